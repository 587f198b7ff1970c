#include "src/crays/lights.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <mutex>

#include "src/crays/microfacet.h"
#include "src/scene/texture.h"

namespace trex {
namespace {

constexpr std::size_t kMostHintedSuns = 4;  // each costs a shadow ray per reader

vec3 meanEmission(const Scene& scene, const Material& material) {
  vec3 mean = material.emission;
  if (material.emissiveTexture.present()) {
    mean *= vec3(
        textureMean(scene.images[static_cast<std::size_t>(material.emissiveTexture.image)], true));
  }
  return mean;
}

/// Falloff of KHR_lights_punctual: 1 inside the inner cone, 0 outside the outer one.
float spotFactor(const Light& light, float cosine) {
  if (light.type != Light::Type::kSpot) return 1.0f;
  const float outer = std::cos(light.outerConeAngle);
  const float scale = 1.0f / std::max(0.001f, std::cos(light.innerConeAngle) - outer);
  const float x = std::clamp((cosine - outer) * scale, 0.0f, 1.0f);
  return x * x;
}

/// Inverse square law, cut smoothly at the range if there is one (KHR_lights_punctual).
float rangeFactor(const Light& light, float distance) {
  if (!std::isfinite(light.range) || light.range <= 0.0f) return 1.0f;
  const float r = distance / light.range;
  return std::clamp(1.0f - r * r * r * r, 0.0f, 1.0f);
}

vec3 uniformSphere(vec2 u) {
  const float z = 1.0f - 2.0f * u.x, r = std::sqrt(std::max(0.0f, 1.0f - z * z));
  return vec3(r * std::cos(2.0f * kPi * u.y), r * std::sin(2.0f * kPi * u.y), z);
}

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

/// Inverse of uniformSphere(), in [0, 1)^2.
vec2 sphereSquare(const vec3& d) {
  const float phi = std::atan2(d.y, d.x) * (0.5f * kInvPi);
  return glm::clamp(vec2(0.5f - 0.5f * d.z, phi < 0.0f ? phi + 1.0f : phi), vec2(0.0f),
                    vec2(0x1.fffffep-1f));
}

std::uint64_t lightKey(std::uint32_t object, std::uint32_t material) {
  return std::uint64_t{object} << 32 | material;
}

std::vector<double> cumulate(const std::vector<double>& weights) {
  std::vector<double> sums(weights.size() + 1, 0.0);
  for (std::size_t i = 0; i < weights.size(); ++i) sums[i + 1] = sums[i] + weights[i];
  return sums;
}

/// Texel weight of a latitude-longitude map: mean luminance of what bilinear look-ups can return
/// near it times the sine, never 0 so that every direction can be sampled.
double texelWeight(const Image& map, int x, int y) {
  const auto at = [&](int px, int py) {
    px = (px + map.width) % map.width;
    py = std::clamp(py, 0, map.height - 1);
    const float* v =
        &map.floats[(static_cast<std::size_t>(py) * static_cast<std::size_t>(map.width) +
                     static_cast<std::size_t>(px)) *
                    3u];
    return static_cast<double>(luminance(vec3(v[0], v[1], v[2])));
  };
  const double value =
      0.5 * at(x, y) + 0.125 * (at(x - 1, y) + at(x + 1, y) + at(x, y - 1) + at(x, y + 1));
  const double sine = std::sin(std::numbers::pi * (y + 0.5) / map.height);
  return value * sine;
}

}  // namespace

namespace {

std::shared_ptr<const MapTables> makeMapTables(const Image& map) {
  const auto width = static_cast<std::size_t>(map.width),
             height = static_cast<std::size_t>(map.height);
  MapTables tables;
  std::vector<double> rows(height, 0.0), weights(width * height);
  tables.columns.assign((width + 1) * height, 0.0);
  double largest = 0.0;
  for (std::size_t y = 0; y < height; ++y) {
    for (std::size_t x = 0; x < width; ++x) {
      weights[y * width + x] = texelWeight(map, static_cast<int>(x), static_cast<int>(y));
      largest = std::max(largest, weights[y * width + x]);
    }
  }
  for (std::size_t y = 0; y < height; ++y) {
    double* row = &tables.columns[y * (width + 1)];
    for (std::size_t x = 0; x < width; ++x) {
      row[x + 1] = row[x] + std::max(weights[y * width + x], 1e-6 * largest);
    }
    rows[y] = row[width];
  }
  tables.rows = cumulate(rows);
  // Texels are (2 pi / w) x (pi / h).
  if (largest > 0.0) {
    tables.power = tables.rows.back() * 2.0 * std::numbers::pi * std::numbers::pi /
                   static_cast<double>(width * height);
  }
  return std::make_shared<const MapTables>(std::move(tables));
}

/// The tables of the map asked for last are kept: they cost more than all else of a light set.
std::shared_ptr<const MapTables> mapTables(const std::shared_ptr<const Image>& map) {
  static std::mutex mutex;
  static std::weak_ptr<const Image> known;
  static std::shared_ptr<const MapTables> tables;
  const std::lock_guard lock(mutex);
  if (!tables || known.lock() != map) {
    tables = makeMapTables(*map);
    known = map;
  }
  return tables;
}

}  // namespace

LightSet::LightSet(const Scene& scene, const dvec3& renderOrigin, const Box3f& bounds,
                   const Visibility& visibility)
    : environment_(scene.environment),
      mapSine_(std::sin(scene.environment.rotation)),
      mapCosine_(std::cos(scene.environment.rotation)),
      visibility_(visibility) {
  // Above this the power of a sky overflows single precision.
  environment_.color = glm::min(environment_.color, vec3(1e30f));
  if (!bounds.empty()) {
    centre_ = bounds.centre();
    radius_ = std::max(0.5f * glm::length(bounds.size()), 1e-20f);
  }
  for (const Material& m : scene.materials) {
    materialRadiance_.push_back(m.unlit ? vec3(0.0f) : meanEmission(scene, m));
    materialTwoSided_.push_back(m.doubleSided);
  }
  addLuminaires(scene, renderOrigin);
  addPunctual(scene, renderOrigin);
  addEnvironment(scene);
  if (std::any_of(scene.media.begin(), scene.media.end(),
                  [](const Medium& m) { return m.emits(); })) {
    media_ = Media::make(scene, renderOrigin);
    if (media_ && media_->power() > 0.0) sources_.push_back({Kind::kMedia, 0, media_->power()});
  }

  std::vector<double> weights;
  for (const Entry& e : lights_) weights.push_back(e.power);
  lightCumulative_ = cumulate(weights);
  weights.clear();
  for (const Entry& e : sources_) weights.push_back(e.power);
  sourceCumulative_ = cumulate(weights);
  totalPower_ = sourceCumulative_.back();
  if (!(lightCumulative_.back() > 0.0)) lights_.clear();
}

void LightSet::addLuminaires(const Scene& scene, const dvec3& renderOrigin) {
  for (const Instance& i : scene.instances) {
    addLuminaire(scene.meshes[static_cast<std::size_t>(i.mesh)], i, renderOrigin);
  }
  for (const Scene::AddedEmitter& e : scene.addedEmitters) {
    Instance instance;
    instance.object = e.object;
    addLuminaire(e.mesh, instance, renderOrigin);
  }
  emitterCumulative_.assign(1, 0.0);
  for (const Emitter& e : emitters_) {
    emitterCumulative_.push_back(emitterCumulative_.back() + static_cast<double>(e.area));
  }
  for (const Luminaire& l : luminaires_) {
    const double sides = materialTwoSided_[l.material] ? 2.0 : 1.0;
    const double power =
        std::numbers::pi * l.area * sides * luminance(materialRadiance_[l.material]);
    const auto index = static_cast<std::uint32_t>(lights_.size());
    luminaireOf_[lightKey(l.object, l.material)] = index;
    lights_.push_back({Kind::kLuminaire, index, power});
  }
  sources_ = lights_;
}

/// The triangles of one instance; an object of several meshes of one material is one luminaire.
void LightSet::addLuminaire(const Mesh& mesh, const Instance& instance, const dvec3& renderOrigin) {
  const auto material = static_cast<std::uint32_t>(mesh.material);
  const auto object = static_cast<std::uint32_t>(instance.object);
  if (luminance(materialRadiance_[material]) <= 0.0f || !visibility_.shows(object)) return;
  const float flip = glm::determinant(glm::dmat3(instance.transform)) < 0.0 ? -1.0f : 1.0f;
  const auto place = [&](std::uint32_t v) {
    const dvec3 local = mesh.origin + dvec3(mesh.positions[v]);
    return dvec3(instance.transform * glm::dvec4(local, 1.0)) - renderOrigin;
  };
  Luminaire luminaire{static_cast<std::uint32_t>(emitters_.size()),
                      0,
                      object,
                      material,
                      vec3(0.0f),
                      vec3(0.0f),
                      0.0f,
                      0.0f};
  Box3f bounds;
  for (const glm::uvec3& t : mesh.triangles) {
    const dvec3 a = place(t.x);
    const vec3 b(place(t.y) - a), c(place(t.z) - a);
    const vec3 cross = glm::cross(b, c);
    const float twice = glm::length(cross);
    if (!(twice > 0.0f)) continue;
    emitters_.push_back({a, b, c, cross * (flip / twice), 0.5f * twice});
    luminaire.area += 0.5f * twice;
    luminaire.meanNormal += cross * (0.5f * flip);
    for (const vec3& p : {vec3(0.0f), b, c}) bounds.extend(vec3(a + dvec3(p)));
    ++luminaire.count;
  }
  if (luminaire.count == 0) return;
  luminaire.centre = bounds.centre();
  luminaire.radius = 0.5f * glm::length(bounds.size());
  luminaire.meanNormal /= luminaire.area;
  const bool continues = !luminaires_.empty() && luminaires_.back().object == object &&
                         luminaires_.back().material == material;
  if (!continues) {
    luminaires_.push_back(luminaire);
    return;
  }
  Luminaire& whole = luminaires_.back();
  const float distance = 0.5f * glm::length(luminaire.centre - whole.centre);
  whole.centre = 0.5f * (whole.centre + luminaire.centre);
  whole.radius = distance + std::max(whole.radius, luminaire.radius);
  whole.meanNormal = (whole.meanNormal * whole.area + luminaire.meanNormal * luminaire.area) /
                     (whole.area + luminaire.area);
  whole.area += luminaire.area;
  whole.count += luminaire.count;
}

void LightSet::addPunctual(const Scene& scene, const dvec3& renderOrigin) {
  for (const Light& light : scene.lights) {
    const double intensity = luminance(light.intensity);
    if (!(intensity > 0.0)) continue;
    double power = 4.0 * std::numbers::pi * intensity;
    if (light.type == Light::Type::kSpot) {
      power = 2.0 * std::numbers::pi * (1.0 - std::cos(light.outerConeAngle)) * intensity;
    } else if (light.type == Light::Type::kDirectional) {
      power = std::numbers::pi * radius_ * radius_ * intensity;
    }
    const Entry entry{Kind::kPunctual, static_cast<std::uint32_t>(punctual_.size()), power};
    punctual_.push_back({light, light.position - renderOrigin});
    lights_.push_back(entry);
    sources_.push_back(entry);
  }
}

void LightSet::addEnvironment(const Scene& scene) {
  const double disk =
      std::numbers::pi * radius_ * radius_;  // what a parallel beam sees of the sphere
  if (scene.environment.map) {
    map_ = mapTables(scene.environment.map);
    mapPower_ = map_->power * luminance(environment_.color);
    if (mapPower_ > 0.0) {
      const Entry entry{Kind::kMap, 0, disk * mapPower_};
      lights_.push_back(entry);
      sources_.push_back(entry);
    }
  } else if (luminance(environment_.color) > 0.0f) {
    const double all = 4.0 * std::numbers::pi * luminance(environment_.color);
    sources_.push_back({Kind::kConstant, 0, disk * all});
  }
}

std::size_t LightSet::pick(const std::vector<double>& cumulative, float u, float& remapped) {
  const double target = static_cast<double>(u) * cumulative.back();
  const auto at = std::upper_bound(cumulative.begin() + 1, cumulative.end() - 1, target);
  const auto index = static_cast<std::size_t>(at - cumulative.begin()) - 1;
  const double width = cumulative[index + 1] - cumulative[index];
  remapped = width > 0.0 ? static_cast<float>((target - cumulative[index]) / width) : 0.5f;
  remapped = std::clamp(remapped, 0.0f, 0x1.fffffep-1f);
  return index;
}

/// About the irradiance (luminance) that a light gives at a point; above 0 wherever it can be.
float LightSet::weigh(const Entry& entry, const vec3& point) const {
  switch (entry.kind) {
    case Kind::kLuminaire: {
      const Luminaire& l = luminaires_[entry.index];
      const vec3 away = point - l.centre;
      const float distance2 = glm::dot(away, away);
      // Within its own size a light may be anywhere around: the distance counts from its border.
      const float near2 = std::max(distance2, 0.25f * l.radius * l.radius + 0.1f * l.area);
      float facing = 1.0f;
      if (!materialTwoSided_[l.material] && distance2 > l.radius * l.radius) {
        const float spread = 1.0f - glm::length(l.meanNormal) + l.radius / std::sqrt(distance2);
        const float cosine = glm::dot(away, l.meanNormal) / std::sqrt(distance2);
        facing = std::clamp(cosine + spread, 0.05f, 1.0f);
      }
      return luminance(materialRadiance_[l.material]) * l.area * facing / near2;
    }
    case Kind::kPunctual: {
      const Punctual& p = punctual_[entry.index];
      const float intensity = luminance(p.light.intensity);
      if (p.light.type == Light::Type::kDirectional) return intensity;
      const vec3 away(dvec3(point) - p.position);
      return intensity / std::max(glm::dot(away, away), 1e-8f * radius_ * radius_);
    }
    case Kind::kMap:
      return static_cast<float>(mapPower_);
    case Kind::kConstant:
    case Kind::kMedia:
      break;
  }
  return 0.0f;
}

/// Chooses a light for a point: its number, the chance of that, and u made uniform again.
std::size_t LightSet::choose(const vec3& point, float& u, float& chance) const {
  const std::size_t count = lights_.size();
  if (count == 1) {
    chance = 1.0f;
    return 0;
  }
  if (count > kMostWeighed) {
    const std::size_t index = pick(lightCumulative_, u, u);
    chance = static_cast<float>(lights_[index].power / lightCumulative_.back());
    return index;
  }
  float weights[kMostWeighed] = {}, sum = 0.0f;
  for (std::size_t i = 0; i < count; ++i) sum += weights[i] = weigh(lights_[i], point);
  float target = u * sum;
  std::size_t index = 0;
  while (index + 1 < count && target >= weights[index]) target -= weights[index++];
  chance = weights[index] / sum;
  u = std::clamp(target / weights[index], 0.0f, 0x1.fffffep-1f);
  return index;
}

float LightSet::chanceOf(std::size_t light, const vec3& point) const {
  if (lights_.size() == 1) return 1.0f;
  if (lights_.size() > kMostWeighed) {
    return static_cast<float>(lights_[light].power / lightCumulative_.back());
  }
  float sum = 0.0f;
  for (const Entry& entry : lights_) sum += weigh(entry, point);
  return weigh(lights_[light], point) / sum;
}

bool LightSet::sample(const dvec3& point, Sampler& sampler, LightSample& out) const {
  float choice = sampler.next1D(), chance = 1.0f;
  const vec2 u = sampler.next2D();
  const Entry& entry = lights_[choose(vec3(point), choice, chance)];
  bool found = false;
  switch (entry.kind) {
    case Kind::kLuminaire:
      found = sampleLuminaire(luminaires_[entry.index], point, u, out);
      break;
    case Kind::kPunctual:
      found = samplePunctual(punctual_[entry.index], point, u, out);
      break;
    case Kind::kMap:
      found = sampleMap(u, out);
      break;
    case Kind::kConstant:
    case Kind::kMedia:
      break;
  }
  out.pdf *= chance;
  return found && out.pdf > 0.0f && maxComponent(out.radiance) > 0.0f;
}

/// A triangle of a luminaire in proportion to area; u is made uniform again.
const LightSet::Emitter& LightSet::pickEmitter(const Luminaire& luminaire, float& u) const {
  const auto begin = emitterCumulative_.begin() + luminaire.first;
  const auto end = begin + luminaire.count;
  const double target = *begin + static_cast<double>(u) * (*end - *begin);
  const auto at = std::upper_bound(begin + 1, end, target) - 1;
  u = std::clamp(static_cast<float>((target - *at) / (*(at + 1) - *at)), 0.0f, 0x1.fffffep-1f);
  return emitters_[static_cast<std::size_t>(at - emitterCumulative_.begin())];
}

bool LightSet::sampleLuminaire(const Luminaire& luminaire, const dvec3& point, vec2 u,
                               LightSample& out) const {
  const Emitter& emitter = pickEmitter(luminaire, u.x);
  const float root = std::sqrt(u.x);
  out.target = emitter.at(root * (1.0f - u.y), root * u.y);
  const vec3 towards(out.target - point);
  const float distance2 = glm::dot(towards, towards);
  if (!(distance2 > 0.0f)) return false;
  out.distance = std::sqrt(distance2);
  out.direction = towards / out.distance;
  float cosine = -glm::dot(out.direction, emitter.normal);
  if (materialTwoSided_[luminaire.material]) cosine = std::abs(cosine);
  if (cosine <= 0.0f) return false;
  out.pdf = distance2 / (cosine * luminaire.area);
  out.solidAngle = std::min(luminaire.area * cosine / distance2, 2.0f * kPi);
  out.radiance = materialRadiance_[luminaire.material];
  out.delta = false;
  return visibility_.keeps(out.target);
}

bool LightSet::samplePunctual(const Punctual& punctual, const dvec3& point, vec2 u,
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
  const vec3 towards(out.target - point);
  const float distance2 = glm::dot(towards, towards);
  if (!(distance2 > 0.0f)) return false;
  out.distance = std::sqrt(distance2);
  out.direction = towards / out.distance;
  out.radiance = light.intensity * (spotFactor(light, -glm::dot(out.direction, light.direction)) *
                                    rangeFactor(light, out.distance) / distance2);
  return true;
}

/// Undoes the map's rotation about +y.
vec3 LightSet::toMap(const vec3& d) const {
  return vec3(mapCosine_ * d.x - mapSine_ * d.z, d.y, mapSine_ * d.x + mapCosine_ * d.z);
}
vec3 LightSet::fromMap(const vec3& d) const {
  return vec3(mapCosine_ * d.x + mapSine_ * d.z, d.y, mapCosine_ * d.z - mapSine_ * d.x);
}

/// Direction of map coordinates: row 0 is +y; u = 0.5 + atan2(x, -z) / (2 pi), as environment()
/// reads.
vec3 LightSet::mapDirection(vec2 u, float& pdf) const {
  const auto width = static_cast<std::size_t>(environment_.map->width);
  const auto height = static_cast<std::size_t>(environment_.map->height);
  float v = 0.0f, w = 0.0f;
  const std::size_t y = pick(map_->rows, u.x, v);
  const double* row = &map_->columns[y * (width + 1)];
  const double target = static_cast<double>(u.y) * row[width];
  const double* at = std::upper_bound(row + 1, row + width, target);
  const auto x = static_cast<std::size_t>(at - row) - 1;
  w = std::clamp(static_cast<float>((target - row[x]) / (row[x + 1] - row[x])), 0.0f,
                 0x1.fffffep-1f);
  const float theta = kPi * (static_cast<float>(y) + v) / static_cast<float>(height);
  const float phi = 2.0f * kPi * ((static_cast<float>(x) + w) / static_cast<float>(width) - 0.5f);
  const float sine = std::sin(theta);
  const double chance = (row[x + 1] - row[x]) / map_->rows.back();
  pdf = static_cast<float>(chance * static_cast<double>(width * height) /
                           (2.0 * std::numbers::pi * std::numbers::pi * std::max(sine, 1e-6f)));
  return fromMap(vec3(sine * std::sin(phi), std::cos(theta), -sine * std::cos(phi)));
}

bool LightSet::sampleMap(vec2 u, LightSample& out) const {
  out.direction = mapDirection(u, out.pdf);
  // The density as a ray that finds this direction by chance would compute it, rounding included.
  out.pdf = mapDensity(out.direction);
  out.distance = kInfinity;
  out.radiance = environment(out.direction);
  out.delta = false;
  out.solidAngle = 2.0f * kPi;
  return true;
}

float LightSet::pdfEmitter(const vec3& point, std::uint32_t object, std::uint32_t material,
                           float distance, float cosine) const {
  if (lights_.empty() || cosine <= 0.0f) return 0.0f;
  const auto found = luminaireOf_.find(lightKey(object, material));
  if (found == luminaireOf_.end()) return 0.0f;
  const float area = luminaires_[found->second].area;
  return chanceOf(found->second, point) * distance * distance / (cosine * area);
}

float LightSet::pdfEnvironment(const vec3& point, const vec3& direction) const {
  if (mapPower_ <= 0.0 || lights_.empty()) return 0.0f;
  return chanceOf(lights_.size() - 1, point) * mapDensity(direction);  // the map is the last light
}

/// Density per solid angle of sampleMap().
float LightSet::mapDensity(const vec3& worldDirection) const {
  const vec3 direction = toMap(worldDirection);
  const auto width = static_cast<std::size_t>(environment_.map->width);
  const auto height = static_cast<std::size_t>(environment_.map->height);
  const float sine = std::hypot(direction.x, direction.z);
  const float theta = std::atan2(sine, direction.y);
  const float phi = std::atan2(direction.x, -direction.z);
  const auto cell = [](float x, std::size_t n) {
    return std::min(static_cast<std::size_t>(std::max(x, 0.0f) * static_cast<float>(n)), n - 1);
  };
  const std::size_t y = cell(theta * kInvPi, height), x = cell(0.5f + phi * 0.5f * kInvPi, width);
  const double* row = &map_->columns[y * (width + 1)];
  const double chance = (row[x + 1] - row[x]) / map_->rows.back();
  return static_cast<float>(
      chance * static_cast<double>(width * height) /
      (2.0 * std::numbers::pi * std::numbers::pi * std::max(static_cast<double>(sine), 1e-6)));
}

vec3 LightSet::environment(const vec3& worldDirection) const {
  if (!environment_.map) return environment_.color;
  const vec3 direction = toMap(worldDirection);
  const float theta = std::atan2(std::hypot(direction.x, direction.z), direction.y);
  const float phi = std::atan2(direction.x, -direction.z);
  Texture lookUp;
  lookUp.wrapT = Texture::Wrap::kClamp;
  const vec2 uv(0.5f + phi * 0.5f * kInvPi, theta * kInvPi);
  return environment_.color * vec3(sampleTexture(*environment_.map, lookUp, uv, false));
}

float LightSet::largestPhotonPower() const {
  float largest = 0.0f;
  for (const Entry& e : sources_) {
    vec3 color(1.0f);
    if (e.kind == Kind::kLuminaire) color = materialRadiance_[luminaires_[e.index].material];
    if (e.kind == Kind::kPunctual) color = punctual_[e.index].light.intensity;
    if (e.kind == Kind::kConstant) color = environment_.color;
    float brightest = maxComponent(color) / std::max(luminance(color), 1e-30f);
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
    case Kind::kLuminaire:
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
  float unused = 0.0f;
  const std::size_t index = pick(sourceCumulative_, sampler.next1D(), unused);
  const Entry& entry = sources_[index];
  out.source = static_cast<std::uint32_t>(index);
  if (outsideDimensions(entry) > 0) {
    emitOutside(entry, sampler, guides, out);
  } else if (entry.kind == Kind::kLuminaire) {
    emitLuminaire(luminaires_[entry.index], sampler, out);
  } else if (entry.kind == Kind::kMedia) {
    media_->emit(sampler, out.start.position, out.direction, out.power);
    out.scatters = false;
  } else {
    emitPunctual(punctual_[entry.index], sampler, out);
  }
  out.power *= static_cast<float>(totalPower_ / entry.power);
  if (entry.kind == Kind::kLuminaire && !visibility_.keeps(out.start.position)) return false;
  return isFinite(out.power) && maxComponent(out.power) > 0.0f;
}

void LightSet::emitLuminaire(const Luminaire& luminaire, Sampler& sampler,
                             EmittedPhoton& out) const {
  vec2 u = sampler.next2D();
  const Emitter& emitter = pickEmitter(luminaire, u.x);
  vec2 d = sampler.next2D();
  const float root = std::sqrt(u.x);
  out.start = RayStart(emitter.at(root * (1.0f - u.y), root * u.y), RayStart::On::kSource);
  vec3 normal = emitter.normal;
  float sides = 1.0f;
  if (materialTwoSided_[luminaire.material]) {
    sides = 2.0f;
    d.x *= 2.0f;
    if (d.x >= 1.0f) {
      d.x -= 1.0f;
      normal = -normal;
    }
  }
  out.direction = Basis(normal).toWorld(cosineSample(d));
  out.power = materialRadiance_[luminaire.material] * (kPi * luminaire.area * sides);
}

void LightSet::emitPunctual(const Punctual& punctual, Sampler& sampler, EmittedPhoton& out) const {
  const Light& light = punctual.light;
  out.start = punctual.position;
  const vec2 u = sampler.next2D();
  if (light.radius > 0.0f) {
    out.start.position += dvec3(light.radius * uniformSphere(sampler.next2D()));
  }
  if (light.type == Light::Type::kSpot) {
    const float cosine = 1.0f - u.x * (1.0f - std::cos(light.outerConeAngle));
    const float sine = std::sqrt(std::max(0.0f, 1.0f - cosine * cosine)), phi = 2.0f * kPi * u.y;
    out.direction =
        Basis(light.direction).toWorld(vec3(sine * std::cos(phi), sine * std::sin(phi), cosine));
    out.power = light.intensity *
                (2.0f * kPi * (1.0f - std::cos(light.outerConeAngle)) * spotFactor(light, cosine));
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

/// Inverse of mapDirection().
vec2 LightSet::mapPlace(const vec3& worldDirection) const {
  const vec3 direction = toMap(worldDirection);
  const auto width = static_cast<std::size_t>(environment_.map->width);
  const auto height = static_cast<std::size_t>(environment_.map->height);
  const auto place = [](const double* sums, std::size_t n, double x) {
    const double at = std::clamp(x, 0.0, 1.0) * static_cast<double>(n);
    const std::size_t i = std::min(static_cast<std::size_t>(at), n - 1);
    const double inside = sums[i] + (at - static_cast<double>(i)) * (sums[i + 1] - sums[i]);
    return static_cast<float>(inside / sums[n]);
  };
  const float theta = std::atan2(std::hypot(direction.x, direction.z), direction.y);
  const float phi = std::atan2(direction.x, -direction.z);
  const double y = static_cast<double>(theta * kInvPi);
  const double x = static_cast<double>(0.5f + phi * 0.5f * kInvPi);
  const std::size_t row =
      std::min(static_cast<std::size_t>(y * static_cast<double>(height)), height - 1);
  return vec2(place(map_->rows.data(), height, y),
              place(&map_->columns[row * (width + 1)], width, x));
}

void LightSet::hint(const ImportanceMap& importance, const ClearLayers& layers,
                    std::span<EmissionGuide> guides) const {
  std::size_t suns = 0;
  for (std::size_t i = 0; i < guides.size(); ++i) {
    const Entry& source = sources_[i];
    if (guides[i].dimensions() == 4) hintSky(source, importance, guides[i]);
    if (guides[i].dimensions() == 2 && suns++ < kMostHintedSuns) {
      hintSun(punctual_[source.index].light.direction, importance, layers, guides[i]);
    }
    guides[i].update();
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

void LightSet::hintSun(const vec3& towards, const ImportanceMap& importance,
                       const ClearLayers& layers, EmissionGuide& guide) const {
  const auto& readers = importance.readers();
  std::vector<std::uint8_t> lit(readers.size(), 0);
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, readers.size(), 256),
                    [&](const auto& range) {
                      for (std::size_t i = range.begin(); i < range.end(); ++i) {
                        lit[i] = glm::dot(readers[i].normal, towards) < 0.0f &&
                                 layers.connect(readers[i].start, -towards).reaches();
                      }
                    });
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
