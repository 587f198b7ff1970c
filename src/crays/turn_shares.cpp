#include "src/crays/turn_shares.h"

#include <algorithm>

namespace trex {

float TurnShares::at(const vec3& position, std::uint32_t turns) const {
  if (turns >= turns_) return 1.0f;
  return shares_[std::size_t{rows_[places_.of(position)]} * turns_ + turns];
}

TurnSums::TurnSums(const Box3f& bounds, std::uint32_t most) : places_{bounds}, turns_(most + 1) {
  restart();
}

void TurnSums::restart() {
  if (!counts()) return;
  rows_.assign(CoarseCells::kCount, 0);
  sums_.assign(turns_, 0.0);
}

void TurnSums::add(const vec3& position, std::uint32_t turns, float power) {
  if (!counts()) return;
  std::uint32_t& row = rows_[places_.of(position)];
  if (row == 0) {
    row = static_cast<std::uint32_t>(sums_.size() / turns_);
    sums_.resize(sums_.size() + turns_, 0.0);
  }
  turns = std::min(turns, turns_ - 1);
  sums_[turns] += static_cast<double>(power);
  sums_[std::size_t{row} * turns_ + turns] += static_cast<double>(power);
}

TurnShares TurnSums::shares() const {
  TurnShares out;
  if (!counts()) return out;
  out.places_ = places_;
  out.rows_ = rows_;
  out.turns_ = turns_;
  out.shares_.resize(sums_.size());
  for (std::size_t row = 0; row < sums_.size(); row += turns_) {
    double all = 0.0, sum = 0.0;
    for (std::uint32_t t = 0; t < turns_; ++t) all += sums_[row + t];
    for (std::uint32_t t = 0; t < turns_; ++t) {
      sum += sums_[row + t];
      out.shares_[row + t] = all > 0.0 ? static_cast<float>(sum / all) : 1.0f;
    }
  }
  return out;
}

}  // namespace trex
