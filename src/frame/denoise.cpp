#include "src/frame/denoise.h"

#include <hwy/aligned_allocator.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cassert>
#include <new>
#include <optional>
#include <utility>

#include "src/core/memory.h"
#include "src/core/threads.h"
#include "src/frame/denoise_fragments.h"
#include "src/frame/denoise_kernels.h"

namespace trex {
namespace {

constexpr std::size_t kFilterPlanes = kGuidePlanes + 2 * kCellPlanes;
constexpr float kSurely = kNoiseTolerance * kNoiseTolerance;  // of variances
constexpr float kDoubt = 4.0f;  // of variances: they are estimates, too small where light is rare

// Pixels, margins included, that a thread does in about a millisecond with AVX2 at 3 GHz.
constexpr std::size_t kBandPixels = 16384;

/// Row k of the order in which rows `step` apart follow each other: most of what a row reads was
/// then read by the row before, and is in the cache still.
int rowInOrder(int k, int height, int step) {
  const int rows = height / step, longer = height % step;  // the first groups have a row more
  const int split = longer * (rows + 1);
  if (k < split) return k / (rows + 1) + k % (rows + 1) * step;
  return longer + (k - split) / rows + (k - split) % rows * step;
}

}  // namespace

struct GuessFilter::Work {
  Work(const FeatureImage& features, bool few);
  Work(const FeatureImage& features, const std::vector<vec3>& radiance,
       const std::vector<vec3>& variance, bool correction);

  /// Rows from row_ on, of the pass under way.
  void band();
  bool done() const { return pass_ == passes_.size(); }

  std::vector<vec3> out;

 private:
  enum Kind {
    kPrepare,
    kCalm,
    kSmooth,
    kSpread,
    kWeigh,
    kReach,
    kGather,
    kMix,
    kSettle,
    kLose,
    kFlow,
    kSettleFlow,
    kShare,
    kCollect,
    kFinish
  };
  struct Pass {
    Kind kind;
    int step = 1;
    bool swaps = false;  ///< what is written is read from then on
  };

  std::size_t index(int y) const {
    return static_cast<std::size_t>(y) * static_cast<std::size_t>(planes_.width);
  }
  void plan(bool few);
  void planFlow();
  void allocate(const FeatureImage& features);
  void copyPixel(const FeaturePart& part, float share, const vec3& light, const vec3& variance,
                 int x, int y);
  void clearMargins(int y);
  void prepareRow(int y);
  void calmRow(int y);
  void loseRow(int y);
  void finishRow(int y);
  void passRow(const Pass& pass, int y);

  FilterPlanes planes_;
  hwy::AlignedFreeUniquePtr<float[]> memory_;
  FilterKernels kernels_ = chooseFilterKernels();
  std::optional<Fragments> fragments_;  ///< none if every pixel shows one surface
  bool correction_, few_ = false;
  std::vector<Pass> passes_;
  std::size_t pass_ = 0;
  int row_ = 0;
};

GuessFilter::Work::Work(const FeatureImage& features, bool few) : correction_(false) {
  allocate(features);
  tbb::parallel_for(0u, features.height(), [&](std::uint32_t y) {
    clearMargins(static_cast<int>(y));
    for (std::uint32_t x = 0; x < features.width(); ++x) {
      const FeaturePart& part = features.most(x, y);
      copyPixel(part, features.shareOfMost(x, y), part.light, part.variance(), static_cast<int>(x),
                static_cast<int>(y));
    }
  });
  fragments_.emplace(features);
  if (fragments_->empty()) fragments_.reset();
  plan(few);
}

GuessFilter::Work::Work(const FeatureImage& features, const std::vector<vec3>& radiance,
                        const std::vector<vec3>& variance, bool correction)
    : correction_(correction) {
  allocate(features);
  tbb::parallel_for(0u, features.height(), [&](std::uint32_t y) {
    clearMargins(static_cast<int>(y));
    for (std::uint32_t x = 0; x < features.width(); ++x) {
      const std::size_t i = std::size_t{y} * features.width() + x;
      copyPixel(features.surface(x, y), 1.0f, radiance[i], variance[i], static_cast<int>(x),
                static_cast<int>(y));
    }
  });
  plan(false);
}

void GuessFilter::Work::allocate(const FeatureImage& features) {
  planes_.width = static_cast<int>(features.width());
  planes_.height = static_cast<int>(features.height());
  planes_.stride = FilterPlanes::strideOf(features.width());
  const std::size_t plane = planes_.stride * features.height();
  const std::size_t floats = plane * (kFilterPlanes + (correction_ ? 0 : kLostPlanes));
  memory_ = hwy::AllocateAligned<float>(floats);
  if (!memory_) throw std::bad_alloc();
  wantLargePages(memory_.get(), floats * sizeof(float));
  planes_.guides = memory_.get();
  planes_.cells = planes_.guides + plane * kGuidePlanes;
  planes_.written = planes_.cells + plane * kCellPlanes;
  if (!correction_) planes_.lost = planes_.written + plane * kCellPlanes;
}

void GuessFilter::Work::plan(bool few) {
  few_ = few;
  passes_ = {{kPrepare}};
  if (!correction_) passes_.push_back({kCalm, 1, true});
  passes_.push_back({few ? kSpread : kSmooth, 1, true});
  if (fragments_) passes_.insert(passes_.end(), {{kWeigh}, {kReach}});
  for (int i = 0; i < FilterPlanes::kIterations; ++i) passes_.push_back({kGather, 1 << i, true});
  if (fragments_) passes_.insert(passes_.end(), {{kMix}, {kSettle}, {kMix}, {kSettle}});
  if (!correction_) {
    passes_.push_back({kLose});
    planFlow();
    for (int i = 0; i < FilterPlanes::kIterations; ++i)
      passes_.insert(passes_.end(), {{kShare, 1 << i}, {kCollect, 1 << i}});
    planFlow();
  }
  passes_.push_back({kFinish});
}

void GuessFilter::Work::planFlow() {
  if (fragments_) passes_.insert(passes_.end(), {{kFlow}, {kSettleFlow}});
}

/// Until they are prepared, guides are features as they are, with the footprint in kSlope and the
/// share in kCover, the light of `written` is the variance, and all light counts as lost.
void GuessFilter::Work::copyPixel(const FeaturePart& part, float share, const vec3& light,
                                  const vec3& variance, int x, int y) {
  const std::size_t stride = planes_.stride;
  float* guide = planes_.guideRow(y) + x;
  const Feature& f = part.mean;
  // What reflects nothing is no surface to share with.
  putThree(f.normal * (1.0f - f.black), guide + kNormal * stride, stride);
  putThree(f.position, guide + kPosition * stride, stride);
  guide[kSlope * stride] = f.footprint;
  putThree(f.albedo, guide + kAlbedo * stride, stride);
  guide[kCover * stride] = share;
  putThree(light, planes_.cellRow(y) + x + kLight * stride, stride);
  putThree(variance, planes_.writtenRow(y) + x + kLight * stride, stride);
  if (planes_.lost != nullptr) putThree(light, planes_.lostRow(y) + x, stride);
}

void GuessFilter::Work::clearMargins(int y) {
  const auto clear = [&](float* pixels, float value) {
    std::fill(pixels - FilterPlanes::kMargin, pixels, value);
    std::fill(pixels + planes_.width, pixels - FilterPlanes::kMargin + planes_.stride, value);
  };
  for (std::size_t p = 0; p < kGuidePlanes; ++p) {
    clear(planes_.guideRow(y) + p * planes_.stride, p == kLength ? FilterPlanes::kOutside : 0.0f);
  }
  for (std::size_t p = 0; p < kCellPlanes; ++p) {
    clear(planes_.cellRow(y) + p * planes_.stride, 0.0f);
    clear(planes_.writtenRow(y) + p * planes_.stride, 0.0f);
  }
  if (planes_.lost == nullptr) return;
  for (std::size_t p = 0; p < kLostPlanes; ++p)
    clear(planes_.lostRow(y) + p * planes_.stride, 0.0f);
}

void GuessFilter::Work::prepareRow(int y) {
  const std::size_t stride = planes_.stride;
  for (int x = 0; x < planes_.width; ++x) {
    float *guide = planes_.guideRow(y) + x, *cell = planes_.cellRow(y) + x;
    const vec3 normal = getThree(guide + kNormal * stride, stride);
    const float length = glm::length(normal);
    if (length > 0.0f) putThree(normal / length, guide + kNormal * stride, stride);
    guide[kLength * stride] = length;
    guide[kSlope * stride] = slopeOf(length, guide[kSlope * stride]);
    const vec3 albedo = guideAlbedo(getThree(guide + kAlbedo * stride, stride));
    putThree(albedo, guide + kAlbedo * stride, stride);
    guide[kCover * stride] *= luminance(albedo);

    const vec3 light = getThree(cell + kLight * stride, stride) / albedo;
    putThree(light, cell + kLight * stride, stride);
    cell[kBright * stride] = luminance(light);
    const vec3 variance = getThree(planes_.writtenRow(y) + x + kLight * stride, stride);
    cell[kVariance * stride] = luminance(variance / (albedo * albedo));
  }
}

/// A pixel brighter than all around it, by no more than its noise, has met a rare path: it counts
/// as the brightest of them.
void GuessFilter::Work::calmRow(int y) {
  const std::size_t stride = planes_.stride;
  const int top = std::max(y - 1, 0), bottom = std::min(y + 1, planes_.height - 1);
  for (int x = 0; x < planes_.width; ++x) {
    const int left = std::max(x - 1, 0), right = std::min(x + 1, planes_.width - 1);
    float most = 0.0f;
    for (int v = top; v <= bottom; ++v) {
      const float* bright = planes_.cellRow(v) + kBright * stride;
      for (int u = left; u <= right; ++u) {
        if (u != x || v != y) most = std::max(most, bright[u]);
      }
    }
    const float *cell = planes_.cellRow(y) + x, bright = cell[kBright * stride];
    const float over = bright - most;
    const bool noise = few_ || over * over < kSurely * cell[kVariance * stride];
    const float scale = over > 0.0f && most > 0.0f && noise ? most / bright : 1.0f;
    float* written = planes_.writtenRow(y) + x;
    for (std::size_t p = kLight; p <= kBright; ++p) written[p * stride] = cell[p * stride] * scale;
    written[kVariance * stride] = cell[kVariance * stride];
  }
}

void GuessFilter::Work::loseRow(int y) {
  if (fragments_) fragments_->lose(y);
  const std::size_t stride = planes_.stride;
  for (int x = 0; x < planes_.width; ++x) {
    const float *guide = planes_.guideRow(y) + x, *cell = planes_.cellRow(y) + x;
    float* lost = planes_.lostRow(y) + x;
    putThree(getThree(lost, stride) / getThree(guide + kAlbedo * stride, stride) -
                 getThree(cell + kLight * stride, stride),
             lost, stride);
  }
}

void GuessFilter::Work::finishRow(int y) {
  const std::size_t stride = planes_.stride;
  vec3* row = out.data() + index(y);
  for (int x = 0; x < planes_.width; ++x) {
    const float *guide = planes_.guideRow(y) + x, *cell = planes_.cellRow(y) + x;
    const vec3 albedo = getThree(guide + kAlbedo * stride, stride);
    vec3 v = getThree(cell + kLight * stride, stride);
    if (!correction_) {
      const float share = guide[kCover * stride] / luminance(albedo);
      row[x] = glm::max(v + getThree(planes_.lostRow(y) + x, stride), vec3(0.0f)) * albedo * share;
      continue;
    }
    v *= albedo;
    const float value = cell[kBright * stride];
    const float square = value * value;
    row[x] = v * (square > 0.0f ? square / (square + kDoubt * cell[kVariance * stride]) : 0.0f);
  }
  if (fragments_) fragments_->add(y, row);
}

void GuessFilter::Work::passRow(const Pass& pass, int y) {
  switch (pass.kind) {
    case kPrepare:
      return prepareRow(y);
    case kCalm:
      return calmRow(y);
    case kSmooth:
      return kernels_.smoothVariance(planes_, y);
    case kSpread:
      return kernels_.spreadVariance(planes_, y);
    case kWeigh:
      return fragments_->weigh(planes_, y);
    case kReach:
      return fragments_->reach(planes_, y);
    case kGather:
      return kernels_.gather(planes_, y, pass.step);
    case kMix:
      return fragments_->mix(planes_, y);
    case kSettle:
      return fragments_->settle(y);
    case kLose:
      return loseRow(y);
    case kFlow:
      return fragments_->flow(planes_, y);
    case kSettleFlow:
      return fragments_->settleFlow(planes_, y);
    case kShare:
      return kernels_.share(planes_, y, pass.step);
    case kCollect:
      return kernels_.collect(planes_, y, pass.step);
    case kFinish:
      return finishRow(y);
  }
}

void GuessFilter::Work::band() {
  const Pass& pass = passes_[pass_];
  if (pass.kind == kFinish && row_ == 0) out.resize(index(planes_.height));
  const auto threads = static_cast<std::size_t>(threadsAllowed());
  const std::size_t rows = std::max<std::size_t>(kBandPixels / planes_.stride, 1) * threads;
  const int end = static_cast<int>(
      std::min(static_cast<std::size_t>(row_) + rows, static_cast<std::size_t>(planes_.height)));
  tbb::parallel_for(row_, end,
                    [&](int k) { passRow(pass, rowInOrder(k, planes_.height, pass.step)); });
  row_ = end;
  if (row_ < planes_.height) return;
  if (pass.swaps) std::swap(planes_.cells, planes_.written);
  ++pass_;
  row_ = 0;
}

GuessFilter::GuessFilter(const FeatureImage& features, bool few)
    : work_(std::make_unique<Work>(features, few)) {}
GuessFilter::GuessFilter(const FeatureImage& features, const std::vector<vec3>& radiance,
                         const std::vector<vec3>& variance, bool correction)
    : work_(std::make_unique<Work>(features, radiance, variance, correction)) {}
GuessFilter::GuessFilter(GuessFilter&& other) noexcept = default;
GuessFilter& GuessFilter::operator=(GuessFilter&& other) noexcept = default;
GuessFilter::~GuessFilter() = default;

bool GuessFilter::advance(const std::function<bool()>& keepGoing) {
  while (!work_->done()) {
    work_->band();
    if (!work_->done() && !keepGoing()) return false;
  }
  return true;
}

std::vector<vec3> GuessFilter::result() {
  assert(work_->done());
  return std::move(work_->out);
}

std::uint64_t GuessFilter::bytesNeeded(std::uint32_t width, std::uint32_t height) {
  const std::uint64_t floats = FilterPlanes::strideOf(width) * (kFilterPlanes + kLostPlanes);
  return (floats * sizeof(float) + width * sizeof(vec3)) * height +
         Fragments::bytesNeeded(width, height);
}

namespace {

std::vector<vec3> inOneGo(GuessFilter filter) {
  filter.advance([] { return true; });
  return filter.result();
}

}  // namespace

std::vector<vec3> denoiseGuess(const FeatureImage& features, const std::vector<vec3>& radiance,
                               const std::vector<vec3>& variance) {
  return inOneGo({features, radiance, variance, false});
}

std::vector<vec3> denoiseCorrection(const FeatureImage& features,
                                    const std::vector<vec3>& difference,
                                    const std::vector<vec3>& variance) {
  return inOneGo({features, difference, variance, true});
}

}  // namespace trex
