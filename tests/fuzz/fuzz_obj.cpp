// Any bytes as an .obj file, imported and streamed; what follows a line "#mtl" is its material
// library, input.mtl.
#include "tests/fuzz/fuzz.h"

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const auto [model, materials] = trex::fuzz::split({data, size}, "\n#mtl\n");
  trex::fuzz::writeInput("input.mtl", materials);
  const auto path = trex::fuzz::writeInput("input.obj", model);
  trex::fuzz::importAndCheck(path);
  trex::fuzz::streamAndCheck(path);
  return 0;
}
