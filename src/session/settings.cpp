#include "src/session/settings.h"

#include <fmt/format.h>

namespace trex {

std::string exactText(const RenderSettings& settings) {
  return settings.dial ? "auto" : fmt::format("{}", settings.exact);
}

std::string guessText(const RenderSettings& settings) {
  switch (settings.guess) {
    case GuessKind::kRay:
      return guessText(0.0);
    case GuessKind::kCone:
      return guessText(1.0);
    case GuessKind::kMixed:
      return guessText(settings.coneShare);
    case GuessKind::kAuto:
      break;
  }
  return "auto";
}

std::string guessText(double coneShare) {
  if (coneShare <= 0.0) return "ray";
  return coneShare >= 1.0 ? "cone" : fmt::format("{}", coneShare);
}

}  // namespace trex
