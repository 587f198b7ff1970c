// Light that glass lets pass straight on: thin sheets, and panes whose two faces are parallel.
//
// A path that nothing but smooth transmission has touched, that ends in the medium where it began
// and in the direction in which it began, is straight. Light sampling finds it, so that sun, point
// and spot lights shine through windows, and paths that meet a lamp or the sky that way are weighed
// against light sampling. All other chains of mirrors and glass bend light: caustics.h finds those
// of point-like lights, and paths find those of lamps and skies. ClearPath is what tells the two
// apart on every side, so that nothing is counted twice or lost.
#pragma once

#include <vector>

#include "src/core/maths.h"
#include "src/crays/bsdf.h"
#include "src/crays/ray_scene.h"

namespace trex {

/// What refraction has done to a path since it left a surface or a light. Distances are metres.
class ClearPath {
 public:
  /// Largest angle between first and last direction of a straight path, radian.
  static constexpr float kStraight = 1e-3f;

  /// From the first refraction on; `direction` is that before it, `length` the way to it.
  void begin(const vec3& direction, float length);
  bool begun() const { return begun_; }
  const vec3& direction() const { return direction_; }
  /// A stretch between two surfaces.
  void advance(float length);
  /// A smooth face with this normal (either side) and index of the far side over the near one.
  void refract(const vec3& normal, float eta, const vec3& after);
  /// Whether the path is straight if it ends with this direction; so it is if it has not begun.
  bool straight(const vec3& last) const;
  /// Area across the end of the path per solid angle about its start, m^2/sr: distance^2 if nothing
  /// refracts. Each stretch counts with its length over its index, and in the plane of incidence
  /// cos^2 outside over cos^2 inside times as much. Right for straight paths only.
  float spread() const { return std::abs(xx_ * yy_ - xy_ * xy_); }

 private:
  vec3 direction_{0.0f};
  vec2 axis_{1.0f, 0.0f};                    ///< of the plane of incidence, across direction_
  float index_ = 1.0f;                       ///< of where the path is, over that of its start
  float stretch_ = 1.0f;                     ///< cos^2 outside over cos^2 here
  float xx_ = 0.0f, xy_ = 0.0f, yy_ = 0.0f;  ///< metres a radian, across direction_
  bool begun_ = false;
};

struct WaitingRay;

/// How light that was sampled reaches a point.
struct LightConnection {
  vec3 passed{0.0f};       ///< share that arrives, by colour; 0: none
  vec3 direction{0.0f};    ///< in which it leaves the point: refraction moves it a little
  float focus = 1.0f;      ///< irradiance over that of the straight line of the same length
  bool refracted = false;  ///< direction and focus differ from those of the straight line
  bool reaches() const { return passed != vec3(0.0f); }
};

/// A ray that goes through clear layers.
struct ClearWalk {
  RayStart start;  ///< of its last piece
  vec3 direction;
  vec3 absorption{0.0f};  ///< there, 1/m
  vec3 passed{1.0f};      ///< share of light, by colour
  vec3 glass{1.0f};       ///< of it, what glass takes that voxels leave out
  float length = 0.0f;    ///< metres, of all pieces but an endless last one
  int layers = 0;         ///< met so far
  ClearPath path{};
  bool blocked = false;

  void advance(float metres) {
    if (path.begun()) path.advance(metres);
    length += metres;
    if (absorption != vec3(0.0f)) passed *= glm::exp(-absorption * metres);
  }
};

/// A connection as far as it is known, where rays wait for pages: plain data.
struct WaitingConnection {
  enum class Stage : std::uint8_t {
    kStraight,  ///< the straight line is looked at
    kBends,     ///< whether glass is on it, as something else is in the way
    kAims,      ///< the way through that is looked for
    kFound,
  };
  Stage stage = Stage::kStraight;
  bool walking = false;     ///< `walk` has begun
  std::uint8_t turn = 0;    ///< aims so far
  ClearWalk walk{};         ///< of the present aim
  LightConnection found{};  ///< the answer
  dvec3 goal{0.0};          ///< where the aim is put
};

/// Follows shadow rays through what lets light pass: layers by their alpha, and clear glass.
/// Immutable, so thread safe.
class ClearLayers {
 public:
  static constexpr int kMost = 1024;  ///< layers that one ray may pass

  ClearLayers(const Scene& scene, const RayScene& rays);

  /// Whether there is glass that voxels leave out, and which materials are.
  bool glass() const { return anyGlass_; }
  bool isGlass(std::uint32_t material) const { return glass_[material] != 0; }
  /// Whether smooth transmission at a surface counts as clear. Half a refraction does not: the rest
  /// of the light would go another way.
  static bool clear(const Bsdf& bsdf) { return !bsdf.refracts() || bsdf.coverage() >= 1.0f; }

  /// Light from the end (infinite: from that direction) that reaches the start. Where the end has a
  /// point the ray runs towards that; `direction` is about the same. `absorption`, 1/m: of the
  /// volume the start lies in.
  LightConnection connect(const RayStart& start, const vec3& direction,
                          const RayEnd& end = kInfinity, const vec3& absorption = vec3(0.0f)) const;
  /// The same, as far as the pages that are there go: see RayScene::intersectHere(). True once
  /// `way.found` is the answer; else `ray` waits, and the same is to be asked again. Both begin
  /// with all values at their defaults.
  bool connectHere(const RayStart& start, const vec3& direction, const RayEnd& end,
                   const vec3& absorption, WaitingRay& ray, WaitingConnection& way) const;
  /// Whether connect() is a matter of occluded() alone, since nothing lets light pass: then its
  /// answer is none, or unblocked().
  bool blockOnly() const { return !any_ && !anyBends_; }
  static bool blockOnly(const Scene& scene);
  static LightConnection unblocked(const vec3& direction, const RayEnd& end,
                                   const vec3& absorption);
  /// A single ray, up to where it comes closest to the end's point, or without end.
  ClearWalk walk(const RayStart& start, const vec3& direction, const RayEnd& end,
                 const vec3& absorption = vec3(0.0f)) const;
  /// What the next piece of such a ray meets, if anything before `end`. False if it waits for a
  /// page (see RayScene::meetHere()), with `waits`; null: nothing waits.
  bool meet(const ClearWalk& walk, const RayEnd& end, WaitingRay* waits, RayHit& hit,
            bool& met) const;
  /// Takes a ray through a surface it has met, as seen by it. False if nothing passes.
  bool pass(const Surface& surface, const Bsdf& bsdf, ClearWalk& walk) const;
  bool pass(const Surface& surface, ClearWalk& walk) const;

 private:
  void findBends();
  bool mayMeetBends(const RayStart& start, const vec3& direction, const RayEnd& end) const;
  bool meetsBends(const RayStart& start, const vec3& direction, const RayEnd& end) const;
  bool follow(ClearWalk& walk, const RayEnd& end, WaitingRay* waits) const;
  bool aim(const RayStart& start, const vec3& direction, const RayEnd& end, const vec3& absorption,
           WaitingRay* waits, WaitingConnection& way) const;
  bool takeAim(const RayStart& start, const vec3& direction, const RayEnd& light,
               WaitingConnection& way) const;

  const Scene& scene_;
  const RayScene& rays_;
  std::vector<std::uint8_t> glass_;  ///< by material; of passages_ those that are glass
  std::vector<hccm::Passage> passages_;
  std::vector<hccm::Passage> bends_;  ///< by material: what refracts blocks, all else is absent
  Box3f bendBox_;                     ///< render space; of all that refracts...
  std::vector<Box3f> bendBoxes_;      ///< ...and of its parts
  bool any_ = false, anyGlass_ = false, anyBends_ = false;
};

}  // namespace trex
