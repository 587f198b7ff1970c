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
  uvec4 first, second;
  Surface surface;
  std::uint32_t octant;
  glm::vec3 normal;
  float weight() const { return surface.sides.x + surface.sides.y; }
};

float coverageOf(const uvec4& voxel, int direction) {
  const std::uint32_t word = direction < 4 ? voxel.x : voxel.y;
  return static_cast<float>(word >> (8 * (direction & 3)) & 255u) * (1.0f / 255.0f);
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
    const std::uint32_t material = child.first.y >> 16;
    float weight = 0.0f;
    for (const Child& other : children) {
      if (other.first.y >> 16 == material) weight += other.weight();
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
void filter(std::span<const Child> children, float face, uvec4& first, uvec4& second,
            Surface& surface) {
  VoxelSums sums;
  sums.normal = alignChildren(children, surface.sides);
  sums.area = std::max(surface.sides.x, surface.sides.y);
  surface.moments = parentMoments(children);
  // The side of a child is decided by the packed normals, as its readers do (asvoFlips).
  const glm::vec3 normal = packer().asvoOctDecode(packer().asvoOctEncode(sums.normal));
  for (const Child& child : children) {
    const int side = glm::dot(child.normal, normal) < 0.0f ? 1 : 0;
    const float area = std::bit_cast<float>(child.second.z);
    sums.albedo += child.weight() * packer().asvoUnpackAlbedo(child.first.z);
    sums.weight += child.weight();
    sums.power[side] += area * packer().asvoUnpackRgb9e5(child.second.x);
    sums.power[1 - side] += area * packer().asvoUnpackRgb9e5(child.second.y);
  }
  for (int direction = 0; direction < 6; ++direction) {
    float cells[8] = {};
    for (const Child& child : children) cells[child.octant] = coverageOf(child.first, direction);
    sums.coverage[direction] = columnCoverage(cells, direction / 2);
  }
  sums.material = dominantMaterial(children);
  sums.pack(first, second);
  first.z |= planeByte(surface.moments, normal, sums.area / face) << 24;
}

/// Fills the voxel of node i from its children.
void filterNode(Tree& tree, std::vector<Surface>& surfaces, float face, std::uint32_t i) {
  std::array<Child, 8> children;
  std::size_t count = 0;
  const uvec2 node = tree.nodes[i];
  for (std::uint32_t octant = 0; octant < 8; ++octant) {
    if ((node.y >> octant & 1u) == 0) continue;
    Child& child = children[count];
    const std::size_t index = node.x + count++;
    child.first = tree.voxels[2 * index];
    child.second = tree.voxels[2 * index + 1];
    child.surface = surfaces[index];
    child.octant = octant;
    child.normal = packer().asvoOctDecode(child.first.w);
  }
  filter({children.data(), count}, face, tree.voxels[2ull * i], tree.voxels[2ull * i + 1],
         surfaces[i]);
}

}  // namespace

void buildLevels(Tree& tree, std::vector<std::uint64_t> keys, std::vector<Surface>& surfaces) {
  for (int level = static_cast<int>(tree.info.depth) - 1; level >= 0; --level) {
    const float edge = std::ldexp(tree.info.size, -level);
    const std::uint32_t begin = tree.levelOffsets[level], end = tree.levelOffsets[level + 1];
    std::uint32_t parent = begin;
    std::size_t kept = 0;
    for (std::size_t k = 0; k < keys.size(); ++k) {
      const std::uint64_t childKey = keys[k], key = childKey >> 3;
      if (k == 0 || keys[kept - 1] != key) {
        keys[kept++] = key;
        parent = begin + static_cast<std::uint32_t>(kept - 1);
        tree.nodes[parent] = uvec2(end + static_cast<std::uint32_t>(k), 0u);
      }
      tree.nodes[parent].y |= 1u << (childKey & 7u);
    }
    keys.resize(kept);
    const tbb::blocked_range<std::uint32_t> range(begin, end, 512);
    tbb::parallel_for(range, [&](const auto& part) {
      for (std::uint32_t i = part.begin(); i < part.end(); ++i)
        filterNode(tree, surfaces, edge * edge, i);
    });
  }
}

}  // namespace asvo
