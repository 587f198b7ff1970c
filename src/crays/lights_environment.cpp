// The environment as a light: directions of a latitude-longitude map in proportion to its radiance.
#include <algorithm>
#include <cmath>
#include <mutex>

#include "src/crays/lights.h"
#include "src/crays/lights_detail.h"
#include "src/scene/texture.h"

namespace trex {
namespace {

/// Texel weight of a latitude-longitude map: mean luminance of what bilinear look-ups return within
/// it, those that its corners mix in too, times the sine.
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
  // Along an axis the texel itself counts 3/4 in the mean, either neighbour 1/8.
  const auto row = [&](int py) {
    return 0.75 * at(x, py) + 0.125 * (at(x - 1, py) + at(x + 1, py));
  };
  const double value = 0.75 * row(y) + 0.125 * (row(y - 1) + row(y + 1));
  const double sine = std::sin(std::numbers::pi * (y + 0.5) / map.height);
  return value * sine;
}

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

void LightSet::addEnvironment(const Scene& scene) {
  const double disk =
      std::numbers::pi * radius_ * radius_;  // what a parallel beam sees of the sphere
  if (scene.environment.map) {
    map_ = mapTables(scene.environment.map);
    mapPower_ = map_->power * luminance(environment_.color);
    if (mapPower_ > 0.0) sources_.push_back({Kind::kMap, 0, disk * mapPower_});
  } else if (luminance(environment_.color) > 0.0f) {
    const double all = 4.0 * std::numbers::pi * luminance(environment_.color);
    sources_.push_back({Kind::kConstant, 0, disk * all});
  }
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
  double inside = 0.0;
  const std::size_t y = pick(map_->rows, u.x, inside);
  const auto v = static_cast<float>(inside);
  const double* row = &map_->columns[y * (width + 1)];
  const double target = static_cast<double>(u.y) * row[width];
  const double* at = std::upper_bound(row + 1, row + width, target);
  const auto x = static_cast<std::size_t>(at - row) - 1;
  const float w = std::clamp(static_cast<float>((target - row[x]) / (row[x + 1] - row[x])), 0.0f,
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

}  // namespace trex
