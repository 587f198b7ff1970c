#include "src/viewer/camera_control.h"

#include <algorithm>
#include <cmath>
#include <glm/gtc/matrix_transform.hpp>

namespace trex {
namespace {

constexpr double kSteepest = 0.9998;                    // sine of 89 degrees
constexpr double kDollyShare = 0.85;                    // of the distance that is left after a step
constexpr double kNearest = 1e-5;                       // to the pivot, of the scene's size
constexpr double kFlyShare = 0.25;                      // of the scene's size a second
constexpr float kLeastFov = 0.0175f, kMostFov = 3.12f;  // radians

double diagonal(const Box3d& bounds) {
  const double size = bounds.empty() ? 0.0 : glm::length(bounds.size());
  return size > 0.0 ? size : 1.0;
}

dvec3 rightOf(const Camera& camera) {
  return glm::normalize(glm::cross(dvec3(camera.forward), dvec3(camera.up)));
}

/// Gives the camera this direction, and the up that is nearest to `up`.
void aim(Camera& camera, const dvec3& forward, const dvec3& up) {
  const dvec3 ahead = glm::normalize(forward);
  const dvec3 right = glm::normalize(glm::cross(ahead, up));
  camera.forward = vec3(ahead);
  camera.up = vec3(glm::cross(right, ahead));
}

}  // namespace

CameraControl::CameraControl(const Camera& camera, const Box3d& bounds) : camera_(camera) {
  setBounds(bounds);
  chooseVertical();
}

void CameraControl::setBounds(const Box3d& bounds) {
  sceneSize_ = diagonal(bounds);
  centre_ = bounds.empty() ? dvec3(0.0) : bounds.centre();
  const double along = glm::dot(centre_ - camera_.eye, dvec3(camera_.forward));
  pivot_ = camera_.eye + std::max(along, 0.05 * sceneSize_) * dvec3(camera_.forward);
}

void CameraControl::setCamera(const Camera& camera) {
  const double distance = pivotDistance();
  camera_ = camera;
  pivot_ = camera_.eye + distance * dvec3(camera_.forward);
  chooseVertical();
}

void CameraControl::setFieldOfView(float radians) {
  camera_.verticalFov = std::clamp(radians, kLeastFov, kMostFov);
}

/// A world axis that the camera holds level: y, or z of a model that stands on its xy plane; the
/// camera's own up if it is rolled.
void CameraControl::chooseVertical() {
  const dvec3 right = rightOf(camera_), up(camera_.up), x(1, 0, 0), y(0, 1, 0), z(0, 0, 1);
  const bool standsOnXy = std::abs(up.y) < 1e-6 && up.z > 0.0;
  vertical_ = up;
  for (const dvec3& axis : {standsOnXy ? z : y, standsOnXy ? y : z, x}) {
    if (std::abs(glm::dot(right, axis)) > 1e-3) continue;
    vertical_ = glm::dot(up, axis) < -1e-6 ? -axis : axis;
    return;
  }
}

void CameraControl::turn(const dmat4& rotation) {
  const auto rotated = [&](const dvec3& v) { return dvec3(rotation * glm::dvec4(v, 0.0)); };
  aim(camera_, rotated(dvec3(camera_.forward)), rotated(dvec3(camera_.up)));
}

double CameraControl::pivotDistance() const {
  return std::max(glm::length(pivot_ - camera_.eye), kNearest * sceneSize_);
}

double CameraControl::heightAtPivot() const {
  if (camera_.orthographic) return camera_.orthographicHeight;
  return 2.0 * pivotDistance() * std::tan(0.5 * double(camera_.verticalFov));
}

namespace {

/// The pitch that was asked for, less what would lead over a pole.
double allowedPitch(const Camera& camera, const dvec3& vertical, double pitch) {
  const double now = std::asin(std::clamp(glm::dot(dvec3(camera.forward), vertical), -1.0, 1.0));
  const double most = std::asin(kSteepest);
  // A camera that starts beyond the limit may turn back, not further.
  return std::clamp(pitch, std::min(-most - now, 0.0), std::max(most - now, 0.0));
}

dmat4 yawAndPitch(const Camera& camera, const dvec3& vertical, double yaw, double pitch) {
  const dmat4 pitched = glm::rotate(dmat4(1.0), pitch, rightOf(camera));
  return glm::rotate(dmat4(1.0), yaw, vertical) * pitched;
}

}  // namespace

void CameraControl::orbit(const vec2& drag) {
  const double yaw = -double(kPi) * drag.x;
  const double pitch = allowedPitch(camera_, vertical_, -double(kPi) * drag.y);
  const dmat4 rotation = yawAndPitch(camera_, vertical_, yaw, pitch);
  camera_.eye = pivot_ + dvec3(rotation * glm::dvec4(camera_.eye - pivot_, 0.0));
  turn(rotation);
}

void CameraControl::look(const vec2& drag) {
  const double fov = camera_.orthographic ? 0.7 : double(camera_.verticalFov);
  const double pitch = allowedPitch(camera_, vertical_, -fov * drag.y);
  const double distance = pivotDistance();
  turn(yawAndPitch(camera_, vertical_, -fov * drag.x, pitch));
  pivot_ = camera_.eye + distance * dvec3(camera_.forward);
}

void CameraControl::pan(const vec2& drag) {
  const dvec3 move =
      heightAtPivot() * (double(drag.y) * dvec3(camera_.up) - double(drag.x) * rightOf(camera_));
  camera_.eye += move;
  pivot_ += move;
}

void CameraControl::dolly(float steps) {
  const double share = std::pow(kDollyShare, double(steps));
  if (camera_.orthographic) {
    camera_.orthographicHeight =
        std::clamp(camera_.orthographicHeight * static_cast<float>(share), 1e-6f, 1e12f);
    return;
  }
  const dvec3 away = camera_.eye - pivot_;
  const double distance = glm::length(away), nearest = kNearest * sceneSize_;
  const dvec3 direction = distance > 0.0 ? away / distance : -dvec3(camera_.forward);
  camera_.eye = pivot_ + std::max(distance * share, std::min(distance, nearest)) * direction;
}

void CameraControl::fly(const vec3& direction, double seconds, double pace) {
  const dvec3 move = kFlyShare * sceneSize_ * pace * seconds *
                     (double(direction.x) * rightOf(camera_) + double(direction.y) * vertical_ +
                      double(direction.z) * dvec3(camera_.forward));
  camera_.eye += move;
  pivot_ += move;
}

void CameraControl::frame(const Box3d& box, double aspect) {
  if (box.empty()) return;
  const double radius = std::max(0.5 * glm::length(box.size()), kNearest * sceneSize_);
  const double halfHeight = 0.5 * double(camera_.verticalFov);
  const double halfWidth = std::atan(std::tan(halfHeight) * aspect);
  pivot_ = box.centre();
  camera_.eye =
      pivot_ - 1.05 * radius / std::sin(std::min(halfHeight, halfWidth)) * dvec3(camera_.forward);
  if (camera_.orthographic) {
    camera_.orthographicHeight = static_cast<float>(2.1 * radius / std::min(aspect, 1.0));
  }
}

}  // namespace trex
