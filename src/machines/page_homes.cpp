#include "src/machines/page_homes.h"

#include <algorithm>
#include <cmath>

namespace trex::machines {
namespace {

// What is measured of a link may be off by so much: machines are busy.
constexpr double kMeasured = 0.25, kLeastShare = 0.1;

/// 64 bits that look random (the finalizer of MurmurHash3, Appleby).
std::uint64_t mix(std::uint64_t x) {
  x = (x ^ x >> 33) * 0xff51afd7ed558ccdull;
  x = (x ^ x >> 33) * 0xc4ceb9fe1a85ec53ull;
  return x ^ x >> 33;
}

}  // namespace

std::uint32_t homeOf(std::uint64_t offset, std::span<const PageHome> homes) {
  std::uint32_t best = 0;
  double least = HUGE_VAL;
  for (const PageHome& home : homes) {
    // Exponential variates: the first of several has the chances of its rate.
    const double u = (static_cast<double>(mix(offset + mix(home.machine)) >> 11) + 0.5) * 0x1p-53;
    const double at = -std::log(u) / std::max(home.weight, 1u);
    if (at < least) least = at, best = home.machine;
  }
  return best;
}

std::vector<PageHome> chooseHomes(std::span<const HomeCandidate> machines) {
  std::vector<double> speeds;
  for (const HomeCandidate& m : machines) {
    if (m.link.known()) speeds.push_back(m.link.bandwidth);
  }
  double half = 0.0;  // of them are at least so fast
  if (!speeds.empty()) {
    const auto middle = speeds.begin() + static_cast<std::ptrdiff_t>(speeds.size() / 2);
    std::nth_element(speeds.begin(), middle, speeds.end());
    half = *middle;
  }
  std::vector<PageHome> homes;
  for (const HomeCandidate& m : machines) {
    const double share = m.link.known() ? m.link.bandwidth / half : 1.0;
    if (share < kLeastShare) continue;
    homes.push_back({m.machine, static_cast<std::uint32_t>(share < kMeasured ? share * kWholeWeight
                                                                             : kWholeWeight)});
  }
  if (homes.size() < 2) homes.clear();
  return homes;
}

}  // namespace trex::machines
