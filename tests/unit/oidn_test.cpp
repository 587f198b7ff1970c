// Open Image Denoise: what is said of libraries that can't be used, by one that pretends; and,
// where the real one is there (scripts/oidn), what it does.
#include "src/frame/oidn.h"

#include <gtest/gtest.h>
#include <tbb/global_control.h>
#include <unistd.h>

#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <limits>
#include <random>

#include "src/core/error.h"

namespace trex {
namespace {

namespace fs = std::filesystem;

/// Sets a variable of the environment for a while.
class Setting {
 public:
  Setting(const char* name, const char* value) : name_(name) {
    if (const char* old = std::getenv(name)) before_ = old;
    had_ = std::getenv(name) != nullptr;
    value != nullptr ? setenv(name, value, 1) : unsetenv(name);
  }
  ~Setting() { had_ ? setenv(name_, before_.c_str(), 1) : unsetenv(name_); }

 private:
  const char* name_;
  std::string before_;
  bool had_ = false;
};

std::string refusal(const std::string& file) {
  try {
    const Oidn library(file);
  } catch (const Error& e) {
    EXPECT_EQ(e.code(), ExitCode::kMemoryOrDevice);
    return e.what();
  }
  return "";
}

TEST(Oidn, SaysWhatIsWrongWithALibrary) {
  const auto says = [](const char* mode, const std::string& file) {
    const Setting fake("FAKE_OIDN", mode);
    return refusal(file);
  };
  EXPECT_EQ(says(nullptr, TREX_FAKE_OIDN), "");
  EXPECT_NE(says("version3", TREX_FAKE_OIDN).find("version 3.9.0"), std::string::npos);
  EXPECT_NE(says("sick", TREX_FAKE_OIDN).find("not well"), std::string::npos);
  EXPECT_NE(says(nullptr, TREX_FAKE_OIDN_OLD).find("oidnGetNumPhysicalDevices"), std::string::npos);
  EXPECT_NE(says(nullptr, __FILE__).find("can't be opened"), std::string::npos);
  EXPECT_NE(says(nullptr, "/nowhere/at.all").find("/nowhere/at.all"), std::string::npos);
  for (const char* mode : {"version3", "sick"}) {
    EXPECT_NE(says(mode, TREX_FAKE_OIDN).find("scripts/oidn"), std::string::npos);
  }
}

TEST(Oidn, TakesTheCpuWhereTheGpuFails) {
  const Setting fake("FAKE_OIDN", "gpu");
  const Oidn library(TREX_FAKE_OIDN);
  EXPECT_EQ(library.device(), "CPU, pretended");
  EXPECT_EQ(library.version(), "2.9.0");
}

TEST(Oidn, FailuresOfARunAreErrors) {
  const Setting fake("FAKE_OIDN", "tired");
  const Oidn library(TREX_FAKE_OIDN);
  const std::vector<vec3> grey(128 * 128, vec3(0.5f));
  try {
    library.denoise({128, 128}, grey, OidnQuality::kHigh);
    ADD_FAILURE();
  } catch (const Error& e) {
    EXPECT_EQ(e.code(), ExitCode::kMemoryOrDevice);
    EXPECT_NE(std::string(e.what()).find("out of pretended memory"), std::string::npos);
  }
}

TEST(Oidn, GoesOnAfterAFailure) {
  const std::vector<vec3> grey(128 * 128, vec3(0.5f)), white(32 * 64, vec3(1.0f));
  const Setting well("FAKE_OIDN", nullptr);
  const Oidn library(TREX_FAKE_OIDN);
  library.prepare(128, 128, true, OidnQuality::kHigh);
  for (int i = 0; i < 2; ++i) {
    EXPECT_EQ(library.denoise({128, 128}, grey, OidnQuality::kHigh), grey);
    EXPECT_EQ(library.denoise({32, 64}, white, OidnQuality::kHigh), white);
    const Setting tired("FAKE_OIDN", "tired");
    EXPECT_THROW(library.denoise({128, 128}, grey, OidnQuality::kHigh), Error);
  }
}

TEST(Oidn, WhatComesOutIsFinite) {
  const Setting fake("FAKE_OIDN", "nan");
  const Oidn library(TREX_FAKE_OIDN);
  for (const vec3& v :
       library.denoise({8, 8}, std::vector<vec3>(64, vec3(2.0f)), OidnQuality::kFast))
    for (int c = 0; c < 3; ++c) EXPECT_TRUE(v[c] == 0.0f || v[c] == 2.0f);
}

TEST(Oidn, IsLookedForWhereTheManualSays) {
  const fs::path folder = fs::temp_directory_path() / ("trex-oidn-" + std::to_string(getpid()));
  const fs::path brought = folder / "trex/oidn/lib/libOpenImageDenoise.so.2";
  const Setting data("XDG_DATA_HOME", folder.c_str());
  const std::vector<std::string> systems{"libOpenImageDenoise.so.2"};
  {
    const Setting unset("TREX_OIDN", nullptr);
    EXPECT_EQ(oidnPlaces(), systems);
    fs::create_directories(brought.parent_path());
    std::ofstream(brought) << "no library";
    EXPECT_EQ(oidnPlaces(), (std::vector<std::string>{brought.string(), systems[0]}));
    const OidnSearch search = searchOidn(oidnPlaces());
    EXPECT_TRUE(search.broken && !search.library);
    EXPECT_NE(search.problem.find(brought.string()), std::string::npos);
    const Setting relative("XDG_DATA_HOME", "here"), home("HOME", folder.c_str());
    EXPECT_EQ(oidnPlaces(), systems);
  }
  {
    const Setting named("TREX_OIDN", TREX_FAKE_OIDN);
    EXPECT_EQ(oidnPlaces(), std::vector<std::string>{TREX_FAKE_OIDN});
    EXPECT_EQ(searchOidn(oidnPlaces()).library->file(), TREX_FAKE_OIDN);
  }
  const Setting none("TREX_OIDN", "none");
  EXPECT_TRUE(oidnPlaces().empty());
  const OidnSearch search = searchOidn({});
  EXPECT_TRUE(!search.library && !search.broken);
  fs::remove_all(folder);
}

// ---- the real one ----

class RealOidn : public testing::Test {
 protected:
  void SetUp() override {
    if (!findOidn().library) GTEST_SKIP() << findOidn().problem;
  }
  static const Oidn& library() { return *findOidn().library; }
};

constexpr std::uint32_t kWidth = 96, kHeight = 64;

/// A grey and a striped wall that meet in the middle, and light on them.
struct Walls {
  OidnGuides guides{kWidth, kHeight};
  std::vector<vec3> truth;
  Walls() {
    for (std::uint32_t i = 0; i < kWidth * kHeight; ++i) {
      const std::uint32_t x = i % kWidth;
      const bool left = x < kWidth / 2;
      const float albedo = left ? 0.5f : (x / 6) % 2 ? 0.8f : 0.2f;
      guides.albedo.emplace_back(albedo);
      guides.normal.push_back(left ? vec3(1, 0, 0) : vec3(0, 0, 1));
      truth.emplace_back(albedo * (left ? 1.0f : 3.0f));
    }
  }
  /// The light with the noise of a sample or so.
  std::vector<vec3> noisy(unsigned seed) const {
    std::mt19937 random(seed);
    std::exponential_distribution<float> factor(1.0f);
    std::vector<vec3> out;
    for (const vec3& v : truth) out.push_back(v * factor(random));
    return out;
  }
};

double meanOf(const std::vector<vec3>& light) {
  double sum = 0.0;
  for (const vec3& v : light) sum += static_cast<double>(v.x + v.y + v.z);
  return sum / static_cast<double>(3 * light.size());
}

double meanSquare(const std::vector<vec3>& a, const std::vector<vec3>& b) {
  double sum = 0.0;
  for (std::size_t i = 0; i < a.size(); ++i)
    sum += static_cast<double>(glm::dot(a[i] - b[i], a[i] - b[i]));
  return sum / static_cast<double>(a.size());
}

TEST_F(RealOidn, TakesNoiseAndKeepsEdgesTexturesAndTheMean) {
  const Walls walls;
  const std::vector<vec3> noisy = walls.noisy(3);
  for (const bool thorough : {false, true}) {
    const auto out = denoiseLight(library(), walls.guides, {noisy}, thorough);
    EXPECT_LT(meanSquare(out, walls.truth), 0.05 * meanSquare(noisy, walls.truth));
    EXPECT_NEAR(meanOf(out) / meanOf(noisy), 1.0, 1e-5);
  }
}

/// More pictures than are kept ready, by turns, and with other guides: each as by itself.
TEST_F(RealOidn, PicturesBeforeChangeNothing) {
  struct Job {
    std::uint32_t width, height;
    bool albedo, smooth;
    OidnQuality quality;
  };
  constexpr OidnQuality kBalanced = OidnQuality::kBalanced, kHigh = OidnQuality::kHigh;
  const Job jobs[] = {{64, 48, true, false, kBalanced},  {64, 48, true, true, kHigh},
                      {48, 64, true, true, kHigh},       {64, 48, false, false, kHigh},
                      {64, 48, true, true, kBalanced},   {20, 20, true, false, kBalanced},
                      {400, 400, true, false, kBalanced}};
  const auto run = [](const Oidn& library, const Job& job) {
    const std::size_t count = std::size_t{job.width} * job.height;
    OidnGuides guides{job.width, job.height};
    std::mt19937 random(job.width);
    std::exponential_distribution<float> factor(1.0f);
    std::vector<vec3> light(count);
    for (vec3& v : light) v = vec3(factor(random), factor(random), 1.0f);
    if (job.albedo) guides.albedo.assign(count, vec3(0.5f));
    if (job.albedo) guides.normal.assign(count, vec3(0, 0, 1));
    guides.smooth = job.smooth;
    return library.denoise(guides, light, job.quality);
  };
  const Oidn many(library().file());
  prepareLight(many, 64, 48);
  for (int round = 0; round < 2; ++round) {
    for (const Job& job : jobs) EXPECT_EQ(run(many, job), run(Oidn(library().file()), job));
  }
}

TEST_F(RealOidn, PartsOfLightAddUp) {
  const Walls walls;
  const std::vector<vec3> a = walls.noisy(1), b = walls.noisy(2);
  const auto out = denoiseLight(library(), walls.guides, {a, b}, true);
  EXPECT_NEAR(meanOf(out), meanOf(a) + meanOf(b), 1e-5);
}

TEST_F(RealOidn, GuidesMayBeMissing) {
  const Walls walls;
  const std::vector<vec3> noisy = walls.noisy(5);
  for (const bool albedo : {false, true}) {
    OidnGuides guides = walls.guides;
    guides.normal.clear();
    if (!albedo) guides.albedo.clear();
    const auto out = denoiseLight(library(), guides, {noisy}, true);
    EXPECT_LT(meanSquare(out, walls.truth), 0.5 * meanSquare(noisy, walls.truth));
  }
}

TEST_F(RealOidn, ThreadsDoNotChangeABit) {
  const Walls walls;
  const std::vector<vec3> noisy = walls.noisy(7);
  const auto once = [&](std::size_t threads) {
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
    return denoiseLight(Oidn(library().file()), walls.guides, {noisy}, true);
  };
  EXPECT_EQ(once(1), once(3));
}

TEST_F(RealOidn, ExtremesStayFiniteAndAreNotNegative) {
  constexpr float kInf = std::numeric_limits<float>::infinity();
  const auto check = [&](std::uint32_t width, std::uint32_t height, std::vector<vec3> light) {
    const std::size_t count = std::size_t{width} * height;
    const OidnGuides guides{width, height, std::vector<vec3>(count, vec3(0.5f)),
                            std::vector<vec3>(count, vec3(0, 0, 1))};
    const auto out = denoiseLight(library(), guides, {light}, false);
    EXPECT_EQ(out.size(), count);
    for (const vec3& v : out) {
      for (int c = 0; c < 3; ++c) EXPECT_TRUE(std::isfinite(v[c]) && v[c] >= 0.0f) << v[c];
    }
    return meanOf(out);
  };
  EXPECT_EQ(check(32, 32, std::vector<vec3>(1024, vec3(0.0f))), 0.0);
  EXPECT_NEAR(check(1, 1, {vec3(0.25f)}), 0.25, 1e-5);
  for (const float v : {1e-30f, 1e-6f, 1.0f, 1e6f, 1e30f}) {
    std::vector<vec3> light(1024, vec3(v));
    check(32, 32, light);
    light[500] = vec3(1e30f);
    check(32, 32, light);
  }
  std::vector<vec3> bad(1024, vec3(1.0f));
  bad[3] = vec3(std::nanf(""), -kInf, kInf);
  bad[700] = vec3(-1.0f);
  EXPECT_NEAR(check(32, 32, bad), 1.0, 0.02);
  EXPECT_NEAR(check(16384, 3, std::vector<vec3>(16384 * 3, vec3(1.0f))), 1.0, 1e-4);
}

}  // namespace
}  // namespace trex
