// make_vdb KIND FILE: .vdb files for tests and pictures, written by OpenVDB itself.
//
//   cube        density 1 in 16^3 voxels of 1/16 m about the origin
//   smoke       a plume in 64 x 96 x 64 voxels, 1 m high, that stands on the origin
//   fire        the same with a grid of temperatures, in kelvin
//   glow        a cube with a grid of vectors that shines, red 1, green 2, blue 4
//   one         one voxel
//   empty       no voxel
//   nan         a cube with values that are not finite, negative, or huge
//   level       a level set
//   two         two fog volumes, neither of them called density
//   far         two voxels 1e8 voxels apart
//   tile        density 1 in one tile of 128^3 voxels
//   skew        the cube, sheared
#include <openvdb/io/File.h>
#include <openvdb/openvdb.h>
#include <openvdb/tools/LevelSetSphere.h>

#include <cmath>
#include <cstdio>
#include <limits>
#include <string>

namespace {

using openvdb::Coord;
using openvdb::FloatGrid;
using openvdb::Vec3SGrid;

template <typename Grid>
typename Grid::Ptr make(const char* name, double edge, const openvdb::Vec3d& corner) {
  const auto grid = Grid::create();
  grid->setName(name);
  grid->setGridClass(openvdb::GRID_FOG_VOLUME);
  grid->setTransform(openvdb::math::Transform::createLinearTransform(edge));
  grid->transform().postTranslate(corner + openvdb::Vec3d(0.5 * edge));
  return grid;
}

template <typename Grid, typename Value>
void fill(Grid& grid, const Coord& size, Value value) {
  auto at = grid.getAccessor();
  for (int x = 0; x < size.x(); ++x) {
    for (int y = 0; y < size.y(); ++y) {
      for (int z = 0; z < size.z(); ++z) at.setValue(Coord(x, y, z), value(x, y, z));
    }
  }
}

FloatGrid::Ptr cube(const char* name) {
  const auto grid = make<FloatGrid>(name, 1.0 / 16.0, openvdb::Vec3d(-0.5));
  fill(*grid, Coord(16), [](int, int, int) { return 1.0f; });
  return grid;
}

/// Smooth and cheap: a few sines that do not repeat.
double noise(double x, double y, double z) {
  double sum = 0.0, scale = 1.0;
  for (int octave = 0; octave < 4; ++octave) {
    sum += scale * std::sin(x + 1.7 * std::sin(1.3 * y + octave)) *
           std::sin(y + 1.1 * std::sin(1.9 * z)) * std::sin(z + 1.5 * std::sin(1.1 * x));
    x = 1.9 * x + 3.1, y = 1.8 * y + 1.3, z = 2.1 * z + 0.7, scale *= 0.55;
  }
  return sum;
}

double plume(double x, double y, double z) {
  const double swayX = 0.08 * std::sin(5.0 * y), swayZ = 0.06 * std::sin(7.0 * y + 1.0);
  const double radius = 0.08 + 0.18 * y, r = std::hypot(x - swayX, z - swayZ) / radius;
  const double body = 1.0 - r * r + 0.9 * noise(9.0 * x, 8.0 * y, 9.0 * z);
  const double ends = std::min(1.0, 12.0 * y) * std::min(1.0, 5.0 * (1.0 - y));
  return std::max(0.0, std::min(1.0, 1.5 * body) * ends);
}

openvdb::GridPtrVec smoke(bool fire) {
  constexpr double kEdge = 1.0 / 96.0;
  const openvdb::Vec3d corner(-32.0 * kEdge, 0.0, -32.0 * kEdge);
  const auto density = make<FloatGrid>("density", kEdge, corner);
  auto at = density->getAccessor();
  const auto temperature = make<FloatGrid>("temperature", kEdge, corner);
  auto warm = temperature->getAccessor();
  for (int x = 0; x < 64; ++x) {
    for (int y = 0; y < 96; ++y) {
      for (int z = 0; z < 64; ++z) {
        const double py = (y + 0.5) * kEdge;
        const double d = plume((x - 31.5) * kEdge, py, (z - 31.5) * kEdge);
        if (d <= 0.0) continue;
        at.setValue(Coord(x, y, z), static_cast<float>(d));
        warm.setValue(Coord(x, y, z),
                      static_cast<float>(2200.0 * d * std::max(0.0, 1.0 - 1.6 * py)));
      }
    }
  }
  if (fire) return {density, temperature};
  return {density};
}

openvdb::GridPtrVec grids(const std::string& kind) {
  if (kind == "cube") return {cube("density")};
  if (kind == "smoke") return smoke(false);
  if (kind == "fire") return smoke(true);
  if (kind == "two") return {cube("a"), cube("b")};
  if (kind == "glow") {
    const auto density = cube("density");
    const auto emission = make<Vec3SGrid>("emission", 1.0 / 16.0, openvdb::Vec3d(-0.5));
    fill(*emission, Coord(16), [](int, int, int) { return openvdb::Vec3s(1, 2, 4); });
    return {density, emission};
  }
  if (kind == "level") {
    return {openvdb::tools::createLevelSetSphere<FloatGrid>(0.5f, openvdb::Vec3f(0), 0.05f)};
  }
  if (kind == "nan") {
    const auto grid = cube("density");
    const float bad[] = {std::numeric_limits<float>::quiet_NaN(),
                         std::numeric_limits<float>::infinity(), -1.0f, 1e30f};
    for (int i = 0; i < 4; ++i) grid->tree().setValue(Coord(4 + i, 4, 4), bad[i]);
    return {grid};
  }
  const auto grid = make<FloatGrid>("density", 1.0 / 16.0, openvdb::Vec3d(-0.5));
  if (kind == "one" || kind == "far") grid->tree().setValue(Coord(8, 8, 8), 1.0f);
  if (kind == "far") grid->tree().setValue(Coord(100'000'000, 8, 8), 1.0f);
  if (kind == "tile") {
    grid->setTransform(openvdb::math::Transform::createLinearTransform(1.0 / 128.0));
    grid->transform().postTranslate(openvdb::Vec3d(-0.5));
    grid->tree().addTile(2, Coord(0), 1.0f, true);
  }
  if (kind == "skew") {
    fill(*grid, Coord(16), [](int, int, int) { return 1.0f; });
    grid->transform().postShear(0.5, openvdb::math::X_AXIS, openvdb::math::Y_AXIS);
  }
  return {grid};
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 3) {
    std::fputs("usage: make_vdb KIND FILE\n", stderr);
    return 2;
  }
  openvdb::initialize();
  openvdb::io::File file(argv[2]);
  file.write(grids(argv[1]));
  file.close();
  return 0;
}
