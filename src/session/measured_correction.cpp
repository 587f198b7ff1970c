#include "src/session/measured_correction.h"

#include <algorithm>
#include <cmath>

#include "src/session/block_products.h"
#include "src/session/rows.h"

namespace trex {
namespace {

constexpr float kFaint = 0.01f;  // of squares in relMSE
/// Of all other error, what counts as bias at most where that does not stand out: the whole is then
/// within a factor of two of the truth if that is anything from 5/8 to 5/2 of the others.
constexpr double kMaybe = 0.25;

double dotOf(const vec3& a, const vec3& b) { return static_cast<double>(glm::dot(a, b)); }

/// The half whose filter has not seen a pixel.
std::size_t unseenBy(std::uint32_t x, std::uint32_t y) { return 1u - ((x + y) & 1u); }

/// Mean square of all differences: what the noise of one counts as at least. A rare bright path
/// makes both mean and variance of its pixel large; a pixel that has met none knows too little.
dvec3 pooledSquare(const Accumulator& sums) {
  struct Squares {
    dvec3 squares{0.0};
    double count = 0.0;
    void add(const Squares& o) {
      squares += o.squares;
      count += o.count;
    }
  };
  const auto all = sumOfRows<Squares>(sums.height(), [&](std::uint32_t y, Squares& row) {
    for (std::uint32_t x = 0; x < sums.width(); ++x) {
      const Moments d = sums.difference(x, y);
      row.add({d.squares(), static_cast<double>(d.count())});
    }
  });
  return all.squares / std::max(all.count, 1.0);
}

}  // namespace

std::vector<vec3> relativeWeights(const std::vector<vec3>& picture) {
  double sum = 0.0;
  for (const vec3& v : picture) sum += static_cast<double>(v.x + v.y + v.z);
  const auto mean = static_cast<float>(sum / (3.0 * static_cast<double>(picture.size())));
  std::vector<vec3> out(picture.size());
  tbb::parallel_for(std::size_t{0}, out.size(), [&](std::size_t i) {
    out[i] = 1.0f / (picture[i] * picture[i] + kFaint * mean * mean + 1e-30f);
  });
  return out;
}

/// Sums of a cell, and the weight that follows.
struct MeasuredCorrection::Shared {
  double shared = 0.0, doubt = 0.0, square = 0.0;
  void add(const Shared& o) {
    shared += o.shared;
    doubt += o.doubt;
    square += o.square;
  }
  /// Of both halves together, whose noise is half of one's.
  double weight() const {
    const double sure = shared - kSurely * std::sqrt(doubt);
    if (!(sure > 0.0) || !(square > 0.0)) return 0.0;
    const double one = std::min(sure / square, 1.0);
    return 2.0 * one / (1.0 + one);
  }
};

MeasuredCorrection::MeasuredCorrection(const FeatureImage& features, NoisyPixels noisy,
                                       const std::vector<float>& scattering)
    : features_(&features),
      width_(features.width()),
      height_(features.height()),
      scattering_(scattering),
      raw_(std::move(noisy.mean)),
      variance_(std::move(noisy.variance)) {}

/// In a tile where pixels lack pairs sums are divided by how many a pixel has there on average:
/// unbiased, however few they are.
NoisyPixels exactDifferences(const FrameBuffers& frame) {
  const Accumulator& sums = frame.sums;
  NoisyPixels out;
  out.mean.resize(std::size_t{sums.width()} * sums.height());
  out.variance.resize(out.mean.size());
  const dvec3 pooled = pooledSquare(sums);
  const std::vector<Tile>& tiles = frame.tiles.tiles();
  tbb::parallel_for(std::size_t{0}, tiles.size(), [&](std::size_t t) {
    const Tile& area = tiles[t];
    std::uint64_t all = 0, fewest = ~std::uint64_t{0};
    const auto each = [&](const auto& visit) {
      for (std::uint32_t y = area.y; y < area.y + area.height; ++y) {
        for (std::uint32_t x = area.x; x < area.x + area.width; ++x) visit(x, y);
      }
    };
    each([&](std::uint32_t x, std::uint32_t y) {
      all += sums.pairs(x, y);
      fewest = std::min(fewest, sums.pairs(x, y));
    });
    if (all == 0) return;
    const bool few = fewest < kPairsEnough;
    const double mean = static_cast<double>(all) / (double{1} * area.width * area.height);
    each([&](std::uint32_t x, std::uint32_t y) {
      const Moments d = sums.difference(x, y);
      const double n = static_cast<double>(d.count()), count = few ? mean : n;
      const dvec3 one = few ? pooled : glm::max(d.varianceOfMean() * n, pooled);
      const std::size_t i = std::size_t{y} * sums.width() + x;
      out.mean[i] = vec3(d.mean() * (n / count));
      out.variance[i] = vec3(one / count);
    });
  });
  return out;
}

/// The filter of the pixels of one half; the others are the mean of those around them.
GuessFilter MeasuredCorrection::filterOf(std::uint32_t half) const {
  std::vector<vec3> difference = raw_, spread = variance_;
  eachRow(height_, [&](std::uint32_t y) {
    for (std::uint32_t x = 0; x < width_; ++x) {
      const std::size_t i = std::size_t{y} * width_ + x;
      if (((x + y) & 1u) != half) {
        vec3 sum(0.0f), noise(0.0f);
        float count = 0.0f;
        const auto take = [&](bool there, std::size_t other) {
          if (!there) return;
          sum += raw_[other];
          noise += variance_[other];
          count += 1.0f;
        };
        take(x > 0, i - 1);
        take(x + 1 < width_, i + 1);
        take(y > 0, i - width_);
        take(y + 1 < height_, i + width_);
        difference[i] = count > 0.0f ? sum / count : vec3(0.0f);
        // As noisy as one of them: what it shares with them no mean takes away.
        spread[i] = count > 0.0f ? noise / count : variance_[i];
      }
      difference[i] /= scattering_[i];
      spread[i] /= scattering_[i] * scattering_[i];
    }
  });
  return {*features_, difference, spread, true};
}

GuessFilter MeasuredCorrection::filterOfAll() const {
  std::vector<vec3> difference = raw_, spread = variance_;
  tbb::parallel_for(std::size_t{0}, raw_.size(), [&](std::size_t i) {
    difference[i] /= scattering_[i];
    spread[i] /= scattering_[i] * scattering_[i];
  });
  return {*features_, difference, spread, true};
}

bool MeasuredCorrection::advance(const std::function<bool()>& keepGoing) {
  std::vector<vec3>* const results[] = {&filtered_[0], &filtered_[1], &all_};
  for (std::uint32_t f = 0; f < 3; ++f) {
    std::vector<vec3>& result = *results[f];
    if (!result.empty()) continue;
    if (!filter_) {
      filter_.emplace(f < 2 ? filterOf(f) : filterOfAll());
      if (!keepGoing()) return false;
    }
    if (!filter_->advance(keepGoing)) return false;
    result = filter_->result();
    filter_.reset();
    tbb::parallel_for(std::size_t{0}, result.size(),
                      [&](std::size_t i) { result[i] *= scattering_[i]; });
    if (!keepGoing()) return false;
  }
  return true;
}

CellWeights<MeasuredCorrection::Shared> MeasuredCorrection::measure(
    const std::vector<vec3>& weigh) const {
  CellWeights<Shared> weights(width_, height_);
  const std::uint32_t cell = CellWeights<Shared>::kCell;
  eachRow((height_ + cell - 1) / cell, [&](std::uint32_t cells) {
    for (std::uint32_t y = cells * cell; y < std::min((cells + 1) * cell, height_); ++y) {
      for (std::uint32_t x = 0; x < width_; ++x) {
        const std::size_t i = std::size_t{y} * width_ + x;
        const vec3 w = weigh[i], unseen = w * filtered_[unseenBy(x, y)][i];
        weights.of(x, y).add({dotOf(unseen, raw_[i]), dotOf(unseen * unseen, variance_[i]),
                              dotOf(unseen, filtered_[unseenBy(x, y)][i])});
      }
    }
  });
  weights.settle();
  return weights;
}

/// Sum of the squares of the guess's bias, even in blocks of some size.
BiasFigures MeasuredCorrection::biasOf(const std::vector<vec3>& weigh, std::uint32_t size) const {
  return blockProducts(width_, height_, size, weigh, [&](std::size_t i) { return raw_[i]; });
}

std::vector<vec3> MeasuredCorrection::take(const std::vector<vec3>& picture) {
  const std::vector<vec3> weigh = relativeWeights(picture);
  const CellWeights<Shared> weights = measure(weigh);
  std::vector<vec3> out(picture.size());
  struct Captured {
    double sum = 0.0;
    void add(const Captured& o) { sum += o.sum; }
  };
  const auto captured = sumOfRows<Captured>(height_, [&](std::uint32_t y, Captured& row) {
    for (std::uint32_t x = 0; x < width_; ++x) {
      const std::size_t i = std::size_t{y} * width_ + x;
      const float part = weights.at(x, y);
      out[i] = part * all_[i];
      // |b|^2 - |b - c|^2 of the bias b and the correction c.
      row.sum += 2.0 * static_cast<double>(part) *
                     dotOf(weigh[i] * filtered_[unseenBy(x, y)][i], raw_[i]) -
                 dotOf(weigh[i] * out[i], out[i]);
    }
  });
  double gained = captured.sum;
  if (!(gained > 0.0)) {  // a few rare bright paths outweigh all others: it does harm
    std::fill(out.begin(), out.end(), vec3(0.0f));
    gained = 0.0;
  }
  const BiasFigures even = biasOf(weigh, kBlockSides[0]), fine = biasOf(weigh, kBlockSides[1]);
  const BiasFigures more{fine.square - std::max(even.square, 0.0),
                         std::hypot(fine.doubt, even.doubt)};
  const double values = 3.0 * static_cast<double>(picture.size());
  left_ = {{even.square / values, even.doubt / values}, standsOut(more) / values, gained / values};
  return out;
}

double BiasLeft::square(double known, double others) const {
  const double sure = std::max(known, captured), more = std::max(even.square, 0.0) - sure;
  double beyond = std::min(more + kSurely * even.doubt, 0.0);
  if (more > 0.0) {
    const double maybe = more * more / (more + even.doubt);
    beyond = std::max(standsOut({more, even.doubt}), std::min(maybe, kMaybe * (others + known)));
  }
  return std::max(sure + beyond - captured, 0.0) + detail;
}

}  // namespace trex
