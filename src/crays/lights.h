// Light sources gathered from a scene and sampled for next event estimation and photons.
//
// Triangles that shine (emitters.h), point, spot and directional lights stand in a light tree
// (light_tree.h) and are chosen at a point in proportion to about the irradiance that they give
// there, whatever their number. An environment map stands beside the tree with the integral of its
// radiance for its weight. A constant sky is not in the set of next event estimation: the cosine of
// the surface is its ideal density, so directions sampled from the BSDF serve it alone. Photons
// leave sources in proportion to their power.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <vector>

#include "src/core/maths.h"
#include "src/core/sampler.h"
#include "src/crays/clear_path.h"
#include "src/crays/emitters.h"
#include "src/crays/light_tree.h"
#include "src/crays/media.h"
#include "src/crays/photon_guide.h"
#include "src/crays/visibility.h"
#include "src/scene/scene.h"

namespace trex {

/// Where light arrives. Remembers what the lights weigh there once a LightSet has been asked, so
/// each thread has its own, and one serves one LightSet.
class LightPoint {
 public:
  /// `normal`: unit, of a surface that scatters light of its side alone; zero if light of all
  /// directions counts (media, glass).
  LightPoint(const dvec3& position, const vec3& normal = vec3(0.0f))
      : position_(position), normal_(normal) {}
  LightPoint(const vec3& position, const vec3& normal = vec3(0.0f))
      : LightPoint(dvec3(position), normal) {}
  const dvec3& position() const { return position_; }
  /// `normal` as above.
  void moveTo(const dvec3& position, const vec3& normal) {
    position_ = position;
    normal_ = normal;
    weighed_ = false;
  }

 private:
  friend class LightSet;
  dvec3 position_;
  vec3 normal_;
  mutable bool weighed_ = false;
  mutable LightTree::Cut cut_;
};

/// A direction towards a light from a point. radiance/pdf is what arrives if nothing is between;
/// for point-like lights (`delta`) pdf is the chance of choosing the light and radiance is an
/// irradiance at normal incidence.
struct LightSample {
  vec3 direction{0.0f};
  float distance = 0.0f;  ///< metres; infinite for directional lights and the environment
  vec3 radiance{0.0f};
  float pdf = 0.0f;  ///< per solid angle
  bool delta = false;
  float solidAngle =
      0.0f;            ///< of the light as seen from the point, steradian, about; 0 if point-like
  dvec3 target{0.0};   ///< the point on the light, in render space, if `distance` is finite
  vec3 normal{0.0f};   ///< of an emitter's front there; zero for other lights
  TriangleId emitter;  ///< none for other lights

  /// Where a shadow ray ends.
  RayEnd end() const {
    return distance < kInfinity ? RayEnd(distance, target, emitter) : RayEnd(distance);
  }
  /// `pdf` of the way by which the light is reached: thick glass shows another side of an emitter.
  float pdfBy(const LightConnection& way) const {
    const float straight = glm::dot(normal, direction), seen = glm::dot(normal, way.direction);
    if (!way.refracted || straight == 0.0f) return pdf / way.focus;
    return straight * seen > 0.0f ? pdf / way.focus * (straight / seen) : kInfinity;
  }
};

/// A light that was chosen for a point, and the numbers that choose a place on it.
struct LightChoice {
  const LightPoint* at = nullptr;
  Sampler* sampler = nullptr;
  vec2 u{0.0f};
  double onLight = 0.0;  ///< u.x with more digits, once it has chosen a light of its leaf
  std::uint32_t light = 0;
  float chance = 0.0f;  ///< 0: nothing was chosen
  bool map = false;     ///< it is the environment map
};

/// A photon leaving a light: power is that of all light divided by the density of the choice, so
/// the mean of many photons carries the scene's power.
struct EmittedPhoton {
  RayStart start;
  vec3 direction{0.0f};
  vec3 power{0.0f};  ///< W
  /// How it was chosen, for EmissionGuide::learn: the source, the place in its primary sample space
  /// (direction, disk) and the density there over the uniform one. Set for outside sources.
  std::uint32_t source = 0;
  vec4 primary{0.0f};
  float density = 1.0f;
  bool scatters = true;     ///< media may scatter it once: not so if they sent it
  float range = kInfinity;  ///< of the light, not yet in its power: RangeOnTheWay
};

/// Cumulative luminance times sin(theta) of a map: what its directions are sampled by.
struct MapTables {
  std::vector<double> rows, columns;
  double power = 0.0;  ///< integral of its luminance over the sphere
};

/// Immutable, so thread safe.
class LightSet {
 public:
  /// Scene and rays must outlive it. Triangles of emissive materials of all instances are listed;
  /// what the rays' visibility hides does not shine. Throws as Emitters does.
  LightSet(const Scene& scene, const RayScene& rays);

  /// True if next event estimation has anything to sample.
  bool empty() const { return tree_.empty() && !(mapWeight_ > 0.0f); }
  /// True if any light exists, the constant sky included.
  bool anyPower() const { return totalPower_ > 0.0; }
  /// Samples a light as seen from a point; false if the sample carries nothing.
  bool sample(const LightPoint& at, Sampler& sampler, LightSample& out) const;
  /// sample() in two steps, for many points together, with the same bits: so that memory that is
  /// waited for is waited for once. `at` and `sampler` of the choices are set.
  void choose(std::span<LightChoice> choices) const;
  bool sample(const LightChoice& choice, LightSample& out) const;

  /// Density per solid angle with which sample(at) would have found what a ray hit after
  /// `distance`; cosine at the emitter, not negative. 0 for surfaces not in the set.
  float pdfEmitter(const LightPoint& at, const RayHit& hit, float distance, float cosine) const;
  /// Density with which sample(at) would have found this direction of the environment map; 0 if
  /// there is none.
  float pdfEnvironment(const LightPoint& at, const vec3& direction) const;
  /// Radiance of the environment from a direction (pointing away from the scene).
  vec3 environment(const vec3& direction) const;
  bool hasEnvironment() const { return environment_.present(); }
  /// Whether a ray can find any of the lights.
  bool canBeHit() const { return hasEnvironment() || !emitters_.triangles().empty(); }

  /// A photon; a function of the sampler's numbers and the guides. False if it carries nothing.
  /// `guides`: none, or one a source as guides() makes them.
  bool emit(Sampler& sampler, EmittedPhoton& out, std::span<const EmissionGuide> guides = {}) const;
  /// Guides that know nothing yet, by source; none if no source shines from outside.
  std::vector<EmissionGuide> guides() const;
  /// Which readers of an ImportanceMap are lit by a sun that shines towards a direction: 1 or 0.
  using SunSeers = std::function<std::vector<std::uint8_t>(const vec3& towards)>;
  /// Hints for the guides from importons: their escapes for skies, and for suns what they see of
  /// them.
  void hint(const ImportanceMap& importance, const SunSeers& seers,
            std::span<EmissionGuide> guides) const;
  /// Total power of all lights, W, by luminance.
  double totalPower() const { return totalPower_; }
  /// The largest channel of a photon's power that emit() can return.
  float largestPhotonPower() const;

 private:
  enum class Kind : std::uint8_t { kEmitters, kPunctual, kMap, kConstant, kMedia };

  struct Entry {
    Kind kind;
    std::uint32_t index;  ///< into punctual_
    double power;         ///< luminance, W
  };
  struct Punctual {
    Light light;
    dvec3 position;
  };

  void addEmitters();
  void addPunctual(const Scene& scene, const dvec3& renderOrigin);
  void addEnvironment(const Scene& scene);
  void buildTree();
  LightBounds boundsOf(const Emitters::Triangle& triangle) const;
  LightBounds boundsOf(const Punctual& punctual) const;
  vec3 toTree(const dvec3& position) const;
  double sidesOf(const Emitters::Triangle& triangle) const;
  double emitterPower(const Emitters::Triangle& triangle) const;
  vec3 toMap(const vec3& direction) const;
  vec3 fromMap(const vec3& direction) const;
  const LightTree::Cut& cutAt(const LightPoint& at) const;
  float mapShare(const LightTree::Cut& cut) const;
  float mapDensity(const vec3& direction) const;
  static std::size_t pick(const std::vector<double>& cumulative, double u, double& rest);
  void pickOfLeaf(const LightTree::Choice& leaf, LightChoice& out) const;
  bool sampleTriangle(const Emitters::Triangle& triangle, const LightPoint& at, double u, float v,
                      LightSample& out) const;
  bool samplePunctual(const Punctual& punctual, const LightPoint& at, vec2 u,
                      LightSample& out) const;
  bool sampleMap(vec2 u, LightSample& out) const;
  vec3 mapDirection(vec2 u, float& pdf) const;
  void emitTriangle(double choice, Sampler& sampler, EmittedPhoton& out) const;
  void emitPunctual(const Punctual& punctual, Sampler& sampler, EmittedPhoton& out) const;
  vec2 mapPlace(const vec3& direction) const;
  vec2 diskPlace(const vec3& towards, const vec3& point) const;
  void hintSky(const Entry& source, const ImportanceMap& importance, EmissionGuide& guide) const;
  void hintWanted(const Entry& source, const ImportanceMap& importance, EmissionGuide& guide) const;
  void hintSun(const vec3& towards, const ImportanceMap& importance, const SunSeers& seers,
               EmissionGuide& guide) const;
  int outsideDimensions(const Entry& source) const;
  void emitOutside(const Entry& source, Sampler& sampler, std::span<const EmissionGuide> guides,
                   EmittedPhoton& out) const;
  void emitFromSphere(const vec3& towards, vec2 u, EmittedPhoton& out) const;

  Emitters emitters_;
  std::vector<double> emitterCumulative_;  ///< power before each triangle
  std::vector<Punctual> punctual_;
  LightTree tree_;              ///< triangles, then punctual lights
  std::vector<Entry> sources_;  ///< of photons
  std::vector<double> sourceCumulative_;
  Environment environment_;
  std::shared_ptr<const Media> media_;    ///< null unless one shines
  std::shared_ptr<const MapTables> map_;  ///< null if there is no map
  double mapPower_ = 0.0;
  float mapWeight_ = 0.0f;                   ///< in the tree's unit
  float mapSine_ = 0.0f, mapCosine_ = 1.0f;  ///< of its rotation
  bool many_ = false;                        ///< a choice among them wants more than 24 bits
  Visibility visibility_;
  vec3 centre_{0.0f};
  float radius_ = 1.0f;  ///< of the sphere around the scene
  double totalPower_ = 0.0;
};

}  // namespace trex
