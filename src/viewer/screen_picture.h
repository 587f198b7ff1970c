// From linear pictures and lattices of them to the 8-bit picture on the screen.
#pragma once

#include <cstdint>
#include <vector>

#include "src/core/maths.h"
#include "src/frame/tone_map.h"
#include "src/viewer/viewer.h"

namespace trex {

/// A picture of every `spacing`-th pixel, stretched over width x height: bilinear between its
/// pixels, or (`nearest`) as blocks. Returns row by row.
std::vector<vec3> stretch(const std::vector<vec3>& lattice, std::uint32_t width,
                          std::uint32_t height, std::uint32_t spacing, bool nearest);

/// 8 bits: equal to what the ToneMap writes to a file.
void toneMapTo(const std::vector<vec3>& linear, const ToneMap& toneMap,
               std::vector<std::uint8_t>& rgba);
/// Values in [0, 1] as they are, for views that are not light.
void writeValues(const std::vector<vec3>& values, std::vector<std::uint8_t>& rgba);

/// Tints the pixels where `inside` holds, and draws their border.
void highlight(const std::vector<std::uint8_t>& inside, std::uint32_t width, std::uint32_t height,
               std::vector<std::uint8_t>& rgba);

/// From blue over green and yellow to red; x in [0, 1].
vec3 heat(float x);

}  // namespace trex
