// Wavefront OBJ as a stream: the text is read once, into files of vertices and triangles that are
// mapped, so that none of it is held.
#include <algorithm>
#include <atomic>

#include "src/scene/obj_reader.h"
#include "src/scene/streamed.h"
#include "src/scene/texture.h"

namespace trex::detail {
namespace {

class ObjStream : public TriangleStream, ObjReader {
 public:
  ObjStream(const std::filesystem::path& path, const ImportOptions& options)
      : ObjReader(path, options, scratchFolder(options)),
        options_(options),
        placed_(options),
        triangles_(scratchFolder(options)) {
    readAll();
    beginStreamed(scene_, path);
    for (const auto& [group, uv] : texCoordsIn_) addMesh(group, emittingMesh(group));
    for (Instance& instance : scene_.instances) instance.transform = placed_.world();
    scene_.droppedTriangles = 0;  // those of lamps are counted with all others
    makeBatches();
    measure();
    finishStreamed(scene_, options, bounds_);
  }
  const Scene& scene() const override { return scene_; }
  Box3d bounds() const override { return bounds_; }
  std::uint64_t triangleCount() const override { return triangles_.size(); }
  std::uint64_t batchCount() const override { return batches_.size(); }
  std::string key() const override { return streamKey(scene_, options_); }
  StreamAttributes attributes() const override {
    StreamAttributes a;
    a.colors = !colors_.empty();
    for (const Batch& b : batches_) {
      a.normals |= b.normals;
      a.texCoords |= b.texCoords;
    }
    return a;
  }
  std::uint64_t residentBytes() const override {
    return runs_.size() * sizeof(Run) + batches_.size() * sizeof(Batch) +
           smoothVertices_.residentBytes();
  }

  void batch(std::uint64_t number, TriangleBatch& out) const override {
    out.clear();
    out.origin = bounds_.empty() ? dvec3(0.0) : bounds_.centre();
    const Batch& from = batches_[number];
    std::size_t run = from.run;
    for (std::uint64_t t = from.first; t < from.end; ++t) {
      while (run + 1 < runs_.size() && runs_[run + 1].first <= t) ++run;
      addTriangle(triangles_[t], from, out);
      const ObjGroup& group = runs_[run].group;
      const auto material = static_cast<std::uint32_t>(group.material);
      const auto object = static_cast<std::uint32_t>(group.object);
      const bool same = !out.runs.empty() && out.runs.back().material == material &&
                        out.runs.back().object == object;
      if (!same) out.runs.push_back({material, object, 0});
      ++out.runs.back().triangles;
    }
    if (++reads_ % kForget == 0) forget();
  }

 private:
  using Triangle = std::array<ObjCorner, 3>;
  /// Triangles from `first` on are of one group.
  struct Run {
    ObjGroup group;
    std::uint64_t first;
  };
  struct Batch {
    std::uint64_t first, end;
    std::size_t run;  ///< of the first
    bool normals, texCoords;
  };
  static constexpr std::uint64_t kForget = 16;  ///< batches between two of forget()

  void take(const ObjGroup& group, std::span<const ObjCorner> corners,
            std::span<const glm::uvec3> triangles) override {
    if (runs_.empty() || runs_.back().group != group) {
      runs_.push_back({group, triangles_.size()});
      anyTexCoord_ = &texCoordsIn_[group];
    }
    for (const ObjCorner& c : corners) *anyTexCoord_ |= c[1] >= 0;
    for (const glm::uvec3& t : triangles) {
      triangles_.push_back({corners[t.x], corners[t.y], corners[t.z]});
    }
  }

  bool texCoordsOf(const ObjGroup& group) const {
    return texCoordsIn_.at(group) && readsTexCoords(scene_.materials[group.material]);
  }
  std::uint64_t endOf(std::size_t run) const {
    return run + 1 < runs_.size() ? runs_[run + 1].first : triangles_.size();
  }

  /// Lamps are needed as meshes too; others stay empty.
  Mesh emittingMesh(const ObjGroup& group) {
    if (!scene_.materials[group.material].emits()) return {};
    CornerTable<3> table;
    std::vector<glm::uvec3> triangles;
    for (std::size_t r = 0; r < runs_.size(); ++r) {
      if (runs_[r].group != group) continue;
      for (std::uint64_t t = runs_[r].first; t < endOf(r); ++t) {
        const Triangle& corners = triangles_[t];
        triangles.push_back(
            {table.indexOf(corners[0]), table.indexOf(corners[1]), table.indexOf(corners[2])});
      }
    }
    return meshOf(group, table.corners(), std::move(triangles), texCoordsOf(group));
  }

  /// Runs of the same attributes together, up to a batch's size.
  void makeBatches() {
    for (std::size_t r = 0; r < runs_.size(); ++r) {
      const bool uv = texCoordsOf(runs_[r].group);
      std::uint64_t first = runs_[r].first;
      while (first < endOf(r)) {
        const bool goesOn = !batches_.empty() && batches_.back().texCoords == uv &&
                            batches_.back().normals == runs_[r].group.normals &&
                            batches_.back().end - batches_.back().first < kBatchTriangles;
        if (!goesOn) batches_.push_back({first, first, r, runs_[r].group.normals, uv});
        Batch& b = batches_.back();
        b.end = std::min<std::uint64_t>(endOf(r), b.first + kBatchTriangles);
        first = b.end;
      }
    }
  }

  dvec3 position(const ObjCorner& c) const {
    return placed_.point(frame_.origin() + dvec3(positions_[c[0]]));
  }

  void addTriangle(const Triangle& triangle, const Batch& kind, TriangleBatch& out) const {
    for (const ObjCorner& c : triangle) {
      out.positions.push_back(vec3(position(c) - out.origin));
      if (kind.normals) out.normals.push_back(placed_.direction(normalOf(c)));
      if (kind.texCoords) {
        const vec2 uv = texCoordOf(c);
        out.texCoords.push_back(std::isfinite(uv.x) && std::isfinite(uv.y) ? uv : vec2(0.0f));
      }
      if (!colors_.empty()) out.colors.push_back(colors_[c[0]]);
    }
    if (kind.normals) repairNormals(out);
  }

  void measure() {
    for (std::uint64_t t = 0; t < triangles_.size(); ++t) {
      for (const ObjCorner& c : triangles_[t]) {
        const dvec3 p = position(c);
        if (isFinite(vec3(p))) bounds_.extend(p);
      }
      if (t % (std::uint64_t{1} << 18) == 0) forget();
    }
    forget();
  }

  void forget() const {
    positions_.forget();
    normals_.forget();
    texCoords_.forget();
    colors_.forget();
    madeNormals_.forget();
    triangles_.forget();
  }

  ImportOptions options_;
  Placement placed_;
  GrowingArray<Triangle> triangles_;
  std::vector<Run> runs_;
  std::vector<Batch> batches_;
  std::map<ObjGroup, bool> texCoordsIn_;  ///< whether any corner of a group has them
  bool* anyTexCoord_ = nullptr;           ///< of the last run's
  Box3d bounds_;
  mutable std::atomic<std::uint64_t> reads_{0};
};

}  // namespace

std::unique_ptr<TriangleStream> openObjStream(const std::filesystem::path& path,
                                              const ImportOptions& options) {
  if (lowerExtension(path) != ".obj" || !std::filesystem::is_regular_file(path)) return nullptr;
  return std::make_unique<ObjStream>(path, options);
}

}  // namespace trex::detail
