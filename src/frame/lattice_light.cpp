#include "src/frame/lattice_light.h"

#include <tbb/parallel_for.h>

#include <algorithm>

namespace trex {
namespace {

constexpr std::uint32_t kBandPixels = 8192;  // some milliseconds of a thread
constexpr float kEnough = 1e-2f;             // weights that tell of a surface
constexpr int kAround = 2;                   // lattice pixels, where the nearest tell nothing

}  // namespace

LatticeLight::LatticeLight(const FeatureImage& lattice, const std::vector<vec3>& light,
                           const FeatureImage& all, std::uint32_t step, std::uint32_t stride)
    : all_(all), step_(step), stride_(stride), columns_(lattice.width()), rows_(lattice.height()) {
  lattice_.resize(light.size());
  tbb::parallel_for(0u, rows_, [&](std::uint32_t y) {
    for (std::uint32_t x = 0; x < columns_; ++x) {
      const std::size_t i = std::size_t{y} * columns_ + x;
      // Footprints of the lattice are those of its own, wider pixels.
      const Feature& f = lattice.most(x, y).mean;
      lattice_[i] = known(f);
      lattice_[i].light = light[i] / guideAlbedo(f.albedo);
    }
  });
  out_.resize(std::size_t{(all.width() + stride - 1) / stride} *
              ((all.height() + stride - 1) / stride));
}

LatticeLight::Known LatticeLight::known(const Feature& f) const {
  Known out{};
  const vec3 normal = f.normal * (1.0f - f.black);
  const float length = glm::length(normal);
  out.surface = length > 0.0f;
  if (out.surface) out.shown.normal = normal / length;
  out.shown.position = f.position;
  out.shown.slope = slopeOf(length, f.footprint);
  return out;
}

/// The four pixels of the lattice around a pixel, in proportion to nearness and likeness; where
/// none of them is alike, those around them; where none of these is, as if all were.
vec3 LatticeLight::lightOf(Feature f, std::uint32_t x, std::uint32_t y) const {
  f.footprint *= static_cast<float>(step_);
  const Known own = known(f);
  const std::uint32_t column = x / step_, row = y / step_;
  const float perStep = 1.0f / static_cast<float>(step_),
              u = static_cast<float>(x - column * step_) * perStep,
              v = static_cast<float>(y - row * step_) * perStep;
  const auto likeness = [&](const Known& k) {
    if (own.surface != k.surface) return 0.0f;
    return own.surface ? alike(own.shown, k.shown, 1.0f) : 1.0f;
  };
  vec3 sum(0.0f), all(0.0f);
  float weights = 0.0f, allWeights = 0.0f;
  for (std::uint32_t k = 0; k < 4; ++k) {
    const std::uint32_t dx = k & 1u, dy = k >> 1;
    const float tent = (dx ? u : 1.0f - u) * (dy ? v : 1.0f - v);
    if (tent <= 0.0f) continue;
    const Known& known = lattice_[std::size_t{std::min(row + dy, rows_ - 1)} * columns_ +
                                  std::min(column + dx, columns_ - 1)];
    const float weight = tent * likeness(known);
    sum += weight * known.light;
    weights += weight;
    if (known.surface) {
      all += tent * known.light;
      allWeights += tent;
    }
  }
  if (weights < kEnough) {
    const int left = static_cast<int>(column) - kAround + 1,
              top = static_cast<int>(row) - kAround + 1;
    for (int r = std::max(top, 0); r < std::min(top + 2 * kAround, static_cast<int>(rows_)); ++r) {
      for (int c = std::max(left, 0); c < std::min(left + 2 * kAround, static_cast<int>(columns_));
           ++c) {
        const Known& known =
            lattice_[static_cast<std::size_t>(r) * columns_ + static_cast<std::size_t>(c)];
        const float weight = likeness(known);
        sum += weight * known.light;
        weights += weight;
      }
    }
  }
  if (weights > 0.0f) return guideAlbedo(f.albedo) * sum / weights;
  return own.surface && allWeights > 0.0f ? guideAlbedo(f.albedo) * all / allWeights : vec3(0.0f);
}

vec3 LatticeLight::lightAt(std::uint32_t x, std::uint32_t y) const {
  const vec3 most = lightOf(all_.most(x, y).mean, x, y);
  const float share = all_.shareOfMost(x, y);
  return share == 1.0f ? most : glm::mix(lightOf(all_.rest(x, y).mean, x, y), most, share);
}

bool LatticeLight::advance(const std::function<bool()>& keepGoing) {
  const std::uint32_t width = (all_.width() + stride_ - 1) / stride_,
                      height = (all_.height() + stride_ - 1) / stride_;
  const std::uint32_t band = std::max(kBandPixels / width, 1u) * 2;
  while (row_ < height) {
    const std::uint32_t end = std::min(row_ + band, height);
    tbb::parallel_for(row_, end, [&](std::uint32_t y) {
      for (std::uint32_t x = 0; x < width; ++x)
        out_[std::size_t{y} * width + x] = lightAt(x * stride_, y * stride_);
    });
    row_ = end;
    if (row_ < height && !keepGoing()) return false;
  }
  return true;
}

}  // namespace trex
