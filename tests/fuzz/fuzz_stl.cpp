// Any bytes as an .stl file, imported and streamed.
#include "tests/fuzz/fuzz.h"

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const auto path = trex::fuzz::writeInput("input.stl", {data, size});
  trex::fuzz::importAndCheck(path);
  trex::fuzz::streamAndCheck(path);
  return 0;
}
