// Light of a coarse frame on all of its pixels: edges and texture are those of every pixel.
#include "src/frame/lattice_light.h"

#include <gtest/gtest.h>

#include <cmath>

namespace trex {
namespace {

constexpr std::uint32_t kWidth = 37, kHeight = 22;

/// A floor and a wall that meet at x = 17.5, with a texture, and a thin post that no fourth pixel
/// shows; above them nothing.
Feature at(std::uint32_t x, std::uint32_t y) {
  if (y < 4) return {};
  Feature f;
  f.normal = x < 18 ? vec3(0, 1, 0) : vec3(1, 0, 0);
  if (x == 23) f.normal = vec3(0, 0, 1);
  f.position = vec3(std::min(x, 18u), x < 18 ? 0u : x - 18, y);
  f.albedo = vec3((x + y) % 2 == 0 ? 0.9f : 0.1f, 0.5f, 0.3f);
  f.footprint = 1.0f;
  return f;
}

/// Light without texture: a slope on the floor, another on the wall.
vec3 light(std::uint32_t x, std::uint32_t y) {
  if (y < 4) return vec3(0.0f);
  const auto u = static_cast<float>(x), v = static_cast<float>(y);
  return x < 18 ? vec3(1.0f + 0.01f * u, 1.0f, 2.0f) : vec3(5.0f + 0.02f * v, 6.0f, 7.0f);
}

TEST(LatticeLight, HasTheEdgesAndTheTextureOfEveryPixel) {
  for (const std::uint32_t step : {2u, 4u}) {
    FeatureImage all(kWidth, kHeight);
    for (std::uint32_t y = 0; y < kHeight; ++y) {
      for (std::uint32_t x = 0; x < kWidth; ++x) all.add(x, y, at(x, y));
    }
    FeatureImage lattice((kWidth + step - 1) / step, (kHeight + step - 1) / step);
    std::vector<vec3> lit;
    for (std::uint32_t y = 0; y < lattice.height(); ++y) {
      for (std::uint32_t x = 0; x < lattice.width(); ++x) {
        Feature f = at(x * step, y * step);
        f.footprint *= static_cast<float>(step);
        lattice.add(x, y, f);
        lit.push_back(light(x * step, y * step) * f.albedo);
      }
    }
    LatticeLight spread(lattice, lit, all, step);
    int pauses = 0;
    while (!spread.advance([&] { return ++pauses % 2 == 0; })) continue;
    const std::vector<vec3> got = spread.result();
    ASSERT_EQ(got.size(), std::size_t{kWidth} * kHeight);
    for (std::uint32_t y = 0; y < kHeight; ++y) {
      for (std::uint32_t x = 0; x < kWidth; ++x) {
        const vec3 is = got[std::size_t{y} * kWidth + x];
        if (x == 23 && y >= 4) {  // known by nothing alike: the light around it
          EXPECT_TRUE(is.x > 0.0f && isFinite(is));
          continue;
        }
        // Beyond the lattice's last row or column its light goes on as it is.
        const vec3 right = light(x, y) * at(x, y).albedo;
        for (int c = 0; c < 3; ++c) EXPECT_NEAR(is[c], right[c], 0.05f * right[c]) << x << ' ' << y;
      }
    }
    LatticeLight thin(lattice, lit, all, step, 2);
    EXPECT_TRUE(thin.advance([] { return true; }));
    const std::vector<vec3> second = thin.result();
    constexpr std::uint32_t kColumns = (kWidth + 1) / 2;
    ASSERT_EQ(second.size(), std::size_t{kColumns} * ((kHeight + 1) / 2));
    for (std::size_t i = 0; i < second.size(); ++i) {
      const std::size_t x = i % kColumns * 2, y = i / kColumns * 2;
      EXPECT_EQ(second[i], got[y * kWidth + x]);
    }
  }
}

TEST(LatticeLight, APictureOfOnePixel) {
  FeatureImage all(1, 1), lattice(1, 1);
  const Feature f = at(3, 5);
  all.add(0, 0, f);
  lattice.add(0, 0, f);
  LatticeLight spread(lattice, {vec3(2.0f) * f.albedo}, all, 2);
  EXPECT_TRUE(spread.advance([] { return false; }));
  const vec3 got = spread.result().front();
  for (int c = 0; c < 3; ++c) EXPECT_FLOAT_EQ(got[c], 2.0f * f.albedo[c]);
}

TEST(FeaturePart, JoinsSamplesOfTheSameSurface) {
  const Feature f = at(3, 5), texel = at(4, 5), other = at(20, 5);
  const float values[] = {0.3f, 1.2f, 0.7f, 2.0f, 0.1f};
  FeaturePart one, two, all, wall;
  for (int i = 0; i < 5; ++i) {
    const Feature& shown = i < 2 ? f : texel;
    (i < 2 ? one : two).add(shown, values[i] * shown.albedo);
    all.add(shown, values[i] * shown.albedo);
  }
  wall.add(other, vec3(9.0f));
  one.join(two);
  one.join(wall);
  one.join(FeaturePart{});
  EXPECT_EQ(one.count, 5.0f);
  for (int c = 0; c < 3; ++c) {
    EXPECT_NEAR(one.light[c], all.light[c], 1e-6f);
    EXPECT_NEAR(one.variance()[c], all.variance()[c], 1e-6f);
    EXPECT_NEAR(one.mean.albedo[c], all.mean.albedo[c], 1e-6f);
  }
  EXPECT_EQ(one.mean.position, f.position);
}

}  // namespace
}  // namespace trex
