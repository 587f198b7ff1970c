#include "src/session/paged_voxels.h"

#include <algorithm>

#include "src/scene/look.h"
#include "src/session/voxel_source.h"

namespace trex {
namespace {

/// Pages as blocks. Of each triangle's corners, texture coordinates and colour go along if the page
/// has them.
class PageBlocks : public asvo::BlockSource {
 public:
  PageBlocks(const Scene& scene, const hccm::PagedMesh& mesh) : scene_(scene), mesh_(mesh) {
    boxes_.resize(mesh.table().pages.size());
    for (const hccm::PageGroup& g : mesh.table().groups) {
      boxes_[g.page].extend(vec3(g.lower[0], g.lower[1], g.lower[2]));
      boxes_[g.page].extend(vec3(g.upper[0], g.upper[1], g.upper[2]));
    }
    for (const Material& m : scene.materials) passes_.push_back(passesLight(m));
    firstGroup_.assign(boxes_.size() + 1, static_cast<std::uint32_t>(mesh.table().groups.size()));
    for (std::uint32_t i = mesh.groupCount(); i-- > 0;) {
      firstGroup_[mesh.table().groups[i].page] = i;
    }
  }
  std::uint32_t blockCount() const override { return static_cast<std::uint32_t>(boxes_.size()); }
  void bounds(std::uint32_t block, vec3& lower, vec3& upper) const override {
    lower = boxes_[block].lower;
    upper = boxes_[block].upper;
  }
  std::uint64_t triangles(std::uint32_t block) const override {
    return mesh_.table().pages[block].triangles;
  }
  void read(std::uint32_t block, const vec3& lower, const vec3& upper,
            Reading& out) const override {
    const hccm::PagedMesh::Pin pin = mesh_.page(block);
    for (std::uint32_t i = firstGroup_[block]; i < firstGroup_[block + 1]; ++i) {
      const hccm::PageGroup& g = mesh_.table().groups[i];
      const vec3 groupLower(g.lower[0], g.lower[1], g.lower[2]);
      const vec3 groupUpper(g.upper[0], g.upper[1], g.upper[2]);
      if (apart(groupLower, groupUpper, lower, upper)) continue;
      for (std::uint32_t c = g.first; c < std::uint32_t{g.first} + g.count; ++c) {
        readCluster(pin.mesh(), c, lower, upper, out);
      }
    }
  }
  asvo::Shade shade(const asvo::Triangle& triangle, const Reading& reading, float u,
                    float v) const override {
    TexCoords uv{};
    vec4 color(1.0f);
    if (triangle.shadeKey != kPlain) {
      const vec4* corners = &reading.extra[triangle.shadeKey];
      const vec4 places = (1.0f - u - v) * corners[3] + u * corners[4] + v * corners[5];
      color = (1.0f - u - v) * corners[0] + u * corners[1] + v * corners[2];
      uv = {vec2(places), vec2(places.z, places.w)};
    }
    return voxelShade(scene_.materials[triangle.material], scene_.images, uv, color);
  }

 private:
  static constexpr std::uint32_t kPlain = 0xffffffffu;

  static bool apart(const vec3& aLower, const vec3& aUpper, const vec3& bLower,
                    const vec3& bUpper) {
    return glm::any(glm::greaterThan(aLower, bUpper)) || glm::any(glm::greaterThan(bLower, aUpper));
  }

  void readCluster(const hccm::Mesh& page, std::uint32_t cluster, const vec3& lower,
                   const vec3& upper, Reading& out) const {
    if (passes_[page.clusterMaterial(cluster)]) return;
    vec3 clusterLower, clusterUpper;
    page.clusterBounds(cluster, clusterLower, clusterUpper);
    if (apart(clusterLower, clusterUpper, lower, upper)) return;
    page.forTriangles(cluster, [&](std::uint32_t index) {
      const hccm::Triangle t = page.triangle(cluster, index);
      const vec3 *a = &t.position[0], *b = &t.position[1], *c = &t.position[2];
      if (apart(glm::min(*a, glm::min(*b, *c)), glm::max(*a, glm::max(*b, *c)), lower, upper)) {
        return;
      }
      asvo::Triangle& made = out.triangles.emplace_back();
      std::copy_n(t.position, 3, made.position);
      made.material = t.material;
      made.shadeKey = kPlain;
      if (!t.hasTexCoords && !t.hasColors) return;
      made.shadeKey = static_cast<std::uint32_t>(out.extra.size());
      for (const vec4& color : t.color) {
        out.extra.push_back(t.hasColors ? unpackVertexColor(color) : vec4(1.0f));
      }
      for (int k = 0; k < 3; ++k) {
        out.extra.push_back(vec4(t.texCoord[k], t.secondTexCoord[k]));
      }
    });
  }

  const Scene& scene_;
  const hccm::PagedMesh& mesh_;
  std::vector<Box3f> boxes_;               ///< by page
  std::vector<std::uint32_t> firstGroup_;  ///< by page, and the end
  std::vector<bool> passes_;               ///< by material: light goes through
};

}  // namespace

asvo::Tree buildPagedVoxels(const Scene& scene, const hccm::PagedMesh& mesh,
                            const asvo::BuildOptions& options, std::uint64_t memoryBytes,
                            const std::function<bool(double)>& keepGoing) {
  const PageBlocks blocks(scene, mesh);
  return asvo::buildFromBlocks(blocks, {options, memoryBytes, keepGoing});
}

}  // namespace trex
