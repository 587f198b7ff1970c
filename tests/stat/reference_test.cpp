// Exact mode against a reference made by another renderer, with the variances of both; the hybrid
// against exact mode. On failure the pictures are written to the artefact folder.
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>

#include "src/frame/image_file.h"
#include "src/frame/picture_reader.h"
#include "src/scene/import.h"
#include "src/session/session.h"

namespace trex {
namespace {
namespace fs = std::filesystem;

constexpr std::uint32_t kSide = 64;
const fs::path kSource = TREX_SOURCE_DIR;

std::vector<float> readReference(const char* name) {
  const fs::path path = kSource / "tests/refs" / name;
  const Picture picture = readPicture(path);
  EXPECT_EQ(picture.width, kSide);
  EXPECT_EQ(picture.channels.size(), 3u);
  return picture.values;
}

/// Mean and variance of each channel of each pixel, and of the whole picture.
struct Rendered {
  std::vector<double> mean, variance;
  dvec3 total{0.0}, totalVariance{0.0};
  Picture picture;
};

Rendered render(const RenderSettings& settings) {
  Scene scene = importScene(kSource / "assets/cornell.glb");
  const Camera camera = scene.cameras.front();
  const ModelOptions options{.voxels = settings.exact < 1.0,
                             .voxelDepth = voxelDepthFor(kSide * kSide)};
  Session session(std::make_shared<const Model>(makeModel(std::move(scene), options)), camera,
                  settings, {.variance = true});
  session.run();
  EXPECT_EQ(session.report().nonFinite, 0u);
  Rendered out;
  constexpr double kPixels = double{kSide} * kSide;
  for (std::uint32_t y = 0; y < kSide; ++y) {
    for (std::uint32_t x = 0; x < kSide; ++x) {
      const dvec3 mean = session.frame().mean(x, y),
                  variance = session.frame().varianceOfMean(x, y);
      for (int c = 0; c < 3; ++c) {
        out.mean.push_back(mean[c]);
        out.variance.push_back(variance[c]);
      }
      out.total += mean / kPixels;
      out.totalVariance += variance / (kPixels * kPixels);
    }
  }
  out.picture = session.picture();
  return out;
}

RenderSettings settings(double exact, std::uint32_t samples, std::uint32_t seed) {
  RenderSettings s;
  s.width = s.height = kSide;
  s.exact = exact;
  s.samples = samples;
  s.seed = seed;
  return s;
}

void keepArtefact(const std::string& name, const Picture& picture) {
  fs::create_directories(TREX_ARTEFACT_DIR);
  const fs::path path = fs::path(TREX_ARTEFACT_DIR) / (name + ".exr");
  writePicture(path, picture, ToneMap{});
  std::printf("picture: %s\n", path.c_str());
}

/// DESIGN: 99.75 % of the pixels pass a z-test at the level that so many tests allow; the mean is
/// right within 0.3 %.
TEST(ExactMode, MatchesTheReferencePixelByPixel) {
  const std::vector<float> mean = readReference("cornell.exr");
  const std::vector<float> variance = readReference("cornell.var.exr");
  const Rendered ours = render(settings(1.0, 1024, 1));
  std::size_t passed = 0;
  double sumOurs = 0.0, sumReference = 0.0;
  for (std::size_t i = 0; i < mean.size(); ++i) {
    const double together = ours.variance[i] + static_cast<double>(variance[i]);
    const double z =
        std::abs(ours.mean[i] - static_cast<double>(mean[i])) / std::sqrt(together + 1e-20);
    // Variances estimated from few passes have tails: 4 instead of the normal distribution's 3.02.
    passed += z < 4.0;
    sumOurs += ours.mean[i];
    sumReference += static_cast<double>(mean[i]);
  }
  const double share = static_cast<double>(passed) / static_cast<double>(mean.size());
  EXPECT_GE(share, 0.9975);
  EXPECT_NEAR(sumOurs / sumReference, 1.0, 0.003);
  std::printf("pixels passed %.4f, mean ratio %.5f\n", share, sumOurs / sumReference);
  if (HasFailure()) keepArtefact("exact-cornell", ours.picture);
}

/// The correction makes the hybrid consistent: equal means within the confidence interval, for
/// either kind of guess.
TEST(Hybrid, ConvergesToExactMode) {
  const Rendered exact = render(settings(1.0, 256, 2));
  for (GuessKind guess : {GuessKind::kRay, GuessKind::kCone}) {
    RenderSettings s = settings(0.25, 512, 3);
    s.guess = guess;
    const Rendered hybrid = render(s);
    for (int c = 0; c < 3; ++c) {
      const double z = (hybrid.total[c] - exact.total[c]) /
                       std::sqrt(hybrid.totalVariance[c] + exact.totalVariance[c]);
      EXPECT_LT(std::abs(z), 3.5) << "channel " << c << " guess " << static_cast<int>(guess);
    }
    if (HasFailure()) keepArtefact("hybrid-cornell", hybrid.picture);
  }
}

/// The bias of the guess alone stays small: 2 % of the mean, and no pixel block is far off.
TEST(Guess, BiasIsBounded) {
  const Rendered exact = render(settings(1.0, 256, 4));
  const Rendered guess = render(settings(0.0, 256, 5));
  for (int c = 0; c < 3; ++c) EXPECT_NEAR(guess.total[c] / exact.total[c], 1.0, 0.02);
  constexpr std::uint32_t kBlock = 8;
  double worst = 0.0;
  for (std::uint32_t by = 0; by < kSide; by += kBlock) {
    for (std::uint32_t bx = 0; bx < kSide; bx += kBlock) {
      double a = 0.0, b = 0.0;
      for (std::uint32_t y = by; y < by + kBlock; ++y) {
        for (std::uint32_t x = bx; x < bx + kBlock; ++x) {
          a += guess.mean[(std::size_t{y} * kSide + x) * 3 + 1];
          b += exact.mean[(std::size_t{y} * kSide + x) * 3 + 1];
        }
      }
      if (b > 1e-3) worst = std::max(worst, std::abs(a / b - 1.0));
    }
  }
  std::printf("worst block of %u x %u pixels is off by %.3f\n", kBlock, kBlock, worst);
  EXPECT_LT(worst, 0.12);
  if (HasFailure()) keepArtefact("guess-cornell", guess.picture);
}

}  // namespace
}  // namespace trex
