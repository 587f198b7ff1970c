#include <algorithm>

#include "src/scene/gltf_detail.h"

namespace trex::detail {
namespace {

constexpr std::uint32_t kUnused = 0xffffffffu;

int attribute(const tinygltf::Primitive& p, const std::string& name) {
  const auto found = p.attributes.find(name);
  return found == p.attributes.end() ? -1 : found->second;
}

bool isTriangles(int mode) {
  return mode == TINYGLTF_MODE_TRIANGLES || mode == TINYGLTF_MODE_TRIANGLE_STRIP ||
         mode == TINYGLTF_MODE_TRIANGLE_FAN;
}

std::vector<glm::uvec3> assemble(int mode, const std::vector<std::uint32_t>& i) {
  std::vector<glm::uvec3> triangles;
  const std::size_t n = i.size();
  if (n < 3) return triangles;
  if (mode == TINYGLTF_MODE_TRIANGLES) {
    triangles.reserve(n / 3);
    for (std::size_t k = 0; k + 2 < n; k += 3) triangles.push_back({i[k], i[k + 1], i[k + 2]});
    return triangles;
  }
  triangles.reserve(n - 2);
  for (std::size_t k = 0; k + 2 < n; ++k) {
    glm::uvec3 t(i[k + 1], i[k + 2], i[0]);
    if (mode == TINYGLTF_MODE_TRIANGLE_STRIP) {
      t = k % 2 == 0 ? glm::uvec3(i[k], i[k + 1], i[k + 2]) : glm::uvec3(i[k], i[k + 2], i[k + 1]);
    }
    // Strips are joined by triangles without area.
    if (t.x != t.y && t.y != t.z && t.z != t.x) triangles.push_back(t);
  }
  return triangles;
}

/// Renumbers the vertices in order of index and returns the old numbers, if a good part of them is
/// not used: exporters like to share one vertex buffer among many primitives.
std::vector<std::uint32_t> compact(std::vector<glm::uvec3>& triangles, std::uint64_t vertices) {
  std::vector<std::uint32_t> used;
  if (triangles.size() < vertices / 6) {
    used.reserve(triangles.size() * 3);
    for (const glm::uvec3& t : triangles) used.insert(used.end(), {t.x, t.y, t.z});
    std::sort(used.begin(), used.end());
    used.erase(std::unique(used.begin(), used.end()), used.end());
    for (glm::uvec3& t : triangles) {
      for (int k = 0; k < 3; ++k) {
        t[k] = static_cast<std::uint32_t>(std::lower_bound(used.begin(), used.end(), t[k]) -
                                          used.begin());
      }
    }
    return used;
  }
  std::vector<std::uint32_t> renumbered(vertices, kUnused);
  for (const glm::uvec3& t : triangles) {
    for (int k = 0; k < 3; ++k) renumbered[t[k]] = 0;
  }
  for (std::uint32_t v = 0; v < vertices; ++v) {
    if (renumbered[v] == kUnused) continue;
    renumbered[v] = static_cast<std::uint32_t>(used.size());
    used.push_back(v);
  }
  if (used.size() < vertices) {
    for (glm::uvec3& t : triangles) {
      t = {renumbered[t.x], renumbered[t.y], renumbered[t.z]};
    }
  }
  return used;
}

}  // namespace

const std::vector<int>& GltfMeshes::use(int gltfMesh) {
  const auto& meshes = context_.model.meshes;
  if (gltfMesh < 0 || std::size_t(gltfMesh) >= meshes.size()) {
    context_.bad("mesh {} does not exist; there are {}", gltfMesh, meshes.size());
  }
  const auto [at, isNew] = done_.try_emplace(gltfMesh);
  if (!isNew) return at->second;
  const tinygltf::Mesh& mesh = meshes[gltfMesh];
  for (std::size_t i = 0; i < mesh.primitives.size(); ++i) {
    const tinygltf::Primitive& p = mesh.primitives[i];
    const std::string where = fmt::format("mesh {} ('{}') primitive {}", gltfMesh, mesh.name, i);
    if (!isTriangles(p.mode)) {
      if (p.mode < 0 || p.mode > TINYGLTF_MODE_TRIANGLE_FAN) {
        context_.bad("{}: mode {} does not exist", where, p.mode);
      }
      context_.warn("{}: points and lines are skipped", where);
      continue;
    }
    if (!p.targets.empty()) context_.warn("morph targets are ignored");
    at->second.push_back(primitive(p, where, mesh.name));
  }
  return at->second;
}

int GltfMeshes::primitive(const tinygltf::Primitive& p, const std::string& where,
                          const std::string& name) {
  const int material = materials_.use(p.material);
  const int set = materials_.texCoordSet(material);
  const std::string texCoord = fmt::format("TEXCOORD_{}", set);
  const int uv = set < 0 ? -1 : attribute(p, texCoord);
  if (set >= 0 && uv < 0) {
    context_.warn("{}: its material has textures, but there is no {}", where, texCoord);
  }
  const std::string key =
      fmt::format("{} {} {} {} {} {}", attribute(p, "POSITION"), attribute(p, "NORMAL"),
                  attribute(p, "COLOR_0"), uv, p.indices, p.mode);
  auto& meshes = context_.scene.meshes;
  const int next = static_cast<int>(meshes.size());
  const auto [first, isNew] = byGeometry_.try_emplace(key, next);
  const auto [same, isNewPair] = byMaterial_.try_emplace({first->second, material}, next);
  if (!isNewPair) return same->second;
  Mesh mesh;
  if (isNew) {
    readGeometry(p, uv < 0 ? -1 : set, where, mesh);
  } else {
    mesh = meshes[first->second];
    mesh.sameGeometryAs = first->second;
  }
  mesh.name = name;
  mesh.material = material;
  meshes.push_back(std::move(mesh));
  return next;
}

std::vector<std::uint32_t> GltfMeshes::readIndices(const tinygltf::Primitive& p,
                                                   std::uint64_t vertices,
                                                   const std::string& where) const {
  std::vector<std::uint32_t> indices;
  if (p.indices < 0) {
    indices.resize(vertices);
    for (std::uint64_t i = 0; i < vertices; ++i) indices[i] = static_cast<std::uint32_t>(i);
    return indices;
  }
  const GltfAccessor accessor(context_, p.indices);
  const int type = accessor.componentType();
  if (accessor.components() != 1 || (type != TINYGLTF_COMPONENT_TYPE_UNSIGNED_BYTE &&
                                     type != TINYGLTF_COMPONENT_TYPE_UNSIGNED_SHORT &&
                                     type != TINYGLTF_COMPONENT_TYPE_UNSIGNED_INT)) {
    context_.bad("{}: indices (accessor {}) must be unsigned integers", where, p.indices);
  }
  indices.resize(accessor.count());
  for (std::uint64_t i = 0; i < accessor.count(); ++i) {
    indices[i] = accessor.index(i);
    if (indices[i] >= vertices) {
      context_.bad("{}: index {} is vertex {}, but there are {}", where, i, indices[i], vertices);
    }
  }
  return indices;
}

void GltfMeshes::readGeometry(const tinygltf::Primitive& p, int texCoordSet,
                              const std::string& where, Mesh& mesh) {
  const int positionIndex = attribute(p, "POSITION");
  if (positionIndex < 0) context_.bad("{}: has no POSITION", where);
  const GltfAccessor positions(context_, positionIndex);
  const auto checked = [&](const GltfAccessor& a, const char* what, int least, int most) {
    if (a.components() < least || a.components() > most) {
      context_.bad("{}: {} has {} components", where, what, a.components());
    }
    if (a.count() != positions.count()) {
      context_.bad("{}: {} has {} elements, POSITION {}", where, what, a.count(),
                   positions.count());
    }
  };
  checked(positions, "POSITION", 3, 3);
  {
    const std::vector<std::uint32_t> indices = readIndices(p, positions.count(), where);
    if (p.mode == TINYGLTF_MODE_TRIANGLES && indices.size() % 3 != 0) {
      context_.warn("{}: {} indices are not whole triangles; the rest is ignored", where,
                    indices.size());
    }
    mesh.triangles = assemble(p.mode, indices);
  }
  const std::vector<std::uint32_t> used = compact(mesh.triangles, positions.count());
  mesh.positions.reserve(used.size());
  for (const std::uint32_t v : used) {
    mesh.positions.push_back({positions.value(v, 0), positions.value(v, 1), positions.value(v, 2)});
  }
  if (const int index = attribute(p, "NORMAL"); index >= 0) {
    const GltfAccessor normals(context_, index);
    checked(normals, "NORMAL", 3, 3);
    mesh.normals.reserve(used.size());
    for (const std::uint32_t v : used) {
      mesh.normals.push_back({normals.value(v, 0), normals.value(v, 1), normals.value(v, 2)});
    }
  }
  if (texCoordSet >= 0) {
    const GltfAccessor uv(context_, attribute(p, fmt::format("TEXCOORD_{}", texCoordSet)));
    checked(uv, "TEXCOORD", 2, 2);
    mesh.texCoords.reserve(used.size());
    for (const std::uint32_t v : used) mesh.texCoords.push_back({uv.value(v, 0), uv.value(v, 1)});
  }
  if (const int index = attribute(p, "COLOR_0"); index >= 0) {
    const GltfAccessor colors(context_, index);
    checked(colors, "COLOR_0", 3, 4);
    if (colors.componentType() != TINYGLTF_COMPONENT_TYPE_FLOAT && !colors.normalized()) {
      context_.bad("{}: integer COLOR_0 (accessor {}) must be normalized", where, index);
    }
    mesh.colors.reserve(used.size());
    for (const std::uint32_t v : used) {
      glm::u8vec4 c(255);
      for (int k = 0; k < colors.components(); ++k) c[k] = toUnorm8(colors.value(v, k));
      mesh.colors.push_back(c);
    }
  }
  sanitiseMesh(context_.scene, mesh, context_.name + ": " + where);
}

}  // namespace trex::detail
