// Two rooms whose light is known, and what the guess makes of them: the figures of `trex bench
// asvo` that are no rates.
#pragma once

#include "src/session/settings.h"

namespace trex {

/// A closed room of 4 x 2.5 x 4 m in the sun, with walls of `leaves` leaf voxels: radiosity inside
/// in percent of the sun's irradiance. 0 would be right.
double leakPercent(double leaves, GuessKind guess, int device);

/// A closed box whose walls emit 1 - albedo: error of the radiance inside, which is 1, in percent.
double furnaceErrorPercent(float albedo, GuessKind guess, int device);

}  // namespace trex
