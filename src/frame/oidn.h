// Open Image Denoise 2 (https://www.openimagedenoise.org), opened at run time where it is there.
// Nothing of it is needed to build this program or to run it.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "src/core/maths.h"

namespace trex {

/// How well, for how long: OIDN_QUALITY_... of its API.
enum class OidnQuality : int { kFast = 4, kBalanced = 5, kHigh = 6 };

/// What a picture shows, row by row, width * height of each, and empty where it is not known.
struct OidnGuides {
  std::uint32_t width = 0, height = 0;
  std::vector<vec3> albedo{};  ///< [0, 1]
  std::vector<vec3> normal{};  ///< [-1, 1], any length up to 1
  bool smooth = false;         ///< they are without noise
};

/// The library with a device of it: a GPU where one works, else the CPU. Calls of several threads
/// take turns.
class Oidn {
 public:
  /// Opens `file`, a path or the name of a system's library, and tries a small picture on its
  /// device. Throws Error(kMemoryOrDevice): not there, not a library, another version than 2,
  /// functions missing, no device that works.
  explicit Oidn(const std::string& file);
  ~Oidn();
  Oidn(const Oidn&) = delete;
  Oidn& operator=(const Oidn&) = delete;

  const std::string& file() const;
  const std::string& version() const;  ///< "2.5.1"
  const std::string& device() const;   ///< "CPU, NAME"

  /// The guides without their noise; those that are empty stay so. Throws Error(kMemoryOrDevice).
  void smooth(OidnGuides& guides, OidnQuality quality) const;

  /// Light (linear, any size, not negative) without its noise: finite, not negative. Values that
  /// are not finite count as 0. On the CPU the same bits for any number of threads. Throws
  /// Error(kMemoryOrDevice).
  std::vector<vec3> denoise(const OidnGuides& guides, const std::vector<vec3>& light,
                            OidnQuality quality) const;

  /// Makes ready what denoise() needs for light with both guides, `cleanGuides` being smooth: some
  /// ms, which a small picture had better not wait for. Of no effect for large ones.
  void prepare(std::uint32_t width, std::uint32_t height, bool cleanGuides,
               OidnQuality quality) const;

  /// Memory that denoiseLight() takes at its peak, with the library itself, bytes (measured on the
  /// CPU).
  static std::uint64_t bytesNeeded(std::uint32_t width, std::uint32_t height);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// The parts of a picture's light denoised, and their sum. Each keeps its mean, unless the library
/// took or added more than a tenth, which a few outshining pixels do. `thorough`: takes the best
/// network, for twice the work a part, and smooths the guides first unless they are smooth, for as
/// much again as one part takes.
std::vector<vec3> denoiseLight(const Oidn& library, OidnGuides guides,
                               const std::vector<std::vector<vec3>>& parts, bool thorough);

/// Oidn::prepare() for both ways of denoiseLight(). Throws Error(kMemoryOrDevice).
void prepareLight(const Oidn& library, std::uint32_t width, std::uint32_t height);

/// Where the library is looked for, in this order: TREX_OIDN alone if it is set (`none`: nowhere);
/// else what scripts/oidn brings, in oidn/lib below $XDG_DATA_HOME/trex (~/.local/share/trex); the
/// system's.
std::vector<std::string> oidnPlaces();

/// What was found at the first of these places that has a library.
struct OidnSearch {
  std::shared_ptr<const Oidn> library;  ///< null: there is none that can be used
  std::string problem;                  ///< then: why, and what to do
  bool broken = false;                  ///< then: one is there, or named, and can't be used
};
OidnSearch searchOidn(const std::vector<std::string>& places);

/// Of oidnPlaces(), at the first call. Thread safe.
const OidnSearch& findOidn();

}  // namespace trex
