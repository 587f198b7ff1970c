#include "src/paths/path_tracer.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <span>

#include "src/crays/waiting_ray.h"
#include "src/paths/waiting_path.h"
#include "src/paths/wave.h"

namespace trex {
namespace {

/// Width of a shadow cone as a share of its light's: wide ones are stopped by voxels beside it.
constexpr float kShadowWidth = 0.06f;

/// Share of light sampling in light of density `pdf` from a direction that scattering has with
/// density `scattered`.
float lightWeight(const LightSample& light, float pdf, float scattered) {
  return light.delta ? 1.0f : powerHeuristic(pdf, scattered);
}

}  // namespace

LightAnswer weigh(const LightQuestion& q, const vec3& throughput, bool coupled, bool direct,
                  const LightConnection& way, const BsdfValue& surface) {
  const LightSample& light = q.light;
  const float pdf = light.pdfBy(way);
  const vec3 unweighted = throughput * surface.f * light.radiance * way.passed / pdf;
  const float weight = lightWeight(light, pdf, surface.pdf),
              guessWeight = q.farEmitter ? 1.0f : weight;
  LightAnswer answer;
  answer.exact = unweighted * weight;
  answer.direct = direct;
  answer.apart = q.coneShadow || (coupled && guessWeight != weight);
  if (answer.apart) answer.guess = q.coneShadow ? vec3(0.0f) : unweighted * guessWeight;
  return answer;
}

/// Next event estimation: chooses one light for each path that is lit, and asks for it.
void PathTracer::ask(Wave& wave) const {
  std::array<LightChoice, Wave::kPaths> choices;
  std::array<WavePath*, Wave::kPaths> paths;
  std::size_t count = 0;
  for (WavePath* path : wave.underWay) {
    path->asks = false;
    if (path->fate != Fate::kLit || lights_.empty()) continue;
    choices[count] = {.at = &path->here(), .sampler = &path->sampler};
    paths[count++] = path;
  }
  lights_.choose(std::span(choices).first(count));
  std::array<PlainValues, Wave::kPaths / PlainLanes::kLanes> values{};
  for (std::size_t i = 0; i < count; ++i) {
    WavePath& path = *paths[i];
    LightSample& light = path.question.light = LightSample{};
    path.asks = lights_.sample(choices[i], light);
    if (!path.isPlain()) continue;
    PlainValues& of = values[path.place / PlainLanes::kLanes];
    for (int k = 0; k < 3; ++k) of.direction[k][Wave::laneOf(path.place)] = light.direction[k];
  }
  for (std::size_t i = 0; i < wave.plainBlocks(); ++i)
    plain_.kernels().value(wave.plain[i], values[i]);
  for (std::size_t i = 0; i < count; ++i) {
    WavePath& path = *paths[i];
    if (!path.asks) continue;
    path.asks = path.isPlain() ? askPlain(path, wave, values[path.place / PlainLanes::kLanes])
                               : askLight(path, wave);
  }
}

/// For one path alone.
void PathTracer::ask(WavePath& path, Wave& wave) const {
  LightSample& light = path.question.light = LightSample{};
  path.asks =
      !lights_.empty() && lights_.sample(path.here(), path.sampler, light) && askLight(path, wave);
}

/// Makes a question of a light that was sampled. False if the light does not count.
bool PathTracer::askLight(WavePath& path, Wave& wave) const {
  const Bsdf& bsdf = *path.bsdf;
  LightQuestion& q = path.question;
  const LightSample& light = q.light;
  const bool caustic = light.delta && path.spread && path.caustics != nullptr;
  q.kind = caustic ? LobeKind::kBroad : LobeKind::kAll;
  q.surface = bsdf.value(light.direction, q.kind);
  if (maxComponent(q.surface.f) <= 0.0f) return false;
  if (!rays_.leave(path.surface, light.direction, bsdf.leavesFront(light.direction), q.start))
    return false;
  return asksRay(path, wave);
}

/// Whether a ray asks for the light. Shadow rays of lamps are C-rays: what stands before them is
/// mostly thin or near. Those of wide parts of the sky are cones, at vertices that have cones.
bool PathTracer::asksRay(WavePath& path, Wave& wave) const {
  LightQuestion& q = path.question;
  const LightSample& light = q.light;
  // A cone vertex gathers its far field without emission, so a far emitter is light sampling's
  // alone.
  const float near = path.coneVertex ? nearField() : 0.0f;
  q.farEmitter = path.coneVertex && light.distance < kInfinity && light.distance > near;
  q.coneShadow = path.coneVertex && !(light.distance < kInfinity) &&
                 light.solidAngle > guess_.shadowSolidAngle;
  if (!q.coneShadow) return true;
  const float weight = lightWeight(light, light.pdf, q.surface.pdf);
  shadowCone(path, path.throughput * q.surface.f * light.radiance / light.pdf * weight, wave);
  return path.paired;
}

/// The same at a plain surface.
bool PathTracer::askPlain(WavePath& path, Wave& wave, const PlainValues& values) const {
  const PlainLanes& lanes = wave.lanesOf(path.place);
  const std::size_t lane = Wave::laneOf(path.place);
  LightQuestion& q = path.question;
  q.kind = LobeKind::kAll;
  q.surface = {PlainLanes::vector(values.f, lane), values.pdf[lane]};
  return maxComponent(q.surface.f) > 0.0f &&
         rays_.leave(path.surface, q.light.direction, lanes.leavesFront(q.light.direction, lane),
                     q.start) &&
         asksRay(path, wave);
}

/// What arrives of the light that was chosen, and of caustics. `wave`: has the plain surfaces.
void PathTracer::answer(WavePath& path, const PlainWave& wave) const {
  if (path.asks) takeAnswer(path);
  if (path.caustics != nullptr) path.add(causticLight(path, wave), path.scattered == 0);
}

/// Most surfaces have none, and many of the others are matte: of neither a Bsdf is made.
vec3 PathTracer::causticLight(WavePath& path, const PlainWave& wave) const {
  const CausticMap& map = path.scattered == 0 ? *path.caustics->seen : *path.caustics->later;
  const vec3 at(path.surface.position);
  const std::uint32_t near = map.near(at);
  if (near == 0) return vec3(0.0f);
  const std::uint32_t turns = scene_.maxBounces - path.turns;
  if (path.isPlain()) {
    const PlainLanes& lanes = wave.lanesOf(path.place);
    const std::size_t lane = PlainWave::laneOf(path.place);
    if (PlainLanes::is(lanes.lambertian, lane)) {
      const auto of = [&](const PlainLanes::Floats(&v)[3]) { return PlainLanes::vector(v, lane); };
      const MatteSurface surface{of(lanes.diffuse), of(lanes.normal), of(lanes.facing),
                                 of(lanes.smoothNormal)};
      return path.throughput * map.radiance(at, near, surface, turns);
    }
  }
  return path.throughput * map.radiance(at, near, bsdfOf(path), !path.spread, turns);
}

void PathTracer::takeAnswer(WavePath& path) const {
  const LightQuestion& q = path.question;
  const LightConnection way =
      connect(path, q.start, q.light.direction, q.light.end(), absorptionOf(path));
  if (!way.reaches()) return;
  const BsdfValue surface = way.refracted ? bsdfOf(path).value(way.direction, q.kind) : q.surface;
  path.add(weigh(q, path.throughput, path.coupled, path.scattered == 0, way, surface));
}

/// Of the volume that the question's ray goes through, 1/m.
vec3 PathTracer::absorptionOf(const WavePath& path) const {
  return path.isPlain()
             ? path.absorption
             : path.bsdf->absorptionTowards(path.question.light.direction, path.absorption);
}

/// The question of a path, which may go on before it is answered.
AskedLight PathTracer::asked(const WavePath& path) const {
  return {path.question,  path.throughput, absorptionOf(path), path.hit,
          path.direction, path.coupled,    path.scattered == 0};
}

/// The answer, none if `ray` is blocked. False if it waits for a page.
bool PathTracer::answerHere(WaitingLight& light, WaitingRay& ray, LightAnswer& answer) const {
  const AskedLight& a = light.asked;
  const LightQuestion& q = a.question;
  const RayEnd end = q.light.end();
  if (!layers_.connectHere(q.start, q.light.direction, end, a.absorption, ray, light.way))
    return false;
  const LightConnection way = throughMedia(light.way.found, q.start, q.light.direction, end);
  ray.blocked = !way.reaches();
  if (ray.blocked) return true;
  BsdfValue surface = q.surface;
  if (way.refracted) {
    ray.best = a.at;
    ray.answered = true;
    if (!rays_.surfaceIsHere(a.at)) return false;
    surface = Bsdf(scene_, rays_.surface(a.at), -a.incoming).value(way.direction, q.kind);
  }
  answer = weigh(q, a.throughput, a.coupled, a.direct, way, surface);
  return true;
}

/// The shadow cone of a wide part of the sky, which brings `radiance` if nothing is in its way.
void PathTracer::shadowCone(WavePath& path, const vec3& radiance, Wave& wave) const {
  const RayStart& start = path.question.start;
  const LightSample& light = path.question.light;
  const float near = nearField();
  if (!connect(path, start, light.direction, near, vec3(0.0f)).reaches()) return;
  ConeRequest request;
  request.origin = vec3(start.position);
  request.direction = light.direction;
  request.tanHalf =
      std::min(std::sqrt(light.solidAngle * kInvPi), guess_.footprint.diffuseSpread) * kShadowWidth;
  request.tmin = near;
  request.jitter = path.sampler.next1D();
  request.background = radiance;
  if (media_ != nullptr) {
    request.background *= media_->transmittance(start.position, light.direction, kInfinity);
  }
  if (layers_.glass()) {  // voxels have none
    const ClearWalk walk = layers_.walk(start, light.direction, light.end());
    if (!walk.path.straight(walk.direction)) return;  // bent: scattered rays find it
    request.background *= walk.glass;
  }
  request.direct = path.scattered == 0;
  request.job = path.job;
  request.bounce = path.bounces;
  request.shadow = true;
  wave.cones.requests.push_back(request);
  ++path.counts->cones;
}

/// How light that was sampled arrives at the start; `absorption`: of the volume there, 1/m.
LightConnection PathTracer::connect(WavePath& path, const RayStart& start, const vec3& direction,
                                    const RayEnd& end, const vec3& absorption) const {
  ++path.counts->shadowRays;
  return throughMedia(layers_.connect(start, direction, end, absorption), start, direction, end);
}

/// Media dim it, too.
LightConnection PathTracer::throughMedia(LightConnection way, const RayStart& start,
                                         const vec3& direction, const RayEnd& end) const {
  if (media_ != nullptr && way.reaches()) {
    way.passed *= media_->transmittance(start.position, direction, end.distance);
  }
  return way;
}

/// Whether emitterWeight() will ask for the way of light from what a ray has met, by what.
bool PathTracer::asksEmitter(const WavePath& path, const RayHit& hit, RayQuery& query) const {
  if (!path.clear.begun()) return false;
  const Surface surface = rays_.surface(hit);
  const Bsdf bsdf(scene_, surface, -path.direction);
  if (bsdf.unlit() || !(maxComponent(bsdf.emission()) > 0.0f) || !(path.density() < kInfinity))
    return false;
  query = {path.left, path.clear.direction(), 0.0f,
           RayEnd(glm::length(vec3(surface.position - path.left.position)), surface.position)};
  return true;
}

/// Share of an emitter's light that falls to a path from a vertex, where light sampling may find it
/// too. `density` as PathState::density(), `left` where the ray left the vertex, `travelled` metres
/// to it by `way`. `connection`: what asksEmitter() asked for, or null.
float PathTracer::emitterWeight(float density, const RayStart& left, const LightPoint& vertex,
                                const ClearPath& way, float travelled, const vec3& direction,
                                const Surface& surface, const RayHit& hit,
                                const LightConnection* connection) const {
  if (!(density < kInfinity)) return 1.0f;
  const float cosine = std::abs(glm::dot(surface.geometricNormal, direction));
  const auto sampled = [&](float distance) {
    return lights_.pdfEmitter(vertex, hit, distance, cosine);
  };
  if (!way.begun()) return powerHeuristic(density, sampled(travelled));
  // Light sampling chooses along the straight line; what counts is its density on this way, which
  // it need not find: by the edge of a thick pane it may see another one, or none.
  const RayEnd end(glm::length(vec3(surface.position - left.position)), surface.position);
  const LightConnection found =
      connection != nullptr ? *connection : layers_.connect(left, way.direction(), end);
  constexpr float kSame = 4.0f * ClearPath::kStraight;
  if (!found.reaches() || glm::length(found.direction - way.direction()) > kSame) return 1.0f;
  const auto distance = static_cast<float>(glm::length(surface.position - vertex.position()));
  return powerHeuristic(density, sampled(distance) * way.spread() / (distance * distance));
}

}  // namespace trex
