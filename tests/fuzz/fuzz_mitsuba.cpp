// Any bytes as a Mitsuba scene; behind a line "=====" those of a serialized mesh, m.serialized.
#include "tests/fuzz/fuzz.h"

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const auto [scene, mesh] = trex::fuzz::split({data, size}, "=====\n");
  trex::fuzz::writeInput("m.serialized", mesh);
  trex::fuzz::importAndCheck(trex::fuzz::writeInput("input.xml", scene));
  return 0;
}
