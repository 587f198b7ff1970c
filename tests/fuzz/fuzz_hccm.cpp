// Any bytes as an HCCMesh: what fromBytes() accepts is decoded and traced. The mutator repairs the
// size and the checksum, else nothing would get past them.
#include <tbb/global_control.h>

#include <cstring>
#include <random>

#include "hccmesh/hccmesh.h"
#include "hccmesh/layout.h"
#include "hccmesh/validate.h"
#include "tests/fuzz/fuzz.h"

namespace {

using trex::fuzz::require;

void traceAll(const hccm::Mesh& mesh) {
  glm::vec3 lower, upper;
  mesh.bounds(lower, upper);
  std::mt19937 random(1);
  std::uniform_real_distribution<float> unit(-0.2f, 1.2f);
  const auto point = [&] {
    const float x = unit(random), y = unit(random), z = unit(random);
    return lower + (upper - lower) * glm::vec3(x, y, z);
  };
  for (int i = 0; i < 16; ++i) {
    const glm::vec3 from = point(), to = point();
    hccm::PreparedRay ray = mesh.prepare({from, 0.0f, to - from, i % 2 ? 1.0f : INFINITY});
    hccm::Hit hit;
    for (std::uint32_t c = 0; c < mesh.clusterCount(); ++c) {
      const bool first = hit.cluster == hccm::Hit::kNothing, shadowed = mesh.occluded(c, ray);
      const bool nearer = mesh.intersect(c, ray, hit);
      require(first ? nearer == shadowed : !nearer || shadowed);
    }
    hccm::PreparedRay again = mesh.prepare({from, 0.0f, to - from, i % 2 ? 1.0f : INFINITY});
    hccm::Hit top;
    require(mesh.occluded(again) == (hit.cluster != hccm::Hit::kNothing));
    require(mesh.intersect(again, top) == (hit.cluster != hccm::Hit::kNothing));
    require(top.cluster == hit.cluster && top.triangle == hit.triangle);
    if (hit.cluster == hccm::Hit::kNothing) continue;
    require(hit.cluster < mesh.clusterCount());
    const std::uint32_t leaf = hit.triangle / 8, place = hit.triangle % 8;
    require(leaf < mesh.clusterLeafCount(hit.cluster));
    require(place < mesh.leafTriangleCount(hit.cluster, leaf));
  }
}

void decodeAll(const hccm::Mesh& mesh) {
  std::uint64_t triangles = 0;
  for (std::uint32_t c = 0; c < mesh.clusterCount(); ++c) {
    glm::vec3 lower, upper;
    mesh.clusterBounds(c, lower, upper);
    for (std::uint32_t leaf = 0; leaf < mesh.clusterLeafCount(c); ++leaf)
      for (std::uint32_t i = 0; i < mesh.leafTriangleCount(c, leaf); ++i, ++triangles)
        for (const glm::vec3& p : mesh.triangle(c, 8 * leaf + i).position)
          require(glm::all(glm::lessThanEqual(lower, p)) && glm::all(glm::lessThanEqual(p, upper)));
  }
  require(triangles == mesh.triangleCount() && mesh.sizes().total() == mesh.bytes().size());
}

}  // namespace

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
  const auto bytes = std::as_bytes(std::span(data, size));
  try {
    const hccm::Mesh mesh = hccm::Mesh::fromBytes({bytes.begin(), bytes.end()});
    decodeAll(mesh);
    traceAll(mesh);
  } catch (const hccm::FormatError&) {
    // Expected.
  }
  return 0;
}

std::size_t LLVMFuzzerCustomMutator(std::uint8_t* data, std::size_t size, std::size_t maxSize,
                                    unsigned seed) {
  using hccm::layout::Header;
  constexpr std::size_t kLeast = sizeof(Header) + hccm::layout::kTailBytes;
  std::minstd_rand random(seed);
  if (size > kLeast && random() % 8 != 0) {
    // A few bytes in place: the parts keep where they are.
    const std::size_t at = 24 + random() % (size - kLeast + sizeof(Header) - 24);
    const std::size_t count = std::min<std::size_t>(size - at, 1 + random() % 16);
    LLVMFuzzerMutate(data + at, count, count);
  } else {
    size = LLVMFuzzerMutate(data, size, maxSize);
  }
  if (size < kLeast || random() % 64 == 0) return size;
  const std::uint64_t total = size;
  std::memcpy(data + offsetof(Header, byteSize), &total, sizeof(total));
  const std::uint64_t hash = hccm::checksumOf(std::as_bytes(std::span(data, size)));
  std::memcpy(data + offsetof(Header, checksum), &hash, sizeof(hash));
  return size;
}
