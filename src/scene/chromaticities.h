// Colour spaces by the chromaticities of their primaries.
#pragma once

#include <array>

#include "src/core/maths.h"

namespace trex::detail {

/// CIE x, y of red, green, blue and white.
using Chromaticities = std::array<glm::dvec2, 4>;
inline constexpr Chromaticities kRec709 = {
    {{0.64, 0.33}, {0.30, 0.60}, {0.15, 0.06}, {0.3127, 0.3290}}};

/// RGB to XYZ, white of luminance 1 [SMPTE RP 177].
glm::dmat3 toXyz(const Chromaticities& c);

/// RGB to linear Rec. 709, with white as white: Bradford's adaptation where whites differ [CIE
/// 159]. May leave [0, 1]. Not finite if the primaries lie on a line.
glm::dmat3 toRec709(const Chromaticities& c);

}  // namespace trex::detail
