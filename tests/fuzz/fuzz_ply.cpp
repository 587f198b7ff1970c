// Any bytes as a .ply file.
#include "tests/fuzz/fuzz.h"

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  trex::fuzz::importAndCheck(trex::fuzz::writeInput("input.ply", {data, size}));
  return 0;
}
