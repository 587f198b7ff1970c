#include "tests/fuzz/fuzz.h"

#include <unistd.h>

#include <algorithm>
#include <cstdio>

#include "src/core/error.h"
#include "src/core/log.h"
#include "src/scene/import.h"
#include "src/scene/triangle_stream.h"

namespace trex::fuzz {
namespace {

bool finite(const vec3& v) {
  return std::isfinite(v.x) && std::isfinite(v.y) && std::isfinite(v.z);
}

template <typename T>
bool fits(const std::vector<T>& values, const Mesh& mesh) {
  return values.empty() || values.size() == mesh.positions.size();
}

void checkMesh(const Scene& scene, const Mesh& mesh) {
  require(!mesh.triangles.empty());
  for (const glm::uvec3& t : mesh.triangles) {
    require(std::max({t.x, t.y, t.z}) < mesh.positions.size());
  }
  require(std::all_of(mesh.positions.begin(), mesh.positions.end(), finite));
  require(fits(mesh.normals, mesh) && fits(mesh.texCoords, mesh) && fits(mesh.colors, mesh));
  require(fits(mesh.secondTexCoords, mesh));
  require(mesh.secondTexCoords.empty() || !mesh.texCoords.empty());
  for (const vec3& n : mesh.normals) require(std::abs(glm::length(n) - 1.0f) < 1e-3f);
  for (const vec2& uv : mesh.texCoords) require(std::isfinite(uv.x) && std::isfinite(uv.y));
  require(mesh.material >= 0 && std::size_t(mesh.material) < scene.materials.size());
  require(mesh.sameGeometryAs < static_cast<int>(scene.meshes.size()));
}

void checkInstance(const Scene& scene, const Instance& instance) {
  require(instance.mesh >= 0 && std::size_t(instance.mesh) < scene.meshes.size());
  require(instance.object >= 0 && std::size_t(instance.object) < scene.objects.size());
  const double determinant = glm::determinant(instance.transform);
  require(std::isfinite(determinant) && determinant != 0.0);
}

void checkMaterial(const Scene& scene, const Material& m) {
  require(finite(m.emission) && finite(vec3(m.baseColor)) && finite(m.specularColor));
  require(m.roughness >= 0.0f && m.roughness <= 1.0f && m.metallic >= 0.0f && m.metallic <= 1.0f);
  for (const Texture* t :
       {&m.baseColorTexture, &m.metallicRoughnessTexture, &m.normalTexture, &m.emissiveTexture,
        &m.transmissionTexture, &m.specularTexture, &m.specularColorTexture}) {
    require(t->image == kNone || std::size_t(t->image) < scene.images.size());
  }
}

void checkCamera(const Camera& c) {
  require(std::abs(glm::length(c.forward) - 1.0f) < 1e-3f);
  require(std::abs(glm::length(c.up) - 1.0f) < 1e-3f);
  require(std::abs(glm::dot(c.up, c.forward)) < 1e-3f);
  require(std::isfinite(c.verticalFov) && std::isfinite(c.orthographicHeight));
}

void checkScene(const Scene& scene) {
  require(!scene.instances.empty() && !scene.materials.empty() && !scene.cameras.empty());
  for (const Mesh& mesh : scene.meshes) checkMesh(scene, mesh);
  for (const Instance& instance : scene.instances) checkInstance(scene, instance);
  for (const Material& material : scene.materials) checkMaterial(scene, material);
  for (const Camera& camera : scene.cameras) checkCamera(camera);
}

}  // namespace

std::filesystem::path writeInput(const std::string& name, Bytes bytes) {
  static const std::filesystem::path folder = [] {
    const auto made =
        std::filesystem::temp_directory_path() / ("trex-fuzz-" + std::to_string(::getpid()));
    std::filesystem::create_directories(made);
    std::atexit([] { std::filesystem::remove_all(folder); });
    return made;
  }();
  std::filesystem::path path = folder / name;
  std::FILE* file = std::fopen(path.c_str(), "wb");
  require(file != nullptr);
  if (!bytes.empty()) require(std::fwrite(bytes.data(), 1, bytes.size(), file) == bytes.size());
  std::fclose(file);
  return path;
}

void importAndCheck(const std::filesystem::path& path, const std::string& animation) {
  setLogLevel(LogLevel::kQuiet);
  Scene scene;
  try {
    scene = importScene(path, {.loadTextures = false,
                               .environmentGiven = true,  // a sky takes longer than the file
                               .animation = animation,
                               .atSeconds = 0.5});
  } catch (const Error& error) {
    require(error.code() == (animation.empty() ? ExitCode::kInput : error.code()));
    require(std::string_view(error.what()).find('\n') == std::string_view::npos);
    return;
  }
  checkScene(scene);
}

void streamAndCheck(const std::filesystem::path& path, double pointSize) {
  setLogLevel(LogLevel::kQuiet);
  try {
    const auto stream = openTriangleStream(
        path, {.loadTextures = false, .environmentGiven = true, .pointSize = pointSize});
    const Scene& scene = stream->scene();
    TriangleBatch batch;
    std::uint64_t triangles = 0;
    for (std::uint64_t b = 0; b < stream->batchCount(); ++b) {
      stream->batch(b, batch);
      const std::size_t corners = batch.positions.size();
      require(batch.normals.empty() || batch.normals.size() == corners);
      require(batch.texCoords.empty() || batch.texCoords.size() == corners);
      require(batch.colors.empty() || batch.colors.size() == corners);
      require(batch.secondTexCoords.empty() || batch.secondTexCoords.size() == corners);
      std::size_t inRuns = 0;
      for (const TriangleBatch::Run& run : batch.runs) {
        require(run.material < scene.materials.size() && run.object < scene.objects.size());
        inRuns += run.triangles;
      }
      require(inRuns == batch.triangles());
      triangles += inRuns;
    }
    require(triangles == stream->triangleCount());
  } catch (const Error& error) {
    require(error.code() == ExitCode::kInput);
  }
}

bool contains(Bytes bytes, std::string_view text) {
  return std::search(bytes.begin(), bytes.end(), text.begin(), text.end()) != bytes.end();
}

std::pair<Bytes, Bytes> split(Bytes bytes, std::string_view separator) {
  const auto at = std::search(bytes.begin(), bytes.end(), separator.begin(), separator.end());
  if (at == bytes.end()) return {bytes, {}};
  const auto before = static_cast<std::size_t>(at - bytes.begin());
  return {bytes.first(before), bytes.subspan(before + separator.size())};
}

}  // namespace trex::fuzz
