#include "src/paths/caustics.h"

#include <algorithm>
#include <cmath>

#include "src/crays/clear_path.h"
#include "src/crays/lights_detail.h"
#include "src/crays/microfacet.h"
#include "src/crays/ray_scene_parts.h"
#include "src/paths/walk_tracer.h"

namespace trex {
namespace {

constexpr int kCausticBounces = 64;
constexpr std::uint32_t kPilotRounds = 4, kPilotRound = 1u << 13;
constexpr std::size_t kBends = 4096;         // places on mirrors and glass that lights aim at
constexpr std::size_t kAllHints = 1u << 20;  // of all lights together
constexpr std::uint32_t kBendsOfCluster = 256;
constexpr double kUnknownShare = 0.1;  // of photons, for lights that seem to bend nothing

/// A place on a mirror or glass, for `area` of it.
struct Bend {
  vec3 position, normal;
  float area;
};

/// `count` places spread over a cluster.
void addBends(const hccm::Mesh& mesh, std::uint32_t cluster, const dmat4& toRender,
              std::uint32_t count, std::vector<Bend>& out) {
  std::vector<std::uint32_t> triangles;
  mesh.forTriangles(cluster, [&](std::uint32_t i) { triangles.push_back(i); });
  const std::size_t all = triangles.size();
  for (std::uint32_t i = 0; i < count; ++i) {
    const hccm::Triangle t =
        mesh.triangle(cluster, triangles[count < all ? i * all / count : i % all]);
    dvec3 p[3];
    for (int k = 0; k < 3; ++k) {
      p[k] = dvec3(toRender * glm::dvec4(dvec3(t.position[k]), 1.0));
    }
    const dvec3 normal = glm::cross(p[1] - p[0], p[2] - p[0]);
    const double twice = glm::length(normal);
    if (!(twice > 0.0)) continue;
    const vec2 u = Sampler(cluster, i, 0).next2D();
    const double root = std::sqrt(double(u.x)), v = root * double(u.y);
    out.push_back({vec3(p[0] * (1.0 - root) + p[1] * (root - v) + p[2] * v), vec3(normal / twice),
                   static_cast<float>(0.5 * twice * static_cast<double>(all) / count)});
  }
}

/// Places all over the mirrors and glass of a scene; none of a mesh in pages.
std::vector<Bend> findBends(const Scene& scene, const RayScene& rays) {
  struct Cluster {
    const hccm::Mesh* mesh;
    dmat4 toRender;
    std::uint32_t number;
  };
  const RayScene::Parts& parts = rays.parts();
  std::vector<Cluster> clusters;
  const auto add = [&](const hccm::Mesh& mesh, const dmat4& toRender) {
    for (std::uint32_t c = 0; c < mesh.clusterCount(); ++c) {
      if (mayBend(scene.materials[mesh.clusterMaterial(c)]))
        clusters.push_back({&mesh, toRender, c});
    }
  };
  if (!parts.paged) add(parts.world, dmat4(1.0));
  for (const RayScene::Parts::Placed& p : parts.placed) {
    add(parts.shared[p.mesh], placeOf(scene, parts, p).toRender);
  }
  std::vector<Bend> bends;
  const std::size_t step = clusters.size() / kBends + 1;
  const auto each = static_cast<std::uint32_t>(
      std::clamp<std::size_t>(kBends / (clusters.size() + 1), 1, kBendsOfCluster));
  for (std::size_t i = 0; i < clusters.size(); i += step) {
    addBends(*clusters[i].mesh, clusters[i].number, clusters[i].toRender, each, bends);
  }
  return bends;
}

}  // namespace

bool mayBend(const Material& m) {
  const bool sharp =
      m.metallicRoughnessTexture.present() || m.roughness * m.roughness <= kSharpAlpha;
  return !m.unlit && sharp && (m.metallic > 0.0f || m.specular > 0.0f || m.transmission > 0.0f);
}

/// A photon at its light. `power` is that of the light over the density of the choice.
struct CausticLights::Start {
  dvec3 origin;
  vec3 direction, power;
  vec4 primary;
  float density;
  float range;  ///< of the light, not yet in its power
};

CausticLights::CausticLights(const Scene& scene, const WalkTracer& walks, std::uint32_t seed)
    : scene_(scene), walks_(walks), rays_(walks.rays()), seed_(seed) {
  const Box3f bounds = rays_.bounds();
  if (bounds.empty()) return;
  centre_ = bounds.centre();
  radius_ = std::max(0.5f * glm::length(bounds.size()), 1e-20f);
  for (const Light& light : scene.lights) {
    if (maxComponent(light.intensity) <= 0.0f) continue;
    sources_.push_back({light, light.position - rays_.renderOrigin()});
  }
  const std::vector<Bend> bends = findBends(scene, rays_);
  const std::size_t step = bends.size() * sources_.size() / kAllHints + 1;
  for (Source& source : sources_) {
    for (std::size_t i = 0; i < bends.size(); i += step) {
      hint(source, bends[i].position, bends[i].normal, bends[i].area);
    }
    source.guide.update();
  }
  for (std::uint32_t round = 0; round < kPilotRounds; ++round) pilot(round);
  double flux = 0.0, before = 0.0;
  for (const Source& source : sources_) flux += source.flux;
  any_ = flux > 0.0;
  cumulative_.push_back(0.0);
  for (const Source& source : sources_) {
    const double even = 1.0 / static_cast<double>(sources_.size());
    before += any_ ? kUnknownShare * even + (1.0 - kUnknownShare) * source.flux / flux : even;
    cumulative_.push_back(before);
  }
}

/// Of a point or spot light: about its axis, areas kept.
vec3 CausticLights::direction(const Source& source, vec2 u) const {
  return Basis(source.light.direction).toWorld(coneDirection(source.light, u));
}

/// Where in the light's primary space a photon to `point` starts; outside of [0, 1)^2 if nowhere.
vec2 CausticLights::place(const Source& source, const vec3& point) const {
  const Basis basis(source.light.direction);
  if (source.light.type == Light::Type::kDirectional) {
    const vec3 p = basis.toLocal((point - centre_) / radius_);
    return 0.5f + 0.5f * vec2(p.x, p.y);
  }
  const vec3 d = basis.toLocal(glm::normalize(point - vec3(source.position)));
  const float phi = std::atan2(d.y, d.x) * (0.5f * kInvPi);
  return vec2(coneShare(source.light, d), phi < 0.0f ? phi + 1.0f : phi);
}

/// A place that bends light, by what it takes of the light's primary space.
void CausticLights::hint(Source& source, const vec3& point, const vec3& normal, float area) const {
  const vec2 u = place(source, point);
  if (!(u.x >= 0.0f && u.x < 1.0f && u.y >= 0.0f && u.y < 1.0f)) return;
  vec3 towards = source.light.direction;
  float seen = area;
  if (source.light.type != Light::Type::kDirectional) {
    const vec3 way = point - vec3(source.position);
    const float distance2 = std::max(glm::dot(way, way), 1e-30f);
    towards = way / std::sqrt(distance2);
    seen = area / std::max(distance2, area);
  }
  source.guide.hint(vec4(u, 0.0f, 0.0f),
                    seen * std::max(std::abs(glm::dot(normal, towards)), 0.1f));
}

CausticLights::Start CausticLights::emit(const Source& source, Sampler& sampler) const {
  const Light& light = source.light;
  Start start;
  start.range = light.type == Light::Type::kDirectional ? kInfinity : light.range;
  start.primary = vec4(sampler.next2D(), 0.0f, 0.0f);
  start.density = source.guide.warp(sampler.next1D(), start.primary);
  const vec2 u(start.primary.x, start.primary.y);
  if (light.type == Light::Type::kDirectional) {
    const Basis basis(light.direction);
    const vec2 at = radius_ * (2.0f * u - 1.0f);
    start.direction = light.direction;
    start.origin = dvec3(centre_ + basis.tangent * at.x + basis.bitangent * at.y -
                         light.direction * (radius_ * 1.001f));
    start.power = light.intensity * (4.0f * radius_ * radius_ / start.density);
    return start;
  }
  start.direction = direction(source, u);
  start.origin = source.position;
  if (light.radius > 0.0f) {
    start.origin += dvec3(light.radius * uniformSphere(sampler.next2D()));
  }
  const float solidAngle = 2.0f * kPi * coneVersine(light);
  const float falloff = spotFactor(light, start.direction);
  start.power = light.intensity * (falloff * solidAngle / start.density);
  return start;
}

/// A photon on its way.
struct CausticLights::Photon : Walk {
  vec3 power{0.0f}, absorption{0.0f};  ///< absorption: of the volume there, 1/m
  float most = 0.0f;                   ///< largest channel at the light
  ClearPath clear;
  RangeOnTheWay range{kInfinity};
  bool bent = false, blurred = false;
  float way = 0.0f;         ///< metres since it was bent last
  std::uint32_t turns = 1;  ///< as Scene::maxBounces counts, that where it is seen among them
  int bounces = 0;
};

/// Photons go through mirrors and glass; each surface on the way that scatters as well gets them.
struct CausticLights::Photons {
  using State = Photon;
  static constexpr bool kAnyHit = false;
  const CausticLights& of;

  static bool begin(Photon& photon, const Start& start) {
    photon.start = start.origin;
    photon.direction = start.direction;
    photon.power = start.power;
    photon.most = maxComponent(start.power);
    photon.range = RangeOnTheWay(start.range);
    return photon.most > 0.0f;
  }
  void await(const Surface& surface) const { prefetchTextures(of.scene_, surface); }
  /// Calls land(CausticPhoton) where it lands.
  template <typename Land>
  bool advance(Photon& photon, Sampler& sampler, const WalkEnd& end, const Land& land) const {
    if (!end.met()) return false;
    arrive(photon, end.distance);
    const Surface& surface = end.surface;
    const Bsdf bsdf(of.scene_, surface, -photon.direction);
    if (bsdf.unlit()) return false;
    if (bsdf.coverage() < 1.0f && sampler.next1D() >= bsdf.coverage()) {
      photon.start = surface.leave();
    } else {
      const bool counts = landsOn(bsdf, photon.blurred);
      const bool bent = photon.bent || !photon.clear.straight(photon.direction);
      if (counts && bent && isFinite(photon.power)) {
        land(CausticPhoton{vec3(surface.position), bsdf.geometricNormal(), -photon.direction,
                           photon.power * photon.range.factor(), photon.blurred,
                           static_cast<std::uint16_t>(photon.turns), photon.way});
      }
      if (!scatter(photon, sampler, surface, bsdf)) return false;
    }
    return ++photon.bounces < kCausticBounces && maxComponent(photon.power) > 0.0f;
  }

 private:
  /// What the way to a surface takes.
  void arrive(Photon& photon, float distance) const {
    const Media* const media = of.rays_.media();
    photon.range.advance(distance);
    photon.way += distance;
    if (photon.absorption != vec3(0.0f)) photon.power *= glm::exp(-photon.absorption * distance);
    if (media == nullptr) return;
    photon.power *= media->transmittance(photon.start.position, photon.direction, distance);
  }
  bool scatter(Photon& photon, Sampler& sampler, const Surface& surface, const Bsdf& bsdf) const;
};

bool CausticLights::Photons::scatter(Photon& photon, Sampler& sampler, const Surface& surface,
                                     const Bsdf& bsdf) const {
  BsdfSample next;
  if (!bsdf.sample(sampler, next)) return false;
  if (!next.delta && !bsdf.goesOnSharp(sampler, next)) return false;
  photon.blurred |= !next.delta;
  if (!next.delta || !next.transmitted || !ClearLayers::clear(bsdf)) {
    photon.bent = true;
    photon.way = 0.0f;
    photon.power *= photon.range.end();
    if (++photon.turns > of.scene_.maxBounces) return false;
  } else if (bsdf.refracts()) {
    photon.way = 0.0f;
    if (!photon.clear.begun()) photon.clear.begin(photon.direction, 0.0f);
    photon.clear.refract(bsdf.normal(), bsdf.eta(), next.direction);
  }
  photon.power *= next.weight * (next.etaSquared * bsdf.photonFactor(next.direction));
  const float survival = std::min(1.0f, maxComponent(photon.power) / photon.most);
  if (!(survival > 0.0f) || sampler.next1D() >= survival) return false;
  photon.power /= survival;
  photon.absorption = bsdf.absorptionTowards(next.direction, photon.absorption);
  photon.leave(surface, next.direction, bsdf.leavesFront(next.direction));
  return true;
}

/// Photons of all lights in turn, from which their guides learn.
struct CausticLights::PilotPhotons : Photons {
  using Found = FindsNothing;
  struct Pilot {
    vec4 primary{0.0f};
    float density = 1.0f, flux = 0.0f;
  };
  std::uint32_t round;
  std::vector<Pilot>& pilots;  ///< by walk

  Sampler sampler(std::uint32_t walk) const {
    return Sampler(0x70696c6fu, walk, hashCombine(of.seed_, round));
  }
  bool begin(Photon& photon, Sampler& sampler) const {
    const Start start = of.emit(of.sources_[photon.number % of.sources_.size()], sampler);
    pilots[photon.number] = {start.primary, start.density};
    return Photons::begin(photon, start);
  }
  bool advance(Photon& photon, Sampler& sampler, const WalkEnd& end,
               WalkFindings<FindsNothing>&) const {
    return Photons::advance(photon, sampler, end, [&](const CausticPhoton& landed) {
      pilots[photon.number].flux += luminance(landed.power);
    });
  }
};

void CausticLights::pilot(std::uint32_t round) {
  if (sources_.empty()) return;
  std::vector<PilotPhotons::Pilot> pilots(kPilotRound);
  walks_.follow(PilotPhotons{{*this}, round, pilots}, kPilotRound);
  const double each =
      std::max(1.0, static_cast<double>(kPilotRound) / static_cast<double>(sources_.size()));
  for (std::uint32_t i = 0; i < kPilotRound; ++i) {
    if (pilots[i].flux <= 0.0f) continue;
    Source& source = sources_[i % sources_.size()];
    source.guide.learn(pilots[i].primary, pilots[i].density, 1.0f);
    source.flux += static_cast<double>(pilots[i].flux) / (each * kPilotRounds);
  }
  for (Source& source : sources_) source.guide.update();
}

/// Photons of lights by their flux.
struct CausticLights::MapPhotons : Photons {
  using Found = CausticPhoton;
  std::uint32_t seed, first;

  Sampler sampler(std::uint32_t walk) const { return Sampler(0x63617573u, first + walk, seed); }
  bool begin(Photon& photon, Sampler& sampler) const {
    const std::vector<double>& sums = of.cumulative_;
    const double choice = static_cast<double>(sampler.next1D()) * sums.back();
    const auto at = std::upper_bound(sums.begin() + 1, sums.end() - 1, choice);
    const auto index = static_cast<std::size_t>(at - sums.begin()) - 1;
    Start start = of.emit(of.sources_[index], sampler);
    start.power /= static_cast<float>((*at - *(at - 1)) / sums.back());
    return Photons::begin(photon, start);
  }
  bool advance(Photon& photon, Sampler& sampler, const WalkEnd& end,
               WalkFindings<CausticPhoton>& landed) const {
    return Photons::advance(photon, sampler, end,
                            [&](const CausticPhoton& at) { landed.add(photon, at); });
  }
};

std::vector<CausticPhoton> CausticLights::shoot(std::uint32_t set, std::uint64_t first,
                                                std::uint32_t count) const {
  if (!any_) return {};
  const std::uint32_t seed =
      hashCombine(hashCombine(seed_, set), static_cast<std::uint32_t>(first >> 32));
  const MapPhotons photons{{*this}, seed, static_cast<std::uint32_t>(first)};
  std::vector<CausticPhoton> landed;
  walks_.follow(photons, count, landed);
  return landed;
}

}  // namespace trex
