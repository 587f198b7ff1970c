#include <OpenImageIO/imageio.h>
#include <gtest/gtest.h>
#include <tbb/parallel_for.h>
#include <unistd.h>

#include <cmath>
#include <filesystem>

#include "src/core/error.h"
#include "src/frame/accumulator.h"
#include "src/frame/image_file.h"
#include "src/frame/tiles.h"

namespace trex {
namespace {
namespace fs = std::filesystem;

TEST(Accumulator, DropsCountsAndReportsNonFiniteSamples) {
  Accumulator frame(2, 2, true);
  const vec3 bad(1.0f, std::nanf(""), 0.0f), good(1.0f, 2.0f, 3.0f);
  frame.add(1, 0, 7, bad, nullptr);
  frame.add(1, 0, 8, good, &bad);
  frame.add(1, 0, 9, vec3(kInfinity), nullptr);
  frame.add(1, 0, 10, good, &good);
  EXPECT_EQ(frame.nonFiniteCount(), 3u);
  ASSERT_EQ(frame.nonFiniteSamples().size(), 3u);
  EXPECT_EQ(frame.nonFiniteSamples()[0].x, 1u);
  EXPECT_EQ(frame.nonFiniteSamples()[0].sample, 7u);
  EXPECT_EQ(frame.samples(1, 0), 1u);
  EXPECT_EQ(frame.mean(1, 0), dvec3(1, 2, 3));
}

TEST(Accumulator, PixelsAreIndependentAndThreadSafe) {
  Accumulator frame(64, 64, false);
  tbb::parallel_for(0u, 64u, [&](std::uint32_t y) {
    for (std::uint32_t x = 0; x < 64; ++x) {
      for (std::uint32_t s = 0; s < 8; ++s) {
        frame.add(x, y, s, vec3(static_cast<float>(x), static_cast<float>(y), 1.0f), nullptr);
      }
    }
  });
  for (std::uint32_t y = 0; y < 64; ++y) {
    for (std::uint32_t x = 0; x < 64; ++x) EXPECT_EQ(frame.mean(x, y), dvec3(x, y, 1));
  }
}

TEST(Tiles, CoverEveryPixelOnce) {
  for (auto [w, h] : {std::pair{1u, 1u}, {64u, 64u}, {65u, 3u}, {640u, 360u}, {1000u, 1u}}) {
    std::vector<int> covered(std::size_t{w} * h, 0);
    for (const Tile& t : makeTiles(w, h, 64)) {
      for (std::uint32_t y = t.y; y < t.y + t.height; ++y) {
        for (std::uint32_t x = t.x; x < t.x + t.width; ++x) ++covered.at(std::size_t{y} * w + x);
      }
    }
    for (int c : covered) ASSERT_EQ(c, 1);
  }
}

TEST(Tiles, StartAtTheCentre) {
  const Tile first = makeTiles(640, 640, 64).front();
  EXPECT_LE(std::abs(first.x + 32.0 - 320.0), 32.0);
  EXPECT_LE(std::abs(first.y + 32.0 - 320.0), 32.0);
}

class ImageFileTest : public ::testing::Test {
 protected:
  void SetUp() override {
    folder_ = fs::temp_directory_path() / ("trex-image-" + std::to_string(::getpid()));
    fs::create_directories(folder_);
    picture_.width = 3;
    picture_.height = 2;
    picture_.channels = {"R", "G", "B", "sampleCount"};
    for (int i = 0; i < 6 * 4; ++i) picture_.values.push_back(static_cast<float>(i) * 0.37e3f);
    picture_.metadata = {{"trex:seed", "42"}};
  }
  void TearDown() override { fs::remove_all(folder_); }
  fs::path folder_;
  Picture picture_;
};

TEST_F(ImageFileTest, ExrKeepsEveryBitAndTheMetadata) {
  const fs::path path = folder_ / "a.exr";
  writePicture(path, picture_, ToneMap{});
  auto in = OIIO::ImageInput::open(path.string());
  ASSERT_TRUE(in);
  ASSERT_EQ(in->spec().nchannels, 4);
  EXPECT_EQ(in->spec().get_string_attribute("trex:seed"), "42");
  std::vector<float> values(picture_.values.size());
  ASSERT_TRUE(in->read_image(0, 0, 0, 4, OIIO::TypeDesc::FLOAT, values.data()));
  // OpenImageIO may reorder: compare by name.
  for (int c = 0; c < 4; ++c) {
    const auto& name = in->spec().channelnames[static_cast<std::size_t>(c)];
    const auto at = std::find(picture_.channels.begin(), picture_.channels.end(), name);
    ASSERT_NE(at, picture_.channels.end()) << name;
    const auto source = static_cast<std::size_t>(at - picture_.channels.begin());
    for (std::size_t i = 0; i < 6; ++i) {
      EXPECT_EQ(values[i * 4 + static_cast<std::size_t>(c)], picture_.values[i * 4 + source]);
    }
  }
}

TEST_F(ImageFileTest, PngIsWrittenAndBadNamesAreRefused) {
  writePicture(folder_ / "a.png", picture_, ToneMap{});
  EXPECT_GT(fs::file_size(folder_ / "a.png"), 50u);
  EXPECT_THROW(writePicture(folder_ / "a.bmp", picture_, ToneMap{}), Error);
  EXPECT_THROW(writePicture(folder_ / "no" / "a.png", picture_, ToneMap{}), Error);
  EXPECT_EQ(std::distance(fs::directory_iterator(folder_), fs::directory_iterator{}), 1);
}

TEST(ToneMap, IsSrgbAndSurvivesNonsense) {
  EXPECT_NEAR(ToneMap{}.apply(vec3(0.18f)).x, 0.4614f, 1e-3f);
  EXPECT_NEAR(ToneMap{}.apply(vec3(5.0f)).y, 1.0f, 1e-6f);
  const vec3 nonsense = ToneMap{}.apply(vec3(std::nanf(""), -1.0f, kInfinity));
  EXPECT_EQ(nonsense.x, 0.0f);
  EXPECT_EQ(nonsense.y, 0.0f);
  EXPECT_NEAR(nonsense.z, 1.0f, 1e-6f);
  EXPECT_NEAR(ToneMap{1.0f}.apply(vec3(0.09f)).x, 0.4614f, 1e-3f);
}

TEST_F(ImageFileTest, AutoExposureBringsThe70thPercentileToHalf) {
  Picture p;
  p.width = 10;
  p.height = 1;
  p.channels = {"R", "G", "B"};
  for (int i = 0; i < 10; ++i) p.values.insert(p.values.end(), 3, static_cast<float>(i + 1));
  EXPECT_NEAR(autoExposure(p), std::log2(0.5f / 7.0f), 1e-5f);
  p.values.assign(30, 0.0f);
  EXPECT_EQ(autoExposure(p), 0.0f);
}

}  // namespace
}  // namespace trex
