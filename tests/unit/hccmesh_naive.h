// A second decoder of HCCMesh, written from FORMAT.md alone: one bit at a time, no shared code.
#pragma once

#include <cmath>
#include <cstdint>
#include <cstring>
#include <span>
#include <stdexcept>
#include <vector>

namespace hccm::naive {

struct Vertex {
  std::int64_t grid[3] = {};
  double normal[3] = {}, uv[2] = {}, secondUv[2] = {}, color[4] = {};
};
struct Leaf {
  std::uint32_t first = 0, end = 0;
  std::int64_t lower[3] = {}, upper[3] = {};
};
struct Cluster {
  std::uint32_t material = 0, object = 0, flags = 0;
  std::vector<Vertex> vertices;
  std::vector<std::uint32_t> corners;  // three a triangle
  std::vector<Leaf> leaves;            // boxes only if there are several
};
struct File {
  double gridOrigin[3] = {}, step = 0, errorBound = 0;
  std::uint64_t triangles = 0, dropped = 0;
  std::vector<Cluster> clusters;
};

class Reader {
 public:
  explicit Reader(std::span<const std::byte> bytes) : bytes_(bytes) {}
  std::uint64_t bits(std::uint64_t byte, std::uint64_t bit, unsigned count) const {
    std::uint64_t value = 0;
    for (unsigned i = 0; i < count; ++i) {
      const std::uint64_t at = bit + i;
      if (byte + at / 8 >= bytes_.size()) throw std::out_of_range("naive decoder");
      const auto b = std::to_integer<unsigned>(bytes_[byte + at / 8]);
      value |= std::uint64_t((b >> (at % 8)) & 1u) << i;
    }
    return value;
  }
  std::uint32_t u8(std::uint64_t at) const { return static_cast<std::uint32_t>(bits(at, 0, 8)); }
  std::uint32_t u16(std::uint64_t at) const { return static_cast<std::uint32_t>(bits(at, 0, 16)); }
  std::uint32_t u32(std::uint64_t at) const { return static_cast<std::uint32_t>(bits(at, 0, 32)); }
  std::int32_t i32(std::uint64_t at) const { return static_cast<std::int32_t>(u32(at)); }
  std::uint64_t u64(std::uint64_t at) const { return bits(at, 0, 64); }
  double f32(std::uint64_t at) const {
    const std::uint32_t w = u32(at);
    float f;
    std::memcpy(&f, &w, 4);
    return double(f);
  }
  double f64(std::uint64_t at) const {
    const std::uint64_t w = u64(at);
    double f;
    std::memcpy(&f, &w, 8);
    return f;
  }

 private:
  std::span<const std::byte> bytes_;
};

inline void readNormal(const Reader& r, std::uint64_t at, double* out) {
  const double a = static_cast<std::int16_t>(r.u16(at)),
               b = static_cast<std::int16_t>(r.u16(at + 2));
  double x = a / 32767.0, y = b / 32767.0;
  const double z = 1.0 - std::abs(x) - std::abs(y);
  if (z < 0.0) {
    const double ox = x, oy = y;
    x = (1.0 - std::abs(oy)) * (ox < 0.0 ? -1.0 : 1.0);
    y = (1.0 - std::abs(ox)) * (oy < 0.0 ? -1.0 : 1.0);
  }
  const double length = std::sqrt(x * x + y * y + z * z);
  out[0] = x / length, out[1] = y / length, out[2] = z / length;
}

// The triangles of a record at byte `at`; returns where it ends. `named`: vertices of earlier
// leaves.
inline std::uint64_t readRecord(const Reader& r, std::uint64_t at, std::uint32_t& named,
                                Cluster& c) {
  std::uint64_t bit = 0;
  const auto next = [&](unsigned count) {
    bit += count;
    return static_cast<std::uint32_t>(r.bits(at, bit - count, count));
  };
  if (next(8) != named) throw std::runtime_error("first fresh vertex");
  const std::uint32_t m = next(4) + 3;
  std::vector<bool> starts(m, false), isNew(m, true);
  starts[0] = true;
  for (std::uint32_t p = 1; p <= m - 3; ++p) starts[p] = next(1) != 0;
  std::uint32_t n = 3;
  for (std::uint32_t i = 3; i < m; ++i) {
    isNew[i] = next(1) != 0;
    n += isNew[i];
  }
  std::vector<bool> fresh;
  for (std::uint32_t i = 0; i < n; ++i) fresh.push_back(next(1) != 0);
  std::vector<std::uint32_t> local, vertices;
  std::uint32_t names = 0;
  for (std::uint32_t i = 0; i < m; ++i) local.push_back(isNew[i] ? names++ : next(4));
  while (bit % 8 != 0)
    if (next(1) != 0) throw std::runtime_error("spare bits");
  for (std::uint32_t i = 0; i < n; ++i) vertices.push_back(fresh[i] ? named++ : next(8));
  for (std::uint32_t p = 0; p + 2 < m; ++p) {
    if (!starts[p]) continue;
    c.corners.push_back(vertices.at(local[p % 2 == 0 ? p : p + 1]));
    c.corners.push_back(vertices.at(local[p % 2 == 0 ? p + 1 : p]));
    c.corners.push_back(vertices.at(local[p + 2]));
  }
  return at + bit / 8;
}

/// One set of all vertices; where it ends.
inline std::uint64_t readTexCoords(const Reader& r, std::uint64_t at, bool floats,
                                   double (Vertex::*set)[2], Cluster& c) {
  const std::uint64_t head = at;
  if (!floats) at += 16;
  for (Vertex& v : c.vertices) {
    for (unsigned k = 0; k < 2; ++k)
      (v.*set)[k] = floats ? r.f32(at + 4 * k)
                           : r.f32(head + 4 * k) + r.f32(head + 8 + 4 * k) * r.u16(at + 2 * k);
    at += floats ? 8 : 4;
  }
  return at;
}

inline Cluster readCluster(const Reader& r, std::uint64_t at) {
  Cluster c;
  std::int64_t anchor[3];
  unsigned width[3], shift[3];
  for (unsigned k = 0; k < 3; ++k) {
    anchor[k] = r.i32(at + 4 * k);
    width[k] = r.u8(at + 24 + k);
    shift[k] = r.u8(at + 27 + k);
  }
  c.material = r.u32(at + 12), c.object = r.u32(at + 16);
  const std::uint32_t t = r.u8(at + 20) + 1, v = r.u8(at + 21), l = r.u8(at + 22);
  c.flags = r.u8(at + 23);
  std::uint64_t next = at + 36;
  c.leaves.resize(l);
  if (l > 1) {
    for (std::uint32_t i = 0; i < l; ++i)
      for (unsigned k = 0; k < 3; ++k) {
        c.leaves[i].lower[k] = anchor[k] + (std::int64_t(r.u8(next + 2 * k * l + i)) << shift[k]);
        c.leaves[i].upper[k] =
            anchor[k] + (std::int64_t(r.u8(next + (2 * k + 1) * l + i)) << shift[k]);
      }
    next += 6 * l;
  }
  const std::uint64_t groups = next, places = next + 2 * ((l + 7) / 8);
  std::uint64_t record = places + l;
  std::uint32_t named = 0;
  for (std::uint32_t i = 0; i < l; ++i) {
    if (at + r.u16(groups + 2 * (i / 8)) + r.u8(places + i) != record)
      throw std::runtime_error("place of a leaf");
    c.leaves[i].first = static_cast<std::uint32_t>(c.corners.size()) / 3;
    record = readRecord(r, record, named, c);
    c.leaves[i].end = static_cast<std::uint32_t>(c.corners.size()) / 3;
  }
  next = record;
  if (next != at + r.u16(at + 34)) throw std::runtime_error("vertexOffset");
  if (named != v || c.corners.size() != 3 * t) throw std::runtime_error("counts");
  c.vertices.resize(v);
  const unsigned w = width[0] + width[1] + width[2];
  for (std::uint32_t i = 0; i < v; ++i) {
    std::uint64_t bit = std::uint64_t(w) * i;
    for (unsigned k = 0; k < 3; ++k) {
      c.vertices[i].grid[k] = anchor[k] + static_cast<std::int64_t>(r.bits(next, bit, width[k]));
      bit += width[k];
    }
  }
  next += (std::uint64_t(w) * v + 7) / 8;
  while (c.flags != 0 && (next - at) % 4 != 0) ++next;
  for (std::uint32_t i = 0; (c.flags & 1) && i < v; ++i, next += 4)
    readNormal(r, next, c.vertices[i].normal);
  if (c.flags & 2) next = readTexCoords(r, next, (c.flags & 4) != 0, &Vertex::uv, c);
  for (std::uint32_t i = 0; (c.flags & 8) && i < v; ++i, next += 4)
    for (unsigned k = 0; k < 4; ++k) c.vertices[i].color[k] = r.u8(next + k) / 255.0;
  if (c.flags & 16) readTexCoords(r, next, (c.flags & 32) != 0, &Vertex::secondUv, c);
  return c;
}

inline File readFile(std::span<const std::byte> bytes) {
  const Reader r(bytes);
  File f;
  for (unsigned k = 0; k < 3; ++k) f.gridOrigin[k] = r.f64(24 + 8 * k);
  f.errorBound = r.f64(48);
  f.triangles = r.u64(56), f.dropped = r.u64(64);
  f.step = std::exp2(r.i32(72));
  for (std::uint32_t i = 0; i < r.u32(76); ++i)
    f.clusters.push_back(readCluster(r, 16ull * r.u32(112 + 4ull * i)));
  return f;
}

}  // namespace hccm::naive
