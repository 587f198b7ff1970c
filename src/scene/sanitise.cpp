// What every reader does to a mesh before it enters the scene.
#include <algorithm>

#include "src/scene/import_detail.h"

namespace trex::detail {
namespace {

void checkIndices(const Mesh& mesh, const std::string& where) {
  const std::size_t vertices = mesh.positions.size();
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
    const glm::uvec3& t = mesh.triangles[i];
    const std::uint32_t most = std::max({t.x, t.y, t.z});
    if (most >= vertices) {
      fail(ExitCode::kInput, "{}: triangle {} refers to vertex {}, but there are {}", where, i,
           most, vertices);
    }
  }
}

void dropNonFinite(Scene& scene, Mesh& mesh) {
  const auto finite = [&](const vec3& p) { return isFinite(p); };
  const auto good = std::find_if(mesh.positions.begin(), mesh.positions.end(), finite);
  const vec3 replacement = good == mesh.positions.end() ? vec3(0.0f) : *good;
  const auto bad = [&](const glm::uvec3& t) {
    return !finite(mesh.positions[t.x]) || !finite(mesh.positions[t.y]) ||
           !finite(mesh.positions[t.z]);
  };
  if (std::all_of(mesh.positions.begin(), mesh.positions.end(), finite)) return;
  scene.droppedTriangles += std::erase_if(mesh.triangles, bad);
  for (vec3& p : mesh.positions) {
    if (!finite(p)) p = replacement;
  }
}

/// Returns the number of normals that were unusable.
std::uint64_t fixNormals(Mesh& mesh) {
  std::vector<bool> broken;
  for (std::size_t i = 0; i < mesh.normals.size(); ++i) {
    vec3& n = mesh.normals[i];
    const float length2 = glm::dot(n, n);
    if (length2 >= 1e-30f && length2 <= 1e30f) {
      // Leave bits alone that are unit to rounding already.
      if (std::abs(length2 - 1.0f) > 1e-6f) n *= 1.0f / std::sqrt(length2);
      continue;
    }
    if (broken.empty()) broken.resize(mesh.normals.size());
    broken[i] = true;
    n = vec3(0.0f);
  }
  if (broken.empty()) return 0;
  for (const glm::uvec3& t : mesh.triangles) {
    const vec3& a = mesh.positions[t.x];
    const vec3 face = glm::cross(mesh.positions[t.y] - a, mesh.positions[t.z] - a);
    for (int k = 0; k < 3; ++k) {
      if (broken[t[k]]) mesh.normals[t[k]] += face;
    }
  }
  for (std::size_t i = 0; i < mesh.normals.size(); ++i) {
    if (!broken[i]) continue;
    const vec3 n = mesh.normals[i];
    const float largest = std::max({std::abs(n.x), std::abs(n.y), std::abs(n.z)});
    const bool usable = largest > 0.0f && isFinite(n);
    mesh.normals[i] = usable ? glm::normalize(n / largest) : vec3(0.0f, 1.0f, 0.0f);
  }
  return static_cast<std::uint64_t>(std::count(broken.begin(), broken.end(), true));
}

}  // namespace

void sanitiseMesh(Scene& scene, Mesh& mesh, const std::string& where) {
  checkIndices(mesh, where);
  dropNonFinite(scene, mesh);
  if (const std::uint64_t count = fixNormals(mesh); count > 0) {
    scene.replaced.add(
        fmt::format("{}: {} unusable normals replaced by those of the faces", where, count), count);
  }
  std::uint64_t badCoords = 0;
  for (std::vector<vec2>* set : {&mesh.texCoords, &mesh.secondTexCoords}) {
    for (vec2& uv : *set) {
      if (std::isfinite(uv.x) && std::isfinite(uv.y)) continue;
      uv = vec2(0.0f);
      ++badCoords;
    }
  }
  if (badCoords > 0) {
    scene.replaced.add(
        fmt::format("{}: {} non-finite texture coordinates set to 0", where, badCoords), badCoords);
  }
}

void checkExtent(const Scene& scene) {
  const auto check = [&](const dvec3& p, const char* what, const std::string& name) {
    if (glm::all(glm::lessThanEqual(glm::abs(p), dvec3(kMaxCoordinate)))) return;
    fail(ExitCode::kInput, "{}: {} '{}' reaches to {:.3g},{:.3g},{:.3g}, beyond {:.0e} m",
         scene.source, what, name, p.x, p.y, p.z, kMaxCoordinate);
  };
  std::vector<Box3d> boxes(scene.meshes.size());
  for (std::size_t i = 0; i < boxes.size(); ++i) {
    for (const vec3& p : scene.meshes[i].positions) {
      boxes[i].extend(scene.meshes[i].origin + dvec3(p));
    }
  }
  for (const Instance& instance : scene.instances) {
    const Box3d& box = boxes[instance.mesh];
    for (int k = 0; k < 8; ++k) {
      const dvec3 corner(k & 1 ? box.upper.x : box.lower.x, k & 2 ? box.upper.y : box.lower.y,
                         k & 4 ? box.upper.z : box.lower.z);
      check(dvec3(instance.transform * glm::dvec4(corner, 1.0)), "object", instance.name);
    }
  }
  for (const Camera& camera : scene.cameras) check(camera.eye, "camera", camera.name);
  for (const Light& light : scene.lights) check(light.position, "light", light.name);
}

void removeUnusedImages(Scene& scene) {
  std::vector<int> newIndex(scene.images.size(), kNone);
  for (Material& m : scene.materials) {
    for (Texture* t : m.textures()) {
      if (!t->present()) continue;
      if (scene.images[t->image].width == 0) *t = {};
      if (t->present()) newIndex[t->image] = 0;
    }
  }
  int kept = 0;
  for (std::size_t i = 0; i < newIndex.size(); ++i) {
    if (newIndex[i] == kNone) continue;
    newIndex[i] = kept++;
    if (newIndex[i] != static_cast<int>(i)) {
      scene.images[newIndex[i]] = std::move(scene.images[i]);
    }
  }
  scene.images.resize(kept);
  for (Material& m : scene.materials) {
    for (Texture* t : m.textures()) {
      if (t->present()) t->image = newIndex[t->image];
    }
  }
}

void removeEmptyMeshes(Scene& scene) {
  std::vector<int> newIndex(scene.meshes.size(), kNone);
  int kept = 0;
  for (std::size_t i = 0; i < scene.meshes.size(); ++i) {
    if (!scene.meshes[i].triangles.empty()) newIndex[i] = kept++;
  }
  if (kept == static_cast<int>(scene.meshes.size()) && kept > 0) return;
  for (std::size_t i = 0; i < scene.meshes.size(); ++i) {
    if (newIndex[i] == kNone) continue;
    Mesh& mesh = scene.meshes[i];
    // Equal geometry is empty together, so the earlier mesh is kept whenever this one is.
    if (mesh.sameGeometryAs != kNone) mesh.sameGeometryAs = newIndex[mesh.sameGeometryAs];
    if (newIndex[i] != static_cast<int>(i)) scene.meshes[newIndex[i]] = std::move(mesh);
  }
  scene.meshes.resize(kept);
  std::erase_if(scene.instances, [&](const Instance& i) { return newIndex[i.mesh] == kNone; });
  for (Instance& instance : scene.instances) instance.mesh = newIndex[instance.mesh];
}

void tellPoints(Scene& scene, const std::string& file, std::uint64_t points, const char* instead) {
  if (points == 0) return;
  scene.replaced.add(
      fmt::format("{}: it is a cloud of {} points without faces, which are not drawn; {}", file,
                  points, instead));
}

}  // namespace trex::detail
