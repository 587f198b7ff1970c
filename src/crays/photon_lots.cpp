#include "src/crays/photon_lots.h"

#include <cmath>

namespace trex {

void LotSums::restart() {
  rows_.assign(CoarseCells::kCount, 0);
  sums_.assign(1, Sums{});
  before_.clear();
  settled_ = false;
}

void LotSums::add(const vec3& position, std::uint64_t photon, float power) {
  if (!counts()) return;
  std::uint32_t& row = rows_[places_.of(position)];
  if (row == 0) {
    row = static_cast<std::uint32_t>(sums_.size());
    sums_.emplace_back();
  }
  sums_[row][photon / kRun % PhotonLots::kLots] += static_cast<double>(power);
}

PhotonLots LotSums::settle(std::uint64_t photons) {
  PhotonLots out;
  if (!counts() || photons == 0) return out;
  constexpr std::uint64_t kRound = kRun * PhotonLots::kLots;
  std::array<double, PhotonLots::kLots> share{};  // of all photons
  for (std::uint64_t lot = 0; lot < PhotonLots::kLots; ++lot) {
    const std::uint64_t rest = photons % kRound, before = lot * kRun,
                        more = rest > before ? std::min(rest - before, kRun) : 0;
    share[lot] = static_cast<double>(photons / kRound * kRun + more) / static_cast<double>(photons);
  }
  out.places_ = places_;
  out.rows_ = rows_;
  out.cells_.resize(sums_.size());
  before_.resize(sums_.size(), 0.0);
  for (std::size_t row = 1; row < sums_.size(); ++row) {
    double all = 0.0;
    for (const double sum : sums_[row]) all += sum;
    PhotonLots::Cell& cell = out.cells_[row];
    const double mean = all / static_cast<double>(photons);
    // Not the other way about: of few photons before, so many times as many say nothing.
    if (settled_ && mean > 0.0) cell.before = static_cast<float>(before_[row] / mean);
    before_[row] = mean;
    for (std::size_t lot = 0; all > 0.0 && lot < share.size(); ++lot) {
      // A lot of a share s has (1 - s) / s times the variance of all about their mean.
      const double s = share[lot];
      if (!(s > 0.0 && s < 1.0)) continue;
      cell.noise[lot] =
          static_cast<float>((sums_[row][lot] / (s * all) - 1.0) * std::sqrt(s / (1.0 - s)));
    }
  }
  settled_ = true;
  return out;
}

}  // namespace trex
