#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <cmath>
#include <limits>
#include <random>

#include "src/core/error.h"
#include "src/frame/image_diff.h"
#include "src/frame/separable_filter.h"

namespace trex {
namespace {

ColorImage noise(std::uint32_t width, std::uint32_t height, std::uint32_t seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<float> value(0.0f, 1.0f);
  ColorImage image{width, height, {}};
  for (std::size_t i = 0; i < std::size_t{width} * height; ++i) {
    const float r = value(random), g = value(random), b = value(random);
    image.pixels.emplace_back(r, g, b);
  }
  return image;
}

Picture pictureOf(const ColorImage& image) {
  Picture out{image.width, image.height, {"R", "G", "B"}, {}, {}};
  for (const vec3& c : image.pixels) out.values.insert(out.values.end(), {c.x, c.y, c.z});
  return out;
}

TEST(SeparableFilter, KeepsAConstantUpToTheBorder) {
  Plane plane(7, 5);
  for (float& v : plane.values) v = 3.0f;
  const Kernel kernel{0.25f, 0.5f, 0.25f};
  for (float v : filterColumns(filterRows(plane, kernel), kernel).values) EXPECT_EQ(v, 3.0f);
}

TEST(SeparableFilter, CorrelatesInTheRightDirection) {
  Plane plane(5, 5);
  plane.row(2)[2] = 1.0f;
  const Kernel kernel{1.0f, 10.0f, 100.0f};
  const Plane rows = filterRows(plane, kernel), columns = filterColumns(plane, kernel);
  EXPECT_EQ(rows.row(2)[1], 100.0f);
  EXPECT_EQ(rows.row(2)[3], 1.0f);
  EXPECT_EQ(columns.row(1)[2], 100.0f);
  EXPECT_EQ(columns.row(3)[2], 1.0f);
}

TEST(Flip, IsZeroForEqualAndNearOneForBlackAndWhite) {
  const ColorImage image = noise(17, 9, 1);
  EXPECT_EQ(meanError(flipMap(image, image, kFlipPixelsPerDegree)), 0.0);
  ColorImage black{16, 16, std::vector<vec3>(256, vec3(0.0f))}, white = black;
  for (vec3& c : white.pixels) c = vec3(1.0f);
  const double error = meanError(flipMap(black, white, kFlipPixelsPerDegree));
  EXPECT_GT(error, 0.9);
  EXPECT_LE(error, 1.0 + 1e-6);
}

TEST(Flip, OnePixelIsSeenAroundItAlone) {
  const ColorImage flat{41, 41, std::vector<vec3>(41 * 41, vec3(0.4f))};
  ColorImage changed = flat;
  changed.pixels[20 * 41 + 20] = vec3(1.0f, 0.0f, 0.0f);
  const std::vector<float> map = flipMap(flat, changed, kFlipPixelsPerDegree);
  EXPECT_GT(map[20 * 41 + 20], 0.05f);
  EXPECT_LT(map[0], 1e-3f);
  EXPECT_GT(meanError(map), 0.0);
}

TEST(Flip, ThreadsDoNotChangeABit) {
  const ColorImage a = noise(67, 45, 1), b = noise(67, 45, 2);
  const std::vector<float> many = hdrFlipMap(a, b, kFlipPixelsPerDegree);
  const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
  EXPECT_EQ(hdrFlipMap(a, b, kFlipPixelsPerDegree), many);
}

TEST(Flip, HandlesExtremesOfSightAndRadiance) {
  ColorImage a = noise(5, 3, 1), b = noise(5, 3, 2);
  a.pixels[0] = vec3(1e38f);
  b.pixels[1] = vec3(-1e38f);
  for (double ppd : {kLeastPixelsPerDegree, 5.0, kMostPixelsPerDegree}) {
    for (const auto& map : {flipMap(a, b, ppd), hdrFlipMap(a, b, ppd)}) {
      for (float v : map) EXPECT_TRUE(v >= 0.0f && v <= 1.0f + 1e-6f) << v << " at " << ppd;
    }
  }
}

TEST(Flip, ExposuresSpanTheReference) {
  ColorImage image{2, 2, {vec3(8.0f), vec3(2.0f), vec3(2.0f), vec3(2.0f)}};
  const ExposureRange range = flipExposures(image);
  EXPECT_NEAR(range.stop - range.start, 2.0f, 1e-5f);
  image.pixels.assign(4, vec3(0.0f));
  EXPECT_TRUE(std::isfinite(flipExposures(image).start));
}

TEST(ImageDiff, EqualPicturesHaveEqualBitsAndNoError) {
  const Picture a = pictureOf(noise(8, 8, 1));
  const ImageDiff diff = compareImages(a, a, {});
  EXPECT_TRUE(diff.equalBits);
  EXPECT_TRUE(diff.reasons.empty());
  ASSERT_TRUE(diff.figures);
  EXPECT_EQ(diff.figures->rmse, 0.0);
  EXPECT_EQ(diff.figures->relative.all, 0.0);
  EXPECT_EQ(diff.figures->flip, 0.0);
  EXPECT_EQ(diff.figures->hdrFlip, 0.0);
  EXPECT_EQ(diff.figures->meanRatio, 1.0);
  EXPECT_FALSE(diff.figures->psnrDb);
}

TEST(ImageDiff, OrderOfChannelsDoesNotMatter) {
  Picture a{1, 1, {"R", "G", "B"}, {1.0f, 2.0f, 3.0f}, {}};
  Picture b{1, 1, {"B", "G", "R"}, {3.0f, 2.0f, 1.0f}, {}};
  EXPECT_TRUE(compareImages(a, b, {}).equalBits);
}

TEST(ImageDiff, SizesDifferEvenByABlackColumn) {
  const Picture a = pictureOf(noise(8, 8, 1));
  Picture b{9, 8, a.channels, {}, {}};
  for (std::size_t y = 0; y < 8; ++y) {
    b.values.insert(b.values.end(), a.values.begin() + y * 24, a.values.begin() + (y + 1) * 24);
    b.values.insert(b.values.end(), 3, 0.0f);
  }
  const ImageDiff diff = compareImages(a, b, {});
  ASSERT_EQ(diff.reasons.size(), 1u);
  EXPECT_NE(diff.reasons[0].find("8x8 and 9x8"), std::string::npos);
  EXPECT_FALSE(diff.figures);
}

TEST(ImageDiff, MissingChannelsAreNamed) {
  Picture a = pictureOf(noise(4, 4, 1)), b = a;
  b.channels[1] = "depth";
  const ImageDiff diff = compareImages(a, b, {});
  EXPECT_EQ(diff.onlyInA, std::vector<std::string>{"G"});
  EXPECT_EQ(diff.onlyInB, std::vector<std::string>{"depth"});
  EXPECT_EQ(diff.reasons.size(), 2u);
  EXPECT_FALSE(diff.figures);
  a.channels = b.channels = {"X", "Y", "Z"};
  EXPECT_THROW(compareImages(a, b, {}), Error);
}

TEST(ImageDiff, NonFiniteValuesDifferEvenFromThemselves) {
  for (float bad : {std::nanf(""), kInfinity, -kInfinity}) {
    Picture a = pictureOf(noise(4, 4, 1));
    a.values[(2 * 4 + 3) * 3 + 1] = bad;
    a.values[(3 * 4 + 0) * 3 + 0] = bad;
    const ImageDiff diff = compareImages(a, a, {});
    EXPECT_EQ(diff.reasons.size(), 2u);
    EXPECT_EQ(diff.nonFiniteA.count, 2u);
    EXPECT_EQ(diff.nonFiniteB.x, 3u);
    EXPECT_EQ(diff.nonFiniteB.y, 2u);
    EXPECT_EQ(diff.nonFiniteB.channel, "G");
    EXPECT_FALSE(diff.figures);
  }
}

TEST(ImageDiff, OnePixelAndASignError) {
  const Picture a = pictureOf(noise(6, 5, 1));
  Picture b = a;
  b.values[(4 * 6 + 2) * 3 + 2] += 0.5f;
  ImageDiff diff = compareImages(b, a, {});
  EXPECT_FALSE(diff.equalBits);
  EXPECT_NEAR(diff.figures->maxError, 0.5, 1e-6);
  EXPECT_EQ(diff.figures->maxX, 2u);
  EXPECT_EQ(diff.figures->maxY, 4u);
  EXPECT_EQ(diff.figures->maxChannel, 'B');
  EXPECT_NEAR(diff.figures->rmse, 0.5 / std::sqrt(90.0), 1e-6);
  b = a;
  for (float& v : b.values) v = -v;
  diff = compareImages(b, a, {});
  EXPECT_NEAR(diff.figures->meanRatio, -1.0, 1e-12);
  EXPECT_GT(diff.figures->flip, 0.3);
}

TEST(ImageDiff, TrimmedErrorLeavesOutTheLargestTerms) {
  const ColorImage reference{20, 20,
                             std::vector<vec3>(400, vec3(1.0f))};  // 1200 terms: one is left out
  ColorImage image = reference;
  image.pixels[7].y = 101.0f;
  const RelativeError error = relativeError(image, reference);
  EXPECT_NEAR(error.all, 1e4 / 1.01 / 1200.0, 1e-9);
  EXPECT_EQ(error.trimmed, 0.0);
}

TEST(ImageDiff, DisplayScaleInterpolatesThePercentile) {
  ColorImage image{3, 1, {vec3(1.0f), vec3(4.0f), vec3(2.0f)}};
  EXPECT_NEAR(displayScale(image), 0.5 / (2.0 + 0.4 * 2.0), 1e-12);  // rank 0.7 * 2
  image = {1, 1, {vec3(0.0f)}};
  EXPECT_NEAR(displayScale(image), 0.5e12, 1.0);
}

Picture noisy(std::uint32_t seed, float shift) {
  std::mt19937 random(seed);
  std::normal_distribution<float> error(0.0f, 0.1f);
  Picture out{64, 64, {"R", "G", "B", "variance.R", "variance.G", "variance.B"}, {}, {}};
  for (int i = 0; i < 64 * 64; ++i) {
    for (int c = 0; c < 3; ++c) out.values.push_back(2.0f + shift + error(random));
    out.values.insert(out.values.end(), 3, 0.01f);
  }
  return out;
}

TEST(ZTest, HoldsForTwoPicturesOfOneThing) {
  const ImageDiff diff = compareImages(noisy(1, 0.0f), noisy(2, 0.0f), {});
  ASSERT_TRUE(diff.figures && diff.figures->zTest);
  const ZTest& z = *diff.figures->zTest;
  EXPECT_NEAR(z.within2, 0.9545, 0.01);
  EXPECT_NEAR(z.within3, 0.9973, 0.003);
  EXPECT_GT(z.largestP, 1e-3);
  EXPECT_GT(z.leastMeanP, 1e-3);
}

TEST(ZTest, SeesABiasFarBelowTheNoise) {
  // 0.01 is a tenth of a pixel's sigma and 4.5 sigma of the difference of the means.
  const ZTest z = zTest(noisy(1, 0.01f), noisy(2, 0.0f));
  EXPECT_LT(z.leastMeanP, 0.01);
  EXPECT_GT(z.largestP, 1e-3);
  EXPECT_GT(z.meanZ[0], 0.0);
}

TEST(ZTest, FindsOnePixelThatIsWrong) {
  Picture a = noisy(1, 0.0f);
  a.values[(5 * 64 + 9) * 6 + 1] = 9.0f;
  const ZTest z = zTest(a, noisy(2, 0.0f));
  EXPECT_EQ(z.largestX, 9u);
  EXPECT_EQ(z.largestY, 5u);
  EXPECT_LT(z.largestP, 1e-12);
}

TEST(ZTest, WithoutVarianceOnlyEqualValuesAgree) {
  Picture a{1, 1, noisy(1, 0).channels, {1, 1, 1, 0, 0, 0}, {}}, b = a;
  EXPECT_EQ(zTest(a, b).largest, 0.0);
  EXPECT_EQ(zTest(a, b).leastMeanP, 1.0);
  b.values[0] = 1.5f;
  EXPECT_TRUE(std::isinf(zTest(a, b).largest));
  EXPECT_EQ(zTest(a, b).leastMeanP, 0.0);
}

TEST(Magma, GoesFromBlackToLightYellow) {
  EXPECT_LT(maxComponent(magma(0.0f)), 0.05f);
  EXPECT_GT(magma(1.0f).x, 0.95f);
  EXPECT_EQ(magma(7.0f), magma(1.0f));
  for (int i = 0; i < 99; ++i) {
    const auto at = static_cast<float>(i) / 100.0f;
    EXPECT_LT(luminance(magma(at)), luminance(magma(at + 0.01f)));
  }
}

}  // namespace
}  // namespace trex
