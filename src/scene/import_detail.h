// What the readers of src/scene share. Not for other folders.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "src/core/error.h"
#include "src/scene/import.h"
#include "src/scene/triangle_stream.h"

namespace trex::detail {

/// Largest number of vertices or triangles of one mesh: indices are 32 bits wide.
inline constexpr std::uint64_t kMaxElements = 0xfffffff0u;

Scene readGltf(const std::filesystem::path& path, const ImportOptions& options);
/// The model at `path` as a reader in another process handed it over (src/assimp/child.h).
Scene readHandedOver(std::span<const std::uint8_t> bytes, const std::filesystem::path& path,
                     const ImportOptions& options);
/// What assimp reads, by its extension with the dot, in lower case. A process of its own does: a
/// file that breaks it is Error(kInput), one that needs more than ImportOptions::maxMemory
/// Error(kMemoryOrDevice).
Scene readAssimp(const std::filesystem::path& path, const ImportOptions& options);
bool isAssimpExtension(const std::string& extension);
/// Whether files of such a format tell their unit and what is up.
bool knowsItsUnit(const std::string& extension);
Scene readPly(const std::filesystem::path& path, const ImportOptions& options);
/// Throws Error(kUsage) if points are to be shown of a file that has none.
void checkPointSize(const std::filesystem::path& path, const ImportOptions& options);
Scene readStl(const std::filesystem::path& path, const ImportOptions& options);
Scene readPbrt(const std::filesystem::path& path, const ImportOptions& options);
Scene readMitsuba(const std::filesystem::path& path, const ImportOptions& options);
Scene readObj(const std::filesystem::path& path, const ImportOptions& options);

/// A binary STL file as a stream that maps it; null for other files.
std::unique_ptr<TriangleStream> openStlStream(const std::filesystem::path& path,
                                              const ImportOptions& options);

/// A binary PLY file of bare positions as a stream that maps it; null for other files. Throws
/// Error(kInput) if it is cut off.
std::unique_ptr<TriangleStream> openPlyStream(const std::filesystem::path& path,
                                              const ImportOptions& options);

/// An OBJ file as a stream over temporary files (ImportOptions::scratch); null for other files.
std::unique_ptr<TriangleStream> openObjStream(const std::filesystem::path& path,
                                              const ImportOptions& options);

/// A file's extension with its point, in lower case.
std::string lowerExtension(const std::filesystem::path& path);

/// Adds a file that is about to be read to Scene::files, once. One that is not there is left to
/// the reader to complain about.
void noteFile(Scene& scene, const std::filesystem::path& path);

/// Warns that a format tells no unit, unless one was given.
void noteNoUnit(Scene& scene, const std::string& format, const std::filesystem::path& path,
                const ImportOptions& options);

/// Lambertian grey: what a surface without a material looks like.
Material defaultMaterial();

/// Drops triangles with non-finite vertices (counted in the scene), makes normals unit length
/// (unusable ones become the face's), and non-finite texture coordinates 0. Throws Error(kInput) if
/// an index is out of range; `where` names the file and the mesh.
void sanitiseMesh(Scene& scene, Mesh& mesh, const std::string& where);

/// Bytes that this process may still use of `maxMemory` (0: of what the machine has).
std::uint64_t leftBytes(std::uint64_t maxMemory);

/// Tells that a file has points and nothing that joins them, if it has any.
void tellPoints(Scene& scene, const std::string& file, std::uint64_t points, const char* instead);

/// Furthest coordinate of anything in a scene, metres: squares of lengths stay in single precision.
inline constexpr double kMaxCoordinate = 1e18;

/// Throws Error(kInput) if an object, a camera or a light is further out than kMaxCoordinate.
void checkExtent(const Scene& scene);

/// Removes meshes without triangles and their instances; fails if none is left.
void removeEmptyMeshes(Scene& scene);

/// Makes textures of images without texels none, and removes images that no material uses.
void removeUnusedImages(Scene& scene);

/// Turns double positions into floats around the first finite one, which keeps the detail of a
/// model far from the world's origin. Used for all meshes of a file, so that shared edges stay
/// shared.
class LocalFrame {
 public:
  vec3 toLocal(const dvec3& p) {
    if (!set_ && isFinite(vec3(p))) {
      origin_ = dvec3(vec3(p));
      set_ = true;
    }
    return vec3(p - origin_);
  }
  const dvec3& origin() const { return origin_; }

 private:
  bool set_ = false;
  dvec3 origin_{0.0};
};

}  // namespace trex::detail
