// A weight for each pixel, from sums over cells of a picture.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "src/core/maths.h"

namespace trex {

/// `Sums`: of a cell; has add(const Sums&), and weight(), a double, of cells together. Weights
/// change evenly between the centres of cells, each of which counts together with its neighbours.
template <typename Sums>
class CellWeights {
 public:
  static constexpr std::uint32_t kCell = 32;  ///< pixels wide

  CellWeights(std::uint32_t width, std::uint32_t height)
      : columns_((width + kCell - 1) / kCell),
        rows_((height + kCell - 1) / kCell),
        cells_(std::size_t{columns_} * rows_) {}
  Sums& of(std::uint32_t x, std::uint32_t y) {
    return cells_[std::size_t{y / kCell} * columns_ + x / kCell];
  }
  /// Once all sums are there, before at().
  void settle() {
    smooth_.resize(cells_.size());
    for (std::uint32_t y = 0; y < rows_; ++y) {
      for (std::uint32_t x = 0; x < columns_; ++x) {
        Sums sum;
        for (std::uint32_t v = y > 0 ? y - 1 : 0; v <= std::min(y + 1, rows_ - 1); ++v) {
          for (std::uint32_t u = x > 0 ? x - 1 : 0; u <= std::min(x + 1, columns_ - 1); ++u) {
            sum.add(cells_[std::size_t{v} * columns_ + u]);
          }
        }
        smooth_[std::size_t{y} * columns_ + x] = static_cast<float>(sum.weight());
      }
    }
  }
  float at(std::uint32_t x, std::uint32_t y) const {
    const auto place = [](std::uint32_t pixel, std::uint32_t count) {
      const float p = (static_cast<float>(pixel) + 0.5f) / static_cast<float>(kCell) - 0.5f;
      return std::clamp(p, 0.0f, static_cast<float>(count - 1));
    };
    const float px = place(x, columns_), py = place(y, rows_);
    const auto x0 = static_cast<std::uint32_t>(px), y0 = static_cast<std::uint32_t>(py);
    const std::uint32_t x1 = std::min(x0 + 1, columns_ - 1), y1 = std::min(y0 + 1, rows_ - 1);
    const auto cell = [&](std::uint32_t u, std::uint32_t v) {
      return smooth_[std::size_t{v} * columns_ + u];
    };
    const float fx = px - static_cast<float>(x0), fy = py - static_cast<float>(y0);
    return glm::mix(glm::mix(cell(x0, y0), cell(x1, y0), fx),
                    glm::mix(cell(x0, y1), cell(x1, y1), fx), fy);
  }

 private:
  std::uint32_t columns_, rows_;
  std::vector<Sums> cells_;
  std::vector<float> smooth_;
};

}  // namespace trex
