#include "src/scene/import.h"

#include <sys/stat.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <cerrno>
#include <cstring>
#include <glm/gtc/matrix_transform.hpp>
#include <new>

#include "src/core/log.h"
#include "src/scene/import_detail.h"
#include "src/scene/input_file.h"
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

std::string lowerExtension(const std::filesystem::path& path) {
  std::string extension = path.extension().string();
  std::transform(extension.begin(), extension.end(), extension.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return extension;
}

void noteFile(Scene& scene, const std::filesystem::path& path) {
  const std::string name = path.string();
  std::error_code error;
  if (!std::filesystem::is_regular_file(path, error)) return;
  const bool known = std::any_of(scene.files.begin(), scene.files.end(),
                                 [&](const SourceFile& f) { return f.path == name; });
  if (!known) scene.files.push_back(examineSource(path));
}

void noteNoUnit(Scene& scene, const std::string& format, const std::filesystem::path& path,
                const ImportOptions& options) {
  if (options.unit != 1.0 || options.zUp) return;
  scene.warnings.push_back(
      fmt::format("{}: {} tells no unit and no up; metres and y are taken (--unit mm --up z)",
                  path.string(), format));
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

/// Of what is packed, if gzip has packed a format that is read through an InputFile.
std::string formatOf(const std::filesystem::path& path) {
  const std::string extension = detail::lowerExtension(path);
  if (extension != ".gz") return extension;
  const std::string inner = detail::lowerExtension(path.stem());
  return inner == ".pbrt" || inner == ".ply" || inner == ".obj" ? inner : extension;
}

void checkReadable(const std::filesystem::path& path) {
  std::error_code error;
  const auto status = std::filesystem::status(path, error);
  const std::string name = path.string();
  if (name == "-") {
    fail(ExitCode::kInput,
         "-: a model is read from a file, not from standard input; save it first");
  }
  if (!std::filesystem::exists(status)) fail(ExitCode::kInput, "{}: no such file", name);
  if (std::filesystem::is_directory(status)) {
    fail(ExitCode::kInput,
         "{}: is a folder; give a .gltf, .glb, .ply, .obj, .stl, .xml or .pbrt file", name);
  }
  if (!std::filesystem::is_regular_file(status)) {
    fail(ExitCode::kInput,
         "{}: is a pipe or a device; models are read from files alone, so save it to one first",
         name);
  }
  if (std::filesystem::file_size(path, error) == 0) {
    fail(ExitCode::kInput, "{}: the file is empty", name);
  }
}

void refuseDefines(const std::filesystem::path& path, const ImportOptions& options) {
  if (options.defines.empty()) return;
  fail(ExitCode::kUsage, "{}: -D is of Mitsuba's .xml alone", path.string());
}

Scene readByExtension(const std::filesystem::path& path, const ImportOptions& options) {
  const std::string extension = formatOf(path);
  detail::checkPointSize(path, options);
  if (extension == ".pbrt" && (options.unit != 1.0 || options.zUp)) {
    fail(ExitCode::kUsage,
         "{}: pbrt scenes have cameras and lights; --unit and --up are for bare models",
         path.string());
  }
  if (extension == ".gltf" || extension == ".glb") {
    if (options.unit != 1.0 || options.zUp) {
      fail(ExitCode::kUsage, "{}: glTF is in metres with y up; --unit and --up are for others",
           path.string());
    }
    refuseDefines(path, options);
    return detail::readGltf(path, options);
  }
  if (!options.scene.empty() || !options.variant.empty() || !options.animation.empty()) {
    fail(ExitCode::kUsage, "{}: --scene, --variant and --animation are of glTF alone",
         path.string());
  }
  if (extension == ".xml") {
    if (options.unit != 1.0 || options.zUp) {
      fail(ExitCode::kUsage, "{}: a scene places its parts; --unit and --up are for others",
           path.string());
    }
    return detail::readMitsuba(path, options);
  }
  refuseDefines(path, options);
  if (extension == ".ply") return detail::readPly(path, options);
  if (extension == ".obj") return detail::readObj(path, options);
  if (extension == ".stl") return detail::readStl(path, options);
  if (extension == ".pbrt") return detail::readPbrt(path, options);
  if (detail::isAssimpExtension(extension)) {
    if (detail::knowsItsUnit(extension) && (options.unit != 1.0 || options.zUp)) {
      fail(ExitCode::kUsage,
           "{}: {} files tell their unit and what is up; --unit and --up are for "
           "others",
           path.string(), extension);
    }
    Scene scene = detail::readAssimp(path, options);
    if (!detail::knowsItsUnit(extension)) {
      detail::noteNoUnit(scene, extension, path, options);
    }
    return scene;
  }
  fail(ExitCode::kInput,
       "{}: unknown extension '{}'; .gltf, .glb, .ply, .obj, .stl, .xml (Mitsuba), .pbrt and what "
       "assimp knows (.fbx, .dae, .3ds, .3mf, ...) can be read; export it as one of these",
       path.string(), extension);
}

/// Moves a scene by a matrix that turns and scales, the latter by `scale`.
void place(Scene& scene, const dmat4& world, double scale) {
  const auto point = [&](const dvec3& p) { return dvec3(world * glm::dvec4(p, 1.0)); };
  const auto direction = [&](const vec3& d) {
    return vec3(dvec3(world * glm::dvec4(dvec3(d), 0.0)) / scale);
  };
  const auto length = static_cast<float>(scale);
  for (Instance& instance : scene.instances) instance.transform = world * instance.transform;
  for (Light& light : scene.lights) {
    light.position = point(light.position);
    light.direction = direction(light.direction);
    light.range *= length;
    // What it shines on is as bright as before.
    if (light.type != Light::Type::kDirectional) light.intensity *= length * length;
  }
  for (Camera& camera : scene.cameras) {
    camera.eye = point(camera.eye);
    camera.forward = direction(camera.forward);
    camera.up = direction(camera.up);
    camera.orthographicHeight *= length;
  }
}

}  // namespace

void detail::checkPointSize(const std::filesystem::path& path, const ImportOptions& options) {
  if (options.pointSize == 0.0 || formatOf(path) == ".ply") return;
  fail(ExitCode::kUsage, "{}: --point-size is of .ply alone", path.string());
}

std::string ImportOptions::key() const {
  std::string text;
  if (unit != 1.0) text += fmt::format(" unit {}", unit);
  if (zUp) text += " z up";
  if (pointSize > 0.0) text += fmt::format(" points of {}", pointSize);
  if (!scene.empty()) text += " scene " + scene;
  if (maxBounces) text += fmt::format(" bounces {}", *maxBounces);
  for (const std::string& define : defines) text += " -D " + define;
  if (!variant.empty()) text += " variant " + variant;
  if (!animation.empty()) text += fmt::format(" animation {} at {}", animation, atSeconds);
  return text;
}

dmat4 ImportOptions::toWorld() const {
  dmat4 m(1.0);
  if (zUp)
    m = dmat4(glm::dvec4(1, 0, 0, 0), glm::dvec4(0, 0, -1, 0), glm::dvec4(0, 1, 0, 0),
              glm::dvec4(0, 0, 0, 1));
  return m * glm::scale(dmat4(1.0), dvec3(unit));
}

double parseUnit(const std::string& text) {
  constexpr std::array<std::pair<const char*, double>, 5> kUnits = {
      {{"mm", 0.001}, {"cm", 0.01}, {"m", 1.0}, {"in", 0.0254}, {"ft", 0.3048}}};
  for (const auto& [name, metres] : kUnits) {
    if (text == name) return metres;
  }
  double metres = 0.0;
  if (!detail::parseDouble(text, metres) || !(metres >= 1e-12 && metres <= 1e12)) {
    fail(ExitCode::kUsage, "--unit {}: want mm, cm, m, in, ft or metres such as 0.001", text);
  }
  return metres;
}

std::string bouncesText(std::uint32_t most) {
  return most == Scene::kAnyBounces ? "all" : std::to_string(most);
}

Scene importScene(const std::filesystem::path& path, const ImportOptions& options) {
  if (isSynthName(path.string())) {
    Scene scene = makeSynth(path.string());
    addVolumes(scene, options.volumes, options.maxMemory);
    scene.maxBounces = options.maxBounces.value_or(scene.maxBounces);
    return scene;
  }
  checkReadable(path);
  Scene scene;
  const SourceFile model = examineSource(path);
  try {
    scene = readByExtension(path, options);
  } catch (const Error& e) {
    throw Error(e.code(), oneLine(e.what()));  // names of the file are in it
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
  detail::removeUnusedImages(scene);
  if (scene.droppedTriangles > 0) {
    scene.replaced.add(fmt::format("{}: {} triangles with non-finite vertices dropped",
                                   scene.source, scene.droppedTriangles),
                       scene.droppedTriangles);
  }
  if (scene.instances.empty()) {
    fail(ExitCode::kInput, "{}: no triangle to render{}{}", scene.source,
         scene.replaced.texts.empty() ? "" : ": ",
         scene.replaced.texts.empty() ? "" : scene.replaced.texts.front());
  }
  if (options.unit != 1.0 || options.zUp) place(scene, options.toWorld(), options.unit);
  detail::checkExtent(scene);
  addVolumes(scene, options.volumes, options.maxMemory);
  addDefaultLightAndCamera(scene, options.environmentGiven);
  scene.maxBounces = options.maxBounces.value_or(scene.maxBounces);
  tellReplaced(scene, options.strict);
  return scene;
}

void refuseReplaced(const Scene& scene) {
  const Replaced& parts = scene.replaced;
  if (parts.count == 0) return;
  fail(ExitCode::kInput, "{}{}; without --strict the rest is shown", parts.texts.front(),
       parts.count > 1 ? fmt::format(" (and {} more parts)", parts.count - 1) : "");
}

void tellReplaced(const Scene& scene, bool strict) {
  for (const std::string& warning : scene.warnings) logWarning("{}", warning);
  if (strict) refuseReplaced(scene);
  const Replaced& parts = scene.replaced;
  constexpr std::size_t kMostSaid = 20;
  const std::size_t said = std::min(kMostSaid, parts.texts.size());
  for (std::size_t i = 0; i < said; ++i) logWarning("{}", parts.texts[i]);
  if (said < parts.texts.size()) {
    logWarning("{}: {} parts are not shown as they are; trex info lists them", scene.source,
               parts.count);
  }
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
