#include "src/session/shown_picture.h"

#include <tbb/parallel_for.h>

#include <algorithm>

namespace trex {
namespace {

constexpr std::uint64_t kPairsThatTell = 2;  // a pixel, from which on there is a variance
/// Of a pixel, from which on their own spread tells enough of their variance.
constexpr std::uint64_t kSamplesThatTell = 4;

/// Calls value(x, y) for every pixel of the lattice, in parallel by rows.
template <typename Value>
std::vector<vec3> collect(std::uint32_t width, std::uint32_t height, std::uint32_t step,
                          const Value& value) {
  const std::uint32_t columns = (width + step - 1) / step, rows = (height + step - 1) / step;
  std::vector<vec3> out(std::size_t{columns} * rows);
  tbb::parallel_for(0u, rows, [&](std::uint32_t row) {
    for (std::uint32_t column = 0; column < columns; ++column) {
      out[std::size_t{row} * columns + column] = vec3(value(column * step, row * step));
    }
  });
  return out;
}

/// A pixel brighter than all around it has met a rare path: it counts as the brightest of them.
std::vector<vec3> withoutDots(const std::vector<vec3>& picture, std::uint32_t width,
                              std::uint32_t height) {
  std::vector<vec3> out = picture;
  tbb::parallel_for(0u, height, [&](std::uint32_t y) {
    const std::uint32_t top = y > 0 ? y - 1 : 0, bottom = std::min(y + 1, height - 1);
    for (std::uint32_t x = 0; x < width; ++x) {
      const std::uint32_t left = x > 0 ? x - 1 : 0, right = std::min(x + 1, width - 1);
      float most = 0.0f;
      for (std::uint32_t v = top; v <= bottom; ++v) {
        for (std::uint32_t u = left; u <= right; ++u) {
          if (u != x || v != y)
            most = std::max(most, luminance(picture[std::size_t{v} * width + u]));
        }
      }
      vec3& own = out[std::size_t{y} * width + x];
      const float light = luminance(own);
      if (light > most && most > 0.0f) own *= most / light;
    }
  });
  return out;
}

/// Of so few samples little is known but how they differ from their neighbours.
std::vector<vec3> spreadAround(const std::vector<vec3>& picture, std::uint32_t width,
                               std::uint32_t height) {
  std::vector<vec3> out(picture.size());
  tbb::parallel_for(0u, height, [&](std::uint32_t y) {
    const std::uint32_t top = y > 0 ? y - 1 : 0, bottom = std::min(y + 1, height - 1);
    for (std::uint32_t x = 0; x < width; ++x) {
      const std::uint32_t left = x > 0 ? x - 1 : 0, right = std::min(x + 1, width - 1);
      vec3 sum(0.0f), square(0.0f);
      float count = 0.0f;
      for (std::uint32_t v = top; v <= bottom; ++v) {
        for (std::uint32_t u = left; u <= right; ++u) {
          const vec3& p = picture[std::size_t{v} * width + u];
          sum += p;
          square += p * p;
          count += 1.0f;
        }
      }
      const vec3 mean = sum / count;
      out[std::size_t{y} * width + x] = glm::max(square / count - mean * mean, vec3(0.0f));
    }
  });
  return out;
}

/// The means over the samples that met something of `values` that count 0 for those that did not;
/// of a variance, `power` is 2.
void perCovered(std::vector<vec3>& values, const std::vector<float>& covered, int power = 1) {
  for (std::size_t i = 0; i < values.size(); ++i) {
    const float share = power == 1 ? covered[i] : covered[i] * covered[i];
    values[i] = share > 0.0f ? values[i] / share : vec3(0.0f);
  }
}

/// The same of features.
FeatureImage perCovered(const FeatureImage& all, const std::vector<float>& covered) {
  FeatureImage out(all.width(), all.height());
  for (std::uint32_t y = 0; y < all.height(); ++y) {
    for (std::uint32_t x = 0; x < all.width(); ++x) {
      Feature f = all.mean(x, y);
      const float share = covered[std::size_t{y} * all.width() + x];
      if (share > 0.0f) {
        f = {f.albedo / share, f.normal / share, f.position / share, f.footprint / share,
             f.black / share};
      }
      out.add(x, y, f);
    }
  }
  return out;
}

/// The filter of the difference to exact paths. each(value): of all pixels; `covered`: shares of
/// them, or empty.
template <typename Each>
GuessFilter correctionOf(const Accumulator& sums, const FeatureImage& features, const Each& each,
                         const std::vector<float>& covered) {
  using Pixel = std::uint32_t;
  // A rare bright path makes both mean and variance of its pixel large; a pixel that has met none
  // knows too little of them. So no variance counts as less than that of all pixels together.
  const dvec3 pooled = sums.pooledDifferenceVariance();
  auto difference = each([&](Pixel x, Pixel y) { return sums.difference(x, y).mean(); });
  auto spread = each([&](Pixel x, Pixel y) {
    const Moments d = sums.difference(x, y);
    return glm::max(d.varianceOfMean(), pooled / static_cast<double>(d.count()));
  });
  if (!covered.empty()) {
    perCovered(difference, covered);
    perCovered(spread, covered, 2);
  }
  return {features, difference, spread, true};
}

/// The features of the lattice's pixels; a pixel of it is `step` pixels wide.
template <typename Source>
FeatureImage thinFeatures(const FeatureImage& all, std::uint32_t step, const Source& source) {
  const std::uint32_t columns = (all.width() + step - 1) / step,
                      rows = (all.height() + step - 1) / step;
  FeatureImage out(columns, rows);
  for (std::uint32_t y = 0; y < rows; ++y) {
    for (std::uint32_t x = 0; x < columns; ++x) {
      const auto [px, py] = source(x * step, y * step);
      Feature f = all.mean(px, py);
      f.footprint *= static_cast<float>(step);
      out.add(x, y, f);
    }
  }
  return out;
}

}  // namespace

ShownPicture::ShownPicture(const FrameBuffers& frame, std::uint32_t width, std::uint32_t height,
                           const ShownOptions& options) {
  gather(frame, width, height, options);
}

void ShownPicture::gather(const FrameBuffers& frame, std::uint32_t width, std::uint32_t height,
                          const ShownOptions& options) {
  using Pixel = std::uint32_t;
  const Accumulator& sums = frame.sums;
  const std::uint32_t step = options.spacing;
  const bool whole = frame.tiles.samplesDone() > 0;
  // The pixel that stands for one that has no sample yet.
  const auto source = [&](Pixel x, Pixel y) {
    const std::uint32_t s = whole ? 1 : std::max(frame.tiles.spacingAt(x, y), 1u);
    return std::pair(x / s * s, y / s * s);
  };
  const auto each = [&](const auto& value) {
    return collect(width, height, step, [&](Pixel x, Pixel y) {
      const auto [px, py] = source(x, y);
      return value(px, py);
    });
  };
  if (!options.denoise) {
    picture_ = each([&](Pixel x, Pixel y) { return sums.mean(x, y); });
    return;
  }
  const FeatureImage& features = *frame.features;
  auto guess = each([&](Pixel x, Pixel y) { return features.light(x, y); });
  picture_ = each([&](Pixel x, Pixel y) {
    return glm::max(sums.guess(x, y).mean() - dvec3(features.light(x, y)), dvec3(0.0));
  });
  const std::uint32_t columns = (width + step - 1) / step, rows = (height + step - 1) / step;
  auto variance = each([&](Pixel x, Pixel y) { return features.lightVariance(x, y); });
  std::vector<vec3> calm = guess;
  if (frame.tiles.samplesDone() < kSamplesThatTell) {
    calm = withoutDots(guess, columns, rows);
    const auto spread = spreadAround(calm, columns, rows);
    for (std::size_t i = 0; i < spread.size(); ++i) {
      const auto x = static_cast<Pixel>(i % columns) * step,
                 y = static_cast<Pixel>(i / columns) * step;
      const auto [px, py] = source(x, y);
      if (sums.guess(px, py).count() >= kSamplesThatTell) {
        calm[i] = guess[i];
      } else {
        variance[i] = glm::max(variance[i], spread[i]);
      }
    }
  }
  if (!whole) {
    guess_.emplace(thinFeatures(features, step, source), guess, variance, calm);
    return;
  }
  const FeatureImage* shownFeatures = &features;
  std::optional<FeatureImage> ofCovered;
  if (options.premultiplied) {
    for (Pixel y = 0; y < height; ++y) {
      for (Pixel x = 0; x < width; ++x) covered_.push_back(frame.coverage->mean(x, y));
    }
    perCovered(guess, covered_);
    perCovered(calm, covered_);
    perCovered(picture_, covered_);
    perCovered(variance, covered_, 2);
    shownFeatures = &ofCovered.emplace(perCovered(features, covered_));
  }
  guess_.emplace(*shownFeatures, guess, variance, calm);
  if (!options.pairs || sums.fewestPairs() < kPairsThatTell) return;
  correction_.emplace(correctionOf(sums, *shownFeatures, each, covered_));
}

void ShownPicture::addResult(std::optional<GuessFilter>& filter) {
  const auto add = filter->result();
  for (std::size_t i = 0; i < add.size(); ++i) picture_[i] += add[i];
  filter.reset();
}

bool ShownPicture::advance(const std::function<bool()>& keepGoing) {
  if (guess_) {
    if (!guess_->advance(keepGoing)) return false;
    addResult(guess_);
  }
  if (correction_) {
    if (!correction_->advance(keepGoing)) return false;
    addResult(correction_);
  }
  for (std::size_t i = 0; i < covered_.size(); ++i) picture_[i] *= covered_[i];
  covered_.clear();
  return true;
}

}  // namespace trex
