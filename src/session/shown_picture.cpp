#include "src/session/shown_picture.h"

#include <tbb/parallel_for.h>

#include <algorithm>

#include "src/frame/oidn.h"
#include "src/session/rows.h"
#include "src/session/unfiltered_pixels.h"

namespace trex {
namespace {

/// Of a pixel, from which on their own spread tells enough of their variance.
constexpr std::uint64_t kSamplesThatTell = 4;
/// Pixels wide, of the lattice that light is filtered on before that: one of it has four times as
/// many samples, which tell its noise from its light.
constexpr std::uint32_t kLeastLattice = 2;
/// Of a pixel, whose albedo and normal are smooth; and from which on they are more use to Open
/// Image Denoise's best network as they are than to the other (docs/denoising.md).
constexpr std::uint32_t kSamplesThatShow = 8, kSamplesThatDo = 3;
/// Of all pixels, well enough to tell what a denoiser that does not know them has lost.
constexpr std::uint64_t kSamplesThatTellTheRest = 16;

/// Calls value(x, y) for every pixel of the lattice, in parallel by rows.
template <typename Value>
std::vector<vec3> collect(std::uint32_t width, std::uint32_t height, std::uint32_t step,
                          const Value& value) {
  const std::uint32_t columns = (width + step - 1) / step, rows = (height + step - 1) / step;
  std::vector<vec3> out(std::size_t{columns} * rows);
  eachRow(rows, [&](std::uint32_t row) {
    for (std::uint32_t column = 0; column < columns; ++column) {
      out[std::size_t{row} * columns + column] = vec3(value(column * step, row * step));
    }
  });
  return out;
}

/// The filter drops rare bright differences, and waits for pairs enough to know their noise. What
/// the guess lacks by them all is known well though: the picture takes the share `missing` / its
/// sum of it everywhere. Bounded, as one path may outshine a picture.
/// `doubt`: variance of `missing`, which counts as far as it stands out of it.
void makeUp(std::vector<vec3>& lit, double missing, double doubt) {
  constexpr double kDoubt = 4.0;  // of variances, as in the filter
  if (doubt > 0.0) missing *= std::max(1.0 - kDoubt * doubt / (missing * missing), 0.0);
  constexpr double kMost = 2.0;
  double sum = 0.0;
  for (const vec3& v : lit) sum += static_cast<double>(v.x + v.y + v.z);
  if (!(sum > 0.0)) return;
  const auto scale = static_cast<float>(std::clamp(1.0 + missing / sum, 1.0 / kMost, kMost));
  for (vec3& v : lit) v *= scale;
}

template <typename Visit>
void eachPixel(const Tile& tile, const Visit& visit) {
  for (std::uint32_t y = tile.y; y < tile.y + tile.height; ++y) {
    for (std::uint32_t x = tile.x; x < tile.x + tile.width; ++x) visit(x, y);
  }
}

/// Pairs of a pixel, on average.
double meanPairs(const FrameBuffers& frame) {
  if (frame.dial) return frame.dial->meanPairs();
  const std::uint32_t width = frame.sums.width(), height = frame.sums.height();
  std::uint64_t all = 0;
  for (std::uint32_t y = 0; y < height; ++y) {
    for (std::uint32_t x = 0; x < width; ++x) all += frame.sums.pairs(x, y);
  }
  return static_cast<double>(all) / (double{1} * width * height);
}

/// What the guess's light lacks, denoised by something that does not fade as samples grow.
NoisyPixels lostLight(const FrameBuffers& frame, const std::vector<vec3>& denoised) {
  using Pixel = std::uint32_t;
  const std::uint32_t width = frame.sums.width(), height = frame.sums.height();
  return {collect(width, height, 1,
                  [&](Pixel x, Pixel y) {
                    return frame.features->light(x, y) - denoised[std::size_t{y} * width + x];
                  }),
          collect(width, height, 1,
                  [&](Pixel x, Pixel y) { return frame.sums.guess(x, y).varianceOfMean(); })};
}

/// The features of the lattice's pixels; a pixel of it is `step` pixels wide.
template <typename Source>
FeatureImage thinFeatures(const FeatureImage& all, std::uint32_t step, const Source& source) {
  const std::uint32_t columns = (all.width() + step - 1) / step,
                      rows = (all.height() + step - 1) / step;
  FeatureImage out(columns, rows);
  eachRow(rows, [&](std::uint32_t y) {
    for (std::uint32_t x = 0; x < columns; ++x) {
      const auto [px, py] = source(x * step, y * step);
      out.copy(x, y, all, px, py, static_cast<float>(step));
    }
  });
  return out;
}

/// Parts the light of a frame, which is `parts`, into indirect and direct light.
void takeDirectOut(const FrameBuffers& frame, std::vector<std::vector<vec3>>& parts) {
  using Pixel = std::uint32_t;
  std::vector<vec3>& all = parts.front();
  const std::uint32_t width = frame.sums.width();
  std::vector<vec3> direct = collect(width, frame.sums.height(), 1, [&](Pixel x, Pixel y) {
    const vec3& light = all[std::size_t{y} * width + x];
    const vec3 own = vec3(frame.sums.guess(x, y).mean()) - light;
    return glm::clamp(vec3(frame.direct->guess(x, y)) - own, vec3(0.0f), light);
  });
  for (std::size_t i = 0; i < all.size(); ++i) all[i] -= direct[i];
  parts.push_back(std::move(direct));
}

/// The light of a whole frame by Open Image Denoise: by what pixels show, direct and indirect apart
/// in the thorough way. The best network wants guides without noise; what many samples show is.
std::vector<vec3> byOidn(const FrameBuffers& frame, const FeatureImage& features,
                         DenoiseMethod method) {
  using Pixel = std::uint32_t;
  const std::uint32_t width = features.width(), height = features.height();
  const auto each = [&](const auto& value) { return collect(width, height, 1, value); };
  const std::uint32_t samples = frame.tiles.samplesDone();
  OidnGuides guides{width, height,
                    each([&](Pixel x, Pixel y) { return features.mean(x, y).albedo; }),
                    each([&](Pixel x, Pixel y) { return features.mean(x, y).normal; }),
                    samples >= kSamplesThatShow};
  std::vector<std::vector<vec3>> parts{
      each([&](Pixel x, Pixel y) { return features.light(x, y); })};
  bool best = method == DenoiseMethod::kOidnThorough;
  if (best) {
    takeDirectOut(frame, parts);
  } else if (method == DenoiseMethod::kOidnWell && samples >= kSamplesThatDo) {
    best = guides.smooth = true;
  }
  return denoiseLight(*findOidn().library, std::move(guides), parts, best);
}

bool fewSamples(const FrameBuffers& frame) { return frame.tiles.samplesDone() < kSamplesThatTell; }

}  // namespace

std::vector<vec3> denoiseFrame(const FrameBuffers& frame, const FeatureImage& features,
                               DenoiseMethod method) {
  if (isOidn(method)) return byOidn(frame, features, method);
  GuessFilter filter(features, fewSamples(frame));
  filter.advance([] { return true; });
  return filter.result();
}

ShownPicture::ShownPicture(const FrameBuffers& frame, std::uint32_t width, std::uint32_t height,
                           const ShownOptions& options)
    : keepGuess_(options.keepGuess) {
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
  if (options.method == DenoiseMethod::kOff) {
    const UnfilteredPixels pixels(frame);
    picture_ = each([&](Pixel x, Pixel y) { return pixels.mean(x, y); });
    return;
  }
  const FeatureImage& features = *frame.features;
  const bool few = fewSamples(frame);
  const auto unfiltered = [&](Pixel x, Pixel y) {
    return glm::max(sums.guess(x, y).mean() - dvec3(features.light(x, y)), dvec3(0.0));
  };
  if (options.spread) {
    const FeatureImage& looks = frame.looks->shown();
    picture_ =
        collect(width, height, options.shown, [&](Pixel x, Pixel y) { return looks.light(x, y); });
    shown_ = options.shown;
    step_ = std::max(step, kLeastLattice);
    gathered_.emplace(frame, step_);
    few_ = frame.tiles.meanProgress() * step_ * step_ < kSamplesThatTell;
    all_ = &looks;
  } else {
    picture_ = each(unfiltered);
  }
  if (!whole) {
    if (gathered_) return;
    FeatureImage lattice = thinFeatures(features, step, source);
    if (frame.memory) {
      eachRow(lattice.height(), [&](std::uint32_t y) {
        for (std::uint32_t x = 0; x < lattice.width(); ++x) {
          joinMemory(*frame.memory, lattice, x, y, step);
        }
      });
    }
    guess_.emplace(lattice, few);
    return;
  }
  if (isOidn(options.method)) {
    lit_ = denoiseFrame(frame, features, options.method);
  } else if (!gathered_) {
    guess_.emplace(features, few);
  }
  if (!options.pairs) return;
  addMissing(frame);
  if (meanPairs(frame) < kPairsThatTell) return;
  scattering_.resize(std::size_t{width} * height);
  eachRow(height, [&](Pixel y) {
    for (Pixel x = 0; x < width; ++x) {
      const float share = features.scattering(x, y);
      scattering_[std::size_t{y} * width + x] = share > 0.0f ? share : 1.0f;
    }
  });
  const bool tells = frame.tiles.samplesDone() >= kSamplesThatTellTheRest;
  correction_.emplace(features, exactDifferences(frame), scattering_);
  if (tells && !lit_.empty()) lost_.emplace(features, lostLight(frame, lit_), scattering_);
}

/// What the guess of all pixels lacks, and its variance.
void ShownPicture::addMissing(const FrameBuffers& frame) {
  const Accumulator& sums = frame.sums;
  const std::vector<Tile>& tiles = frame.tiles.tiles();
  if (!frame.dial) {
    for (const Tile& tile : tiles) {
      eachPixel(tile, [&](std::uint32_t x, std::uint32_t y) {
        const dvec3 m = sums.difference(x, y).mean();
        missing_ += m.x + m.y + m.z;
      });
    }
    return;
  }
  struct Known {
    double sum = 0.0, squares = 0.0, pairs = 0.0;
  };
  std::vector<Known> known(tiles.size());
  tbb::parallel_for(std::size_t{0}, tiles.size(), [&](std::size_t i) {
    if (frame.dial->tile(i).pairs == 0) return;
    Known& k = known[i];
    eachPixel(tiles[i], [&](std::uint32_t x, std::uint32_t y) {
      const Moments d = sums.difference(x, y);
      const auto n = static_cast<double>(d.count());
      const dvec3 m = d.mean(), square = d.squares();
      k.sum += (m.x + m.y + m.z) * n;
      k.squares += 3.0 * (square.x + square.y + square.z);
      k.pairs += n;
    });
  });
  for (std::size_t i = 0; i < tiles.size(); ++i) {
    const Known& k = known[i];
    if (k.pairs == 0.0) continue;
    const double pixels = double{1} * tiles[i].width * tiles[i].height;
    missing_ += pixels * k.sum / k.pairs;
    doubt_ += pixels * pixels * k.squares / (k.pairs * k.pairs);
  }
}

/// A part of a pixel's correction.
void ShownPicture::takeIn(std::size_t pixel, const vec3& part) {
  lit_[pixel] += part;
  missing_ -= static_cast<double>(part.x + part.y + part.z);
}

bool ShownPicture::addMeasured(MeasuredCorrection& correction,
                               const std::function<bool()>& keepGoing) {
  if (!correction.advance(keepGoing)) return false;
  std::vector<vec3> all = picture_;
  for (std::size_t i = 0; i < all.size(); ++i) all[i] += lit_[i];
  const std::vector<vec3> add = correction.take(all);
  for (std::size_t i = 0; i < add.size(); ++i) takeIn(i, add[i]);
  return true;
}

bool ShownPicture::advance(const std::function<bool()>& keepGoing) {
  if (gathered_) {
    if (!gathered_->advance(keepGoing)) return false;
    thin_.emplace(gathered_->take());
    gathered_.reset();
    guess_.emplace(*thin_, few_);
    if (!keepGoing()) return false;
  }
  if (guess_) {
    if (!guess_->advance(keepGoing)) return false;
    lit_ = guess_->result();
    guess_.reset();
    if (thin_) spread_.emplace(*thin_, lit_, *all_, step_, shown_);
  }
  if (spread_) {
    if (!spread_->advance(keepGoing)) return false;
    lit_ = spread_->result();
    spread_.reset();
    thin_.reset();
  }
  if (keepGuess_ && guessLight_.empty()) guessLight_ = lit_;
  if (correction_) {
    if (!addMeasured(*correction_, keepGoing)) return false;
    biasLeft_ = correction_->left();
    correction_.reset();
  }
  if (lost_) {
    if (!addMeasured(*lost_, keepGoing)) return false;
    lost_.reset();
  }
  if (missing_ != 0.0) makeUp(lit_, missing_, doubt_);
  missing_ = 0.0;
  for (std::size_t i = 0; i < lit_.size(); ++i) picture_[i] += lit_[i];
  lit_.clear();
  return true;
}

}  // namespace trex
