// Any bytes as what the process that reads with assimp hands over (src/assimp/child.h).
#include "src/core/error.h"
#include "src/core/log.h"
#include "src/scene/import_detail.h"
#include "tests/fuzz/glb_mutator.h"

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  trex::setLogLevel(trex::LogLevel::kQuiet);
  try {
    trex::detail::readHandedOver({data, size}, "model.fbx", {.loadTextures = false});
  } catch (const trex::Error& error) {
    trex::fuzz::require(error.code() == trex::ExitCode::kInput);
  }
  return 0;
}

std::size_t LLVMFuzzerCustomMutator(std::uint8_t* data, std::size_t size, std::size_t maxSize,
                                    unsigned seed) {
  return trex::fuzz::mutateGlb(data, size, maxSize, seed);
}
