// Merging renders of one view with different seeds into what one longer render would have given.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "src/frame/image_file.h"

namespace trex {

/// Adds pictures one at a time, so that only the sums and one picture are in memory.
///
/// R, G, B and further layers become means weighted by sampleCount; variance.R, .G, .B (variance of
/// the mean) are pooled with the formula of [Chan, Golub, LeVeque 1979] from counts, means and
/// variances; sampleCount is summed; objectId and materialId are the first picture's.
class PictureMerger {
 public:
  /// Throws Error(kInput) that starts with `name` if the picture can't be merged with those before:
  /// layers missing, another size, scene, camera or exact share, a seed that is in already, a value
  /// that is not finite, a filtered picture.
  void add(const Picture& picture, const std::string& name);

  /// The merged picture; at least one was added. Pixels without samples are black.
  Picture result() const;

 private:
  enum class Rule : std::uint8_t { kMean, kColor, kVariance, kCount, kFirst };

  void start(const Picture& picture, const std::string& name);
  void checkFits(const Picture& picture, const std::string& name) const;
  void takeMetadata(const Picture& picture, const std::string& name);
  void accumulate(const Picture& picture, const std::string& name);

  Picture first_;  ///< size, channels and metadata; values of the first picture
  std::string firstName_;
  std::vector<Rule> rules_;           ///< by channel
  std::vector<int> colorOfVariance_;  ///< by channel; -1 where it is no variance
  int countChannel_ = -1;
  std::vector<double> counts_;  ///< by pixel
  std::vector<double> sums_;    ///< by value: means so far, or sums of squared deviations
  std::vector<std::string> seeds_;
  std::uint64_t samples_ = 0, nonFinite_ = 0;
};

}  // namespace trex
