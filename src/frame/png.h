// PNG files [ISO/IEC 15948], encoded here: most renders write one, and OpenImageIO takes longer to
// load than a small one to render.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

namespace trex {

/// A whole file of sRGB colours, row by row from the top: three values a pixel or, with `alpha`,
/// four, alpha not premultiplied. Equal values make equal files.
std::vector<std::uint8_t> encodePng(std::uint32_t width, std::uint32_t height, bool alpha,
                                    std::span<const std::uint8_t> values);
std::vector<std::uint8_t> encodePng(std::uint32_t width, std::uint32_t height, bool alpha,
                                    std::span<const std::uint16_t> values);

}  // namespace trex
