// Sun and clear sky by turbidity and the sun's height, for scene formats that name them.
//
// The sky's pattern is Perez's in the fit of [Preetham, Shirley, Smits 1999]; it is scaled so that
// its light on level ground, by colour, is that of the model of [Hosek, Wilkie 2012], whose
// sunlight [2013] is the sun's. Both as Mitsuba has them, radiances in units of the equal-energy
// white's. Within some percent in sum; single directions differ more.
#pragma once

#include <memory>

#include "src/scene/scene.h"

namespace trex::detail {

struct Daylight {
  double turbidity = 3.0;    ///< [1, 10]; clear air is 2, haze 6
  dvec3 sun{0.0, 1.0, 0.0};  ///< unit vector to it
  dvec3 up{0.0, 1.0, 0.0};
  double skyScale = 1.0, sunScale = 1.0;
  double sunRadius = 0.00467;  ///< radians; its power is the same for all
};

/// Light of the sun on a surface that faces it; by sunScale.
vec3 sunIrradiance(const Daylight& day);

/// An environment of the sky, black below the horizon, with the sun in it if `withSun`; that of a
/// radius under 0.01 would be lost between texels, so it is better a directional light.
Environment daylightSky(const Daylight& day, bool withSun);

}  // namespace trex::detail
