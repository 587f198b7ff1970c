// Caustics of point-like lights: light of a sun, a point or a spot that mirrors and glass, smooth
// or nearly so, have bent before it meets a surface that scatters. Neither light sampling nor the
// eye's rays find such paths well or at all, so photons do: a density of photons around the point,
// over a radius that shrinks from map to map, so that the mean over the samples of a pixel
// converges [Hachisuka et al. 2008; Knaus and Zwicker 2011, whose passes need nothing of each
// other].
//
// What light sampling finds is left out: straight ways (clear_path.h), and sharp lobes that are
// seen before any broad one, which show the light itself. With S for deltas and lobes of an alpha
// up to kSharpAlpha, B for broad ones, L for the light and E for the eye: photons find L S+ B,
// paths E S* B and all that follows; of E S+ L, paths find what has a sharp lobe next to the light,
// photons what has deltas there. A scene without point-like lights, or without such mirrors and
// glass, has no object of these classes.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <span>
#include <unordered_map>
#include <vector>

#include "src/crays/bsdf.h"
#include "src/crays/photon_guide.h"

namespace trex {

class WalkTracer;

/// A photon where a surface scatters it.
struct CausticPhoton {
  vec3 position, normal;  ///< normal: geometric, unit
  vec3 towards;           ///< unit, where it came from
  vec3 power;             ///< W, over the number of photons of its map
  bool blurred;           ///< by a sharp lobe that is no delta
  std::uint16_t turns;    ///< with that where it is seen, as Scene::maxBounces counts
  float way;              ///< metres from where it was last bent
};

/// Whether a surface that light comes to is one where photons land; `blurred` as of a photon.
inline bool landsOn(const Bsdf& bsdf, bool blurred) {
  return blurred ? bsdf.hasBroad() : !bsdf.onlyDelta();
}

/// How wide the first densities are taken, by place: so that there are some photons in each. Made
/// of photons that no map has. Immutable, so thread safe.
class CausticWidths {
 public:
  /// Of halves: the narrowest is some 50 times the rounding of a place in the scene.
  static constexpr std::uint32_t kLevels = 15;

  /// `scene`: radius of the sphere around it, metres. `wanted`: of these photons, in a width.
  CausticWidths(std::span<const CausticPhoton> photons, float scene, double wanted);
  /// The width for a photon is radius(level). `u`, [0, 1)^2, moves the place where they are counted
  /// along the surface, so that widths change from place to place without seams.
  std::uint32_t level(const CausticPhoton& photon, vec2 u) const;
  float radius(std::uint32_t level) const;
  /// The widest whose radius is no more than this, if any is, else the narrowest.
  std::uint32_t levelWithin(float most) const;

 private:
  std::uint64_t key(const vec3& position, std::uint32_t level) const;
  /// Of photons, in the square around a disk that has enough.
  double leastInCell() const { return wanted_ * (4.0 / kPi); }

  float scene_;
  double wanted_;
  std::array<std::unordered_map<std::uint64_t, std::uint32_t>, kLevels> counts_;
};

/// A Lambertian surface as Bsdf has it, without the rest of one.
struct MatteSurface {
  vec3 diffuse;
  vec3 normal;                ///< for shading, on the side of the eye
  vec3 facing, smoothNormal;  ///< geometric and smooth one there, whose horizons count

  /// As Bsdf::evaluate().
  vec3 evaluate(const vec3& incoming) const {
    const float up = glm::dot(incoming, normal);
    const bool lit =
        up > 0.0f && (glm::dot(incoming, facing) > 0.0f || glm::dot(incoming, smoothNormal) > 0.0f);
    return lit ? diffuse * (kInvPi * up) : vec3(0.0f);
  }
};

/// Photons of one map, by place. Immutable, so thread safe.
class CausticMap {
 public:
  /// Each photon is spread over a disk of the width at its place times `shrink`, or of a smaller
  /// one by chance where the disk hangs over edges, as far as there are surfaces in it.
  CausticMap(const Scene& scene, std::span<const CausticPhoton> photons,
             const CausticWidths& widths, float shrink, const WalkTracer& walks);
  /// Of the widths of disks those that may reach a place, a bit each: 0 where there is no caustic,
  /// which is most places.
  std::uint32_t near(const vec3& position) const;
  /// Radiance that leaves the surface at a place, `near` of which is known, towards the eye of the
  /// Bsdf by its broad lobes and, if asked for, by sharp ones of light that deltas alone have bent.
  /// Of photons that have turned at most `turns` times.
  vec3 radiance(const vec3& position, std::uint32_t near, const Bsdf& bsdf, bool sharpToo,
                std::uint32_t turns = Scene::kAnyBounces) const;
  vec3 radiance(const vec3& position, std::uint32_t near, const MatteSurface& surface,
                std::uint32_t turns = Scene::kAnyBounces) const;
  std::size_t size() const;

 private:
  /// Photons of one radius. Each stands in all cells, two radii wide, that its disk may reach, so
  /// that a place asks its own cell alone.
  struct Grid {
    struct Entry {
      vec3 position;
      std::uint32_t photon;  ///< its number times 8, and the cell's parity
    };
    std::uint32_t level;
    float radius;
    std::vector<CausticPhoton> photons;
    std::vector<Entry> entries;         ///< by bucket, then by photon
    std::vector<std::uint32_t> firsts;  ///< of each bucket, and the end
    /// Two bits for each of kMarksOfBucket parts of a bucket, where there are buckets for all finer
    /// photons too: whether a cell has photons, and whether finer cells in it have. Few are set.
    std::vector<std::uint64_t> marks;
    static constexpr std::size_t kMarksOfBucket = 16;
    static constexpr std::uint32_t kHere = 1, kFiner = 2;
    Grid(std::uint32_t level, std::vector<CausticPhoton> photons, float radius, std::size_t finer);
    glm::ivec3 cell(const vec3& position) const;
    /// No two cells of a photon have the same.
    static std::uint32_t parity(const glm::ivec3& c) {
      return static_cast<std::uint32_t>((c.x & 1) | (c.y & 1) << 1 | (c.z & 1) << 2);
    }
    /// Its low bits are the bucket.
    static std::uint32_t hash(const glm::ivec3& cell);
    std::size_t place(const glm::ivec3& cell) const { return hash(cell) & (32 * marks.size() - 1); }
    void mark(const glm::ivec3& cell, std::uint32_t what);
    void markFiner(const Grid& finer);
    std::uint32_t marked(const glm::ivec3& cell) const;
    template <typename Use>
    void forReached(const vec3& position, const Grid& finer, const Use& use) const;
    template <typename Use>
    void forNear(const vec3& position, const Use& use) const;
  };
  /// `scattered`(photon): what of its light, by area across it, goes to the eye.
  template <typename Scattered>
  vec3 radianceOf(const vec3& position, std::uint32_t near, const vec3& normal, std::uint32_t turns,
                  const Scattered& scattered) const;

  std::vector<Grid> grids_;  ///< the finest first; cells lie in those of the next
};

/// Whether a material may have deltas or sharp lobes somewhere.
bool mayBend(const Material& material);

/// Sends photons where mirrors and glass are. Immutable once made, so thread safe.
class CausticLights {
 public:
  /// Scene and tracer must outlive it. Traces some 10^4 photons to find out where light is bent.
  CausticLights(const Scene& scene, const WalkTracer& walks, std::uint32_t seed);
  /// Caustics of photons first .. first + count - 1 of a set, which are spread evenly; the same for
  /// any number of threads. Power is not yet divided by a number of photons.
  std::vector<CausticPhoton> shoot(std::uint32_t set, std::uint64_t first,
                                   std::uint32_t count) const;
  /// Whether any photon made a caustic so far.
  bool any() const { return any_; }
  /// Metres, of the sphere around the scene.
  float sceneRadius() const { return radius_; }

 private:
  struct Source {
    Light light;
    dvec3 position;
    EmissionGuide guide{2};
    double flux = 0.0;  ///< about, of caustics, W
  };
  struct Start;
  struct Photon;
  struct Photons;
  struct PilotPhotons;
  struct MapPhotons;
  vec3 direction(const Source& source, vec2 u) const;
  vec2 place(const Source& source, const vec3& point) const;
  void hint(Source& source, const vec3& point, const vec3& normal, float area) const;
  Start emit(const Source& source, Sampler& sampler) const;
  void pilot(std::uint32_t round);

  const Scene& scene_;
  const WalkTracer& walks_;
  const RayScene& rays_;
  std::uint32_t seed_;
  vec3 centre_{0.0f};
  float radius_ = 1.0f;
  std::vector<Source> sources_;
  std::vector<double> cumulative_;  ///< chances before each source, and 1
  bool any_ = false;
};

/// The maps of a sample. Light at later vertices is spread over the picture by chance anyway, so
/// that a quarter of the photons does.
struct SampleCaustics {
  std::uint32_t sample;
  std::unique_ptr<const CausticMap> seen;   ///< for the first vertex that scatters
  std::unique_ptr<const CausticMap> later;  ///< for those after it
};

/// The maps of a picture: sample number s of every pixel reads maps s, which depend on the scene,
/// the seed, the number of pixels and s alone. All maps have as many photons, so that the cost of a
/// sample does not grow.
class CausticMaps {
 public:
  /// Whether a scene has caustics: point-like lights, and mirrors or glass.
  static bool needed(const Scene& scene);
  /// Costs nothing yet.
  CausticMaps(const Scene& scene, const WalkTracer& walks, std::uint64_t pixels, std::uint32_t seed)
      : scene_(scene), walks_(walks), pixels_(pixels), seed_(seed) {}

  /// Makes the maps of these samples and forgets old ones. Not while find() is called.
  void prepare(std::span<const std::uint32_t> samples);
  /// Those of a prepared sample; null if there is no caustic.
  const SampleCaustics* find(std::uint32_t sample) const;

  std::uint64_t photons() const { return shot_; }
  double seconds() const { return seconds_; }

 private:
  std::uint32_t photonsOfMap() const;
  void start();
  SampleCaustics make(std::uint32_t sample);

  const Scene& scene_;
  const WalkTracer& walks_;
  std::uint64_t pixels_;
  std::uint32_t seed_;
  std::unique_ptr<const CausticLights> lights_;  ///< null until the first map
  std::unique_ptr<const CausticWidths> widths_;
  std::vector<SampleCaustics> maps_;  ///< the latest last
  std::uint64_t shot_ = 0;
  double seconds_ = 0.0;
};

}  // namespace trex
