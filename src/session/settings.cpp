#include "src/session/settings.h"

#include <fmt/format.h>

namespace trex {

std::string exactText(const RenderSettings& settings) {
  return settings.dial ? "auto" : fmt::format("{}", settings.exact);
}

}  // namespace trex
