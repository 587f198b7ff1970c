// Any bytes as the scene.json of a bundle.
#include <cstring>

#include "src/bundle/contents.h"
#include "src/core/error.h"
#include "tests/fuzz/fuzz.h"
#include "tests/fuzz/json_mutator.h"

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using trex::fuzz::require;
  try {
    const trex::bundle::Description d =
        trex::bundle::readDescription(std::as_bytes(std::span(data, size)), "input");
    const trex::Scene& s = d.scene;
    require(!s.materials.empty() && !s.cameras.empty());
    for (const trex::Mesh& m : s.meshes) {
      require(m.material >= 0 && static_cast<std::size_t>(m.material) < s.materials.size());
    }
    for (const trex::Instance& i : s.instances) {
      require(i.mesh >= 0 && static_cast<std::size_t>(i.mesh) < s.meshes.size());
    }
    // What was read is written and read back alike.
    const std::string text = trex::bundle::writeDescription(d);
    const auto again = trex::bundle::readDescription(std::as_bytes(std::span(text)), "again");
    require(trex::bundle::writeDescription(again) == text);
  } catch (const trex::Error&) {
    // Expected.
  }
  return 0;
}

std::size_t LLVMFuzzerCustomMutator(std::uint8_t* data, std::size_t size, std::size_t maxSize,
                                    unsigned seed) {
  std::minstd_rand random(seed);
  if (random() % 8 != 0) {
    const std::string text =
        trex::fuzz::mutateJson(reinterpret_cast<const char*>(data), size, random);
    if (!text.empty() && text.size() <= maxSize) {
      std::memcpy(data, text.data(), text.size());
      return text.size();
    }
  }
  return LLVMFuzzerMutate(data, size, maxSize);
}
