// A path that waits for pages: all that it knows, and the rays that have no answer yet.
#pragma once

#include <cstdint>
#include <type_traits>

#include "src/crays/waiting_ray.h"
#include "src/paths/medium_light.h"
#include "src/paths/path_state.h"
#include "src/paths/wave.h"

namespace trex {

/// The light of a vertex where glass, alpha or media may be on the way.
struct WaitingLight {
  AskedLight asked;
  WaitingConnection way{};
};

/// What a path asks at the end of a ray before it arrives there.
enum class Arrival : std::uint8_t {
  kOpen,
  kMedium,   ///< what media scatter on the way
  kSurface,  ///< what is there
  kEmitter,  ///< how light of what shines there could have been sampled
  kReady,
};

/// Plain data. A path at a vertex has two questions at once: whether the light that was chosen
/// there arrives, and where it goes on. It goes on when both are answered.
struct WaitingPath {
  PathState state;
  NextRay next{false, kInfinity};
  WaitingRay ray{};     ///< to the next surface
  WaitingRay shadow{};  ///< towards the light, if `asks`; of the arrival
  RayQuery towards{};
  LightAnswer light{};    ///< what it brings if nothing is in the way
  vec3 caustics{0.0f};    ///< added after it
  bool asks = false;      ///< for that light
  bool collects = false;  ///< caustics
  bool ended = false;     ///< there is no next surface: it waits for the light alone
  bool emitter = false;   ///< the arrival has asked for the way of its light
  std::uint8_t open = 0;  ///< rays without an answer
  Arrival arrival = Arrival::kOpen;

  /// The ray to the next surface.
  RayQuery query() const { return {state.start, state.direction, state.tnear, RayEnd(next.end)}; }
};
static_assert(std::is_trivially_destructible_v<WaitingPath>);
static_assert(sizeof(WaitingPath) <= 720);
static_assert(sizeof(WaitingLight) <= 560 && sizeof(MediumLight) <= 640);

}  // namespace trex
