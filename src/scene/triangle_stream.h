// Models as streams of triangles, for bakes that never hold a whole model in memory.
//
// A stream is a row of batches. Each can be made on its own, by any thread, and is the same each
// time, so whatever is built from a stream does not depend on the number of threads.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <vector>

#include "src/scene/import.h"
#include "src/scene/scene.h"

namespace trex {

/// Triangles of one kind of attributes; corner k of triangle i is at 3 * i + k. Attributes are
/// empty or as long as positions. Runs of one material and object follow each other.
struct TriangleBatch {
  struct Run {
    std::uint32_t material = 0, object = 0;
    std::size_t triangles = 0;
  };
  dvec3 origin{0.0};            ///< added to every position, metres
  std::vector<vec3> positions;  ///< counter-clockwise from the front; need not be finite
  std::vector<vec3> normals;    ///< any length but zero
  std::vector<vec2> texCoords;
  std::vector<vec2> secondTexCoords;  ///< only with texCoords
  std::vector<glm::u8vec4> colors;    ///< of packVertexColor()
  std::vector<Run> runs;

  void clear();
  std::size_t triangles() const { return positions.size() / 3; }
};

struct StreamAttributes {
  bool normals = false, texCoords = false, colors = false, secondTexCoords = false;
  /// Of a triangle, at most.
  std::uint64_t bytes() const {
    return 12u * normals + 24u * texCoords + 12u * colors + 24u * secondTexCoords;
  }
};

/// Where triangles come from. Const calls are thread safe.
class TriangleStream {
 public:
  virtual ~TriangleStream() = default;
  /// Materials, cameras, lights, objects; of meshes, just those that emit have arrays.
  virtual const Scene& scene() const = 0;
  /// A box that all finite triangles lie in, world metres; empty if there are none.
  virtual Box3d bounds() const = 0;
  virtual std::uint64_t triangleCount() const = 0;  ///< those that are not finite included
  virtual std::uint64_t batchCount() const = 0;
  /// Fills a batch, of at most kBatchTriangles. Throws Error(kInput) if the source is damaged.
  virtual void batch(std::uint64_t number, TriangleBatch& out) const = 0;
  /// The source's name and whatever decides its triangles; equal texts mean equal triangles.
  virtual std::string key() const = 0;
  /// What triangles may bring besides positions.
  virtual StreamAttributes attributes() const { return {}; }
  /// Bytes that the stream itself holds in memory.
  virtual std::uint64_t residentBytes() const { return 0; }

  static constexpr std::size_t kBatchTriangles = std::size_t{1} << 16;
};

/// Opens a model as a stream: synth: names are generated; binary PLY and STL files are mapped; OBJ
/// and other PLY files, clouds of points among them, are read once, into temporary files
/// (ImportOptions::scratch) that are mapped; PLY files with texture coordinates, colours of faces
/// or strips and all other formats are imported whole. Throws Error as importScene() does, kOutput
/// if a temporary file can't be written.
std::unique_ptr<TriangleStream> openTriangleStream(const std::filesystem::path& path,
                                                   const ImportOptions& options = {});

/// A scene in memory as a stream; takes it over.
std::unique_ptr<TriangleStream> streamOf(Scene scene);

/// All of a stream in memory: a mesh for each run of one object and material.
Scene sceneOfStream(const TriangleStream& stream);

}  // namespace trex
