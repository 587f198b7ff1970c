// Camera and Film of pbrt.
//
// pbrt's camera looks along its +z with +y up and +x to the right of the picture; a matrix from
// camera to world with a positive determinant therefore shows a world that is left-handed. Cameras
// here have right = forward x up, so such a world is mirrored in x to show the same picture. Files
// that begin with Scale -1 1 1, as exporters of right-handed worlds write them, stay as they are.
#pragma once

#include <optional>

#include "src/scene/pbrt_context.h"
#include "src/scene/pbrt_state.h"

namespace trex::detail {

class PbrtCamera {
 public:
  explicit PbrtCamera(PbrtContext& context) : context_(context) {}

  void film(const std::string& kind, PbrtParameters parameters);
  /// `state` has the transform from world to camera.
  void camera(const std::string& kind, PbrtParameters parameters, const PbrtState& state);

  /// What the film multiplies radiance with.
  float exposure() const;
  /// From pbrt's world to ours: as it is, or mirrored.
  glm::dmat3 toWorld() const;
  /// Adds the camera to the scene, in our world, if the file has one; to be called once.
  void finish();

 private:
  double aspect() const;
  void lens(const PbrtParameters& p, Camera& made, double sideways, double along) const;
  void realistic(const PbrtParameters& p, Camera& made) const;
  double focalLength(const std::string& file) const;
  void perspective(const PbrtParameters& p, double halfHeight, double stretch, Camera& made) const;

  PbrtContext& context_;
  std::string kind_;  ///< empty: no camera
  std::string file_;
  std::uint64_t line_ = 0;
  PbrtParameters parameters_, film_;
  bool version4Film_ = false;
  dmat4 cameraToWorld_{1.0};
};

}  // namespace trex::detail
