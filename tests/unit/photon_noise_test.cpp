// Noise that a picture has without showing it: that of photons in cached light, and of rare bright
// samples. What is told of it, and that neither stops nor threads change that.
#include "src/session/photon_noise.h"

#include <gtest/gtest.h>
#include <tbb/global_control.h>
#include <unistd.h>

#include <cmath>
#include <filesystem>
#include <random>

#include "src/session/block_products.h"
#include "src/session/checkpoint.h"
#include "src/session/measured_correction.h"
#include "src/session/session.h"
#include "tests/unit/scenes.h"

namespace trex {
namespace {

constexpr std::uint64_t kPixels = 1u << 16;

// ---- which light ----

TEST(SampleLights, AreThoseOfTheSamples) {
  for (const bool inPages : {false, true}) {
    for (const std::uint64_t least : {std::uint64_t{0}, std::uint64_t{200000}}) {
      const auto lights = lightsOf(kPixels, least, inPages);
      std::size_t now = 0;
      for (std::uint32_t sample = 0; sample < 3000; ++sample) {
        if (now + 1 < lights.size() && lights[now + 1].first == sample) ++now;
        EXPECT_EQ(lights[now].photons, photonsFor(sample, kPixels, least, inPages)) << sample;
      }
    }
  }
}

TEST(SampleLights, NoiseIsToldByTheLightBefore) {
  const std::vector<SampleLight> lights{{0, 100}, {4, 300}, {16, 900}};
  EXPECT_EQ(photonsBefore(lights, 100), 0u);  // until the fourth sample nobody asks
  EXPECT_EQ(photonsBefore(lights, 300), 100u);
  EXPECT_EQ(photonsBefore(lights, 900), 300u);
  const std::vector<SampleLight> late{{0, 300}, {16, 900}}, always{{0, 500}};
  EXPECT_EQ(photonsBefore(late, 300), 150u);
  EXPECT_EQ(photonsBefore(late, 900), 300u);
  EXPECT_EQ(photonsBefore(always, 500), 250u);
}

/// The covariance of two lights is the variance of the finer one.
TEST(SampleLights, VarianceOfTheirMean) {
  const std::vector<SampleLight> lights{{0, 100}, {4, 300}, {16, 900}};
  const auto photons = [](std::uint32_t sample) {
    return sample < 4 ? 100.0 : sample < 16 ? 300.0 : 900.0;
  };
  for (const std::uint32_t samples : {1u, 4u, 5u, 16u, 17u, 60u}) {
    double sum = 0.0;
    for (std::uint32_t i = 0; i < samples; ++i) {
      for (std::uint32_t k = 0; k < samples; ++k) sum += 1.0 / std::max(photons(i), photons(k));
    }
    EXPECT_NEAR(varianceOfLight(lights, samples) * samples * samples / sum, 1.0, 1e-12) << samples;
  }
}

// ---- its square ----

constexpr std::uint32_t kSide = 96, kBlock = 4;

/// Noise that is even in blocks, of standard deviation `shared`, and that of paths, `own`.
PhotonNoise noiseOf(double shared, double own, std::uint32_t samples) {
  PhotonNoise noise(kSide, kSide, {{0, 100}, {4, 300}, {16, 900}});
  std::mt19937 random(5);
  std::normal_distribution<double> normal;
  std::vector<double> blocks(kSide / kBlock * (kSide / kBlock));
  for (std::uint32_t sample = 0; sample < samples; ++sample) {
    if (sample == 0 || sample == 4 || sample == 16) {  // another light, of other noise
      for (double& b : blocks) b = shared * normal(random);
    }
    for (std::uint32_t i = 0; i < kSide * kSide; ++i) {
      const std::uint32_t x = i % kSide, y = i / kSide;
      const double block = blocks[y / kBlock * (kSide / kBlock) + x / kBlock];
      noise.add(x, y, sample, vec3(static_cast<float>(block + own * normal(random))));
    }
  }
  return noise;
}

TEST(PhotonNoise, IsWhatPixelsShare) {
  const std::vector<vec3> weigh(kSide * kSide, vec3(0.5f));
  for (const std::uint32_t samples : {16u, 20u}) {
    const double photons = samples == 16 ? 300.0 : 900.0;
    const double older = photons * varianceOfLight(noiseOf(0, 0, 1).lights(), samples);
    const double found = noiseOf(0.2, 1.0, samples).square(samples, weigh, kBlock);
    EXPECT_NEAR(found / (0.5 * 0.04 * older), 1.0, 0.2) << samples;
    EXPECT_LT(noiseOf(0.0, 1.0, samples).square(samples, weigh, kBlock), 0.1 * found);
  }
}

TEST(PhotonNoise, WithoutSamplesIsNothing) {
  PhotonNoise noise = noiseOf(0.2, 0.0, 16);
  const std::vector<vec3> weigh(kSide * kSide, vec3(1.0f));
  EXPECT_EQ(noise.square(0, weigh, kBlock), 0.0);
  noise.add(3, 3, 15, vec3(kInfinity));
  EXPECT_TRUE(std::isfinite(noise.square(16, weigh, kBlock)));
  for (std::uint32_t i = 0; i < kSide * kSide; ++i) noise.restart(i % kSide, i / kSide);
  EXPECT_EQ(noise.square(16, weigh, kBlock), 0.0);
}

// ---- sessions ----

constexpr std::uint32_t kWidth = 80, kHeight = 72;

/// A room that is lit through a gap from beside it, so that few photons come.
const std::shared_ptr<const Model>& backRoom() {
  static const auto model = [] {
    Scene scene;
    scene.materials = {test::lambert(0.7f), test::lambert(0.0f, 60.0f)};
    test::place(scene, test::box(vec3(-2.0f), vec3(2.0f), 0, true));
    test::place(scene, test::box(vec3(-0.8f, -2.0f, -2.0f), vec3(-0.7f, 2.0f, 1.5f), 0, false));
    test::place(scene, test::box(vec3(-1.6f, 0.8f, -1.6f), vec3(-1.4f, 1.0f, -1.4f), 1, false));
    test::place(scene, test::sphere(vec3(0.8f, -0.5f, -0.8f), 0.6f, 0, 12));
    scene.cameras = {test::lookAt(dvec3(0.9, 0.0, 1.9), dvec3(0.6, 0.0, -1.0), 1.0f)};
    return std::make_shared<const Model>(
        makeModel(std::move(scene), {.voxels = true, .voxelDepth = 6}));
  }();
  return model;
}

RenderSettings settings(std::uint32_t samples, Denoise denoise = Denoise::kFilter) {
  RenderSettings s;
  s.width = kWidth;
  s.height = kHeight;
  s.samples = samples;
  s.exact = kFirstShare;
  s.dial = true;
  s.device = RenderSettings::kNoDevice;
  s.guess = GuessKind::kRay;
  s.denoise = denoise;
  return s;
}

std::unique_ptr<Session> session(const RenderSettings& s) {
  return std::make_unique<Session>(backRoom(), backRoom()->scene.cameras.front(), s);
}

/// Relative squares of the guess's means in blocks of 8 x 8 pixels: how far seeds differ there,
/// which is mostly by their photons, over many of them.
TEST(PhotonNoiseSession, WhatIsToldIsHowFarSeedsDiffer) {
  constexpr std::uint32_t kSeeds = 16, kBlocks = 8;
  std::vector<std::vector<dvec3>> blocks(kSeeds);
  std::vector<vec3> weigh(kWidth * kHeight);
  double told = 0.0, squares = 0.0;
  for (std::uint32_t seed = 0; seed < kSeeds; ++seed) {
    RenderSettings s = settings(16);
    s.seed = seed;
    const auto r = session(s);
    r->run();
    const Accumulator& sums = r->buffers().sums;
    dvec3 mean(0.0);
    for (std::uint32_t i = 0; i < kWidth * kHeight; ++i) {
      mean += sums.guess(i % kWidth, i / kWidth).mean() / (1.0 * kWidth * kHeight);
    }
    for (std::uint32_t top = 0; top < kHeight; top += kBlocks) {
      for (std::uint32_t left = 0; left < kWidth; left += kBlocks) {
        dvec3 sum(0.0);
        for (std::uint32_t i = 0; i < kBlocks * kBlocks; ++i) {
          sum += sums.guess(left + i % kBlocks, top + i / kBlocks).mean();
        }
        blocks[seed].push_back(sum / (1.0 * kBlocks * kBlocks) / mean);
      }
    }
    // One weight for all pixels of all seeds.
    std::fill(weigh.begin(), weigh.end(), vec3(1.0 / (mean * mean)));
    const double one = r->buffers().photonNoise->square(16, weigh, kBlocks);
    told += one / kSeeds;
    squares += one * one / kSeeds;
  }
  double is = 0.0;
  for (std::size_t b = 0; b < blocks[0].size(); ++b) {
    dvec3 sum(0.0), square(0.0);
    for (const auto& of : blocks) {
      sum += of[b];
      square += of[b] * of[b];
    }
    const dvec3 variance = (square - sum * sum / (1.0 * kSeeds)) / (kSeeds - 1.0);
    is += (variance.x + variance.y + variance.z) / (3.0 * static_cast<double>(blocks[0].size()));
  }
  EXPECT_GT(told, is / 2.0);
  EXPECT_LT(told, is * 2.0);
  EXPECT_GT(told, 1e-3);
  // Of a single draw what is told differs by 1.1 of its mean, as the room's brightness is one
  // number.
  EXPECT_LT(squares - told * told, 0.8 * 0.8 * told * told);
}

/// What is known counts without pairs; what they say beyond it as far as it stands out.
TEST(BiasLeft, HoldsWhatIsKnown) {
  BiasLeft nothing{{0.0, 0.5}, 0.0, 0.0};
  EXPECT_EQ(nothing.square(0.0, 0.0), 0.0);
  EXPECT_EQ(nothing.square(0.01, 0.0), 0.01);
  nothing.even.square = -0.7;  // noise
  EXPECT_EQ(nothing.square(0.01, 0.0), 0.01);
  const BiasLeft known{{0.02, 1e-6}, 0.0, 0.0}, less{{0.004, 1e-6}, 0.0, 0.0};
  EXPECT_NEAR(known.square(0.0, 0.0), 0.02, 1e-5);
  EXPECT_NEAR(known.square(0.01, 0.0), 0.02, 1e-5);
  EXPECT_NEAR(less.square(0.01, 0.0), 0.004, 1e-5);
  const BiasLeft corrected{{0.02, 1e-6}, 0.001, 0.015};
  EXPECT_NEAR(corrected.square(0.0, 0.0), 0.006, 1e-5);
  EXPECT_NEAR(corrected.square(0.01, 0.0), 0.006, 1e-5);
}

/// What does not stand out counts for no more than a quarter of what is known of the error.
TEST(BiasLeft, WhatMayBeNoiseDoesNotOutweighWhatIsKnown) {
  for (const double square : {0.001, 0.1, 0.3, 0.59}) {
    const BiasLeft doubtful{{square, 0.3}, 0.0, 0.0};
    EXPECT_EQ(doubtful.square(0.0, 0.0), 0.0);
    EXPECT_LE(doubtful.square(0.01, 0.02), 0.01 + 0.25 * 0.03);
    EXPECT_GT(doubtful.square(0.0, 0.02), 0.0);
  }
  const BiasLeft sure{{1.5, 0.3}, 0.0, 0.0};  // by five standard errors
  EXPECT_GT(sure.square(0.01, 0.02), 1.2);
  // Less than nothing is noise: what is known stays.
  const BiasLeft noise{{-0.5, 0.1}, 0.0, 0.0};
  EXPECT_EQ(noise.square(0.01, 0.02), 0.01);
}

/// Differences between exact paths and guess in a room that is lit through a gap: next to all paths
/// find less than the guess, few find very much more. By chance they may seem to know a bias: it
/// stands out of their spread as seldom as it would of a normal deviate's. One that all share does.
TEST(BlockProducts, RareBrightDifferencesDoNotStandOut) {
  constexpr std::uint32_t kSize = 96, kWide = 8, kTrials = 200;
  const std::vector<vec3> weigh(kSize * kSize, vec3(1.0f));
  std::mt19937 random(7);
  std::uniform_real_distribution<float> unit(0.0f, 1.0f);
  for (const float chance : {0.1f, 0.01f, 0.001f}) {
    std::uint32_t seen = 0;
    double mean = 0.0;
    for (std::uint32_t trial = 0; trial < kTrials; ++trial) {
      std::vector<vec3> values(kSize * kSize);
      for (vec3& v : values) v = vec3(unit(random) < chance ? (1.0f - chance) / chance : -1.0f);
      const BiasFigures found =
          blockProducts(kSize, kSize, kWide, weigh, [&](std::size_t i) { return values[i]; });
      seen += standsOut(found) > 0.0 ? 1 : 0;
      mean += found.square / (3.0 * kSize * kSize * kTrials);
    }
    EXPECT_LE(seen, kTrials / 20) << chance;
    EXPECT_LT(std::abs(mean), 0.005 / static_cast<double>(chance)) << chance;
  }
  std::vector<vec3> values(kSize * kSize);
  for (vec3& v : values) v = vec3(0.3f + 0.3f * (unit(random) < 0.1f ? 9.0f : -1.0f));
  const BiasFigures found =
      blockProducts(kSize, kSize, kWide, weigh, [&](std::size_t i) { return values[i]; });
  EXPECT_NEAR(standsOut(found) / (3.0 * kSize * kSize), 0.09, 0.015);
}

TEST(BlockProducts, OfOneBlockDoubtIsAsLargeAsWhatItSays) {
  const std::vector<vec3> weigh(16, vec3(1.0f));
  const BiasFigures found = blockProducts(4, 4, 8, weigh, [](std::size_t) { return vec3(1.0f); });
  EXPECT_FLOAT_EQ(static_cast<float>(found.square), 48.0f);
  EXPECT_EQ(found.doubt, found.square);
  EXPECT_EQ(standsOut(found), 0.0);
}

// ---- noise of light ----

/// Of rare bright samples, as of others: a draw has the variance of the mean, and no mean.
TEST(LightNoise, DrawsHaveTheMeansVariance) {
  for (const std::uint32_t samples : {15u, 16u}) {
    LightNoise noise(kSide, kSide);
    std::mt19937 random(samples);
    std::uniform_real_distribution<float> unit(0.0f, 1.0f);
    const float chance = 0.1f;  // of a sample of 5, else 1
    double mean = 0.0, square = 0.0;
    for (std::uint32_t i = 0; i < kSide * kSide; ++i) {
      float sum = 0.0f;
      for (std::uint32_t s = 0; s < samples; ++s) {
        const float light = unit(random) < chance ? 5.0f : 1.0f;
        noise.add(i % kSide, i / kSide, s, vec3(light));
        sum += light;
      }
      const auto count = static_cast<float>(samples);
      const vec3 draw = noise.draw(i % kSide, i / kSide, vec3(sum / count), count);
      EXPECT_EQ(draw.x, draw.y);
      mean += static_cast<double>(draw.x) / (kSide * kSide);
      square += static_cast<double>(draw.x * draw.x) / (kSide * kSide);
    }
    const double variance = 16.0 * 0.1 * 0.9 / samples;
    EXPECT_NEAR(mean, 0.0, 4.0 * std::sqrt(variance) / kSide);
    EXPECT_NEAR(square / variance, 1.0, 0.1);
  }
}

TEST(LightNoise, EvenLightHasNone) {
  LightNoise noise(1, 1);
  for (std::uint32_t s = 0; s < 7; ++s) noise.add(0, 0, s, vec3(0.5f, 1.0f, 2.0f));
  EXPECT_EQ(noise.draw(0, 0, vec3(0.5f, 1.0f, 2.0f), 7.0f), vec3(0.0f));
  noise.restart(0, 0);
  EXPECT_EQ(noise.draw(0, 0, vec3(0.0f), 0.0f), vec3(0.0f));
}

TEST(PhotonNoiseSession, ThreadsAndStopsChangeNoEstimate) {
  const auto path =
      std::filesystem::temp_directory_path() / ("trex-photons-" + std::to_string(getpid()));
  const auto whole = session(settings(22));
  whole->run();
  const double told = whole->estimatedError();
  EXPECT_GT(told, 0.0);
  for (const int tiles : {30, 50, 68}) {
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, 1);
    const auto first = session(settings(22));
    int left = tiles;
    first->run([&] { return left-- > 0; });
    first->saveCheckpoint(path, 5, 0);
    const auto second = session(settings(22));
    CheckpointReader reader(path);
    second->restoreCheckpoint(reader);
    second->run();
    EXPECT_EQ(told, second->estimatedError()) << tiles;
    EXPECT_EQ(whole->picture().values, second->picture().values) << tiles;
  }
  std::filesystem::remove(path);
}

/// Pairs of which a few outshine all others: what they would change by more than it is worth is
/// left out, and the picture stays near that of the guess.
TEST(MeasuredCorrectionSession, RareBrightPathsDoNoHarm) {
  RenderSettings corrected = settings(16);
  corrected.seed = 4;
  RenderSettings plain = corrected;
  plain.dial = false;
  plain.exact = 0.0;
  const auto a = session(corrected), b = session(plain);
  a->run();
  b->run();
  const Picture p = a->picture(), guess = b->picture();
  double mean = 0.0, off = 0.0;
  const auto count = static_cast<double>(guess.values.size());
  for (const float v : guess.values) mean += static_cast<double>(v) / count;
  for (std::size_t i = 0; i < guess.values.size(); ++i) {
    const auto x = static_cast<double>(p.values[i]), y = static_cast<double>(guess.values[i]);
    off += (x - y) * (x - y) / (y * y + 0.01 * mean * mean) / count;
  }
  EXPECT_LT(off, 0.3);
}

/// Of any photons asked for at once, such as those of a machine that comes late.
TEST(PhotonNoiseSession, LightOfAllPhotonsAtOnceTellsTheSame) {
  const auto steps = session(settings(17)), late = session(settings(17));
  steps->run();
  const std::uint64_t photons = photonsFor(16, kWidth * kHeight, 0, false);
  ASSERT_EQ(steps->light().photons(), photons);
  EXPECT_TRUE(late->makeLight(photons, [] { return true; }));
  const dvec3 origin = backRoom()->rays->renderOrigin();
  int told = 0;
  for (int i = 0; i < 40; ++i) {
    const vec3 at(dvec3(1.9 - 0.06 * i, -2.0, 0.5) - origin);
    vec3 a(0.0f), b(0.0f), noiseA(0.0f), noiseB(0.0f);
    const vec3 up(0.0f, 1.0f, 0.0f);
    const bool known =
        steps->light().cache()->noisyIrradiance(at, up, 0.0f, vec2(0.5f), 3, a, noiseA);
    EXPECT_EQ(known,
              late->light().cache()->noisyIrradiance(at, up, 0.0f, vec2(0.5f), 3, b, noiseB));
    EXPECT_EQ(a, b);
    EXPECT_EQ(noiseA, noiseB);
    told += noiseA != vec3(0.0f) ? 1 : 0;
  }
  EXPECT_GT(told, 4);
}

}  // namespace
}  // namespace trex
