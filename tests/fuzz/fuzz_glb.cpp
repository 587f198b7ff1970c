// Any bytes as a .glb file.
#include "tests/fuzz/glb_mutator.h"

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const auto path = trex::fuzz::writeInput("input.glb", {data, size});
  trex::fuzz::importAndCheck(path);
  if (trex::fuzz::contains({data, size}, "animations")) trex::fuzz::importAndCheck(path, "0");
  return 0;
}

std::size_t LLVMFuzzerCustomMutator(std::uint8_t* data, std::size_t size, std::size_t maxSize,
                                    unsigned seed) {
  return trex::fuzz::mutateGlb(data, size, maxSize, seed);
}
