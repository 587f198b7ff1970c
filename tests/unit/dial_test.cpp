// The dial that sets itself: what it measures, that it leaves the mean alone, its
// correction, and that pictures keep their bits.
#include "src/session/dial.h"

#include <gtest/gtest.h>
#include <tbb/global_control.h>
#include <unistd.h>

#include <cmath>
#include <filesystem>
#include <random>

#include "src/session/checkpoint.h"
#include "src/session/measured_correction.h"
#include "src/session/picture_error.h"
#include "src/session/session.h"
#include "src/session/unfiltered_pixels.h"
#include "tests/unit/scenes.h"

namespace trex {
namespace {

// ---- what it measures ----

constexpr std::uint32_t kSide = 64;
const Tile kArea{0, 0, kSide, kSide};

/// A guess of mean 1 + bias and its exact value, of mean 1.
struct Integrand {
  double bias, guessNoise, pairNoise;
  std::mt19937 random{1};

  std::pair<vec3, vec3> sample() {
    std::normal_distribution<double> noise;
    const double guess = 1.0 + bias + guessNoise * noise(random);
    const double exact = guess - bias + pairNoise * noise(random);
    return {vec3(static_cast<float>(guess)), vec3(static_cast<float>(exact))};
  }
};

TEST(MeasureShares, FindsVariancesAndBias) {
  for (const double bias : {0.0, 0.2, -0.2}) {
    Integrand integrand{bias, 0.5, 0.7};
    Accumulator sums(kSide, kSide, true);
    for (std::uint32_t s = 0; s < 8; ++s) {
      for (std::uint32_t i = 0; i < kSide * kSide; ++i) {
        const auto [guess, exact] = integrand.sample();
        sums.add(i % kSide, i / kSide, s, guess, s % 2 == 0 ? &exact : nullptr);
      }
    }
    const ShareFigures f = measureShares(kArea, sums);
    const double weight = 1.0 / (1.01 * (1.0 + bias) * (1.0 + bias));
    EXPECT_DOUBLE_EQ(f.pairs, 4.0);
    EXPECT_NEAR(f.guessVariance, weight * 0.25, 0.05 * weight);
    EXPECT_NEAR(f.pairVariance, weight * 0.49, 0.05 * weight);
    EXPECT_NEAR(f.bias[0].square, weight * bias * bias, 4.0 * f.bias[0].doubt);
    EXPECT_LT(f.bias[0].doubt, 0.01);
    EXPECT_NEAR(f.bias[1].square, 0.0, 4.0 * f.bias[1].doubt);
  }
}

TEST(Dial, FirstSamplesHaveNoPairs) {
  const Dial dial(1, kSide * kSide);
  EXPECT_EQ(dial.share(0, 0), 0.0);
  EXPECT_EQ(dial.share(0, 1), kFirstShare);
}

TEST(Dial, LooksAsOftenAsItMay) {
  for (const bool seldom : {false, true}) {
    const std::vector<std::uint32_t> looks = seldom ? std::vector<std::uint32_t>{16, 64, 256, 1024}
                                                    : std::vector<std::uint32_t>{2, 3, 4, 6, 9, 13};
    Dial dial(1, kSide * kSide, {{}, seldom}), restored = dial;
    const Accumulator sums(kSide, kSide, true);
    for (const std::uint32_t look : looks) {
      EXPECT_EQ(dial.nextLook(), look);
      restored.restore(look - 1);
      EXPECT_EQ(restored.nextLook(), look);
      dial.look(std::span(&kArea, 1), look - 1, sums);  // not yet
      EXPECT_EQ(dial.nextLook(), look);
      dial.look(std::span(&kArea, 1), look, sums);
    }
    dial.restart();
    EXPECT_EQ(dial.nextLook(), looks[0]);
  }
}

/// Choices depend on samples, and still the mean is the exact one: over many pictures, whether the
/// guess is right, wrong, or noisy.
TEST(Dial, LeavesTheMeanAlone) {
  constexpr int kPictures = 60;
  constexpr std::uint32_t kSamples = 40;
  for (const double bias : {0.0, 0.1, 0.5}) {
    Integrand integrand{bias, 0.3, 1.0};
    double sum = 0.0, square = 0.0, share = 0.0;
    for (int picture = 0; picture < kPictures; ++picture) {
      Accumulator sums(kSide, kSide, true);
      Dial dial(1, kSide * kSide);
      for (std::uint32_t s = 0; s < kSamples; ++s) {
        for (std::uint32_t i = 0; i < kSide * kSide; ++i) {
          const double offset = std::fmod(i * 0.618033988749895 + picture * 0.41, 1.0);
          const bool paired = takesExact(s, dial.share(0, s), offset);
          const auto [guess, exact] = integrand.sample();
          sums.add(i % kSide, i / kSide, s, guess, paired ? &exact : nullptr);
          dial.add(0, paired, paired ? 6 : 3);
        }
        dial.look(std::span(&kArea, 1), s + 1, sums);
      }
      double mean = 0.0;
      for (std::uint32_t i = 0; i < kSide * kSide; ++i) {
        EXPECT_GT(sums.pairs(i % kSide, i / kSide), 0u);
        mean += sums.mean(i % kSide, i / kSide).x / (kSide * kSide);
      }
      sum += mean;
      square += mean * mean;
      share += dial.share() / kPictures;
    }
    const double mean = sum / kPictures, variance = square / kPictures - mean * mean;
    EXPECT_NEAR(mean, 1.0, 4.0 * std::sqrt(variance / kPictures)) << bias;
    if (bias == 0.0) {
      EXPECT_LT(share, 0.1);
    } else {
      EXPECT_GT(share, 0.15) << bias;
    }
  }
}

// ---- the correction ----

/// A frame of one even surface whose guess lacks `bias` of the light, after 8 samples, each
/// `apart`-th with a pair.
std::unique_ptr<FrameBuffers> frameOf(double bias, double pairNoise, std::uint32_t apart = 2) {
  Integrand integrand{bias, 0.1, pairNoise};
  auto frame = std::make_unique<FrameBuffers>(
      kSide, kSide, true, true, PictureLayers{},
      TileScheduler({kArea}, TileScheduler::Order::kSweep, kSide, kSide));
  frame->dial = std::make_unique<Dial>(1, kSide * kSide);
  for (std::uint32_t s = 0; s < 8; ++s) {
    for (std::uint32_t i = 0; i < kSide * kSide; ++i) {
      const std::uint32_t x = i % kSide, y = i / kSide;
      const auto [guess, exact] = integrand.sample();
      const bool paired = s % apart == 0;
      frame->sums.add(x, y, s, guess, paired ? &exact : nullptr);
      const vec3 place(static_cast<float>(x), static_cast<float>(y), 0.0f);
      const Feature f{vec3(0.5f), vec3(0.0f, 0.0f, 1.0f), place, 1.0f, 0.0f};
      frame->features->add(x, y, f, guess);
      frame->dial->add(0, paired, 2);
    }
  }
  frame->tiles.restore(8, 0);
  return frame;
}

struct Corrected {
  double mean = 0.0, square = 0.0, left = 0.0;
};

Corrected correct(const FrameBuffers& frame) {
  MeasuredCorrection correction(*frame.features, exactDifferences(frame),
                                std::vector<float>(kSide * kSide, 1.0f));
  EXPECT_TRUE(correction.advance([] { return true; }));
  Corrected out;
  for (const vec3& v : correction.take(std::vector<vec3>(kSide * kSide, vec3(1.0f)))) {
    const auto value = static_cast<double>(v.x);
    out.mean += value / (kSide * kSide);
    out.square += value * value / (kSide * kSide);
  }
  out.left = correction.left().square(0.0, 0.0);
  return out;
}

TEST(MeasuredCorrection, FindsABiasInNoise) {
  const Corrected found = correct(*frameOf(0.3, 0.5));
  EXPECT_NEAR(found.mean, -0.3, 0.04);
  EXPECT_LT(found.left, 0.005);
}

TEST(MeasuredCorrection, LeavesNoTraceOfNoise) {
  for (const double noise : {0.3, 1.0, 5.0}) {
    EXPECT_LT(correct(*frameOf(0.0, noise)).square, 1e-4 * noise * noise) << noise;
  }
}

TEST(MeasuredCorrection, SaysWhatItLeaves) {
  // So noisy that little can be corrected, and so large that it still is known.
  const Corrected found = correct(*frameOf(0.3, 6.0));
  const double true_ = (found.mean + 0.3) * (found.mean + 0.3) / 1.01;
  EXPECT_NEAR(found.left, true_, 0.06);
}

// ---- without a filter ----

/// Mean square of the distance to the truth, 1: of the guess, of guess and all differences, and of
/// what is shown.
struct Distances {
  double guess = 0.0, all = 0.0, shown = 0.0;
};

Distances distances(const FrameBuffers& frame) {
  const UnfilteredPixels pixels(frame);
  Distances out;
  const auto square = [](const dvec3& v) { return (v.x - 1.0) * (v.x - 1.0) / (kSide * kSide); };
  for (std::uint32_t i = 0; i < kSide * kSide; ++i) {
    const std::uint32_t x = i % kSide, y = i / kSide;
    out.guess += square(frame.sums.guess(x, y).mean());
    out.all += square(frame.sums.mean(x, y));
    out.shown += square(pixels.mean(x, y));
  }
  return out;
}

TEST(UnfilteredPixels, AreNotWorseThanTheGuessNorThanAllDifferences) {
  for (const double noise : {0.003, 0.03, 0.3, 3.0}) {
    for (const double bias : {0.0, 0.1, 0.5}) {
      const Distances found = distances(*frameOf(bias, noise));
      EXPECT_LE(found.shown, 1.02 * std::min(found.guess, found.all)) << noise << ' ' << bias;
    }
  }
}

TEST(UnfilteredPixels, ShowTheGuessWhilePairsAreFew) {
  const auto frame = frameOf(0.5, 0.1, 8);  // one of each pixel
  const UnfilteredPixels pixels(*frame);
  for (std::uint32_t i = 0; i < kSide; ++i) {
    EXPECT_EQ(pixels.mean(i, i), frame->sums.guess(i, i).mean());
    EXPECT_EQ(pixels.variance(i, i), frame->sums.guess(i, i).varianceOfMean());
  }
}

TEST(UnfilteredPixels, WithoutADialAreAllDifferences) {
  const auto frame = frameOf(0.5, 3.0, 8);
  frame->dial.reset();
  const UnfilteredPixels pixels(*frame);
  for (std::uint32_t i = 0; i < kSide; ++i) {
    EXPECT_EQ(pixels.mean(i, i), frame->sums.mean(i, i));
    EXPECT_EQ(pixels.variance(i, i), frame->sums.varianceOfMean(i, i));
  }
  EXPECT_EQ(pixels.estimatedError(), frame->sums.estimatedError());
}

TEST(UnfilteredPixels, TellTheirError) {
  for (const double noise : {0.01, 0.3, 1.0}) {
    for (const double bias : {0.0, 0.3}) {
      const auto frame = frameOf(bias, noise);
      const double told = UnfilteredPixels(*frame).estimatedError();
      const double weight = 1.0 / (1.01 * (1.0 + bias) * (1.0 + bias));
      EXPECT_NEAR(told / distances(*frame).shown, 1.0, 0.5 + (1.0 - weight)) << noise << bias;
    }
  }
}

// ---- sessions ----

constexpr std::uint32_t kWidth = 80, kHeight = 72;  // four tiles, two of them cut

std::shared_ptr<const Model> roomModel(float emission = 8.0f) {
  Scene scene;
  scene.materials = {test::lambert(0.6f), test::lambert(0.0f, emission)};
  test::place(scene, test::box(vec3(-2.0f), vec3(2.0f), 0, true));
  test::place(scene, test::box(vec3(-0.5f, 1.8f, -0.5f), vec3(0.5f, 1.9f, 0.5f), 1, false));
  test::place(scene, test::sphere(vec3(0.8f, 0.0f, -1.0f), 0.6f, 0, 12));
  scene.cameras = {test::lookAt(dvec3(0.0, 0.0, 1.9), dvec3(0.0, 0.0, -1.0), 1.0f)};
  return std::make_shared<const Model>(
      makeModel(std::move(scene), {.voxels = true, .voxelDepth = 5}));
}

const std::shared_ptr<const Model>& room() {
  static const auto model = roomModel();
  return model;
}

RenderSettings settings(std::uint32_t samples, GuessKind guess = GuessKind::kRay) {
  RenderSettings s;
  s.width = kWidth;
  s.height = kHeight;
  s.samples = samples;
  s.exact = kFirstShare;
  s.dial = true;
  s.device = RenderSettings::kNoDevice;
  s.guess = guess;
  s.denoise = Denoise::kFilter;
  return s;
}

const PictureLayers kAll = layersFromNames({"all"});

std::unique_ptr<Session> session(const RenderSettings& s,
                                 const std::shared_ptr<const Model>& model = room()) {
  return std::make_unique<Session>(model, model->scene.cameras.front(), s, kAll);
}

TEST(DialSession, ThreadsAndStopsChangeNoBit) {
  RenderSettings off = settings(20);
  off.denoise = Denoise::kOff;
  for (const RenderSettings& s : {settings(20), settings(20, GuessKind::kCone), off}) {
    const auto whole = session(s);
    whole->run();
    EXPECT_GT(whole->report().exactShare, 0.0);
    for (const std::size_t threads : {1, 3}) {
      const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
      const auto pieces = session(s);
      while (!pieces->goalReached()) {
        int left = 3;
        pieces->run([&] { return left-- > 0; });
      }
      EXPECT_EQ(whole->picture().values, pieces->picture().values) << threads;
    }
  }
}

/// A first picture waits for nothing that it can't use.
TEST(DialSession, OneSampleIsTheGuess) {
  for (const Denoise denoise : {Denoise::kFilter, Denoise::kOff}) {
    RenderSettings dialled = settings(1), guess = settings(1);
    dialled.denoise = guess.denoise = denoise;
    guess.dial = false;
    guess.exact = 0.0;
    const auto a = session(dialled), b = session(guess);
    a->run();
    b->run();
    EXPECT_EQ(a->picture().values, b->picture().values);
    EXPECT_EQ(a->report().rays.cRays, b->report().rays.cRays);
    EXPECT_EQ(a->report().exactShare, 0.0);
  }
}

TEST(DialSession, GoesOnFromACheckpointWithTheSameBits) {
  const auto path =
      std::filesystem::temp_directory_path() / ("trex-dial-" + std::to_string(getpid()));
  const auto whole = session(settings(14));
  whole->run();
  for (const int tiles : {3, 8, 11, 26, 36}) {  // before, at and after looks
    const auto first = session(settings(14));
    int left = tiles;
    first->run([&] { return left-- > 0; });
    first->saveCheckpoint(path, 5, 0);
    const auto second = session(settings(14));
    CheckpointReader reader(path);
    second->restoreCheckpoint(reader);
    second->run();
    EXPECT_EQ(whole->picture().values, second->picture().values) << tiles;
    EXPECT_EQ(whole->report().exactShare, second->report().exactShare);
  }
  std::filesystem::remove(path);
}

TEST(DialSession, TheLayerSaysWhichSamplesWereExact) {
  const auto r = session(settings(12));
  r->run();
  const Picture p = r->picture();
  const auto at = std::find(p.channels.begin(), p.channels.end(), "exactShare");
  ASSERT_NE(at, p.channels.end());
  double sum = 0.0;
  for (std::size_t i = 0; i < kWidth * kHeight; ++i) {
    const float share =
        p.values[i * p.channels.size() + static_cast<std::size_t>(at - p.channels.begin())];
    EXPECT_GE(share, 0.0f);
    EXPECT_LE(share, 1.0f);
    sum += static_cast<double>(share);
  }
  EXPECT_NEAR(sum / (kWidth * kHeight), r->report().exactShare, 1e-6);
}

TEST(DialSession, ExtremesEnd) {
  RenderSettings small = settings(40);
  small.width = small.height = 1;
  const auto dark = roomModel(0.0f);  // nothing shines: all samples are exact
  for (const auto& [s, model] : {std::pair{small, room()}, {settings(5), dark}, {small, dark}}) {
    const auto r = session(s, model);
    r->run();
    EXPECT_EQ(r->samplesDone(), s.samples);
    for (const float v : r->picture().values) EXPECT_TRUE(std::isfinite(v));
    EXPECT_EQ(r->report().exactShare == 1.0, model == dark);
  }
}

/// A picture of many exact samples, unfiltered.
Picture exactPicture(std::uint32_t seed) {
  RenderSettings exact = settings(750);
  exact.dial = false;
  exact.exact = 1.0;
  exact.seed = seed;
  exact.denoise = Denoise::kOff;
  const auto fine = session(exact);
  fine->run();
  return fine->picture();
}

/// relMSE of a picture, by two of many exact samples: the product of its distances from both is the
/// square of that from the truth, whatever noise these have, as it is not the same.
double trueError(const Picture& shown, const Picture& one, const Picture& other) {
  constexpr std::size_t kPixels = std::size_t{kWidth} * kHeight;
  const auto at = [](const Picture& p, std::size_t i) {
    return static_cast<double>(p.values[i / 3 * p.channels.size() + i % 3]);
  };
  double mean = 0.0, error = 0.0;
  for (std::size_t i = 0; i < 3 * kPixels; ++i) mean += at(one, i) + at(other, i);
  mean /= 6.0 * kPixels;
  for (std::size_t i = 0; i < 3 * kPixels; ++i) {
    const double a = at(shown, i), b = at(one, i), c = at(other, i), middle = 0.5 * (b + c);
    error += (a - b) * (a - c) / (middle * middle + 0.01 * mean * mean);
  }
  return error / (3.0 * kPixels);
}

/// The estimate is the distance to the truth, as far as it goes.
TEST(DialSession, TheErrorItTellsIsTheError) {
  const Picture one = exactPicture(1001), other = exactPicture(1002);
  for (const std::uint32_t samples : {16u, 64u}) {
    std::vector<double> ratios;
    for (std::uint32_t seed = 0; seed < 5; ++seed) {
      RenderSettings s = settings(samples);
      s.seed = seed;
      const auto rough = session(s);
      rough->run();
      ratios.push_back(rough->estimatedError() / trueError(rough->picture(), one, other));
    }
    std::sort(ratios.begin(), ratios.end());
    EXPECT_GT(ratios[2], 0.5) << samples;
    EXPECT_LT(ratios[2], 2.0) << samples;
    EXPECT_GT(ratios.front(), 0.4) << samples;
    EXPECT_LT(ratios.back(), 2.5) << samples;
  }
}

TEST(DialSession, StopsAtTheErrorAskedFor) {
  RenderSettings s = settings(0);
  s.error = 0.003;
  const auto r = session(s);
  r->run();
  EXPECT_LE(r->estimatedError(), 0.003);
  EXPECT_GE(r->samplesDone(), 16u);
}

}  // namespace
}  // namespace trex
