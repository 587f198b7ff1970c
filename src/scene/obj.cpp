// Wavefront OBJ as meshes. Every (object, material) pair becomes one, or two: one with normals, one
// of flat faces.
#include <algorithm>

#include "src/scene/obj_reader.h"
#include "src/scene/texture.h"

namespace trex::detail {
namespace {

class ObjScene : ObjReader {
 public:
  using ObjReader::ObjReader;

  Scene read() {
    readAll();
    for (auto& [group, part] : parts_) {
      const auto& corners = part.table.corners();
      const bool uv =
          (options().geometryOnly || readsTexCoords(scene_.materials[group.material])) &&
          std::any_of(corners.begin(), corners.end(), [](const ObjCorner& c) { return c[1] >= 0; });
      addMesh(group, meshOf(group, corners, std::move(part.triangles), uv));
      part = {};
    }
    return std::move(scene_);
  }

 private:
  struct Part {
    CornerTable<3> table;
    std::vector<glm::uvec3> triangles;
  };

  void take(const ObjGroup& group, std::span<const ObjCorner> corners,
            std::span<const glm::uvec3> triangles) override {
    if (last_ == nullptr || lastGroup_ != group) {
      last_ = &parts_[group];
      lastGroup_ = group;
    }
    if (last_->triangles.size() + triangles.size() > kMaxElements) {
      fail(ExitCode::kInput, "{}: too many triangles", where());
    }
    numbers_.clear();
    for (const ObjCorner& c : corners) numbers_.push_back(last_->table.indexOf(c));
    for (const glm::uvec3& t : triangles) {
      last_->triangles.push_back({numbers_[t.x], numbers_[t.y], numbers_[t.z]});
    }
  }

  std::map<ObjGroup, Part> parts_;
  Part* last_ = nullptr;
  ObjGroup lastGroup_;
  std::vector<std::uint32_t> numbers_;
};

}  // namespace

Scene readObj(const std::filesystem::path& path, const ImportOptions& options) {
  return ObjScene(path, options).read();
}

}  // namespace trex::detail
