#include "src/session/dial.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

namespace trex {
namespace {

constexpr double kFloor = 0.01;  // of squares in relMSE

double sumOf(const dvec3& v) { return v.x + v.y + v.z; }

/// Sums over the pixels of a block.
struct BlockSums {
  dvec3 mean{0.0}, guessVariance{0.0};
  dvec3 differences{0.0}, squares{0.0};              ///< squares: of pairs
  dvec3 ownProducts{0.0};                            ///< squares of the sums of pixels
  double pixels = 0.0, pairs = 0.0, products = 0.0;  ///< products: of pairs of different pixels

  BlockSums(const Tile& area, std::uint32_t left, std::uint32_t top, std::uint32_t side,
            const Accumulator& sums) {
    const std::uint32_t right = std::min(left + side, area.x + area.width),
                        bottom = std::min(top + side, area.y + area.height);
    for (std::uint32_t y = top; y < bottom; ++y) {
      for (std::uint32_t x = left; x < right; ++x) {
        const Moments &guess = sums.guess(x, y), difference = sums.difference(x, y);
        const double n = static_cast<double>(difference.count());
        mean += guess.mean();
        guessVariance += guess.varianceOfMean() * static_cast<double>(guess.count());
        differences += difference.mean() * n;
        squares += difference.squares();
        const dvec3 sum = difference.mean() * n;
        ownProducts += sum * sum;
        pixels += 1.0;
        pairs += n;
        products -= n * n;
      }
    }
    products += pairs * pairs;
  }
};

/// What the blocks of one size say.
struct ScaleSums {
  double pixels = 0.0, pairs = 0.0, guessVariance = 0.0;
  double known = 0.0, pairVariance = 0.0;  ///< known: pixels of blocks that know of pairs
  BiasFigures bias;

  ScaleSums(const Tile& area, std::uint32_t side, double floor, const Accumulator& sums) {
    for (std::uint32_t y = area.y; y < area.y + area.height; y += side) {
      for (std::uint32_t x = area.x; x < area.x + area.width; x += side) {
        add(BlockSums(area, x, y, side, sums), floor);
      }
    }
    guessVariance /= pixels;
    if (known == 0.0) return;
    pairVariance /= known;
    bias = {bias.square / known, std::sqrt(bias.doubt) / known};
  }
  void add(const BlockSums& b, double floor) {
    const dvec3 m = b.mean / b.pixels, weight = 1.0 / (m * m + floor) / 3.0;
    pixels += b.pixels;
    pairs += b.pairs;
    guessVariance += sumOf(b.guessVariance * weight);
    if (!(b.products > 0.0)) return;
    const dvec3 square = b.differences * b.differences;
    const dvec3 variance = glm::max(b.squares - square / b.pairs, dvec3(0.0)) / (b.pairs - 1.0);
    const double spread = b.pixels * sumOf(variance * weight);
    pairVariance += spread;
    bias.square += b.pixels * sumOf((square - b.ownProducts) * weight) / b.products;
    bias.doubt += 2.0 * spread * spread / b.products;
    known += b.pixels;
  }
};

/// Of squares in an area, below which they count as dark.
double floorOf(const Tile& area, const Accumulator& sums) {
  double sum = 0.0;
  for (std::uint32_t y = area.y; y < area.y + area.height; ++y) {
    for (std::uint32_t x = area.x; x < area.x + area.width; ++x) {
      sum += sumOf(sums.guess(x, y).mean());
    }
  }
  const double mean = sum / (3.0 * area.width * area.height);
  return kFloor * mean * mean + 1e-30;
}

}  // namespace

ShareFigures measureShares(const Tile& area, const Accumulator& sums) {
  const double floor = floorOf(area, sums);
  const ScaleSums coarse(area, kBlockSides[0], floor, sums);
  ShareFigures f{.pixels = coarse.pixels,
                 .pairs = coarse.pairs / coarse.pixels,
                 .guessVariance = coarse.guessVariance,
                 .pairVariance = coarse.pairVariance};
  f.bias[0] = coarse.bias;
  for (int k = 1; k < kScales; ++k) {
    const ScaleSums fine(area, kBlockSides[k], floor, sums);
    f.bias[k] = {fine.bias.square - f.bias[0].square, fine.bias.doubt};
  }
  return f;
}

double Dial::share() const {
  double pairs = 0.0, samples = 0.0;
  for (const DialTile& t : tiles_) {
    pairs += static_cast<double>(t.pairs);
    samples += static_cast<double>(t.pairs + t.guesses);
  }
  return samples > 0.0 ? pairs / samples : 0.0;
}

/// Over the pixels.
double Dial::mean(double DialTile::*value) const {
  if (nextLook_ == firstLook()) return -1.0;
  double sum = 0.0, samples = 0.0;
  for (const DialTile& t : tiles_) {
    const auto own = static_cast<double>(t.pairs + t.guesses);
    sum += own * t.*value;
    samples += own;
  }
  return samples > 0.0 ? sum / samples : -1.0;
}

double Dial::meanPairs() const {
  double pairs = 0.0;
  for (const DialTile& t : tiles_) pairs += static_cast<double>(t.pairs);
  return pairs / static_cast<double>(pixels_);
}

void Dial::add(std::size_t tile, bool paired, std::uint64_t rays) {
  DialTile& t = tiles_[tile];
  (paired ? t.pairs : t.guesses) += 1;
  (paired ? t.pairRays : t.guessRays) += rays;
}

void Dial::look(std::span<const Tile> tiles, std::uint32_t samples, const Accumulator& sums) {
  if (samples < nextLook_) return;
  restore(samples);
  const auto each = [](std::uint64_t rays, std::uint64_t count) {
    return static_cast<double>(rays) / static_cast<double>(count);
  };
  std::vector<ShareFigures> figures(tiles.size());
  tbb::parallel_for(std::size_t{0}, tiles.size(), [&](std::size_t i) {
    const DialTile& t = tiles_[i];
    ShareFigures& f = figures[i] = measureShares(tiles[i], sums);
    f.pooling = use_.pooling;
    // A tile all of whose samples are pairs, or none, knows nothing of costs: they count as equal.
    if (t.guesses > 0) f.guessCost = std::max(each(t.guessRays, t.guesses), 1.0);
    f.pairCost = f.guessCost;
    if (t.guesses > 0 && t.pairs > 0) {
      f.pairCost = std::max(each(t.pairRays, t.pairs) - f.guessCost, 0.0);
    }
  });
  poolBias(figures);
  const std::vector<double> shares = chooseShares(figures, samples);
  for (std::size_t i = 0; i < tiles.size(); ++i) {
    tiles_[i].share = shares[i];
    const double error = expectedError(figures[i], samples, figures[i].pairs);
    tiles_[i].noise = figures[i].guessVariance / (use_.pooling.guesses * samples);
    tiles_[i].bias = error - tiles_[i].noise;
  }
}

void Dial::restart() {
  tiles_.assign(tiles_.size(), {});
  nextLook_ = firstLook();
}

void Dial::restore(std::uint32_t samples) {
  for (nextLook_ = firstLook(); nextLook_ <= samples && nextLook_ < 1u << 30;) {
    nextLook_ += use_.seldom ? 3 * nextLook_ : nextLook_ / 2;
  }
}

}  // namespace trex
