// Media: from leaves to bricks, and the file.
#include "asvo/medium.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <limits>
#include <string>
#include <unordered_map>

#define XXH_INLINE_ALL
#include <xxhash.h>

#include "asvo/build_parts.h"

namespace asvo {
namespace {

constexpr char kMediumMagic[8] = {'A', 'S', 'V', 'O', 'f', 'o', 'g', ' '};
constexpr std::uint32_t kMediumVersion = 1;
constexpr std::int32_t kMostPlace = 1 << 30;  // of voxels: sums of places stay in 32 bits

/// 88 bytes at the start of the file.
struct MediumHeader {
  char magic[8];
  std::uint32_t version;
  std::uint32_t byteOrder;
  std::uint64_t fileBytes;
  std::int32_t base[3];
  std::int32_t size[3];
  float emissionScale;
  std::uint32_t brickCount;
  std::uint32_t arrayCount;
  std::uint32_t emits;
  std::uint64_t voxels;
  std::uint64_t bodyHash;  ///< XXH3-64 of all that follows the header
  std::uint64_t hash;      ///< XXH3-64 of the 80 bytes before
};
static_assert(sizeof(MediumHeader) == 88 && offsetof(MediumHeader, base) == 24 &&
              offsetof(MediumHeader, emissionScale) == 48 && offsetof(MediumHeader, voxels) == 64 &&
              offsetof(MediumHeader, hash) == 80);
static_assert(sizeof(Medium::Brick) == 12);

[[noreturn]] void badMedium(const std::string& what) { throw FormatError("medium: " + what); }

std::uint64_t keyOf(const glm::ivec3& brick) {
  constexpr std::uint64_t kMask = (1u << 21) - 1;
  return (static_cast<std::uint64_t>(brick.x) & kMask) |
         (static_cast<std::uint64_t>(brick.y) & kMask) << 21 |
         (static_cast<std::uint64_t>(brick.z) & kMask) << 42;
}

/// Bricks along each axis of a grid whose leaves have corners in [lower, upper]; as numbers of 64
/// bits. A brick reaches into the leaf after it, so there is one before the first.
glm::i64vec3 sizeOf(const glm::ivec3& lower, const glm::ivec3& upper) {
  return (glm::i64vec3(upper) - glm::i64vec3(lower)) / std::int64_t{Medium::kCells} +
         std::int64_t{2};
}

/// The leaves of a source by place.
class Leaves {
 public:
  explicit Leaves(std::span<const MediumLeaf> leaves) : leaves_(leaves) {
    for (std::size_t i = 0; i < leaves.size(); ++i) {
      places_[keyOf(leaves[i].origin >> 3)] = static_cast<std::uint32_t>(i);
    }
  }
  const MediumLeaf* at(const glm::ivec3& brick) const {
    const auto found = places_.find(keyOf(brick));
    return found == places_.end() ? nullptr : &leaves_[found->second];
  }

 private:
  std::span<const MediumLeaf> leaves_;
  std::unordered_map<std::uint64_t, std::uint32_t> places_;
};

/// The 9x9x9 values of one brick.
struct Values {
  std::array<float, Medium::kBrickValues> density;
  std::array<glm::vec3, Medium::kBrickValues> emission;
};

float cleanDensity(float v) {
  return v >= 0.0f
             ? (v <= std::numeric_limits<float>::max() ? std::min(v, Medium::kMostDensity) : 0.0f)
             : 0.0f;
}

glm::vec3 cleanEmission(const glm::vec3& v) {
  return {cleanDensity(v.x), cleanDensity(v.y), cleanDensity(v.z)};
}

void gatherValues(const Leaves& leaves, const glm::ivec3& brick, Values& out) {
  const MediumLeaf* near[8];
  for (int i = 0; i < 8; ++i) {
    near[i] = leaves.at(brick + glm::ivec3(i >> 2, i >> 1 & 1, i & 1));
  }
  std::size_t n = 0;
  for (int x = 0; x < Medium::kValues; ++x) {
    for (int y = 0; y < Medium::kValues; ++y) {
      for (int z = 0; z < Medium::kValues; ++z, ++n) {
        const MediumLeaf* leaf = near[(x >> 3) * 4 + (y >> 3) * 2 + (z >> 3)];
        const auto place = static_cast<std::size_t>((x & 7) * 64 + (y & 7) * 8 + (z & 7));
        out.density[n] = leaf == nullptr        ? 0.0f
                         : leaf->values.empty() ? cleanDensity(leaf->density)
                                                : cleanDensity(leaf->values[place]);
        out.emission[n] = leaf == nullptr || leaf->emissions.empty()
                              ? glm::vec3(0.0f)
                              : cleanEmission(leaf->emissions[place]);
      }
    }
  }
}

void appendBrick(Medium& m, const Values& v, std::uint32_t& slot) {
  const auto [least, most] = std::minmax_element(v.density.begin(), v.density.end());
  glm::vec3 brightest(0.0f);
  bool evenEmission = true;
  for (const glm::vec3& e : v.emission) {
    brightest = glm::max(brightest, e);
    evenEmission &= e == v.emission[0];
  }
  Medium::Brick brick;
  brick.largest = *most;
  const float scale = m.emissionScale > 0.0f ? 1.0f / m.emissionScale : 0.0f;
  brick.emission = packer().asvoPackRgb9e5(brightest * scale);
  if (brick.largest <= 0.0f && brick.emission == 0) return;
  slot = static_cast<std::uint32_t>(m.bricks.size());
  if (*least < *most || !evenEmission) {
    brick.values = static_cast<std::uint32_t>(m.densities.size() / Medium::kBrickValues);
    const float inverse = brick.largest > 0.0f ? 65535.0f / brick.largest : 0.0f;
    for (const float d : v.density) {
      m.densities.push_back(
          static_cast<std::uint16_t>(std::lround(std::min(d * inverse, 65535.f))));
    }
    if (m.emissionScale > 0.0f) {
      for (const glm::vec3& e : v.emission)
        m.emissions.push_back(packer().asvoPackRgb9e5(e * scale));
    }
  }
  m.bricks.push_back(brick);
}

/// Counts voxels, and what had to be changed; the largest emission of all.
float survey(std::span<const MediumLeaf> leaves, Medium& m) {
  const auto cleaned = [&m](float value) {
    const float clean = cleanDensity(value);
    if (clean != value) ++(value > Medium::kMostDensity && clean > 0.0f ? m.cut : m.dropped);
    return clean;
  };
  float brightest = 0.0f;
  for (const MediumLeaf& leaf : leaves) {
    const bool even = leaf.values.empty() && cleaned(leaf.density) > 0.0f;
    for (std::size_t i = 0; i < 512; ++i) {
      bool filled = even;
      if (i < leaf.values.size()) filled |= cleaned(leaf.values[i]) > 0.0f;
      for (int channel = 0; channel < 3 && i < leaf.emissions.size(); ++channel) {
        const float e = cleaned(leaf.emissions[i][channel]);
        brightest = std::max(brightest, e);
        filled |= e > 0.0f;
      }
      m.voxels += filled ? 1 : 0;
    }
  }
  return brightest;
}

template <typename T>
void put(std::vector<std::byte>& out, const std::vector<T>& array) {
  const std::size_t at = out.size(), bytes = array.size() * sizeof(T);
  out.resize((at + bytes + 7) & ~std::size_t{7});
  if (bytes > 0) std::memcpy(out.data() + at, array.data(), bytes);
}

template <typename T>
std::uint64_t padded(std::uint64_t count) {
  return (count * sizeof(T) + 7) & ~std::uint64_t{7};
}

/// Takes `count` elements off the front.
template <typename T>
void take(std::span<const std::byte>& from, std::uint64_t count, std::vector<T>& out) {
  out.resize(count);
  if (count > 0) std::memcpy(static_cast<void*>(out.data()), from.data(), count * sizeof(T));
  from = from.subspan(padded<T>(count));
}

/// Checks every index that a tracer follows, and every value that it multiplies.
void checkMedium(const Medium& m) {
  for (const std::uint32_t i : m.index) {
    if (i != Medium::kNone && i >= m.bricks.size())
      badMedium("the index names a brick that is not there");
  }
  const std::size_t arrays = m.densities.size() / Medium::kBrickValues;
  for (const Medium::Brick& b : m.bricks) {
    if (!(b.largest >= 0.0f && b.largest <= Medium::kMostDensity)) {
      badMedium("a brick's density is not in [0, 1e12]");
    }
    if (b.values != Medium::kNone && b.values >= arrays) {
      badMedium("a brick names an array that is not there");
    }
    if (m.emissions.empty() && b.emission != 0 && b.values != Medium::kNone) {
      badMedium("a brick shines in a medium without emission");
    }
  }
}

}  // namespace

std::uint64_t Medium::bytesNeeded(const glm::ivec3& lower, const glm::ivec3& upper,
                                  std::uint64_t leaves, std::uint64_t uniformLeaves,
                                  bool emission) {
  const glm::i64vec3 size = sizeOf(lower, upper);
  const double index = static_cast<double>(size.x) * static_cast<double>(size.y) *
                       static_cast<double>(size.z) * sizeof(std::uint32_t);
  if (index > 1e18) return std::uint64_t{1} << 60;
  // A full leaf may wake all of its neighbours; in grids of any size there are few such.
  const std::uint64_t array = kBrickValues * (sizeof(std::uint16_t) + (emission ? 4 : 0));
  constexpr std::uint64_t kMap = 48;  // of the leaves by place
  return static_cast<std::uint64_t>(index) + leaves * (2 * (array + sizeof(Brick)) + kMap) +
         uniformLeaves * (sizeof(Brick) + array + kMap);
}

Medium Medium::build(std::span<const MediumLeaf> leaves) {
  Medium m;
  const float brightest = survey(leaves, m);
  // Stored emission ends at 1: far from both ends of the format.
  m.emissionScale = brightest > 0.0f ? std::max(brightest, 1e-30f) : 0.0f;
  if (m.voxels == 0) {
    m.emissionScale = 1.0f;
    return m;
  }
  glm::ivec3 lower(kMostPlace), upper(-kMostPlace);
  for (const MediumLeaf& leaf : leaves) {
    lower = glm::min(lower, leaf.origin);
    upper = glm::max(upper, leaf.origin);
  }
  const glm::i64vec3 size = sizeOf(lower, upper);
  const double entries =
      static_cast<double>(size.x) * static_cast<double>(size.y) * static_cast<double>(size.z);
  if (entries > static_cast<double>(kMostIndex)) {
    badMedium("its voxels are spread over " + std::to_string(entries) + " bricks, " +
              std::to_string(kMostIndex) + " can be indexed");
  }
  m.base = lower - kCells;
  m.size = glm::ivec3(size);
  m.index.assign(static_cast<std::size_t>(entries), kNone);
  const Leaves byPlace(leaves);
  // Bricks in the order of the index, so that equal grids give equal bytes. Only those beside a
  // leaf can have a value.
  std::vector<std::uint8_t> wanted(m.index.size(), 0);
  const auto slotOf = [&](const glm::ivec3& at) {
    return static_cast<std::size_t>(at.x) +
           static_cast<std::size_t>(m.size.x) *
               (static_cast<std::size_t>(at.y) +
                static_cast<std::size_t>(m.size.y) * static_cast<std::size_t>(at.z));
  };
  const glm::ivec3 first = m.base >> 3;
  for (const MediumLeaf& leaf : leaves) {
    for (int i = 0; i < 8; ++i) {
      wanted[slotOf((leaf.origin >> 3) - first - glm::ivec3(i >> 2, i >> 1 & 1, i & 1))] = 1;
    }
  }
  Values values;
  glm::ivec3 at(0);
  for (at.z = 0; at.z < m.size.z; ++at.z) {
    for (at.y = 0; at.y < m.size.y; ++at.y) {
      for (at.x = 0; at.x < m.size.x; ++at.x) {
        if (wanted[slotOf(at)] == 0) continue;
        gatherValues(byPlace, first + at, values);
        appendBrick(m, values, m.index[slotOf(at)]);
      }
    }
  }
  if (m.emissionScale == 0.0f) m.emissionScale = 1.0f;
  m.bricks.shrink_to_fit();
  m.densities.shrink_to_fit();
  m.emissions.shrink_to_fit();
  return m;
}

std::uint64_t Medium::bytes() const {
  return index.size() * sizeof(index[0]) + bricks.size() * sizeof(Brick) +
         densities.size() * sizeof(densities[0]) + emissions.size() * sizeof(emissions[0]);
}

std::vector<std::byte> Medium::toBytes() const {
  std::vector<std::byte> out;
  out.reserve(sizeof(MediumHeader) + bytes() + 32);
  out.resize(sizeof(MediumHeader));
  put(out, index);
  put(out, bricks);
  put(out, densities);
  put(out, emissions);
  MediumHeader h{};
  std::memcpy(h.magic, kMediumMagic, sizeof(kMediumMagic));
  h.version = kMediumVersion;
  h.byteOrder = 0x01020304u;
  h.fileBytes = out.size();
  for (int axis = 0; axis < 3; ++axis) h.base[axis] = base[axis], h.size[axis] = size[axis];
  h.emissionScale = emissionScale;
  h.brickCount = static_cast<std::uint32_t>(bricks.size());
  h.arrayCount = static_cast<std::uint32_t>(densities.size() / kBrickValues);
  h.emits = emits() ? 1 : 0;
  h.voxels = voxels;
  h.bodyHash = XXH3_64bits(out.data() + sizeof(MediumHeader), out.size() - sizeof(MediumHeader));
  h.hash = XXH3_64bits(&h, offsetof(MediumHeader, hash));
  std::memcpy(out.data(), &h, sizeof(h));
  return out;
}

Medium Medium::fromBytes(std::span<const std::byte> bytes) {
  MediumHeader h;
  if (bytes.size() < sizeof(h)) badMedium("it ends in its header");
  std::memcpy(&h, bytes.data(), sizeof(h));
  if (std::memcmp(h.magic, kMediumMagic, sizeof(kMediumMagic)) != 0) badMedium("it is no medium");
  if (h.version != kMediumVersion)
    badMedium("its version is " + std::to_string(h.version) + ", not 1");
  if (h.byteOrder != 0x01020304u || h.hash != XXH3_64bits(&h, offsetof(MediumHeader, hash))) {
    badMedium("its header is damaged");
  }
  std::uint64_t entries = 1;
  for (int axis = 0; axis < 3; ++axis) {
    if (h.size[axis] < 0 || h.size[axis] > kMostPlace / kCells || h.base[axis] < -kMostPlace ||
        h.base[axis] > kMostPlace) {
      badMedium("its size is out of range");
    }
    entries = std::min(entries * static_cast<std::uint64_t>(h.size[axis]), kMostIndex + 1);
  }
  if (entries > kMostIndex) badMedium("its index is too large");
  if (!(h.emissionScale > 0.0f && h.emissionScale <= kMostDensity) || h.emits > 1) {
    badMedium("its emission is out of range");
  }
  const std::uint64_t values = std::uint64_t{h.arrayCount} * kBrickValues;
  const std::uint64_t expected = sizeof(h) + padded<std::uint32_t>(entries) +
                                 padded<Brick>(h.brickCount) + padded<std::uint16_t>(values) +
                                 padded<std::uint32_t>(h.emits != 0 ? values : 0);
  if (expected != h.fileBytes || expected != bytes.size())
    badMedium("its parts are not as long as it");
  std::span<const std::byte> body = bytes.subspan(sizeof(h));
  if (XXH3_64bits(body.data(), body.size()) != h.bodyHash) badMedium("its content is damaged");
  Medium m;
  m.base = glm::ivec3(h.base[0], h.base[1], h.base[2]);
  m.size = glm::ivec3(h.size[0], h.size[1], h.size[2]);
  m.emissionScale = h.emissionScale;
  m.voxels = h.voxels;
  take(body, entries, m.index);
  take(body, h.brickCount, m.bricks);
  take(body, values, m.densities);
  take(body, h.emits != 0 ? values : 0, m.emissions);
  checkMedium(m);
  return m;
}

}  // namespace asvo
