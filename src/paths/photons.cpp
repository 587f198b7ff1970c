#include "src/paths/photons.h"

#include <tbb/parallel_for.h>

#include <algorithm>

#include "src/crays/bsdf.h"
#include "src/crays/clear_path.h"
#include "src/crays/lights_detail.h"
#include "src/paths/walk_tracer.h"
#include "src/scene/look.h"

namespace trex {
namespace {

struct Photon : Walk {
  vec3 power{0.0f};      ///< W
  float emitted = 0.0f;  ///< its largest channel at the light
  RangeOnTheWay range{kInfinity};
  std::uint32_t source = 0;  ///< this, primary and density as in EmittedPhoton
  vec4 primary{0.0f};
  float density = 1.0f;
  bool scatters = true;      ///< media may scatter it
  std::uint32_t bounce = 0;  ///< ends of rays
  std::uint32_t turns = 0;   ///< as Scene::maxBounces counts; two more follow where it lands
  std::uint32_t held = 0;    ///< landings so far where light is held
};

static_assert(sizeof(Photon) <= 144);

/// Photons go to the first surface that can hold light, or on to all others. They are scattered by
/// media once, before their first surface, as C-rays see it (PathTracer::passMedia); later media
/// just take photons away.
struct Photons {
  using State = Photon;
  static constexpr bool kAnyHit = false;
  using Found = LandedPhoton;

  const Scene& scene;
  const Media* media;  ///< null if there is none
  const LightSet& lights;
  std::span<const EmissionGuide> guides;
  std::uint32_t seed;
  std::uint32_t first;  ///< number of walk 0
  bool allBounces;
  const PlainSurfaces& plain;
  const std::vector<std::uint8_t>& inVoxels;  ///< by material

  Sampler sampler(std::uint32_t walk) const { return Sampler(0x70686f74u, first + walk, seed); }
  bool begin(Photon& photon, Sampler& sampler) const;
  void await(const Surface& surface) const { prefetchTextures(scene, surface); }
  bool advance(Photon& photon, Sampler& sampler, const WalkEnd& end,
               WalkFindings<LandedPhoton>& landed) const;
  bool arrivePlain(Photon& photon, const WalkEnd& end, const PlainAt& at,
                   WalkFindings<LandedPhoton>& landed) const;
  bool scatterPlain(Photon& photon, Sampler& sampler, const Surface& surface, const PlainAt& at,
                    const BsdfSample& next) const;

 private:
  bool meet(Photon& photon, Sampler& sampler, const WalkEnd& end,
            WalkFindings<LandedPhoton>& landed) const;
  bool land(Photon& photon, const Surface& surface, const vec3& normal, bool held,
            WalkFindings<LandedPhoton>& landed) const;
  bool turn(Photon& photon, Sampler& sampler, const Surface& surface, const BsdfSample& next,
            float factor, bool front) const;
};

bool Photons::begin(Photon& photon, Sampler& sampler) const {
  EmittedPhoton at;
  if (!lights.emit(sampler, at, guides)) return false;
  photon.start = at.start;
  photon.direction = at.direction;
  photon.power = at.power;
  photon.emitted = maxComponent(at.power);
  photon.range = RangeOnTheWay(at.range);
  photon.source = at.source;
  photon.primary = at.primary;
  photon.density = at.density;
  photon.scatters = at.scatters;
  return true;
}

/// Scattered by a medium into a new direction, or absorbed: false.
bool scatterInMedium(const MediaCollision& collision, Sampler& sampler, Photon& photon) {
  const float survival = maxComponent(collision.albedo);
  if (!(survival > 0.0f) || sampler.next1D() >= survival) return false;
  photon.power *= collision.albedo / survival;
  photon.start = photon.start.position + dvec3(photon.direction) * double(collision.distance);
  photon.direction =
      sampleHenyeyGreenstein(photon.direction, collision.anisotropy, sampler.next2D());
  photon.range.advance(collision.distance);
  photon.power *= photon.range.end();
  photon.scatters = false;
  ++photon.turns;
  return true;
}

bool Photons::advance(Photon& photon, Sampler& sampler, const WalkEnd& end,
                      WalkFindings<LandedPhoton>& landed) const {
  if (end.closed()) return false;
  MediaCollision collision;
  if (media != nullptr &&
      media->collide(photon.start.position, photon.direction, end.met() ? end.distance : kInfinity,
                     sampler, collision)) {
    if (!photon.scatters || !scatterInMedium(collision, sampler, photon)) return false;
  } else if (!end.met() || !meet(photon, sampler, end, landed)) {
    return false;
  }
  return ++photon.bounce < kPhotonBounces;
}

bool Photons::meet(Photon& photon, Sampler& sampler, const WalkEnd& end,
                   WalkFindings<LandedPhoton>& landed) const {
  photon.range.advance(end.distance);
  const Surface& surface = end.surface;
  const Bsdf bsdf(scene, surface, -photon.direction);
  const bool passes = bsdf.coverage() < 1.0f && sampler.next1D() >= bsdf.coverage();
  const bool held = bsdf.cacheable() && !passes && !bsdf.unlit();
  // The inner side of glass gets what its outer one got, bent and denser.
  const bool inside = bsdf.refracts() && !bsdf.cacheable() &&
                      glm::dot(photon.direction, surface.geometricNormal) > 0.0f;
  if (!inside && !land(photon, surface, bsdf.geometricNormal(), held, landed)) return false;
  if (passes) {
    photon.start = surface.leave();
    return true;
  }
  if (bsdf.unlit()) return false;
  BsdfSample next;
  if (!bsdf.sample(sampler, next)) return false;
  if (!next.delta || !next.transmitted || !ClearLayers::clear(bsdf)) {
    ++photon.turns;
    photon.power *= photon.range.end();
  }
  return turn(photon, sampler, surface, next, bsdf.photonFactor(next.direction),
              bsdf.leavesFront(next.direction));
}

/// False if it ends there.
bool Photons::land(Photon& photon, const Surface& surface, const vec3& normal, bool held,
                   WalkFindings<LandedPhoton>& landed) const {
  if (photon.turns + 2 > scene.maxBounces) return false;
  if (inVoxels[surface.material] == 0 && !held) return true;
  const vec3 power = photon.power * photon.range.factor();
  if (!isFinite(power) || !(maxComponent(power) > 0.0f)) return !held;
  landed.add(photon, {.position = vec3(surface.position),
                      .normal = normal,
                      .power = power,
                      .index = first + photon.number,
                      .source = photon.source,
                      .primary = photon.primary,
                      .density = photon.density,
                      .bounce = photon.held,
                      .turns = photon.turns,
                      .held = held});
  photon.held += held ? 1 : 0;
  return allBounces || !held;
}

/// Goes on in another direction. False if it is absorbed.
bool Photons::turn(Photon& photon, Sampler& sampler, const Surface& surface, const BsdfSample& next,
                   float factor, bool front) const {
  photon.power *= next.weight * (next.etaSquared * factor);
  const float survival = std::min(1.0f, maxComponent(photon.power) / photon.emitted);
  if (!(survival > 0.0f) || sampler.next1D() >= survival) return false;
  photon.power /= survival;
  photon.scatters = false;
  photon.leave(surface, next.direction, front);
  return true;
}

bool Photons::arrivePlain(Photon& photon, const WalkEnd& end, const PlainAt& at,
                          WalkFindings<LandedPhoton>& landed) const {
  photon.range.advance(end.distance);
  return land(photon, end.surface, at.facing(), at.cacheable(), landed);
}

bool Photons::scatterPlain(Photon& photon, Sampler& sampler, const Surface& surface,
                           const PlainAt& at, const BsdfSample& next) const {
  ++photon.turns;
  photon.power *= photon.range.end();
  return turn(photon, sampler, surface, next, at.photonFactor(next.direction),
              at.leavesFront(next.direction)) &&
         ++photon.bounce < kPhotonBounces;
}

}  // namespace

std::optional<std::vector<LandedPhoton>> landPhotons(const Scene& scene, const WalkTracer& walks,
                                                     const LightSet& lights, std::uint32_t seed,
                                                     std::uint64_t first, std::uint64_t count,
                                                     bool allBounces,
                                                     std::span<const EmissionGuide> guides,
                                                     const std::function<bool()>& giveUp) {
  const RayScene& rays = walks.rays();
  // Media scatter photons on their way.
  const PlainSurfaces plain = rays.media() == nullptr && rays.parts().paged == nullptr
                                  ? PlainSurfaces(scene, rays, kClearAlpha)
                                  : PlainSurfaces::none(scene, rays);
  std::vector<std::uint8_t> inVoxels;
  for (const Material& m : scene.materials) inVoxels.push_back(passesLight(m) ? 0 : 1);
  const Photons photons{scene,      rays.media(), lights,
                        guides,     seed,         static_cast<std::uint32_t>(first),
                        allBounces, plain,        inVoxels};
  std::vector<LandedPhoton> landed;
  if (!walks.follow(photons, static_cast<std::uint32_t>(count), landed, giveUp))
    return std::nullopt;
  return landed;
}

std::vector<PhotonLesson> lessonsOf(std::span<const LandedPhoton> landed,
                                    const ImportanceMap& importance,
                                    std::span<const EmissionGuide> guides) {
  std::vector<float> visits(landed.size(), 0.0f);
  tbb::parallel_for(std::size_t{0}, landed.size(), [&](std::size_t i) {
    const LandedPhoton& p = landed[i];
    if (!p.held || p.source >= guides.size() || guides[p.source].dimensions() == 0) return;
    visits[i] = importance.visits(p.position, p.normal);
  });
  std::vector<PhotonLesson> lessons;
  for (std::size_t i = 0; i < landed.size(); ++i) {
    const LandedPhoton& p = landed[i];
    if (visits[i] > 0.0f) lessons.push_back({p.primary, p.density, visits[i], p.source});
  }
  return lessons;
}

void learn(std::span<const PhotonLesson> lessons, std::span<EmissionGuide> guides) {
  for (const PhotonLesson& l : lessons) {
    if (l.source < guides.size()) guides[l.source].learn(l.primary, l.density, l.visits);
  }
  for (EmissionGuide& guide : guides) guide.update();
}

}  // namespace trex
