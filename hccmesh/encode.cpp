#include "hccmesh/encode.h"

#include <algorithm>
#include <array>
#include <bit>

#include "hccmesh/layout.h"
#include "hccmesh/octahedral.h"

namespace hccm {
namespace {

// A vertex as it is stored, or nearly so; vertices of equal bytes are one.
struct VertexKey {
  glm::ivec3 grid{0};
  std::uint32_t normal = 0;
  glm::vec2 texCoord{0.0f};
  glm::u8vec4 color{0};
};
static_assert(sizeof(VertexKey) == 28);

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
  if (s.flags & layout::kTexCoords) {
    const glm::vec2 uv = s.part.texCoords[vertex];
    key.texCoord = {finiteOrZero(uv.x), finiteOrZero(uv.y)};
  }
  if (s.flags & layout::kColors) key.color = s.part.colors[vertex];
  return key;
}

// Vertices of one cluster, each once.
class Welder {
 public:
  Welder() { slots_.fill(kFree); }
  std::uint16_t add(const VertexKey& key) {
    std::uint32_t words[7];
    std::memcpy(words, static_cast<const void*>(&key), sizeof(key));
    std::uint64_t hash = 0;
    for (std::uint32_t w : words) hash = (hash ^ w) * 0x9e3779b97f4a7c15ull, hash ^= hash >> 29;
    for (std::size_t slot = hash % kSlots;; slot = (slot + 1) % kSlots) {
      if (slots_[slot] == kFree) {
        slots_[slot] = static_cast<std::uint16_t>(count_);
        vertices_[count_] = key;
        return static_cast<std::uint16_t>(count_++);
      }
      if (std::memcmp(&vertices_[slots_[slot]], &key, sizeof(key)) == 0) return slots_[slot];
    }
  }
  std::size_t count() const { return count_; }
  const VertexKey& operator[](std::size_t i) const { return vertices_[i]; }

 private:
  static constexpr std::size_t kSlots = 1024;
  static constexpr std::uint16_t kFree = 0xffff;
  std::array<std::uint16_t, kSlots> slots_;
  std::array<VertexKey, 3 * layout::kMaxTriangles> vertices_;
  std::size_t count_ = 0;
};

using Corners = std::array<std::uint16_t, 3>;

struct ClusterInput {
  const Source* source = nullptr;  ///< for material, object and flags
  std::vector<std::uint8_t> leafStarts;
  std::vector<Corners> triangles;   ///< in leaf order
  std::vector<VertexKey> vertices;  ///< in the order of their first use
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

TexCoordRange texCoordRange(const std::vector<VertexKey>& vertices) {
  TexCoordRange r;
  glm::vec2 least = vertices[0].texCoord, most = least;
  for (const VertexKey& v : vertices) {
    least = glm::min(least, v.texCoord);
    most = glm::max(most, v.texCoord);
  }
  const glm::vec2 extent = most - least;
  r.asFloats = !(extent.x <= 2.0f && extent.y <= 2.0f);
  r.least = least;
  r.scale = extent * (1.0f / 65535.0f);
  return r;
}

class BlobWriter {
 public:
  BlobWriter(const ClusterInput& in, std::vector<std::byte>& out) : in_(in) {
    layOut();
    start_ = out.size();
    out.resize(start_ + offsets_.end);
    blob_ = out.data() + start_;
    std::memcpy(blob_, &header_, sizeof(header_));
    if (header_.leafCount > 1) writeBoxes();
    writeTopology();
    writeVertices();
    writeAttributes();
  }

 private:
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
    h.triangleCountLess1 = static_cast<std::uint8_t>(in_.triangles.size() - 1);
    h.vertexCountLess1 = static_cast<std::uint8_t>(in_.vertices.size() - 1);
    h.leafCount = static_cast<std::uint8_t>(in_.leafStarts.size());
    h.indexBits = static_cast<std::uint8_t>(std::bit_width(in_.vertices.size() - 1));
    h.flags = in_.source->flags;
    if (h.flags & layout::kTexCoords) {
      range_ = texCoordRange(in_.vertices);
      if (range_.asFloats) h.flags |= layout::kFloatTexCoords;
    }
    for (int k = 0; k < 3; ++k) {
      const auto extent = static_cast<std::uint32_t>(upper[k] - lower[k]);
      h.anchor[k] = lower[k];
      h.width[k] = static_cast<std::uint8_t>(std::bit_width(extent));
      h.boxShift[k] = boxShiftFor(extent);
      h.top[k] = static_cast<std::uint8_t>((extent + (1u << h.boxShift[k]) - 1u) >> h.boxShift[k]);
    }
    offsets_ = layout::offsetsOf(h);
    h.topologyOffset = static_cast<std::uint16_t>(offsets_.topology);
    h.vertexOffset = static_cast<std::uint16_t>(offsets_.vertices);
  }

  glm::uvec3 offsetOf(const VertexKey& v) const {
    return glm::uvec3(v.grid - glm::ivec3(header_.anchor[0], header_.anchor[1], header_.anchor[2]));
  }

  void writeBoxes() {
    const std::size_t leaves = in_.leafStarts.size();
    for (std::size_t leaf = 0; leaf < 8u * header_.groups(); ++leaf) {
      glm::uvec3 lower(0xffffffffu), upper(0u);
      if (leaf < leaves) {
        const std::size_t end = leaf + 1 < leaves ? in_.leafStarts[leaf + 1] : in_.triangles.size();
        for (std::size_t t = in_.leafStarts[leaf]; t < end; ++t)
          for (std::uint16_t vertex : in_.triangles[t]) {
            lower = glm::min(lower, offsetOf(in_.vertices[vertex]));
            upper = glm::max(upper, offsetOf(in_.vertices[vertex]));
          }
        blob_[offsets_.leafStarts + leaf] = static_cast<std::byte>(in_.leafStarts[leaf]);
      }
      std::byte* planes = blob_ + offsets_.boxes + leaf / 8 * layout::kGroupBytes + leaf % 8;
      for (int k = 0; k < 3; ++k) {
        const std::uint32_t shift = header_.boxShift[k];
        const bool used = leaf < leaves;
        planes[16 * k] = static_cast<std::byte>(used ? lower[k] >> shift : 255u);
        planes[16 * k + 8] =
            static_cast<std::byte>(used ? (upper[k] + (1u << shift) - 1u) >> shift : 0u);
      }
    }
  }

  void writeTopology() {
    std::uint32_t bit = 0;
    for (const Corners& triangle : in_.triangles)
      for (std::uint16_t vertex : triangle) {
        layout::writeBits(blob_ + offsets_.topology, bit, header_.indexBits, vertex);
        bit += header_.indexBits;
      }
  }

  void writeVertices() {
    std::uint32_t bit = 0;
    for (const VertexKey& v : in_.vertices) {
      const glm::uvec3 offset = offsetOf(v);
      for (int k = 0; k < 3; ++k) {
        layout::writeBits(blob_ + offsets_.vertices, bit, header_.width[k], offset[k]);
        bit += header_.width[k];
      }
    }
  }

  template <typename T>
  static std::byte* put(std::byte* at, const T& value) {
    std::memcpy(at, &value, sizeof(T));
    return at + sizeof(T);
  }

  void writeAttributes() {
    std::byte* normal = blob_ + offsets_.normals;
    std::byte* uv = blob_ + offsets_.texCoords;
    std::byte* color = blob_ + offsets_.colors;
    const bool floats = range_.asFloats, texCoords = (header_.flags & layout::kTexCoords) != 0;
    if (texCoords && !floats) uv = put(put(uv, range_.least), range_.scale);
    for (const VertexKey& v : in_.vertices) {
      if (header_.flags & layout::kNormals) normal = put(normal, v.normal);
      if (texCoords && floats) uv = put(uv, v.texCoord);
      if (texCoords && !floats) uv = put(uv, quantised(v.texCoord));
      if (header_.flags & layout::kColors) color = put(color, v.color);
    }
  }

  glm::u16vec2 quantised(const glm::vec2& uv) const {
    glm::u16vec2 q(0);
    for (int k = 0; k < 2; ++k)
      if (range_.scale[k] > 0.0f) {
        const double steps = (double(uv[k]) - range_.least[k]) / range_.scale[k];
        q[k] = static_cast<std::uint16_t>(std::min(65535.0, std::floor(steps + 0.5)));
      }
    return q;
  }

  const ClusterInput& in_;
  layout::ClusterHeader header_;
  layout::Offsets offsets_;
  TexCoordRange range_;
  std::size_t start_ = 0;
  std::byte* blob_ = nullptr;
};

}  // namespace

void encodePiece(std::span<const Source> sources, const Grid& grid,
                 std::span<const Reference> piece, std::vector<std::byte>& blobs,
                 std::vector<std::uint32_t>& sizes) {
  PieceSplitter splitter(piece);
  std::vector<Corners> cornersOf(piece.size());
  ClusterInput in;
  for (Range cluster; splitter.nextCluster(cluster);) {
    Welder welder;
    for (PieceSplitter::Index i : splitter.triangles(cluster)) {
      const Source& source = sources[piece[i].source];
      const glm::uvec3 corners = source.corners(piece[i].triangle);
      for (int k = 0; k < 3; ++k)
        cornersOf[i][k] = welder.add(makeVertex(source, grid, corners[k], corners));
    }
    if (welder.count() > layout::kMaxVertices) {
      splitter.refuse(cluster);
      continue;
    }
    in.source = &sources[piece[splitter.triangles(cluster)[0]].source];
    in.leafStarts = splitter.splitIntoLeaves(cluster);
    in.triangles.clear();
    in.vertices.clear();
    std::array<std::uint16_t, 3 * layout::kMaxTriangles> renumbered;
    renumbered.fill(0xffff);
    for (PieceSplitter::Index i : splitter.triangles(cluster)) {
      Corners corners = cornersOf[i];
      for (std::uint16_t& corner : corners) {
        std::uint16_t& number = renumbered[corner];
        if (number == 0xffff) {
          number = static_cast<std::uint16_t>(in.vertices.size());
          in.vertices.push_back(welder[corner]);
        }
        corner = number;
      }
      in.triangles.push_back(corners);
    }
    const std::size_t before = blobs.size();
    BlobWriter(in, blobs);
    sizes.push_back(static_cast<std::uint32_t>(blobs.size() - before));
  }
}

}  // namespace hccm
