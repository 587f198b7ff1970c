#include "src/scene/volume.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "asvo/asvo.h"
#include "asvo/medium.h"
#include "src/core/error.h"
#include "src/core/log.h"
#include "src/core/memory.h"
#include "src/scene/import_detail.h"
#include "src/scene/input_file.h"
#include "src/scene/spectra.h"
#include "src/vdb/vdb_library.h"

namespace trex {
namespace {

constexpr std::size_t kVoxels = 512;
constexpr double kMostScale = 1e12;
constexpr float kWhiteKelvin = 1500.0f;  // luminance 1

dvec3 planckXyz(double kelvin) {
  return detail::emissionXyz([&](double nm) { return detail::planck(nm, kelvin); });
}

/// Rec. 709 of XYZ, clipped to what it can show, luminance kept.
dvec3 rec709(const dvec3& xyz) {
  const dvec3 inside = glm::max(detail::rgbOfXyz(xyz), dvec3(0.0));
  const double shown = 0.2126 * inside.x + 0.7152 * inside.y + 0.0722 * inside.z;
  return shown > 0.0 ? inside * (xyz.y / shown) : dvec3(0.0);
}

bool inRange(double value, double low, double high) { return value >= low && value <= high; }

/// The colour of one or three numbers.
bool colorOf(std::span<const double> numbers, double high, vec3& out) {
  if (numbers.size() != 1 && numbers.size() != 3) return false;
  for (std::size_t i = 0; i < 3; ++i) {
    const double value = numbers[numbers.size() == 3 ? i : 0];
    if (!inRange(value, 0.0, high)) return false;
    out[static_cast<int>(i)] = static_cast<float>(value);
  }
  return true;
}

/// What shines of one brick, if anything does.
class Emission {
 public:
  Emission(const VdbFog& fog, float kelvin) : fog_(fog), kelvin_(kelvin) {
    if (!present()) return;
    values_.resize(fog.density.size());
    for (std::size_t i = 0; i < values_.size(); ++i) values_[i] = at(i);
  }
  bool present() const {
    return !fog_.emission.empty() || !fog_.flames.empty() || !fog_.temperature.empty();
  }
  std::span<const vec3> of(std::uint32_t array) const {
    if (!present()) return {};
    return std::span(values_).subspan(std::size_t{array} * kVoxels, kVoxels);
  }

 private:
  vec3 at(std::size_t i) const {
    if (!fog_.emission.empty()) return fog_.emission[i];
    const float amount = fog_.flames.empty() ? fog_.density[i] : fog_.flames[i];
    if (fog_.temperature.empty()) return vec3(amount);
    return amount * blackBody(kelvin_ * fog_.temperature[i]);
  }
  const VdbFog& fog_;
  float kelvin_;
  std::vector<vec3> values_;
};

std::vector<asvo::MediumLeaf> leavesOf(const VdbFog& fog, const Emission& emission) {
  std::vector<asvo::MediumLeaf> leaves;
  leaves.reserve(fog.bricks.size());
  for (const TrexVdbBrick& b : fog.bricks) {
    asvo::MediumLeaf& leaf = leaves.emplace_back();
    leaf.origin = glm::ivec3(b.origin[0], b.origin[1], b.origin[2]);
    leaf.density = b.density;
    if (b.array == 0xffffffffu) continue;
    leaf.values = fog.density.subspan(std::size_t{b.array} * kVoxels, kVoxels);
    leaf.emissions = emission.of(b.array);
  }
  return leaves;
}

void checkTransform(const dmat4& m, const std::string& file) {
  const double scale =
      glm::length(dvec3(m[0])) * glm::length(dvec3(m[1])) * glm::length(dvec3(m[2]));
  const double determinant = glm::determinant(glm::dmat3(m));
  if (!std::isnormal(determinant) || !(std::abs(determinant) > 1e-12 * scale)) {
    fail(ExitCode::kInput, "{}: its transform has no volume or is not finite", file);
  }
}

asvo::Medium build(const VolumeRequest& r, const VdbFog& fog, std::uint64_t left, bool& shines) {
  const Emission emission(fog, r.kelvin);
  shines = emission.present();
  const std::vector<asvo::MediumLeaf> leaves = leavesOf(fog, emission);
  glm::ivec3 lower(0), upper(0);
  for (const asvo::MediumLeaf& leaf : leaves) {
    lower = &leaf == leaves.data() ? leaf.origin : glm::min(lower, leaf.origin);
    upper = &leaf == leaves.data() ? leaf.origin : glm::max(upper, leaf.origin);
  }
  const std::size_t arrays = fog.density.size() / kVoxels;
  const std::uint64_t needed =
      asvo::Medium::bytesNeeded(lower, upper, arrays, leaves.size() - arrays, shines);
  if (needed > left) {
    fail(ExitCode::kMemoryOrDevice,
         "{}: its grid needs about {}, there are {}; make --max-memory larger", r.file,
         formatBytes(needed), formatBytes(left));
  }
  try {
    return asvo::Medium::build(leaves);
  } catch (const asvo::FormatError& e) {
    fail(ExitCode::kInput, "{}: {}", r.file, e.what());
  }
}

[[noreturn]] void refuse(const std::string& text, const std::string& what) {
  fail(ExitCode::kUsage, "--volume {}: {}; want FILE.vdb?density=1&albedo=R,G,B&g=0&emission=1",
       text, what);
}

}  // namespace

vec3 blackBody(float kelvin) {
  constexpr float kLeast = 300.0f, kMost = 20000.0f;
  constexpr int kSteps = 1024;
  // Evenly in 1 / T, where the logarithm of the radiance is about straight.
  static const auto table = [] {
    std::array<vec3, kSteps + 1> t;
    const double unit = planckXyz(kWhiteKelvin).y;
    for (std::size_t i = 0; i < t.size(); ++i) {
      const double share = static_cast<double>(i) / kSteps;
      const double inverse = (1.0 - share) / kLeast + share / kMost;
      const dvec3 rgb = rec709(planckXyz(1.0 / inverse) / unit);
      t[i] = vec3(glm::log(glm::max(rgb, dvec3(1e-30))));
    }
    return t;
  }();
  if (!(kelvin >= kLeast)) return vec3(0.0f);
  const float inverse = 1.0f / std::min(kelvin, kMost);
  const float place =
      std::clamp((1.0f / kLeast - inverse) / (1.0f / kLeast - 1.0f / kMost), 0.0f, 1.0f) * kSteps;
  const auto step = static_cast<std::size_t>(std::min(place, kSteps - 1.0f));
  return glm::exp(glm::mix(table[step], table[step + 1], place - static_cast<float>(step)));
}

std::string setVolumeOption(VolumeRequest& r, const std::string& key,
                            std::span<const double> numbers) {
  const bool one = numbers.size() == 1;
  const double value = numbers.empty() ? 0.0 : numbers[0];
  if (key == "density") {
    if (!one || !inRange(value, 0.0, kMostScale)) return "density must be a number in [0, 1e12]";
    r.density = static_cast<float>(value);
  } else if (key == "albedo") {
    if (!colorOf(numbers, 1.0, r.albedo)) return "albedo must be 1 or 3 numbers in [0, 1]";
  } else if (key == "g") {
    if (!one || !inRange(value, -0.99, 0.99)) return "g must be a number in [-0.99, 0.99]";
    r.anisotropy = static_cast<float>(value);
  } else if (key == "emission") {
    vec3 emission;
    if (!colorOf(numbers, kMostScale, emission)) {
      return "emission must be 1 or 3 numbers in [0, 1e12]";
    }
    r.emission = emission;
  } else if (key == "kelvin") {
    if (!one || !inRange(value, 0.0, 1e6)) return "kelvin must be a number in [0, 1e6]";
    r.kelvin = static_cast<float>(value);
  } else if (key == "scale") {
    if (!one || !inRange(value, 1e-12, 1e12)) return "scale must be a number in [1e-12, 1e12]";
    for (int axis = 0; axis < 3; ++axis) r.transform[axis] *= value;
  } else if (key == "move") {
    if (numbers.size() != 3) return "move must be 3 numbers";
    for (std::size_t axis = 0; axis < 3; ++axis) {
      if (!inRange(numbers[axis], -detail::kMaxCoordinate, detail::kMaxCoordinate)) {
        return "move must be within 1e18 m";
      }
      r.transform[3][static_cast<int>(axis)] = numbers[axis];
    }
  } else {
    return "unknown option '" + key +
           "'; there are density, albedo, g, emission, kelvin, scale "
           "and move";
  }
  return {};
}

VolumeRequest parseVolume(const std::string& text) {
  VolumeRequest r;
  const std::size_t question = text.rfind(".vdb?");
  r.file = question == std::string::npos ? text : text.substr(0, question + 4);
  if (r.file.empty()) refuse(text, "has no file");
  if (question == std::string::npos) return r;
  const std::string problem = detail::parseOptions(
      std::string_view(text).substr(question + 5),
      [&r](const std::string& key, auto numbers) { return setVolumeOption(r, key, numbers); });
  if (!problem.empty()) refuse(text, problem);
  return r;
}

void addVolume(Scene& scene, const VolumeRequest& r, std::uint64_t maxMemory) {
  std::error_code error;
  if (!std::filesystem::is_regular_file(r.file, error)) {
    fail(ExitCode::kInput, "{}: no such volume file", r.file);
  }
  detail::noteFile(scene, r.file);
  // The values as they are read, their emission as colours, and the grid made of them.
  const VdbFog fog = readFog(r.file, detail::leftBytes(maxMemory) / 3);
  bool shines = false;
  Medium medium;
  asvo::Medium grid = build(r, fog, detail::leftBytes(maxMemory), shines);
  if (grid.dropped > 0 || grid.cut > 0) {
    scene.warnings.push_back(
        fmt::format("{}: {} values that are negative or not finite set to 0, {} above 1e12 cut",
                    r.file, grid.dropped, grid.cut));
  }
  medium.transform = r.transform * fog.toWorld;
  checkTransform(medium.transform, r.file);
  for (int corner = 0; corner < 8; ++corner) {
    const dvec3 size = dvec3(grid.size * asvo::Medium::kCells);
    const dvec3 place = dvec3(grid.base) + size * dvec3(corner & 1, corner >> 1 & 1, corner >> 2);
    const dvec3 world(medium.transform * glm::dvec4(place, 1.0));
    const double most = std::max({std::abs(world.x), std::abs(world.y), std::abs(world.z)});
    if (!(most <= detail::kMaxCoordinate)) {
      fail(ExitCode::kInput, "{}: reaches beyond 1e18 m", r.file);
    }
  }
  if (grid.empty()) {
    scene.warnings.push_back(fmt::format("{}: has no voxel with any density", r.file));
    return;
  }
  medium.name = std::filesystem::path(r.file).filename().string();
  medium.density = r.density;
  medium.albedo = r.albedo;
  medium.anisotropy = r.anisotropy;
  medium.emission = r.emission.value_or(vec3(shines ? 1.0f : 0.0f));
  medium.grid = std::make_shared<const asvo::Medium>(std::move(grid));
  logVerbose("{}: {} voxels, {}", r.file, medium.grid->voxels, formatBytes(medium.grid->bytes()));
  scene.media.push_back(std::move(medium));
}

void addVolumes(Scene& scene, std::span<const VolumeRequest> requests, std::uint64_t maxMemory) {
  for (const VolumeRequest& r : requests) addVolume(scene, r, maxMemory);
}

std::uint64_t detail::leftBytes(std::uint64_t maxMemory) {
  const std::uint64_t all = availableMemoryLimit();
  const std::uint64_t allowed = maxMemory > 0 ? std::min(maxMemory, all) : all;
  const std::uint64_t used = residentBytes();
  return allowed > used ? allowed - used : 0;
}

}  // namespace trex
