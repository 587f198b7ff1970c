// Any bytes as an .stl file, imported and streamed.
#include "src/core/error.h"
#include "src/scene/triangle_stream.h"
#include "tests/fuzz/fuzz.h"

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const auto path = trex::fuzz::writeInput("input.stl", {data, size});
  trex::fuzz::importAndCheck(path);
  try {
    const auto stream = trex::openTriangleStream(path);
    trex::TriangleBatch batch;
    for (std::uint64_t b = 0; b < stream->batchCount(); ++b) stream->batch(b, batch);
  } catch (const trex::Error&) {
  }
  return 0;
}
