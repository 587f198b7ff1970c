// Binary STL files as streams: the file is mapped, never held.
#include <algorithm>
#include <atomic>
#include <bit>
#include <cstring>

#include "src/scene/import_detail.h"
#include "src/scene/mapped_file.h"
#include "src/scene/stl_file.h"
#include "src/scene/streamed.h"

namespace trex::detail {
namespace {

class StlStream : public TriangleStream {
 public:
  StlStream(const std::filesystem::path& path, const StlKind& kind, const ImportOptions& options)
      : map_(path), triangles_(kind.triangles), options_(options), placed_(options) {
    beginStreamed(scene_, path);
    if (kStlHeader + kStlTriangle * triangles_ > map_.size()) {
      fail(ExitCode::kInput, "{}: the file ends early", scene_.source);
    }
    measure();
    tellAttributes(scene_, scene_.source, attributed_);
    scene_.materials.push_back(defaultMaterial());
    scene_.objects.push_back(path.stem().string());
    scene_.meshes.emplace_back().name = scene_.objects[0];
    scene_.instances.emplace_back().name = scene_.objects[0];
    if (kind.said != kind.triangles) {
      scene_.replaced.add(
          fmt::format("{}: its header says {} triangles, it has room for {}; those are shown",
                      scene_.source, kind.said, kind.triangles));
    }
    noteNoUnit(scene_, "STL", path, options);
    finishStreamed(scene_, options, bounds_);
  }
  const Scene& scene() const override { return scene_; }
  Box3d bounds() const override { return bounds_; }
  std::uint64_t triangleCount() const override { return triangles_; }
  std::uint64_t batchCount() const override {
    return (triangles_ + kBatchTriangles - 1) / kBatchTriangles;
  }
  std::string key() const override { return streamKey(scene_, options_); }

  void batch(std::uint64_t number, TriangleBatch& out) const override {
    out.clear();
    out.origin = bounds_.empty() ? dvec3(0.0) : bounds_.centre();
    const std::uint64_t first = number * kBatchTriangles;
    const std::uint64_t end = std::min<std::uint64_t>(triangles_, first + kBatchTriangles);
    for (std::uint64_t t = first; t < end; ++t) {
      for (int k = 0; k < 3; ++k) out.positions.push_back(vec3(corner(t, k) - out.origin));
    }
    out.runs.push_back({0, 0, out.triangles()});
    if (++reads_ % kForget == 0) map_.forget();
  }

 private:
  static constexpr std::uint64_t kForget = 16;  ///< batches between two of MappedFile::forget()

  dvec3 corner(std::uint64_t triangle, int k) const {
    vec3 p;
    std::memcpy(&p.x, map_.data() + kStlHeader + kStlTriangle * triangle + 12 * (k + 1), 12);
    return placed_.point(dvec3(p));
  }

  void measure() {
    for (std::uint64_t t = 0; t < triangles_; ++t) {
      for (int k = 0; k < 3; ++k) {
        const dvec3 p = corner(t, k);
        if (isFinite(vec3(p))) bounds_.extend(p);
      }
      attributed_ += hasAttributes(map_.data() + kStlHeader + kStlTriangle * t);
      if (t % (std::uint64_t{1} << 20) == 0) map_.forget();
    }
    map_.forget();
  }

  MappedFile map_;
  std::uint64_t triangles_ = 0, attributed_ = 0;
  ImportOptions options_;
  Placement placed_;
  Scene scene_;
  Box3d bounds_;
  mutable std::atomic<std::uint64_t> reads_{0};
};

}  // namespace

std::unique_ptr<TriangleStream> openStlStream(const std::filesystem::path& path,
                                              const ImportOptions& options) {
  static_assert(std::endian::native == std::endian::little);
  if (lowerExtension(path) != ".stl" || !std::filesystem::is_regular_file(path)) return nullptr;
  const StlKind kind = kindOfStl(path);
  if (!kind.binary) return nullptr;
  return std::make_unique<StlStream>(path, kind, options);
}

}  // namespace trex::detail
