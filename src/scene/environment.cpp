#include <charconv>
#include <cmath>

#include "src/scene/image_io.h"
#include "src/scene/import_detail.h"
#include "src/scene/input_file.h"

namespace trex {
namespace {

constexpr int kMaxEnvironmentWidth = 32768;

/// True for text that was meant as numbers, so that "1,2" is a usage error and not a missing file.
bool looksLikeNumbers(const std::string& text) {
  return text.find_first_not_of("0123456789+-.eE, ") == std::string::npos ||
         text.find("nan") == 0 || text.find("inf") == 0;
}

[[noreturn]] void badEnvironment(const std::string& text, const std::string& what) {
  fail(ExitCode::kUsage, "--env {}: {}; want R,G,B or FILE?rotate=DEGREES&strength=S", text, what);
}

vec3 parseColor(const std::string& text) {
  vec3 color(0.0f);
  const char* at = text.data();
  const char* end = at + text.size();
  bool good = true;
  for (int i = 0; i < 3 && good; ++i) {
    while (at < end && (*at == ' ' || *at == '+')) ++at;
    const auto [next, error] = std::from_chars(at, end, color[i]);
    good = error == std::errc() && std::isfinite(color[i]) && color[i] >= 0.0f &&
           (i == 2 ? next == end : next < end && *next == ',');
    at = i == 2 ? next : next + 1;
  }
  if (!good) badEnvironment(text, "R,G,B must be three numbers of at least 0");
  return color;
}

void readOptions(const std::string& text, const std::string& options, Environment& environment) {
  const auto set = [&](const std::string& key, std::span<const double> numbers) -> std::string {
    const double value = numbers.size() == 1 ? numbers[0] : std::nan("");
    if (key == "rotate") {
      if (!(std::abs(value) <= 1e5)) return "rotate must be a number of degrees within 1e5";
      environment.rotation = static_cast<float>(glm::radians(value));
    } else if (key == "strength") {
      if (!(value >= 0.0 && value <= 1e12)) return "strength must be a number in [0, 1e12]";
      environment.color = vec3(static_cast<float>(value));
    } else {
      return "unknown option '" + key + "'; there are rotate and strength";
    }
    return {};
  };
  const std::string problem = detail::parseOptions(options, set);
  if (!problem.empty()) badEnvironment(text, problem);
}

}  // namespace

Environment parseEnvironment(const std::string& text) {
  const std::string file = environmentFile(text);
  std::error_code error;
  const auto status = std::filesystem::status(file, error);
  Environment environment;
  if (!std::filesystem::exists(status) && looksLikeNumbers(file)) {
    if (file != text) badEnvironment(text, "rotate and strength are of a file alone");
    environment.color = parseColor(text);
    return environment;
  }
  environment.color = vec3(1.0f);
  if (file != text) readOptions(text, text.substr(file.size() + 1), environment);
  if (!std::filesystem::exists(status)) {
    fail(ExitCode::kInput, "{}: no such environment file (R,G,B is also possible)", file);
  }
  if (!std::filesystem::is_regular_file(status)) {
    fail(ExitCode::kInput, "{}: the environment is not a plain file", file);
  }
  environment.map =
      std::make_shared<const Image>(detail::readFloatImage(file, kMaxEnvironmentWidth));
  return environment;
}

std::string environmentFile(const std::string& text) { return text.substr(0, text.rfind('?')); }

Environment softSky() {
  constexpr int kWidth = 64, kHeight = 32;
  const vec3 above(0.75f, 0.85f, 1.0f), below(0.22f, 0.20f, 0.18f), key(1.3f, 1.2f, 1.0f);
  const vec3 towardsKey = glm::normalize(vec3(0.6f, 0.7f, 0.7f));
  auto image = std::make_shared<Image>();
  image->name = "soft sky";
  image->width = kWidth;
  image->height = kHeight;
  image->channels = 3;
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kWidth; ++x) {
      const float theta = kPi * (static_cast<float>(y) + 0.5f) / kHeight;
      const float phi = 2.0f * kPi * ((static_cast<float>(x) + 0.5f) / kWidth - 0.5f);
      const vec3 d(std::sin(theta) * std::sin(phi), std::cos(theta),
                   -std::sin(theta) * std::cos(phi));
      const float up = glm::smoothstep(-0.35f, 0.35f, d.y);
      const float lobe = std::pow(std::max(glm::dot(d, towardsKey), 0.0f), 6.0f);
      const vec3 radiance = glm::mix(below, above, up) + key * lobe;
      image->floats.insert(image->floats.end(), {radiance.x, radiance.y, radiance.z});
    }
  }
  Environment environment;
  environment.color = vec3(1.0f);
  environment.map = std::move(image);
  return environment;
}

}  // namespace trex
