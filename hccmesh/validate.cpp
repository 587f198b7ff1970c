#include "hccmesh/validate.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <xxhash.h>

#include <algorithm>
#include <cmath>
#include <memory>

#include "hccmesh/hccmesh.h"
#include "hccmesh/layout.h"
#include "hccmesh/leaf.h"

namespace hccm {
namespace {

void check(bool good, const char* what, std::uint64_t at) {
  if (!good)
    throw FormatError(std::string("not a valid HCCMesh: ") + what + " at byte " +
                      std::to_string(at));
}

bool allZero(const std::byte* from, const std::byte* to) {
  return std::all_of(from, to, [](std::byte b) { return b == std::byte{0}; });
}

layout::Header checkHeader(std::span<const std::byte> bytes) {
  check(bytes.size() >= sizeof(layout::Header) + layout::kTailBytes, "truncated header",
        bytes.size());
  layout::Header h;
  std::memcpy(&h, bytes.data(), sizeof(h));
  check(std::memcmp(h.magic, layout::kMagic, 4) == 0, "wrong magic", 0);
  if (h.version != layout::kVersion)
    throw FormatError("an HCCMesh of version " + std::to_string(h.version) +
                      ", this program reads version " + std::to_string(layout::kVersion) +
                      "; bake again");
  check(h.byteSize == bytes.size(), "size differs from the buffer's", 8);
  check(h.checksum == checksumOf(bytes), "wrong checksum", 16);
  for (double o : h.gridOrigin) check(std::isfinite(o), "grid origin not finite", 24);
  check(std::isfinite(h.errorBound) && h.errorBound >= 0.0, "wrong error bound", 48);
  check(h.stepExponent >= layout::kMinStepExponent && h.stepExponent <= layout::kMaxStepExponent,
        "step out of range", 72);
  const std::uint64_t room = bytes.size() - sizeof(layout::Header) - layout::kTailBytes;
  check(h.clusterCount <= room / (4 + sizeof(layout::ClusterHeader)) &&
            layout::firstBlob(h.clusterCount) <= room + sizeof(layout::Header),
        "too many clusters", 76);
  check(allZero(bytes.data() + offsetof(layout::Header, reserved), bytes.data() + sizeof(h)),
        "reserved bytes not zero", 104);
  return h;
}

struct Bounds {
  std::int32_t lower[3] = {INT32_MAX, INT32_MAX, INT32_MAX};
  std::int32_t upper[3] = {INT32_MIN, INT32_MIN, INT32_MIN};
  void extend(const std::int32_t* p) {
    for (int k = 0; k < 3; ++k) {
      lower[k] = std::min(lower[k], p[k]);
      upper[k] = std::max(upper[k], p[k]);
    }
  }
};

// What a header says of itself. `at`: of the blob, as below.
void checkCounts(const layout::ClusterHeader& h, std::uint64_t at) {
  const std::uint32_t t = h.triangles(), v = h.vertices();
  check(v >= 3 && v <= 3 * t, "wrong vertex count", at + 21);
  check(h.leafCount >= 1 && h.leafCount <= layout::kMaxLeaves && h.leafCount <= t,
        "wrong leaf count", at + 22);
  const auto with = [&](std::uint32_t flag, std::uint32_t needed) {
    return !(h.flags & flag) || (h.flags & needed);
  };
  check((h.flags & ~layout::kAllFlags) == 0 && with(layout::kFloatTexCoords, layout::kTexCoords) &&
            with(layout::kSecondTexCoords, layout::kTexCoords) &&
            with(layout::kFloatSecondTexCoords, layout::kSecondTexCoords),
        "unknown flags", at + 23);
  for (int k = 0; k < 3; ++k) {
    check(h.width[k] <= layout::kMaxWidth, "wrong width", at + 24);
    check(std::abs(std::int64_t(h.lower[k])) <= layout::kMaxGrid, "bounds off the grid", at);
    check(h.boxShift[k] <= 24, "wrong box shift", at + 27);
  }
  check(h.reserved == 0, "reserved byte not zero", at + 33);
}

// Vertices from `lower` to `upper`, grid.
void checkExtent(const layout::ClusterHeader& h, const std::int32_t* lower,
                 const std::int32_t* upper, std::uint64_t at) {
  for (int k = 0; k < 3; ++k) {
    check(upper[k] <= layout::kMaxGrid, "vertex off the grid", at);
    check(lower[k] == h.lower[k], "bounds are not the least", at);
    const auto extent = static_cast<std::uint32_t>(upper[k] - h.lower[k]);
    check(h.width[k] == std::bit_width(extent), "width is not the least", at + 24);
    const std::uint32_t cell = 1u << h.boxShift[k];
    check(h.top[k] == (extent + cell - 1u) / cell, "box does not fit the vertices", at + 30);
  }
}

void checkTexCoords(const std::byte* blob, const layout::ClusterHeader& h, std::uint32_t offset,
                    bool floats, std::uint64_t at) {
  const std::uint32_t count = floats ? 2 * h.vertices() : 4;
  for (std::uint32_t i = 0; i < count; ++i) {
    float value;
    std::memcpy(&value, blob + offset + 4u * i, 4);
    check(std::isfinite(value), "texture coordinate not finite", at + offset + 4u * i);
  }
}

void checkTexCoords(const std::byte* blob, const layout::ClusterHeader& h, std::uint64_t at) {
  const layout::Offsets o = layout::offsetsOf(h);
  if (h.flags & layout::kTexCoords)
    checkTexCoords(blob, h, o.texCoords, (h.flags & layout::kFloatTexCoords) != 0, at);
  if (h.flags & layout::kSecondTexCoords)
    checkTexCoords(blob, h, o.secondTexCoords, (h.flags & layout::kFloatSecondTexCoords) != 0, at);
}

// One blob; `size` bytes from `b`, which lie inside the buffer with its tail behind them.
class ClusterCheck {
 public:
  ClusterCheck(const std::byte* b, std::uint64_t size, std::uint64_t at) : b_(b), at_(at) {
    check(size >= sizeof(layout::ClusterHeader), "truncated cluster", at);
    std::memcpy(&h_, b, sizeof(h_));
    checkCounts(h_, at);
    o_ = layout::offsetsOf(h_);
    check(o_.records < o_.vertices && o_.end == size, "cluster of wrong size", at);
    checkVertices();
    checkLeaves();
    checkTexCoords(b, h_, at);
    check(allZero(b + o_.attributesEnd, b + o_.end), "padding not zero", at + o_.attributesEnd);
  }
  const Bounds& bounds() const { return bounds_; }
  std::uint32_t triangles() const { return h_.triangles(); }

 private:
  void checkVertices() {
    for (std::uint32_t v = 0; v < h_.vertices(); ++v) {
      layout::readVertex(b_ + o_.vertices, h_, v, grid_[v]);
      bounds_.extend(grid_[v]);
    }
    const std::uint32_t end = h_.vertices() * h_.vertexBits();
    for (std::uint32_t bit = end; bit < 8u * (o_.normals - o_.vertices); ++bit)
      check(layout::readBits(b_ + o_.vertices, bit, 1) == 0, "padding not zero",
            at_ + o_.vertices + bit / 8);
    checkExtent(h_, bounds_.lower, bounds_.upper, at_);
  }

  // Records lie without gaps, and number vertices in the order of their first use.
  void checkLeaves() const {
    std::uint32_t at = o_.records, used = 0, triangles = 0;
    for (std::uint32_t i = 0; i < h_.leafCount; ++i) {
      check(layout::recordOffset(b_, h_, i) == at, "leaf at a wrong place", at_ + o_.leafStarts);
      check(i % 8 != 0 || b_[o_.leafStarts + i] == std::byte{0}, "group at a wrong place",
            at_ + o_.groupStarts);
      check(at < o_.vertices, "leaves overlap vertices", at_ + at);
      const LeafTopology leaf = readLeaf(b_ + at);
      check(leaf.canonical && leaf.firstFresh == used && used + leaf.fresh <= h_.vertices(),
            "damaged leaf", at_ + at);
      if (h_.leafCount > 1) checkBox(i, leaf);
      used += leaf.fresh;
      triangles += leaf.triangles;
      at += leaf.bytes;
    }
    check(at == o_.vertices, "leaves do not end at the vertices", at_ + 34);
    check(used == h_.vertices() && triangles == h_.triangles(), "wrong counts in leaves", at_ + 20);
  }

  void checkBox(std::uint32_t leaf, const LeafTopology& t) const {
    for (std::uint32_t i = 0; i < t.locals; ++i)
      for (int k = 0; k < 3; ++k) {
        const std::byte* lower =
            b_ + o_.boxes + 2u * static_cast<std::uint32_t>(k) * h_.leafCount + leaf;
        const auto plane = [&](std::byte q) {
          return h_.lower[k] + (std::to_integer<std::int64_t>(q) << h_.boxShift[k]);
        };
        const std::int32_t at = grid_[t.vertex[i]][k];
        check(plane(*lower) <= at && plane(lower[h_.leafCount]) >= at, "box does not hold its leaf",
              at_ + o_.boxes);
      }
  }

  const std::byte* b_;
  std::uint64_t at_;
  layout::ClusterHeader h_;
  layout::Offsets o_;
  Bounds bounds_;
  std::int32_t grid_[layout::kMaxVertices][3];
};

}  // namespace

std::uint64_t checksumOf(std::span<const std::byte> bytes) {
  layout::Header h;
  std::memcpy(&h, bytes.data(), sizeof(h));
  h.checksum = 0;
  const std::unique_ptr<XXH3_state_t, XXH_errorcode (*)(XXH3_state_t*)> state(XXH3_createState(),
                                                                              XXH3_freeState);
  if (!state) throw std::bad_alloc();
  XXH3_64bits_reset(state.get());
  XXH3_64bits_update(state.get(), &h, sizeof(h));
  XXH3_64bits_update(state.get(), bytes.data() + sizeof(h), bytes.size() - sizeof(h));
  return XXH3_64bits_digest(state.get());
}

ClusterSummary validateCluster(std::span<const std::byte> blob, std::uint64_t at) {
  const ClusterCheck check(blob.data(), blob.size(), at);
  ClusterSummary s;
  std::copy_n(check.bounds().lower, 3, s.lower);
  std::copy_n(check.bounds().upper, 3, s.upper);
  s.triangles = check.triangles();
  return s;
}

void validateAssembled(const std::byte* blob, std::uint32_t triangles, const std::uint32_t* least,
                       const std::uint32_t* most, std::uint64_t at) {
  layout::ClusterHeader h;
  std::memcpy(&h, blob, sizeof(h));
  checkCounts(h, at);
  std::int32_t lower[3], upper[3];
  for (int k = 0; k < 3; ++k) {
    lower[k] = h.lower[k] + static_cast<std::int32_t>(least[k]);
    upper[k] = h.lower[k] + static_cast<std::int32_t>(most[k]);
  }
  checkExtent(h, lower, upper, at);
  check(triangles == h.triangles(), "wrong counts in leaves", at + 20);
  checkTexCoords(blob, h, at);
}

void validate(std::span<const std::byte> bytes) {
  const layout::Header h = checkHeader(bytes);
  const std::uint64_t end = bytes.size() - layout::kTailBytes;
  check(allZero(bytes.data() + end, bytes.data() + bytes.size()), "tail not zero", end);
  std::vector<std::uint32_t> table(h.clusterCount);
  if (!table.empty()) std::memcpy(table.data(), bytes.data() + sizeof(h), 4ull * h.clusterCount);
  const std::uint64_t first = layout::firstBlob(h.clusterCount);
  const std::uint64_t tableEnd = sizeof(h) + 4ull * h.clusterCount;
  check(allZero(bytes.data() + tableEnd, bytes.data() + first), "padding not zero", tableEnd);
  const auto begin = [&](std::uint64_t i) {
    return i < table.size() ? layout::blobOffset(table[i]) : end;
  };
  check(begin(0) == first, "first cluster not after the table", sizeof(h));
  for (std::uint64_t i = 0; i < table.size(); ++i)
    check(begin(i) < begin(i + 1) && begin(i + 1) <= end, "cluster table not ascending",
          sizeof(h) + 4 * i);

  struct Sum {
    Bounds bounds;
    std::uint64_t triangles = 0;
  };
  const std::uint64_t kBlock = 256;
  std::vector<Sum> sums((table.size() + kBlock - 1) / kBlock);
  tbb::parallel_for(std::size_t{0}, sums.size(), [&](std::size_t block) {
    const std::uint64_t stop = std::min<std::uint64_t>(table.size(), (block + 1) * kBlock);
    for (std::uint64_t i = block * kBlock; i < stop; ++i) {
      const ClusterSummary c =
          validateCluster(bytes.subspan(begin(i), begin(i + 1) - begin(i)), begin(i));
      sums[block].bounds.extend(c.lower);
      sums[block].bounds.extend(c.upper);
      sums[block].triangles += c.triangles;
    }
  });
  Sum all;
  for (const Sum& s : sums) {
    all.bounds.extend(s.bounds.lower);
    all.bounds.extend(s.bounds.upper);
    all.triangles += s.triangles;
  }
  check(all.triangles == h.triangleCount, "wrong triangle count", 56);
  for (int k = 0; k < 3; ++k) {
    const bool empty = table.empty();
    check(h.lower[k] == (empty ? 0 : all.bounds.lower[k]) &&
              h.upper[k] == (empty ? 0 : all.bounds.upper[k]),
          "wrong bounds", 80);
  }
}

}  // namespace hccm
