#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "src/core/error.h"
#include "src/frame/accumulator.h"
#include "src/frame/picture_merge.h"

namespace trex {
namespace {

constexpr std::uint32_t kWidth = 3, kHeight = 2;

const std::vector<std::string> kChannels{
    "R", "G", "B", "variance.R", "variance.G", "variance.B", "sampleCount", "depth", "objectId"};

/// What a session would write of these samples; depth is the number of samples.
Picture pictureOf(const Accumulator& frame, const std::string& seed, float objectId) {
  Picture out{kWidth, kHeight, kChannels, {}, {}};
  std::uint64_t samples = 0;
  for (std::uint32_t y = 0; y < kHeight; ++y) {
    for (std::uint32_t x = 0; x < kWidth; ++x) {
      const dvec3 mean = frame.mean(x, y), variance = frame.varianceOfMean(x, y);
      for (const dvec3& v : {mean, variance}) {
        for (int c = 0; c < 3; ++c) out.values.push_back(static_cast<float>(v[c]));
      }
      const auto count = static_cast<float>(frame.samples(x, y));
      out.values.insert(out.values.end(), {count, count, objectId});
      samples = std::max(samples, frame.samples(x, y));
    }
  }
  out.metadata = {{"trex:scene", "room.glb"},
                  {"trex:seed", seed},
                  {"trex:samples", std::to_string(samples)},
                  {"trex:nonFiniteSamples", "1"}};
  return out;
}

class PictureMerge : public ::testing::Test {
 protected:
  PictureMerge() : whole_(kWidth, kHeight, false) {
    std::mt19937 random(1);
    std::lognormal_distribution<float> value(0.0f, 1.0f);
    int seed = 0;
    for (std::uint32_t count : {5u, 1u, 16u}) {
      Accumulator part(kWidth, kHeight, false);
      for (std::uint32_t s = 0; s < count; ++s) {
        for (std::uint32_t i = 0; i < kWidth * kHeight; ++i) {
          const vec3 sample(value(random), value(random), value(random) * 1e3f);
          part.add(i % kWidth, i / kWidth, s, sample, nullptr);
          whole_.add(i % kWidth, i / kWidth, s, sample, nullptr);
        }
      }
      parts_.push_back(pictureOf(part, std::to_string(seed), static_cast<float>(seed)));
      ++seed;
    }
  }
  /// The message of the refusal to merge `b` to the first part.
  std::string refusal(const Picture& b) {
    PictureMerger merger;
    merger.add(parts_[0], "a.exr");
    try {
      merger.add(b, "b.exr");
    } catch (const Error& e) {
      EXPECT_EQ(e.code(), ExitCode::kInput);
      return e.what();
    }
    return "";
  }
  static std::string* metadata(Picture& picture, const std::string& key) {
    for (auto& [name, value] : picture.metadata) {
      if (name == key) return &value;
    }
    return nullptr;
  }

  Accumulator whole_;
  std::vector<Picture> parts_;
};

TEST_F(PictureMerge, EqualsOneRenderOfAllSamples) {
  PictureMerger merger;
  for (const Picture& part : parts_) merger.add(part, "part");
  const Picture merged = merger.result(), want = pictureOf(whole_, "0,1,2", 0.0f);
  ASSERT_EQ(merged.channels, want.channels);
  for (std::size_t i = 0; i < want.values.size(); ++i) {
    if (kChannels[i % kChannels.size()] == "depth") continue;
    EXPECT_NEAR(merged.values[i], want.values[i], 1e-5 * std::abs(want.values[i]))
        << kChannels[i % kChannels.size()];
  }
}

TEST_F(PictureMerge, WeighsOtherLayersBySamples) {
  PictureMerger merger;
  for (const Picture& part : parts_) merger.add(part, "part");
  // The depth of each part is its number of samples.
  EXPECT_NEAR(merger.result().values[7], (5.0 * 5.0 + 1.0 + 16.0 * 16.0) / 22.0, 1e-5);
}

TEST_F(PictureMerge, OrderOfPartsAndGroupsDoesNotMatter) {
  PictureMerger pair, nested, flat;
  pair.add(parts_[2], "c");
  pair.add(parts_[1], "b");
  nested.add(pair.result(), "cb");
  nested.add(parts_[0], "a");
  for (const Picture& part : parts_) flat.add(part, "part");
  Picture a = nested.result(), b = flat.result();
  for (std::size_t i = 0; i < a.values.size(); ++i) {
    if (kChannels[i % kChannels.size()] == "objectId") continue;
    EXPECT_NEAR(a.values[i], b.values[i], 1e-5 * std::abs(b.values[i]));
  }
  EXPECT_EQ(*metadata(a, "trex:seed"), "2,1,0");
  EXPECT_EQ(*metadata(a, "trex:samples"), "22");
  EXPECT_EQ(*metadata(a, "trex:nonFiniteSamples"), "3");
  EXPECT_EQ(*metadata(a, "trex:scene"), "room.glb");
}

TEST_F(PictureMerge, PixelsWithoutSamplesTakeNoPart) {
  for (std::size_t c = 0; c < 8; ++c) parts_[1].values[c] = c == 6 ? 0.0f : 1e6f;
  PictureMerger merger;
  merger.add(parts_[0], "a");
  merger.add(parts_[1], "b");
  const Picture merged = merger.result();
  EXPECT_EQ(merged.values[0], parts_[0].values[0]);
  EXPECT_EQ(merged.values[6], 5.0f);
}

TEST_F(PictureMerge, RefusesWhatDoesNotFit) {
  Picture other = parts_[1];
  other.width = 2;
  other.height = 3;
  EXPECT_NE(refusal(other).find("2x3"), std::string::npos);
  other = parts_[1];
  *metadata(other, "trex:seed") = "7,0";
  EXPECT_NE(refusal(other).find("seed 0"), std::string::npos);
  other = parts_[1];
  metadata(other, "trex:seed")->clear();
  EXPECT_NE(refusal(other).find("trex:seed"), std::string::npos);
  for (const char* key : {"trex:scene", "trex:camera", "trex:exact", "trex:maxBounces"}) {
    other = parts_[1];
    std::erase_if(other.metadata, [&](const auto& entry) { return entry.first == key; });
    other.metadata.emplace_back(key, "other");
    EXPECT_NE(refusal(other).find(key), std::string::npos);
  }
  other = parts_[1];
  other.metadata.emplace_back("trex:denoised", "yes");
  EXPECT_NE(refusal(other).find("--denoise off"), std::string::npos);
}

TEST_F(PictureMerge, RefusesMissingLayersAndBadValues) {
  for (std::size_t c = 0; c < kChannels.size(); ++c) {
    Picture other = parts_[1];
    other.channels[c] = "other";
    EXPECT_NE(refusal(other).find(kChannels[c]), std::string::npos) << kChannels[c];
  }
  for (float bad : {std::nanf(""), kInfinity}) {
    Picture other = parts_[1];
    other.values[9 + 7] = bad;
    EXPECT_NE(refusal(other).find("depth of pixel 1,0"), std::string::npos);
  }
  for (float bad : {-1.0f, 1.5f}) {
    Picture other = parts_[1];
    other.values[6] = bad;
    EXPECT_NE(refusal(other).find("no count"), std::string::npos);
  }
}

}  // namespace
}  // namespace trex
