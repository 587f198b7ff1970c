// Any bytes as an .asvo file: cones and rays go through what fromBytes() accepts. The mutator
// changes one section and repairs the checksums, else nothing would get past them.
#define XXH_INLINE_ALL
#include <xxhash.h>

#include <algorithm>
#include <cstring>
#include <random>

#include "asvo/tracer.h"
#include "tests/fuzz/fuzz.h"

namespace {

using trex::fuzz::require;

/// Offsets in the file, from FORMAT.md.
constexpr std::size_t kInfo = 32, kSections = 64, kEmitters = 128, kHash = 136, kHeader = 144;

template <typename T>
T read(const std::uint8_t* data) {
  T value;
  std::memcpy(&value, data, sizeof(value));
  return value;
}
void write(std::uint8_t* data, std::uint64_t value) { std::memcpy(data, &value, sizeof(value)); }

void trace(const asvo::Tree& tree) {
  const std::vector<asvo::uvec4> light(tree.nodes.size(), asvo::uvec4(0x7fffffffu));
  const asvo::Tracer tracer(tree, light);
  const glm::vec3 lower(tree.info.lowerX, tree.info.lowerY, tree.info.lowerZ);
  std::mt19937 random(1);
  std::uniform_real_distribution<float> unit(0.0f, 1.0f);
  for (int i = 0; i < 16; ++i) {
    const float x = unit(random), y = unit(random), z = unit(random);
    const glm::vec3 origin = lower + glm::vec3(x, y, z) * tree.info.size;
    const glm::vec3 direction = glm::normalize(glm::vec3(y - z, z - x, x - 0.5f) + 1e-6f);
    const asvo::Tracer::AsvoCone cone =
        tracer.asvoMarch(origin, direction, 0.4f * unit(random), 0.0f, 1e30f, unit(random), true);
    require(cone.transmittance == -1.0f ||
            (cone.transmittance >= 0.0f && cone.transmittance <= 1.0f));
    require(cone.radiance.x >= 0.0f && cone.radiance.y >= 0.0f && cone.radiance.z >= 0.0f);
    asvo::Tracer::AsvoHit hit;
    if (!tracer.asvoIntersect(origin, direction, 0.0f, 1e30f, hit)) continue;
    require(hit.voxel >= tree.info.firstLeaf && hit.voxel < tree.info.nodeCount && hit.sub < 64);
  }
}

/// Start and length of a section, held inside the file.
std::pair<std::size_t, std::size_t> section(const std::uint8_t* data, std::size_t size, int i) {
  const std::uint64_t nodes = read<std::uint32_t>(data + kInfo + 20);
  const std::uint64_t leaves = read<std::uint32_t>(data + kInfo + 28);
  const std::uint64_t emitters = read<std::uint32_t>(data + kEmitters);
  const std::uint64_t lengths[4] = {nodes * 8, nodes * 16, leaves * 8, emitters * 12};
  const std::uint64_t at =
      std::min<std::uint64_t>(read<std::uint64_t>(data + kSections + 16 * i), size);
  return {at, std::min<std::uint64_t>(lengths[i], size - at)};
}

void repair(std::uint8_t* data, std::size_t size) {
  for (int i = 0; i < 4; ++i) {
    const auto [at, length] = section(data, size, i);
    write(data + kSections + 16 * i + 8, XXH3_64bits(data + at, length));
  }
  write(data + 16, size);
  std::memset(data + kEmitters + 4, 0, 4);
  write(data + kHash, XXH3_64bits(data, kHash));
}

}  // namespace

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  try {
    trace(asvo::Tree::fromBytes(std::as_bytes(std::span(data, size))));
  } catch (const asvo::FormatError&) {
    // Expected.
  }
  return 0;
}

std::size_t LLVMFuzzerCustomMutator(std::uint8_t* data, std::size_t size, std::size_t maxSize,
                                    unsigned seed) {
  std::minstd_rand random(seed);
  if (size < kHeader) return LLVMFuzzerMutate(data, size, maxSize);
  const int which = static_cast<int>(random() % 16);
  if (which == 15) size = LLVMFuzzerMutate(data, size, maxSize);
  if (size < kHeader) return size;
  std::pair<std::size_t, std::size_t> part{kInfo, 32};
  if (which < 12) part = section(data, size, which % 4);
  if (which < 15 && part.second > 0) {
    const std::size_t skip = random() % part.second;
    const std::size_t count = std::min<std::size_t>(part.second - skip, 1 + random() % 32);
    LLVMFuzzerMutate(data + part.first + skip, count, count);
  }
  if (random() % 64 != 0) repair(data, size);
  return size;
}
