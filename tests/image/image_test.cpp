// Small scenes against committed references with known variance (refs/, made by make_refs.py). The
// exact mode has to pass z-tests; the guess has a bound on its bias a scene. On failure image,
// reference, heat map and p-values are written to the artefact folder.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cmath>
#include <ostream>

#include "src/scene/import.h"
#include "tests/image/reference.h"
#include "tests/image/rendered.h"

namespace trex::test {
namespace {

constexpr std::uint32_t kSide = 64, kGuessSamples = 96;

struct Case {
  const char* name;
  std::uint32_t exactSamples;
  /// Limits of the guess, relative: of the picture's mean, and of its worst block of 8 x 8 pixels.
  double rayMean, rayBlock, coneMean, coneBlock;
  std::uint32_t guessSamples = kGuessSamples;
};

void PrintTo(const Case& c, std::ostream* out) { *out << c.name; }

// Limits a little above what docs/tests.md reports.
constexpr Case kCases[] = {
    {"glossy", 512, 0.01, 0.08, 0.01, 0.08},      {"emitters", 512, 0.01, 0.17, 0.01, 0.17},
    {"slit", 1024, 0.01, 0.15, 0.06, 0.33},       {"sun", 512, 0.01, 0.06, 0.013, 0.15},
    {"glass", 512, 0.01, 0.07, 0.014, 0.12},      {"instances", 512, 0.01, 0.05, 0.01, 0.08},
    {"texture", 512, 0.01, 0.05, 0.012, 0.04},    {"point", 512, 0.01, 0.025, 0.02, 0.05},
    {"coats", 512, 0.01, 0.08, 0.015, 0.05, 192},
};

std::string nameOf(const testing::TestParamInfo<Case>& info) { return info.param.name; }

class Image : public testing::TestWithParam<Case> {
 protected:
  void checkGuess(int device, GuessKind guess, const std::string& title) {
    const Case& c = GetParam();
    const bool cone = guess == GuessKind::kCone;
    const double meanLimit = cone ? c.coneMean : c.rayMean;
    const double blockLimit = cone ? c.coneBlock : c.rayBlock;
    const Rendered reference = readReference(c.name);
    RenderSettings settings = settingsFor(kSide, 0.0, c.guessSamples, 3, device);
    settings.guess = guess;
    const Rendered image = render(importTestScene(c.name), settings);
    const Comparison result = compare(image, reference);
    report(fmt::format("{} {}, mean bias", c.name, title), result.meanRatio - 1.0, meanLimit);
    report(fmt::format("{} {}, worst block", c.name, title), result.worstBlock, blockLimit);
    EXPECT_NEAR(result.meanRatio, 1.0, meanLimit);
    EXPECT_LT(result.worstBlock, blockLimit);
    if (HasFailure()) keepArtefacts(fmt::format("{}-{}", c.name, title), image, reference);
  }
};

/// At most a quarter percent of the pixels may fail: variances estimated from few samples are too
/// small where a rare path carries much light. Blocks of 64 pixels do not need that allowance.
TEST_P(Image, ExactModeMatchesTheReference) {
  const Case& c = GetParam();
  const Rendered reference = readReference(c.name);
  const Rendered image = render(importTestScene(c.name), settingsFor(kSide, 1.0, c.exactSamples));
  const Comparison result = compare(image, reference);
  const std::string name = std::string(c.name) + " exact";
  report(name + " pixels failed", 1.0 - result.pixelsPassed, 0.0025);
  report(name + " p of the worst block", result.blockP, 0.01);
  const double meanVariance = image.totalVariance.x + image.totalVariance.y +
                              image.totalVariance.z + reference.totalVariance.x +
                              reference.totalVariance.y + reference.totalVariance.z;
  const double sum = reference.total.x + reference.total.y + reference.total.z;
  const double limit = 0.003 + 3.0 * std::sqrt(meanVariance) / sum;
  report(name + " mean bias", result.meanRatio - 1.0, limit);
  EXPECT_GE(result.pixelsPassed, 0.9975);
  EXPECT_GT(result.blockP, 0.01);
  EXPECT_NEAR(result.meanRatio, 1.0, limit);
  if (HasFailure()) keepArtefacts(std::string(c.name) + "-exact", image, reference);
}

TEST_P(Image, GuessIsClose) {
  checkGuess(RenderSettings::kNoDevice, GuessKind::kRay, "guess-ray-none");
}
TEST_P(Image, GuessOfTheDeviceIsClose) {
  checkGuess(RenderSettings::kBestDevice, GuessKind::kRay, "guess-ray-device");
}
/// What devices with cores of their own do.
TEST_P(Image, ConesOfTheDeviceAreClose) {
  checkGuess(RenderSettings::kBestDevice, GuessKind::kCone, "guess-cone-device");
}

/// The z-tests above would notice a picture that is 2 % too bright.
TEST(ImageComparison, NoticesTwoPercent) {
  const Rendered reference = readReference("point");
  Rendered image = render(importTestScene("point"), settingsFor(kSide, 1.0, 128));
  EXPECT_GT(compare(image, reference).blockP, 0.01);
  for (dvec3& m : image.mean) m *= 1.02;
  EXPECT_LT(compare(image, reference).blockP, 1e-6);
}

/// Mean FLIP over five seeds of what is shown of a scene, filtered, after 32 samples.
double shownError(const char* scene, double exact, bool dial) {
  constexpr std::uint32_t kSeeds = 5;
  const Rendered reference = readReference(scene);
  const auto model = std::make_shared<const Model>(makeModel(
      importTestScene(scene), {.voxelDepth = voxelDepthFor(std::uint64_t{kSide} * kSide)}));
  double sum = 0.0;
  for (std::uint32_t seed = 0; seed < kSeeds; ++seed) {
    RenderSettings settings = settingsFor(kSide, exact, 32, seed);
    settings.dial = dial;
    settings.denoise = Denoise::kFilter;
    Session session(model, model->scene.cameras.front(), settings);
    session.run();
    const Picture picture = session.picture();
    const std::vector<float>& values = picture.values;
    Rendered image;
    image.width = image.height = kSide;
    for (std::size_t i = 0; i < values.size(); i += picture.channels.size()) {
      image.mean.emplace_back(values[i], values[i + 1], values[i + 2]);
    }
    sum += flip(image, reference) / kSeeds;
  }
  return sum;
}

/// Where exact paths are much noisier than the guess, what they add does not stain the picture.
TEST(ImageCorrection, IsWorthItWhereItIsMostlyNoise) {
  const double guess = shownError("slit", 0.0, false);
  const double given = shownError("slit", 0.25, false) / guess;
  const double dial = shownError("slit", kFirstShare, true) / guess;
  report("slit, exact 0.25 over the guess, FLIP", given, 1.0);
  report("slit, exact auto over the guess, FLIP", dial, 1.1);
  EXPECT_LT(given, 1.0);
  EXPECT_LT(dial, 1.1);
}

INSTANTIATE_TEST_SUITE_P(Scenes, Image, testing::ValuesIn(kCases), nameOf);

}  // namespace
}  // namespace trex::test
