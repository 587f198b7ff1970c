// What the streams of files share (triangle_stream.h).
#pragma once

#include <filesystem>
#include <string>

#include "src/scene/import.h"
#include "src/scene/triangle_stream.h"

namespace trex::detail {

/// From a file's axes and unit to the world.
class Placement {
 public:
  explicit Placement(const ImportOptions& options)
      : world_(options.toWorld()), turn_(glm::mat3(glm::dmat3(world_) / options.unit)) {}
  dvec3 point(const dvec3& p) const { return dvec3(world_ * glm::dvec4(p, 1.0)); }
  vec3 direction(const vec3& d) const { return turn_ * d; }
  const dmat4& world() const { return world_; }

 private:
  dmat4 world_;
  glm::mat3 turn_;
};

/// Where the temporary files of a stream lie.
std::filesystem::path scratchFolder(const ImportOptions& options);

/// Begins the scene of a stream: its source and the file itself.
void beginStreamed(Scene& scene, const std::filesystem::path& path);

/// What importScene() does last, to the scene of a stream with such bounds. Throws Error(kInput) if
/// they are too large.
void finishStreamed(Scene& scene, const ImportOptions& options, const Box3d& bounds);

/// TriangleStream::key() of a model that was read from files.
std::string streamKey(const Scene& scene, const ImportOptions& options);

/// Of the last triangle of a batch: normals that mean nothing become the face's own.
void repairNormals(TriangleBatch& batch);

}  // namespace trex::detail
