#include "src/session/plan.h"

#include <algorithm>

namespace trex {
namespace {

using State = VoxelLight::State;

constexpr std::uint32_t kPreviewSamples = 64;  // no preview lives that long
constexpr std::uint32_t kCoarseCells = 16;     // every fourth pixel, a picture to go on with
constexpr std::uint32_t kPreviewTurns = 3;

/// First a picture to go on with; then every third piece of work, so that the preview goes on while
/// photons are shot. Exact previews are dear, so there the coarsest picture is enough: else a
/// camera that keeps moving would never see any light.
bool previewDue(const SessionState& s) {
  if (!s.interactive || s.previewSamples >= kPreviewSamples) return false;
  if (!s.exactPreviews) return s.lightOfBefore && s.turn % kPreviewTurns == 0;
  const std::uint32_t cells = s.lightOfBefore ? kCoarseCells : 1;
  return s.previewCells < cells || s.light == State::kAwaited || s.turn % kPreviewTurns == 0;
}

/// First sample after those that are there for which more photons are shot. Targets stand still
/// once all photons there can be are shot.
std::uint32_t nextLightSample(const SessionState& s) {
  const auto photons = [&](std::uint32_t sample) {
    return photonsFor(sample, s.pixels, s.leastPhotons, s.inPages);
  };
  std::uint32_t next = 4;
  while (next <= s.samples && next < (1u << 30)) next *= 4;
  // Samples that wait for pages together share their loads: they stop only where they must.
  while (s.inPages && photons(next) == photons(s.samples) && next < (1u << 30)) next *= 4;
  return photonTarget(next, s.pixels) > photonTarget(s.samples, s.pixels) ? next : kAnySamples;
}

}  // namespace

std::uint64_t photonsFor(std::uint32_t sample, std::uint64_t pixels, std::uint64_t leastPhotons,
                         bool inPages) {
  return std::max(photonTarget(inPages ? std::max(sample, kTogether) : sample, pixels),
                  leastPhotons);
}

std::vector<SampleLight> lightsOf(std::uint64_t pixels, std::uint64_t leastPhotons, bool inPages) {
  std::vector<SampleLight> lights{{0, photonsFor(0, pixels, leastPhotons, inPages)}};
  for (std::uint32_t sample = 4; sample < 1u << 30; sample *= 4) {
    const std::uint64_t photons = photonsFor(sample, pixels, leastPhotons, inPages);
    if (photons > lights.back().photons) lights.push_back({sample, photons});
  }
  return lights;
}

bool awaitsLight(const SessionState& s) {
  return s.guesses && s.light != State::kAbsent && s.light != State::kReady;
}

std::optional<Work> plan(const SessionState& s) {
  if (awaitsLight(s)) {
    if (previewDue(s)) return Work{.kind = Work::Kind::kPreview, .barrier = kPreviewSamples};
    if (s.light == State::kAwaited) return {};
    if (s.light != State::kShooting) return Work{.kind = Work::Kind::kLight};
    return Work{.kind = Work::Kind::kPhotons,
                .photons = photonsFor(0, s.pixels, s.leastPhotons, s.inPages)};
  }
  if (s.goalReached) return {};
  const bool reads = s.guesses && s.light == State::kReady;
  const std::uint64_t photons = photonsFor(s.samples, s.pixels, s.leastPhotons, s.inPages);
  if (reads && s.photons < photons) {
    return Work{.kind = Work::Kind::kPhotons, .photons = photons};
  }
  // A capture looks at its goal after every sample, or after as many as can be under way at once.
  std::uint32_t barrier = s.interactive ? kAnySamples : s.samples + s.samplesAtOnce;
  if (s.mostSamples > 0) barrier = std::min(barrier, s.mostSamples);
  if (reads) barrier = std::min(barrier, nextLightSample(s));
  barrier = std::min(barrier, s.nextLook);
  return Work{.kind = Work::Kind::kSamples, .barrier = barrier};
}

}  // namespace trex
