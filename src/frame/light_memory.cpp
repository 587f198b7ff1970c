#include "src/frame/light_memory.h"

#include <algorithm>
#include <cmath>

namespace trex {
namespace {

constexpr float kPixels = 2.0f;           // width of a cell, rounded to a power of two of metres
constexpr float kLongest = 64.0f;         // samples that a cell remembers
constexpr float kFewest = 4.0f;           // that tell of light
constexpr float kDoubt = 0.06f;           // share of its light that a cell may be wrong by
constexpr std::uint32_t kPlaces = 4;      // of the table, that a cell may lie in
constexpr int kLevels[] = {0, 1, -1, 2};  // that tell of a place, the best first

bool keeps(const Feature& f) {
  return f.normal != vec3(0.0f) && f.black < 1.0f && f.albedo != vec3(1.0f) && f.footprint > 0.0f;
}

std::uint64_t mixed(std::uint64_t x) {  // splitmix64's finaliser
  x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9u;
  x = (x ^ (x >> 27)) * 0x94d049bb133111ebu;
  return x ^ (x >> 31);
}

}  // namespace

int LightMemory::levelOf(float footprint) {
  return std::ilogb(std::clamp(kPixels * footprint, 0x1p-60f, 0x1p60f));
}

std::uint64_t LightMemory::hashOf(const vec3& position, const vec3& normal, int level) {
  const vec3 size = glm::abs(normal);
  const int axis = size.x >= size.y && size.x >= size.z ? 0 : size.y >= size.z ? 1 : 2;
  std::uint64_t hash = mixed(static_cast<std::uint64_t>(level + 128) * 8 +
                             static_cast<std::uint64_t>(2 * axis + (normal[axis] < 0.0f ? 1 : 0)));
  for (int i = 0; i < 3; ++i) {
    const float cell = std::floor(std::ldexp(position[i], -level));
    // Beyond that, cells are finer than single precision has places.
    hash = mixed(hash + static_cast<std::uint64_t>(
                            static_cast<std::int64_t>(std::clamp(cell, -0x1p40f, 0x1p40f))));
  }
  return hash;
}

void LightMemory::add(const Feature& f, const vec3& light) {
  if (!keeps(f)) return;
  if (cells_.empty()) cells_.resize(kCells);
  const std::uint64_t hash = hashOf(f.position, f.normal, levelOf(f.footprint));
  const auto key = static_cast<std::uint32_t>(hash >> 32) | 1u;
  Cell* best = nullptr;
  for (std::uint32_t i = 0; i < kPlaces; ++i) {
    Cell& cell = cells_[(hash + i) % kCells];
    if (cell.key == key) {
      best = &cell;
      break;
    }
    if (best == nullptr || cell.count < best->count) best = &cell;
  }
  if (best->key != key) {
    // What has many samples goes too, but not at once.
    best->count *= 0.5f;
    if (best->key != 0 && best->count >= 1.0f) return;
    *best = {};
    best->key = key;
  }
  Cell& c = *best;
  if (c.count >= kLongest) {
    c.spread *= (kLongest - 1.0f) / kLongest;
    c.count = kLongest - 1.0f;
  }
  c.count += 1.0f;
  const vec3 plain = light / guideAlbedo(f.albedo);
  c.light += (plain - c.light) / c.count;
  const float bright = luminance(plain), delta = bright - c.bright;
  c.bright += delta / c.count;
  c.spread += delta * (bright - c.bright);
}

const LightMemory::Cell* LightMemory::find(const vec3& position, const vec3& normal,
                                           int level) const {
  const std::uint64_t hash = hashOf(position, normal, level);
  const auto key = static_cast<std::uint32_t>(hash >> 32) | 1u;
  for (std::uint32_t i = 0; i < kPlaces; ++i) {
    const Cell& cell = cells_[(hash + i) % kCells];
    if (cell.key == key) return cell.count >= kFewest ? &cell : nullptr;
  }
  return nullptr;
}

bool LightMemory::join(FeaturePart& part, vec2 dice) const {
  const Feature& f = part.mean;
  if (cells_.empty() || !keeps(f)) return false;
  const Basis basis(glm::normalize(f.normal));
  const int own = levelOf(f.footprint);
  for (const int more : kLevels) {
    // Around the place, so that cells have no borders.
    const vec2 off = std::ldexp(1.0f, own + more) * (dice - 0.5f);
    const Cell* cell =
        find(f.position + basis.tangent * off.x + basis.bitangent * off.y, f.normal, own + more);
    if (cell == nullptr) continue;
    const float variance = cell->spread / (cell->count - 1.0f), wrong = kDoubt * cell->bright;
    if (!(variance > 0.0f)) continue;
    const float worth = variance / (variance / cell->count + wrong * wrong),
                all = part.count + worth;
    const vec3 albedo = guideAlbedo(f.albedo);
    part.light += (cell->light * albedo - part.light) * (worth / all);
    part.count = all;
    part.spread = variance * albedo * albedo * std::max(all - 1.0f, 0.0f);
    return true;
  }
  return false;
}

void LightMemory::clear() { std::fill(cells_.begin(), cells_.end(), Cell{}); }

}  // namespace trex
