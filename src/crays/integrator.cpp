#include "src/crays/integrator.h"

#include <algorithm>
#include <cmath>

namespace trex {
namespace {

constexpr int kRouletteFrom = 3;   // bounces before Russian roulette may end a path
constexpr int kMostBounces = 256;  // a backstop: roulette ends paths long before
/// Width of a shadow cone as a share of its light's. Wide ones meet voxels at the edges of rooms,
/// which know no planes: with 0.25 a furnace of albedo 0.5 is 1.9 % dark, with 0.06 it is 0.7 %.
constexpr float kShadowWidth = 0.06f;

float powerHeuristic(float a, float b) {
  // Scaled so that the squares of large densities do not overflow.
  if (!(a < kInfinity)) return 1.0f;
  const float ratio = b / std::max(a, 1e-30f);
  return 1.0f / (1.0f + ratio * ratio);
}

}  // namespace

CameraRays::CameraRays(const Camera& camera, const dvec3& renderOrigin, std::uint32_t width,
                       std::uint32_t height)
    : eye_(camera.eye - renderOrigin),
      forward_(camera.forward),
      right_(glm::normalize(glm::cross(camera.forward, camera.up))),
      up_(glm::cross(right_, forward_)),
      width_(static_cast<float>(width)),
      height_(static_cast<float>(height)),
      lensRadius_(camera.lensRadius()),
      focus_(camera.focus),
      orthographic_(camera.orthographic) {
  halfHeight_ =
      orthographic_ ? 0.5f * camera.orthographicHeight : std::tan(0.5f * camera.verticalFov);
  halfWidth_ = halfHeight_ * width_ / height_;
}

void CameraRays::ray(float x, float y, dvec3& origin, vec3& direction) const {
  const float px = (2.0f * x / width_ - 1.0f) * halfWidth_;
  const float py = (1.0f - 2.0f * y / height_) * halfHeight_;
  origin = orthographic_ ? eye_ + dvec3(right_ * px + up_ * py) : eye_;
  direction = orthographic_ ? forward_ : glm::normalize(forward_ + right_ * px + up_ * py);
}

void CameraRays::throughLens(vec2 u, dvec3& origin, vec3& direction) const {
  const float radius = lensRadius_ * std::sqrt(u.x), angle = 2.0f * kPi * u.y;
  const vec3 offset = radius * (std::cos(angle) * right_ + std::sin(angle) * up_);
  origin += dvec3(offset);
  direction = glm::normalize(direction * (focus_ / glm::dot(direction, forward_)) - offset);
}

/// The state of one path. `coupled`: guess and exact path are still the same.
struct Integrator::Path {
  Sampler sampler;
  std::vector<ConeRequest>& cones;
  RayCounts& counts;
  PathSample result{};
  std::uint32_t pixelTag;
  bool paired, coupled;
  const SampleCaustics* caustics;  // may be null
  LightPoint points[2] = {vec3(0.0f), vec3(0.0f)};
  /// The last that scattered, reflected or bent the path.
  LightPoint* vertex = points;
  ClearPath clear{};  // since then
  RayStart left{};    // where it left the vertex
  RayStart start{};
  vec3 direction{0.0f}, throughput{1.0f}, absorption{0.0f};
  float tnear = 0.0f;
  float travelled = 0.0f;  // from `vertex` to `start`, through transparent layers and clear glass
  float roulette = 1.0f;   // undoes the radiance scaling of refraction
  float scatterPdf = kInfinity;  // density of the direction at `vertex`; infinite after a delta
  float roughness = 0.0f;        // of the last lobe
  bool coneRay = false;          // the last vertex hands its far field to a cone
  int bounces = 0;
  int layers = 0;           // of the bounces, those through transparent layers
  int scattered = 0;        // times, mirrors and clear glass not counted
  std::uint32_t turns = 0;  // times scattered or reflected: what Scene::maxBounces counts
  float length = 0.0f;      // from the eye to the last surface
  bool seen = false;        // the feature is known
  bool spread = false;  // by a broad lobe: what sharp ones make of point-like lights is a caustic
  bool certain = true;  // mirrors alone so far, and no choice
  RayHit hit{};

  /// Where the path is.
  LightPoint& other() { return points[vertex == points ? 1 : 0]; }
  /// `direct`: see PathSample.
  void add(const vec3& light, bool direct) {
    (coupled ? result.common : result.exact) += light;
    if (!direct) return;
    if (coupled) result.direct += light;
    result.directExact += light;
  }
  /// Density of the direction at `vertex` if light sampling there finds what comes next, else
  /// infinite.
  float density() const { return clear.straight(direction) ? scatterPdf : kInfinity; }
  /// The direction at `vertex`.
  const vec3& aim() const { return clear.begun() ? clear.direction() : direction; }
  /// A transparent layer or clear glass is left behind.
  void pass() {
    if (clear.begun()) clear.advance(hit.t);
    travelled += hit.t;
  }
  /// Light that the last ray came straight from.
  void addSeen(const vec3& light) {
    add(light, scattered <= 1);
    if (certain && coupled) result.own += light;
  }
  /// The guess parts from the path. False if nobody follows the exact path.
  bool part() {
    coupled = false;
    return paired;
  }
};

Integrator::Integrator(const Scene& scene, const RayScene& rays, const LightSet& lights,
                       const CameraRays& camera, const GuessOptions& guess, std::uint32_t seed,
                       bool background, const CausticMaps* caustics)
    : scene_(scene),
      rays_(rays),
      lights_(lights),
      camera_(camera),
      media_(rays.media()),
      guess_(guess),
      seed_(seed),
      background_(background),
      layers_(scene, rays),
      caustics_(caustics) {}

PathSample Integrator::sample(std::uint32_t x, std::uint32_t y, std::uint32_t width,
                              std::uint32_t sample, bool paired, std::uint32_t pixelTag,
                              std::vector<ConeRequest>& cones, RayCounts& counts) const {
  Path path{.sampler = Sampler(y * width + x, sample, seed_),
            .cones = cones,
            .counts = counts,
            .pixelTag = pixelTag,
            .paired = paired,
            .coupled = true,
            .caustics = caustics_ ? caustics_->find(sample) : nullptr,
            .certain = media_ == nullptr && !camera_.hasLens()};
  const vec2 jitter = path.sampler.next2D();
  camera_.ray(static_cast<float>(x) + jitter.x, static_cast<float>(y) + jitter.y,
              path.start.position, path.direction);
  if (camera_.hasLens()) {
    camera_.throughLens(path.sampler.next2D(), path.start.position, path.direction);
  }
  while (advance(path) && meet(path)) {
  }
  if (paired) ++counts.exactPaths;
  return path.result;
}

/// Finds the next surface. False if the path has left the scene or a cone goes on in its place.
bool Integrator::advance(Path& path) const {
  ++path.counts.cRays;
  bool cone = path.coneRay && path.coupled && !path.clear.begun();
  const float near = nearField();
  // Voxels know nothing of media: a cone whose axis meets one is an exact ray into cached light.
  if (media_ != nullptr && cone) {
    cone = !media_->meets(path.start.position, path.direction, path.tnear, kInfinity);
  }
  // Nor of clear glass: so it is with a cone whose axis meets that first.
  const bool whole = !cone || layers_.glass();
  bool met =
      rays_.intersect(path.start, path.direction, path.tnear, whole ? kInfinity : near, path.hit);
  if (met && cone && whole) {
    cone = path.hit.t > near && !layers_.isGlass(rays_.surface(path.hit).material);
    if (!cone) return true;
  }
  if (cone && !(met && path.hit.t <= near)) {
    path.tnear = near;
    if (!handToCone(path)) return false;
    if (!whole) met = rays_.intersect(path.start, path.direction, near, kInfinity, path.hit);
  }
  if (!met) miss(path);
  return met;
}

void Integrator::miss(Path& path) const {
  if (media_ != nullptr) passMedia(path, kInfinity);
  if (path.bounces == path.layers) {  // nothing but transparent layers and media on the way
    path.result.alpha = 1.0f - path.throughput.x;
    if (!background_) return;
  }
  if (!lights_.hasEnvironment()) return;
  const float weight =
      powerHeuristic(path.density(), lights_.pdfEnvironment(*path.vertex, path.aim()));
  path.addSeen(path.throughput * lights_.environment(path.direction) * weight);
}

/// G0: the far field of a broad lobe is a cone's. False if only the guess was asked for.
bool Integrator::handToCone(Path& path) const {
  ConeRequest request;
  request.origin = vec3(path.start.position);
  request.direction = path.direction;
  request.tanHalf = guess_.footprint.spread(path.roughness);
  request.tmin = path.tnear;
  request.jitter = path.sampler.next1D();
  request.weight = path.throughput;
  request.pixel = path.pixelTag;
  if (lights_.hasEnvironment()) {
    const float weight =
        powerHeuristic(path.scatterPdf, lights_.pdfEnvironment(*path.vertex, path.direction));
    request.background = path.throughput * lights_.environment(path.direction) * weight;
    request.direct = path.scattered <= 1;
  }
  path.cones.push_back(request);
  ++path.counts.cones;
  return path.part();
}

/// Deals with the surface that was hit. False where the path ends.
bool Integrator::meet(Path& path) const {
  const Surface surface = rays_.surface(path.hit);
  const Bsdf bsdf(scene_, surface, -path.direction);
  if (path.absorption != vec3(0.0f)) path.throughput *= glm::exp(-path.absorption * path.hit.t);
  if (media_ != nullptr) passMedia(path, path.hit.t);

  if (bsdf.coverage() > 0.0f && bsdf.coverage() < 1.0f) path.certain = false;
  if (bsdf.coverage() < 1.0f && path.sampler.next1D() >= bsdf.coverage()) {
    path.start = surface.leave();
    path.tnear = 0.0f;
    path.pass();
    path.length += path.hit.t;
    ++path.layers;
    return ++path.bounces < ClearLayers::kMost;
  }
  path.length += path.hit.t;
  if (path.bounces == path.layers) {
    path.result.first = {camera_.depth(surface.position), static_cast<float>(surface.object),
                         static_cast<float>(surface.material)};
  }
  if (!path.seen && (!bsdf.showsOthers() || bsdf.unlit())) {
    path.seen = true;
    const vec3 albedo = bsdf.albedo();
    const vec3 dimmed = glm::min(albedo * path.throughput, vec3(1.0f));  // by mirrors and glass
    path.result.feature = {dimmed, bsdf.normal(), vec3(surface.position),
                           camera_.footprint(path.length),
                           maxComponent(albedo) > 0.0f ? 0.0f : 1.0f};
  }
  if (maxComponent(bsdf.emission()) > 0.0f) {
    ClearPath way = path.clear;
    if (way.begun()) way.advance(path.hit.t);
    const float density = bsdf.unlit() ? kInfinity : path.density(),
                travelled = path.travelled + path.hit.t;
    const float weight = emitterWeight(density, path.left, *path.vertex, way, travelled,
                                       path.direction, surface, path.hit);
    const vec3 light = path.throughput * bsdf.emission() * weight;
    if (path.coneRay && path.coupled && density < kInfinity && travelled > nearField()) {
      // In place of a cone, which gathers no emission (sampleLight): the exact path's alone.
      path.result.exact += light;
      if (path.scattered <= 1) path.result.directExact += light;
    } else {
      path.addSeen(light);
    }
  }
  if (bsdf.unlit()) return false;
  if (path.turns >= scene_.maxBounces) return scatter(path, surface, bsdf, false);
  if (path.coupled && guess_.cache && endInCache(path, surface, bsdf) && !path.part()) return false;

  // Cached light has been reflected once more.
  const bool coneVertex = guess_.cones && path.coupled && bsdf.cacheable() && !bsdf.onlyDelta() &&
                          scene_.maxBounces - path.turns >= 2;
  path.other().moveTo(surface.position, bsdf.transmits() ? vec3(0.0f) : bsdf.normal());
  if (!bsdf.onlyDelta() && !lights_.empty()) sampleLight(path, surface, bsdf, coneVertex);
  if (!bsdf.onlyDelta() && path.caustics != nullptr) {
    const CausticMap& map = path.scattered == 0 ? *path.caustics->seen : *path.caustics->later;
    const vec3 light = map.radiance(surface, bsdf, !path.spread);
    path.add(path.throughput * light, path.scattered == 0);
  }
  return scatter(path, surface, bsdf, coneVertex);
}

/// Share of an emitter's light that falls to a path from a vertex, where light sampling may find it
/// too. `density` as Path::density(), `left` where the ray left the vertex, `travelled` metres to
/// it by `way`.
float Integrator::emitterWeight(float density, const RayStart& left, const LightPoint& vertex,
                                const ClearPath& way, float travelled, const vec3& direction,
                                const Surface& surface, const RayHit& hit) const {
  if (!(density < kInfinity)) return 1.0f;
  const float cosine = std::abs(glm::dot(surface.geometricNormal, direction));
  const auto sampled = [&](float distance) {
    return lights_.pdfEmitter(vertex, hit, distance, cosine);
  };
  if (!way.begun()) return powerHeuristic(density, sampled(travelled));
  // Light sampling chooses along the straight line; what counts is its density on this way, which
  // it need not find: by the edge of a thick pane it may see another one, or none.
  const RayEnd end(glm::length(vec3(surface.position - left.position)), surface.position);
  const LightConnection found = layers_.connect(left, way.direction(), end);
  constexpr float kSame = 4.0f * ClearPath::kStraight;
  if (!found.reaches() || glm::length(found.direction - way.direction()) > kSame) return 1.0f;
  const auto distance = static_cast<float>(glm::length(surface.position - vertex.position()));
  return powerHeuristic(density, sampled(distance) * way.spread() / (distance * distance));
}

/// G1: reads the cache if the ray's footprint is wide enough here. True if it did.
bool Integrator::endInCache(Path& path, const Surface& surface, const Bsdf& bsdf) const {
  if (!(path.density() < kInfinity) || !bsdf.cacheable()) return false;
  const float radius = (path.travelled + path.hit.t) * guess_.footprint.spread(path.roughness);
  if (radius < guess_.footprint.cacheVoxels * guess_.cache->leafSize()) return false;
  const vec2 jitter = path.sampler.next2D();
  vec3 irradiance;
  if (!guess_.cache->irradiance(vec3(surface.position), bsdf.geometricNormal(), radius, jitter,
                                irradiance)) {
    return false;
  }
  path.result.guess += path.throughput * bsdf.cachedAlbedo() * irradiance * kInvPi;
  ++path.counts.cacheReads;
  return true;
}

/// Metres from a surface that are its near field: no cone starts there.
float Integrator::nearField() const {
  return guess_.cache ? guess_.footprint.cacheVoxels * guess_.cache->leafSize() /
                            guess_.footprint.diffuseSpread
                      : 0.0f;
}

/// What a path meets of media on its next `distance` metres: their emission and light that they
/// scatter once are added, what comes after is dimmed.
void Integrator::passMedia(Path& path, float distance) const {
  const MediaStretch s =
      media_->stretch(path.start.position, path.direction, distance, path.sampler);
  if (s.emission != vec3(0.0f)) path.add(path.throughput * s.emission, path.scattered <= 1);
  if (s.scatter != vec3(0.0f) && path.turns < scene_.maxBounces) {
    const dvec3 point = path.start.position + dvec3(path.direction) * double(s.distance);
    const vec3 light = scatteredLight(path, point, s.anisotropy);
    if (light != vec3(0.0f)) path.add(path.throughput * s.scatter * light, path.scattered == 0);
  }
  path.throughput *= s.transmittance;
}

/// Light that arrives at a point of a medium, times the phase function towards the path: by light
/// sampling and, for lights that rays can hit, by sampling the phase function, so that points close
/// to a light of some size do not stand out.
vec3 Integrator::scatteredLight(Path& path, const dvec3& point, float anisotropy) const {
  vec3 sum(0.0f);
  LightSample light;
  if (!lights_.empty() && lights_.sample(point, path.sampler, light)) {
    const LightConnection way = connect(path, point, light.direction, light.end(), vec3(0.0f));
    const float phase = henyeyGreenstein(glm::dot(way.direction, path.direction), anisotropy);
    const float pdf = light.pdfBy(way);
    const float weight = light.delta ? 1.0f : powerHeuristic(pdf, phase);
    sum += light.radiance * way.passed * (phase * weight / pdf);
  }
  if (lights_.canBeHit()) {
    const vec3 to = sampleHenyeyGreenstein(path.direction, anisotropy, path.sampler.next2D());
    const float phase = henyeyGreenstein(glm::dot(to, path.direction), anisotropy);
    sum += lightAlong(path, point, to, phase);
  }
  return sum;
}

/// Radiance of the light that a ray from a point of a medium meets, dimmed by media. `pdf`: density
/// of the direction.
vec3 Integrator::lightAlong(Path& path, const dvec3& point, const vec3& direction,
                            float pdf) const {
  ClearWalk walk{.start = point, .direction = direction};
  vec3 sum(0.0f);
  ++path.counts.shadowRays;
  for (int layer = 0; layer < ClearLayers::kMost; ++layer) {
    RayHit hit;
    if (!rays_.intersect(walk.start, walk.direction, 0.0f, kInfinity, hit)) {
      if (!lights_.hasEnvironment()) return sum;
      const float density = walk.path.straight(walk.direction) ? pdf : kInfinity;
      const float weight = powerHeuristic(density, lights_.pdfEnvironment(point, direction));
      return sum + walk.passed * lights_.environment(walk.direction) *
                       (weight * media_->transmittance(point, direction, kInfinity));
    }
    walk.advance(hit.t);
    const Surface surface = rays_.surface(hit);
    const Bsdf bsdf(scene_, surface, -walk.direction);
    if (!bsdf.unlit() && maxComponent(bsdf.emission()) > 0.0f) {
      const float weight =
          emitterWeight(walk.path.straight(walk.direction) ? pdf : kInfinity, point, point,
                        walk.path, walk.length, walk.direction, surface, hit);
      sum += walk.passed * bsdf.emission() *
             (bsdf.coverage() * weight * media_->transmittance(point, direction, walk.length));
    }
    if (!layers_.pass(surface, bsdf, walk)) break;
  }
  return sum;
}

/// How light that was sampled arrives at the start; `absorption`: of the volume there, 1/m.
LightConnection Integrator::connect(Path& path, const RayStart& start, const vec3& direction,
                                    const RayEnd& end, const vec3& absorption) const {
  ++path.counts.shadowRays;
  LightConnection way = layers_.connect(start, direction, end, absorption);
  if (media_ != nullptr && way.reaches()) {
    way.passed *= media_->transmittance(start.position, direction, end.distance);
  }
  return way;
}

/// The shadow cone of a large light, which brings `radiance` if nothing is in its way.
void Integrator::shadowCone(Path& path, const RayStart& start, const LightSample& light,
                            const vec3& radiance) const {
  const float near = nearField();
  if (!connect(path, start, light.direction, near, vec3(0.0f)).reaches()) return;
  ConeRequest request;
  request.origin = vec3(start.position);
  request.direction = light.direction;
  request.tanHalf =
      std::min(std::sqrt(light.solidAngle * kInvPi), guess_.footprint.diffuseSpread) * kShadowWidth;
  request.tmin = near;
  // The emitter's own voxels must not shadow it: those that the cone reads there are as wide as
  // the cone.
  request.tmax = light.distance -
                 std::max(2.0f * guess_.cache->leafSize(), 2.0f * request.tanHalf * light.distance);
  request.jitter = path.sampler.next1D();
  request.background = radiance;
  if (media_ != nullptr) {
    request.background *= media_->transmittance(start.position, light.direction, light.distance);
  }
  if (layers_.glass()) {  // voxels have none
    const ClearWalk walk = layers_.walk(start, light.direction, light.end());
    if (!walk.path.straight(walk.direction)) return;  // bent: scattered rays find it
    request.background *= walk.glass;
  }
  request.direct = path.scattered == 0;
  request.pixel = path.pixelTag;
  request.shadow = true;
  path.cones.push_back(request);
  ++path.counts.cones;
}

/// Next event estimation: one light. Shadow rays of small lights are C-rays; large ones are cones
/// where this device makes them worth it.
void Integrator::sampleLight(Path& path, const Surface& surface, const Bsdf& bsdf,
                             bool coneVertex) const {
  LightSample light;
  if (!lights_.sample(path.other(), path.sampler, light)) return;
  const bool caustic = light.delta && path.spread && path.caustics != nullptr;
  const LobeKind kind = caustic ? LobeKind::kBroad : LobeKind::kAll;
  vec3 f = bsdf.evaluate(light.direction, kind);
  if (maxComponent(f) <= 0.0f) return;
  RayStart start;
  if (!rays_.leave(surface, light.direction, bsdf.leavesFront(light.direction), start)) return;
  // A cone vertex gathers its far field without emission, so a far emitter is light sampling's
  // alone.
  const float near = coneVertex ? nearField() : 0.0f;
  const bool farEmitter = coneVertex && light.distance < kInfinity && light.distance > near;
  const bool coneShadow =
      coneVertex && light.solidAngle > guess_.shadowSolidAngle && light.distance > near;
  const auto weigh = [&](const vec3& direction, float pdf) {
    return light.delta ? 1.0f : powerHeuristic(pdf, bsdf.pdf(direction));
  };
  if (coneShadow) {
    const float weight = farEmitter ? 1.0f : weigh(light.direction, light.pdf);
    shadowCone(path, start, light, path.throughput * f * light.radiance / light.pdf * weight);
    if (!path.paired) return;
  }
  const vec3 absorption = bsdf.absorptionTowards(light.direction, path.absorption);
  const LightConnection way = connect(path, start, light.direction, light.end(), absorption);
  if (!way.reaches()) return;
  if (way.refracted) f = bsdf.evaluate(way.direction, kind);
  const float pdf = light.pdfBy(way);
  const vec3 unweighted = path.throughput * f * light.radiance * way.passed / pdf;
  const float weight = weigh(way.direction, pdf), guessWeight = farEmitter ? 1.0f : weight;
  const vec3 exact = unweighted * weight;
  const bool direct = path.scattered == 0;
  if (!coneShadow && !(path.coupled && guessWeight != weight)) {
    path.add(exact, direct);
    return;
  }
  const vec3 guess = coneShadow ? vec3(0.0f) : unweighted * guessWeight;
  path.result.guess += guess;
  path.result.exact += exact;
  if (direct) {
    path.result.direct += guess;
    path.result.directExact += exact;
  }
}

/// Goes on behind clear glass: light that was sampled at the last vertex passes it too.
void Integrator::passClear(Path& path, const Bsdf& bsdf, const vec3& direction) const {
  path.pass();
  if (!bsdf.refracts()) return;
  if (!path.clear.begun()) path.clear.begin(path.direction, path.travelled);
  path.clear.refract(bsdf.normal(), bsdf.eta(), direction);
}

/// Chooses the next direction. False where the path ends.
bool Integrator::scatter(Path& path, const Surface& surface, const Bsdf& bsdf,
                         bool coneVertex) const {
  BsdfSample next;
  if (++path.bounces >= kMostBounces || !bsdf.sample(path.sampler, next)) return false;
  if (path.caustics != nullptr && !next.delta) {
    path.spread |= !bsdf.goesOnSharp(path.sampler, next);
  }
  path.throughput *= next.weight;
  path.roulette *= next.etaSquared;
  if (path.bounces >= kRouletteFrom) {
    const float survival = std::min(0.95f, maxComponent(path.throughput) * path.roulette);
    if (!(survival > 0.0f) || path.sampler.next1D() >= survival) return false;
    path.throughput /= survival;
  }
  if (!(maxComponent(path.throughput) > 0.0f)) return false;
  path.certain &= bsdf.showsOthers() && bsdf.oneLobe();
  const bool front = bsdf.leavesFront(next.direction);
  if (!rays_.leave(surface, next.direction, front, path.start)) return false;
  if (next.delta && next.transmitted && ClearLayers::clear(bsdf)) {
    passClear(path, bsdf, next.direction);
  } else {
    if (++path.turns > scene_.maxBounces) return false;
    path.vertex = &path.other();
    path.clear = ClearPath();
    path.left = path.start;
    path.travelled = 0.0f;
    path.scatterPdf = next.delta ? kInfinity : next.pdf;
    if (!next.delta) ++path.scattered;
    path.roughness = next.roughness;
    path.coneRay = coneVertex && !next.delta;
  }
  path.direction = next.direction;
  path.tnear = 0.0f;
  if (next.transmitted) path.absorption = bsdf.absorptionTowards(next.direction, path.absorption);
  return true;
}

}  // namespace trex
