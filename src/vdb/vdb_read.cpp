// Fog out of a .vdb file: one density, and what shines in it.
#include <openvdb/io/File.h>
#include <openvdb/openvdb.h>
#include <unistd.h>

#include <cstring>
#include <exception>
#include <filesystem>
#include <map>
#include <new>
#include <stdexcept>
#include <string>
#include <vector>

#include "src/vdb/vdb.h"

namespace {

constexpr std::uint32_t kUniform = 0xffffffffu;
constexpr int kEdge = 8;
constexpr std::size_t kVoxels = 512;

struct TooLarge : std::runtime_error {
  using std::runtime_error::runtime_error;
};

/// All bytes, or an exception.
void send(int output, const void* bytes, std::size_t count) {
  const char* from = static_cast<const char*>(bytes);
  while (count > 0) {
    const ssize_t sent = ::write(output, from, count);
    if (sent <= 0) throw TooLarge("it can't be passed on");
    from += sent;
    count -= static_cast<std::size_t>(sent);
  }
}

std::string classOf(const openvdb::GridBase& grid) {
  return openvdb::GridBase::gridClassToString(grid.getGridClass());
}

std::string listOf(openvdb::io::File& file) {
  std::string list;
  for (auto name = file.beginName(); name != file.endName(); ++name) {
    const auto grid = file.readGridMetadata(name.gridName());
    list += (list.empty() ? "" : ", ") + name.gridName() + " (" + grid->valueType() + ", " +
            classOf(*grid) + ")";
  }
  return list.empty() ? "none" : list;
}

template <typename Grid>
typename Grid::Ptr readNamed(openvdb::io::File& file, const std::string& name) {
  if (!file.hasGrid(name)) return nullptr;
  return openvdb::gridPtrCast<Grid>(file.readGrid(name));
}

/// The name of the grid that is the density; throws if it can't be told.
std::string densityName(openvdb::io::File& file) {
  std::string only;
  int fogs = 0, levelSets = 0;
  for (auto name = file.beginName(); name != file.endName(); ++name) {
    const auto grid = file.readGridMetadata(name.gridName());
    if (grid->valueType() != "float") continue;
    const bool levelSet = grid->getGridClass() == openvdb::GRID_LEVEL_SET;
    levelSets += levelSet ? 1 : 0;
    if (name.gridName() == "density" && !levelSet) return "density";
    if (grid->getGridClass() != openvdb::GRID_FOG_VOLUME) continue;
    only = name.gridName();
    ++fogs;
  }
  if (fogs == 1) return only;
  if (levelSets > 0 && fogs == 0) {
    throw std::runtime_error("holds a level set, which is a surface and no fog: " + listOf(file) +
                             "; convert it to a fog volume");
  }
  throw std::runtime_error("has no float grid 'density', nor just one fog volume; its grids: " +
                           listOf(file));
}

/// Bricks by their first voxel, in order, so that equal files give equal answers.
class Bricks {
 public:
  explicit Bricks(std::uint64_t maxBytes) : maxBytes_(maxBytes) {}

  void addUniform(const openvdb::CoordBBox& box, float density) {
    const openvdb::Coord low = box.min(), high = box.max();
    const double count = (double(high.x()) - low.x() + 1) / kEdge *
                         (double(high.y()) - low.y() + 1) / kEdge *
                         (double(high.z()) - low.z() + 1) / kEdge;
    charge(count * (sizeof(TrexVdbBrick) + 64));
    for (int x = low.x(); x <= high.x(); x += kEdge) {
      for (int y = low.y(); y <= high.y(); y += kEdge) {
        for (int z = low.z(); z <= high.z(); z += kEdge) {
          bricks_[openvdb::Coord(x, y, z)] = {{x, y, z}, kUniform, density};
        }
      }
    }
  }
  /// The array of a brick, made if it has none.
  std::uint32_t array(const openvdb::Coord& origin) {
    const auto [at, made] = bricks_.try_emplace(
        origin, TrexVdbBrick{{origin.x(), origin.y(), origin.z()}, kUniform, 0});
    TrexVdbBrick& brick = at->second;
    if (brick.array != kUniform) return brick.array;
    charge(double(kVoxels * sizeof(float) * channels_ + sizeof(TrexVdbBrick) + 64));
    brick.array = arrays_++;
    return brick.array;
  }
  void setChannels(std::size_t floats) { channels_ = floats; }
  std::uint32_t arrays() const { return arrays_; }
  const std::map<openvdb::Coord, TrexVdbBrick>& all() const { return bricks_; }

 private:
  void charge(double bytes) {
    bytes_ += bytes;
    if (bytes_ > double(maxBytes_)) {
      throw TooLarge("its voxels need more than " + std::to_string(maxBytes_ >> 20) +
                     " MiB of memory");
    }
  }
  std::uint64_t maxBytes_;
  double bytes_ = 0.0;
  std::size_t channels_ = 1;
  std::uint32_t arrays_ = 0;
  std::map<openvdb::Coord, TrexVdbBrick> bricks_;
};

/// Gives every leaf of a grid an array. Tiles of the density become uniform bricks, those of other
/// grids are left out unless they lie over density.
template <typename Grid>
void addLeaves(const Grid& grid, Bricks& bricks) {
  for (auto leaf = grid.tree().cbeginLeaf(); leaf; ++leaf) {
    if (!leaf->isEmpty()) bricks.array(leaf->origin());
  }
}

void addTiles(const openvdb::FloatGrid& grid, Bricks& bricks) {
  auto tile = grid.tree().cbeginValueOn();
  tile.setMaxDepth(openvdb::FloatTree::DEPTH - 2);  // above the leaves
  for (; tile; ++tile) bricks.addUniform(tile.getBoundingBox(), *tile);
}

/// All arrays of one channel.
template <typename Grid, typename Put>
void fill(const Grid& grid, const Bricks& bricks, Put put) {
  const auto at = grid.getConstAccessor();
  for (const auto& [origin, brick] : bricks.all()) {
    if (brick.array == kUniform) continue;
    std::size_t n = std::size_t{brick.array} * kVoxels;
    for (int x = 0; x < kEdge; ++x) {
      for (int y = 0; y < kEdge; ++y) {
        for (int z = 0; z < kEdge; ++z, ++n) {
          typename Grid::ValueType value;
          const bool active = at.probeValue(origin + openvdb::Coord(x, y, z), value);
          if (active) put(n, value);
        }
      }
    }
  }
}

void sameTransform(const openvdb::GridBase& a, const openvdb::GridBase::Ptr& b) {
  if (b && a.transform() != b->transform()) {
    throw std::runtime_error("grid '" + b->getName() + "' has another transform than '" +
                             a.getName() + "'; resample it");
  }
}

void read(const char* path, std::uint64_t maxBytes, int output) {
  openvdb::initialize();
  openvdb::io::File file(path);
  file.open(false);
  const std::string name = densityName(file);
  const auto density = readNamed<openvdb::FloatGrid>(file, name);
  if (!density) throw std::runtime_error("grid '" + name + "' can't be read");
  const auto temperature = readNamed<openvdb::FloatGrid>(file, "temperature");
  const auto flames = readNamed<openvdb::FloatGrid>(file, "flames");
  const auto emission = readNamed<openvdb::Vec3SGrid>(file, "emission");
  const auto emissionScalar =
      emission || flames ? nullptr : readNamed<openvdb::FloatGrid>(file, "emission");
  const auto flame = flames ? flames : emissionScalar;
  if (!density->transform().isLinear()) {
    throw std::runtime_error("grid '" + name + "' has a transform that is not linear");
  }
  for (const openvdb::GridBase::Ptr& other :
       {openvdb::GridBase::Ptr(temperature), openvdb::GridBase::Ptr(flame),
        openvdb::GridBase::Ptr(emission)}) {
    sameTransform(*density, other);
  }
  Bricks bricks(maxBytes);
  bricks.setChannels(1 + (temperature ? 1 : 0) + (flame ? 1 : 0) + (emission ? 3 : 0));
  addTiles(*density, bricks);
  addLeaves(*density, bricks);
  if (temperature) addLeaves(*temperature, bricks);
  if (flame) addLeaves(*flame, bricks);
  if (emission) addLeaves(*emission, bricks);

  TrexVdbHead head{};
  head.bricks = bricks.all().size();
  head.arrays = bricks.arrays();
  head.channels = (temperature ? kTrexVdbTemperature : 0u) | (flame ? kTrexVdbFlames : 0u) |
                  (emission ? kTrexVdbEmission : 0u);
  const openvdb::Mat4d m = density->transform().baseMap()->getAffineMap()->getMat4();
  for (int i = 0; i < 16; ++i) head.toWorld[i] = m(i / 4, i % 4);
  send(output, &head, sizeof(head));
  std::vector<TrexVdbBrick> list;
  list.reserve(bricks.all().size());
  for (const auto& [origin, brick] : bricks.all()) list.push_back(brick);
  send(output, list.data(), list.size() * sizeof(TrexVdbBrick));
  std::vector<float> values;
  const auto channel = [&](const openvdb::FloatGrid& grid) {
    values.assign(std::size_t{bricks.arrays()} * kVoxels, 0.0f);
    fill(grid, bricks, [&](std::size_t n, float v) { values[n] = v; });
    send(output, values.data(), values.size() * sizeof(float));
  };
  channel(*density);
  if (temperature) channel(*temperature);
  if (flame) channel(*flame);
  if (emission) {
    values.assign(std::size_t{bricks.arrays()} * kVoxels * 3, 0.0f);
    fill(*emission, bricks, [&](std::size_t n, const openvdb::Vec3s& v) {
      for (int axis = 0; axis < 3; ++axis) values[3 * n + std::size_t(axis)] = v[axis];
    });
    send(output, values.data(), values.size() * sizeof(float));
  }
}

/// Starts the output anew with a text.
void complain(int output, const char* text) {
  if (::ftruncate(output, 0) != 0 || ::lseek(output, 0, SEEK_SET) != 0) return;
  if (::write(output, text, std::strlen(text)) < 0) return;
}

}  // namespace

extern "C" int trexReadVdb(const char* path, std::uint64_t maxBytes, int output) {
  try {
    read(path, maxBytes, output);
    return kTrexVdbRead;
  } catch (const TooLarge& e) {
    complain(output, e.what());
    return kTrexVdbTooLarge;
  } catch (const std::bad_alloc&) {
    // Sizes of a damaged file are any; those of a good one are bounded by its compression.
    constexpr std::uintmax_t kMostExpansion = 1032;  // of zlib, the most of those in use
    std::error_code error;
    const std::uintmax_t bytes = std::filesystem::file_size(path, error);
    if (!error && bytes < maxBytes / kMostExpansion) {
      complain(output, "is damaged: it asks for more memory than so short a file can fill");
      return kTrexVdbBad;
    }
    complain(output, "there is not enough memory to read it");
    return kTrexVdbTooLarge;
  } catch (const std::exception& e) {
    complain(output, e.what());
  } catch (...) {
    complain(output, "it can't be read");
  }
  return kTrexVdbBad;
}
