// Where photons of outside sources should start, so that they land where the picture needs light
// [Peter and Pietrek 1998].
//
// A sky or a sun shines on the whole sphere around the scene; of an interior's photons nearly all
// land on the outside of the building. An ImportanceMap marks the places whose cached light camera
// paths would read. Photons that land there teach an EmissionGuide per source where in the source's
// primary sample space (two numbers of direction, two of the place on the disk) they came from, and
// later photons start there more often. Power is divided by the density, and a share of the photons
// stays uniform, so the mean is right in every state of the guide, and powers are bounded.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "src/core/maths.h"
#include "src/crays/ray_scene.h"
#include "src/scene/scene.h"

namespace trex {

class CameraRays;

/// How often camera paths would read cached light, by place and facing. Immutable once made.
class ImportanceMap {
 public:
  /// Nothing is wanted anywhere.
  ImportanceMap() = default;
  /// Traces `paths` camera paths, their numbers fixed by `seed`, over a picture of width x height,
  /// and notes the surfaces that diffuse bounces find. Deterministic for any number of threads
  /// (oneTBB).
  ImportanceMap(const Scene& scene, const RayScene& rays, const CameraRays& camera,
                std::uint32_t width, std::uint32_t height, std::uint32_t seed,
                std::uint32_t paths = 8192);

  /// Visits of the cell of a surface point, on the side of `normal`; 0: nothing there is wanted.
  float visits(const vec3& position, const vec3& normal) const;
  bool empty() const { return visits_.empty(); }

 private:
  static constexpr std::uint32_t kCells = 48;  ///< along the largest extent
  std::uint32_t cell(const vec3& position, const vec3& normal) const;

  vec3 lower_{0.0f};
  float perMetre_ = 0.0f;
  std::vector<std::uint16_t> visits_;  ///< kCells^3 x six directions of the normal
};

/// A density over the unit square (a sun) or hypercube of four dimensions (a sky): leaves of a k-d
/// tree over the wanted photons found so far. Reading is thread safe while nobody learns.
class EmissionGuide {
 public:
  /// Share of the uniform density in the mixture; 1 / kUniformShare bounds what powers grow by.
  static constexpr float kUniformShare = 0.3f;

  /// `dimensions`: 4, 2, or 0 for a source that is not guided.
  explicit EmissionGuide(int dimensions) : dimensions_(dimensions) {}

  int dimensions() const { return dimensions_; }
  /// Moves a uniform point of primary space so that points follow the guide. `choice` in [0, 1) is
  /// one more random number. Returns the density at the new point, uniform being 1; >=
  /// kUniformShare.
  float warp(float choice, vec4& primary) const;

  /// A photon started at `primary` with this density and landed where `value` (> 0) is its
  /// importance.
  void learn(const vec4& primary, float density, float value);
  /// Brings the density up to date, if much was learnt since the last time.
  void update();
  std::size_t leafCount() const { return leaves_.size(); }

 private:
  struct Point {
    vec4 primary;
    float moment;  ///< value^2 over density: sums estimate integrals over primary space
  };
  struct Leaf {
    vec4 lower, size;
    float density;
  };
  /// A box of primary space while the tree is built: points first .. last - 1.
  struct Node {
    std::uint32_t first, last;
    vec4 lower, size;
    double moment;        ///< sum over its points
    double parentMoment;  ///< of the box it was cut from
    std::array<std::uint8_t, 4> cuts;
  };
  int chooseCut(const Node& node) const;
  void cut(const Node& node, int axis, std::vector<Node>& open);
  double sumMoments(std::uint32_t first, std::uint32_t last) const;

  int dimensions_;
  std::vector<Point> points_;
  std::size_t built_ = 0;  ///< points that the leaves know
  std::vector<Leaf> leaves_;
  std::vector<double> cumulative_;  ///< chances of the leaves up to and with each
};

}  // namespace trex
