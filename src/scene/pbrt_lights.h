// The directive LightSource of pbrt.
//
//   point, spot           intensity I; a spot's profile between its cones is ours, of equal power
//   distant               irradiance L
//   infinite              L, or a picture: "mapname" (pbrt-v3, latitude-longitude), "filename"
//                         (pbrt-v4, square)
//   goniometric           a point of the picture's mean; projection: a spot of its field of view
//
// "scale" multiplies, "power" and "illuminance" (pbrt-v4) set the luminous amount as pbrt-v4 does.
#pragma once

#include "src/scene/pbrt_colors.h"
#include "src/scene/pbrt_sky.h"
#include "src/scene/pbrt_state.h"

namespace trex::detail {

class PbrtLights {
 public:
  PbrtLights(PbrtContext& context, PbrtColors& colors) : context_(context), colors_(colors) {}

  void add(const std::string& kind, const PbrtParameters& parameters, const PbrtState& state);

  PbrtSky sky;
  float lightScale = 1.0f;  ///< of all that follow

 private:
  vec3 amount(const PbrtParameters& parameters, std::string_view name);
  float meanOfMap(const PbrtParameters& parameters);
  std::optional<Image> readMap(const std::string& file);
  void push(Light light);
  void addPoint(const PbrtParameters& parameters, const dmat4& toWorld, bool map);
  void addSpot(const std::string& kind, const PbrtParameters& parameters, const dmat4& toWorld);
  void addDistant(const PbrtParameters& parameters, const dmat4& toWorld);
  void addInfinite(const PbrtParameters& parameters, const dmat4& toWorld);

  PbrtContext& context_;
  PbrtColors& colors_;
};

/// Cosine of the inner cone with which a light of glTF's profile between its cones has the power of
/// pbrt's, of the same intensity and outer cone.
double pbrtInnerCosine(double cosStart, double cosEnd, bool version4);

}  // namespace trex::detail
