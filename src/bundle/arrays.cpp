#include "src/bundle/arrays.h"

#include <zstd.h>

#include <cstring>

#include "src/core/error.h"
#include "src/scene/texels.h"
#include "src/scene/texture_cache.h"

namespace trex::bundle {
namespace {

constexpr int kLevel = 3;  // zstd; higher ones gain a few percent and cost seconds

template <typename T>
void append(std::vector<std::byte>& out, const std::vector<T>& array) {
  const auto bytes = std::as_bytes(std::span(array));
  out.insert(out.end(), bytes.begin(), bytes.end());
}

template <typename T>
void take(std::span<const std::byte>& from, std::uint64_t count, std::vector<T>& out) {
  out.resize(count);
  if (count > 0) std::memcpy(static_cast<void*>(out.data()), from.data(), count * sizeof(T));
  from = from.subspan(count * sizeof(T));
}

void checkMesh(const Mesh& mesh, const std::string& where) {
  for (const vec3& p : mesh.positions) {
    if (!isFinite(p)) {
      fail(ExitCode::kInput, "{}: mesh '{}' has a position that is not finite; bake again", where,
           mesh.name);
    }
  }
  const std::size_t count = mesh.positions.size();
  for (const glm::uvec3& t : mesh.triangles) {
    if (t.x >= count || t.y >= count || t.z >= count) {
      fail(ExitCode::kInput, "{}: mesh '{}' has a triangle beyond its {} positions; bake again",
           where, mesh.name, count);
    }
  }
}

}  // namespace

std::shared_ptr<const std::span<const std::byte>> packImage(const Image& image) {
  if (image.paged) return image.paged->packed();
  using Bytes = std::span<const std::byte>;
  const auto made = std::make_shared<const std::vector<std::byte>>(packTiles(image));
  return {new Bytes(*made), [made](const Bytes* view) { delete view; }};
}

std::vector<std::byte> packMap(const Image& map) {
  const auto texels = std::as_bytes(std::span(map.floats));
  std::vector<std::byte> out(ZSTD_compressBound(texels.size()));
  const std::size_t size =
      ZSTD_compress(out.data(), out.size(), texels.data(), texels.size(), kLevel);
  if (ZSTD_isError(size)) {
    fail(ExitCode::kFailed, "{}: can't be compressed: {}", map.name, ZSTD_getErrorName(size));
  }
  out.resize(size);
  return out;
}

void unpackMap(std::span<const std::byte> frame, const std::string& where, Image& map) {
  const std::uint64_t bytes = texelBytes(map, TexelKind::kFloat);
  if (ZSTD_getFrameContentSize(frame.data(), frame.size()) != bytes) {
    fail(ExitCode::kInput, "{}: does not hold the {} bytes of its image; bake again", where, bytes);
  }
  map.floats.resize(bytes / sizeof(float));
  const std::size_t got = ZSTD_decompress(map.floats.data(), bytes, frame.data(), frame.size());
  if (ZSTD_isError(got) || got != bytes) {
    fail(ExitCode::kInput, "{}: texels can't be read: {}; bake again", where,
         ZSTD_isError(got) ? ZSTD_getErrorName(got) : "too few");
  }
  for (const float f : map.floats) {
    if (!std::isfinite(f)) {
      fail(ExitCode::kInput, "{}: has a texel that is not finite; bake again", where);
    }
  }
}

std::vector<std::byte> packEmitters(const Description& description,
                                    const std::vector<Mesh>& meshes) {
  std::vector<std::byte> out;
  for (const EmitterSize& e : description.emitters) {
    append(out, meshes[e.mesh].positions);
    append(out, meshes[e.mesh].triangles);
  }
  return out;
}

void unpackEmitters(std::span<const std::byte> bytes, const std::string& where,
                    Description& description) {
  static_assert(sizeof(vec3) == 12 && sizeof(glm::uvec3) == 12);
  for (const EmitterSize& e : description.emitters) {
    if (e.positions + e.triangles > bytes.size() / 12) {
      fail(ExitCode::kInput, "{}: ends before its last mesh; bake again", where);
    }
    Mesh& mesh = description.scene.meshes[e.mesh];
    take(bytes, e.positions, mesh.positions);
    take(bytes, e.triangles, mesh.triangles);
    checkMesh(mesh, where);
  }
  if (!bytes.empty())
    fail(ExitCode::kInput, "{}: {} bytes too long; bake again", where, bytes.size());
}

}  // namespace trex::bundle
