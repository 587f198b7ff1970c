#include "src/frame/image_file.h"

#include <OpenImageIO/imageio.h>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <memory>

#include "src/core/error.h"
#include "src/core/file.h"

namespace trex {
namespace fs = std::filesystem;
namespace {

std::string lowerExtension(const fs::path& path) {
  std::string extension = path.extension().string();
  std::transform(extension.begin(), extension.end(), extension.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return extension;
}

void writeBuffer(const fs::path& path, const fs::path& target, const OIIO::ImageSpec& spec,
                 OIIO::TypeDesc type, const void* data) {
  const std::unique_ptr<OIIO::ImageOutput> out = OIIO::ImageOutput::create(path.string());
  if (!out) fail(ExitCode::kOutput, "{}: {}", target.string(), OIIO::geterror());
  if (!out->open(path.string(), spec) || !out->write_image(type, data) || !out->close()) {
    fail(ExitCode::kOutput, "{}: can't be written: {}", target.string(), out->geterror());
  }
}

void writeExr(const fs::path& path, const fs::path& target, const Picture& picture) {
  OIIO::ImageSpec spec(static_cast<int>(picture.width), static_cast<int>(picture.height),
                       static_cast<int>(picture.channels.size()), OIIO::TypeDesc::FLOAT);
  spec.channelnames = picture.channels;
  spec.attribute("compression", "zip");
  spec.attribute("DateTime", "1970:01:01 00:00:00");  // equal renders make equal files
  spec.attribute("oiio:ColorSpace", "linear");
  for (const auto& [key, value] : picture.metadata) spec.attribute(key, value);
  writeBuffer(path, target, spec, OIIO::TypeDesc::FLOAT, picture.values.data());
}

void writeBytes(const fs::path& path, const fs::path& target, std::uint32_t width,
                std::uint32_t height, const std::vector<std::uint8_t>& rgb) {
  OIIO::ImageSpec spec(static_cast<int>(width), static_cast<int>(height), 3, OIIO::TypeDesc::UINT8);
  spec.attribute("oiio:ColorSpace", "sRGB");
  writeBuffer(path, target, spec, OIIO::TypeDesc::UINT8, rgb.data());
}

void writePng(const fs::path& path, const fs::path& target, const Picture& picture,
              const ToneMap& toneMap) {
  const std::size_t pixels = std::size_t{picture.width} * picture.height;
  const std::size_t stride = picture.channels.size();
  std::vector<std::uint8_t> bytes(pixels * 3);
  for (std::size_t i = 0; i < pixels; ++i) {
    const float* v = &picture.values[i * stride];
    const vec3 mapped = toneMap.apply(vec3(v[0], v[1], v[2]));
    for (int c = 0; c < 3; ++c) {
      bytes[i * 3 + static_cast<std::size_t>(c)] =
          static_cast<std::uint8_t>(std::lround(mapped[c] * 255.0f));
    }
  }
  writeBytes(path, target, picture.width, picture.height, bytes);
}

}  // namespace

vec3 ToneMap::apply(const vec3& linear) const {
  const float scale = std::exp2(exposure);
  vec3 out;
  for (int c = 0; c < 3; ++c) {
    const float x = linear[c] * scale;
    out[c] = encodeSrgb(x >= 0.0f ? std::min(x, 1.0f) : 0.0f);  // NaN becomes 0
  }
  return out;
}

float autoExposure(const Picture& picture) {
  const std::size_t pixels = std::size_t{picture.width} * picture.height;
  const std::size_t stride = picture.channels.size();
  std::vector<float> means(pixels);
  for (std::size_t i = 0; i < pixels; ++i) {
    const float* v = &picture.values[i * stride];
    means[i] = (v[0] + v[1] + v[2]) / 3.0f;
  }
  if (means.empty()) return 0.0f;
  const auto at = means.begin() + static_cast<std::ptrdiff_t>(0.7 * double(pixels - 1));
  std::nth_element(means.begin(), at, means.end());
  return *at > 0.0f && std::isfinite(*at) ? std::log2(0.5f / *at) : 0.0f;
}

bool knownPictureExtension(const fs::path& path) {
  const std::string extension = lowerExtension(path);
  return extension == ".exr" || extension == ".png";
}

void writePicture(const fs::path& path, const Picture& picture, const ToneMap& toneMap) {
  writeAtomically(path, [&](const fs::path& temporary) {
    if (lowerExtension(path) == ".exr") {
      writeExr(temporary, path, picture);
    } else if (lowerExtension(path) == ".png") {
      writePng(temporary, path, picture, toneMap);
    } else {
      fail(ExitCode::kUsage, "{}: unknown picture format; use .exr or .png", path.string());
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
  writeAtomically(
      path, [&](const fs::path& temporary) { writeBytes(temporary, path, width, height, rgb); });
}

}  // namespace trex
