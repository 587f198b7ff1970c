#include "src/paths/importons.h"

#include "src/crays/bsdf.h"
#include "src/crays/clear_path.h"
#include "src/crays/microfacet.h"
#include "src/paths/walk_tracer.h"

namespace trex {
namespace {

constexpr int kImportonBounces = 32;  // of an importon, mirrors included
constexpr std::uint32_t kMarks = 3;   // diffuse bounces of an importon
constexpr int kLookLayers = 8;        // of glass or leaves that a look may pass

using Mark = ImportanceMap::Mark;

/// A camera path. At a mark it stops, to look for the outside: the ray is then that of a look.
struct Importon : Walk {
  int bounces = 0;
  bool scattered = false;                      ///< light cached at the next surface would be read
  std::uint32_t look = ImportanceMap::kLooks;  ///< of the present mark; that many: none
  int layers = 0;                              ///< that the look has passed
  Mark mark{};
  Surface surface{};    ///< of the mark
  vec3 outgoing{0.0f};  ///< where it was seen from
};

struct Importons {
  using State = Importon;
  static constexpr bool kAnyHit = false;
  using Found = Mark;

  const Scene& scene;
  const CameraRays& camera;
  float width, height;
  std::uint32_t seed;

  Sampler sampler(std::uint32_t walk) const { return Sampler(0x696d706fu, walk, seed); }
  bool begin(Importon& walk, Sampler& sampler) const;
  void await(const Surface& surface) const { prefetchTextures(scene, surface); }
  bool advance(Importon& walk, Sampler& sampler, const WalkEnd& end,
               WalkFindings<Mark>& marks) const;

 private:
  static bool goesOn(Importon& walk) {
    return ++walk.bounces < kImportonBounces && walk.found < kMarks;
  }
  bool meet(Importon& walk, Sampler& sampler, const Surface& surface) const;
  bool beginLook(Importon& walk, Sampler& sampler) const;
  bool passLayer(Importon& walk, Sampler& sampler, const Surface& surface) const;
  bool scatter(Importon& walk, Sampler& sampler, const Surface& surface, const Bsdf& bsdf) const;
};

bool Importons::begin(Importon& walk, Sampler& sampler) const {
  const vec2 place = sampler.next2D();
  camera.ray(place.x * width, place.y * height, walk.start.position, walk.direction);
  return true;
}

bool Importons::advance(Importon& walk, Sampler& sampler, const WalkEnd& end,
                        WalkFindings<Mark>& marks) const {
  if (walk.look == ImportanceMap::kLooks) return end.met() && meet(walk, sampler, end.surface);
  if (end.met() && passLayer(walk, sampler, end.surface)) return true;
  if (end.kind == WalkEnd::Kind::kNothing) {  // the outside
    walk.mark.origin[walk.mark.escapes] = vec3(walk.start.position);
    walk.mark.direction[walk.mark.escapes++] = walk.direction;
  }
  if (++walk.look < ImportanceMap::kLooks) return beginLook(walk, sampler);
  marks.add(walk, walk.mark);
  return scatter(walk, sampler, walk.surface, Bsdf(scene, walk.surface, walk.outgoing));
}

/// The next surface of the path. False if it ends there.
bool Importons::meet(Importon& walk, Sampler& sampler, const Surface& surface) const {
  const Bsdf bsdf(scene, surface, -walk.direction);
  if (bsdf.unlit()) return false;
  if (bsdf.coverage() < 1.0f && sampler.next1D() >= bsdf.coverage()) {
    walk.start = surface.leave();
    return goesOn(walk);
  }
  if (!walk.scattered || !bsdf.cacheable()) return scatter(walk, sampler, surface, bsdf);
  walk.mark = Mark{.start = surface.leave(), .normal = bsdf.geometricNormal()};
  walk.surface = surface;
  walk.outgoing = -walk.direction;
  walk.look = 0;
  return beginLook(walk, sampler);
}

bool Importons::beginLook(Importon& walk, Sampler& sampler) const {
  walk.layers = 0;
  walk.start = walk.mark.start;
  walk.direction = Basis(walk.mark.normal).toWorld(cosineSample(sampler.next2D()));
  return true;
}

/// A look goes on through clear layers. False if it ends there.
bool Importons::passLayer(Importon& walk, Sampler& sampler, const Surface& surface) const {
  const Bsdf bsdf(scene, surface, -walk.direction);
  if (bsdf.unlit()) return false;
  if (bsdf.coverage() >= 1.0f || sampler.next1D() < bsdf.coverage()) {
    BsdfSample next;
    if (!bsdf.onlyDelta() || !bsdf.sample(sampler, next)) return false;
    walk.leave(surface, next.direction, bsdf.leavesFront(next.direction));
  } else {
    walk.start = surface.leave();
  }
  return ++walk.layers < kLookLayers;
}

/// The path leaves a surface. False if it ends there.
bool Importons::scatter(Importon& walk, Sampler& sampler, const Surface& surface,
                        const Bsdf& bsdf) const {
  BsdfSample next;
  if (!bsdf.sample(sampler, next)) return false;
  if (!(sampler.next1D() < maxComponent(next.weight * next.etaSquared))) return false;
  if (!next.delta || !next.transmitted) walk.scattered = !next.delta;
  walk.leave(surface, next.direction, bsdf.leavesFront(next.direction));
  return goesOn(walk);
}

/// Rays from readers towards a sun.
struct SunRays {
  using State = Walk;
  using Found = FindsNothing;
  static constexpr bool kAnyHit = true;

  const std::vector<ImportanceMap::Reader>& readers;
  vec3 towards;                    ///< it shines
  std::vector<std::uint8_t>& lit;  ///< by reader

  static Sampler sampler(std::uint32_t walk) { return Sampler(0, walk, 0); }
  static void await(const Surface&) {}
  bool begin(Walk& walk, Sampler&) const {
    walk.start = readers[walk.number].start;
    walk.direction = -towards;
    return glm::dot(readers[walk.number].normal, towards) < 0.0f;
  }
  bool advance(Walk& walk, Sampler&, const WalkEnd& end, WalkFindings<FindsNothing>&) const {
    lit[walk.number] = !end.met();
    return false;
  }
};

/// The same where glass or alpha may be on the way: ClearLayers::connect() of what is endless, as
/// walks.
struct ClearSunRays {
  struct State : Walk {
    ClearWalk clear{};
  };
  using Found = FindsNothing;
  static constexpr bool kAnyHit = false;

  const ClearLayers& layers;
  SunRays suns;

  static Sampler sampler(std::uint32_t walk) { return SunRays::sampler(walk); }
  static void await(const Surface&) {}
  bool begin(State& walk, Sampler& sampler) const {
    if (!suns.begin(walk, sampler)) return false;
    walk.clear = {.start = walk.start, .direction = walk.direction};
    return true;
  }
  bool advance(State& walk, Sampler&, const WalkEnd& end, WalkFindings<FindsNothing>&) const {
    if (!end.met()) {
      suns.lit[walk.number] = walk.clear.path.straight(walk.direction);
      return false;
    }
    walk.clear.advance(end.distance);
    if (++walk.clear.layers == ClearLayers::kMost || !layers.pass(end.surface, walk.clear))
      return false;
    walk.start = walk.clear.start;
    walk.direction = walk.clear.direction;
    return true;
  }
};

}  // namespace

ImportanceMap traceImportons(const Scene& scene, const WalkTracer& walks, const CameraRays& camera,
                             std::uint32_t width, std::uint32_t height, std::uint32_t seed,
                             std::uint32_t paths) {
  const Box3f bounds = walks.rays().bounds();
  if (bounds.empty()) return {};
  const Importons importons{scene, camera, static_cast<float>(width), static_cast<float>(height),
                            seed};
  std::vector<Mark> marks;
  walks.follow(importons, paths, marks);
  return ImportanceMap(bounds, marks);
}

void hintGuides(const Scene& scene, const WalkTracer& walks, const LightSet& lights,
                const ImportanceMap& importance, std::span<EmissionGuide> guides) {
  const ClearLayers layers(scene, walks.rays());
  const std::vector<ImportanceMap::Reader>& readers = importance.readers();
  const auto seers = [&](const vec3& towards) {
    std::vector<std::uint8_t> lit(readers.size(), 0);
    const auto count = static_cast<std::uint32_t>(readers.size());
    const SunRays suns{readers, towards, lit};
    if (layers.blockOnly()) {
      walks.follow(suns, count);
    } else {
      walks.follow(ClearSunRays{layers, suns}, count);
    }
    return lit;
  };
  lights.hint(importance, seers, guides);
}

}  // namespace trex
