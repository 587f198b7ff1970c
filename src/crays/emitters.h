// The triangles of a scene that shine, as rays meet them: what each sends out (texture, coverage
// and vertex colours included), and places on them chosen in proportion to it.
//
// A triangle's power is the mean of emission times coverage over its samples, as close as the
// texels of its footprint where there are not too many. A triangle that holds a picture is divided
// into up to 4^8 congruent ones that are chosen by what they send out. A triangle that sends out
// nothing at any sample is left out: rays that find light there by chance have it for themselves.
// Of triangles that lie in one place, as exporters double them, and send out the same, one shines:
// rays see no more of them.
#pragma once

#include <cstdint>
#include <unordered_map>
#include <vector>

#include "src/core/maths.h"
#include "src/crays/ray_scene.h"
#include "src/scene/scene.h"

namespace trex {

/// Immutable, so thread safe.
class Emitters {
 public:
  static constexpr std::uint32_t kNotFound = 0xffffffffu;

  struct Triangle {
    dvec3 corner;           ///< render space, metres
    vec3 edge1, edge2;      ///< to the second and third corner of the hit's triangle
    vec3 normal;            ///< unit, of the front
    float area = 0.0f;      ///< m^2
    float radiance = 0.0f;  ///< mean luminance of what it sends out, of one side
    std::uint32_t material = 0, lamp = 0;
    std::uint32_t instance = 0, cluster = 0, triangle = 0;  ///< as in hits
    std::uint32_t cells = kNotFound;                        ///< into cells_, if it holds a picture
    std::uint32_t edgeCells = 1;                            ///< along an edge
  };
  /// A point of a triangle.
  struct Place {
    dvec3 position{0.0};
    vec3 radiance{0.0f};   ///< what is sent out, coverage included
    float density = 0.0f;  ///< of choosing it on its triangle, per square metre
  };

  /// Scene and rays must outlive it; what `rays` hides does not shine. Of a mesh in pages those are
  /// read that overlap a shining mesh of the scene. Throws Error(kInput) if a page can't be read.
  Emitters(const Scene& scene, const RayScene& rays);

  const std::vector<Triangle>& triangles() const { return triangles_; }
  bool shinesBack(const Triangle& t) const { return lamps_[t.lamp].shinesBack; }
  /// Area of all triangles of the same object and material, m^2.
  float lampArea(const Triangle& t) const { return lamps_[t.lamp].area; }
  /// Number of the triangle that a ray met; kNotFound if it isn't one of these.
  std::uint32_t find(const RayHit& hit) const;
  /// A place in proportion to what is sent out there, about; u in [0, 1)^2.
  Place sample(const Triangle& triangle, double u, float v) const;
  /// The density of that at a hit's weights of the second and third corner.
  float density(const Triangle& triangle, float u, float v) const;
  /// The largest channel of radiance over the luminance that a place is chosen by, about.
  float largestRatio() const { return largestRatio_; }
  std::uint64_t bytes() const;

 private:
  /// The triangles of one object and material: what a sample of any of them asks for.
  struct Lamp {
    vec3 emission;
    float area = 0.0f;       ///< m^2
    bool plain, shinesBack;  ///< plain: all of it sends out the same
  };
  struct Run;
  struct Budget;
  struct Measured;
  class Places;

  bool shines(std::uint32_t material) const;
  std::vector<Run> runs() const;
  void addPages(std::vector<Run>& out) const;
  std::vector<Measured> measureRun(const Run& run, const Budget& budget) const;
  bool measure(const RayHit& corner, const Budget& budget, Measured& out) const;
  void measurePicture(const Surface (&corner)[3], const Budget& budget, Measured& out) const;
  void add(const Run& run, std::vector<Measured>& measured, Places& places);

  const Scene& scene_;
  const RayScene& rays_;
  std::vector<Triangle> triangles_;
  std::vector<float> cells_;  ///< cumulative shares, cell by cell, of each picture
  std::vector<Lamp> lamps_;
  std::unordered_map<std::uint64_t, std::uint32_t> lampOf_;  ///< object and material to lamps_
  struct Slots {
    std::size_t first;  ///< in slots_
    std::uint32_t count;
  };
  std::unordered_map<std::uint64_t, Slots> clusters_;  ///< by instance and cluster
  std::vector<std::uint32_t> slots_;                   ///< by triangle of a cluster
  float largestRatio_ = 1.0f;
};

}  // namespace trex
