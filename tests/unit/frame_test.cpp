#include <OpenImageIO/imageio.h>
#include <gtest/gtest.h>
#include <tbb/parallel_for.h>
#include <unistd.h>

#include <cmath>
#include <filesystem>
#include <fstream>

#include "src/core/error.h"
#include "src/frame/accumulator.h"
#include "src/frame/image_file.h"
#include "src/frame/picture_reader.h"
#include "src/frame/png.h"
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

/// Rec. 709 and D65, for whoever reads the file.
TEST_F(ImageFileTest, ExrSaysWhatItsColoursAre) {
  const fs::path path = folder_ / "a.exr";
  writePicture(path, picture_, ToneMap{});
  auto in = OIIO::ImageInput::open(path.string());
  ASSERT_TRUE(in);
  const OIIO::ParamValue* found = in->spec().find_attribute("chromaticities");
  ASSERT_NE(found, nullptr);
  const float expected[8] = {0.64f, 0.33f, 0.3f, 0.6f, 0.15f, 0.06f, 0.3127f, 0.329f};
  for (int i = 0; i < 8; ++i) EXPECT_EQ(static_cast<const float*>(found->data())[i], expected[i]);
}

/// Premultiplied in an .exr, straight in a .png, whatever its depth; refused by a .jpg.
TEST_F(ImageFileTest, AlphaIsStraightInAPngOfEitherDepth) {
  Picture p{3,
            1,
            {"R", "G", "B", "A"},
            {0.5f, 0.25f, 0.0f, 0.5f,  //
             0.0f, 0.0f, 0.0f, 0.0f,   //
             0.2f, 0.2f, 0.2f, 1.0f},
            {},
            true};
  for (const int bits : {8, 16}) {
    writePicture(folder_ / "a.png", p, ToneMap{}, {.bits = bits});
    OIIO::ImageSpec config;
    config["oiio:UnassociatedAlpha"] = 1;
    auto in = OIIO::ImageInput::open((folder_ / "a.png").string(), &config);
    ASSERT_TRUE(in);
    EXPECT_EQ(in->spec().format, bits == 8 ? OIIO::TypeDesc::UINT8 : OIIO::TypeDesc::UINT16);
    EXPECT_EQ(in->spec().get_string_attribute("oiio:ColorSpace"), "sRGB");
    ASSERT_EQ(in->spec().nchannels, 4);
    float v[12];
    ASSERT_TRUE(in->read_image(0, 0, 0, 4, OIIO::TypeDesc::FLOAT, v));
    const float step = bits == 8 ? 0.5f / 255.0f : 0.5f / 65535.0f;
    const float expected[12] = {1.0f,
                                encodeSrgb(0.5f),
                                0.0f,
                                0.5f,
                                0,
                                0,
                                0,
                                0,
                                encodeSrgb(0.2f),
                                encodeSrgb(0.2f),
                                encodeSrgb(0.2f),
                                1.0f};
    for (int i = 0; i < 12; ++i) EXPECT_NEAR(v[i], expected[i], 1.01f * step) << bits << ' ' << i;
  }
  EXPECT_THROW(writePicture(folder_ / "a.jpg", p, ToneMap{}), Error);
  p.premultiplied = false;  // then A is a layer beside the picture
  writePicture(folder_ / "a.png", p, ToneMap{});
  auto in = OIIO::ImageInput::open((folder_ / "a.png").string());
  ASSERT_TRUE(in);
  EXPECT_EQ(in->spec().nchannels, 3);
}

/// Smooth parts and noise, so that rows are coded in all ways: every value comes back.
template <typename Value>
void checkPng(const fs::path& path, bool alpha, OIIO::TypeDesc type) {
  constexpr std::uint32_t kWidth = 61, kHeight = 47;
  const std::uint32_t channels = alpha ? 4 : 3;
  std::vector<Value> values;
  for (std::uint32_t i = 0; i < kWidth * kHeight * channels; ++i) {
    const std::uint32_t x = i / channels % kWidth, y = i / channels / kWidth;
    const std::uint32_t noise = y / 8 % 2 == 0 ? 0 : i * 2654435761u >> 16;
    values.push_back(static_cast<Value>(y < 16 ? x * 3 + y : y * y + 700 * x + noise));
  }
  const std::vector<std::uint8_t> file = encodePng(kWidth, kHeight, alpha, values);
  std::ofstream(path, std::ios::binary)
      .write(reinterpret_cast<const char*>(file.data()), static_cast<std::streamsize>(file.size()));
  OIIO::ImageSpec config;
  config["oiio:UnassociatedAlpha"] = 1;
  const auto in = OIIO::ImageInput::open(path.string(), &config);
  ASSERT_TRUE(in);
  EXPECT_EQ(in->spec().format, type);
  ASSERT_EQ(in->spec().nchannels, static_cast<int>(channels));
  ASSERT_EQ(in->spec().width, static_cast<int>(kWidth));
  std::vector<Value> read(values.size());
  ASSERT_TRUE(in->read_image(0, 0, 0, static_cast<int>(channels), type, read.data()));
  EXPECT_EQ(read, values);
}

TEST_F(ImageFileTest, PngKeepsEveryValue) {
  for (const bool alpha : {false, true}) {
    checkPng<std::uint8_t>(folder_ / "a.png", alpha, OIIO::TypeDesc::UINT8);
    checkPng<std::uint16_t>(folder_ / "a.png", alpha, OIIO::TypeDesc::UINT16);
  }
}

TEST_F(ImageFileTest, JpegHasItsQuality) {
  Picture p{64, 64, {"R", "G", "B"}, {}, {}};
  for (std::uint32_t i = 0; i < 64 * 64; ++i) {
    const float x = static_cast<float>(i % 64) / 64.0f;
    p.values.insert(p.values.end(), {x * x, 0.3f + 0.2f * std::sin(9.0f * x), 0.1f});
  }
  writePicture(folder_ / "fine.jpeg", p, ToneMap{}, {.quality = 95});
  writePicture(folder_ / "coarse.JPG", p, ToneMap{}, {.quality = 20});
  EXPECT_GT(fs::file_size(folder_ / "fine.jpeg"), fs::file_size(folder_ / "coarse.JPG") * 6 / 5);
  const Picture read = readPicture(folder_ / "fine.jpeg");
  for (std::size_t i = 0; i < p.values.size(); ++i) {
    EXPECT_NEAR(encodeSrgb(read.values[i]), encodeSrgb(p.values[i]), 0.02f) << i;
  }
}

/// What is premultiplied is exposed by what it shows.
TEST_F(ImageFileTest, AutoExposureLeavesOutWhatIsNotThere) {
  Picture p{4, 1, {"R", "G", "B", "A"}, {}, {}, true};
  for (const float a : {0.0f, 0.25f, 0.5f, 1.0f}) {
    p.values.insert(p.values.end(), {2.0f * a, 2.0f * a, 2.0f * a, a});
  }
  EXPECT_NEAR(autoExposure(p), -2.0f, 1e-5f);
}

TEST(ToneMap, NeutralIsThatOfItsSpecification) {
  const ToneMap neutral{0.0f, ToneOperator::kNeutral};
  // A grey of 0.5 loses the reflection of 4 %; below 0.08 it is 6.25 x^2.
  EXPECT_NEAR(toScreen(vec3(0.5f), ToneOperator::kNeutral).x, 0.46f, 1e-6f);
  EXPECT_NEAR(toScreen(vec3(0.04f), ToneOperator::kNeutral).x, 0.01f, 1e-6f);
  EXPECT_NEAR(toScreen(vec3(0.8f), ToneOperator::kNeutral).x, 0.76f, 1e-6f);
  // Above: 1 - 0.24^2 / (x - 0.04 - 0.52).
  EXPECT_NEAR(toScreen(vec3(2.0f), ToneOperator::kNeutral).x, 1.0f - 0.0576f / 1.44f, 1e-5f);
  // A bright orange keeps the order of its channels and its hue, and ends in white.
  const vec3 orange(3.0f, 1.5f, 0.5f), shown = toScreen(orange, ToneOperator::kNeutral);
  EXPECT_LT(shown.x, 1.0f);
  EXPECT_GT(shown.x, shown.y);
  EXPECT_GT(shown.y, shown.z);
  EXPECT_NEAR((shown.x - shown.y) / (shown.x - shown.z), 1.5f / 2.5f, 1e-4f);
  EXPECT_GT(toScreen(orange * 1e4f, ToneOperator::kNeutral).z, 0.99f);
  EXPECT_EQ(neutral.apply(vec3(0.0f)), vec3(0.0f));
}

TEST(ToneMap, AgxPutsMiddleGreyInTheMiddle) {
  const ToneMap agx{0.0f, ToneOperator::kAgx};
  // Its pivot: 0.18 is shown as 0.5 of a display with the power 2.2.
  EXPECT_NEAR(std::pow(toScreen(vec3(0.18f), ToneOperator::kAgx).y, 1.0f / 2.2f), 0.5f, 0.01f);
  EXPECT_LT(agx.apply(vec3(0.0f)).x, 0.01f);
  EXPECT_GT(agx.apply(vec3(1e4f)).x, 0.99f);
  const vec3 blue = agx.apply(vec3(0.2f, 0.2f, 20.0f));
  EXPECT_GT(blue.x, 0.3f);  // fades towards white
  EXPECT_GT(blue.z, blue.x);
}

/// Every operator is defined everywhere, grows with the light, and keeps greys grey.
TEST(ToneMap, EveryOperatorSurvivesNonsense) {
  for (const ToneOperator op : {ToneOperator::kCut, ToneOperator::kNeutral, ToneOperator::kAgx}) {
    const float bad[] = {std::nanf(""), -1.0f, kInfinity, -kInfinity, 1e38f, 1e-38f, 0.0f};
    for (const float x : bad) {
      for (const float y : bad) {
        const vec3 shown = toScreen(vec3(x, y, 0.5f), op);
        for (int c = 0; c < 3; ++c) EXPECT_TRUE(shown[c] >= 0.0f && shown[c] <= 1.0f);
      }
    }
    float before = -1.0f;
    for (float x = 1e-3f; x < 100.0f; x *= 1.1f) {
      const vec3 grey = toScreen(vec3(x), op);
      EXPECT_GE(grey.x, before) << x;
      EXPECT_NEAR(grey.x, grey.z, 2e-3f) << x;
      before = grey.x;
    }
  }
  EXPECT_EQ(toneOperatorNames().size(), 3u);
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
