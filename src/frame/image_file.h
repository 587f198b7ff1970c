// Picture files: linear EXR with metadata, tone-mapped PNG and JPEG.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include "src/core/maths.h"
#include "src/frame/tone_map.h"

namespace trex {

/// A float picture with named channels, interleaved, rows from top to bottom.
struct Picture {
  std::uint32_t width = 0, height = 0;
  std::vector<std::string> channels;  ///< "R", "G", "B", "variance.R", "sampleCount", ...
  std::vector<float> values;          ///< width * height * channels.size()
  std::vector<std::pair<std::string, std::string>> metadata;
  bool premultiplied = false;  ///< without background: R, G, B count A times
};

/// What files need to know besides the picture.
struct FileOptions {
  int bits = 8;      ///< of a value of a .png: 8 or 16
  int quality = 90;  ///< of a .jpg, 1 to 100
};

/// Exposure in stops that brings the 70th percentile of the picture's mean channel to 0.5; 0 for a
/// black picture. Of a premultiplied one, what it shows alone counts.
float autoExposure(const Picture& picture);

/// True for the extensions that writePicture knows: .exr .png .jpg .jpeg (any case).
bool knownPictureExtension(const std::filesystem::path& path);
bool isExr(const std::filesystem::path& path);
bool isJpeg(const std::filesystem::path& path);
/// Whether writing it takes the library of src/images/image_library.h.
bool needsImageLibrary(const std::filesystem::path& path);

/// Writes by extension: .exr all channels as 32-bit float, linear, Rec. 709 with D65 as its
/// chromaticities; .png and .jpg the first three channels tone-mapped to sRGB, which is noted in
/// the file. A .png of a premultiplied picture has its A too, and its colours are not multiplied by
/// it. Written beside and renamed. Throws Error(kOutput), and Error(kUsage) for another extension
/// or a .jpg of a premultiplied picture.
void writePicture(const std::filesystem::path& path, const Picture& picture, const ToneMap& toneMap,
                  const FileOptions& options = {});

/// Writes 8-bit sRGB pixels, RGBA whose alpha is left out, as a .png or .jpg. Throws
/// Error(kOutput).
void writeScreen(const std::filesystem::path& path, std::uint32_t width, std::uint32_t height,
                 const std::vector<std::uint8_t>& rgba);

}  // namespace trex
