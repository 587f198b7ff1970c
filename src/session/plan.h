// What a session does next: plain data from plain data. No rays, no clocks, no threads.
//
//   samples read light that is not there    a preview (of the viewer), or the light's next step
//   the goal is reached                     nothing
//   the light has too few photons           more of them
//   else                                    samples, up to where the light may change
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "src/session/photon_noise.h"
#include "src/session/voxel_light.h"

namespace trex {

constexpr std::uint32_t kAnySamples = 0xffffffffu;

/// All that the choice depends on.
struct SessionState {
  bool guesses = false;  ///< samples read light, if there are voxels
  VoxelLight::State light = VoxelLight::State::kAbsent;
  std::uint64_t photons = 0;       ///< that the light is of
  std::uint64_t leastPhotons = 0;  ///< before the first sample
  bool inPages = false;            ///< the model is, whether these are in memory or not
  std::uint64_t pixels = 1;
  std::uint32_t samples = 0;      ///< that every pixel has
  std::uint32_t mostSamples = 0;  ///< that the goal lets a pixel have; 0: no limit
  bool goalReached = false;
  std::uint32_t nextLook = kAnySamples;  ///< samples at which the dial looks next
  // Of the viewer alone:
  bool interactive = false;    ///< there are previews, and tiles overtake each other
  bool lightOfBefore = false;  ///< that previews read; else they trace exact paths
  /// Of which there are some. Not where pages have no room, and there the light need not wait for
  /// any preview.
  bool exactPreviews = true;
  std::uint32_t previewCells = 0;    ///< of the preview's first sample, in every tile; of 64
  std::uint32_t previewSamples = 0;  ///< whole ones
  std::uint32_t samplesAtOnce = 1;   ///< of a capture, between two looks at its goal
  std::uint32_t turn = 0;            ///< grows with every piece of work
};

/// One piece of work.
struct Work {
  enum class Kind : std::uint8_t {
    kPreview,  ///< samples that are shown while the light is made, and never enter the picture
    kLight,    ///< what the light's state asks for: VoxelLight::renew()
    kPhotons,  ///< `photons` in all: VoxelLight::shoot()
    kSamples,  ///< of the picture
  };
  Kind kind = Kind::kSamples;
  std::uint64_t photons = 0;
  std::uint32_t barrier = 0;  ///< no pixel gets this sample or a later one
  bool operator==(const Work&) const = default;
};

/// Samples read light that is not there: what is shown meanwhile is the preview.
bool awaitsLight(const SessionState& s);

/// Photons that there are to be before sample number `sample`: photonTarget(), or the least. Those
/// of sample kTogether are there from the first on where a model is in pages: samples that wait for
/// pages together share their loads, so the light had better not change between them.
constexpr std::uint32_t kTogether = 4;
std::uint64_t photonsFor(std::uint32_t sample, std::uint64_t pixels, std::uint64_t leastPhotons,
                         bool inPages);

/// The lights of all samples of such a picture.
std::vector<SampleLight> lightsOf(std::uint64_t pixels, std::uint64_t leastPhotons, bool inPages);

/// Nothing if there is nothing to do: the goal is reached, or voxels are awaited.
std::optional<Work> plan(const SessionState& s);

}  // namespace trex
