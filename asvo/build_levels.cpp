// The levels above the leaves: structure from Morton keys, data from the children.
#include <oneapi/tbb/blocked_range.h>
#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>

#include "asvo/build_parts.h"

namespace asvo {
namespace {

struct Child {
  uvec4 words;
  Surface surface;
  std::uint32_t octant;
  glm::vec3 normal;
  float weight() const { return surface.sides.x + surface.sides.y; }
};

float coverageOf(const uvec4& voxel, int direction) {
  return static_cast<float>(packer().asvoCoverage(voxel, static_cast<uint>(direction))) / 63.0f;
}

/// Coverage of a face of the parent: its four columns of two cells, averaged. Two cells of a column
/// that face the same way mostly belong to one surface and cover different parts of the column, so
/// their coverages add: composited as if independent, an oblique wall would become transparent.
float columnCoverage(const float (&cells)[8], int axis) {
  float sum = 0.0f;
  for (int octant = 0; octant < 8; ++octant) {
    if ((octant >> axis & 1) == 0) sum += std::min(1.0f, cells[octant] + cells[octant | 1 << axis]);
  }
  return 0.25f * sum;
}

/// Area-weighted normal of the children, aligned as in a leaf; `sides` becomes the area of faces
/// along and against it.
glm::vec3 alignChildren(std::span<const Child> children, vec2& sides) {
  NormalSum normals;
  for (const Child& child : children) {
    normals.add(child.normal, child.surface.sides.x, child.surface.sides.y);
  }
  glm::vec3 sum = normals.normal();
  sides = vec2(0.0f);
  for (const Child& child : children) {
    const bool flips = glm::dot(child.normal, sum) < 0.0f;
    const vec2 own = child.surface.sides;
    sides += flips ? vec2(own.y, own.x) : own;
  }
  if (sides.y > sides.x) {
    std::swap(sides.x, sides.y);
    sum = -sum;
  }
  return sum;
}

std::uint32_t dominantMaterial(std::span<const Child> children) {
  std::uint32_t best = 0;
  float most = -1.0f;
  for (const Child& child : children) {
    const std::uint32_t material = child.words.w & 65535u;
    float weight = 0.0f;
    for (const Child& other : children) {
      if ((other.words.w & 65535u) == material) weight += other.weight();
    }
    if (weight > most) {
      most = weight;
      best = material;
    }
  }
  return best;
}

/// Area of the plane inside a cell of edge 1.
float planeArea(const glm::vec3& normal, float offset) {
  const glm::vec3 helper = std::abs(normal.x) < 0.6f ? glm::vec3(1, 0, 0) : glm::vec3(0, 1, 0);
  const glm::vec3 u = 2.0f * glm::normalize(glm::cross(helper, normal));
  const glm::vec3 v = glm::cross(normal, u), centre = normal * offset;
  Polygon polygon;
  polygon.count = 4;
  polygon.corner[0] = centre - u - v;
  polygon.corner[1] = centre + u - v;
  polygon.corner[2] = centre + u + v;
  polygon.corner[3] = centre - u + v;
  clipToBox(polygon, glm::vec3(0.5f));
  return momentsOf(polygon, normal).area;
}

/// The plane byte of a voxel: bits 0..4 offset, 0 for no plane; bits 5..7 how much of the plane is
/// covered. `area`: of one side, in faces of the voxel.
std::uint32_t planeByte(const Moments& moments, const glm::vec3& normal, float area) {
  // Beyond this standard deviation the surface is not thought to be flat; in edges.
  constexpr float kFlat = 0.1f;
  if (!(moments.area > 0.0f) || !(moments.variance(normal) <= kFlat * kFlat)) return 0;
  const float offset = glm::dot(normal, moments.mean());
  const float step = std::round(offset / Tracer::kAsvoPlaneStep);
  if (std::abs(step) > 15.0f) return 0;
  const float whole = planeArea(normal, offset);
  const float covered = std::min(8.0f * area / std::max(whole, 1e-6f), 8.0f);
  const auto eighths = static_cast<std::uint32_t>(std::max(std::round(covered), 1.0f));
  return static_cast<std::uint32_t>(static_cast<int>(step) + 16) | (eighths - 1u) << 5;
}

/// The surface of the children in the coordinates of their parent.
Moments parentMoments(std::span<const Child> children) {
  Moments moments;
  for (const Child& child : children) {
    const glm::vec3 half(child.octant & 1u, child.octant >> 1 & 1u, child.octant >> 2);
    moments.add(child.surface.moments.moved(0.5f, 0.5f * half - 0.25f), 1.0f);
  }
  return moments;
}

/// `face`: area of a face of the voxel, m^2.
uvec4 filter(std::span<const Child> children, float face, float dither, Surface& surface) {
  VoxelSums sums;
  sums.normal = alignChildren(children, surface.sides);
  sums.area = surface.area() / face;
  surface.moments = parentMoments(children);
  for (const Child& child : children) {
    sums.albedo += child.weight() * packer().asvoUnpackAlbedo(child.words.z);
    sums.weight += child.weight();
    surface.byDirection += child.surface.byDirection;
  }
  sums.byDirection = surface.byDirection / std::max(sums.weight, 1e-30f);
  for (int direction = 0; direction < 6; ++direction) {
    float cells[8] = {};
    for (const Child& child : children) cells[child.octant] = coverageOf(child.words, direction);
    sums.coverage[direction] = columnCoverage(cells, direction / 2);
  }
  sums.material = dominantMaterial(children);
  const glm::vec3 normal = packer().asvoUnpackNormal(packer().asvoPackNormal(sums.normal));
  sums.plane = planeByte(surface.moments, normal, sums.area);
  return sums.pack(dither);
}

/// Fills the voxel of node i from its children.
void filterNode(Tree& tree, std::vector<Surface>& surfaces, float face, float dither,
                std::uint32_t i) {
  std::array<Child, 8> children;
  std::size_t count = 0;
  const uvec2 node = tree.nodes[i];
  for (std::uint32_t octant = 0; octant < 8; ++octant) {
    if ((node.y >> octant & 1u) == 0) continue;
    Child& child = children[count];
    const std::size_t index = node.x + count++;
    child.words = tree.voxels[index];
    child.surface = surfaces[index];
    child.octant = octant;
    child.normal = packer().asvoUnpackNormal(child.words.y);
  }
  tree.voxels[i] = filter({children.data(), count}, face, dither, surfaces[i]);
}

/// Of a level, as the tree keeps it, before all that it has so far.
void keepEmitters(Tree& tree, const std::vector<Surface>& surfaces,
                  const std::vector<EmittedPower>& powers) {
  std::vector<Emitter> level;
  for (const EmittedPower& p : powers) {
    const float area = surfaces[p.node].area();
    // Times the inverse: an area too small to divide by emits nothing.
    const float inverse = area > 1e-30f ? 1.0f / area : 0.0f;
    const Emitter e{p.node, packer().asvoPackRgb9e5(p.side[0] * inverse),
                    packer().asvoPackRgb9e5(p.side[1] * inverse)};
    if ((e.front | e.back) != 0) level.push_back(e);
  }
  tree.emitters.insert(tree.emitters.begin(), level.begin(), level.end());
}

/// Of the parents. `parents`: of each node of the level that starts with node `first`.
std::vector<EmittedPower> parentPowers(const Tree& tree, const std::vector<EmittedPower>& powers,
                                       const std::vector<std::uint32_t>& parents,
                                       std::uint32_t first) {
  const Tracer tracer(tree);
  std::vector<EmittedPower> out;
  for (const EmittedPower& p : powers) {
    const std::uint32_t parent = parents[p.node - first];
    if (out.empty() || out.back().node != parent) {
      out.push_back({parent, {vec3(0.0f), vec3(0.0f)}});
    }
    const bool flips = tracer.asvoFlips(p.node, parent);
    out.back().side[0] += p.side[flips ? 1 : 0];
    out.back().side[1] += p.side[flips ? 0 : 1];
  }
  return out;
}

}  // namespace

void buildLevels(Tree& tree, std::vector<std::uint64_t> keys, std::vector<Surface>& surfaces,
                 std::vector<EmittedPower> emitters) {
  std::vector<std::uint32_t> parents;
  for (int level = static_cast<int>(tree.info.depth) - 1; level >= 0; --level) {
    const float edge = std::ldexp(tree.info.size, -level);
    const std::uint32_t begin = tree.levelOffsets[level], end = tree.levelOffsets[level + 1];
    std::uint32_t parent = begin;
    std::size_t kept = 0;
    keepEmitters(tree, surfaces, emitters);
    parents.clear();
    for (std::size_t k = 0; k < keys.size(); ++k) {
      const std::uint64_t childKey = keys[k], key = childKey >> 3;
      if (k == 0 || keys[kept - 1] != key) {
        keys[kept++] = key;
        parent = begin + static_cast<std::uint32_t>(kept - 1);
        tree.nodes[parent] = uvec2(end + static_cast<std::uint32_t>(k), 0u);
      }
      tree.nodes[parent].y |= 1u << (childKey & 7u);
      if (!emitters.empty()) parents.push_back(parent);
    }
    keys.resize(kept);
    const tbb::blocked_range<std::uint32_t> range(begin, end, 512);
    tbb::parallel_for(range, [&](const auto& part) {
      for (std::uint32_t i = part.begin(); i < part.end(); ++i)
        filterNode(tree, surfaces, edge * edge, ditherOf(keys[i - begin]), i);
    });
    emitters = parentPowers(tree, emitters, parents, end);
  }
  keepEmitters(tree, surfaces, emitters);
}

}  // namespace asvo
