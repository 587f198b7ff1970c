#include "src/scene/import.h"

#include <sys/stat.h>

#include <algorithm>
#include <cctype>
#include <cerrno>
#include <cstring>
#include <new>

#include "src/core/log.h"
#include "src/scene/import_detail.h"
#include "src/scene/synth.h"

namespace trex {
namespace detail {

Material defaultMaterial() {
  Material grey;
  grey.name = "default";
  grey.baseColor = vec4(0.6f, 0.6f, 0.6f, 1.0f);
  grey.metallic = 0.0f;
  grey.specular = 0.0f;
  grey.doubleSided = true;
  return grey;
}

void noteFile(Scene& scene, const std::filesystem::path& path) {
  const std::string name = path.string();
  std::error_code error;
  if (!std::filesystem::is_regular_file(path, error)) return;
  const bool known = std::any_of(scene.files.begin(), scene.files.end(),
                                 [&](const SourceFile& f) { return f.path == name; });
  if (!known) scene.files.push_back(examineSource(path));
}

}  // namespace detail

SourceFile examineSource(const std::filesystem::path& path) {
  struct stat status {};
  if (::stat(path.c_str(), &status) != 0) {
    fail(ExitCode::kInput, "{}: can't be examined: {}", path.string(), std::strerror(errno));
  }
  return {path.string(), static_cast<std::uint64_t>(status.st_size),
          std::int64_t{status.st_mtim.tv_sec} * 1'000'000'000 + status.st_mtim.tv_nsec};
}

namespace {

std::string lowerExtension(const std::filesystem::path& path) {
  std::string extension = path.extension().string();
  std::transform(extension.begin(), extension.end(), extension.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return extension;
}

void checkReadable(const std::filesystem::path& path) {
  std::error_code error;
  const auto status = std::filesystem::status(path, error);
  const std::string name = path.string();
  if (!std::filesystem::exists(status)) fail(ExitCode::kInput, "{}: no such file", name);
  if (std::filesystem::is_directory(status)) {
    fail(ExitCode::kInput, "{}: is a folder; give a .gltf, .glb, .ply or .obj file", name);
  }
  if (std::filesystem::is_regular_file(status) && std::filesystem::file_size(path, error) == 0) {
    fail(ExitCode::kInput, "{}: the file is empty", name);
  }
}

Scene readByExtension(const std::filesystem::path& path, const ImportOptions& options) {
  const std::string extension = lowerExtension(path);
  if (extension == ".gltf" || extension == ".glb") return detail::readGltf(path, options);
  if (extension == ".ply") return detail::readPly(path);
  if (extension == ".obj") return detail::readObj(path, options);
  fail(ExitCode::kInput, "{}: unknown extension '{}'; .gltf, .glb, .ply and .obj can be read",
       path.string(), extension);
}

}  // namespace

Scene importScene(const std::filesystem::path& path, const ImportOptions& options) {
  if (isSynthName(path.string())) {
    Scene scene = makeSynth(path.string());
    addVolumes(scene, options.volumes, options.maxMemory);
    return scene;
  }
  checkReadable(path);
  Scene scene;
  const SourceFile model = examineSource(path);
  try {
    scene = readByExtension(path, options);
  } catch (const Error&) {
    throw;
  } catch (const std::bad_alloc&) {
    fail(ExitCode::kMemoryOrDevice, "{}: not enough memory to read it", path.string());
  } catch (const std::length_error&) {
    fail(ExitCode::kMemoryOrDevice, "{}: too large for memory", path.string());
  } catch (const std::exception& e) {
    fail(ExitCode::kInput, "{}: {}", path.string(), e.what());
  }
  scene.source = path.string();
  scene.files.insert(scene.files.begin(), model);
  detail::removeEmptyMeshes(scene);
  if (scene.droppedTriangles > 0) {
    scene.warnings.push_back(fmt::format("{}: {} triangles with non-finite vertices dropped",
                                         scene.source, scene.droppedTriangles));
  }
  if (scene.instances.empty()) {
    fail(ExitCode::kInput, "{}: no triangle to render{}", scene.source,
         scene.droppedTriangles > 0 ? " (all had non-finite vertices)" : "");
  }
  detail::checkExtent(scene);
  addVolumes(scene, options.volumes, options.maxMemory);
  addDefaultLightAndCamera(scene, options.environmentGiven);
  for (const std::string& warning : scene.warnings) logWarning("{}", warning);
  return scene;
}

bool hasLight(const Scene& scene) {
  if (!scene.lights.empty() || scene.environment.present()) return true;
  if (std::any_of(scene.media.begin(), scene.media.end(),
                  [](const Medium& m) { return m.emits(); })) {
    return true;
  }
  return std::any_of(scene.instances.begin(), scene.instances.end(), [&](const Instance& i) {
    return scene.materials[scene.meshes[i.mesh].material].emits();
  });
}

void addDefaultLightAndCamera(Scene& scene, bool environmentGiven) {
  if (!environmentGiven && !hasLight(scene)) {
    scene.environment = softSky();
    scene.warnings.push_back(
        fmt::format("{}: has no light; lit by a soft sky (--env sets another)", scene.source));
  }
  if (scene.cameras.empty()) {
    scene.cameras.push_back(framingCamera(scene.bounds()));
    scene.warnings.push_back(fmt::format(
        "{}: has no camera; one that frames the model is used (--camera sets it)", scene.source));
  }
}

}  // namespace trex
