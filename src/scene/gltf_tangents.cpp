// Whether the tangents of a glTF file are those that are shown.
#include <algorithm>

#include "src/scene/gltf_detail.h"

namespace trex::detail {
namespace {

/// The share of triangles whose tangents in the file, w included, are not those along the texture.
/// Some thousand triangles stand for all.
double shareOfOtherTangents(const Mesh& mesh, const GltfAccessor& tangents,
                            const std::vector<std::uint32_t>& used) {
  constexpr std::size_t kLooked = 5000;
  constexpr float kAlike = 0.7f;  // cosine
  const std::size_t step = std::max<std::size_t>(1, mesh.triangles.size() / kLooked);
  double looked = 0.0, other = 0.0;
  for (std::size_t i = 0; i < mesh.triangles.size(); i += step) {
    const glm::uvec3& t = mesh.triangles[i];
    const vec3 a = mesh.positions[t.y] - mesh.positions[t.x];
    const vec3 b = mesh.positions[t.z] - mesh.positions[t.x];
    const vec2 s = mesh.texCoords[t.y] - mesh.texCoords[t.x];
    const vec2 r = mesh.texCoords[t.z] - mesh.texCoords[t.x];
    const float area = s.x * r.y - r.x * s.y;
    vec3 given(0.0f);
    float side = 0.0f;
    for (int k = 0; k < 3; ++k) {
      for (int c = 0; c < 3; ++c) given[c] += tangents.value(used[t[k]], c);
      side += tangents.value(used[t[k]], 3);
    }
    const vec3 along = (r.y * a - s.y * b) * (area < 0.0f ? -1.0f : 1.0f);
    const vec3 up = (r.x * a - s.x * b) * (area < 0.0f ? -1.0f : 1.0f);
    const float size = glm::length(given) * glm::length(along);
    if (!(size > 0.0f) || area == 0.0f) continue;
    const vec3 across = glm::cross(glm::cross(a, b), given) * side;
    ++looked;
    other += glm::dot(given, along) < kAlike * size || glm::dot(across, up) < 0.0f;
  }
  return looked > 0.0 ? other / looked : 0.0;
}

}  // namespace

/// Directions along textures come from their coordinates; files that give others are told of.
void GltfMeshes::tellTangents(const tinygltf::Primitive& p, const std::vector<std::uint32_t>& used,
                              const std::string& where, const Mesh& mesh) {
  constexpr double kFew = 0.05;
  const Material& m = context_.scene.materials[mesh.material];
  const auto found = p.attributes.find("TANGENT");
  if (found == p.attributes.end() || !m.normalTexture.present() || mesh.texCoords.empty()) return;
  const GltfAccessor tangents(context_, found->second);
  const bool whole =
      std::all_of(used.begin(), used.end(), [&](std::uint32_t v) { return v < tangents.count(); });
  if (tangents.components() != 4 || !whole) {
    context_.replace("{}: TANGENT is not a VEC4 of each vertex; it is left out", where);
  } else if (const double share = shareOfOtherTangents(mesh, tangents, used); share > kFew) {
    context_.replace(
        "{}: tangents of {:.0f} % of its triangles do not go along its texture; its normal map is "
        "shown along the texture",
        where, 100.0 * share);
  }
}

}  // namespace trex::detail
