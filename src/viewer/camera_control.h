// Moves a camera the way a person means it: around a pivot, along the view, on foot. Plain maths;
// the window feeds it drags and keys.
//
// Drags are given as a share of the picture's height, downwards positive, so that a move feels the
// same in every window.
#pragma once

#include <string>

#include "src/scene/scene.h"

namespace trex {

class CameraControl {
 public:
  /// `bounds` of the scene, world; the pivot is the point of the view's axis nearest to its centre.
  CameraControl(const Camera& camera, const Box3d& bounds);

  const Camera& camera() const { return camera_; }
  const dvec3& pivot() const { return pivot_; }
  /// Length of the scene's diagonal, metres; speeds follow it.
  double sceneSize() const { return sceneSize_; }

  /// Another camera; the pivot moves onto its axis, as far away as it was.
  void setCamera(const Camera& camera);
  /// Another scene under the same camera.
  void setBounds(const Box3d& bounds);
  void setPivot(const dvec3& pivot) { pivot_ = pivot; }
  void setFieldOfView(float radians);

  /// Turns the eye around the pivot; half a turn a height. Stops short of the poles.
  void orbit(const vec2& drag);
  /// Turns the view at the eye; a drag over the height turns by the field of view.
  void look(const vec2& drag);
  /// Moves eye and pivot sideways: what lies at the pivot's depth follows the pointer.
  void pan(const vec2& drag);
  /// Moves the eye towards the pivot (steps > 0) by a constant share of the distance a step, never
  /// through it. An orthographic view is magnified instead.
  void dolly(float steps);
  /// Walks for some seconds: x right, y up, z ahead, each in [-1, 1], at `pace` times a quarter of
  /// the scene's size a second.
  void fly(const vec3& direction, double seconds, double pace);
  /// Moves back until the whole box is in view; it becomes the pivot. `aspect`: width / height.
  void frame(const Box3d& box, double aspect);

 private:
  void chooseVertical();
  void turn(const dmat4& rotation);
  double pivotDistance() const;
  double heightAtPivot() const;

  Camera camera_;
  dvec3 pivot_{0.0};
  dvec3 centre_{0.0};
  double sceneSize_ = 1.0;
  dvec3 vertical_{0.0, 1.0, 0.0};  ///< axis that orbit and look turn about; the horizon stays level
};

/// Pace of a key held with shift or control.
inline constexpr double kFastPace = 4.0, kSlowPace = 0.2;

}  // namespace trex
