#include "src/frame/denoise_fragments.h"

#include <algorithm>

#include "src/frame/alike.h"

namespace trex {
namespace {

// The k-th of eight pixels around one, row by row: where it is, 1 / its distance, and its weight in
// an even picture. The one opposite is 7 - k.
constexpr int kAcross[8] = {-1, 0, 1, -1, 1, -1, 0, 1};
constexpr int kDown[8] = {-1, -1, -1, 0, 0, 1, 1, 1};
constexpr float kNear = 1.0f, kCorner = 0.70710678f;
constexpr float kPerPixel[8] = {kCorner, kNear, kCorner, kNear, kNear, kCorner, kNear, kCorner};
constexpr float kEven[8] = {1.0f / 16.0f, 1.0f / 8.0f,  1.0f / 16.0f, 1.0f / 8.0f,
                            1.0f / 8.0f,  1.0f / 16.0f, 1.0f / 8.0f,  1.0f / 16.0f};
constexpr float kCentre = 1.0f / 4.0f;

}  // namespace

Fragments::Fragments(const FeatureImage& features)
    : width_(static_cast<int>(features.width())), height_(static_cast<int>(features.height())) {
  for (std::uint32_t y = 0; y < features.height(); ++y) {
    rows_.push_back(all_.size());
    for (std::uint32_t x = 0; x < features.width(); ++x) {
      const FeaturePart& part = features.rest(x, y);
      if (part.count == 0.0f || (!part.scatters() && part.light == vec3(0.0f))) continue;
      Fragment f;
      const float length = part.scatters() ? glm::length(part.mean.normal) : 0.0f;
      if (length > 0.0f) f.normal = part.mean.normal / length;
      f.position = part.mean.position;
      f.slope = slopeOf(length, part.mean.footprint);
      f.albedo = guideAlbedo(part.mean.albedo);
      f.raw = f.light = part.light / f.albedo;
      f.variance = luminance(part.variance() / (f.albedo * f.albedo));
      f.share = 1.0f - features.shareOfMost(x, y);
      f.cover = f.share * luminance(f.albedo);
      f.x = static_cast<int>(x);
      all_.push_back(f);
    }
  }
  rows_.push_back(all_.size());
  if (all_.empty()) return;
  const std::size_t pixels = std::size_t{features.width()} * features.height();
  fragmentOf_.assign(pixels, kNone);
  reach_.assign(pixels, 0.0f);
  for (int y = 0; y < height_; ++y) {
    for (std::size_t i = rows_[std::size_t(y)]; i < rows_[std::size_t(y) + 1]; ++i)
      fragmentOf_[pixel(all_[i].x, y)] = static_cast<std::int32_t>(i);
  }
}

template <typename Work>
void Fragments::each(int y, Work work) {
  const auto row = static_cast<std::size_t>(y);
  for (std::size_t i = rows_[row]; i < rows_[row + 1]; ++i) work(all_[i]);
}

template <typename Visit>
void Fragments::around(int x, int y, Visit visit) const {
  for (std::size_t k = 0; k < 8; ++k) {
    const int u = x + kAcross[k], v = y + kDown[k];
    if (u >= 0 && v >= 0 && u < width_ && v < height_) visit(k, u, v);
  }
}

void Fragments::weigh(const FilterPlanes& planes, int y) {
  each(y, [&](Fragment& f) { weighOne(planes, f, y); });
}

/// Its own few samples tell little of its variance: those around it, of as many, tell more.
void Fragments::weighOne(const FilterPlanes& planes, Fragment& f, int y) {
  const std::size_t stride = planes.stride;
  const Shown own{f.normal, f.position, f.slope};
  float sum = 0.0f, weights = 0.0f;
  around(f.x, y, [&](std::size_t k, int u, int v) {
    const float* guide = planes.guideRow(v) + u;
    const Shown most{getThree(guide + kNormal * stride, stride),
                     getThree(guide + kPosition * stride, stride), guide[kSlope * stride]};
    const float w = kEven[k] * alike(own, most, kPerPixel[k]);
    f.toMost[k] = w;
    const vec3 albedo = getThree(guide + kAlbedo * stride, stride);
    const float share = guide[kCover * stride] / luminance(albedo);
    sum += w * share * planes.cellRow(v)[std::size_t(u) + kVariance * stride];
    weights += w;
    const std::int32_t i = fragmentOf_[pixel(u, v)];
    if (i == kNone) return;
    const Fragment& other = at(i);
    f.toRest[k] = kEven[k] * alike(own, {other.normal, other.position, other.slope}, kPerPixel[k]);
  });
  if (weights > 0.0f) f.variance = std::max(f.variance, sum / (weights * f.share));
}

void Fragments::reach(const FilterPlanes& planes, int y) {
  const auto cover = [&](int u, int v) {
    return planes.guideRow(v)[std::size_t(u) + kCover * planes.stride];
  };
  each(y, [&](Fragment& f) {
    around(f.x, y, [&](std::size_t k, int u, int v) {
      f.reach += f.toMost[k] * cover(u, v);
      if (const std::int32_t i = fragmentOf_[pixel(u, v)]; i != kNone)
        f.reach += f.toRest[k] * at(i).cover;
    });
  });
  for (int x = 0; x < width_; ++x) {
    float sum = 0.0f;
    around(x, y, [&](std::size_t k, int u, int v) {
      if (const std::int32_t i = fragmentOf_[pixel(u, v)]; i != kNone)
        sum += at(i).toMost[7 - k] * at(i).cover;
    });
    reach_[pixel(x, y)] = sum;
  }
}

void Fragments::mix(const FilterPlanes& planes, int y) {
  each(y, [&](Fragment& f) { mixOne(planes, f, y); });
}

void Fragments::mixOne(const FilterPlanes& planes, Fragment& f, int y) {
  const std::size_t stride = planes.stride;
  const float bright = luminance(f.light);
  vec3 sum = kCentre * f.light;
  float variance = kCentre * kCentre * f.variance, weights = kCentre;
  const auto add = [&](float even, const vec3& light, float otherVariance) {
    const float difference = bright - luminance(light);
    const float noise = 2.0f * kNoiseTolerance * kNoiseTolerance * f.variance;
    const float w = even * expOfMinus(difference * difference / (noise + 1e-30f));
    sum += w * light;
    variance += w * w * otherVariance;
    weights += w;
  };
  around(f.x, y, [&](std::size_t k, int u, int v) {
    if (f.toMost[k] > 0.0f) {
      const float* cell = planes.cellRow(v) + u;
      add(f.toMost[k], getThree(cell + kLight * stride, stride), cell[kVariance * stride]);
    }
    if (f.toRest[k] > 0.0f) {
      const Fragment& other = at(fragmentOf_[pixel(u, v)]);
      add(f.toRest[k], other.light, other.variance);
    }
  });
  f.next = sum / weights;
  f.nextVariance = variance / (weights * weights);
}

void Fragments::settle(int y) {
  each(y, [](Fragment& f) {
    f.light = f.next;
    f.variance = f.nextVariance;
  });
}

void Fragments::lose(int y) {
  each(y, [](Fragment& f) { f.lost = f.raw - f.light; });
}

void Fragments::flow(const FilterPlanes& planes, int y) {
  each(y, [&](Fragment& f) { flowOne(planes, f, y); });
  for (int x = 0; x < width_; ++x) {
    if (reach_[pixel(x, y)] > 0.0f) flowOfMost(planes, x, y);
  }
}

/// What flows between two is the same seen from both, and neither gives more than it has.
void Fragments::flowOne(const FilterPlanes& planes, Fragment& f, int y) {
  const std::size_t stride = planes.stride;
  f.next = f.lost;
  around(f.x, y, [&](std::size_t k, int u, int v) {
    if (f.toMost[k] > 0.0f) {
      const vec3 lost = getThree(planes.lostRow(v) + u, stride);
      const float cover = planes.guideRow(v)[std::size_t(u) + kCover * stride];
      f.next += (lost - f.lost) * (f.toMost[k] * cover / std::max(f.reach, reach_[pixel(u, v)]));
    }
    if (f.toRest[k] > 0.0f) {
      const Fragment& other = at(fragmentOf_[pixel(u, v)]);
      f.next +=
          (other.lost - f.lost) * (f.toRest[k] * other.cover / std::max(f.reach, other.reach));
    }
  });
}

void Fragments::flowOfMost(const FilterPlanes& planes, int x, int y) {
  const std::size_t stride = planes.stride;
  const vec3 lost = getThree(planes.lostRow(y) + x, stride);
  vec3 sum = lost;
  around(x, y, [&](std::size_t k, int u, int v) {
    const std::int32_t i = fragmentOf_[pixel(u, v)];
    if (i == kNone || !(at(i).toMost[7 - k] > 0.0f)) return;
    const Fragment& f = at(i);
    sum += (f.lost - lost) * (f.toMost[7 - k] * f.cover / std::max(f.reach, reach_[pixel(x, y)]));
  });
  putThree(sum, planes.writtenRow(y) + x + kLight * stride, stride);
}

void Fragments::settleFlow(const FilterPlanes& planes, int y) {
  each(y, [](Fragment& f) { f.lost = f.next; });
  for (int x = 0; x < width_; ++x) {
    if (!(reach_[pixel(x, y)] > 0.0f)) continue;
    putThree(getThree(planes.writtenRow(y) + x + kLight * planes.stride, planes.stride),
             planes.lostRow(y) + x, planes.stride);
  }
}

void Fragments::add(int y, vec3* row) const {
  const auto at = static_cast<std::size_t>(y);
  for (std::size_t i = rows_[at]; i < rows_[at + 1]; ++i) {
    const Fragment& f = all_[i];
    row[f.x] += glm::max(f.light + f.lost, vec3(0.0f)) * f.albedo * f.share;
  }
}

std::uint64_t Fragments::bytesNeeded(std::uint32_t width, std::uint32_t height) {
  constexpr std::uint64_t kAPixel = sizeof(Fragment) + sizeof(std::int32_t) + sizeof(float);
  return kAPixel * width * height;
}

}  // namespace trex
