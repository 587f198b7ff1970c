#include "src/crays/caustics.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

#include "src/crays/clear_path.h"
#include "src/crays/lights_detail.h"
#include "src/crays/microfacet.h"
#include "src/crays/ray_scene_parts.h"

namespace trex {
namespace {

constexpr int kCausticBounces = 64;
constexpr std::uint32_t kCausticChunk = 1024;
constexpr std::uint32_t kPilotRounds = 4, kPilotRound = 1u << 13;
constexpr std::size_t kBends = 4096;         // places on mirrors and glass that lights aim at
constexpr std::size_t kAllHints = 1u << 20;  // of all lights together
constexpr std::uint32_t kBendsOfCluster = 256;
constexpr double kUnknownShare = 0.1;  // of photons, for lights that seem to bend nothing

float outerCosine(const Light& light) {
  return light.type == Light::Type::kSpot ? std::cos(light.outerConeAngle) : -1.0f;
}

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

CausticLights::CausticLights(const Scene& scene, const RayScene& rays, std::uint32_t seed)
    : scene_(scene), rays_(rays), seed_(seed) {
  const Box3f bounds = rays.bounds();
  if (bounds.empty()) return;
  centre_ = bounds.centre();
  radius_ = std::max(0.5f * glm::length(bounds.size()), 1e-20f);
  for (const Light& light : scene.lights) {
    if (maxComponent(light.intensity) <= 0.0f) continue;
    sources_.push_back({light, light.position - rays.renderOrigin()});
  }
  const std::vector<Bend> bends = findBends(scene, rays);
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
  const float z = 1.0f - u.x * (1.0f - outerCosine(source.light));
  const float r = std::sqrt(std::max(0.0f, 1.0f - z * z)), phi = 2.0f * kPi * u.y;
  return Basis(source.light.direction).toWorld(vec3(r * std::cos(phi), r * std::sin(phi), z));
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
  return vec2((1.0f - d.z) / (1.0f - outerCosine(source.light)), phi < 0.0f ? phi + 1.0f : phi);
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
  const float solidAngle = 2.0f * kPi * (1.0f - outerCosine(light));
  const float falloff = spotFactor(light, glm::dot(start.direction, light.direction));
  start.power = light.intensity * (falloff * solidAngle / start.density);
  return start;
}

/// Follows a photon through mirrors and glass; each surface on the way that scatters as well gets
/// it.
void CausticLights::follow(const Start& start, Sampler& sampler,
                           std::vector<CausticPhoton>& out) const {
  const Media* const media = rays_.media();
  RayStart from = start.origin;
  vec3 direction = start.direction, power = start.power, absorption(0.0f);
  const float most = maxComponent(power);
  ClearPath clear;
  RangeOnTheWay range(start.range);
  bool bent = false, blurred = false;
  std::uint32_t turns = 1;  // as Scene::maxBounces counts, that where it is seen among them
  for (int bounce = 0; bounce < kCausticBounces && maxComponent(power) > 0.0f; ++bounce) {
    RayHit hit;
    if (!rays_.intersect(from, direction, 0.0f, kInfinity, hit)) return;
    range.advance(hit.t);
    if (absorption != vec3(0.0f)) power *= glm::exp(-absorption * hit.t);
    if (media != nullptr) power *= media->transmittance(from.position, direction, hit.t);
    const Surface surface = rays_.surface(hit);
    const Bsdf bsdf(scene_, surface, -direction);
    if (bsdf.unlit()) return;
    if (bsdf.coverage() < 1.0f && sampler.next1D() >= bsdf.coverage()) {
      from = surface.leave();
      continue;
    }
    const bool counts = blurred ? bsdf.hasBroad() : !bsdf.onlyDelta();
    if (counts && (bent || !clear.straight(direction)) && isFinite(power)) {
      out.push_back({vec3(surface.position), bsdf.geometricNormal(), -direction,
                     power * range.factor(), blurred});
    }
    BsdfSample next;
    if (!bsdf.sample(sampler, next)) return;
    if (!next.delta && !bsdf.goesOnSharp(sampler, next)) return;
    blurred |= !next.delta;
    if (!next.delta || !next.transmitted || !ClearLayers::clear(bsdf)) {
      bent = true;
      power *= range.end();
      if (++turns > scene_.maxBounces) return;
    } else if (bsdf.refracts()) {
      if (!clear.begun()) clear.begin(direction, 0.0f);
      clear.refract(bsdf.normal(), bsdf.eta(), next.direction);
    }
    power *= next.weight * (next.etaSquared * bsdf.photonFactor(next.direction));
    const float survival = std::min(1.0f, maxComponent(power) / most);
    if (!(survival > 0.0f) || sampler.next1D() >= survival) return;
    power /= survival;
    absorption = bsdf.absorptionTowards(next.direction, absorption);
    direction = next.direction;
    if (!rays_.leave(surface, direction, bsdf.leavesFront(direction), from)) return;
  }
}

/// Photons of all lights in turn, from which their guides learn.
void CausticLights::pilot(std::uint32_t round) {
  struct Found {
    vec4 primary;
    float density, flux;
  };
  const std::uint32_t chunks = kPilotRound / kCausticChunk;
  if (sources_.empty()) return;
  std::vector<std::vector<Found>> found(chunks);
  const auto lights = static_cast<std::uint32_t>(sources_.size());
  tbb::parallel_for(std::uint32_t{0}, chunks, [&](std::uint32_t chunk) {
    std::vector<CausticPhoton> landed;
    for (std::uint32_t i = chunk * kCausticChunk; i < (chunk + 1) * kCausticChunk; ++i) {
      Sampler sampler(0x70696c6fu, i, hashCombine(seed_, round));
      const Start start = emit(sources_[i % lights], sampler);
      landed.clear();
      follow(start, sampler, landed);
      float flux = 0.0f;
      for (const CausticPhoton& p : landed) flux += luminance(p.power);
      found[chunk].push_back({start.primary, start.density, flux});
    }
  });
  const double each = std::max(1.0, static_cast<double>(kPilotRound) / lights);
  std::uint32_t i = 0;
  for (const auto& part : found) {
    for (const Found& f : part) {
      Source& source = sources_[i++ % lights];
      if (f.flux <= 0.0f) continue;
      source.guide.learn(f.primary, f.density, 1.0f);
      source.flux += static_cast<double>(f.flux) / (each * kPilotRounds);
    }
  }
  for (Source& source : sources_) source.guide.update();
}

std::vector<CausticPhoton> CausticLights::shoot(std::uint32_t set, std::uint64_t first,
                                                std::uint32_t count) const {
  if (!any_) return {};
  const std::uint32_t seed =
      hashCombine(hashCombine(seed_, set), static_cast<std::uint32_t>(first >> 32));
  const std::uint32_t chunks = (count + kCausticChunk - 1) / kCausticChunk;
  std::vector<std::vector<CausticPhoton>> landed(chunks);
  tbb::parallel_for(std::uint32_t{0}, chunks, [&](std::uint32_t chunk) {
    const std::uint32_t end = std::min(count, (chunk + 1) * kCausticChunk);
    for (std::uint32_t i = chunk * kCausticChunk; i < end; ++i) {
      Sampler sampler(0x63617573u, static_cast<std::uint32_t>(first) + i, seed);
      const double choice = static_cast<double>(sampler.next1D()) * cumulative_.back();
      const auto at = std::upper_bound(cumulative_.begin() + 1, cumulative_.end() - 1, choice);
      const auto index = static_cast<std::size_t>(at - cumulative_.begin()) - 1;
      Start start = emit(sources_[index], sampler);
      start.power /= static_cast<float>((*at - *(at - 1)) / cumulative_.back());
      follow(start, sampler, landed[chunk]);
    }
  });
  std::vector<CausticPhoton> all;
  for (const auto& part : landed) all.insert(all.end(), part.begin(), part.end());
  return all;
}

}  // namespace trex
