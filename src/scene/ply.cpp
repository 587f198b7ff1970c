// A streaming reader of PLY: polygons and strips, attributes of vertices, faces and wedges.
#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <map>

#include "src/core/memory.h"
#include "src/scene/corner_table.h"
#include "src/scene/import_detail.h"
#include "src/scene/ply_rows.h"
#include "src/scene/polygon.h"
#include "src/scene/splats.h"
#include "src/scene/texture_file.h"

namespace trex::detail {
namespace {

/// Triangles of one texture whose corners have values of their own: vertex, colour, u, v.
struct Part {
  CornerTable<4> table;
  std::vector<glm::uvec3> triangles;
};

class PlyReader {
 public:
  PlyReader(const std::filesystem::path& path, const ImportOptions& options)
      : file_(path), path_(path), options_(options) {
    scene_.textures = options.textures;
  }

  Scene read() {
    const bool ahead = facesComeFirst();
    if (ahead) {
      readElements([](const PlyElement& e) { return e.name == "vertex"; });
      file_ = PlyFile(path_);
    }
    readElements([&](const PlyElement& e) { return !ahead || e.name != "vertex"; });
    return finish();
  }

 private:
  template <typename... Args>
  void replace(std::uint64_t parts, fmt::format_string<Args...> format, Args&&... args) {
    if (parts == 0) return;
    scene_.replaced.add(
        fmt::format("{}: {}", file_.name(), fmt::format(format, std::forward<Args>(args)...)),
        parts);
  }

  /// Whether what joins vertices stands before them: they are read ahead then.
  bool facesComeFirst() const {
    for (const PlyElement& element : file_.elements()) {
      if (element.name == "vertex") return false;
      if ((element.name == "face" || element.name == "tristrips") && element.count > 0) return true;
    }
    return false;
  }

  template <typename Wanted>
  void readElements(const Wanted& wanted) {
    for (const PlyElement& element : file_.elements()) {
      file_.checkCount(element);
      if (!wanted(element)) {
        file_.skip(element);
      } else if (element.name == "vertex") {
        readVertices(element);
      } else if (element.name == "face") {
        readFaces(element);
      } else if (element.name == "tristrips") {
        readStrips(element);
      } else {
        if (element.count > 0) {
          scene_.warnings.push_back(
              fmt::format("{}: element {} is left out", file_.name(), element.name));
        }
        file_.skip(element);
      }
    }
  }

  void readVertices(const PlyElement& element) {
    PlyRow row(element);
    if (!(row.has[kX] && row.has[kY] && row.has[kZ])) file_.bad("element vertex has no x, y and z");
    const bool normals = row.normals();
    const bool uv = row.texCoords();
    mesh_.positions.reserve(element.count);
    if (normals) mesh_.normals.reserve(element.count);
    if (uv) mesh_.texCoords.reserve(element.count);
    if (row.colors()) mesh_.colors.reserve(element.count);
    // Text has as many digits as it likes, so it is treated like doubles.
    const bool wide = row.wide || file_.isText();
    const auto& value = row.value;
    for (std::uint64_t i = 0; i < element.count; ++i) {
      row.read(file_);
      const dvec3 p(value[kX], value[kY], value[kZ]);
      mesh_.positions.push_back(wide ? frame_.toLocal(p) : vec3(p));
      if (normals) mesh_.normals.push_back(vec3(value[kNx], value[kNy], value[kNz]));
      if (uv) mesh_.texCoords.push_back(vec2(value[kU], 1.0 - value[kV]));
      if (row.colors()) mesh_.colors.push_back(row.color());
    }
    tellBright(scene_, file_.name(), row);
  }

  void readFaces(const PlyElement& element) {
    PlyFaceRow face(element);
    if (face.indices == PlyFaceRow::kAbsent) file_.bad("element face has no list vertex_indices");
    if (!isInteger(element.properties[face.indices].type)) {
      file_.bad("vertex_indices must be integers");
    }
    const bool wedges = options_.loadTextures && face.texCoords != PlyFaceRow::kAbsent &&
                        !file_.textureFiles().empty();
    const bool ownCorners = wedges || face.row.colors();
    mesh_.triangles.reserve(std::min<std::uint64_t>(element.count, file_.remaining() / 4));
    for (std::uint64_t i = 0; i < element.count; ++i) {
      readFace(face, wedges);
      if (!checkFace(i)) continue;
      ownCorners ? addOwnCorners(face, wedges) : addShared();
    }
    tellBright(scene_, file_.name(), face.row);
    replace(smallFaces_, "{} faces with fewer than 3 corners are left out", smallFaces_);
    replace(badFaces_, "{}; {} such faces are left out", firstBadFace_, badFaces_);
    replace(crossedFaces_, "{} faces cross themselves; fans of triangles are used", crossedFaces_);
  }

  void readFace(PlyFaceRow& face, bool wedges) {
    corners_.clear();
    wedges_.clear();
    texture_ = 0;
    for (std::size_t k = 0; k < face.row.slots.size(); ++k) {
      const PlyProperty& property = face.row.properties[k];
      if (k == face.indices) {
        readList(property, [&](double v) { corners_.push_back(v); });
      } else if (wedges && k == face.texCoords) {
        readList(property, [&](double v) { wedges_.push_back(static_cast<float>(v)); });
      } else if (wedges && k == face.number) {
        const double number = file_.scalar(property.type);
        const bool known = number >= 0.0 && number < double(file_.textureFiles().size());
        texture_ = known ? static_cast<int>(number) : 0;
      } else if (face.row.slots[k] >= kRed && face.row.slots[k] <= kAlpha) {
        face.row.value[face.row.slots[k]] = file_.scalar(property.type);
      } else {
        file_.skip(property);
      }
    }
  }

  template <typename Use>
  void readList(const PlyProperty& property, Use use) {
    const std::uint64_t count = file_.listCount(property);
    for (std::uint64_t i = 0; i < count; ++i) use(file_.scalar(property.type));
  }

  bool inRange(double index) const {
    return index >= 0.0 && index < static_cast<double>(mesh_.positions.size()) &&
           index == std::floor(index);
  }

  /// Whether the face that was read can be shown.
  bool checkFace(std::uint64_t face) {
    if (corners_.size() < 3) {
      ++smallFaces_;
      return false;
    }
    for (const double index : corners_) {
      if (inRange(index)) continue;
      if (badFaces_++ == 0) {
        firstBadFace_ = fmt::format("face {} refers to vertex {}, but there are {}", face, index,
                                    mesh_.positions.size());
      }
      return false;
    }
    return true;
  }

  std::span<const glm::uvec3> cutFace() {
    points_.clear();
    if (corners_.size() > 3) {
      for (const double c : corners_) {
        points_.push_back(dvec3(mesh_.positions[static_cast<std::size_t>(c)]));
      }
    } else {
      points_.resize(3);
    }
    const auto triangles = cutter_.cut(points_);
    crossedFaces_ += cutter_.failed();
    if (mesh_.triangles.size() + triangles.size() > kMaxElements) file_.bad("too many triangles");
    return triangles;
  }

  void addShared() {
    const auto at = [&](std::uint32_t corner) {
      return static_cast<std::uint32_t>(corners_[corner]);
    };
    for (const glm::uvec3& t : cutFace()) {
      mesh_.triangles.push_back({at(t.x), at(t.y), at(t.z)});
    }
  }

  /// Corners of the face have its colour, and texture coordinates of their own.
  void addOwnCorners(PlyFaceRow& face, bool wedges) {
    Part& part = parts_[texture_];
    const auto triangles = cutFace();
    std::int32_t color = -1;
    if (face.row.colors()) {
      const glm::u8vec4 c = face.row.color();
      color = std::bit_cast<std::int32_t>(std::array{c.x, c.y, c.z, c.w});
    }
    numbers_.clear();
    for (std::size_t i = 0; i < corners_.size(); ++i) {
      const auto vertex = static_cast<std::uint32_t>(corners_[i]);
      vec2 uv(0.0f);
      if (wedges && 2 * i + 1 < wedges_.size()) uv = {wedges_[2 * i], 1.0f - wedges_[2 * i + 1]};
      numbers_.push_back(part.table.indexOf({static_cast<std::int32_t>(vertex), color,
                                             std::bit_cast<std::int32_t>(uv.x),
                                             std::bit_cast<std::int32_t>(uv.y)}));
    }
    for (const glm::uvec3& t : triangles) {
      part.triangles.push_back({numbers_[t.x], numbers_[t.y], numbers_[t.z]});
    }
    partsHaveColors_ = partsHaveColors_ || face.row.colors();
    partsHaveTexCoords_ = partsHaveTexCoords_ || wedges;
  }

  /// Strips of triangles, each turned the other way around; -1 begins anew.
  void readStrips(const PlyElement& element) {
    const auto list = std::find_if(element.properties.begin(), element.properties.end(),
                                   [](const PlyProperty& p) { return p.isList; });
    if (list == element.properties.end() || !isInteger(list->type)) {
      file_.bad("element tristrips has no list of integers");
    }
    std::uint64_t bad = 0;
    for (std::uint64_t i = 0; i < element.count; ++i) {
      for (const PlyProperty& property : element.properties) {
        if (&property != &*list) {
          file_.skip(property);
          continue;
        }
        corners_.clear();
        readList(property, [&](double v) {
          if (v != -1.0) return addToStrip(v, bad);
          corners_.clear();
        });
      }
    }
    replace(bad, "{} triangles of strips refer to vertices that do not exist; they are left out",
            bad);
  }

  void addToStrip(double index, std::uint64_t& bad) {
    corners_.push_back(index);
    const std::size_t n = corners_.size();
    if (n < 3) return;
    std::array<double, 3> t = {corners_[n - 3], corners_[n - 2], corners_[n - 1]};
    if (n % 2 == 0) std::swap(t[0], t[1]);
    if (t[0] == t[1] || t[1] == t[2] || t[2] == t[0]) return;  // joins strips
    if (!std::all_of(t.begin(), t.end(), [&](double v) { return inRange(v); })) {
      ++bad;
    } else if (mesh_.triangles.size() >= kMaxElements) {
      file_.bad("too many triangles");
    } else {
      mesh_.triangles.push_back({static_cast<std::uint32_t>(t[0]), static_cast<std::uint32_t>(t[1]),
                                 static_cast<std::uint32_t>(t[2])});
    }
  }

  /// A mesh of the triangles of one texture.
  Mesh meshOf(Part& part) const {
    Mesh mesh;
    mesh.triangles = std::move(part.triangles);
    for (const auto& corner : part.table.corners()) {
      const auto vertex = static_cast<std::uint32_t>(corner[0]);
      mesh.positions.push_back(mesh_.positions[vertex]);
      if (!mesh_.normals.empty()) mesh.normals.push_back(mesh_.normals[vertex]);
      if (partsHaveTexCoords_) {
        mesh.texCoords.push_back(
            {std::bit_cast<float>(corner[2]), std::bit_cast<float>(corner[3])});
      } else if (!mesh_.texCoords.empty()) {
        mesh.texCoords.push_back(mesh_.texCoords[vertex]);
      }
      if (partsHaveColors_) {
        const auto c = std::bit_cast<std::array<std::uint8_t, 4>>(corner[1]);
        mesh.colors.emplace_back(c[0], c[1], c[2], c[3]);
      } else if (!mesh_.colors.empty()) {
        mesh.colors.push_back(mesh_.colors[vertex]);
      }
    }
    return mesh;
  }

  void add(Mesh mesh, int texture) {
    Material material = defaultMaterial();
    const auto& files = file_.textureFiles();
    if (options_.loadTextures && !mesh.texCoords.empty() && std::size_t(texture) < files.size()) {
      material.baseColorTexture.image =
          imageOfFile(scene_, path_.parent_path(), files[texture], true, file_.name() + ": texture",
                      "it is left out");
    }
    if (!mesh.colors.empty() || material.textured()) material.baseColor = vec4(1.0f);
    mesh.name = scene_.objects[0];
    mesh.origin = frame_.origin();
    mesh.material = static_cast<int>(scene_.materials.size());
    scene_.materials.push_back(std::move(material));
    sanitiseMesh(scene_, mesh, file_.name());
    Instance instance;
    instance.name = mesh.name;
    instance.mesh = static_cast<int>(scene_.meshes.size());
    scene_.meshes.push_back(std::move(mesh));
    scene_.instances.push_back(std::move(instance));
  }

  void finishCloud() {
    const std::size_t points = mesh_.positions.size();
    if (!(options_.pointSize > 0.0)) {
      return tellPoints(scene_, file_.name(), points, "--point-size METRES shows them");
    }
    const Splats splats(options_.pointSize / options_.unit, !mesh_.normals.empty());
    if (points > kMaxElements / splats.corners()) file_.bad("too many points");
    const std::uint64_t needed = points * (splats.corners() * (sizeof(vec3) + sizeof(glm::u8vec4)) +
                                           splats.triangles().size() * sizeof(glm::uvec3));
    if (const std::uint64_t left = leftBytes(options_.maxMemory); needed > left) {
      fail(ExitCode::kMemoryOrDevice,
           "{}: {} points need {} of memory, {} are left; make --max-memory larger, or trex bake "
           "--stream it to a bundle, which is read in parts",
           file_.name(), points, formatBytes(needed), formatBytes(left));
    }
    Mesh made;
    for (std::size_t i = 0; i < points; ++i) {
      const auto corners = splats.around(mesh_.normals.empty() ? vec3(0.0f) : mesh_.normals[i]);
      const auto first = static_cast<std::uint32_t>(made.positions.size());
      for (const glm::uvec3& t : splats.triangles()) made.triangles.push_back(first + t);
      for (std::uint32_t c = 0; c < splats.corners(); ++c) {
        made.positions.push_back(mesh_.positions[i] + corners[c]);
        if (!mesh_.colors.empty()) made.colors.push_back(mesh_.colors[i]);
      }
    }
    mesh_ = std::move(made);
    scene_.warnings.push_back(
        fmt::format("{}: {}", file_.name(), splats.describe(points, options_.pointSize)));
  }

  Scene finish() {
    scene_.objects.push_back(path_.stem().string());
    if (file_.badNumbers() > 0) {
      replace(file_.badNumbers(), "{} is not a number; not-a-number is used",
              file_.firstBadNumber());
    }
    if (mesh_.triangles.empty() && parts_.empty() && !mesh_.positions.empty()) {
      finishCloud();
    } else if (options_.pointSize > 0.0) {
      scene_.warnings.push_back(file_.name() + Splats::kNoCloud);
    }
    for (auto& [texture, part] : parts_) {
      if (!part.triangles.empty()) add(meshOf(part), texture);
    }
    if (!mesh_.triangles.empty() || parts_.empty()) add(std::move(mesh_), 0);
    return std::move(scene_);
  }

  PlyFile file_;
  std::filesystem::path path_;
  const ImportOptions& options_;
  Scene scene_;
  Mesh mesh_;  ///< all vertices, and the triangles that share them
  std::map<int, Part> parts_;
  bool partsHaveColors_ = false, partsHaveTexCoords_ = false;
  LocalFrame frame_;
  // Of the face under way.
  std::vector<double> corners_;
  std::vector<float> wedges_;
  int texture_ = 0;
  std::vector<dvec3> points_;
  std::vector<std::uint32_t> numbers_;
  PolygonCutter cutter_;
  std::uint64_t smallFaces_ = 0, badFaces_ = 0, crossedFaces_ = 0;
  std::string firstBadFace_;
};

}  // namespace

Scene readPly(const std::filesystem::path& path, const ImportOptions& options) {
  return PlyReader(path, options).read();
}

}  // namespace trex::detail
