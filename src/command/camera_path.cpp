#include "src/command/camera_path.h"

#include <fmt/format.h>

#include <fstream>
#include <nlohmann/json.hpp>

#include "src/core/error.h"
#include "src/scene/import.h"

namespace trex {
namespace {

using nlohmann::json;

constexpr std::uintmax_t kMostBytes = 64u << 20;
constexpr std::size_t kMostCameras = 1'000'000;

json readJson(const std::filesystem::path& path) {
  std::error_code problem;
  const std::uintmax_t size = std::filesystem::file_size(path, problem);
  if (problem) fail(ExitCode::kInput, "{}: {}", path.string(), problem.message());
  if (size > kMostBytes) {
    fail(ExitCode::kInput, "{}: {} bytes; a camera path has at most {}", path.string(), size,
         kMostBytes);
  }
  std::ifstream file(path);
  try {
    return json::parse(file);
  } catch (const json::exception& e) {
    fail(ExitCode::kInput, "{}: not valid JSON: {}", path.string(), e.what());
  }
}

/// The three numbers at `key`, in the form --camera takes.
std::string triple(const json& camera, const char* key) {
  const json& v = camera.at(key);
  if (!v.is_array() || v.size() != 3) throw Error(ExitCode::kInput, "want three numbers");
  return fmt::format("{},{},{}", v[0].get<double>(), v[1].get<double>(), v[2].get<double>());
}

Camera readCamera(const json& camera, const Scene& scene) {
  if (camera.is_string()) return parseCamera(camera.get<std::string>(), scene);
  for (const auto& [key, value] : camera.items()) {
    if (key != "eye" && key != "target" && key != "up" && key != "vfov" && key != "fstop" &&
        key != "focus") {
      throw Error(ExitCode::kInput, fmt::format("unknown key '{}'", key));
    }
  }
  const std::string up = camera.contains("up") ? triple(camera, "up") : "0,1,0";
  std::string lens;
  for (const char* key : {"fstop", "focus"}) {
    if (!camera.contains(key)) continue;
    lens += fmt::format("{}{}={}", lens.empty() ? '?' : '&', key, camera[key].get<double>());
  }
  return parseCamera(fmt::format("{}/{}/{}/{}{}", triple(camera, "eye"), triple(camera, "target"),
                                 up, camera.value("vfov", 40.0), lens),
                     scene);
}

}  // namespace

std::vector<Camera> readCameraPath(const std::filesystem::path& path, const Scene& scene) {
  const json file = readJson(path);
  const auto refuse = [&](const std::string& where, const std::string& what) {
    fail(ExitCode::kInput, "{}: {}: {}", path.string(), where, what);
  };
  if (!file.is_object() || file.value("trex", json()) != json(1)) {
    refuse("/trex", "want an object with \"trex\": 1, the version");
  }
  for (const auto& [key, value] : file.items()) {
    if (key != "trex" && key != "cameras") refuse("/" + key, "unknown key");
  }
  if (!file.contains("cameras") || !file["cameras"].is_array() || file["cameras"].empty() ||
      file["cameras"].size() > kMostCameras) {
    refuse("/cameras", fmt::format("want a list of 1 to {} cameras", kMostCameras));
  }
  std::vector<Camera> cameras;
  for (std::size_t i = 0; i < file["cameras"].size(); ++i) {
    try {
      cameras.push_back(readCamera(file["cameras"][i], scene));
    } catch (const std::exception& e) {
      refuse(fmt::format("/cameras/{}", i), e.what());
    }
  }
  return cameras;
}

}  // namespace trex
