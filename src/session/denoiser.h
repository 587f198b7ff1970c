// Which denoiser a render takes, and for how long.
#pragma once

#include <string>

#include "src/session/settings.h"

namespace trex {

enum class DenoiseMethod : std::uint8_t {
  kOff,
  kFilter,        ///< src/frame/denoise.h
  kOidnQuick,     ///< Open Image Denoise, all light in one go
  kOidnWell,      ///< the same by its best network
  kOidnThorough,  ///< that network for direct and indirect light apart
};

/// Whether Open Image Denoise may be taken: it is asked for, or `auto` finds it, there is memory
/// for it, and the picture is not exact. The same for every render with these settings here. Throws
/// Error(kMemoryOrDevice) if it is asked for and can't be used.
bool mayUseOidn(const RenderSettings& settings);

/// The choice. With a limit of time Open Image Denoise is tried out first: the best way that takes
/// no more than its share of the time. Throws as mayUseOidn().
DenoiseMethod denoiseMethod(const RenderSettings& settings);

/// Of the ways of Open Image Denoise the best one that takes no more than its share of so many
/// seconds of rendering, where the quick one takes `quick`; kFilter if none does.
DenoiseMethod wayWithin(double seconds, double quick);

/// Makes Open Image Denoise ready for pictures of these settings, where it may be taken: what can't
/// be is told when the picture asks.
void prepareDenoiser(const RenderSettings& settings);

/// Seconds that denoising a whole picture takes here, about: the guess alone, and with a
/// correction by pairs.
double denoiseSeconds(DenoiseMethod method, const RenderSettings& settings, bool corrected);

/// "none", "filter", or "oidn VERSION (DEVICE)".
std::string denoiserName(DenoiseMethod method);

inline bool isOidn(DenoiseMethod m) { return m >= DenoiseMethod::kOidnQuick; }

}  // namespace trex
