// Radiance's pictures (.hdr): 8 bits of mantissa a colour and a shared exponent [Ward 1991].
#pragma once

#include <cstdint>
#include <span>
#include <string>

#include "src/scene/scene.h"

namespace trex::detail {

/// Whether a file begins as these pictures do.
bool isRgbe(std::span<const std::uint8_t> file);

/// Decodes one of at most `maxSide` texels a side as three floats a texel of linear Rec. 709, rows
/// from the top: plain, run-length coded in the old way and in the new one, written in any of the
/// eight orders, in RGB or XYZ. What its EXPOSURE and COLORCORR lines say was multiplied into it is
/// taken out again. Throws Error(kInput) that starts with `name` if it is broken.
Image readRgbe(std::span<const std::uint8_t> file, const std::string& name, std::int64_t maxSide,
               std::uint64_t maxMemory = 0);

}  // namespace trex::detail
