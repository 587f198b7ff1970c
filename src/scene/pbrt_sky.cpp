#include "src/scene/pbrt_sky.h"

#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <numbers>

namespace trex::detail {
namespace {

constexpr double kTurn = 2.0 * std::numbers::pi;

/// World direction of a place on our latitude-longitude map, both in [0, 1].
dvec3 directionAt(double x, double y) {
  const double theta = std::numbers::pi * y, phi = kTurn * (x - 0.5);
  return {std::sin(theta) * std::sin(phi), std::cos(theta), -std::sin(theta) * std::cos(phi)};
}

}  // namespace

glm::dvec2 equalAreaSquare(const dvec3& d) {
  const double radius = std::sqrt(std::max(0.0, 1.0 - std::abs(d.z)));
  const double x = std::abs(d.x), y = std::abs(d.y);
  const double angle = x == 0.0 && y == 0.0 ? 0.0 : std::atan2(y, x) / (0.5 * std::numbers::pi);
  glm::dvec2 p(radius * (1.0 - angle), radius * angle);
  if (d.z < 0.0) p = {1.0 - p.y, 1.0 - p.x};
  p = {std::copysign(p.x, d.x), std::copysign(p.y, d.y)};
  return 0.5 * (p + 1.0);
}

dvec3 equalAreaDirection(const glm::dvec2& square) {
  const glm::dvec2 p = 2.0 * square - 1.0, a = glm::abs(p);
  const double inside = 1.0 - (a.x + a.y);
  const double r = 1.0 - std::abs(inside);
  const double phi = (r == 0.0 ? 1.0 : (a.y - a.x) / r + 1.0) * std::numbers::pi / 4.0;
  const double flat = r * std::sqrt(std::max(0.0, 2.0 - r * r));
  return {std::copysign(std::cos(phi), p.x) * flat, std::copysign(std::sin(phi), p.y) * flat,
          std::copysign(1.0 - r * r, inside)};
}

vec3 PbrtSky::Map::at(const dvec3& d) const {
  glm::dvec2 p;
  if (square) {
    p = equalAreaSquare(d);
  } else {
    const double turn = std::atan2(d.y, d.x) / kTurn;
    p = {turn < 0.0 ? turn + 1.0 : turn, std::acos(std::clamp(d.z, -1.0, 1.0)) / std::numbers::pi};
  }
  const int x = std::clamp(static_cast<int>(p.x * image.width), 0, image.width - 1);
  const int y = std::clamp(static_cast<int>(p.y * image.height), 0, image.height - 1);
  const float* texel = &image.floats[(std::size_t(y) * image.width + x) * 3];
  return factor * vec3(texel[0], texel[1], texel[2]);
}

double PbrtSky::Map::illuminance() const {
  double sum = 0.0;
  for (int y = 0; y < image.height; ++y) {
    for (int x = 0; x < image.width; ++x) {
      const double cosine =
          equalAreaDirection({(x + 0.5) / image.width, (y + 0.5) / image.height}).z;
      if (cosine <= 0.0) continue;
      const float* texel = &image.floats[(std::size_t(y) * image.width + x) * 3];
      sum += cosine * double{luminance(vec3(texel[0], texel[1], texel[2]))};
    }
  }
  return sum * 2.0 * kTurn / (double(image.width) * image.height);
}

Environment PbrtSky::environment(const glm::dmat3& mirror) const {
  Environment made;
  made.color = constant_;
  if (maps_.empty()) return made;
  Image image;
  image.name = maps_.size() == 1 ? maps_[0].image.name : "infinite lights";
  image.channels = 3;
  for (const Map& map : maps_) {
    image.height = std::max(image.height, map.image.height);
    image.width = std::max(image.width, map.square ? 2 * map.image.height : map.image.width);
  }
  image.floats.resize(std::size_t(image.width) * image.height * 3);
  std::vector<glm::dmat3> toLight;
  for (const Map& map : maps_) toLight.push_back(glm::inverse(mirror * map.toWorld));
  tbb::parallel_for(0, image.height, [&](int y) {
    for (int x = 0; x < image.width; ++x) {
      vec3 sum(0.0f);
      for (int k = 0; k < 4; ++k) {
        const dvec3 d = directionAt((x + 0.25 + 0.5 * (k & 1)) / image.width,
                                    (y + 0.25 + 0.5 * (k >> 1)) / image.height);
        for (std::size_t i = 0; i < maps_.size(); ++i) {
          sum += maps_[i].at(glm::normalize(toLight[i] * d));
        }
      }
      const vec3 radiance = constant_ + 0.25f * sum;
      for (int c = 0; c < 3; ++c) {
        image.floats[(std::size_t(y) * image.width + x) * 3 + c] = radiance[c];
      }
    }
  });
  made.color = vec3(1.0f);
  made.map = std::make_shared<const Image>(std::move(image));
  return made;
}

}  // namespace trex::detail
