// Where photons of outside sources should start, so that they land where the picture needs light
// [Peter and Pietrek 1998].
//
// A sky or a sun shines on the whole sphere around the scene; of an interior's photons nearly all
// land on the outside of the building. An ImportanceMap knows the marks of importons: camera paths
// that mark the places whose cached light would be read (src/paths/importons.h). Those that leave
// the scene, and photons that land in marked places, teach an EmissionGuide per source where in the
// source's primary sample space (two numbers for the place on the disk, two for the direction)
// wanted photons start, and later photons start there more often. Power is divided by the density,
// and a share of the photons stays uniform, so the mean is right in every state of the guide, and
// powers are bounded.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "src/core/maths.h"
#include "src/crays/ray_scene.h"
#include "src/scene/scene.h"

namespace trex {

/// How often camera paths would read cached light, by place and facing. Immutable once made.
class ImportanceMap {
 public:
  static constexpr std::uint32_t kLooks = 2;  ///< rays towards the outside from each marked place

  /// A place whose cached light an importon would read, and the looks from there that reach the
  /// outside: where their last pieces start, and their directions.
  struct Mark {
    RayStart start{};
    vec3 normal{0.0f};  ///< unit, of the side that is read
    std::array<vec3, kLooks> origin{}, direction{};
    std::uint32_t escapes = 0;
  };

  /// Nothing is wanted anywhere.
  ImportanceMap() = default;
  /// Of all marks in a scene of these bounds; those of each importon after each other.
  ImportanceMap(const Box3f& bounds, std::span<const Mark> marks);

  /// About how many importons visited the cell of a surface point, on the side of `normal`; 0:
  /// nothing there is wanted.
  float visits(const vec3& position, const vec3& normal) const;
  bool empty() const { return fine_.empty(); }

  /// A surface point whose cached light an importon would read.
  struct Reader {
    RayStart start;
    vec3 normal;   ///< unit, of the side that was read
    float visits;  ///< of its cell
  };
  /// A line from a reader to the outside; the unit direction points away from the scene.
  struct Escape {
    vec3 origin, direction;
    float visits;  ///< of the reader's cell
  };
  const std::vector<Reader>& readers() const { return readers_; }
  const std::vector<Escape>& escapes() const { return escapes_; }

 private:
  /// Cells along the largest extent. The mean of both grids counts: fine cells tell near from far,
  /// in coarse ones nothing is missed by chance.
  static constexpr std::uint32_t kFine = 64, kCoarse = 16;
  std::uint32_t cell(const vec3& position, const vec3& normal, std::uint32_t cells) const;

  vec3 lower_{0.0f};
  float perMetre_ = 0.0f;                     ///< one over the largest extent
  std::vector<std::uint16_t> fine_, coarse_;  ///< visits, cells^3 x six directions of the normal
  std::vector<Reader> readers_;
  std::vector<Escape> escapes_;
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
  /// importance; one that lands more than once is told again before the next one.
  void learn(const vec4& primary, float density, float value);
  /// Before any photon: a place where wanted photons would start. The sum of weights of hints in a
  /// region is in proportion to what photons would give there, value^2 / density.
  void hint(const vec4& primary, float weight);
  /// A place that leads where light is wanted, whether or not it arrives. Spread evenly over all
  /// such places these see to it that no photon of theirs is left to the uniform share, whose few
  /// carry much.
  void hintWide(const vec4& primary);
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
    double moment;  ///< sum over its points
    std::array<std::uint8_t, 4> cuts;
  };
  int chooseCut(const Node& node) const;
  void cut(const Node& node, int axis, std::vector<Node>& open);
  double sumMoments(std::uint32_t first, std::uint32_t last) const;

  int dimensions_;
  std::vector<Point> hints_, learnt_, wide_;
  std::vector<Point> points_;  ///< all in one unit, while the tree is built
  std::size_t built_ = 0;      ///< points that the leaves know
  std::vector<Leaf> leaves_;
  std::vector<double> cumulative_;  ///< chances of the leaves up to and with each
};

}  // namespace trex
