#include "src/scene/relief.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "src/scene/image_make.h"
#include "src/scene/texture_cache.h"

namespace trex::detail {

UvFacts uvFactsOf(const Mesh& mesh, const dmat4& place) {
  UvFacts facts;
  if (mesh.texCoords.empty()) return facts;
  const glm::dmat3 linear(place);
  double area = 0.0, uvArea = 0.0, turn = 0.0;
  for (const glm::uvec3& t : mesh.triangles) {
    const dvec3 a(mesh.positions[t.x]);
    const dvec3 normal = glm::cross(linear * (dvec3(mesh.positions[t.y]) - a),
                                    linear * (dvec3(mesh.positions[t.z]) - a));
    const glm::dvec2 u = glm::dvec2(mesh.texCoords[t.y]) - glm::dvec2(mesh.texCoords[t.x]);
    const glm::dvec2 v = glm::dvec2(mesh.texCoords[t.z]) - glm::dvec2(mesh.texCoords[t.x]);
    const double cross = u.x * v.y - u.y * v.x;
    area += glm::length(normal), uvArea += std::abs(cross), turn += cross;
  }
  if (area > 0.0 && uvArea > 0.0) facts.metresPerUv = std::sqrt(area / uvArea);
  facts.rightHanded = turn > 0.0;
  return facts;
}

void setBumps(Scene& scene, const Texture& heights, double metres, const UvFacts& facts,
              Material& m) {
  const int width = scene.images[heights.image].width;
  const double slope = metres * width * std::abs(double(heights.scale.x)) / facts.metresPerUv;
  if (!std::isfinite(slope) || slope == 0.0) return;
  // In steps of four, so that surfaces of many sizes share a few images.
  const double step =
      std::exp2(std::clamp(2.0 * std::round(0.5 * std::log2(std::abs(slope))), -20.0, 10.0));
  const std::string name =
      fmt::format("normals of {} times {:.3g}", scene.images[heights.image].name, step);
  m.normalTexture = heights;
  m.normalScale = static_cast<float>(std::clamp(slope / step, -1e3, 1e3));
  const auto same = std::find_if(scene.images.begin(), scene.images.end(),
                                 [&](const Image& i) { return i.name == name; });
  m.normalTexture.image = static_cast<int>(same - scene.images.begin());
  if (same != scene.images.end()) return;
  Image normals = normalsOfHeights(scene.images[heights.image], static_cast<float>(step));
  normals.name = name;
  addImage(scene, std::move(normals));
}

}  // namespace trex::detail
