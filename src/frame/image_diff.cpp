#include "src/frame/image_diff.h"

#include <fmt/ranges.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <iterator>
#include <limits>
#include <set>

#include "src/core/error.h"
#include "src/frame/picture_reader.h"

namespace trex {
namespace {

std::vector<std::string> missing(const Picture& from, const Picture& in) {
  std::vector<std::string> names;
  std::copy_if(from.channels.begin(), from.channels.end(), std::back_inserter(names),
               [&](const std::string& name) { return channelIndex(in, name) < 0; });
  std::sort(names.begin(), names.end());
  return names;
}

NonFinite findNonFinite(const Picture& picture) {
  NonFinite out;
  const std::size_t stride = picture.channels.size();
  for (std::size_t i = 0; i < picture.values.size(); ++i) {
    if (std::isfinite(picture.values[i])) continue;
    if (out.count++ > 0) continue;
    const std::size_t pixel = i / stride;
    out.x = static_cast<std::uint32_t>(pixel % picture.width);
    out.y = static_cast<std::uint32_t>(pixel / picture.width);
    out.channel = picture.channels[i % stride];
  }
  return out;
}

bool finiteColors(const ColorImage& image) {
  return std::all_of(image.pixels.begin(), image.pixels.end(),
                     [](const vec3& c) { return isFinite(c); });
}

bool sameBits(const Picture& a, const Picture& b) {
  std::vector<std::size_t> to;
  for (const std::string& name : a.channels) {
    to.push_back(static_cast<std::size_t>(channelIndex(b, name)));
  }
  const std::size_t stride = to.size();
  for (std::size_t i = 0; i < a.values.size(); ++i) {
    const float other = b.values[i / stride * stride + to[i % stride]];
    if (std::bit_cast<std::uint32_t>(a.values[i]) != std::bit_cast<std::uint32_t>(other)) {
      return false;
    }
  }
  return true;
}

void findHardDifferences(const Picture& a, const Picture& b, ImageDiff& out) {
  if (a.width != b.width || a.height != b.height) {
    out.reasons.push_back(
        fmt::format("sizes differ: {}x{} and {}x{}", a.width, a.height, b.width, b.height));
  }
  out.onlyInA = missing(a, b);
  out.onlyInB = missing(b, a);
  if (!out.onlyInA.empty())
    out.reasons.push_back(fmt::format("channels only in A: {}", fmt::join(out.onlyInA, ", ")));
  if (!out.onlyInB.empty())
    out.reasons.push_back(fmt::format("channels only in B: {}", fmt::join(out.onlyInB, ", ")));
  out.nonFiniteA = findNonFinite(a);
  out.nonFiniteB = findNonFinite(b);
  for (const auto& [name, found] : {std::pair{"A", &out.nonFiniteA}, {"B", &out.nonFiniteB}}) {
    if (found->count == 0) continue;
    out.reasons.push_back(
        fmt::format("{} values of {} are not finite; the first: {} of pixel {},{}", found->count,
                    name, found->channel, found->x, found->y));
  }
}

std::optional<double> psnr(const ColorImage& a, const ColorImage& b) {
  double sum = 0.0;
  for (std::size_t i = 0; i < a.pixels.size(); ++i) {
    for (int c = 0; c < 3; ++c) {
      const double d = double{encodeSrgb(a.pixels[i][c])} - double{encodeSrgb(b.pixels[i][c])};
      sum += d * d;
    }
  }
  if (sum == 0.0) return std::nullopt;
  return -10.0 * std::log10(sum / (3.0 * static_cast<double>(a.pixels.size())));
}

void measureLinear(const ColorImage& a, const ColorImage& b, DiffFigures& out) {
  double squares = 0.0;
  for (std::size_t i = 0; i < a.pixels.size(); ++i) {
    for (int c = 0; c < 3; ++c) {
      const double d = double{a.pixels[i][c]} - double{b.pixels[i][c]};
      squares += d * d;
      if (std::abs(d) <= out.maxError) continue;
      out.maxError = std::abs(d);
      out.maxX = static_cast<std::uint32_t>(i % a.width);
      out.maxY = static_cast<std::uint32_t>(i / a.width);
      out.maxChannel = "RGB"[c];
    }
  }
  out.rmse = std::sqrt(squares / (3.0 * static_cast<double>(a.pixels.size())));
  out.relative = relativeError(a, b);
  const double meanA = meanValue(a), meanB = meanValue(b);
  out.meanRatio = meanA == meanB ? 1.0 : meanA / meanB;
}

void measureSeen(const ColorImage& a, const ColorImage& b, const DiffOptions& options,
                 DiffFigures& out) {
  const double scale = options.exposure ? std::exp2(*options.exposure) : displayScale(b);
  out.exposure = std::log2(scale);
  const ColorImage shownA = displayed(a, scale), shownB = displayed(b, scale);
  out.psnrDb = psnr(shownA, shownB);
  out.flipMap = flipMap(shownB, shownA, options.pixelsPerDegree);
  out.flip = meanError(out.flipMap);
  out.hdrFlipMap = hdrFlipMap(b, a, options.pixelsPerDegree);
  out.hdrFlip = meanError(out.hdrFlipMap);
}

}  // namespace

ImageDiff compareImages(const Picture& a, const Picture& b, const DiffOptions& options) {
  ImageDiff out{a.width, a.height, b.width, b.height, {}, {}, {}, {}, false, {}, {}};
  findHardDifferences(a, b, out);
  if (a.width != b.width || a.height != b.height) return out;
  out.equalBits = out.onlyInA.empty() && out.onlyInB.empty() && sameBits(a, b);
  for (const char* name : {"R", "G", "B"}) {
    if ((channelIndex(a, name) < 0) != (channelIndex(b, name) < 0)) return out;
  }
  const ColorImage colorsA = colorsOf(a, "A"), colorsB = colorsOf(b, "B");
  if (!finiteColors(colorsA) || !finiteColors(colorsB)) return out;
  out.figures.emplace();
  measureLinear(colorsA, colorsB, *out.figures);
  measureSeen(colorsA, colorsB, options, *out.figures);
  const bool finite = out.nonFiniteA.count == 0 && out.nonFiniteB.count == 0;
  if (finite && hasVariance(a) && hasVariance(b)) out.figures->zTest = zTest(a, b);
  return out;
}

ColorImage colorsOf(const Picture& picture, const std::string& name) {
  int index[3];
  for (int c = 0; c < 3; ++c) {
    const std::string channel(1, "RGB"[c]);
    index[c] = channelIndex(picture, channel);
    if (index[c] < 0) fail(ExitCode::kInput, "{}: has no channel {}", name, channel);
  }
  const std::size_t stride = picture.channels.size();
  ColorImage out{picture.width, picture.height, {}};
  out.pixels.reserve(std::size_t{picture.width} * picture.height);
  for (std::size_t i = 0; i < picture.values.size(); i += stride) {
    const float* v = &picture.values[i];
    out.pixels.emplace_back(v[index[0]], v[index[1]], v[index[2]]);
  }
  return out;
}

double displayScale(const ColorImage& reference) {
  std::vector<double> means;
  means.reserve(reference.pixels.size());
  for (const vec3& c : reference.pixels) means.push_back((double{c.x} + c.y + c.z) / 3.0);
  const double rank = 0.7 * static_cast<double>(means.size() - 1);
  const auto below = means.begin() + static_cast<std::ptrdiff_t>(rank);
  std::nth_element(means.begin(), below, means.end());
  const auto above = std::next(below) == means.end() ? below : std::next(below);
  const double upper = above == below ? *below : *std::min_element(above, means.end());
  const double value = *below + (upper - *below) * (rank - std::floor(rank));
  return 0.5 / std::max(value, 1e-12);
}

ColorImage displayed(const ColorImage& image, double scale) {
  ColorImage out = image;
  for (vec3& c : out.pixels) {
    for (int k = 0; k < 3; ++k) {
      c[k] = static_cast<float>(std::clamp(double{c[k]} * scale, 0.0, 1.0));
    }
  }
  return out;
}

RelativeError relativeError(const ColorImage& image, const ColorImage& reference) {
  const double mean = meanValue(reference);
  std::vector<double> terms;
  terms.reserve(image.pixels.size() * 3);
  for (std::size_t i = 0; i < image.pixels.size(); ++i) {
    for (int c = 0; c < 3; ++c) {
      const double r = reference.pixels[i][c], d = image.pixels[i][c] - r;
      terms.push_back(d == 0.0 ? 0.0 : d * d / (r * r + 0.01 * mean * mean));
    }
  }
  const std::size_t left = terms.size() - std::max<std::size_t>(1, terms.size() / 1000);
  std::nth_element(terms.begin(), terms.begin() + static_cast<std::ptrdiff_t>(left), terms.end());
  RelativeError out;
  double sum = 0.0;
  for (std::size_t i = 0; i < terms.size(); ++i) {
    sum += terms[i];
    if (i + 1 == left) out.trimmed = sum / static_cast<double>(left);
  }
  out.all = sum / static_cast<double>(terms.size());
  return out;
}

double meanValue(const ColorImage& image) {
  double sum = 0.0;
  for (const vec3& c : image.pixels) sum += double{c.x} + c.y + c.z;
  return sum / (3.0 * static_cast<double>(image.pixels.size()));
}

vec3 magma(float x) {
  // Ten evenly spaced colours of the map; between them it is nearly straight.
  constexpr std::uint32_t kPoints[] = {0x000004, 0x180f3d, 0x440f76, 0x721f81, 0x9e2f7f,
                                       0xcd4071, 0xf1605d, 0xfd9668, 0xfeca8d, 0xfcfdbf};
  const auto color = [&](int i) {
    return vec3(kPoints[i] >> 16, kPoints[i] >> 8 & 0xffu, kPoints[i] & 0xffu) / 255.0f;
  };
  const float at = std::clamp(x, 0.0f, 1.0f) * 9.0f;
  const int i = std::min(static_cast<int>(at), 8);
  return glm::mix(color(i), color(i + 1), at - static_cast<float>(i));
}

}  // namespace trex
