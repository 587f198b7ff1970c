// Scores pictures against one reference, and shows them.
#pragma once

#include <nlohmann/json.hpp>
#include <string>

#include "src/frame/image_diff.h"

namespace trex {

class Scorer {
 public:
  /// `reference` decides exposure and relMSE; FLIP is against `clean`, the same picture without
  /// noise or itself.
  Scorer(ColorImage reference, ColorImage clean);

  /// relmse (trimmed), relmse_all, flip, mean_ratio, nonfinite_pixels (they count as black).
  nlohmann::json score(ColorImage image) const;

  /// A PNG at the reference's exposure, as base64.
  std::string png(const ColorImage& image) const;
  std::string referencePng() const { return png(clean_); }
  std::uint32_t width() const { return reference_.width; }
  std::uint32_t height() const { return reference_.height; }

 private:
  ColorImage reference_, clean_, shown_;
  double scale_, mean_;
};

/// A scorer of the reference file and, if there is one, the clean picture beside it. Throws
/// Error(kInput), also where the size is not width x height.
Scorer readReference(const std::string& path, std::uint32_t width, std::uint32_t height);

}  // namespace trex
