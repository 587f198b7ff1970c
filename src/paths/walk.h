// Walks: paths of photons, importons and probes, as data. Each is a small record in an array, and
// all that happens to it happens at the ends of its rays, so that rays of many walks are traced
// together, and a walk can wait for a page (walk_tracer.h). What a walk finds depends on its number
// alone.
#pragma once

#include <algorithm>
#include <concepts>
#include <cstdint>
#include <new>
#include <span>
#include <type_traits>
#include <vector>

#include "src/core/sampler.h"
#include "src/crays/ray_scene.h"

namespace trex {

/// What every walk knows between two rays. A kind of walk adds what it needs.
struct Walk {
  RayStart start{};       ///< of the next ray
  vec3 direction{0.0f};   ///< unit
  float end = kInfinity;  ///< of the ray, metres
  RayExit exit{};         ///< where the ray starts, if that must be asked first
  std::uint32_t number = 0;
  std::uint32_t found = 0;  ///< findings so far

  /// Goes on from a surface that has scattered it. The start is known once its exit is.
  void leave(const Surface& surface, const vec3& next, bool front) {
    start = surface.leave();
    exit = RayScene::exit(surface, next, front);
    direction = next;
  }
  RayQuery query() const { return {start, direction, 0.0f, end}; }
};

/// What has become of a ray.
struct WalkEnd {
  enum class Kind : std::uint8_t {
    kHit,
    kNothing,  ///< it met nothing as far as it went
    kClosed,   ///< it could not leave its triangle
  };
  Kind kind = Kind::kNothing;
  float distance = 0.0f;  ///< of kHit this and the surface, unless of any hit
  Surface surface{};

  /// Of a hit. The surface is made in its place: a copy takes a hundredth of a photon.
  void take(const RayScene& rays, const RayHit& hit) {
    distance = hit.t;
    ::new (static_cast<void*>(&surface)) Surface(rays.surface(hit));
  }
  bool met() const { return kind == Kind::kHit; }
  bool closed() const { return kind == Kind::kClosed; }
};

/// What walks find, with the number of the walk and that of the finding, since they come in any
/// order.
template <typename T>
class WalkFindings {
 public:
  static std::uint64_t bytesOfOne() { return sizeof(Entry); }
  void add(Walk& walk, const T& what) { all_.push_back({walk.number, walk.found++, what}); }
  /// Appends the findings of walks first ... first + count - 1, which all are in `parts`, by walk,
  /// those of a walk in its order.
  static void inOrder(std::span<const WalkFindings> parts, std::uint32_t first, std::uint32_t count,
                      std::vector<T>& out) {
    if (std::ranges::all_of(parts, [](const WalkFindings& part) { return part.all_.empty(); }))
      return;
    std::vector<std::size_t> places(count + std::size_t{1}, 0);
    for (const WalkFindings& part : parts) {
      for (const Entry& e : part.all_) ++places[e.walk - first + 1];
    }
    places[0] = out.size();
    for (std::size_t i = 0; i < count; ++i) places[i + 1] += places[i];
    out.resize(places[count]);
    for (const WalkFindings& part : parts) {
      for (const Entry& e : part.all_) out[places[e.walk - first] + e.place] = e.what;
    }
  }

 private:
  struct Entry {
    std::uint32_t walk, place;
    T what;
  };
  std::vector<Entry> all_;
};

/// Of walks that leave what they find elsewhere, by their number.
struct FindsNothing {};

/// A kind of walk. Its functions are thread safe, and trace no rays.
///
///   kAnyHit    whether its rays ask for anything that is there, and not for the nearest
///   State      a Walk and more; plain data
///   Found      what it finds on its way, or FindsNothing
///   sampler()  the random numbers of a walk
///   begin()    makes its first ray; `walk.number` is set. False if there is none
///   await()    asks for what advance() will read of a surface from memory
///   advance()  what happens at the end of a ray; makes the next one. False if the walk ends there
///
/// One that has `plain`, PlainSurfaces, has plain surfaces shaded in lanes. Where walks go in waves
/// advance() of these is in two parts, as its random numbers go to lanes in between:
///
///   arrivePlain()   what happens before Bsdf::sample(), and
///   scatterPlain()  after it. False if the walk ends there
template <typename Kind>
concept WalkKind = std::derived_from<typename Kind::State, Walk> &&
    std::is_trivially_destructible_v<typename Kind::State> &&
    std::same_as<decltype(Kind::kAnyHit), const bool> &&
    requires(const Kind& kind, typename Kind::State& walk, Sampler& sampler, const WalkEnd& end,
             WalkFindings<typename Kind::Found>& found) {
  { kind.sampler(std::uint32_t{}) } -> std::same_as<Sampler>;
  kind.await(end.surface);
  { kind.begin(walk, sampler) } -> std::same_as<bool>;
  { kind.advance(walk, sampler, end, found) } -> std::same_as<bool>;
};

}  // namespace trex
