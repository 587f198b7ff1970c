#include <algorithm>
#include <optional>

#include "src/scene/gltf_compressed.h"
#include "src/scene/gltf_detail.h"
#include "src/scene/gltf_pose.h"

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

void dropUnused(std::vector<glm::uvec3>& triangles) {
  std::erase_if(triangles, [](const glm::uvec3& t) {
    return t.x == kUnused || t.y == kUnused || t.z == kUnused;
  });
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

/// How one set of coordinates comes from another, which is kept in that place: scaled and shifted
/// along each axis. Nothing if it does not.
std::optional<GltfMaterials::SetMap> mapOfSets(std::size_t place, const GltfAccessor& a,
                                               const GltfAccessor& b) {
  constexpr float kSlack = 2e-5f;
  GltfMaterials::SetMap map;
  map.set = static_cast<std::uint8_t>(place);
  if (a.components() != 2 || b.components() != 2 || a.count() != b.count()) return {};
  for (int axis = 0; axis < 2; ++axis) {
    std::uint64_t least = 0, most = 0;
    for (std::uint64_t i = 0; i < a.count(); ++i) {
      if (a.value(i, axis) < a.value(least, axis)) least = i;
      if (a.value(i, axis) > a.value(most, axis)) most = i;
    }
    const float range = a.value(most, axis) - a.value(least, axis);
    if (range > 0.0f) map.scale[axis] = (b.value(most, axis) - b.value(least, axis)) / range;
    map.offset[axis] = b.value(least, axis) - map.scale[axis] * a.value(least, axis);
    for (std::uint64_t i = 0; i < a.count(); ++i) {
      const float there = map.scale[axis] * a.value(i, axis) + map.offset[axis];
      if (!(std::abs(there - b.value(i, axis)) <= kSlack)) return {};
    }
  }
  return map;
}

}  // namespace

GltfMeshes::GltfMeshes(GltfContext& context, GltfMaterials& materials)
    : context_(context), materials_(materials) {
  const std::string& wanted = context.options.variant;
  if (wanted.empty()) return;
  std::string names;
  const auto found = context.model.extensions.find("KHR_materials_variants");
  if (found != context.model.extensions.end() && found->second.IsObject() &&
      found->second.Has("variants") && found->second.Get("variants").IsArray()) {
    const tinygltf::Value& variants = found->second.Get("variants");
    for (int i = 0; i < static_cast<int>(variants.ArrayLen()) && variant_ == kNone; ++i) {
      const tinygltf::Value& v = variants.Get(i);
      const std::string name = v.IsObject() && v.Has("name") && v.Get("name").IsString()
                                   ? v.Get("name").Get<std::string>()
                                   : std::string();
      if (name == wanted || std::to_string(i) == wanted) variant_ = i;
      if (i < 20) names += (i > 0 ? ", " : "") + name;
    }
  }
  if (variant_ == kNone) {
    fail(ExitCode::kUsage, "{}: has no variant '{}'; it has {}", context.name, wanted,
         names.empty() ? "none" : names);
  }
}

std::vector<int> GltfMeshes::use(int gltfMesh, const GltfDeformation& deformation) {
  if (!deformation.none()) return primitives(gltfMesh, deformation);
  const auto [at, isNew] = done_.try_emplace(gltfMesh);
  if (isNew) at->second = primitives(gltfMesh, deformation);
  return at->second;
}

std::vector<int> GltfMeshes::primitives(int gltfMesh, const GltfDeformation& deformation) {
  const auto& meshes = context_.model.meshes;
  std::vector<int> made;
  if (gltfMesh < 0 || std::size_t(gltfMesh) >= meshes.size()) {
    context_.replace("mesh {} does not exist; there are {}; it is left out", gltfMesh,
                     meshes.size());
    return made;
  }
  const tinygltf::Mesh& mesh = meshes[gltfMesh];
  for (std::size_t i = 0; i < mesh.primitives.size(); ++i) {
    const tinygltf::Primitive& p = mesh.primitives[i];
    const std::string where = fmt::format("mesh {} ('{}') primitive {}", gltfMesh, mesh.name, i);
    if (!isTriangles(p.mode)) {
      if (p.mode < 0 || p.mode > TINYGLTF_MODE_TRIANGLE_FAN) {
        context_.replace("{}: mode {} does not exist; it is left out", where, p.mode);
      } else {
        context_.replace("{}: it is of points or lines, which are left out", where);
      }
      continue;
    }
    context_.attempt(kLeftOut,
                     [&] { made.push_back(primitive(p, where, mesh.name, deformation)); });
  }
  return made;
}

/// The material of the variant that is shown, or the primitive's own.
int GltfMeshes::materialOf(const tinygltf::Primitive& p) const {
  const auto found = p.extensions.find("KHR_materials_variants");
  if (variant_ == kNone || found == p.extensions.end() || !found->second.IsObject() ||
      !found->second.Has("mappings") || !found->second.Get("mappings").IsArray()) {
    return p.material;
  }
  const tinygltf::Value& mappings = found->second.Get("mappings");
  for (int m = 0; m < static_cast<int>(mappings.ArrayLen()); ++m) {
    const tinygltf::Value& mapping = mappings.Get(m);
    if (!mapping.IsObject() || !mapping.Has("variants") || !mapping.Get("variants").IsArray() ||
        !mapping.Has("material") || !mapping.Get("material").IsNumber()) {
      continue;
    }
    const tinygltf::Value& variants = mapping.Get("variants");
    for (int v = 0; v < static_cast<int>(variants.ArrayLen()); ++v) {
      if (variants.Get(v).IsNumber() && indexOf(variants.Get(v)) == variant_) {
        return indexOf(mapping.Get("material"));
      }
    }
  }
  return p.material;
}

/// Which sets of coordinates a primitive keeps for its material, and the material that reads these:
/// sets that are another one scaled and shifted are not kept, those that are missing read 0,0.
int GltfMeshes::chooseSets(int material, const tinygltf::Primitive& p, const std::string& where,
                           TexCoordAccessors& kept) {
  kept = {-1, -1};
  const GltfMaterials::SetMaps usual = materials_.usualMaps(material);
  GltfMaterials::SetMaps maps = usual;
  std::vector<int> sets, keptSets;
  for (const int set : GltfMaterials::keptSets(materials_.texCoordSets(material))) {
    if (set >= 0) sets.push_back(set);
  }
  for (const auto& [set, map] : usual) {
    if (std::find(sets.begin(), sets.end(), set) == sets.end()) sets.push_back(set);
  }
  for (const int set : sets) {
    const int accessor = attribute(p, fmt::format("TEXCOORD_{}", set));
    std::optional<GltfMaterials::SetMap> map;
    if (accessor < 0) {
      context_.replace(
          "{}: its material has textures, but there is no TEXCOORD_{}; the texel at 0,0 is used",
          where, set);
      map = {.set = 0, .scale = vec2(0.0f)};
    }
    for (std::size_t i = 0; i < keptSets.size() && !map; ++i) {
      map = mapOfSets(i, GltfAccessor(context_, kept[i]), GltfAccessor(context_, accessor));
    }
    if (!map && keptSets.size() < kept.size()) {
      map = {.set = static_cast<std::uint8_t>(keptSets.size())};
      kept[keptSets.size()] = accessor;
      keptSets.push_back(set);
    }
    if (!map) {
      context_.replace("{}: its textures use coordinate sets {}, {} and {}; set {} is used for {}",
                       where, keptSets[0], keptSets[1], set, keptSets[0], set);
      map.emplace();
    }
    maps[set] = *map;
  }
  return keptSets.empty() || maps == usual ? material : materials_.withMaps(material, maps);
}

int GltfMeshes::primitive(const tinygltf::Primitive& compressed, const std::string& where,
                          const std::string& name, const GltfDeformation& deformation) {
  const tinygltf::Primitive p = decodeDraco(context_, compressed, where);
  TexCoordAccessors texCoords;
  const int material = chooseSets(materials_.use(materialOf(p)), p, where, texCoords);
  const std::string key =
      fmt::format("{} {} {} {} {} {} {}", attribute(p, "POSITION"), attribute(p, "NORMAL"),
                  attribute(p, "COLOR_0"), texCoords[0], texCoords[1], p.indices, p.mode);
  auto& meshes = context_.scene.meshes;
  const int next = static_cast<int>(meshes.size());
  const auto known = deformation.none() ? byGeometry_.find(key) : byGeometry_.end();
  Mesh mesh;
  mesh.material = material;
  if (known == byGeometry_.end()) {
    readGeometry(p, texCoords, where, deformation, mesh);
    if (deformation.none()) {
      byGeometry_.emplace(key, next);
      byMaterial_.emplace(std::pair(next, material), next);
    }
  } else {
    const auto [same, isNew] = byMaterial_.try_emplace({known->second, material}, next);
    if (!isNew) return same->second;
    mesh = meshes[known->second];
    mesh.sameGeometryAs = known->second;
  }
  mesh.name = name;
  mesh.material = material;
  meshes.push_back(std::move(mesh));
  return next;
}

std::vector<std::uint32_t> GltfMeshes::readIndices(const tinygltf::Primitive& p,
                                                   std::uint64_t vertices,
                                                   const std::string& where) {
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
  std::uint64_t bad = 0;
  for (std::uint64_t i = 0; i < accessor.count(); ++i) {
    indices[i] = accessor.index(i);
    if (indices[i] < vertices) continue;
    if (bad++ == 0) {
      context_.replace("{}: index {} is vertex {}, but there are {}; its triangles are left out",
                       where, i, indices[i], vertices);
    }
    indices[i] = kUnused;
  }
  return indices;
}

void GltfMeshes::readGeometry(const tinygltf::Primitive& p, const TexCoordAccessors& texCoords,
                              const std::string& where, const GltfDeformation& deformation,
                              Mesh& mesh) {
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
      context_.replace("{}: {} indices are not whole triangles; the rest is left out", where,
                       indices.size());
    }
    mesh.triangles = assemble(p.mode, indices);
    dropUnused(mesh.triangles);
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
  for (std::size_t set = 0; set < texCoords.size(); ++set) {
    if (texCoords[set] < 0) continue;
    const GltfAccessor uv(context_, texCoords[set]);
    checked(uv, "TEXCOORD", 2, 2);
    std::vector<vec2>& out = set == 0 ? mesh.texCoords : mesh.secondTexCoords;
    out.reserve(used.size());
    for (const std::uint32_t v : used) out.push_back({uv.value(v, 0), uv.value(v, 1)});
  }
  if (const int index = attribute(p, "COLOR_0"); index >= 0) {
    GltfAccessor colors(context_, index);
    checked(colors, "COLOR_0", 3, 4);
    if (colors.componentType() != TINYGLTF_COMPONENT_TYPE_FLOAT && !colors.normalized()) {
      context_.replace("{}: integer COLOR_0 (accessor {}) is not normalized; it is taken as if",
                       where, index);
      colors.normalize();
    }
    mesh.colors.reserve(used.size());
    for (const std::uint32_t v : used) {
      vec4 c(1.0f);
      for (int k = 0; k < colors.components(); ++k) c[k] = colors.value(v, k);
      mesh.colors.push_back(packVertexColor(c));
    }
  }
  tellTangents(p, used, where, mesh);
  if (!deformation.none()) {
    deform(context_, p, used, deformation, where, skinFrame_, mesh);
  }
  sanitiseMesh(context_.scene, mesh, context_.name + ": " + where);
}

}  // namespace trex::detail
