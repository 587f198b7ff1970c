#include "src/viewer/screen_picture.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <utility>

namespace trex {
namespace {

/// sRGB bytes by the upper bits of a float in [2^-14, 1). Where a piece of that range holds more
/// than one byte's values, the byte is computed: equal to ToneMap everywhere.
class ByteTable {
 public:
  ByteTable() {
    for (std::size_t i = 0; i < pieces_.size(); ++i) {
      const auto first = static_cast<std::uint32_t>((kFirst + i) << kShift);
      pieces_[i] = {exact(std::bit_cast<float>(first)),
                    exact(std::bit_cast<float>(first + (1u << kShift) - 1))};
    }
  }
  std::uint8_t at(float x) const {
    if (!(x >= 0x1p-14f)) return 0;  // far below half a step
    if (x >= 1.0f) return 255;
    const auto& [low, high] = pieces_[(std::bit_cast<std::uint32_t>(x) >> kShift) - kFirst];
    return low == high ? low : exact(x);
  }

 private:
  static std::uint8_t exact(float x) {
    return static_cast<std::uint8_t>(std::lround(ToneMap{}.apply(vec3(x)).x * 255.0f));
  }
  static constexpr std::uint32_t kShift = 13;
  static constexpr std::size_t kFirst = std::size_t{(127 - 14) << 23} >> kShift;
  std::array<std::pair<std::uint8_t, std::uint8_t>, (std::size_t{127 << 23} >> kShift) - kFirst>
      pieces_;
};

template <typename Pixel>
void forRows(std::size_t pixels, const Pixel& pixel) {
  constexpr std::size_t kPiece = 4096;
  tbb::parallel_for(std::size_t{0}, (pixels + kPiece - 1) / kPiece, [&](std::size_t piece) {
    for (std::size_t i = piece * kPiece; i < std::min(pixels, (piece + 1) * kPiece); ++i) pixel(i);
  });
}

}  // namespace

std::vector<vec3> stretch(const std::vector<vec3>& lattice, std::uint32_t width,
                          std::uint32_t height, std::uint32_t spacing, bool nearest) {
  if (spacing == 1) return lattice;
  const std::uint32_t columns = (width + spacing - 1) / spacing,
                      rows = (height + spacing - 1) / spacing;
  std::vector<vec3> out(std::size_t{width} * height);
  const float inverse = 1.0f / static_cast<float>(spacing);
  tbb::parallel_for(0u, height, [&](std::uint32_t y) {
    const std::uint32_t y0 = y / spacing, y1 = std::min(y0 + 1, rows - 1);
    const float v = static_cast<float>(y - y0 * spacing) * inverse;
    const vec3 *upper = &lattice[std::size_t{y0} * columns],
               *lower = &lattice[std::size_t{y1} * columns];
    vec3* to = &out[std::size_t{y} * width];
    for (std::uint32_t x = 0; x < width; ++x) {
      const std::uint32_t x0 = x / spacing, x1 = std::min(x0 + 1, columns - 1);
      if (nearest) {
        to[x] = upper[x0];
        continue;
      }
      const float u = static_cast<float>(x - x0 * spacing) * inverse;
      to[x] = (upper[x0] * (1.0f - u) + upper[x1] * u) * (1.0f - v) +
              (lower[x0] * (1.0f - u) + lower[x1] * u) * v;
    }
  });
  return out;
}

void toneMapTo(const std::vector<vec3>& linear, const ToneMap& toneMap,
               std::vector<std::uint8_t>& rgba) {
  static const ByteTable table;
  const float scale = std::exp2(toneMap.exposure);
  rgba.resize(linear.size() * 4);
  forRows(linear.size(), [&](std::size_t i) {
    const vec3 shown = toScreen(linear[i] * scale, toneMap.toneOperator);
    for (int c = 0; c < 3; ++c) {
      rgba[4 * i + static_cast<std::size_t>(c)] = table.at(shown[c]);
    }
    rgba[4 * i + 3] = 255;
  });
}

void writeValues(const std::vector<vec3>& values, std::vector<std::uint8_t>& rgba) {
  rgba.resize(values.size() * 4);
  forRows(values.size(), [&](std::size_t i) {
    const vec3 v = glm::clamp(values[i], 0.0f, 1.0f) * 255.0f + 0.5f;
    for (int c = 0; c < 3; ++c) {
      rgba[4 * i + static_cast<std::size_t>(c)] = static_cast<std::uint8_t>(v[c]);
    }
    rgba[4 * i + 3] = 255;
  });
}

void highlight(const std::vector<std::uint8_t>& inside, std::uint32_t width, std::uint32_t height,
               std::vector<std::uint8_t>& rgba) {
  const auto at = [&](std::uint32_t x, std::uint32_t y) {
    return inside[std::size_t{y} * width + x] != 0;
  };
  for (std::uint32_t y = 0; y < height; ++y) {
    for (std::uint32_t x = 0; x < width; ++x) {
      if (!at(x, y)) continue;
      const bool border = (x > 0 && !at(x - 1, y)) || (x + 1 < width && !at(x + 1, y)) ||
                          (y > 0 && !at(x, y - 1)) || (y + 1 < height && !at(x, y + 1));
      std::uint8_t* p = &rgba[4 * (std::size_t{y} * width + x)];
      const int parts = border ? 7 : 1;  // of 8 are the colour of what is selected
      p[0] = static_cast<std::uint8_t>((p[0] * (8 - parts) + 255 * parts) / 8);
      p[1] = static_cast<std::uint8_t>((p[1] * (8 - parts) + 150 * parts) / 8);
      p[2] = static_cast<std::uint8_t>((p[2] * (8 - parts) + 20 * parts) / 8);
    }
  }
}

vec3 heat(float x) {
  x = std::clamp(x, 0.0f, 1.0f);
  return glm::clamp(vec3(4.0f * x - 2.0f, 2.0f - std::abs(4.0f * x - 2.0f), 2.0f - 4.0f * x), 0.0f,
                    1.0f);
}

}  // namespace trex
