#include "src/bench/bench_score.h"

#include <cmath>
#include <filesystem>
#include <span>

#include "src/core/error.h"
#include "src/frame/picture_reader.h"
#include "src/frame/png.h"

namespace trex {
namespace {

std::string base64(std::span<const unsigned char> bytes) {
  constexpr const char* kDigits =
      "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string text;
  for (std::size_t i = 0; i < bytes.size(); i += 3) {
    std::uint32_t group = 0;
    for (std::size_t k = 0; k < 3; ++k) {
      group = group << 8 | (i + k < bytes.size() ? bytes[i + k] : 0u);
    }
    for (std::size_t k = 0; k < 4; ++k) {
      text += i + k > bytes.size() ? '=' : kDigits[group >> (18 - 6 * k) & 63u];
    }
  }
  return text;
}

std::vector<std::uint8_t> pngOf(const ColorImage& shown) {
  std::vector<std::uint8_t> texels;
  for (const vec3& c : shown.pixels) {
    const vec3 encoded = ToneMap{}.apply(c);
    for (int k = 0; k < 3; ++k) {
      texels.push_back(static_cast<std::uint8_t>(std::lround(encoded[k] * 255.0f)));
    }
  }
  return encodePng(shown.width, shown.height, false, texels);
}

void checkSize(const ColorImage& image, const std::string& path, std::uint32_t width,
               std::uint32_t height) {
  if (image.width == width && image.height == height) return;
  fail(ExitCode::kInput, "{}: is {}x{}; give --size {}x{} or another reference", path, image.width,
       image.height, image.width, image.height);
}

ColorImage readColors(const std::string& path, std::uint32_t width, std::uint32_t height) {
  ColorImage image = colorsOf(readPicture(path), path);
  checkSize(image, path, width, height);
  for (const vec3& c : image.pixels) {
    if (!isFinite(c)) fail(ExitCode::kInput, "{}: a pixel of the reference is not finite", path);
  }
  return image;
}

}  // namespace

Scorer::Scorer(ColorImage reference, ColorImage clean)
    : reference_(std::move(reference)),
      clean_(std::move(clean)),
      scale_(displayScale(reference_)),
      mean_(meanValue(reference_)) {
  shown_ = displayed(clean_, scale_);
}

nlohmann::json Scorer::score(ColorImage image) const {
  std::uint64_t nonFinite = 0;
  for (vec3& c : image.pixels) {
    if (isFinite(c)) continue;
    c = vec3(0.0f);
    ++nonFinite;
  }
  const RelativeError error = relativeError(image, reference_);
  const double mean = meanValue(image);
  const auto map = flipMap(shown_, displayed(image, scale_), kFlipPixelsPerDegree);
  return {{"relmse", error.trimmed},
          {"relmse_all", error.all},
          {"flip", meanError(map)},
          {"mean_ratio", mean == mean_ ? 1.0 : mean / mean_},
          {"nonfinite_pixels", nonFinite}};
}

std::string Scorer::png(const ColorImage& image) const {
  return base64(pngOf(displayed(image, scale_)));
}

Scorer readReference(const std::string& path, std::uint32_t width, std::uint32_t height) {
  ColorImage reference = readColors(path, width, height);
  const std::filesystem::path clean = std::filesystem::path(path).replace_extension(".clean.exr");
  ColorImage second =
      std::filesystem::exists(clean) ? readColors(clean.string(), width, height) : reference;
  return {std::move(reference), std::move(second)};
}

}  // namespace trex
