// Photons: light sources chosen in proportion to their power.
#include <algorithm>
#include <cmath>

#include "src/crays/lights.h"
#include "src/crays/lights_detail.h"
#include "src/crays/microfacet.h"

namespace trex {
namespace {

constexpr std::size_t kMostHintedSuns = 4;  // each costs a shadow ray per reader
constexpr float kSmallPart = 0.5f;          // of the scene's radius
constexpr std::uint32_t kWideSkyHints = 1u << 14, kWideSunHints = 1u << 10;

/// The unit square onto the unit disk, areas and neighbourhoods kept [Shirley and Chiu 1997], so
/// that boxes of a guide stay compact.
vec2 concentricDisk(vec2 u) {
  const vec2 p = 2.0f * u - 1.0f;
  if (p.x == 0.0f && p.y == 0.0f) return vec2(0.0f);
  const bool wide = std::abs(p.x) > std::abs(p.y);
  const float r = wide ? p.x : p.y;
  const float angle = wide ? 0.25f * kPi * (p.y / p.x) : 0.5f * kPi - 0.25f * kPi * (p.x / p.y);
  return r * vec2(std::cos(angle), std::sin(angle));
}

/// Inverse of concentricDisk(), in [0, 1)^2.
vec2 squareOfDisk(vec2 d) {
  const float length = glm::length(d);
  vec2 p(0.0f);
  if (std::abs(d.x) > std::abs(d.y)) {
    p.x = std::copysign(length, d.x);
    p.y = p.x * (4.0f * kInvPi) * std::atan(d.y / d.x);
  } else if (d.y != 0.0f) {
    p.y = std::copysign(length, d.y);
    p.x = p.y * (4.0f * kInvPi) * std::atan(d.x / d.y);
  }
  return glm::clamp(0.5f + 0.5f * p, vec2(0.0f), vec2(0x1.fffffep-1f));
}

/// The radius of a ball around the readers' median place that holds nine in ten of them with some
/// room; those that importons found outside, through a window, do not count. Infinite without any.
float ballOf(const std::vector<ImportanceMap::Reader>& readers, vec3& middle) {
  if (readers.empty()) return kInfinity;
  std::vector<float> values(readers.size());
  const auto nth = [&](std::size_t n) {
    std::nth_element(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(n), values.end());
    return values[n];
  };
  for (int axis = 0; axis < 3; ++axis) {
    std::transform(readers.begin(), readers.end(), values.begin(), [&](const auto& reader) {
      return static_cast<float>(reader.start.position[axis]);
    });
    middle[axis] = nth(values.size() / 2);
  }
  std::transform(readers.begin(), readers.end(), values.begin(), [&](const auto& reader) {
    return glm::length(vec3(reader.start.position) - middle);
  });
  return 1.25f * nth(values.size() * 9 / 10);
}

/// Inverse of uniformSphere(), in [0, 1)^2.
vec2 sphereSquare(const vec3& d) {
  const float phi = std::atan2(d.y, d.x) * (0.5f * kInvPi);
  return glm::clamp(vec2(0.5f - 0.5f * d.z, phi < 0.0f ? phi + 1.0f : phi), vec2(0.0f),
                    vec2(0x1.fffffep-1f));
}

}  // namespace

float LightSet::largestPhotonPower() const {
  float largest = 0.0f;
  for (const Entry& e : sources_) {
    vec3 color(1.0f);
    if (e.kind == Kind::kPunctual) color = punctual_[e.index].light.intensity;
    if (e.kind == Kind::kConstant) color = environment_.color;
    float brightest = maxComponent(color) / std::max(luminance(color), 1e-30f);
    if (e.kind == Kind::kEmitters) brightest = emitters_.largestRatio();
    if (e.kind == Kind::kMedia) brightest = media_->largestChannel() / static_cast<float>(e.power);
    // A map's photons differ from each other by what bilinear filtering and colours add.
    const float guided = outsideDimensions(e) > 0 ? 1.0f / EmissionGuide::kUniformShare : 1.0f;
    largest = std::max(largest, (e.kind == Kind::kMap ? 64.0f : brightest) * guided);
  }
  return largest * static_cast<float>(totalPower_);
}

/// Dimensions of a source's primary sample space if it shines from outside, else 0.
int LightSet::outsideDimensions(const Entry& source) const {
  switch (source.kind) {
    case Kind::kEmitters:
    case Kind::kMedia:
      return 0;
    case Kind::kPunctual:
      return punctual_[source.index].light.type == Light::Type::kDirectional ? 2 : 0;
    case Kind::kMap:
    case Kind::kConstant:
      return 4;
  }
  return 0;
}

std::vector<EmissionGuide> LightSet::guides() const {
  std::vector<EmissionGuide> guides;
  bool any = false;
  for (const Entry& e : sources_) {
    guides.emplace_back(outsideDimensions(e));
    any |= guides.back().dimensions() > 0;
  }
  return any ? guides : std::vector<EmissionGuide>{};
}

bool LightSet::emit(Sampler& sampler, EmittedPhoton& out,
                    std::span<const EmissionGuide> guides) const {
  if (!(totalPower_ > 0.0)) return false;
  double rest = 0.0;
  const std::size_t index = pick(sourceCumulative_, longNumber(sampler.next2D()), rest);
  const Entry& entry = sources_[index];
  out.source = static_cast<std::uint32_t>(index);
  if (outsideDimensions(entry) > 0) {
    emitOutside(entry, sampler, guides, out);
  } else if (entry.kind == Kind::kEmitters) {
    emitTriangle(rest, sampler, out);
  } else if (entry.kind == Kind::kMedia) {
    media_->emit(sampler, out.start.position, out.direction, out.power);
    out.scatters = false;
  } else {
    emitPunctual(punctual_[entry.index], sampler, out);
  }
  out.power *= static_cast<float>(totalPower_ / entry.power);
  if (entry.kind == Kind::kEmitters && !visibility_.keeps(out.start.position)) return false;
  return isFinite(out.power) && maxComponent(out.power) > 0.0f;
}

/// From a triangle in proportion to its power. `choice`: in [0, 1).
void LightSet::emitTriangle(double choice, Sampler& sampler, EmittedPhoton& out) const {
  double rest = 0.0;
  const Emitters::Triangle& t = emitters_.triangles()[pick(emitterCumulative_, choice, rest)];
  const vec2 u = sampler.next2D();
  vec2 d = sampler.next2D();
  const Emitters::Place place = emitters_.sample(t, longNumber(u.x, rest), u.y);
  vec3 normal = t.normal;
  if (emitters_.shinesBack(t)) {
    d.x *= 2.0f;
    if (d.x >= 1.0f) {
      d.x -= 1.0f;
      normal = -normal;
    }
  }
  out.direction = Basis(normal).toWorld(cosineSample(d));
  out.start = RayStart(place.position, RayStart::On::kSource);
  const double density =
      static_cast<double>(place.density) * emitterPower(t) / emitterCumulative_.back();
  out.power = place.radiance * static_cast<float>(std::numbers::pi * sidesOf(t) / density);
}

void LightSet::emitPunctual(const Punctual& punctual, Sampler& sampler, EmittedPhoton& out) const {
  const Light& light = punctual.light;
  out.start = punctual.position;
  out.range = light.range;
  const vec2 u = sampler.next2D();
  if (light.radius > 0.0f) {
    out.start.position += dvec3(light.radius * uniformSphere(sampler.next2D()));
  }
  if (light.type == Light::Type::kSpot) {
    const vec3 local = coneDirection(light, u);
    out.direction = Basis(light.direction).toWorld(local);
    out.power = light.intensity * (2.0f * kPi * coneVersine(light) *
                                   spotFactor(light, local.z, u.x * coneVersine(light)));
    return;
  }
  out.direction = uniformSphere(u);
  out.power = light.intensity * (4.0f * kPi);
}

/// A photon of the sky, the map or a sun, started where its guide says.
void LightSet::emitOutside(const Entry& source, Sampler& sampler,
                           std::span<const EmissionGuide> guides, EmittedPhoton& out) const {
  const bool sky = source.kind != Kind::kPunctual;
  const vec2 first = sampler.next2D();
  const vec2 second = sky ? sampler.next2D() : vec2(0.0f);
  out.primary = sky ? vec4(second, first) : vec4(first, second);
  out.density = 1.0f;
  if (out.source < guides.size()) {
    out.density = guides[out.source].warp(sampler.next1D(), out.primary);
  }
  const vec2 disk(out.primary.x, out.primary.y), direction(out.primary.z, out.primary.w);
  const float area = kPi * radius_ * radius_;
  if (source.kind == Kind::kPunctual) {
    const Light& light = punctual_[source.index].light;
    emitFromSphere(light.direction, disk, out);
    out.power = light.intensity * area;
  } else if (source.kind == Kind::kMap) {
    float pdf = 0.0f;
    const vec3 from = mapDirection(direction, pdf);
    emitFromSphere(-from, disk, out);
    out.power = environment(from) * (area / pdf);
  } else {
    emitFromSphere(uniformSphere(direction), disk, out);
    out.power = environment_.color * (4.0f * kPi * area);
  }
  out.power /= out.density;
}

/// The place on the disk, in the unit square, that a photon to `point` starts from.
vec2 LightSet::diskPlace(const vec3& towards, const vec3& point) const {
  const vec3 p = Basis(towards).toLocal((point - centre_) / radius_);
  return squareOfDisk(vec2(p.x, p.y));
}

void LightSet::hint(const ImportanceMap& importance, const SunSeers& seers,
                    std::span<EmissionGuide> guides) const {
  std::size_t suns = 0;
  for (std::size_t i = 0; i < guides.size(); ++i) {
    const Entry& source = sources_[i];
    if (guides[i].dimensions() == 4) hintSky(source, importance, guides[i]);
    if (guides[i].dimensions() == 2 && suns++ < kMostHintedSuns) {
      hintSun(punctual_[source.index].light.direction, importance, seers, guides[i]);
    }
    if (guides[i].dimensions() > 0) hintWanted(source, importance, guides[i]);
    guides[i].update();
  }
}

/// All that leads into the ball that holds most readers, if that is small: a room in a city.
void LightSet::hintWanted(const Entry& source, const ImportanceMap& importance,
                          EmissionGuide& guide) const {
  vec3 middle;
  const float share = ballOf(importance.readers(), middle) / radius_;
  if (!(share < kSmallPart)) return;
  const bool sky = source.kind != Kind::kPunctual;
  for (std::uint32_t i = 0; i < (sky ? kWideSkyHints : kWideSunHints); ++i) {
    Sampler sampler(0x77696465u, i, 0);
    const vec2 place = share * concentricDisk(sampler.next2D()), direction = sampler.next2D();
    float pdf = 0.0f;
    const vec3 towards = !sky                        ? punctual_[source.index].light.direction
                         : source.kind == Kind::kMap ? -mapDirection(direction, pdf)
                                                     : uniformSphere(direction);
    const vec3 at = Basis(towards).toLocal((middle - centre_) / radius_);
    guide.hintWide(vec4(squareOfDisk(vec2(at.x, at.y) + place), sky ? direction : vec2(0.0f)));
  }
}

/// Escapes are uniform in solid angle times area, as photons of a constant sky are; a map's photons
/// are denser where the map is bright, and each hint then stands for more of primary space.
void LightSet::hintSky(const Entry& source, const ImportanceMap& importance,
                       EmissionGuide& guide) const {
  for (const ImportanceMap::Escape& e : importance.escapes()) {
    const vec2 disk = diskPlace(-e.direction, e.origin);
    if (source.kind == Kind::kMap) {
      guide.hint(vec4(disk, mapPlace(e.direction)), e.visits * mapDensity(e.direction));
    } else {
      guide.hint(vec4(disk, sphereSquare(-e.direction)), e.visits);
    }
  }
}

void LightSet::hintSun(const vec3& towards, const ImportanceMap& importance, const SunSeers& seers,
                       EmissionGuide& guide) const {
  const auto& readers = importance.readers();
  const std::vector<std::uint8_t> lit = seers(towards);
  for (std::size_t i = 0; i < readers.size(); ++i) {
    if (!lit[i]) continue;
    const float cosine = -glm::dot(readers[i].normal, towards);
    guide.hint(vec4(diskPlace(towards, vec3(readers[i].start.position)), 0.0f, 0.0f),
               readers[i].visits * cosine);
  }
}

/// A photon through the disk that the sphere around the scene shows to `towards`.
void LightSet::emitFromSphere(const vec3& towards, vec2 u, EmittedPhoton& out) const {
  const vec2 d = radius_ * concentricDisk(u);
  const Basis basis(towards);
  out.direction = towards;
  out.start = centre_ + basis.tangent * d.x + basis.bitangent * d.y - towards * (radius_ * 1.001f);
}

}  // namespace trex
