// Rays of the camera, and how wide a pixel is where they arrive.
#pragma once

#include <cmath>
#include <cstdint>

#include "src/core/maths.h"
#include "src/scene/scene.h"

namespace trex {

/// A camera in render space, ready to make rays.
class CameraRays {
 public:
  CameraRays(const Camera& camera, const dvec3& renderOrigin, std::uint32_t width,
             std::uint32_t height);
  /// Ray through image position (x, y) in pixels from the upper left corner.
  void ray(float x, float y, dvec3& origin, vec3& direction) const;
  bool hasLens() const { return lensRadius_ > 0.0f; }
  /// Moves such a ray to a place of the lens, u in [0, 1)^2; it still meets the plane of focus at
  /// the same point.
  void throughLens(vec2 u, dvec3& origin, vec3& direction) const;
  /// Distance of a point along the viewing direction, metres.
  float depth(const dvec3& point) const { return glm::dot(vec3(point - eye_), forward_); }
  /// Width of a pixel after `distance` metres, metres; of what it mixes where a lens blurs.
  float footprint(float distance) const {
    const float sharp = (orthographic_ ? 1.0f : distance) * 2.0f * halfHeight_ / height_;
    return hasLens() ? sharp + 2.0f * lensRadius_ * std::abs(distance - focus_) / focus_ : sharp;
  }

 private:
  dvec3 eye_;
  vec3 forward_, right_, up_;
  float halfWidth_, halfHeight_, width_, height_, lensRadius_, focus_;
  bool orthographic_;
};

}  // namespace trex
