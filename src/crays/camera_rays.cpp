#include "src/crays/camera_rays.h"

namespace trex {

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

}  // namespace trex
