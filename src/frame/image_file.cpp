#include "src/frame/image_file.h"

#include <algorithm>
#include <cctype>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <fstream>

#include "src/core/error.h"
#include "src/core/file.h"
#include "src/frame/png.h"
#include "src/images/image_library.h"

namespace trex {
namespace fs = std::filesystem;
namespace {

std::string lowerExtension(const fs::path& path) {
  std::string extension = path.extension().string();
  std::transform(extension.begin(), extension.end(), extension.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return extension;
}

void write(const fs::path& path, const fs::path& target, const ImageToWrite& image) {
  std::string error;
  if (!imageLibrary().write(path.string(), image, error)) {
    fail(ExitCode::kOutput, "{}: {}", target.string(), error);
  }
}

void writeExr(const fs::path& path, const fs::path& target, const Picture& picture) {
  // Of red, green, blue and white: Rec. 709 and D65.
  static constexpr float kRec709[8] = {0.64f, 0.33f, 0.3f, 0.6f, 0.15f, 0.06f, 0.3127f, 0.329f};
  write(path, target,
        {.width = static_cast<int>(picture.width),
         .height = static_cast<int>(picture.height),
         .values = ImageValues::kFloat,
         .channels = picture.channels,
         .data = picture.values.data(),
         .texts = picture.metadata,
         .chromaticities = kRec709});
}

void writeJpeg(const fs::path& path, const fs::path& target, std::uint32_t width,
               std::uint32_t height, const std::vector<std::uint8_t>& rgb, int quality) {
  write(path, target,
        {.width = static_cast<int>(width),
         .height = static_cast<int>(height),
         .values = ImageValues::kByte,
         .channels = {"R", "G", "B"},
         .data = rgb.data(),
         .jpegQuality = quality});
}

template <typename Value>
void writePng(const fs::path& path, const fs::path& target, std::uint32_t width,
              std::uint32_t height, bool alpha, const std::vector<Value>& values) {
  const std::vector<std::uint8_t> file = encodePng(width, height, alpha, values);
  std::ofstream out(path, std::ios::binary);
  out.write(reinterpret_cast<const char*>(file.data()), static_cast<std::streamsize>(file.size()));
  out.close();
  if (!out) {
    fail(ExitCode::kOutput, "{}: can't be written: {}", target.string(), std::strerror(errno));
  }
}

/// Index of A where it is to be written.
int alphaChannel(const Picture& picture) {
  const auto at = std::find(picture.channels.begin(), picture.channels.end(), "A");
  return picture.premultiplied && at != picture.channels.end()
             ? static_cast<int>(at - picture.channels.begin())
             : -1;
}

/// Tone-mapped values of all pixels, rounded to whole numbers up to `most`.
template <typename Value>
std::vector<Value> displayedValues(const Picture& picture, const ToneMap& toneMap, float most) {
  const std::size_t pixels = std::size_t{picture.width} * picture.height;
  const std::size_t stride = picture.channels.size();
  const int alpha = alphaChannel(picture);
  const auto rounded = [most](float x) { return static_cast<Value>(std::lround(x * most)); };
  std::vector<Value> out;
  out.reserve(pixels * (alpha < 0 ? 3 : 4));
  for (std::size_t i = 0; i < pixels; ++i) {
    const float* v = &picture.values[i * stride];
    vec3 color(v[0], v[1], v[2]);
    const float a = alpha < 0 ? 1.0f : std::clamp(v[alpha], 0.0f, 1.0f);
    if (a < 1.0f) color = a > 0.0f ? color / a : vec3(0.0f);
    const vec3 mapped = toneMap.apply(color);
    for (int c = 0; c < 3; ++c) out.push_back(rounded(mapped[c]));
    if (alpha >= 0) out.push_back(rounded(a));
  }
  return out;
}

void writeToneMapped(const fs::path& path, const fs::path& target, const Picture& picture,
                     const ToneMap& toneMap, const FileOptions& options) {
  const std::uint32_t width = picture.width, height = picture.height;
  const bool alpha = alphaChannel(picture) >= 0;
  if (!isJpeg(target) && options.bits == 16) {
    const auto values = displayedValues<std::uint16_t>(picture, toneMap, 65535.0f);
    writePng(path, target, width, height, alpha, values);
    return;
  }
  const auto values = displayedValues<std::uint8_t>(picture, toneMap, 255.0f);
  if (isJpeg(target)) {
    writeJpeg(path, target, width, height, values, options.quality);
  } else {
    writePng(path, target, width, height, alpha, values);
  }
}

}  // namespace

float autoExposure(const Picture& picture) {
  const std::size_t pixels = std::size_t{picture.width} * picture.height;
  const std::size_t stride = picture.channels.size();
  const int alpha = alphaChannel(picture);
  std::vector<float> means;
  means.reserve(pixels);
  for (std::size_t i = 0; i < pixels; ++i) {
    const float* v = &picture.values[i * stride];
    const float a = alpha < 0 ? 1.0f : v[alpha];
    if (a > 0.0f) means.push_back((v[0] + v[1] + v[2]) / (3.0f * a));
  }
  if (means.empty()) return 0.0f;
  const auto at = means.begin() + static_cast<std::ptrdiff_t>(0.7 * double(means.size() - 1));
  std::nth_element(means.begin(), at, means.end());
  return *at > 0.0f && std::isfinite(*at) ? std::log2(0.5f / *at) : 0.0f;
}

bool isJpeg(const fs::path& path) {
  return lowerExtension(path) == ".jpg" || lowerExtension(path) == ".jpeg";
}

bool needsImageLibrary(const fs::path& path) { return isExr(path) || isJpeg(path); }

bool isExr(const fs::path& path) { return lowerExtension(path) == ".exr"; }

bool knownPictureExtension(const fs::path& path) {
  return isExr(path) || lowerExtension(path) == ".png" || isJpeg(path);
}

void writePicture(const fs::path& path, const Picture& picture, const ToneMap& toneMap,
                  const FileOptions& options) {
  if (!knownPictureExtension(path)) {
    fail(ExitCode::kUsage, "{}: unknown picture format; use .exr, .png or .jpg", path.string());
  }
  if (isJpeg(path) && alphaChannel(picture) >= 0) {
    fail(ExitCode::kUsage, "{}: a .jpg has no alpha; use .exr or .png", path.string());
  }
  writeAtomically(path, [&](const fs::path& temporary) {
    if (isExr(path)) {
      writeExr(temporary, path, picture);
    } else {
      writeToneMapped(temporary, path, picture, toneMap, options);
    }
  });
}

void writeScreen(const fs::path& path, std::uint32_t width, std::uint32_t height,
                 const std::vector<std::uint8_t>& rgba) {
  std::vector<std::uint8_t> rgb;
  rgb.reserve(rgba.size() / 4 * 3);
  for (std::size_t i = 0; i < rgba.size(); i += 4) {
    rgb.insert(rgb.end(), rgba.begin() + static_cast<std::ptrdiff_t>(i),
               rgba.begin() + static_cast<std::ptrdiff_t>(i) + 3);
  }
  writeAtomically(path, [&](const fs::path& temporary) {
    if (isJpeg(path)) {
      writeJpeg(temporary, path, width, height, rgb, FileOptions{}.quality);
    } else {
      writePng(temporary, path, width, height, false, rgb);
    }
  });
}

}  // namespace trex
