#include "src/crays/lights.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "src/core/prefetch.h"
#include "src/crays/lights_detail.h"

namespace trex {
namespace {

/// Where a directional light stands in the tree: this many radii of the scene away, its rays are
/// parallel enough.
constexpr double kSunDistance = 1e4;
/// The faintest light counts with this share of the brightest one: single precision ends.
constexpr double kLeastShare = 1e-20;
/// Lights among which a number of 24 bits chooses well.
constexpr std::size_t kFew = 4096;
/// Points that lights are chosen for at a time.
constexpr std::size_t kTogether = 16;

}  // namespace

LightSet::LightSet(const Scene& scene, const RayScene& rays)
    : emitters_(scene, rays),
      environment_(scene.environment),
      mapSine_(std::sin(scene.environment.rotation)),
      mapCosine_(std::cos(scene.environment.rotation)),
      visibility_(rays.visibility()) {
  // Above this the power of a sky overflows single precision.
  environment_.color = glm::min(environment_.color, vec3(1e30f));
  const Box3f bounds = rays.bounds();
  if (!bounds.empty()) {
    centre_ = bounds.centre();
    radius_ = std::max(0.5f * glm::length(bounds.size()), 1e-20f);
  }
  addEmitters();
  addPunctual(scene, rays.renderOrigin());
  addEnvironment(scene);
  if (std::any_of(scene.media.begin(), scene.media.end(),
                  [](const Medium& m) { return m.emits(); })) {
    media_ = Media::make(scene, rays.renderOrigin());
    if (media_ && media_->power() > 0.0) sources_.push_back({Kind::kMedia, 0, media_->power()});
  }
  std::vector<double> weights;
  for (const Entry& e : sources_) weights.push_back(e.power);
  sourceCumulative_ = cumulate(weights);
  totalPower_ = sourceCumulative_.back();
  buildTree();
}

double LightSet::sidesOf(const Emitters::Triangle& t) const {
  return emitters_.shinesBack(t) ? 2.0 : 1.0;
}

/// W, by luminance.
double LightSet::emitterPower(const Emitters::Triangle& t) const {
  return std::numbers::pi * sidesOf(t) * static_cast<double>(t.area) *
         static_cast<double>(t.radiance);
}

void LightSet::addEmitters() {
  std::vector<double> weights;
  weights.reserve(emitters_.triangles().size());
  for (const Emitters::Triangle& t : emitters_.triangles()) weights.push_back(emitterPower(t));
  emitterCumulative_ = cumulate(weights);
  const double power = emitterCumulative_.back();
  if (power > 0.0) sources_.push_back({Kind::kEmitters, 0, power});
}

void LightSet::addPunctual(const Scene& scene, const dvec3& renderOrigin) {
  for (const Light& light : scene.lights) {
    const double intensity = luminance(light.intensity);
    if (!(intensity > 0.0)) continue;
    double power = 4.0 * std::numbers::pi * intensity;
    if (light.type == Light::Type::kSpot) {
      power = 2.0 * std::numbers::pi * static_cast<double>(coneVersine(light)) * intensity;
    } else if (light.type == Light::Type::kDirectional) {
      power = std::numbers::pi * radius_ * radius_ * intensity;
    }
    sources_.push_back({Kind::kPunctual, static_cast<std::uint32_t>(punctual_.size()), power});
    punctual_.push_back({light, light.position - renderOrigin});
  }
}

vec3 LightSet::toTree(const dvec3& position) const {
  return vec3((position - dvec3(centre_)) / static_cast<double>(radius_));
}

LightBounds LightSet::boundsOf(const Emitters::Triangle& t) const {
  LightBounds b;
  for (const dvec3& p : {t.corner, t.corner + dvec3(t.edge1), t.corner + dvec3(t.edge2)}) {
    b.box.extend(toTree(p));
  }
  b.axis = t.normal;
  b.reach = 0.5f * kPi;
  b.bothSides = emitters_.shinesBack(t);
  b.group = t.lamp;
  return b;
}

LightBounds LightSet::boundsOf(const Punctual& p) const {
  LightBounds b;
  if (p.light.type == Light::Type::kDirectional) {
    b.box.extend(-p.light.direction * static_cast<float>(kSunDistance));
  } else {
    const vec3 ball(p.light.radius / radius_);
    b.box = {toTree(p.position) - ball, toTree(p.position) + ball};
  }
  b.spread = kPi;
  if (p.light.type == Light::Type::kSpot) {
    b.axis = p.light.direction;
    b.spread = std::min(p.light.innerConeAngle, p.light.outerConeAngle);
    b.reach = p.light.outerConeAngle - b.spread + 1e-3f;
  }
  return b;
}

/// The tree's unit of length is the scene's radius, its unit of power the brightest light's.
void LightSet::buildTree() {
  std::vector<LightBounds> bounds;
  std::vector<double> power;
  const double area = static_cast<double>(radius_) * static_cast<double>(radius_);
  for (const Emitters::Triangle& t : emitters_.triangles()) {
    bounds.push_back(boundsOf(t));
    power.push_back(static_cast<double>(t.radiance) * static_cast<double>(t.area) / area);
  }
  for (const Punctual& p : punctual_) {
    const bool sun = p.light.type == Light::Type::kDirectional;
    bounds.push_back(boundsOf(p));
    power.push_back(static_cast<double>(luminance(p.light.intensity)) *
                    (sun ? kSunDistance * kSunDistance : 1.0 / area));
  }
  double brightest = mapPower_;
  for (const double p : power) brightest = std::max(brightest, p);
  if (!(brightest > 0.0)) return;
  for (std::size_t i = 0; i < bounds.size(); ++i) {
    bounds[i].power = static_cast<float>(std::max(power[i] / brightest, kLeastShare));
  }
  many_ = bounds.size() > kFew;
  mapWeight_ = static_cast<float>(mapPower_ / brightest);
  tree_ = LightTree(bounds);
}

std::size_t LightSet::pick(const std::vector<double>& cumulative, double u, double& rest) {
  const double target = u * cumulative.back();
  const auto at = std::upper_bound(cumulative.begin() + 1, cumulative.end() - 1, target);
  const auto index = static_cast<std::size_t>(at - cumulative.begin()) - 1;
  const double width = cumulative[index + 1] - cumulative[index];
  rest = width > 0.0 ? (target - cumulative[index]) / width : 0.5;
  rest = std::clamp(rest, 0.0, 0x1.fffffffffffffp-1);
  return index;
}

const LightTree::Cut& LightSet::cutAt(const LightPoint& at) const {
  if (!std::exchange(at.weighed_, true)) {
    if (mapWeight_ > 0.0f || !tree_.single()) {
      tree_.cut(toTree(at.position_), at.normal_, at.cut_);
    } else {
      tree_.cutAlone(at.cut_);
    }
  }
  return at.cut_;
}

/// Chance that the map is chosen, where the rest is as bright as the cut says.
float LightSet::mapShare(const LightTree::Cut& cut) const {
  return mapWeight_ > 0.0f ? mapWeight_ / (mapWeight_ + cut.sum) : 0.0f;
}

bool LightSet::sample(const LightPoint& at, Sampler& sampler, LightSample& out) const {
  LightChoice choice{.at = &at, .sampler = &sampler};
  choose({&choice, 1});
  return sample(choice, out);
}

void LightSet::choose(std::span<LightChoice> choices) const {
  for (; choices.size() > kTogether; choices = choices.subspan(kTogether))
    choose(choices.first(kTogether));
  LightTree::Question questions[kTogether];
  std::uint8_t number[kTogether];
  std::size_t count = 0;
  for (std::size_t i = 0; i < choices.size(); ++i) {
    LightChoice& c = choices[i];
    const double choice =
        many_ ? longNumber(c.sampler->next2D()) : static_cast<double>(c.sampler->next1D());
    c.u = c.sampler->next2D();
    const LightTree::Cut& cut = cutAt(*c.at);
    const auto ofMap = static_cast<double>(mapShare(cut));
    c.map = choice < ofMap;
    c.chance = c.map ? static_cast<float>(ofMap) : 0.0f;
    if (c.map) continue;
    number[count] = static_cast<std::uint8_t>(i);
    questions[count++] = {&cut, (choice - ofMap) / (1.0 - ofMap), {}};
  }
  tree_.choose(std::span(questions).first(count));
  for (std::size_t k = 0; k < count; ++k) {
    if (questions[k].choice.chance > 0.0f) pickOfLeaf(questions[k].choice, choices[number[k]]);
  }
}

bool LightSet::sample(const LightChoice& choice, LightSample& out) const {
  if (!(choice.chance > 0.0f)) return false;
  const LightPoint& at = *choice.at;
  bool found = false;
  if (choice.map) {
    found = sampleMap(choice.u, out);
    out.pdf *= choice.chance;
  } else {
    const std::size_t triangles = emitters_.triangles().size();
    found = choice.light < triangles
                ? sampleTriangle(emitters_.triangles()[choice.light], at, choice.onLight,
                                 choice.u.y, out)
                : samplePunctual(punctual_[choice.light - triangles], at, choice.u, out);
    out.pdf *= choice.chance;
    out.pdf *= 1.0f - mapShare(at.cut_);
  }
  return found && out.pdf > 0.0f && maxComponent(out.radiance) > 0.0f;
}

/// One of a leaf's lights: the number that places the sample on it chooses it too, so that samples
/// stay evenly spread over a lamp of two triangles.
void LightSet::pickOfLeaf(const LightTree::Choice& leaf, LightChoice& out) const {
  double first = longNumber(out.u.x, leaf.rest);
  std::uint32_t place = leaf.first;
  while (place + 1 < leaf.first + leaf.count && first >= static_cast<double>(tree_.share(place))) {
    first -= static_cast<double>(tree_.share(place++));
  }
  out.onLight = std::min(first / static_cast<double>(tree_.share(place)), 0x1.fffffffffffffp-1);
  out.light = tree_.light(place);
  out.chance = leaf.chance * tree_.share(place);
  if (out.light < emitters_.triangles().size()) {
    prefetch(&emitters_.triangles()[out.light], sizeof(Emitters::Triangle));
  }
}

bool LightSet::sampleTriangle(const Emitters::Triangle& t, const LightPoint& at, double u, float v,
                              LightSample& out) const {
  const Emitters::Place place = emitters_.sample(t, u, v);
  out.target = place.position;
  const vec3 towards(out.target - at.position_);
  const float distance2 = glm::dot(towards, towards);
  if (!(distance2 > 0.0f)) return false;
  out.distance = std::sqrt(distance2);
  out.direction = towards / out.distance;
  float cosine = -glm::dot(out.direction, t.normal);
  if (emitters_.shinesBack(t)) cosine = std::abs(cosine);
  if (cosine <= 0.0f) return false;
  out.pdf = distance2 * place.density / cosine;
  out.solidAngle = std::min(emitters_.lampArea(t) * cosine / distance2, 2.0f * kPi);
  out.radiance = place.radiance;
  out.normal = t.normal;
  out.emitter = {t.instance, t.cluster, t.triangle};
  out.delta = false;
  return visibility_.keeps(out.target);
}

bool LightSet::samplePunctual(const Punctual& punctual, const LightPoint& at, vec2 u,
                              LightSample& out) const {
  const Light& light = punctual.light;
  out.delta = true;
  out.pdf = 1.0f;
  out.solidAngle = 0.0f;
  if (light.type == Light::Type::kDirectional) {
    out.direction = -light.direction;
    out.distance = kInfinity;
    out.radiance = light.intensity;
    return true;
  }
  out.target = punctual.position;
  if (light.radius > 0.0f) out.target += dvec3(light.radius * uniformSphere(u));
  const vec3 towards(out.target - at.position_);
  const float distance2 = glm::dot(towards, towards);
  if (!(distance2 > 0.0f)) return false;
  out.distance = std::sqrt(distance2);
  out.direction = towards / out.distance;
  out.radiance = light.intensity * (spotFactor(light, -out.direction) *
                                    rangeFactor(light.range, out.distance) / distance2);
  return true;
}

float LightSet::pdfEmitter(const LightPoint& at, const RayHit& hit, float distance,
                           float cosine) const {
  if (!(cosine > 0.0f) || tree_.empty()) return 0.0f;
  const std::uint32_t number = emitters_.find(hit);
  if (number == Emitters::kNotFound) return 0.0f;
  const LightTree::Cut& cut = cutAt(at);
  const float chance = tree_.chance(cut, number) * (1.0f - mapShare(cut));
  const float density = emitters_.density(emitters_.triangles()[number], static_cast<float>(hit.u),
                                          static_cast<float>(hit.v));
  return chance * distance * distance * density / cosine;
}

float LightSet::pdfEnvironment(const LightPoint& at, const vec3& direction) const {
  if (!(mapWeight_ > 0.0f)) return 0.0f;
  return mapShare(cutAt(at)) * mapDensity(direction);
}

}  // namespace trex
