// Images that are light: linear, of Rec. 709, finite and not negative.
#include <fmt/ranges.h>

#include <array>
#include <cmath>
#include <mutex>

#include "src/core/log.h"
#include "src/images/image_library.h"
#include "src/scene/chromaticities.h"
#include "src/scene/image_io.h"
#include "src/scene/image_parts.h"
#include "src/scene/import_detail.h"
#include "src/scene/input_file.h"
#include "src/scene/mapped_file.h"
#include "src/scene/rgbe.h"
#include "src/scene/texture.h"

namespace trex::detail {
namespace {

/// The primaries that an .exr names, if they are others than those of Rec. 709.
std::optional<Chromaticities> otherPrimaries(const ImageFileSpec& spec) {
  for (const auto& [key, text] : spec.texts) {
    if (key != "chromaticities") continue;
    Chromaticities c{};
    std::string numbers = text;
    for (char& letter : numbers) letter = letter == ',' ? ' ' : letter;
    std::string_view rest = numbers;
    double difference = 0.0;
    for (std::size_t i = 0; i < 8; ++i) {
      double& value = c[i / 2][static_cast<int>(i % 2)];
      if (!parseDouble(nextWord(rest), value)) return {};
      difference = std::max(difference, std::abs(value - kRec709[i / 2][static_cast<int>(i % 2)]));
    }
    constexpr double kRounding = 2e-3;
    if (difference <= kRounding) return {};
    return c;
  }
  return {};
}

void changePrimaries(Image& image, const Chromaticities& from) {
  const glm::mat3 m(toRec709(from));
  bool usable = true;
  for (int c = 0; c < 3; ++c) usable = usable && isFinite(m[c]);
  if (!usable) {
    logWarning("{}: its chromaticities make no colours; Rec. 709 is taken", image.name);
    return;
  }
  logWarning(
      "{}: colours of primaries {:.4g} become those of Rec. 709", image.name,
      fmt::join(std::array{from[0].x, from[0].y, from[1].x, from[1].y, from[2].x, from[2].y}, ","));
  for (std::size_t i = 0; i + 2 < image.floats.size(); i += 3) {
    float* const p = &image.floats[i];
    const vec3 given(p[0], p[1], p[2]);
    if (!isFinite(given)) continue;
    const vec3 color = glm::max(m * given, glm::min(given, vec3(0.0f)));  // none less than before
    for (int c = 0; c < 3; ++c) p[c] = color[c];
  }
}

/// A texel that is not a radiance would poison importance sampling of the whole map. What is
/// infinite was too bright for a half.
void makeRadiance(Image& image) {
  constexpr float kLargestHalf = 65504.0f;
  std::uint64_t bad = 0, infinite = 0;
  for (float& f : image.floats) {
    if (std::isfinite(f) && f >= 0.0f) continue;
    const bool bright = f > 0.0f;
    f = bright ? kLargestHalf : 0.0f;
    ++(bright ? infinite : bad);
  }
  if (bad > 0) {
    logWarning("{}: {} negative values or ones that are no number set to 0", image.name, bad);
  }
  if (infinite > 0) {
    logWarning("{}: {} infinite values set to {}, the largest of halves", image.name, infinite,
               kLargestHalf);
  }
}

Image decodeLight(const std::string& name, int maxWidth) {
  const std::lock_guard lock(imageDecoding());
  std::string error;
  const OpenImageFile input(imageLibrary().open(name, "", true, error));
  if (!input) {
    fail(ExitCode::kInput, "{}: not an image that can be decoded: {}", name,
         utf8Of(oneLine(error)));
  }
  const std::optional<Colors> at = findColors(*input, name, false);
  if (!at) {
    fail(ExitCode::kInput, "{}: no channels R, G, B in any part of it; its first has {}", name,
         utf8Of(oneLine(fmt::format("{}", fmt::join(specOf(*input, 0).channels, ", ")))));
  }
  const ImageFileSpec spec = specOf(*input, at->part);
  checkSize(spec, name, maxWidth);
  Image image;
  image.name = name;
  image.channels = at->channels;
  setSize(spec, image);
  const std::size_t texels = std::size_t(image.width) * image.height;
  checkRoom(texels * 3 * sizeof(float), name, 0);
  image.floats.resize(texels * image.channels);
  readWindow(*input, *at, spec, ImageValues::kFloat, name,
             reinterpret_cast<std::byte*>(image.floats.data()));
  if (image.channels == 1) {
    std::vector<float> rgb(texels * 3);
    for (std::size_t i = 0; i < texels * 3; ++i) rgb[i] = image.floats[i / 3];
    image.floats = std::move(rgb);
    image.channels = 3;
  }
  // Whole numbers of [0, 1] are encoded, but those of .exr, which count.
  for (float& f : image.floats) {
    if (spec.floats) break;
    f = spec.windowed ? f * 4294967295.0f : decodeSrgb(f);
  }
  if (const auto primaries = otherPrimaries(spec)) changePrimaries(image, *primaries);
  return image;
}

}  // namespace

Image readFloatImage(const std::filesystem::path& path, int maxWidth) {
  const MappedFile file(path);
  const std::span<const std::uint8_t> bytes(file.data(), file.size());
  Image image = isRgbe(bytes) ? readRgbe(bytes, path.string(), maxWidth)
                              : decodeLight(path.string(), maxWidth);
  makeRadiance(image);
  return image;
}

}  // namespace trex::detail
