#include "src/frame/denoise.h"

#include <hwy/aligned_allocator.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <cassert>
#include <new>
#include <utility>

#include "src/frame/denoise_kernels.h"

namespace trex {
namespace {

constexpr float kPlaneTolerance = 1.0f;  // pixel widths off the surface's plane
constexpr std::size_t kFilterPlanes = kGuidePlanes + 2 * kCellPlanes;
constexpr float kLeastAlbedo = 0.02f;
constexpr float kDoubt = 4.0f;  // of variances: they are estimates, too small where light is rare

// Pixels, margins included, that a thread does in about a millisecond with AVX2 at 3 GHz.
constexpr std::size_t kBandPixels = 16384;

vec3 getThree(const float* at, std::size_t stride) { return {at[0], at[stride], at[2 * stride]}; }
void putThree(const vec3& v, float* at, std::size_t stride) {
  at[0] = v.x;
  at[stride] = v.y;
  at[2 * stride] = v.z;
}

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
  Work(const FeatureImage& features, const std::vector<vec3>& radiance,
       const std::vector<vec3>& variance, const std::vector<vec3>* calm, bool correction);

  /// Rows from row_ on, of the pass under way.
  void band();
  bool done() const { return pass_ == kPasses; }

  std::vector<vec3> out;

 private:
  enum Pass {
    kPrepare,
    kSmooth,
    kGather,
    kLose = kGather + FilterPlanes::kIterations,
    kGiveBack,  // two passes a step
    kFinish = kGiveBack + 2 * FilterPlanes::kIterations,
    kPasses
  };

  int step() const {
    if (pass_ >= kGather && pass_ < kLose) return 1 << (pass_ - kGather);
    if (pass_ >= kGiveBack && pass_ < kFinish) return 1 << ((pass_ - kGiveBack) / 2);
    return 1;
  }
  std::size_t index(int y) const {
    return static_cast<std::size_t>(y) * static_cast<std::size_t>(planes_.width);
  }
  void copyRow(const FeatureImage& features, const vec3* light, const vec3* variance, int y);
  void copyLost(const vec3* radiance, int y);
  void clearMargins(int y);
  void prepareRow(int y);
  void loseRow(int y);
  void finishRow(int y);
  void passRow(int y);

  FilterPlanes planes_;
  hwy::AlignedFreeUniquePtr<float[]> memory_;
  FilterKernels kernels_ = chooseFilterKernels();
  bool correction_;
  int pass_ = kPrepare, row_ = 0;
};

GuessFilter::Work::Work(const FeatureImage& features, const std::vector<vec3>& radiance,
                        const std::vector<vec3>& variance, const std::vector<vec3>* calm,
                        bool correction)
    : correction_(correction) {
  planes_.width = static_cast<int>(features.width());
  planes_.height = static_cast<int>(features.height());
  planes_.stride = FilterPlanes::strideOf(features.width());
  const std::size_t plane = planes_.stride * features.height();
  memory_ = hwy::AllocateAligned<float>(plane * (kFilterPlanes + (correction ? 0 : kLostPlanes)));
  if (!memory_) throw std::bad_alloc();
  planes_.guides = memory_.get();
  planes_.cells = planes_.guides + plane * kGuidePlanes;
  planes_.written = planes_.cells + plane * kCellPlanes;
  if (!correction) planes_.lost = planes_.written + plane * kCellPlanes;
  const std::vector<vec3>& light = calm != nullptr ? *calm : radiance;
  tbb::parallel_for(0, planes_.height, [&](int y) {
    clearMargins(y);
    copyRow(features, light.data() + index(y), variance.data() + index(y), y);
    if (planes_.lost != nullptr) copyLost(radiance.data() + index(y), y);
  });
}

/// Until they are prepared, guides are features as they are, with the footprint in kSlope, and the
/// light of `written` is the variance.
void GuessFilter::Work::copyRow(const FeatureImage& features, const vec3* light,
                                const vec3* variance, int y) {
  const std::size_t stride = planes_.stride;
  float *guides = planes_.guideRow(y), *cells = planes_.cellRow(y),
        *written = planes_.writtenRow(y);
  for (int x = 0; x < planes_.width; ++x) {
    const Feature& f = features.mean(static_cast<std::uint32_t>(x), static_cast<std::uint32_t>(y));
    // What reflects nothing is no surface to share with.
    putThree(f.normal * (1.0f - f.black), guides + kNormal * stride + x, stride);
    putThree(f.position, guides + kPosition * stride + x, stride);
    guides[kSlope * stride + static_cast<std::size_t>(x)] = f.footprint;
    putThree(f.albedo, guides + kAlbedo * stride + x, stride);
    putThree(light[x], cells + kLight * stride + x, stride);
    putThree(variance[x], written + kLight * stride + x, stride);
  }
}

/// Until something is lost, that is all there is, still with its texture.
void GuessFilter::Work::copyLost(const vec3* radiance, int y) {
  for (int x = 0; x < planes_.width; ++x)
    putThree(radiance[x], planes_.lostRow(y) + x, planes_.stride);
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
    float& slope = guide[kSlope * stride];
    slope = length / (kPlaneTolerance * slope + 1e-30f);
    const vec3 albedo = glm::max(getThree(guide + kAlbedo * stride, stride), vec3(kLeastAlbedo));
    putThree(albedo, guide + kAlbedo * stride, stride);

    const vec3 light = getThree(cell + kLight * stride, stride) / albedo;
    putThree(light, cell + kLight * stride, stride);
    cell[kBright * stride] = luminance(light);
    const vec3 variance = getThree(planes_.writtenRow(y) + x + kLight * stride, stride);
    cell[kVariance * stride] = luminance(variance / (albedo * albedo));
  }
}

void GuessFilter::Work::loseRow(int y) {
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
  for (int x = 0; x < planes_.width; ++x) {
    const float *guide = planes_.guideRow(y) + x, *cell = planes_.cellRow(y) + x;
    vec3& v = out[index(y) + static_cast<std::size_t>(x)];
    const vec3 albedo = getThree(guide + kAlbedo * stride, stride);
    v = getThree(cell + kLight * stride, stride);
    if (!correction_) {
      v = glm::max(v + getThree(planes_.lostRow(y) + x, stride), vec3(0.0f)) * albedo;
      continue;
    }
    v *= albedo;
    const float value = cell[kBright * stride];
    const float square = value * value;
    v *= square > 0.0f ? square / (square + kDoubt * cell[kVariance * stride]) : 0.0f;
  }
}

void GuessFilter::Work::passRow(int y) {
  switch (pass_) {
    case kPrepare:
      return prepareRow(y);
    case kSmooth:
      return kernels_.smoothVariance(planes_, y);
    case kLose:
      return loseRow(y);
    case kFinish:
      return finishRow(y);
    default:
      break;
  }
  if (pass_ < kLose) return kernels_.gather(planes_, y, step());
  if ((pass_ - kGiveBack) % 2 == 0) return kernels_.share(planes_, y, step());
  kernels_.collect(planes_, y, step());
}

void GuessFilter::Work::band() {
  if (pass_ == kFinish && row_ == 0) out.resize(index(planes_.height));
  const auto threads = static_cast<std::size_t>(tbb::this_task_arena::max_concurrency());
  const std::size_t rows = std::max<std::size_t>(kBandPixels / planes_.stride, 1) * threads;
  const int end = static_cast<int>(
      std::min(static_cast<std::size_t>(row_) + rows, static_cast<std::size_t>(planes_.height)));
  tbb::parallel_for(row_, end, [&](int k) { passRow(rowInOrder(k, planes_.height, step())); });
  row_ = end;
  if (row_ < planes_.height) return;
  if (pass_ >= kSmooth && pass_ < kLose) std::swap(planes_.cells, planes_.written);
  ++pass_;
  if (pass_ == kLose && correction_) pass_ = kFinish;
  row_ = 0;
}

GuessFilter::GuessFilter(const FeatureImage& features, const std::vector<vec3>& radiance,
                         const std::vector<vec3>& variance, const std::vector<vec3>& calm)
    : work_(std::make_unique<Work>(features, radiance, variance, &calm, false)) {}
GuessFilter::GuessFilter(const FeatureImage& features, const std::vector<vec3>& radiance,
                         const std::vector<vec3>& variance, bool correction)
    : work_(std::make_unique<Work>(features, radiance, variance, nullptr, correction)) {}
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
  return (floats * sizeof(float) + width * sizeof(vec3)) * height;
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
