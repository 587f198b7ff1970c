// Mitsuba's compressed meshes: a header, meshes deflated one by one, and a table of where they
// start at the end. Versions 3 and 4, by the format's description in the manual of Mitsuba 0.6.
#include <zlib.h>

#include <cstring>

#include "src/scene/image_io.h"
#include "src/scene/mitsuba_geometry.h"

namespace trex::detail::mitsuba {
namespace {

constexpr std::uint16_t kMagic = 0x041c;
constexpr std::uint32_t kNormals = 0x1, kTexCoords = 0x2, kColors = 0x8, kFaceNormals = 0x10,
                        kSingle = 0x1000, kDouble = 0x2000;

template <typename T>
T valueAt(std::span<const std::uint8_t> bytes, std::size_t at) {
  T value;
  std::memcpy(&value, bytes.data() + at, sizeof(T));
  return value;
}

/// Inflates in pieces, so that nothing is allocated for what a header says alone.
class Inflater {
 public:
  Inflater(std::span<const std::uint8_t> bytes, std::string where) : where_(std::move(where)) {
    stream_.next_in = const_cast<Bytef*>(bytes.data());
    stream_.avail_in = static_cast<uInt>(std::min<std::size_t>(bytes.size(), 0xffffffffu));
    packed_ = bytes.size();
    if (inflateInit(&stream_) != Z_OK) {
      fail(ExitCode::kMemoryOrDevice, "{}: zlib can't start", where_);
    }
  }
  ~Inflater() { inflateEnd(&stream_); }
  Inflater(const Inflater&) = delete;
  Inflater& operator=(const Inflater&) = delete;

  void read(void* to, std::size_t size) {
    stream_.next_out = static_cast<Bytef*>(to);
    while (size > 0) {
      const auto piece = static_cast<uInt>(std::min<std::size_t>(size, 1u << 30));
      stream_.avail_out = piece;
      while (stream_.avail_out > 0) {
        const int result = inflate(&stream_, Z_NO_FLUSH);
        if (stream_.avail_out == 0) break;
        if (result != Z_OK) {
          fail(ExitCode::kInput, "{}: the compressed mesh is broken or cut off", where_);
        }
      }
      size -= piece;
    }
  }
  template <typename T>
  T value() {
    T v;
    read(&v, sizeof(T));
    return v;
  }
  /// Whether that much may follow: deflate packs at most 1032 to 1.
  bool mayHold(std::uint64_t count, std::uint64_t bytesEach) const {
    return count <= 1032 * packed_ / bytesEach + 1;
  }

 private:
  std::string where_;
  std::uint64_t packed_ = 0;
  z_stream stream_{};
};

/// Vectors of Real, float or double, as floats.
template <typename Real, typename Vec>
void readVectors(Inflater& in, std::uint64_t count, std::vector<Vec>& out) {
  constexpr int kLength = Vec::length();
  std::vector<Real> row(kLength * std::min<std::uint64_t>(count, 4096));
  for (std::uint64_t done = 0; done < count;) {
    const std::uint64_t now = std::min<std::uint64_t>(count - done, 4096);
    in.read(row.data(), now * kLength * sizeof(Real));
    for (std::uint64_t i = 0; i < now; ++i) {
      Vec v;
      for (int c = 0; c < kLength; ++c) v[c] = static_cast<float>(row[i * kLength + c]);
      out.push_back(v);
    }
    done += now;
  }
}

template <typename Real>
void readVertices(Inflater& in, std::uint32_t flags, std::uint64_t count, Mesh& mesh) {
  readVectors<Real>(in, count, mesh.positions);
  if (flags & kNormals) readVectors<Real>(in, count, mesh.normals);
  if (flags & kTexCoords) readVectors<Real>(in, count, mesh.texCoords);
  std::vector<vec3> colors;
  if (flags & kColors) readVectors<Real>(in, count, colors);
  for (const vec3& c : colors) mesh.colors.push_back(packVertexColor(vec4(c, 1.0f)));
}

Mesh readMesh(Inflater& in, std::uint16_t version, const std::string& where) {
  const auto flags = in.value<std::uint32_t>();
  Mesh mesh;
  if (version >= 4) {
    for (char c = in.value<char>(); c != '\0'; c = in.value<char>()) {
      if (mesh.name.size() < 256) mesh.name += c;
    }
  }
  const auto vertices = in.value<std::uint64_t>(), triangles = in.value<std::uint64_t>();
  const bool wide = (flags & kDouble) != 0;
  if ((flags & (kSingle | kDouble)) == 0) {
    fail(ExitCode::kInput, "{}: numbers are neither of single nor of double precision", where);
  }
  if (vertices > kMaxElements || triangles > kMaxElements ||
      !in.mayHold(vertices, wide ? 24 : 12) || !in.mayHold(triangles, 12)) {
    fail(ExitCode::kInput, "{}: {} vertices and {} triangles are more than the file can hold",
         where, vertices, triangles);
  }
  wide ? readVertices<double>(in, flags, vertices, mesh)
       : readVertices<float>(in, flags, vertices, mesh);
  if (flags & kFaceNormals) mesh.normals.clear();
  for (std::uint64_t i = 0; i < triangles; ++i) {
    glm::uvec3 t;
    in.read(&t, sizeof(t));
    mesh.triangles.push_back(t);
  }
  return mesh;
}

}  // namespace

Mesh readSerialized(const std::filesystem::path& path, std::uint32_t index,
                    const std::string& where) {
  const std::vector<std::uint8_t> file = readWholeFile(path, where, std::uint64_t{1} << 33);
  const std::span<const std::uint8_t> bytes = file;
  if (bytes.size() < 8 || valueAt<std::uint16_t>(bytes, 0) != kMagic) {
    fail(ExitCode::kInput, "{}: {} is no serialized mesh of Mitsuba", where, path.string());
  }
  const auto version = valueAt<std::uint16_t>(bytes, 2);
  if (version != 3 && version != 4) {
    fail(ExitCode::kInput, "{}: {} is of version {}; 3 and 4 can be read", where, path.string(),
         version);
  }
  const std::uint64_t count = valueAt<std::uint32_t>(bytes, bytes.size() - 4);
  const std::uint64_t entry = version == 4 ? 8 : 4;
  if (index >= count || count * entry + 8 > bytes.size()) {
    fail(ExitCode::kInput, "{}: {} holds {} meshes, none of number {}", where, path.string(), count,
         index);
  }
  const std::size_t at = bytes.size() - 4 - (count - index) * entry;
  const std::uint64_t start = version == 4 ? valueAt<std::uint64_t>(bytes, at)
                                           : std::uint64_t{valueAt<std::uint32_t>(bytes, at)};
  if (start > bytes.size() - 8) {
    fail(ExitCode::kInput, "{}: mesh {} of {} lies outside the file", where, index, path.string());
  }
  Inflater in(bytes.subspan(start + 4),
              fmt::format("{}: mesh {} of {}", where, index, path.string()));
  return readMesh(in, version, where);
}

}  // namespace trex::detail::mitsuba
