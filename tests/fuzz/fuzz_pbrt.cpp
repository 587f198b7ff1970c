// Any bytes as a .pbrt file; what follows a line "#in" is a file that it may include, in.pbrt.
#include "tests/fuzz/fuzz.h"

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const auto [scene, included] = trex::fuzz::split({data, size}, "\n#in\n");
  trex::fuzz::writeInput("in.pbrt", included);
  trex::fuzz::importAndCheck(trex::fuzz::writeInput("input.pbrt", scene));
  return 0;
}
