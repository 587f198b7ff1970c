#include "src/scene/scene.h"

#include <algorithm>

#include "src/core/error.h"

namespace trex {
namespace {

dvec3 position(const Mesh& mesh, std::uint32_t vertex) {
  return mesh.origin + dvec3(mesh.positions[vertex]);
}

dvec3 transformed(const dmat4& m, const dvec3& p) { return dvec3(m * glm::dvec4(p, 1.0)); }

/// Box of the vertices that triangles use, in the mesh's own space.
Box3d meshBounds(const Mesh& mesh) {
  Box3f local;
  for (const glm::uvec3& t : mesh.triangles) {
    for (int k = 0; k < 3; ++k) local.extend(mesh.positions[t[k]]);
  }
  Box3d box;
  if (local.empty()) return box;
  box.extend(mesh.origin + dvec3(local.lower));
  box.extend(mesh.origin + dvec3(local.upper));
  return box;
}

/// True if each axis is mapped to one axis: then the box of the corners is the box of the points.
bool keepsAxes(const dmat4& m) {
  for (int column = 0; column < 3; ++column) {
    int nonZero = 0;
    for (int row = 0; row < 3; ++row) nonZero += m[column][row] != 0.0;
    if (nonZero > 1) return false;
  }
  return true;
}

}  // namespace

glm::u8vec4 packVertexColor(const vec4& linear) {
  glm::u8vec4 packed;
  for (int k = 0; k < 4; ++k) {
    const float c = linear[k] > 0.0f ? std::min(linear[k], 1.0f) : 0.0f;
    packed[k] = static_cast<std::uint8_t>((k < 3 ? encodeSrgb(c) : c) * 255.0f + 0.5f);
  }
  return packed;
}

vec4 unpackVertexColor(glm::u8vec4 packed) {
  static const std::array<float, 256> kLinear = [] {
    std::array<float, 256> table{};
    for (std::size_t i = 0; i < table.size(); ++i) {
      table[i] = decodeSrgb8(static_cast<std::uint8_t>(i));
    }
    return table;
  }();
  return {kLinear[packed.x], kLinear[packed.y], kLinear[packed.z],
          static_cast<float>(packed.w) / 255.0f};
}

vec4 unpackVertexColor(const vec4& packed) {
  return unpackVertexColor(glm::u8vec4(packed * 255.0f + 0.5f));
}

void Replaced::add(std::string text, std::uint64_t parts) {
  text = oneLine(std::move(text));
  count += parts;
  if (texts.size() >= kMostTexts) return;
  if (std::find(texts.begin(), texts.end(), text) == texts.end()) texts.push_back(std::move(text));
}

std::uint64_t Scene::triangleCount() const {
  std::uint64_t count = 0;
  for (const Instance& instance : instances) count += meshes[instance.mesh].triangles.size();
  return count;
}

std::uint64_t Scene::uniqueTriangleCount() const {
  std::uint64_t count = 0;
  for (const Mesh& mesh : meshes) {
    if (mesh.sameGeometryAs == kNone) count += mesh.triangles.size();
  }
  return count;
}

Box3d Scene::bounds() const {
  std::vector<Box3d> local(meshes.size());
  for (std::size_t i = 0; i < meshes.size(); ++i) local[i] = meshBounds(meshes[i]);
  Box3d box;
  for (const Instance& instance : instances) {
    const Mesh& mesh = meshes[instance.mesh];
    const Box3d& b = local[instance.mesh];
    if (b.empty()) continue;
    if (keepsAxes(instance.transform)) {
      box.extend(transformed(instance.transform, b.lower));
      box.extend(transformed(instance.transform, b.upper));
      continue;
    }
    for (const glm::uvec3& t : mesh.triangles) {
      for (int k = 0; k < 3; ++k) {
        box.extend(transformed(instance.transform, position(mesh, t[k])));
      }
    }
  }
  return box;
}

}  // namespace trex
