#include "src/session/denoiser.h"

#include <fmt/format.h>

#include <algorithm>
#include <mutex>
#include <vector>

#include "src/core/clock.h"
#include "src/core/error.h"
#include "src/core/log.h"
#include "src/core/memory.h"
#include "src/frame/denoise.h"
#include "src/frame/oidn.h"

namespace trex {
namespace {

/// Part of the memory that `auto` spends on Open Image Denoise.
constexpr std::uint64_t kMostMemoryPart = 4;

/// A way of it: its work over that of the quick one, and the most of the seconds of a render that
/// are spent on it. The better ways cost samples (docs/denoising.md).
struct Way {
  DenoiseMethod method;
  double work, share;
};
constexpr Way kWays[] = {{DenoiseMethod::kOidnThorough, 4.6, 0.125},
                         {DenoiseMethod::kOidnWell, 2.3, 0.25},
                         {DenoiseMethod::kOidnQuick, 1.0, 0.25}};

double workOf(DenoiseMethod method) {
  const Way* const way = std::find_if(std::begin(kWays), std::end(kWays),
                                      [&](const Way& w) { return w.method == method; });
  return way->work;
}

/// The shorter of two runs.
template <typename Run>
double secondsOf(const Run& run) {
  double best = kInfinity;
  for (int i = 0; i < 2; ++i) {
    const double mark = secondsNow();
    run();
    best = std::min(best, secondsNow() - mark);
  }
  return best;
}

/// Seconds a pixel that the filter takes here, at most: every neighbour counts on an even picture.
double filterSeconds() {
  constexpr std::uint32_t kSide = 64;
  static const double seconds = [&] {
    FeatureImage features(kSide, kSide);
    const std::vector<vec3> even(kSide * kSide, vec3(1.0f));
    return secondsOf([&] { denoiseGuess(features, even, even); }) / (kSide * kSide);
  }();
  return seconds;
}

/// Seconds a pixel of the quick way.
double oidnSeconds(const Oidn& library) {
  constexpr std::uint32_t kSide = 128;
  static const double seconds = [&] {
    const std::vector<vec3> even(kSide * kSide, vec3(0.5f));
    const OidnGuides guides{kSide, kSide, even, even};
    return secondsOf([&] { denoiseLight(library, guides, {even}, false); }) / (kSide * kSide);
  }();
  return seconds;
}

/// Said once: every render of a job asks.
void warnOfBroken(const std::string& problem) {
  static std::once_flag said;
  std::call_once(said, [&] { logWarning("{}", problem); });
}

}  // namespace

DenoiseMethod wayWithin(double seconds, double quick) {
  for (const Way& way : kWays) {
    if (way.work * quick <= way.share * seconds) return way.method;
  }
  return DenoiseMethod::kFilter;
}

bool mayUseOidn(const RenderSettings& s) {
  if (s.denoise == Denoise::kOidn) {
    const OidnSearch& search = findOidn();
    if (!search.library) fail(ExitCode::kMemoryOrDevice, "--denoise oidn: {}", search.problem);
    return true;
  }
  if (s.denoise != Denoise::kAuto || s.exact >= 1.0) return false;
  const std::uint64_t machine = availableMemoryLimit();
  const std::uint64_t allowed = s.maxMemory > 0 ? std::min(s.maxMemory, machine) : machine;
  if (Oidn::bytesNeeded(s.width, s.height) > allowed / kMostMemoryPart) return false;
  const OidnSearch& search = findOidn();
  if (search.broken && !search.library) warnOfBroken(search.problem);
  return search.library != nullptr;
}

DenoiseMethod denoiseMethod(const RenderSettings& s) {
  if (s.denoise == Denoise::kOff) return DenoiseMethod::kOff;
  try {
    if (mayUseOidn(s)) {
      if (!(s.seconds > 0.0)) return DenoiseMethod::kOidnThorough;
      const double quick = denoiseSeconds(DenoiseMethod::kOidnQuick, s, false);
      const DenoiseMethod method = wayWithin(s.seconds, quick);
      const bool asked = s.denoise == Denoise::kOidn;
      return asked && !isOidn(method) ? DenoiseMethod::kOidnQuick : method;
    }
  } catch (const Error& e) {
    if (s.denoise == Denoise::kOidn) throw;
    warnOfBroken(e.what());
  }
  const bool untouched = s.denoise == Denoise::kAuto && s.exact >= 1.0;
  return untouched ? DenoiseMethod::kOff : DenoiseMethod::kFilter;
}

void prepareDenoiser(const RenderSettings& s) {
  try {
    if (mayUseOidn(s)) prepareLight(*findOidn().library, s.width, s.height);
  } catch (const Error&) {
  }
}

double denoiseSeconds(DenoiseMethod method, const RenderSettings& s, bool corrected) {
  if (method == DenoiseMethod::kOff) return 0.0;
  const double pixels = static_cast<double>(s.width) * s.height;
  const double corrections = !corrected ? 0.0 : s.dial ? 2.0 : 1.0;  // a dial's: of two halves
  if (!isOidn(method)) return (1.0 + corrections) * filterSeconds() * pixels;
  const double guess = workOf(method) * oidnSeconds(*findOidn().library);
  return (guess + (corrected ? corrections * filterSeconds() : 0.0)) * pixels;
}

std::string denoiserName(DenoiseMethod method) {
  if (method == DenoiseMethod::kOff) return "none";
  if (!isOidn(method)) return "filter";
  const Oidn& library = *findOidn().library;
  return fmt::format("oidn {} ({})", library.version(), library.device());
}

}  // namespace trex
