// Any bytes as a .glb file.
#include "tests/fuzz/glb_mutator.h"

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const auto path = trex::fuzz::writeInput("input.glb", {data, size});
  // Half of those that may move are posed: both ways read what comes before the pose alike.
  const bool posed = size % 2 == 0 && trex::fuzz::contains({data, size}, "animations");
  trex::fuzz::importAndCheck(path, posed ? "0" : "");
  return 0;
}

std::size_t LLVMFuzzerCustomMutator(std::uint8_t* data, std::size_t size, std::size_t maxSize,
                                    unsigned seed) {
  return trex::fuzz::mutateGlb(data, size, maxSize, seed);
}
