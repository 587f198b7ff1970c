// Any bytes as an .obj file; what follows a line "#mtl" is its material library, input.mtl.
#include "tests/fuzz/fuzz.h"

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const auto [model, materials] = trex::fuzz::split({data, size}, "\n#mtl\n");
  trex::fuzz::writeInput("input.mtl", materials);
  trex::fuzz::importAndCheck(trex::fuzz::writeInput("input.obj", model));
  return 0;
}
