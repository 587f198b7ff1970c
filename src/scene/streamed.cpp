#include "src/scene/streamed.h"

#include <cmath>

#include "src/scene/import_detail.h"

namespace trex::detail {

std::filesystem::path scratchFolder(const ImportOptions& options) {
  std::error_code error;
  if (!options.scratch.empty()) return options.scratch;
  const auto folder = std::filesystem::temp_directory_path(error);
  return error ? std::filesystem::path(".") : folder;
}

void beginStreamed(Scene& scene, const std::filesystem::path& path) {
  scene.source = path.string();
  scene.files.insert(scene.files.begin(), examineSource(path));
}

void finishStreamed(Scene& scene, const ImportOptions& options, const Box3d& bounds) {
  if (!bounds.empty()) {
    const dvec3 furthest = glm::max(-bounds.lower, bounds.upper);
    if (!glm::all(glm::lessThanEqual(furthest, dvec3(kMaxCoordinate)))) {
      fail(ExitCode::kInput, "{}: reaches beyond {:.0e} m", scene.source, kMaxCoordinate);
    }
    if (scene.cameras.empty()) scene.cameras.push_back(framingCamera(bounds));
  }
  removeUnusedImages(scene);
  addDefaultLightAndCamera(scene, options.environmentGiven);
  tellReplaced(scene, options.strict);
}

std::string streamKey(const Scene& scene, const ImportOptions& options) {
  std::string key = scene.source + options.key();
  for (const SourceFile& f : scene.files) {
    key += fmt::format("|{}|{}|{}", f.path, f.bytes, f.modifiedNanoseconds);
  }
  return key;
}

void repairNormals(TriangleBatch& batch) {
  const std::size_t first = batch.positions.size() - 3;
  for (std::size_t i = first; i < first + 3; ++i) {
    const float length = glm::length(batch.normals[i]);
    if (length > 0.0f && std::isfinite(length)) continue;
    const vec3 a = batch.positions[first];
    const vec3 face = glm::cross(batch.positions[first + 1] - a, batch.positions[first + 2] - a);
    const float area = glm::length(face);
    batch.normals[i] = area > 0.0f && std::isfinite(area) ? face / area : vec3(0.0f, 0.0f, 1.0f);
  }
}

}  // namespace trex::detail
