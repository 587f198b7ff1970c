// PLY files of positions, normals and colours as streams: a binary file is mapped, what is made of
// others lies in a temporary file. Those with more in them are left to the importer.
#include <algorithm>
#include <atomic>
#include <bit>
#include <cstring>
#include <fstream>
#include <optional>
#include <sstream>

#include "src/scene/import_detail.h"
#include "src/scene/mapped_file.h"
#include "src/scene/ply_layout.h"
#include "src/scene/polygon.h"
#include "src/scene/splats.h"
#include "src/scene/streamed.h"

namespace trex::detail {
namespace {

/// Which of some names this is, or -1.
int indexOf(const std::string& name, std::initializer_list<const char*> names) {
  const auto at = std::find(names.begin(), names.end(), name);
  return at == names.end() ? -1 : static_cast<int>(at - names.begin());
}

/// Takes a property of a vertex. False if the importer would show more of it than a stream can.
bool takeProperty(const std::string& type, const std::string& name, std::size_t bytes, int* found,
                  PlyLayout& out) {
  const bool single = type == "float" || type == "float32";
  const bool byte = type == "uchar" || type == "uint8";
  if (indexOf(name, {"s", "u", "texture_u", "diffuse_red", "r"}) >= 0) return false;
  if (const int k = indexOf(name, {"x", "y", "z"}); k >= 0) {
    if (!single) return false;
    out.place[k] = out.stride, ++found[0];
  } else if (const int n = indexOf(name, {"nx", "ny", "nz"}); n >= 0) {
    if (!single) return false;
    out.normal[n] = out.stride, ++found[1];
  } else if (const int c = indexOf(name, {"red", "green", "blue", "alpha"}); c >= 0) {
    if (!byte) return false;
    out.color[c] = out.stride;
    ++(c < 3 ? found[2] : found[3]);
  }
  out.stride += bytes;
  return bytes > 0;
}

std::size_t sizeOfType(const std::string& type) {
  if (type == "char" || type == "uchar" || type == "int8" || type == "uint8") return 1;
  if (type == "short" || type == "ushort" || type == "int16" || type == "uint16") return 2;
  if (type == "double" || type == "float64") return 8;
  return type == "int" || type == "uint" || type == "int32" || type == "uint32" ||
                 type == "float" || type == "float32"
             ? 4
             : 0;
}

/// False for anything but little endian bytes, x y z and normals of floats, colours of bytes, no
/// texture coordinates, and faces of nothing but a list of u8 and 32-bit integers; or, with
/// `clouds`, no faces.
bool readLayout(const std::filesystem::path& path, bool clouds, PlyLayout& out) {
  std::ifstream in(path, std::ios::binary);
  std::string line, section;
  int found[4] = {}, lists = 0;  // coordinates, of normals, channels, alpha
  bool binary = false;
  for (int lines = 0; std::getline(in, line) && lines < 100; ++lines) {
    if (!line.empty() && line.back() == '\r') line.pop_back();
    std::istringstream words(line);
    std::string word, type, name, count;
    words >> word >> type >> name;
    if (lines == 0 && word != "ply") return false;
    if (word == "format") binary = type == "binary_little_endian";
    if (word == "element") {
      std::uint64_t number = 0;
      std::istringstream(name) >> number;
      if (type == "vertex" && section.empty())
        out.vertices = number;
      else if (type == "face" && section == "vertex")
        out.faces = number;
      else
        return false;
      section = type;
    }
    if (word == "property" && section == "vertex") {
      if (!takeProperty(type, name, sizeOfType(type), found, out)) return false;
    }
    if (word == "property" && section == "face") {
      words >> count;
      if (type != "list" || sizeOfType(name) != 1 || sizeOfType(count) != 4) return false;
      if (count.starts_with("float")) return false;
      ++lists;
    }
    if (word == "end_header") {
      const auto at = in.tellg();
      out.cloud = clouds && out.vertices > 0 && out.faces == 0;
      if (!binary || found[0] != 3 || (lists != 1 && !out.cloud) || at < 0) return false;
      out.normals = found[1] == 3, out.colors = found[2] == 3, out.alpha = found[3] == 1;
      out.vertexStart = static_cast<std::size_t>(at);
      return true;
    }
  }
  return false;
}

class PlyStream : public TriangleStream {
 public:
  /// Of a file that is mapped if nothing was made of it. `scene` has what was said of it.
  PlyStream(const std::filesystem::path& path, const PlyLayout& layout,
            GrowingArray<std::uint8_t> converted, Scene scene, const ImportOptions& options)
      : converted_(std::move(converted)),
        layout_(layout),
        options_(options),
        placed_(options),
        scene_(std::move(scene)) {
    if (converted_.empty()) map_ = std::make_unique<MappedFile>(path);
    if (layout_.cloud) splats_.emplace(options.pointSize, layout_.normals);
    beginStreamed(scene_, path);
    if (options.pointSize > 0.0 && !splats_) {
      scene_.warnings.push_back(scene_.source + Splats::kNoCloud);
    }
    measure();
    scene_.materials.push_back(defaultMaterial());
    if (layout_.colors) scene_.materials[0].baseColor = vec4(1.0f);
    scene_.objects.push_back(path.stem().string());
    scene_.meshes.emplace_back().name = scene_.objects[0];
    scene_.instances.emplace_back().name = scene_.objects[0];
    finishStreamed(scene_, options, bounds_);
  }
  const Scene& scene() const override { return scene_; }
  Box3d bounds() const override { return bounds_; }
  std::uint64_t triangleCount() const override { return triangles_; }
  std::uint64_t batchCount() const override { return starts_.size(); }
  std::string key() const override { return streamKey(scene_, options_); }
  StreamAttributes attributes() const override {
    return {.normals = layout_.normals && !splats_, .texCoords = false, .colors = layout_.colors};
  }
  std::uint64_t residentBytes() const override { return starts_.size() * sizeof(Start); }

  void batch(std::uint64_t number, TriangleBatch& out) const override {
    out.clear();
    out.origin = bounds_.empty() ? dvec3(0.0) : bounds_.centre();
    splats_ ? addPoints(number, out) : addFaces(number, out);
    out.runs.push_back({0, 0, out.triangles()});
    if (++reads_ % kForget == 0) forget();
  }

 private:
  static constexpr std::uint64_t kTriangles = 1u << 14;  ///< of a batch, the last face's apart
  static constexpr std::uint64_t kForget = 64;  ///< batches between two of MappedFile::forget()
  struct Start {
    std::size_t byte;
    std::uint64_t face;
  };

  void addFaces(std::uint64_t number, TriangleBatch& out) const {
    std::size_t at = starts_[number].byte;
    const std::uint64_t end =
        number + 1 < starts_.size() ? starts_[number + 1].face : layout_.faces;
    PolygonCutter cutter;
    std::vector<dvec3> points;
    for (std::uint64_t face = starts_[number].face; face < end; ++face) {
      const std::uint32_t corners = cornersAt(at);
      const bool good = cornersExist(at, corners);
      points.assign(good ? corners : 0, dvec3(0.0));
      if (corners > 3) {
        for (std::uint32_t c = 0; c < points.size(); ++c) points[c] = position(indexAt(at, c));
      }
      for (const glm::uvec3& t : cutter.cut(points)) {
        for (int k = 0; k < 3; ++k) add(indexAt(at, t[k]), out);
        if (layout_.normals) repairNormals(out);
      }
      at += layout_.countBytes + 4ull * corners;
    }
  }

  /// From a point to the corners of its splat.
  std::array<vec3, 6> cornersOfSplat(std::uint64_t point) const {
    auto corners =
        splats_->around(layout_.normals ? floats(vertexAt(point), layout_.normal) : vec3(0.0f));
    for (vec3& c : corners) c = placed_.direction(c);
    return corners;
  }
  std::uint64_t pointsOfBatch() const { return kTriangles / splats_->triangles().size(); }
  void addPoints(std::uint64_t number, TriangleBatch& out) const {
    const std::uint64_t first = number * pointsOfBatch();
    const std::uint64_t end = std::min(first + pointsOfBatch(), layout_.vertices);
    for (std::uint64_t point = first; point < end; ++point) {
      const dvec3 centre = position(point) - out.origin;
      const auto corners = cornersOfSplat(point);
      for (const glm::uvec3& t : splats_->triangles()) {
        for (int k = 0; k < 3; ++k) {
          out.positions.push_back(vec3(centre + dvec3(corners[t[k]])));
          if (layout_.colors) out.colors.push_back(color(vertexAt(point)));
        }
      }
    }
  }

  const std::uint8_t* data() const { return map_ ? map_->data() : converted_.data(); }
  std::size_t size() const { return map_ ? map_->size() : converted_.size(); }
  void forget() const { map_ ? map_->forget() : converted_.forget(); }
  /// Corners of the face at a byte.
  std::uint32_t cornersAt(std::size_t at) const {
    std::uint32_t corners = 0;
    std::memcpy(&corners, data() + at, layout_.countBytes);
    return corners;
  }
  const std::uint8_t* vertexAt(std::uint64_t vertex) const {
    return data() + layout_.vertexStart + vertex * layout_.stride;
  }
  static vec3 floats(const std::uint8_t* vertex, const std::size_t* place) {
    vec3 p;
    for (int k = 0; k < 3; ++k) std::memcpy(&p[k], vertex + place[k], sizeof(float));
    return p;
  }
  dvec3 position(std::uint64_t vertex) const {
    const std::uint8_t* at = vertexAt(vertex);
    if (!layout_.wide) return placed_.point(dvec3(floats(at, layout_.place)));
    dvec3 p;
    for (int k = 0; k < 3; ++k) std::memcpy(&p[k], at + layout_.place[k], sizeof(double));
    return placed_.point(p);
  }
  /// As the importer reads them: sRGB, alpha linear.
  glm::u8vec4 color(const std::uint8_t* vertex) const {
    glm::u8vec4 c(255);
    for (int k = 0; k < 3; ++k) c[k] = vertex[layout_.color[k]];
    if (layout_.alpha) c.a = vertex[layout_.color[3]];
    return c;
  }
  /// Vertex of a corner of the face at a byte.
  std::uint32_t indexAt(std::size_t at, std::uint32_t corner) const {
    std::uint32_t index;
    std::memcpy(&index, data() + at + layout_.countBytes + 4ull * corner, sizeof(index));
    return index;
  }
  bool cornersExist(std::size_t at, std::uint32_t corners) const {
    for (std::uint32_t c = 0; c < corners; ++c) {
      if (indexAt(at, c) >= layout_.vertices) return false;
    }
    return true;
  }
  void add(std::uint32_t index, TriangleBatch& out) const {
    const std::uint8_t* vertex = vertexAt(index);
    out.positions.push_back(vec3(position(index) - out.origin));
    if (layout_.normals) out.normals.push_back(placed_.direction(floats(vertex, layout_.normal)));
    if (layout_.colors) out.colors.push_back(color(vertex));
  }

  /// One look over all vertices for the bounds, and over all faces for where they lie.
  void measure() {
    const std::size_t bytes = size();
    const auto cut = [&] { fail(ExitCode::kInput, "{}: the file ends early", scene_.source); };
    if (layout_.vertices > (bytes - layout_.vertexStart) / layout_.stride) cut();
    Box3d box;
    for (std::uint64_t v = 0; v < layout_.vertices; ++v) {
      if (v % (std::uint64_t{1} << 20) == 0) forget();
      const dvec3 p = position(v);
      if (!isFinite(vec3(p))) continue;
      box.extend(p);
      if (splats_) {
        for (const vec3& c : cornersOfSplat(v)) box.extend(p + dvec3(c));
      }
    }
    bounds_ = box;
    if (splats_) return measureSplats();
    std::uint64_t inBatch = 0, badFaces = 0, firstBad = 0, smallFaces = 0;
    std::size_t at = layout_.vertexStart + layout_.vertices * layout_.stride;
    for (std::uint64_t face = 0; face < layout_.faces; ++face) {
      if (face == 0 || inBatch >= kTriangles) {
        starts_.push_back({at, face});
        inBatch = 0;
      }
      if (layout_.countBytes > bytes - at) cut();
      const std::uint32_t corners = cornersAt(at);
      if (4ull * corners > bytes - at - layout_.countBytes) cut();
      const bool good = cornersExist(at, corners);
      if (corners < 3) ++smallFaces;
      if (!good && badFaces++ == 0) firstBad = face;
      const std::uint64_t fan = good && corners > 2 ? corners - 2 : 0;
      triangles_ += fan;
      inBatch += fan;
      at += layout_.countBytes + 4ull * corners;
      if (face % (std::uint64_t{1} << 20) == 0) forget();
    }
    forget();
    if (smallFaces > 0) {
      scene_.replaced.add(fmt::format("{}: {} faces with fewer than 3 corners are left out",
                                      scene_.source, smallFaces),
                          smallFaces);
    }
    if (badFaces == 0) return;
    scene_.replaced.add(
        fmt::format("{}: face {} refers to vertices that are not among the {}; {} such faces are "
                    "left out",
                    scene_.source, firstBad, layout_.vertices, badFaces),
        badFaces);
  }

  void measureSplats() {
    forget();
    triangles_ = layout_.vertices * splats_->triangles().size();
    starts_.resize((layout_.vertices + pointsOfBatch() - 1) / pointsOfBatch());
    scene_.warnings.push_back(fmt::format("{}: {}", scene_.source,
                                          splats_->describe(layout_.vertices, options_.pointSize)));
  }

  std::unique_ptr<MappedFile> map_;
  GrowingArray<std::uint8_t> converted_;
  PlyLayout layout_;
  ImportOptions options_;
  Placement placed_;
  Scene scene_;
  Box3d bounds_;
  std::uint64_t triangles_ = 0;
  std::vector<Start> starts_;
  std::optional<Splats> splats_;  ///< of a cloud
  mutable std::atomic<std::uint64_t> reads_{0};
};

}  // namespace

std::unique_ptr<TriangleStream> openPlyStream(const std::filesystem::path& path,
                                              const ImportOptions& options) {
  static_assert(std::endian::native == std::endian::little);
  PlyLayout layout;
  if (lowerExtension(path) != ".ply" || !std::filesystem::is_regular_file(path)) return nullptr;
  Scene scene;
  GrowingArray<std::uint8_t> converted(scratchFolder(options));
  const bool clouds = options.pointSize > 0.0;
  if (!readLayout(path, clouds, layout)) {
    layout = {};
    if (!convertPly(path, clouds, scene, layout, converted)) return nullptr;
  }
  return std::make_unique<PlyStream>(path, layout, std::move(converted), std::move(scene), options);
}

}  // namespace trex::detail
