// Any bytes as a bundle. The mutator changes one section and writes the file anew around it, with
// checksums that fit, else nothing would get past them.
#include <cstring>
#include <memory>
#include <vector>

#include "src/bundle/bundle.h"
#include "src/core/error.h"
#include "tests/fuzz/fuzz.h"
#include "tests/fuzz/json_mutator.h"

namespace {

namespace bundle = trex::bundle;
using Bytes = std::vector<std::byte>;

/// At a multiple of 8, as a mapped file is.
struct Aligned {
  Aligned(const std::uint8_t* data, std::size_t size) : words(size / 8 + 1) {
    std::memcpy(words.data(), data, size);
  }
  std::vector<std::uint64_t> words;
};

Bytes mutated(std::span<const std::byte> section, bool json, std::minstd_rand& random) {
  if (json) {
    const std::string text = trex::fuzz::mutateJson(reinterpret_cast<const char*>(section.data()),
                                                    section.size(), random);
    const auto* first = reinterpret_cast<const std::byte*>(text.data());
    if (!text.empty()) return {first, first + text.size()};
  }
  Bytes out(section.begin(), section.end());
  out.resize(section.size() + 64);
  out.resize(
      LLVMFuzzerMutate(reinterpret_cast<std::uint8_t*>(out.data()), section.size(), out.size()));
  return out;
}

}  // namespace

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const auto owner = std::make_shared<const Aligned>(data, size);
  const auto bytes = std::as_bytes(std::span(owner->words)).first(size);
  try {
    const trex::BundleContents contents =
        trex::readBundle(bytes, owner, "input", {.maxImageBytes = 1u << 22});
    trex::fuzz::require(!contents.description.scene.cameras.empty());
  } catch (const trex::Error&) {
    // Expected.
  }
  return 0;
}

std::size_t LLVMFuzzerCustomMutator(std::uint8_t* data, std::size_t size, std::size_t maxSize,
                                    unsigned seed) {
  std::minstd_rand random(seed);
  try {
    if (random() % 16 == 0) return LLVMFuzzerMutate(data, size, maxSize);
    const Aligned copy(data, size);
    const bundle::Container file(std::as_bytes(std::span(copy.words)).first(size), "input");
    const std::size_t victim = random() % (2 * file.sections().size());
    Bytes changed, out;
    std::vector<bundle::SectionData> sections;
    for (std::size_t i = 0; i < file.sections().size(); ++i) {
      const std::string& name = file.sections()[i].name;
      sections.push_back({name, file.section(name)});
      const bool json = name == "scene.json";
      if (i != victim && !(json && victim >= file.sections().size())) continue;
      changed = mutated(sections.back().bytes, json, random);
      sections.back().bytes = changed;
    }
    if (bundle::containerBytes(sections) > maxSize) return size;
    bundle::writeContainer(sections, [&](std::span<const std::byte> piece) {
      out.insert(out.end(), piece.begin(), piece.end());
    });
    std::memcpy(data, out.data(), out.size());
    return out.size();
  } catch (const trex::Error&) {
    return LLVMFuzzerMutate(data, size, maxSize);
  }
}
