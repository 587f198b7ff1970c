// Names of generated models, and what all of them have in common.
#include "src/scene/synth.h"

#include <charconv>
#include <cmath>
#include <map>

#include "src/core/error.h"
#include "src/scene/import_detail.h"
#include "src/scene/synth_detail.h"

namespace trex {
namespace {

constexpr std::string_view kPrefix = "synth:";
constexpr double kMostTriangles = 1e10;

[[noreturn]] void refuse(const std::string& name, const std::string& why) {
  fail(ExitCode::kUsage,
       "{}: {}; want synth:terrain, synth:scan or synth:assembly, then ?triangles=N&seed=S", name,
       why);
}

std::uint64_t parseTriangles(const std::string& name, std::string_view text) {
  double value = 0.0;
  const auto [at, problem] = std::from_chars(text.data(), text.data() + text.size(), value);
  const bool number = problem == std::errc() && at == text.data() + text.size();
  if (!number || !(value >= 1.0 && value <= kMostTriangles) || value != std::floor(value)) {
    refuse(name, fmt::format("triangles={}: must be a whole number from 1 to {:.0e}", text,
                             kMostTriangles));
  }
  return static_cast<std::uint64_t>(value);
}

std::uint64_t parseSeed(const std::string& name, std::string_view text) {
  std::uint64_t value = 0;
  const auto [at, problem] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (problem != std::errc() || at != text.data() + text.size()) {
    refuse(name, fmt::format("seed={}: must be a whole number of at most 64 bits", text));
  }
  return value;
}

void parseParameter(const std::string& name, std::string_view text, SynthRequest& request) {
  const std::size_t equals = text.find('=');
  const std::string_view key = text.substr(0, equals);
  const std::string_view value =
      equals == std::string_view::npos ? std::string_view() : text.substr(equals + 1);
  if (key == "triangles") {
    request.triangles = parseTriangles(name, value);
  } else if (key == "seed") {
    request.seed = parseSeed(name, value);
  } else {
    refuse(name, fmt::format("unknown parameter '{}'", key));
  }
}

}  // namespace

bool isSynthName(const std::string& name) { return name.starts_with(kPrefix); }

SynthRequest parseSynthName(const std::string& name) {
  using Kind = SynthRequest::Kind;
  static const std::map<std::string_view, Kind> kinds = {
      {"terrain", Kind::kTerrain}, {"scan", Kind::kScan}, {"assembly", Kind::kAssembly}};
  std::string_view rest = std::string_view(name).substr(kPrefix.size());
  const std::size_t question = rest.find('?');
  const auto found = kinds.find(rest.substr(0, question));
  if (found == kinds.end()) refuse(name, fmt::format("no model '{}'", rest.substr(0, question)));
  SynthRequest request;
  request.kind = found->second;
  rest = question == std::string_view::npos ? std::string_view() : rest.substr(question + 1);
  while (!rest.empty()) {
    const std::size_t end = std::min(rest.find('&'), rest.size());
    parseParameter(name, rest.substr(0, end), request);
    rest = end < rest.size() ? rest.substr(end + 1) : std::string_view();
  }
  return request;
}

std::unique_ptr<TriangleStream> openSynth(const std::string& name) {
  const SynthRequest request = parseSynthName(name);
  switch (request.kind) {
    case SynthRequest::Kind::kTerrain:
      return detail::makeTerrain(request, name);
    case SynthRequest::Kind::kScan:
      return detail::makeScan(request, name);
    case SynthRequest::Kind::kAssembly:
      break;
  }
  return detail::makeAssembly(request, name);
}

Scene makeSynth(const std::string& name) {
  const std::unique_ptr<TriangleStream> stream = openSynth(name);
  if (stream->triangleCount() > kMostSynthInMemory) {
    fail(ExitCode::kMemoryOrDevice,
         "{}: {} triangles are too many to be kept as they are; trex bake {} -o X.trex first", name,
         stream->triangleCount(), name);
  }
  return sceneOfStream(*stream);
}

namespace detail {

Camera synthCamera(const char* name, const dvec3& eye, const dvec3& target, float degrees) {
  Camera camera;
  camera.name = name;
  camera.eye = eye;
  camera.forward = vec3(glm::normalize(target - eye));
  const vec3 right = glm::normalize(glm::cross(camera.forward, vec3(0.0f, 1.0f, 0.0f)));
  camera.up = glm::cross(right, camera.forward);
  camera.verticalFov = glm::radians(degrees);
  return camera;
}

Material synthMaterial(const char* name, const vec3& color, float metallic, float roughness) {
  Material m = defaultMaterial();
  m.name = name;
  m.baseColor = vec4(color, 1.0f);
  m.metallic = metallic;
  m.roughness = roughness;
  m.specular = metallic > 0.0f ? 1.0f : 0.5f;
  return m;
}

}  // namespace detail
}  // namespace trex
