// The media of a scene as rays meet them: transmittance, emission, and light that is scattered
// once, towards the ray, by the media along it.
//
// Optical depths are integrated cell by cell (asvo/medium_trace.h) and carry no noise. Where light
// is scattered is sampled in proportion to extinction times transmittance; with several media, one
// is chosen by its opacity and the others attenuate. Emission of overlapping media is sampled by
// one place more. The phase function is that of Henyey and Greenstein [1941].
//
// A scene without media has no object of this class: all that it costs is a null pointer.
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "src/core/maths.h"
#include "src/core/sampler.h"
#include "src/scene/scene.h"

namespace trex {

/// What a stretch of a ray meets of media.
struct MediaStretch {
  float transmittance = 1.0f;
  vec3 emission{0.0f};  ///< radiance that arrives at the start
  /// Light is scattered at origin + distance * direction with this weight (albedo over the density
  /// of the choice, transmittance included); 0: nothing is.
  vec3 scatter{0.0f};
  float distance = 0.0f;
  float anisotropy = 0.0f;  ///< of the medium there
};

/// Where a photon was scattered.
struct MediaCollision {
  float distance = 0.0f;
  vec3 albedo{0.0f};
  float anisotropy = 0.0f;
};

/// Immutable; all calls are thread safe. Directions have unit length, distances are metres and may
/// be infinite.
class Media {
 public:
  /// Null if the scene has no medium that does anything.
  static std::unique_ptr<const Media> make(const Scene& scene, const dvec3& renderOrigin);

  Box3f bounds() const { return bounds_; }  ///< render space
  /// Share of light that passes, [0, 1]; less than 1e-26 is 0.
  float transmittance(const dvec3& origin, const vec3& direction, float distance) const;
  /// Whether anything of a medium lies between the two distances.
  bool meets(const dvec3& origin, const vec3& direction, float from, float to) const;
  /// All of a stretch, with one place where light is scattered. Takes random numbers only if a
  /// medium is met.
  MediaStretch stretch(const dvec3& origin, const vec3& direction, float distance,
                       Sampler& sampler) const;
  /// Whether a photon is scattered or absorbed before `distance`, by chance.
  bool collide(const dvec3& origin, const vec3& direction, float distance, Sampler& sampler,
               MediaCollision& out) const;

  // Media as a source of photons, which makes their light reach surfaces.

  /// Power of the emission, luminance, W.
  double power() const { return powers_.empty() ? 0.0 : powers_.back(); }
  /// Largest power of a photon by channel, if power() is its luminance.
  float largestChannel() const { return largestChannel_; }
  /// A photon in proportion to the emission. `power` has the luminance power() in the mean.
  void emit(Sampler& sampler, dvec3& origin, vec3& direction, vec3& power) const;

 private:
  struct One {
    std::shared_ptr<const asvo::Medium> grid;
    dmat4 toCells;  ///< from render space
    dmat4 toRender;
    double volume;  ///< of a cell, m^3
    float density;
    vec3 albedo, emission;
    float anisotropy;
  };
  struct Met;
  bool enter(const One& one, const dvec3& origin, const vec3& direction, float distance,
             Met& met) const;
  float passed(const One& one, const dvec3& origin, const vec3& direction, float distance) const;
  void addSources();

  std::vector<One> media_;
  Box3f bounds_;
  /// Bricks that shine: their medium, brick of the index, and sums of power.
  struct Source {
    std::uint32_t medium, place;
  };
  std::vector<Source> sources_;
  std::vector<double> powers_;
  float largestChannel_ = 0.0f;
};

/// Density per solid angle of being scattered by an angle; the integral over the sphere is 1.
float henyeyGreenstein(float cosine, float g);
/// A direction with that density about the unit vector `forward`.
vec3 sampleHenyeyGreenstein(const vec3& forward, float g, vec2 u);

}  // namespace trex
