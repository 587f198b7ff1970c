// Compiled once for each instruction set [Highway's foreach_target]. No fused multiply-add, no
// approximate reciprocal: they would differ from one to the next.
#include "src/frame/denoise_kernels.h"

#include <algorithm>
#include <cstddef>
#include <cstdlib>
#include <limits>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "src/frame/denoise_kernels.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#ifndef TREX_FILTER_ONCE
#define TREX_FILTER_ONCE
namespace trex {
namespace {

// Light that is lost, rare dots, may go farther than what is taken for the same.
constexpr float kAlbedoTolerance = 0.2f;
constexpr float kInfinite = std::numeric_limits<float>::infinity();

// A neighbour of a pixel.
struct Tap {
  std::ptrdiff_t guide, cell;  // floats from the pixel to it
  float spline;                // weight of an even picture
  float perPixel;              // 1 / (its distance in pixels)
};

struct Taps {
  Tap tap[24];
  int count = 0;
};

// Weights of an even picture by the distance along an axis, of 5 and of 3 pixels.
constexpr float kWide[3] = {3.0f / 8.0f, 1.0f / 4.0f, 1.0f / 16.0f};
constexpr float kNarrow[2] = {1.0f / 2.0f, 1.0f / 4.0f};

// The pixels `step` apart, without the centre, whose rows are in the picture.
template <std::size_t kReach>
Taps listTaps(const FilterPlanes& planes, int y, int step, const float (&spline)[kReach]) {
  constexpr int kMost = static_cast<int>(kReach) - 1;
  // 1 / sqrt(dx^2 + dy^2) by the squared distance.
  constexpr float kInverse[9] = {0.0f,        1.0f, 0.70710678f, 0.0f,       0.5f,
                                 0.44721360f, 0.0f, 0.0f,        0.35355339f};
  const float inverseStep = 1.0f / static_cast<float>(step);
  const auto stride = static_cast<std::ptrdiff_t>(planes.stride);
  Taps taps;
  for (int dy = -kMost; dy <= kMost; ++dy) {
    if (y + dy * step < 0 || y + dy * step >= planes.height) continue;
    for (int dx = -kMost; dx <= kMost; ++dx) {
      if (dx == 0 && dy == 0) continue;
      Tap& tap = taps.tap[taps.count++];
      tap.guide = dy * step * std::ptrdiff_t{kGuidePlanes} * stride + dx * step;
      tap.cell = dy * step * std::ptrdiff_t{kCellPlanes} * stride + dx * step;
      tap.spline = spline[std::abs(dx)] * spline[std::abs(dy)];
      tap.perPixel = inverseStep * kInverse[dx * dx + dy * dy];
    }
  }
  return taps;
}

}  // namespace
}  // namespace trex
#endif

HWY_BEFORE_NAMESPACE();
namespace trex {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

using DF = hn::CappedTag<float, FilterPlanes::kRound>;
using DI = hn::RebindToSigned<DF>;
using VF = hn::Vec<DF>;
using MF = hn::Mask<DF>;

HWY_INLINE VF set(float value) { return hn::Set(DF(), value); }

struct Three {
  VF x, y, z;
};

HWY_INLINE Three loadThree(const float* at, std::size_t stride) {
  const DF df;
  return {hn::LoadU(df, at), hn::LoadU(df, at + stride), hn::LoadU(df, at + 2 * stride)};
}
HWY_INLINE Three minus(const Three& a, const Three& b) {
  return {hn::Sub(a.x, b.x), hn::Sub(a.y, b.y), hn::Sub(a.z, b.z)};
}
HWY_INLINE VF dot(const Three& a, const Three& b) {
  return hn::Add(hn::Add(hn::Mul(a.x, b.x), hn::Mul(a.y, b.y)), hn::Mul(a.z, b.z));
}
HWY_INLINE VF luminanceOf(const Three& v) {
  return dot(v, {set(0.2126f), set(0.7152f), set(0.0722f)});
}

// exp(-x), within 2e-4 of itself; 0 where x is kFarApart or more. A polynomial for the fraction of
// the power of two; its integer part is shifted from where adding kUnits puts it to the exponent.
HWY_INLINE VF expOfMinus(VF x) {
  constexpr float kUnits = 0x1.8p23f;  // whole numbers of floats about it are their last bits
  constexpr float kBias = 127.0f;
  const DF df;
  const DI di;
  const VF y = hn::Mul(x, set(-1.44269504f));
  const VF whole = hn::Floor(y);
  const VF f = hn::Sub(y, whole);
  VF mantissa = hn::Add(set(0.226163f), hn::Mul(f, set(0.0778610f)));
  mantissa = hn::Add(set(0.695976f), hn::Mul(f, mantissa));
  mantissa = hn::Add(set(1.0f), hn::Mul(f, mantissa));
  const auto exponent = hn::BitCast(di, hn::Add(whole, set(kUnits + kBias)));
  const VF power = hn::BitCast(df, hn::ShiftLeft<23>(exponent));
  return hn::IfThenElseZero(hn::Lt(x, set(kFarApart)), hn::Mul(mantissa, power));
}

// A part of a row, short enough for all that is read for it to stay in the innermost cache.
constexpr int kPart = 128;
constexpr int kLanes = static_cast<int>(hn::MaxLanes(DF()));
static_assert(kPart % FilterPlanes::kRound == 0);

// The arrays come first: aligned stores go to them, and each holds whole vectors.
struct alignas(64) Part {
  float distance[kPart], power[kPart];
  float sum[kCellPlanes][kPart], weights[kPart];
  int width;  // rounded up to whole vectors
};
static_assert(sizeof(float[kPart]) % 64 == 0);

// How little the pixels of a part share with their neighbours by what they show: their weight is
// power * exp(-distance), where power is the 4th of the cosine between their normals. False if
// all are infinitely far.
HWY_INLINE bool guideDistances(const float* guides, std::size_t stride, std::ptrdiff_t neighbour,
                               float perPixel, Part& part) {
  const DF df;
  VF nearest = set(kInfinite);
  for (int x = 0; x < part.width; x += kLanes) {
    const float* guide = guides + x;
    const float* other = guide + neighbour;
    const Three normal = loadThree(guide + kNormal * stride, stride);
    const Three otherNormal = loadThree(other + kNormal * stride, stride);
    const VF cosine = hn::Min(dot(normal, otherNormal), set(1.0f));
    const VF c2 = hn::Mul(cosine, cosine);
    VF power = hn::Mul(c2, c2);
    const Three between = minus(loadThree(other + kPosition * stride, stride),
                                loadThree(guide + kPosition * stride, stride));
    // The same from both sides, as both must agree on what they share.
    const VF off = hn::Mul(hn::Abs(dot(normal, between)), hn::LoadU(df, guide + kSlope * stride));
    const VF otherOff =
        hn::Mul(hn::Abs(dot(otherNormal, between)), hn::LoadU(df, other + kSlope * stride));
    const Three colour = minus(loadThree(guide + kAlbedo * stride, stride),
                               loadThree(other + kAlbedo * stride, stride));
    const VF colourDistance =
        hn::Mul(dot(colour, colour), set(1.0f / (kAlbedoTolerance * kAlbedoTolerance)));
    VF distance = hn::Add(hn::Mul(hn::Add(off, otherOff), set(0.5f * perPixel)), colourDistance);
    // Beyond, light comes from elsewhere.
    distance = hn::IfThenElse(hn::Gt(cosine, set(0.5f)), distance, set(kInfinite));
    // Where one shows nothing, only those alike go together.
    const VF length = hn::LoadU(df, guide + kLength * stride);
    const VF otherLength = hn::LoadU(df, other + kLength * stride);
    const MF nothing = hn::Lt(hn::Mul(length, otherLength), set(1e-3f));
    if (HWY_UNLIKELY(!hn::AllFalse(df, nothing))) {
      const VF alike = hn::IfThenElse(hn::Eq(length, otherLength), hn::Zero(df), set(kInfinite));
      distance = hn::IfThenElse(nothing, alike, distance);
      power = hn::IfThenElse(nothing, set(1.0f), power);
    }
    hn::Store(distance, df, part.distance + x);
    hn::Store(power, df, part.power + x);
    nearest = hn::Min(distance, nearest);
  }
  return !hn::AllFalse(df, hn::Lt(nearest, set(kFarApart)));
}

template <typename Work>
HWY_INLINE void forParts(int width, Part& part, Work work) {
  for (int x = 0; x < width; x += kPart) {
    part.width = std::min((width - x + kLanes - 1) / kLanes * kLanes, kPart);
    work(x);
  }
}

HWY_INLINE VF guideWeight(const Part& part, int x, float spline) {
  const DF df;
  return hn::Mul(set(spline), hn::Mul(hn::Load(df, part.power + x),
                                      expOfMinus(hn::Load(df, part.distance + x))));
}

HWY_INLINE void addTo(float* sum, VF value) {
  const DF df;
  hn::Store(hn::Add(hn::Load(df, sum), value), df, sum);
}

// A variance from few samples is itself noise and rarely too large: the mean over a neighbourhood
// bounds it from below, and with kSpread the variance between pixels there.
template <bool kSpread>
HWY_INLINE void neighbourVariance(const FilterPlanes& planes, int y) {
  const DF df;
  const std::size_t stride = planes.stride;
  const Taps taps = listTaps(planes, y, 1, kWide);
  Part part;
  float *sums = part.sum[kVariance], *first = part.sum[kLight], *second = part.sum[kLight + 1];
  forParts(planes.width, part, [&](int begin) {
    const float* cells = planes.cellRow(y) + begin;
    float* written = planes.writtenRow(y) + begin;
    std::copy_n(cells + kVariance * stride, part.width, sums);
    std::fill_n(part.weights, part.width, 1.0f);
    std::fill_n(first, part.width, 0.0f);
    std::fill_n(second, part.width, 0.0f);
    for (int t = 0; t < taps.count; ++t) {
      const Tap& tap = taps.tap[t];
      if (!guideDistances(planes.guideRow(y) + begin, stride, tap.guide, 1.0f / 3.0f, part))
        continue;
      const float* other = cells + tap.cell;
      for (int x = 0; x < part.width; x += kLanes) {
        const VF w = guideWeight(part, x, 1.0f);
        addTo(sums + x, hn::Mul(w, hn::LoadU(df, other + kVariance * stride + x)));
        addTo(part.weights + x, w);
        if constexpr (kSpread) {
          const VF difference = hn::Sub(hn::LoadU(df, other + kBright * stride + x),
                                        hn::LoadU(df, cells + kBright * stride + x));
          addTo(first + x, hn::Mul(w, difference));
          addTo(second + x, hn::Mul(w, hn::Mul(difference, difference)));
        }
      }
    }
    for (std::size_t p = kLight; p < kVariance; ++p)
      std::copy_n(cells + p * stride, part.width, written + p * stride);
    for (int x = 0; x < part.width; x += kLanes) {
      const VF weights = hn::Load(df, part.weights + x);
      VF variance = hn::Max(hn::LoadU(df, cells + kVariance * stride + x),
                            hn::Div(hn::Load(df, sums + x), weights));
      if constexpr (kSpread) {
        const VF mean = hn::Div(hn::Load(df, first + x), weights);
        const VF spread = hn::Sub(hn::Div(hn::Load(df, second + x), weights), hn::Mul(mean, mean));
        variance = hn::Max(variance, spread);
      }
      hn::StoreU(variance, df, written + kVariance * stride + x);
    }
  });
}

void smoothVariance(const FilterPlanes& planes, int y) { neighbourVariance<false>(planes, y); }
void spreadVariance(const FilterPlanes& planes, int y) { neighbourVariance<true>(planes, y); }

HWY_INLINE void startGather(const float* cells, std::size_t stride, Part& part) {
  const DF df;
  const VF weight = set(9.0f / 64.0f);
  for (int x = 0; x < part.width; x += kLanes) {
    const Three light = loadThree(cells + kLight * stride + x, stride);
    hn::Store(hn::Mul(weight, light.x), df, part.sum[kLight] + x);
    hn::Store(hn::Mul(weight, light.y), df, part.sum[kLight + 1] + x);
    hn::Store(hn::Mul(weight, light.z), df, part.sum[kLight + 2] + x);
    const VF variance = hn::LoadU(df, cells + kVariance * stride + x);
    hn::Store(hn::Mul(hn::Mul(weight, weight), variance), df, part.sum[kVariance] + x);
    hn::Store(weight, df, part.weights + x);
  }
}

HWY_INLINE void gatherTap(const float* cells, std::size_t stride, const Tap& tap, Part& part) {
  const DF df;
  for (int x = 0; x < part.width; x += kLanes) {
    const float* cell = cells + x;
    const float* other = cell + tap.cell;
    const VF difference =
        hn::Sub(hn::LoadU(df, cell + kBright * stride), hn::LoadU(df, other + kBright * stride));
    const VF variance = hn::LoadU(df, other + kVariance * stride);
    // By its own variance alone: a rare bright neighbour, whose variance is large, must not be
    // taken for one of those alike.
    const VF noise = hn::Mul(hn::LoadU(df, cell + kVariance * stride),
                             set(2.0f * kNoiseTolerance * kNoiseTolerance));
    const VF far = hn::Add(hn::Load(df, part.distance + x),
                           hn::Div(hn::Mul(difference, difference), hn::Add(noise, set(1e-30f))));
    const VF w = hn::Mul(set(tap.spline), hn::Mul(hn::Load(df, part.power + x), expOfMinus(far)));
    const Three light = loadThree(other + kLight * stride, stride);
    addTo(part.sum[kLight] + x, hn::Mul(w, light.x));
    addTo(part.sum[kLight + 1] + x, hn::Mul(w, light.y));
    addTo(part.sum[kLight + 2] + x, hn::Mul(w, light.z));
    addTo(part.sum[kVariance] + x, hn::Mul(hn::Mul(w, w), variance));
    addTo(part.weights + x, w);
  }
}

HWY_INLINE void finishGather(const Part& part, float* written, std::size_t stride) {
  const DF df;
  for (int x = 0; x < part.width; x += kLanes) {
    const VF weights = hn::Load(df, part.weights + x);
    Three light = loadThree(part.sum[kLight] + x, kPart);
    light = {hn::Div(light.x, weights), hn::Div(light.y, weights), hn::Div(light.z, weights)};
    const VF bright = luminanceOf(light);
    const VF variance = hn::Div(hn::Load(df, part.sum[kVariance] + x), hn::Mul(weights, weights));
    hn::StoreU(light.x, df, written + kLight * stride + x);
    hn::StoreU(light.y, df, written + (kLight + 1) * stride + x);
    hn::StoreU(light.z, df, written + (kLight + 2) * stride + x);
    hn::StoreU(bright, df, written + kBright * stride + x);
    hn::StoreU(variance, df, written + kVariance * stride + x);
  }
}

// Tap by tap over a part of the row rather than pixel by pixel: short independent iterations keep
// the processor busier than one long chain of a pixel.
void gather(const FilterPlanes& planes, int y, int step) {
  const std::size_t stride = planes.stride;
  const Taps taps = listTaps(planes, y, step, kWide);
  Part part;
  forParts(planes.width, part, [&](int first) {
    const float* guides = planes.guideRow(y) + first;
    const float* cells = planes.cellRow(y) + first;
    startGather(cells, stride, part);
    for (int t = 0; t < taps.count; ++t) {
      const Tap& tap = taps.tap[t];
      if (guideDistances(guides, stride, tap.guide, tap.perPixel, part))
        gatherTap(cells, stride, tap, part);
    }
    finishGather(part, planes.writtenRow(y) + first, stride);
  });
}

constexpr float kCentre = 1.0f / 4.0f;  // the weight of a pixel in its own 3x3

// A pixel's light goes to those alike in proportion to weight times cover, so that it sends as much
// light as it has however their albedos differ.
void share(const FilterPlanes& planes, int y, int step) {
  const DF df;
  const std::size_t stride = planes.stride;
  const Taps taps = listTaps(planes, y, step, kNarrow);
  Part part;
  forParts(planes.width, part, [&](int first) {
    const float* guides = planes.guideRow(y) + first;
    const float* cover = guides + kCover * stride;
    for (int x = 0; x < part.width; x += kLanes)
      hn::Store(hn::Mul(set(kCentre), hn::LoadU(df, cover + x)), df, part.weights + x);
    for (int t = 0; t < taps.count; ++t) {
      const Tap& tap = taps.tap[t];
      if (!guideDistances(guides, stride, tap.guide, tap.perPixel, part)) continue;
      for (int x = 0; x < part.width; x += kLanes) {
        addTo(part.weights + x,
              hn::Mul(guideWeight(part, x, tap.spline), hn::LoadU(df, cover + tap.guide + x)));
      }
    }
    const float* lost = planes.lostRow(y) + first;
    float* written = planes.writtenRow(y) + first + kLight * stride;
    for (int x = 0; x < part.width; x += kLanes) {
      // Beside the picture all is zero.
      const VF scale =
          hn::Div(hn::LoadU(df, cover + x), hn::Add(hn::Load(df, part.weights + x), set(1e-30f)));
      const Three light = loadThree(lost + x, stride);
      hn::StoreU(hn::Mul(light.x, scale), df, written + x);
      hn::StoreU(hn::Mul(light.y, scale), df, written + stride + x);
      hn::StoreU(hn::Mul(light.z, scale), df, written + 2 * stride + x);
    }
  });
}

void collect(const FilterPlanes& planes, int y, int step) {
  const DF df;
  const std::size_t stride = planes.stride;
  const Taps taps = listTaps(planes, y, step, kNarrow);
  Part part;
  forParts(planes.width, part, [&](int first) {
    const float* guides = planes.guideRow(y) + first;
    const float* shares = planes.writtenRow(y) + first + kLight * stride;
    for (int x = 0; x < part.width; x += kLanes) {
      const Three own = loadThree(shares + x, stride);
      hn::Store(hn::Mul(set(kCentre), own.x), df, part.sum[kLight] + x);
      hn::Store(hn::Mul(set(kCentre), own.y), df, part.sum[kLight + 1] + x);
      hn::Store(hn::Mul(set(kCentre), own.z), df, part.sum[kLight + 2] + x);
    }
    for (int t = 0; t < taps.count; ++t) {
      const Tap& tap = taps.tap[t];
      if (!guideDistances(guides, stride, tap.guide, tap.perPixel, part)) continue;
      for (int x = 0; x < part.width; x += kLanes) {
        const VF w = guideWeight(part, x, tap.spline);
        const Three other = loadThree(shares + tap.cell + x, stride);
        addTo(part.sum[kLight] + x, hn::Mul(w, other.x));
        addTo(part.sum[kLight + 1] + x, hn::Mul(w, other.y));
        addTo(part.sum[kLight + 2] + x, hn::Mul(w, other.z));
      }
    }
    float* lost = planes.lostRow(y) + first;
    for (std::size_t p = 0; p < kLostPlanes; ++p) {
      for (int x = 0; x < part.width; x += kLanes)
        hn::StoreU(hn::Load(df, part.sum[p] + x), df, lost + p * stride + x);
    }
  });
}

FilterKernels filterKernels() { return {smoothVariance, spreadVariance, gather, share, collect}; }

}  // namespace HWY_NAMESPACE
}  // namespace trex
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace trex {
HWY_EXPORT(filterKernels);
FilterKernels chooseFilterKernels() {
  hwy::GetChosenTarget().Update(hwy::SupportedTargets());
  return HWY_DYNAMIC_DISPATCH(filterKernels)();
}
}  // namespace trex
#endif
