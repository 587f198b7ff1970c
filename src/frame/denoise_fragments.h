// What pixels show beside their main surface, filtered: the fragments. There are few of them, at
// rims and on glass, and what they show is the main surface of pixels beside them, filtered
// already, or another fragment there. So each is a mean of the 3x3 pixels around it, taken twice,
// by the weights of the other passes.
//
// The light that is lost flows between a fragment and those that it shares with until all have as
// much of it for what they reflect, so that none is lost on the way.
#pragma once

#include <cstdint>
#include <vector>

#include "src/frame/denoise_kernels.h"
#include "src/frame/features.h"

namespace trex {

/// Rows may run at once within one pass; a pass begins when the one before has ended.
class Fragments {
 public:
  /// Of all parts of pixels that are not the main one. Copies what it needs.
  explicit Fragments(const FeatureImage& features);

  bool empty() const { return all_.empty(); }

  /// Weights and variances; `planes` as smoothVariance() left them.
  void weigh(const FilterPlanes& planes, int y);
  /// How much of what is lost each pixel may let go to fragments.
  void reach(const FilterPlanes& planes, int y);
  /// Means with the main surfaces as gather() left them: twice, with settle() after each.
  void mix(const FilterPlanes& planes, int y);
  void settle(int y);
  void lose(int y);
  /// Light that was lost flows between fragments and main surfaces. The latter's new values are in
  /// the light of `written` until settleFlow().
  void flow(const FilterPlanes& planes, int y);
  void settleFlow(const FilterPlanes& planes, int y);
  /// Adds the fragments' light to a row of the picture.
  void add(int y, vec3* row) const;

  /// At most, of a picture.
  static std::uint64_t bytesNeeded(std::uint32_t width, std::uint32_t height);

 private:
  struct Fragment {
    vec3 normal{0.0f};  ///< unit; zero if nothing may be shared
    vec3 position{0.0f}, albedo{0.0f};
    float slope = 0.0f;                       ///< see kSlope
    vec3 raw{0.0f}, light{0.0f}, next{0.0f};  ///< without texture; `next`: of the pass under way
    vec3 lost{0.0f};
    float variance = 0.0f, nextVariance = 0.0f;  ///< of the luminance
    float share = 0.0f, cover = 0.0f;            ///< of the pixel's samples; see kCover
    float reach = 0.0f;                          ///< sum of weight * cover of those it shares with
    int x = 0;
    float toMost[8]{}, toRest[8]{};  ///< weights of the pixels around it, row by row
  };
  static constexpr std::int32_t kNone = -1;

  const Fragment& at(std::int32_t i) const { return all_[static_cast<std::size_t>(i)]; }
  std::size_t pixel(int x, int y) const {
    return static_cast<std::size_t>(y) * static_cast<std::size_t>(width_) +
           static_cast<std::size_t>(x);
  }
  /// Calls work(fragment, y) for those of a row.
  template <typename Work>
  void each(int y, Work work);
  /// Calls visit(k, x, y) for the up to eight pixels around one.
  template <typename Visit>
  void around(int x, int y, Visit visit) const;
  void weighOne(const FilterPlanes& planes, Fragment& f, int y);
  void mixOne(const FilterPlanes& planes, Fragment& f, int y);
  void flowOne(const FilterPlanes& planes, Fragment& f, int y);
  void flowOfMost(const FilterPlanes& planes, int x, int y);

  int width_, height_;
  std::vector<Fragment> all_;             ///< row by row
  std::vector<std::size_t> rows_;         ///< where each row begins, and the end
  std::vector<std::int32_t> fragmentOf_;  ///< by pixel
  std::vector<float> reach_;              ///< by pixel, of its main surface; see Fragment::reach
};

}  // namespace trex
