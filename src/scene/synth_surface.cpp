// synth:terrain and synth:scan: sheets of quads that noise displaces.
#include <algorithm>
#include <array>
#include <cmath>

#include "src/scene/synth_detail.h"

namespace trex::detail {
namespace {

constexpr std::uint32_t kTile = 128;  ///< quads a side; a batch is a tile

/// Quads of n x m in tiles.
struct Tiling {
  std::uint32_t columns = 1, rows = 1;
  std::uint32_t tilesAcross() const { return (columns + kTile - 1) / kTile; }
  std::uint64_t tiles() const {
    return std::uint64_t{tilesAcross()} * ((rows + kTile - 1) / kTile);
  }
  struct Tile {
    std::uint32_t column, row, width, height;
  };
  Tile tile(std::uint64_t number) const {
    const auto x = static_cast<std::uint32_t>(number % tilesAcross()) * kTile;
    const auto y = static_cast<std::uint32_t>(number / tilesAcross()) * kTile;
    return {x, y, std::min(kTile, columns - x), std::min(kTile, rows - y)};
  }
};

float smooth(float t) { return t * t * t * (t * (t * 6.0f - 15.0f) + 10.0f); }

/// In [-1, 1] at a corner of the lattice.
float corner(std::uint32_t seed, int x, int y, int z) {
  std::uint32_t h = seed + static_cast<std::uint32_t>(x) * 0x8da6b343u +
                    static_cast<std::uint32_t>(y) * 0xd8163841u +
                    static_cast<std::uint32_t>(z) * 0xcb1ab31fu;
  h ^= h >> 15;
  h *= 0x2c1b3c6du;
  h ^= h >> 12;
  h *= 0x297a2d39u;
  h ^= h >> 15;
  return static_cast<float>(h >> 8) * 0x1p-23f - 1.0f;
}

/// Value noise in [-1, 1]; z counts as flat where it is a whole number.
float noise(std::uint32_t seed, const vec3& p) {
  const vec3 floor = glm::floor(p), f = p - floor;
  const int x = static_cast<int>(floor.x), y = static_cast<int>(floor.y),
            z = static_cast<int>(floor.z);
  const float u = smooth(f.x), v = smooth(f.y), w = smooth(f.z);
  const auto plane = [&](int k) {
    return glm::mix(glm::mix(corner(seed, x, y, k), corner(seed, x + 1, y, k), u),
                    glm::mix(corner(seed, x, y + 1, k), corner(seed, x + 1, y + 1, k), u), v);
  };
  return w == 0.0f ? plane(z) : glm::mix(plane(z), plane(z + 1), w);
}

/// Octaves of noise, each of half the wavelength and `gain` of the height, down to `finest`.
float layered(std::uint32_t seed, vec3 p, float wavelength, float finest, float gain) {
  p /= wavelength;
  float sum = 0.0f, height = 1.0f;
  for (std::uint32_t octave = 0; wavelength > finest && octave < 24; ++octave) {
    sum += height * noise(seed + octave * 0x9e3779b9u, p);
    height *= gain;
    p *= 2.0f;
    wavelength *= 0.5f;
  }
  return sum;
}

/// What both have in common: one object of one material under a sky.
class Sheet : public TriangleStream {
 public:
  Sheet(const SynthRequest& request, std::string name)
      : seed_(static_cast<std::uint32_t>(mixBits(request.seed))) {
    scene_.source = std::move(name);
    scene_.environment = softSky();
    scene_.objects.emplace_back("surface");
    scene_.meshes.emplace_back().name = "surface";
    scene_.instances.emplace_back().name = "surface";
  }
  const Scene& scene() const override { return scene_; }
  std::string key() const override { return scene_.source; }

 protected:
  /// Adds the tile's quads, whose vertices are at(column, row), seen from the front.
  template <typename At>
  static void fill(const Tiling::Tile& t, const At& at, TriangleBatch& out) {
    out.clear();
    std::vector<vec3> above(t.width + 1), below(t.width + 1);
    for (std::uint32_t i = 0; i <= t.width; ++i) above[i] = at(t.column + i, t.row);
    for (std::uint32_t j = 0; j < t.height; ++j) {
      for (std::uint32_t i = 0; i <= t.width; ++i) below[i] = at(t.column + i, t.row + j + 1);
      for (std::uint32_t i = 0; i < t.width; ++i) {
        addQuad(out.positions, above[i], below[i], below[i + 1], above[i + 1]);
      }
      above.swap(below);
    }
    out.runs.push_back({0, 0, out.triangles()});
  }

  Scene scene_;
  std::uint32_t seed_;
};

class Terrain : public Sheet {
 public:
  Terrain(const SynthRequest& request, const std::string& name) : Sheet(request, name) {
    const double quads = std::max(1.0, static_cast<double>(request.triangles) / 2.0);
    tiling_.columns = static_cast<std::uint32_t>(std::max(1.0, std::round(std::sqrt(quads))));
    tiling_.rows = static_cast<std::uint32_t>(std::max(1.0, std::round(quads / tiling_.columns)));
    finest_ = static_cast<float>(4.0 * kExtent / tiling_.columns);
    scene_.materials.push_back(synthMaterial("ground", vec3(0.36f, 0.33f, 0.26f), 0.0f, 1.0f));
    Light sun;
    sun.type = Light::Type::kDirectional;
    sun.name = "sun";
    sun.direction = glm::normalize(vec3(-0.6f, -0.45f, -0.35f));
    sun.intensity = vec3(4.0f, 3.6f, 3.0f);
    scene_.lights.push_back(sun);
    const double half = 0.5 * kExtent;
    scene_.cameras.push_back(
        synthCamera("hills", dvec3(0.0, 190.0, 1.05 * half), dvec3(0.0, 0.0, -0.1 * half), 40.0f));
  }
  Box3d bounds() const override {
    const double half = 0.5 * kExtent, height = 2.0 * kHeight;
    return {dvec3(-half, -height, -half), dvec3(half, height, half)};
  }
  std::uint64_t triangleCount() const override { return 2ull * tiling_.columns * tiling_.rows; }
  std::uint64_t batchCount() const override { return tiling_.tiles(); }
  void batch(std::uint64_t number, TriangleBatch& out) const override {
    fill(
        tiling_.tile(number), [&](std::uint32_t i, std::uint32_t j) { return vertex(i, j); }, out);
  }

 private:
  static constexpr double kExtent = 1000.0, kHeight = 70.0;  // metres

  vec3 vertex(std::uint32_t i, std::uint32_t j) const {
    const auto x = static_cast<float>(kExtent * (double(i) / tiling_.columns - 0.5));
    const auto z = static_cast<float>(kExtent * (double(j) / tiling_.rows - 0.5));
    const float h = layered(seed_, vec3(x + 700.0f, z + 700.0f, 0.0f), 260.0f, finest_, 0.45f);
    return vec3(x, static_cast<float>(kHeight) * h, z);
  }

  Tiling tiling_;
  float finest_;
};

/// A cube blown up to a sphere and displaced: a point depends on its place on the cube alone, so
/// the sides fit to the bit.
class Scan : public Sheet {
 public:
  Scan(const SynthRequest& request, const std::string& name) : Sheet(request, name) {
    const double n = std::sqrt(static_cast<double>(request.triangles) / 12.0);
    tiling_.columns = tiling_.rows = static_cast<std::uint32_t>(std::max(1.0, std::round(n)));
    finest_ = static_cast<float>(6.0 / tiling_.columns);
    warp_.resize(2ull * tiling_.columns + 1);
    for (std::size_t i = 0; i < warp_.size(); ++i) {
      const double place = double(i) / tiling_.columns - 1.0;
      warp_[i] = std::tan(place * 0.7853981633974483);
    }
    // Equal bits for a place and its opposite keep the sides together.
    for (std::size_t i = 0; i < warp_.size() / 2; ++i) warp_[i] = -warp_[warp_.size() - 1 - i];
    scene_.materials.push_back(synthMaterial("stone", vec3(0.62f, 0.58f, 0.52f), 0.0f, 0.7f));
    scene_.cameras.push_back(
        synthCamera("front", dvec3(1.6, 1.1, 3.2), dvec3(0.0, 0.0, 0.0), 38.0f));
  }
  Box3d bounds() const override { return {dvec3(-kReach), dvec3(kReach)}; }
  std::uint64_t triangleCount() const override { return 12ull * tiling_.columns * tiling_.rows; }
  std::uint64_t batchCount() const override { return 6 * tiling_.tiles(); }
  void batch(std::uint64_t number, TriangleBatch& out) const override {
    const int side = static_cast<int>(number / tiling_.tiles());
    const auto at = [&](std::uint32_t i, std::uint32_t j) { return vertex(side, i, j); };
    fill(tiling_.tile(number % tiling_.tiles()), at, out);
  }

 private:
  static constexpr double kReach = 1.5;  // metres

  vec3 vertex(int side, std::uint32_t i, std::uint32_t j) const {
    const std::uint32_t n = tiling_.columns;
    const int axis = side / 2;
    const bool positive = side % 2 == 0;
    std::uint32_t at[3];
    at[axis] = positive ? 2 * n : 0;
    at[(axis + 1) % 3] = positive ? 2 * j : 2 * i;
    at[(axis + 2) % 3] = positive ? 2 * i : 2 * j;
    const dvec3 d = glm::normalize(dvec3(warp_[at[0]], warp_[at[1]], warp_[at[2]]));
    const vec3 p = vec3(d) + vec3(8.0f);
    const float folds = noise(seed_, p * 3.0f);
    const float r = 1.0f + 0.16f * noise(seed_ + 1, p * 1.3f) + 0.07f * std::abs(folds) +
                    0.03f * layered(seed_ + 2, p, 0.17f, finest_, 0.52f);
    return vec3(d * double(r));
  }

  Tiling tiling_;
  float finest_;
  std::vector<double> warp_;
};

}  // namespace

std::unique_ptr<TriangleStream> makeTerrain(const SynthRequest& request, const std::string& name) {
  return std::make_unique<Terrain>(request, name);
}
std::unique_ptr<TriangleStream> makeScan(const SynthRequest& request, const std::string& name) {
  return std::make_unique<Scan>(request, name);
}

}  // namespace trex::detail
