// From a scene's meshes to HCCMeshes and their placements.
#include "src/crays/ray_scene_parts.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <span>
#include <utility>
#include <vector>

#include "src/core/error.h"
#include "src/core/log.h"
#include "src/crays/ray_scene_surface.h"
#include "src/scene/texture.h"

namespace trex {
namespace {

// Cells of the least size that parts of a level may have, along the edge of what shares a grid: a
// grid holds twice as many, and a part may stand out.
constexpr int kPlaceBits = 22;

// Only what the scene uses is stored.
hccm::Part partOf(const Scene& scene, const Mesh& mesh) {
  hccm::Part part;
  part.positions = mesh.positions;
  part.triangles = mesh.triangles;
  part.normals = mesh.normals;
  part.colors = mesh.colors;
  const Material& material = scene.materials[static_cast<std::size_t>(mesh.material)];
  if (readsTexCoords(material)) part.texCoords = mesh.texCoords;
  if (readsSecondTexCoords(material)) part.secondTexCoords = mesh.secondTexCoords;
  part.material = static_cast<std::uint32_t>(mesh.material);
  return part;
}

dmat4 translation(const dvec3& v) {
  dmat4 m(1.0);
  m[3] = glm::dvec4(v, 1.0);
  return m;
}

dmat4 sharedToRender(const Scene& scene, const Instance& instance, const hccm::Mesh& mesh,
                     const dvec3& renderOrigin) {
  const dvec3 origin = scene.meshes[static_cast<std::size_t>(instance.mesh)].origin;
  return translation(-renderOrigin) * instance.transform * translation(origin + mesh.gridOrigin());
}

bool isFinite(const dmat4& m) {
  for (int c = 0; c < 4; ++c)
    for (int r = 0; r < 4; ++r)
      if (!std::isfinite(m[c][r])) return false;
  return true;
}

// A part of the world's mesh and what it asks of a grid.
struct Measured {
  Box3d box;          // render space
  int flat = kNone;   // axis along which it has no extent
  double cell = 0.0;  // metres: the largest cell that it may have
};

// A cell may be 2^-9 of a part's size, and 2^-5 of its thickness, unless that is so little that it
// is meant to be none: 2^-20 of the size, or the rounding of coordinates. And it may be 2^-14 m, a
// millimetre's 16th: what lies on another thing, a marking on a road, is told from it; or 2^-14 of
// the part's width if that is more.
Measured measure(const hccm::Part& part) {
  Measured m;
  dvec3 farthest(0.0);
  for (const glm::uvec3& t : part.triangles)
    for (int k = 0; k < 3; ++k) {
      const dvec3 p(part.positions[t[k]]);
      m.box.extend(dvec3(part.transform * glm::dvec4(p, 1.0)));
      farthest = glm::max(farthest, glm::abs(p));
    }
  if (m.box.empty()) return m;
  const dvec3 size = m.box.size();
  const double largest = std::max({size.x, size.y, size.z});
  const auto rounding = [&](int k) {  // of two coordinates in single precision
    double sum = 0.0;
    for (int axis = 0; axis < 3; ++axis) sum += std::abs(part.transform[axis][k]) * farthest[axis];
    return std::max(0x1p-20 * largest, 0x1p-23 * sum);
  };
  double least = largest;
  for (int k = 0; k < 3; ++k) {
    if (size[k] <= rounding(k))
      m.flat = k;
    else
      least = std::min(least, size[k]);
  }
  m.cell = std::min({0x1p-9 * largest, 0x1p-5 * least, std::max(0x1p-14, 0x1p-14 * least)});
  return m;
}

// Parts that share a grid: of one level of size, or flat along one axis; and of one place.
struct GridKey {
  int level = 0, flat = kNone;
  std::array<double, 3> place{};
  auto operator<=>(const GridKey&) const = default;
};

class PartsBuilder {
 public:
  PartsBuilder(const Scene& scene, const RayScene::Options& options)
      : scene_(scene), options_(options) {
    const Box3d box = scene.bounds();
    if (!box.empty()) renderOrigin_ = box.centre();
  }
  RayScene::Parts build();

 private:
  void addToWorld(const Instance& instance);
  void addShared(std::span<const int> placements);
  void separate();
  void addMerged(std::span<const hccm::Part> parts);

  const Scene& scene_;
  const RayScene::Options& options_;
  dvec3 renderOrigin_{0.0};
  std::vector<hccm::Part> worldParts_;
  std::vector<hccm::Mesh> shared_;
  std::vector<RayScene::Parts::Placed> placed_;
};

void PartsBuilder::addToWorld(const Instance& instance) {
  const Mesh& mesh = scene_.meshes[static_cast<std::size_t>(instance.mesh)];
  hccm::Part part = partOf(scene_, mesh);
  part.object = static_cast<std::uint32_t>(instance.object);
  part.transform = translation(-renderOrigin_) * instance.transform * translation(mesh.origin);
  if (isFinite(part.transform))
    worldParts_.push_back(part);
  else
    logWarning("instance '{}' has a transform that is not finite; it is left out", instance.name);
}

void PartsBuilder::addShared(std::span<const int> placements) {
  const auto instanceOf = [&](int i) -> const Instance& {
    return scene_.instances[static_cast<std::size_t>(i)];
  };
  const hccm::Part part =
      partOf(scene_, scene_.meshes[static_cast<std::size_t>(instanceOf(placements[0]).mesh)]);
  hccm::BuildOptions build;
  build.precisionBits = options_.precisionBits;
  hccm::Mesh mesh = hccm::Mesh::build({&part, 1}, build);
  if (mesh.triangleCount() == 0) return;
  bool used = false;
  for (int i : placements) {
    const Instance& instance = instanceOf(i);
    Placement placement;
    if (Placement::make(sharedToRender(scene_, instance, mesh, renderOrigin_), instance.object,
                        placement)) {
      placed_.push_back(
          {static_cast<std::uint32_t>(i), static_cast<std::uint32_t>(shared_.size())});
      used = true;
    } else {
      addToWorld(instance);  // flat: rays have no way into it, its triangles do
    }
  }
  if (used) shared_.push_back(std::move(mesh));
}

// Takes out of the world what its grid is too coarse for, and then what must stay in plane with
// that.
void PartsBuilder::separate() {
  std::vector<Measured> measured(worldParts_.size());
  tbb::parallel_for(std::size_t{0}, measured.size(),
                    [&](std::size_t i) { measured[i] = measure(worldParts_[i]); });
  Box3d all;
  for (const Measured& m : measured) all.extend(m.box);
  if (all.empty()) return;
  const dvec3 size = all.size();
  const double step = std::max({size.x, size.y, size.z}) * std::ldexp(1.0, -options_.precisionBits);
  std::map<GridKey, std::vector<hccm::Part>> groups;
  std::vector<std::size_t> rest;
  for (std::size_t i = 0; i < measured.size(); ++i) {
    const Measured& m = measured[i];
    if (m.box.empty() || !(m.cell > 0.0) || step <= m.cell) {
      rest.push_back(i);
      continue;
    }
    GridKey key;
    key.level = std::ilogb(m.cell);
    const double edge = std::ldexp(1.0, key.level + kPlaceBits);
    for (int k = 0; k < 3; ++k)
      key.place[static_cast<std::size_t>(k)] = std::floor(m.box.centre()[k] / edge);
    groups[key].push_back(worldParts_[i]);
  }
  if (groups.empty()) return;
  std::vector<hccm::Part> kept;
  for (const std::size_t i : rest) {
    const Measured& m = measured[i];
    if (m.flat == kNone) {
      kept.push_back(worldParts_[i]);
      continue;
    }
    GridKey key;
    key.flat = m.flat;
    key.place[0] = m.box.centre()[m.flat];
    groups[key].push_back(worldParts_[i]);
  }
  worldParts_ = std::move(kept);
  for (const auto& [key, parts] : groups) addMerged(parts);
}

// The grid's origin is the centre of the parts; along the axis of least extent it is their upper
// side, which stays where it is: the top of a slab.
void PartsBuilder::addMerged(std::span<const hccm::Part> parts) {
  Box3d box;
  for (const hccm::Part& part : parts) box.extend(measure(part).box);
  const dvec3 size = box.size();
  const int thin = size.x < size.y ? (size.x < size.z ? 0 : 2) : (size.y < size.z ? 1 : 2);
  hccm::BuildOptions build;
  build.precisionBits = options_.precisionBits;
  build.chooseOrigin = false;
  build.gridOrigin = box.centre();
  build.gridOrigin[thin] = box.upper[thin];
  hccm::Mesh mesh = hccm::Mesh::build(parts, build);
  if (mesh.triangleCount() == 0) return;
  placed_.push_back({RayScene::Parts::kNoInstance, static_cast<std::uint32_t>(shared_.size())});
  shared_.push_back(std::move(mesh));
}

RayScene::Parts PartsBuilder::build() {
  std::vector<std::vector<int>> placements(scene_.meshes.size());
  for (std::size_t i = 0; i < scene_.instances.size(); ++i)
    placements[static_cast<std::size_t>(scene_.instances[i].mesh)].push_back(static_cast<int>(i));
  for (std::size_t m = 0; m < placements.size(); ++m) {
    const std::vector<int>& list = placements[m];
    const std::uint64_t triangles = scene_.meshes[m].triangles.size();
    if (list.empty() || triangles == 0) continue;
    if (list.size() == 1 || triangles * list.size() <= options_.mergeTriangles)
      for (int i : list) addToWorld(scene_.instances[static_cast<std::size_t>(i)]);
    else
      addShared(list);
  }
  separate();
  hccm::BuildOptions worldOptions;
  worldOptions.precisionBits = options_.precisionBits;
  worldOptions.chooseOrigin = false;  // parts come in render space
  return {renderOrigin_, hccm::Mesh::build(worldParts_, worldOptions), std::move(shared_),
          std::move(placed_), nullptr};
}

}  // namespace

SharedPlace placeOf(const Scene& scene, const RayScene::Parts& parts,
                    const RayScene::Parts::Placed& placed) {
  const hccm::Mesh& mesh = parts.shared[placed.mesh];
  if (placed.instance == RayScene::Parts::kNoInstance)
    return {translation(mesh.gridOrigin()), kNone};
  const Instance& instance = scene.instances[placed.instance];
  return {sharedToRender(scene, instance, mesh, parts.renderOrigin), instance.object};
}

RayScene::Parts RayScene::makeParts(const Scene& scene, const Options& options) {
  try {
    return PartsBuilder(scene, options).build();
  } catch (const std::invalid_argument& e) {
    fail(ExitCode::kInput, "{}: {}", scene.source, e.what());
  }
}

}  // namespace trex
