// Any bytes as a .ply file, imported and streamed.
#include "tests/fuzz/fuzz.h"

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const auto path = trex::fuzz::writeInput("input.ply", {data, size});
  trex::fuzz::importAndCheck(path);
  trex::fuzz::streamAndCheck(path);
  trex::fuzz::streamAndCheck(path, 0.25);
  return 0;
}
