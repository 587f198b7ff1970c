#include "hccmesh/encode.h"

#include <algorithm>
#include <array>
#include <bit>

#include "hccmesh/layout.h"
#include "hccmesh/octahedral.h"

namespace hccm {
namespace {

float finiteOrZero(float x) { return std::isfinite(x) ? x + 0.0f : 0.0f; }  // + 0: no negative zero

std::uint32_t encodeNormal(const Source& s, std::uint32_t vertex, const glm::uvec3& corners) {
  glm::dvec3 n = s.normalMatrix * glm::dvec3(s.part.normals[vertex]);
  double length = glm::length(n);
  if (!(length > 0.0) || !std::isfinite(length)) {  // useless: the face's own
    const glm::dvec3 a = s.transformed(corners.x);
    n = glm::cross(s.transformed(corners.y) - a, s.transformed(corners.z) - a);
    length = glm::length(n);
  }
  if (!(length > 0.0) || !std::isfinite(length)) return encodeOctahedral({0.0f, 0.0f, 1.0f});
  return encodeOctahedral(glm::vec3(n / length));
}

VertexKey makeVertex(const Source& s, const Grid& grid, std::uint32_t vertex,
                     const glm::uvec3& corners) {
  VertexKey key;
  key.grid = s.gridPosition(vertex, grid);
  if (s.flags & layout::kNormals) key.normal = encodeNormal(s, vertex, corners);
  const auto finite = [](const glm::vec2& uv) {
    return glm::vec2(finiteOrZero(uv.x), finiteOrZero(uv.y));
  };
  if (s.flags & layout::kTexCoords) key.texCoord = finite(s.part.texCoords[vertex]);
  if (s.flags & layout::kColors) key.color = s.part.colors[vertex];
  if (s.flags & layout::kSecondTexCoords)
    key.secondTexCoord = finite(s.part.secondTexCoords[vertex]);
  return key;
}

// Vertices of one cluster, each once.
class Welder {
 public:
  void clear() {
    slots_.fill(kFree);
    vertices_.clear();
  }
  /// Of keys that differ in their first bytes, if they do.
  template <std::size_t kBytes>
  std::uint16_t add(const VertexKey& key) {
    std::uint32_t words[kBytes / 4];
    std::memcpy(words, static_cast<const void*>(&key), kBytes);
    std::uint64_t hash = 0;
    for (std::uint32_t w : words) hash = (hash ^ w) * 0x9e3779b97f4a7c15ull, hash ^= hash >> 29;
    for (std::size_t slot = hash % kSlots;; slot = (slot + 1) % kSlots) {
      if (slots_[slot] == kFree) {
        slots_[slot] = static_cast<std::uint16_t>(count());
        vertices_.push_back(key);
        return slots_[slot];
      }
      if (std::memcmp(&vertices_[slots_[slot]], &key, kBytes) == 0) return slots_[slot];
    }
  }
  std::size_t count() const { return vertices_.size(); }
  const VertexKey& operator[](std::size_t i) const { return vertices_[i]; }

 private:
  static constexpr std::size_t kSlots = 4096;
  static constexpr std::uint16_t kFree = 0xffff;
  std::array<std::uint16_t, kSlots> slots_;
  std::vector<VertexKey> vertices_;
};

// Least shift with which the extent ends at 255 or below.
std::uint8_t boxShiftFor(std::uint32_t extent) {
  std::uint32_t shift = 0;
  while (((extent + (1u << shift) - 1u) >> shift) > 255u) ++shift;
  return static_cast<std::uint8_t>(shift);
}

struct TexCoordRange {
  glm::vec2 least{0.0f}, scale{0.0f};
  bool asFloats = false;
};

TexCoordRange texCoordRange(const std::vector<VertexKey>& vertices, glm::vec2 VertexKey::*set) {
  TexCoordRange r;
  glm::vec2 least = vertices[0].*set, most = least;
  for (const VertexKey& v : vertices) {
    least = glm::min(least, v.*set);
    most = glm::max(most, v.*set);
  }
  const glm::vec2 extent = most - least;
  r.asFloats = !(extent.x <= 2.0f && extent.y <= 2.0f);
  r.least = least;
  r.scale = extent * (1.0f / 65535.0f);
  return r;
}

// Bits appended to zeroed bytes.
class BitWriter {
 public:
  explicit BitWriter(std::byte* stream) : stream_(stream) {}
  void put(std::uint32_t value, std::uint32_t bits) {
    layout::writeBits(stream_, at_, bits, value);
    at_ += bits;
  }
  void align() { at_ = (at_ + 7u) & ~7u; }
  std::uint32_t bytes() const { return (at_ + 7u) / 8u; }

 private:
  std::byte* stream_;
  std::uint32_t at_ = 0;
};

// A leaf's record, at most layout::kMaxRecord bytes; `used` vertices have been used by leaves
// before.
constexpr std::uint32_t kRecordRoom = 32;  // writing touches whole words
std::uint32_t writeRecord(const Strip& strip, std::uint32_t& used, std::byte* out) {
  std::array<std::uint16_t, layout::kMaxEntries> local;
  std::uint32_t locals = 0, fresh = 0, next = 0;
  std::array<std::uint32_t, layout::kMaxEntries> place;
  const std::uint32_t firstFresh = used;
  for (std::uint32_t i = 0; i < strip.size; ++i) {
    const auto end = local.begin() + locals;
    const auto at = std::find(local.begin(), end, strip.entries[i]);
    place[i] = static_cast<std::uint32_t>(at - local.begin());
    if (at != end) continue;
    next |= 1u << i;
    if (strip.entries[i] == used) fresh |= 1u << locals, ++used;
    local[locals++] = strip.entries[i];
  }
  BitWriter w(out);
  w.put(firstFresh, 8);
  w.put(strip.size - 3, 4);
  w.put(strip.starts >> 1, strip.size - 3);
  w.put(next >> 3, strip.size - 3);
  w.put(fresh, locals);
  for (std::uint32_t i = 0; i < strip.size; ++i)
    if (!(next >> i & 1u)) w.put(place[i], 4);
  w.align();
  for (std::uint32_t i = 0; i < locals; ++i)
    if (!(fresh >> i & 1u)) w.put(local[i], 8);
  return w.bytes();
}

class BlobWriter {
 public:
  BlobWriter(const ClusterInput& in, std::vector<std::byte>& out) : in_(in) {
    writeRecords();
    layOut();
    const std::size_t start = out.size();
    out.resize(start + offsets_.end);
    blob_ = out.data() + start;
    std::memcpy(blob_, &header_, sizeof(header_));
    if (header_.leafCount > 1) writeBoxes();
    placeRecords();
    writeVertices();
    writeAttributes();
  }

 private:
  void writeRecords() {
    records_.resize(in_.leaves.size() * kRecordRoom);
    std::uint32_t used = 0;
    for (const Strip& leaf : in_.leaves) {
      recordStarts_.push_back(recordBytes_);
      recordBytes_ += writeRecord(leaf, used, records_.data() + recordBytes_);
    }
  }

  void layOut() {
    layout::ClusterHeader& h = header_;
    h = {};
    glm::ivec3 lower = in_.vertices[0].grid, upper = lower;
    for (const VertexKey& v : in_.vertices) {
      lower = glm::min(lower, v.grid);
      upper = glm::max(upper, v.grid);
    }
    h.material = in_.source->part.material;
    h.object = in_.source->part.object;
    int triangles = 0;
    for (const Strip& leaf : in_.leaves) triangles += std::popcount(leaf.starts);
    h.triangleCountLess1 = static_cast<std::uint8_t>(triangles - 1);
    h.vertexCount = static_cast<std::uint8_t>(in_.vertices.size());
    h.leafCount = static_cast<std::uint8_t>(in_.leaves.size());
    h.flags = in_.source->flags;
    if (h.flags & layout::kTexCoords) {
      range_ = texCoordRange(in_.vertices, &VertexKey::texCoord);
      if (range_.asFloats) h.flags |= layout::kFloatTexCoords;
    }
    if (h.flags & layout::kSecondTexCoords) {
      secondRange_ = texCoordRange(in_.vertices, &VertexKey::secondTexCoord);
      if (secondRange_.asFloats) h.flags |= layout::kFloatSecondTexCoords;
    }
    for (int k = 0; k < 3; ++k) {
      const auto extent = static_cast<std::uint32_t>(upper[k] - lower[k]);
      h.lower[k] = lower[k];
      h.width[k] = static_cast<std::uint8_t>(std::bit_width(extent));
      h.boxShift[k] = boxShiftFor(extent);
      h.top[k] = static_cast<std::uint8_t>((extent + (1u << h.boxShift[k]) - 1u) >> h.boxShift[k]);
    }
    h.vertexOffset = static_cast<std::uint16_t>(layout::offsetsOf(h).records + recordBytes_);
    offsets_ = layout::offsetsOf(h);
  }

  glm::uvec3 offsetOf(std::size_t vertex) const {
    return glm::uvec3(in_.vertices[vertex].grid -
                      glm::ivec3(header_.lower[0], header_.lower[1], header_.lower[2]));
  }

  void writeBoxes() {
    const std::size_t leaves = in_.leaves.size();
    for (std::size_t leaf = 0; leaf < leaves; ++leaf) {
      glm::uvec3 lower(0xffffffffu), upper(0u);
      for (std::uint32_t i = 0; i < in_.leaves[leaf].size; ++i) {
        const glm::uvec3 offset = offsetOf(in_.leaves[leaf].entries[i]);
        lower = glm::min(lower, offset);
        upper = glm::max(upper, offset);
      }
      std::byte* planes = blob_ + offsets_.boxes + leaf;
      for (int k = 0; k < 3; ++k, planes += 2 * leaves) {
        const std::uint32_t shift = header_.boxShift[k];
        planes[0] = static_cast<std::byte>(lower[k] >> shift);
        planes[leaves] = static_cast<std::byte>((upper[k] + (1u << shift) - 1u) >> shift);
      }
    }
  }

  void placeRecords() {
    std::uint32_t group = 0;
    for (std::size_t leaf = 0; leaf < recordStarts_.size(); ++leaf) {
      if (leaf % 8 == 0) {
        group = recordStarts_[leaf];
        const auto at = static_cast<std::uint16_t>(offsets_.records + group);
        put(blob_ + offsets_.groupStarts + leaf / 8 * 2, at);
      }
      blob_[offsets_.leafStarts + leaf] = static_cast<std::byte>(recordStarts_[leaf] - group);
    }
    std::memcpy(blob_ + offsets_.records, records_.data(), recordBytes_);
  }

  void writeVertices() {
    BitWriter w(blob_ + offsets_.vertices);
    for (std::size_t v = 0; v < in_.vertices.size(); ++v) {
      const glm::uvec3 offset = offsetOf(v);
      for (int k = 0; k < 3; ++k) w.put(offset[k], header_.width[k]);
    }
  }

  template <typename T>
  static std::byte* put(std::byte* at, const T& value) {
    std::memcpy(at, &value, sizeof(T));
    return at + sizeof(T);
  }

  void writeAttributes() {
    std::byte* normal = blob_ + offsets_.normals;
    std::byte* color = blob_ + offsets_.colors;
    for (const VertexKey& v : in_.vertices) {
      if (header_.flags & layout::kNormals) normal = put(normal, v.normal);
      if (header_.flags & layout::kColors) color = put(color, v.color);
    }
    if (header_.flags & layout::kTexCoords)
      writeTexCoords(range_, &VertexKey::texCoord, blob_ + offsets_.texCoords);
    if (header_.flags & layout::kSecondTexCoords)
      writeTexCoords(secondRange_, &VertexKey::secondTexCoord, blob_ + offsets_.secondTexCoords);
  }

  void writeTexCoords(const TexCoordRange& range, glm::vec2 VertexKey::*set, std::byte* uv) const {
    if (!range.asFloats) uv = put(put(uv, range.least), range.scale);
    for (const VertexKey& v : in_.vertices)
      uv = range.asFloats ? put(uv, v.*set) : put(uv, quantised(v.*set, range));
  }

  static glm::u16vec2 quantised(const glm::vec2& uv, const TexCoordRange& range) {
    glm::u16vec2 q(0);
    for (int k = 0; k < 2; ++k)
      if (range.scale[k] > 0.0f) {
        const double steps = (double(uv[k]) - range.least[k]) / range.scale[k];
        q[k] = static_cast<std::uint16_t>(std::min(65535.0, std::floor(steps + 0.5)));
      }
    return q;
  }

  const ClusterInput& in_;
  layout::ClusterHeader header_;
  layout::Offsets offsets_;
  TexCoordRange range_, secondRange_;
  std::vector<std::byte> records_;
  std::vector<std::uint32_t> recordStarts_;
  std::uint32_t recordBytes_ = 0;
  std::byte* blob_ = nullptr;
};

// The work on one piece.
class ClusterMaker {
 public:
  ClusterMaker(std::span<const Source> sources, const Grid& grid, std::span<const Reference> piece,
               const SplitLimits& limits)
      : sources_(sources),
        grid_(grid),
        piece_(piece),
        limits_(limits),
        splitter_(piece, limits),
        corners_(piece.size()) {}

  void run(const std::function<void(const ClusterInput&)>& take) {
    for (Range cluster; splitter_.nextCluster(cluster);) {
      const Source& source = sources_[piece_[splitter_.triangles(cluster)[0]].source];
      if (source.flags & layout::kSecondTexCoords)
        weld<sizeof(VertexKey)>(cluster);
      else
        weld<offsetof(VertexKey, secondTexCoord)>(cluster);
      if (welder_.count() <= limits_.vertices && makeLeaves(cluster))
        take(in_);
      else
        splitter_.refuse(cluster);
    }
  }

 private:
  template <std::size_t kKeyBytes>
  void weld(const Range& cluster) {
    welder_.clear();
    for (PieceSplitter::Index i : splitter_.triangles(cluster)) {
      const Source& source = sources_[piece_[i].source];
      const glm::uvec3 corners = source.corners(piece_[i].triangle);
      for (int k = 0; k < 3; ++k)
        corners_[i][static_cast<std::size_t>(k)] =
            welder_.add<kKeyBytes>(makeVertex(source, grid_, corners[k], corners));
    }
  }

  bool stripOf(std::span<const PieceSplitter::Index> triangles, Strip& strip) const {
    std::array<Corners, layout::kLeafSize> corners;
    for (std::size_t i = 0; i < triangles.size(); ++i) corners[i] = corners_[triangles[i]];
    return makeStrip(std::span(corners).first(triangles.size()), strip);
  }

  bool makeLeaves(const Range& cluster) {
    // The strips that fit are those of the leaves, in their order.
    in_.leaves.clear();
    splitter_.splitIntoLeaves(cluster, [&](std::span<const PieceSplitter::Index> leaf) {
      Strip strip;
      if (!stripOf(leaf, strip)) return false;
      in_.leaves.push_back(strip);
      return true;
    });
    if (in_.leaves.size() > limits_.leaves) return false;
    in_.source = &sources_[piece_[splitter_.triangles(cluster)[0]].source];
    in_.vertices.clear();
    std::vector<std::uint16_t> renumbered(welder_.count(), 0xffff);
    for (Strip& strip : in_.leaves)
      for (std::uint32_t i = 0; i < strip.size; ++i) {
        std::uint16_t& number = renumbered[strip.entries[i]];
        if (number == 0xffff) {
          number = static_cast<std::uint16_t>(in_.vertices.size());
          in_.vertices.push_back(welder_[strip.entries[i]]);
        }
        strip.entries[i] = number;
      }
    return true;
  }

  std::span<const Source> sources_;
  const Grid& grid_;
  std::span<const Reference> piece_;
  SplitLimits limits_;
  PieceSplitter splitter_;
  Welder welder_;
  std::vector<Corners> corners_;  ///< of the piece's triangles, as numbers of welder_
  ClusterInput in_;
};

}  // namespace

void forEachCluster(std::span<const Source> sources, const Grid& grid,
                    std::span<const Reference> piece, const SplitLimits& limits,
                    const std::function<void(const ClusterInput&)>& take) {
  ClusterMaker(sources, grid, piece, limits).run(take);
}

void encodePiece(std::span<const Source> sources, const Grid& grid,
                 std::span<const Reference> piece, std::vector<std::byte>& blobs,
                 std::vector<std::uint32_t>& sizes) {
  forEachCluster(sources, grid, piece, {}, [&](const ClusterInput& in) {
    const std::size_t before = blobs.size();
    BlobWriter(in, blobs);
    sizes.push_back(static_cast<std::uint32_t>(blobs.size() - before));
  });
}

}  // namespace hccm
