// What the tests of G-rays share: both tracers over one tree, records of a point light, queries.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "asvo/tracer.h"
#include "src/grays/grays.h"
#include "tests/gpu/room.h"

namespace trex::test {

/// "cpu", "device", or "staged": the device driven like a discrete GPU, with memory that is not
/// mapped and the tree in storage buffers.
inline std::unique_ptr<GRayTracer> makeTracer(
    const std::string& kind, const asvo::Tree& tree,
    std::span<const shaderio::PhotonMaterial> materials = {}) {
  if (kind == "cpu") return makeCpuTracer(tree, materials);
  return makeVulkanTracer(tree, materials, -1,
                          {.forceStaging = kind == "staged", .storageBuffers = kind == "staged"});
}

inline asvo::Tree buildTree(const Room& room, int depth) {
  asvo::BuildOptions options;
  options.depth = depth;
  return asvo::Tree::build(room, options);
}

/// First hits of a point light of `watts` a channel in all.
inline std::vector<shaderio::PhotonRecord> pointLight(const asvo::Tree& tree, glm::vec3 position,
                                                      float watts, std::size_t count) {
  Random random(7);
  const asvo::Tracer tracer(tree);
  std::vector<shaderio::PhotonRecord> records;
  for (std::size_t i = 0; i < count; ++i) {
    asvo::Tracer::AsvoHit hit;
    const glm::vec3 direction = random.direction();
    if (!tracer.asvoIntersect(position, direction, 0.0f, 1e30f, hit)) continue;
    records.push_back({position + direction * hit.t, tracer.asvoOctEncode(hit.normal),
                       glm::vec3(watts), static_cast<std::uint32_t>(i)});
  }
  return records;
}

/// Cones from surfaces of the furnished room, the way diffuse gathering casts them.
inline std::vector<shaderio::GatherQuery> roomQueries(const asvo::Tree& tree, std::size_t count) {
  Random random(1);
  const asvo::Tracer tracer(tree);
  const float edge = tree.info.size / static_cast<float>(1u << tree.info.depth);
  std::vector<shaderio::GatherQuery> queries(count);
  for (auto& q : queries) {
    asvo::Tracer::AsvoHit hit;
    glm::vec3 origin, direction;
    do {
      origin = random.inside({0.1f, 0.1f, 0.1f}, {3.9f, 2.9f, 4.9f});
      direction = random.direction();
    } while (!tracer.asvoIntersect(origin, direction, 0.0f, 1e30f, hit));
    q.origin = origin + direction * hit.t + hit.normal * edge;
    q.direction = glm::normalize(hit.normal + 0.999f * random.direction());
    q.tanHalf = 0.15f + 0.15f * random.next();
    q.tmin = 2.0f * edge;
    q.tmax = 1e30f;
    q.jitter = random.next();
    q.flags = random.next() < 0.1f ? shaderio::kQueryShadow : 0u;
    q.index = 0;
  }
  return queries;
}

}  // namespace trex::test
