#include "src/scene/triangle_stream.h"

#include <algorithm>
#include <map>

#include "src/scene/import_detail.h"
#include "src/scene/streamed.h"
#include "src/scene/synth.h"
#include "src/scene/texture.h"

namespace trex {
namespace {

/// A scene's instances, cut into batches.
class SceneStream : public TriangleStream {
 public:
  explicit SceneStream(Scene scene, ImportOptions options = {})
      : scene_(std::move(scene)), options_(std::move(options)), bounds_(scene_.bounds()) {
    for (std::size_t i = 0; i < scene_.instances.size(); ++i) {
      const std::size_t count = meshOf(i).triangles.size();
      triangles_ += count;
      for (std::size_t first = 0; first < count; first += kBatchTriangles) {
        pieces_.push_back({i, first, std::min(count, first + kBatchTriangles)});
      }
    }
  }
  const Scene& scene() const override { return scene_; }
  Box3d bounds() const override { return bounds_; }
  std::uint64_t triangleCount() const override { return triangles_; }
  std::uint64_t batchCount() const override { return pieces_.size(); }
  std::string key() const override { return detail::streamKey(scene_, options_); }
  StreamAttributes attributes() const override {
    StreamAttributes a;
    for (const Mesh& m : scene_.meshes) {
      a.normals |= !m.normals.empty();
      a.texCoords |= !m.texCoords.empty();
      a.colors |= !m.colors.empty();
      a.secondTexCoords |= !m.secondTexCoords.empty();
    }
    return a;
  }
  std::uint64_t residentBytes() const override {
    std::uint64_t bytes = 0;
    for (const Mesh& m : scene_.meshes) {
      bytes += m.positions.size() * sizeof(vec3) + m.triangles.size() * sizeof(glm::uvec3) +
               m.normals.size() * sizeof(vec3) +
               (m.texCoords.size() + m.secondTexCoords.size()) * sizeof(vec2) +
               m.colors.size() * sizeof(glm::u8vec4);
    }
    return bytes;
  }
  void batch(std::uint64_t number, TriangleBatch& out) const override;

 private:
  struct Piece {
    std::size_t instance, first, end;  ///< triangles
  };
  const Mesh& meshOf(std::size_t instance) const {
    return scene_.meshes[static_cast<std::size_t>(scene_.instances[instance].mesh)];
  }

  Scene scene_;
  ImportOptions options_;
  Box3d bounds_;
  std::uint64_t triangles_ = 0;
  std::vector<Piece> pieces_;
};

void SceneStream::batch(std::uint64_t number, TriangleBatch& out) const {
  out.clear();
  const Piece& piece = pieces_[number];
  const Instance& instance = scene_.instances[piece.instance];
  const Mesh& mesh = meshOf(piece.instance);
  const dmat4& m = instance.transform;
  const glm::dmat3 linear(m);
  const bool mirrored = glm::determinant(linear) < 0.0;
  // Normals go by the cofactor matrix: the inverse transpose up to a factor.
  const glm::dmat3 forNormals =
      glm::dmat3(glm::cross(linear[1], linear[2]), glm::cross(linear[2], linear[0]),
                 glm::cross(linear[0], linear[1])) *
      (mirrored ? -1.0 : 1.0);
  const Material& material = scene_.materials[static_cast<std::size_t>(mesh.material)];
  const bool texCoords = !mesh.texCoords.empty() && readsTexCoords(material);
  const bool secondTexCoords =
      texCoords && !mesh.secondTexCoords.empty() && readsSecondTexCoords(material);
  // Floats around one origin for the whole scene keep edges of neighbours shared.
  out.origin = bounds_.centre();
  for (std::size_t t = piece.first; t < piece.end; ++t) {
    glm::uvec3 corners = mesh.triangles[t];
    if (mirrored) std::swap(corners.y, corners.z);
    for (int k = 0; k < 3; ++k) {
      const std::uint32_t v = corners[k];
      const dvec3 p(m * glm::dvec4(mesh.origin + dvec3(mesh.positions[v]), 1.0));
      out.positions.push_back(vec3(p - out.origin));
      if (!mesh.normals.empty()) {
        const dvec3 n = forNormals * dvec3(mesh.normals[v]);
        const double length = glm::length(n);
        out.normals.push_back(length > 0.0 ? vec3(n / length) : vec3(0.0f, 0.0f, 1.0f));
      }
      if (texCoords) out.texCoords.push_back(mesh.texCoords[v]);
      if (secondTexCoords) out.secondTexCoords.push_back(mesh.secondTexCoords[v]);
      if (!mesh.colors.empty()) out.colors.push_back(mesh.colors[v]);
    }
  }
  out.runs.push_back({static_cast<std::uint32_t>(mesh.material),
                      static_cast<std::uint32_t>(instance.object), piece.end - piece.first});
}

}  // namespace

void TriangleBatch::clear() {
  origin = dvec3(0.0);
  positions.clear();
  normals.clear();
  texCoords.clear();
  secondTexCoords.clear();
  colors.clear();
  runs.clear();
}

std::unique_ptr<TriangleStream> streamOf(Scene scene) {
  return std::make_unique<SceneStream>(std::move(scene));
}

Scene sceneOfStream(const TriangleStream& stream) {
  Scene scene = stream.scene();
  scene.meshes.clear();
  scene.instances.clear();
  TriangleBatch batch;
  for (std::uint64_t b = 0; b < stream.batchCount(); ++b) {
    stream.batch(b, batch);
    std::size_t first = 0;
    for (const TriangleBatch::Run& run : batch.runs) {
      const bool goesOn = !scene.meshes.empty() &&
                          scene.meshes.back().material == static_cast<int>(run.material) &&
                          scene.instances.back().object == static_cast<int>(run.object);
      if (!goesOn) {
        Instance instance;
        instance.name = scene.objects[run.object];
        instance.mesh = static_cast<int>(scene.meshes.size());
        instance.object = static_cast<int>(run.object);
        Mesh& mesh = scene.meshes.emplace_back();
        mesh.name = instance.name;
        mesh.material = static_cast<int>(run.material);
        mesh.origin = batch.origin;
        scene.instances.push_back(std::move(instance));
      }
      Mesh& mesh = scene.meshes.back();
      for (std::size_t t = first; t < first + run.triangles; ++t) {
        const auto v = static_cast<std::uint32_t>(mesh.positions.size());
        for (std::size_t k = 0; k < 3; ++k) mesh.positions.push_back(batch.positions[3 * t + k]);
        mesh.triangles.push_back({v, v + 1, v + 2});
      }
      first += run.triangles;
    }
  }
  return scene;
}

std::unique_ptr<TriangleStream> openTriangleStream(const std::filesystem::path& path,
                                                   const ImportOptions& options) {
  if (isSynthName(path.string())) return openSynth(path.string());
  detail::checkPointSize(path, options);
  if (auto stream = detail::openPlyStream(path, options)) return stream;
  if (auto stream = detail::openStlStream(path, options)) return stream;
  if (auto stream = detail::openObjStream(path, options)) return stream;
  return std::make_unique<SceneStream>(importScene(path, options), options);
}

}  // namespace trex
