#include <charconv>

#include "src/core/log.h"
#include "src/scene/image_io.h"
#include "src/scene/import_detail.h"

namespace trex {
namespace {

constexpr int kMaxEnvironmentWidth = 32768;

/// True for text that was meant as numbers, so that "1,2" is a usage error and not a missing file.
bool looksLikeNumbers(const std::string& text) {
  return text.find_first_not_of("0123456789+-.eE, ") == std::string::npos ||
         text.find("nan") == 0 || text.find("inf") == 0;
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
  if (!good) {
    fail(ExitCode::kUsage, "environment '{}': R,G,B must be three numbers of at least 0", text);
  }
  return color;
}

/// A texel that is not a radiance would poison importance sampling of the whole map.
void sanitise(Image& image) {
  std::uint64_t bad = 0;
  for (float& f : image.floats) {
    if (std::isfinite(f) && f >= 0.0f) continue;
    f = 0.0f;
    ++bad;
  }
  if (bad > 0) {
    logWarning("{}: {} negative or non-finite values of the environment set to 0", image.name, bad);
  }
}

}  // namespace

Environment parseEnvironment(const std::string& text) {
  std::error_code error;
  const auto status = std::filesystem::status(text, error);
  Environment environment;
  if (!std::filesystem::exists(status) && looksLikeNumbers(text)) {
    environment.color = parseColor(text);
    return environment;
  }
  if (!std::filesystem::exists(status)) {
    fail(ExitCode::kInput, "{}: no such environment file (R,G,B is also possible)", text);
  }
  if (!std::filesystem::is_regular_file(status)) {
    fail(ExitCode::kInput, "{}: the environment is not a plain file", text);
  }
  auto image = std::make_shared<Image>(detail::readFloatImage(text, kMaxEnvironmentWidth));
  sanitise(*image);
  environment.color = vec3(1.0f);
  environment.map = std::move(image);
  return environment;
}

}  // namespace trex
