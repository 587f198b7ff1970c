// Picture files: linear EXR with metadata, tone-mapped PNG.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include "src/core/maths.h"

namespace trex {

/// A float picture with named channels, interleaved, rows from top to bottom.
struct Picture {
  std::uint32_t width = 0, height = 0;
  std::vector<std::string> channels;  ///< "R", "G", "B", "variance.R", "sampleCount", ...
  std::vector<float> values;          ///< width * height * channels.size()
  std::vector<std::pair<std::string, std::string>> metadata;
};

/// Maps scene radiance to the screen: exposure in stops, then sRGB, clipped to [0, 1].
struct ToneMap {
  float exposure = 0.0f;
  vec3 apply(const vec3& linear) const;
};

/// Exposure in stops that brings the 70th percentile of the picture's mean channel to 0.5; 0 for a
/// black picture.
float autoExposure(const Picture& picture);

/// True for the extensions that writePicture knows: .exr .png (any case).
bool knownPictureExtension(const std::filesystem::path& path);

/// Writes by extension: .exr all channels as 32-bit float, linear; .png the first three channels
/// tone-mapped to 8 bits. Written beside and renamed. Throws Error(kOutput).
void writePicture(const std::filesystem::path& path, const Picture& picture,
                  const ToneMap& toneMap);

/// Writes 8-bit sRGB pixels, RGBA whose alpha is left out, as a PNG. Throws Error(kOutput).
void writeScreen(const std::filesystem::path& path, std::uint32_t width, std::uint32_t height,
                 const std::vector<std::uint8_t>& rgba);

}  // namespace trex
