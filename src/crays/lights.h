// Light sources gathered from a scene and sampled for next event estimation and photons.
//
// Emissive triangles of one object and material form a luminaire. Luminaires, point, spot and
// directional lights and an environment map are chosen in proportion to an estimate of the
// irradiance each gives at the point, if there are few; of their power, if there are many. A
// constant sky is not in the set of next event estimation: the cosine of the surface is its ideal
// density, so directions sampled from the BSDF serve it alone.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <unordered_map>
#include <vector>

#include "src/core/maths.h"
#include "src/core/sampler.h"
#include "src/crays/clear_path.h"
#include "src/crays/media.h"
#include "src/crays/photon_guide.h"
#include "src/crays/ray_scene.h"
#include "src/crays/visibility.h"
#include "src/scene/scene.h"

namespace trex {

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
      0.0f;           ///< of the light as seen from the point, steradian, about; 0 if point-like
  dvec3 target{0.0};  ///< the point on the light, in render space, if `distance` is finite

  /// Where a shadow ray ends.
  RayEnd end() const { return distance < kInfinity ? RayEnd(distance, target) : RayEnd(distance); }
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
  bool scatters = true;  ///< media may scatter it once: not so if they sent it
};

/// Cumulative luminance times sin(theta) of a map: what its directions are sampled by.
struct MapTables {
  std::vector<double> rows, columns;
  double power = 0.0;  ///< integral of its luminance over the sphere
};

class LightSet {
 public:
  /// `renderOrigin` and `bounds` as in RayScene. Triangles of emissive materials of all instances
  /// are listed; a textured emission counts with its mean. What `visibility` hides does not shine.
  LightSet(const Scene& scene, const dvec3& renderOrigin, const Box3f& bounds,
           const Visibility& visibility = {});

  /// True if next event estimation has anything to sample.
  bool empty() const { return lights_.empty(); }
  /// True if any light exists, the constant sky included.
  bool anyPower() const { return totalPower_ > 0.0; }
  /// Samples a light as seen from `point`; false if the sample carries nothing.
  bool sample(const dvec3& point, Sampler& sampler, LightSample& out) const;

  /// Density per solid angle with which sample(point) would have found the emitter of this object
  /// and material that a ray hit after `distance`; cosine at the emitter. 0 for surfaces not in the
  /// set.
  float pdfEmitter(const vec3& point, std::uint32_t object, std::uint32_t material, float distance,
                   float cosine) const;
  /// Density with which sample(point) would have found this direction of the environment map; 0 if
  /// there is none.
  float pdfEnvironment(const vec3& point, const vec3& direction) const;
  /// Radiance of the environment from a direction (pointing away from the scene).
  vec3 environment(const vec3& direction) const;
  bool hasEnvironment() const { return environment_.present(); }
  /// Whether a ray can find any of the lights.
  bool canBeHit() const { return hasEnvironment() || !luminaires_.empty(); }

  /// A photon; a function of the sampler's numbers and the guides. False if it carries nothing.
  /// `guides`: none, or one a source as guides() makes them.
  bool emit(Sampler& sampler, EmittedPhoton& out, std::span<const EmissionGuide> guides = {}) const;
  /// Guides that know nothing yet, by source; none if no source shines from outside.
  std::vector<EmissionGuide> guides() const;
  /// Hints for the guides from importons: their escapes for skies, and for suns what they see of
  /// them.
  void hint(const ImportanceMap& importance, const ClearLayers& layers,
            std::span<EmissionGuide> guides) const;
  /// Total power of all lights, W, by luminance.
  double totalPower() const { return totalPower_; }
  /// The largest channel of a photon's power that emit() can return.
  float largestPhotonPower() const;

 private:
  enum class Kind : std::uint8_t { kLuminaire, kPunctual, kMap, kConstant, kMedia };
  static constexpr std::size_t kMostWeighed =
      48;  ///< lights up to which each is weighed at a point

  struct Emitter {
    dvec3 corner;
    vec3 edge1, edge2, normal;  ///< triangle, normal of the front
    float area;

    dvec3 at(float u, float v) const { return corner + dvec3(edge1 * u + edge2 * v); }
  };
  /// Emitters first .. first + count - 1: one object, one material, so one radiance.
  struct Luminaire {
    std::uint32_t first, count, object, material;
    vec3 centre, meanNormal;  ///< meanNormal: area weighted, shorter than 1 if the faces differ
    float radius, area;
  };
  struct Entry {
    Kind kind;
    std::uint32_t index;  ///< into luminaires_ or punctual_
    double power;         ///< luminance, W
  };
  struct Punctual {
    Light light;
    dvec3 position;
  };

  void addLuminaires(const Scene& scene, const dvec3& renderOrigin);
  void addLuminaire(const Mesh& mesh, const Instance& instance, const dvec3& renderOrigin);
  void addPunctual(const Scene& scene, const dvec3& renderOrigin);
  void addEnvironment(const Scene& scene);
  vec3 toMap(const vec3& direction) const;
  vec3 fromMap(const vec3& direction) const;
  float weigh(const Entry& entry, const vec3& point) const;
  std::size_t choose(const vec3& point, float& u, float& chance) const;
  float chanceOf(std::size_t light, const vec3& point) const;
  const Emitter& pickEmitter(const Luminaire& luminaire, float& u) const;
  float mapDensity(const vec3& direction) const;
  static std::size_t pick(const std::vector<double>& cumulative, float u, float& remapped);
  bool sampleLuminaire(const Luminaire& luminaire, const dvec3& point, vec2 u,
                       LightSample& out) const;
  bool samplePunctual(const Punctual& punctual, const dvec3& point, vec2 u, LightSample& out) const;
  bool sampleMap(vec2 u, LightSample& out) const;
  vec3 mapDirection(vec2 u, float& pdf) const;
  void emitLuminaire(const Luminaire& luminaire, Sampler& sampler, EmittedPhoton& out) const;
  void emitPunctual(const Punctual& punctual, Sampler& sampler, EmittedPhoton& out) const;
  vec2 mapPlace(const vec3& direction) const;
  vec2 diskPlace(const vec3& towards, const vec3& point) const;
  void hintSky(const Entry& source, const ImportanceMap& importance, EmissionGuide& guide) const;
  void hintSun(const vec3& towards, const ImportanceMap& importance, const ClearLayers& layers,
               EmissionGuide& guide) const;
  int outsideDimensions(const Entry& source) const;
  void emitOutside(const Entry& source, Sampler& sampler, std::span<const EmissionGuide> guides,
                   EmittedPhoton& out) const;
  void emitFromSphere(const vec3& towards, vec2 u, EmittedPhoton& out) const;

  std::vector<Emitter> emitters_;
  std::vector<double> emitterCumulative_;  ///< area before each emitter, over all luminaires
  std::vector<Luminaire> luminaires_;
  std::unordered_map<std::uint64_t, std::uint32_t> luminaireOf_;  ///< object and material to light
  std::vector<Punctual> punctual_;
  std::vector<Entry> lights_;   ///< of next event estimation
  std::vector<Entry> sources_;  ///< of photons: lights_, the constant sky and media
  std::vector<double> lightCumulative_, sourceCumulative_;
  std::vector<vec3> materialRadiance_;  ///< mean emission by material
  std::vector<bool> materialTwoSided_;
  Environment environment_;
  std::shared_ptr<const Media> media_;    ///< null unless one shines
  std::shared_ptr<const MapTables> map_;  ///< null if there is no map
  double mapPower_ = 0.0;
  float mapSine_ = 0.0f, mapCosine_ = 1.0f;  ///< of its rotation
  Visibility visibility_;
  vec3 centre_{0.0f};
  float radius_ = 1.0f;  ///< of the sphere around the scene
  double totalPower_ = 0.0;
};

}  // namespace trex
