// Paths on their way through the stages. Private to src/paths.
#pragma once

#include <algorithm>
#include <optional>
#include <vector>

#include "src/crays/bsdf.h"
#include "src/crays/lights.h"
#include "src/paths/caustics.h"
#include "src/paths/cones.h"
#include "src/paths/path_sample.h"
#include "src/paths/path_state.h"
#include "src/paths/plain_wave.h"

namespace trex {

/// A question for a light that was chosen: does its light arrive?
struct LightQuestion {
  LightSample light;
  RayStart start;
  BsdfValue surface;               ///< of the straight direction
  LobeKind kind = LobeKind::kAll;  ///< what its f counts
  bool farEmitter = false;         ///< an emitter beyond the near field: no cone gathers it
  bool coneShadow = false;         ///< the guess has asked a cone
};

/// A light that a path has asked for at a vertex that it may have left since: all that the answer
/// is made of.
struct AskedLight {
  LightQuestion question;
  vec3 throughput{1.0f}, absorption{0.0f};  ///< absorption: on the way to the light, 1/m
  RayHit at{};                              ///< the vertex, ...
  vec3 incoming{0.0f};                      ///< ... and the path's direction to it
  bool coupled = true;
  bool direct = false;  ///< see PathSample
};

/// The light that a question brings if it arrives.
struct LightAnswer {
  vec3 guess{0.0f}, exact{0.0f};
  bool apart = false;   ///< to guess and exact path; else `exact` to where the path adds up
  bool direct = false;  ///< see PathSample
};

/// The light of a question that arrives by `way`. `throughput`, `coupled`: of the path at the
/// vertex; `surface`: what it scatters from there, in that direction.
LightAnswer weigh(const LightQuestion& question, const vec3& throughput, bool coupled, bool direct,
                  const LightConnection& way, const BsdfValue& surface);

/// The next ray of a path: how far it is traced, and whether a cone may go on from there.
struct NextRay {
  bool cone;
  float end;  ///< metres
};

/// What becomes of a path at a surface.
enum class Fate : std::uint8_t {
  kEnds,
  kPasses,    ///< a transparent layer: its next ray is ready
  kScatters,  ///< light that arrives there is not asked for
  kLit,       ///< lights are asked for, then it scatters
};

struct MediumLight;

/// A path in a wave: its state, and what one stage leaves for the next between two rays.
struct WavePath : PathState {
  PathSample* sample = nullptr;
  RayCounts* counts = nullptr;
  const SampleCaustics* caustics = nullptr;  ///< may be null
  Sampler sampler;
  /// The vertex, and where the path is. They remember what lights weigh there.
  LightPoint points[2];
  std::uint8_t atVertex = 0;  ///< which of them
  RayHit hit{};
  /// Of a plain surface only what rays ask for, and no Bsdf: the rest is in the wave's lanes.
  Surface surface;
  std::optional<Bsdf> bsdf;
  std::uint8_t place = PlainWave::kNotPlain;  ///< of a plain surface among those of its wave
  LightQuestion question;
  bool asks = false;  ///< the question
  /// Answered before the path arrives, where rays wait for pages: light that media scatter on its
  /// last stretch, and the way by which light of an emitter there could have been sampled.
  const MediumLight* medium = nullptr;
  const LightConnection* emitter = nullptr;
  Fate fate = Fate::kEnds;
  bool coneVertex = false;
  std::uint8_t choices = 0;  ///< of a look: surfaces so far that showed two things

  WavePath(const PathState& state, const Sampler& numbers)
      : PathState(state), sampler(numbers), points{{vertex, vertexNormal}, vec3(0.0f)} {}

  bool isPlain() const { return place != PlainWave::kNotPlain; }
  const LightPoint& lastPoint() const { return points[atVertex]; }
  LightPoint& here() { return points[1 - atVertex]; }
  /// Turned here: the next ray is ready but for its direction.
  void turn(const vec3& normal) {
    atVertex = 1 - atVertex;
    vertex = lastPoint().position();
    vertexNormal = normal;
    clear = ClearPath();
    left = start;
    travelled = 0.0f;
  }
  /// `direct`: see PathSample.
  void add(const vec3& light, bool direct) {
    (coupled ? sample->common : sample->exact) += light;
    if (!direct) return;
    if (coupled) sample->direct += light;
    sample->directExact += light;
  }
  void add(const LightAnswer& light) {
    if (!light.apart) return add(light.exact, light.direct);
    sample->guess += light.guess;
    sample->exact += light.exact;
    if (!light.direct) return;
    sample->direct += light.guess;
    sample->directExact += light.exact;
  }
  /// Light that the last ray came straight from.
  void addSeen(const vec3& light) {
    add(light, scattered <= 1);
    if (certain && coupled) sample->own += light;
  }
  /// The guess parts from the path. False if nobody follows the exact path.
  bool part() {
    coupled = false;
    return paired;
  }
};

/// Paths that are traced together. Those that are under way stay in the order of their samples.
struct Wave : PlainWave {
  /// Some 2 KiB each; so many stay in the first-level cache or close to it.
  static constexpr std::size_t kPaths = PlainWave::kMost;

  std::vector<WavePath> paths;
  std::vector<WavePath*> underWay;
  Cones& cones;

  explicit Wave(Cones& requests) : cones(requests) {
    paths.reserve(kPaths);
    underWay.reserve(kPaths);
  }
};

inline float powerHeuristic(float a, float b) {
  // Scaled so that the squares of large densities do not overflow.
  if (!(a < kInfinity)) return 1.0f;
  const float ratio = b / std::max(a, 1e-30f);
  return 1.0f / (1.0f + ratio * ratio);
}

}  // namespace trex
