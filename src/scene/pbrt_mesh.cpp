#include "src/scene/pbrt_mesh.h"

#include <algorithm>
#include <cmath>
#include <glm/gtc/matrix_transform.hpp>

#include "src/scene/import_detail.h"
#include "src/scene/texture_file.h"

namespace trex::detail {
namespace {

using Numbers = std::span<const double>;

Numbers firstOf(const PbrtParameters& p, std::initializer_list<std::string_view> names) {
  for (const std::string_view name : names) {
    if (p.find(name) != nullptr) return p.numbers(name);
  }
  return {};
}

vec3 faceNormal(const Mesh& mesh, const glm::uvec3& t) {
  const vec3& a = mesh.positions[t.x];
  return glm::cross(mesh.positions[t.y] - a, mesh.positions[t.z] - a);
}

/// Turns faces to where pbrt's normals point.
void orient(Mesh& mesh, const PbrtFaces& faces) {
  if (faces.reverse && mesh.normals.empty()) {
    for (glm::uvec3& t : mesh.triangles) std::swap(t.y, t.z);
  }
  if (faces.reverse && faces.version4) {
    for (vec3& n : mesh.normals) n = -n;
  }
  if (mesh.normals.empty()) return;
  for (glm::uvec3& t : mesh.triangles) {
    const vec3 mean = mesh.normals[t.x] + mesh.normals[t.y] + mesh.normals[t.z];
    if (glm::dot(faceNormal(mesh, t), mean) < 0.0f) std::swap(t.y, t.z);
  }
}

/// Corners as they are given, checked: P, N, uv.
class Corners {
 public:
  Corners(PbrtContext& context, const PbrtParameters& p)
      : context_(context),
        points_(p.numbers("P")),
        normals_(firstOf(p, {"N"})),
        uvs_(firstOf(p, {"uv", "st"})) {
    check(normals_, 3, "N");
    check(uvs_, 2, "uv");
  }
  std::size_t count() const { return points_.size() / 3; }
  bool hasNormals() const { return !normals_.empty(); }
  bool hasUvs() const { return !uvs_.empty(); }
  dvec3 point(std::size_t i) const {
    return {points_[3 * i], points_[3 * i + 1], points_[3 * i + 2]};
  }
  dvec3 normal(std::size_t i) const {
    return {normals_[3 * i], normals_[3 * i + 1], normals_[3 * i + 2]};
  }
  glm::dvec2 uv(std::size_t i) const { return {uvs_[2 * i], uvs_[2 * i + 1]}; }

  void fill(Mesh& mesh) const {
    LocalFrame frame;
    for (std::size_t i = 0; i < count(); ++i) {
      mesh.positions.push_back(frame.toLocal(point(i)));
      if (hasNormals()) mesh.normals.push_back(vec3(normal(i)));
      if (hasUvs()) mesh.texCoords.push_back(vec2(uv(i).x, 1.0 - uv(i).y));
    }
    mesh.origin = frame.origin();
  }

 private:
  void check(Numbers& values, std::size_t each, const char* name) {
    if (values.empty() || values.size() == each * count()) return;
    context_.replace("'{}' has {} numbers, not {}; it is left out", name, values.size(),
                     each * count());
    values = {};
  }

  PbrtContext& context_;
  Numbers points_, normals_, uvs_;
};

/// Calls add(corners) for each `size` indices that are in range; says how many are not.
template <typename Add>
void forFaces(PbrtContext& context, const PbrtParameters& p, std::size_t size, std::size_t vertices,
              Add add) {
  const Numbers indices = firstOf(p, {"indices"});
  const bool implied = p.find("indices") == nullptr;
  if (implied && vertices != size) {
    context.replace("has {} vertices and no indices; it is left out", vertices);
    return;
  }
  const std::size_t faces = implied ? 1 : indices.size() / size;
  std::array<std::uint32_t, 4> corners{};
  std::uint64_t bad = implied || indices.size() % size == 0 ? 0 : 1;
  for (std::size_t f = 0; f < faces; ++f) {
    bool good = true;
    for (std::size_t k = 0; k < size; ++k) {
      const double index = implied ? static_cast<double>(k) : indices[f * size + k];
      good = good && index >= 0.0 && index < static_cast<double>(vertices);
      corners[k] = good ? static_cast<std::uint32_t>(index) : 0;
    }
    if (good) {
      add(corners);
    } else {
      ++bad;
    }
  }
  if (bad > 0) {
    context.replace("{} faces are not of {} vertices that exist; they are left out", bad, size);
  }
}

Mesh triangleMesh(PbrtContext& context, const PbrtParameters& p) {
  Mesh mesh;
  const Corners corners(context, p);
  p.ignore({"S", "faceIndices", "nlevels"});
  if (corners.count() > kMaxElements) {
    context.replace("has too many vertices; it is left out");
    return mesh;
  }
  corners.fill(mesh);
  forFaces(context, p, 3, corners.count(), [&](const std::array<std::uint32_t, 4>& c) {
    mesh.triangles.push_back({c[0], c[1], c[2]});
  });
  return mesh;
}

/// Pieces a side that show a patch to a thousandth of its size.
int piecesOf(const std::array<dvec3, 4>& p, bool textured) {
  const dvec3 twist = 0.25 * (p[0] - p[1] - p[2] + p[3]);
  const dvec3 along = p[1] - p[0] + p[3] - p[2], across = p[2] - p[0] + p[3] - p[1];
  const double size = glm::length(along) + glm::length(across);
  const dvec3 normal = glm::cross(along, across);
  const double area = glm::length(normal);
  const double off =
      textured || !(area > 0.0) ? glm::length(twist) : std::abs(glm::dot(twist, normal / area));
  if (!(off > 1e-6 * size)) return 1;
  return static_cast<int>(std::clamp(std::ceil(std::sqrt(off / (5e-4 * size))), 1.0, 16.0));
}

/// Corners of a patch are p00, p10, p01, p11: u runs from the first to the second.
class Patches {
 public:
  Patches(PbrtContext& context, const PbrtParameters& p, bool textured)
      : context_(context), corners_(context, p), textured_(textured) {
    forFaces(context, p, 4, corners_.count(),
             [&](const std::array<std::uint32_t, 4>& c) { add(c); });
    mesh_.origin = frame_.origin();
  }
  Mesh take() { return std::move(mesh_); }

 private:
  template <typename T>
  static T at(const std::array<T, 4>& c, double u, double v) {
    return (1.0 - v) * ((1.0 - u) * c[0] + u * c[1]) + v * ((1.0 - u) * c[2] + u * c[3]);
  }

  void add(const std::array<std::uint32_t, 4>& c) {
    std::array<dvec3, 4> points, normals;
    std::array<glm::dvec2, 4> uvs = {{{0, 0}, {1, 0}, {0, 1}, {1, 1}}};
    for (std::size_t k = 0; k < 4; ++k) {
      points[k] = corners_.point(c[k]);
      if (corners_.hasNormals()) normals[k] = corners_.normal(c[k]);
      if (corners_.hasUvs()) uvs[k] = corners_.uv(c[k]);
    }
    const int n = piecesOf(points, textured_);
    const auto first = static_cast<std::uint32_t>(mesh_.positions.size());
    if (mesh_.positions.size() + std::size_t(n + 1) * (n + 1) > kMaxElements) {
      fail(ExitCode::kInput, "{}: too many patches", context_.where());
    }
    for (int j = 0; j <= n; ++j) {
      for (int i = 0; i <= n; ++i) {
        const double u = double(i) / n, v = double(j) / n;
        mesh_.positions.push_back(frame_.toLocal(at(points, u, v)));
        if (corners_.hasNormals()) mesh_.normals.push_back(vec3(at(normals, u, v)));
        const glm::dvec2 uv = at(uvs, u, v);
        if (textured_) mesh_.texCoords.push_back(vec2(uv.x, 1.0 - uv.y));
      }
    }
    const auto vertex = [&](int i, int j) {
      return first + static_cast<std::uint32_t>(j * (n + 1) + i);
    };
    for (int j = 0; j < n; ++j) {
      for (int i = 0; i < n; ++i) {
        mesh_.triangles.push_back({vertex(i, j), vertex(i + 1, j), vertex(i + 1, j + 1)});
        mesh_.triangles.push_back({vertex(i, j), vertex(i + 1, j + 1), vertex(i, j + 1)});
      }
    }
  }

  PbrtContext& context_;
  Corners corners_;
  bool textured_;
  LocalFrame frame_;
  Mesh mesh_;
};

/// Gives each triangle corners and texture coordinates of its own, as pbrt has them by default:
/// (0, 0), (1, 0), (1, 1).
void addDefaultTexCoords(Mesh& mesh) {
  Mesh apart;
  for (const glm::uvec3& t : mesh.triangles) {
    const auto first = static_cast<std::uint32_t>(apart.positions.size());
    for (int k = 0; k < 3; ++k) {
      apart.positions.push_back(mesh.positions[t[k]]);
      if (!mesh.normals.empty()) apart.normals.push_back(mesh.normals[t[k]]);
      apart.texCoords.push_back(vec2(k == 0 ? 0.0f : 1.0f, k == 2 ? 0.0f : 1.0f));
    }
    apart.triangles.push_back({first, first + 1, first + 2});
  }
  mesh.positions = std::move(apart.positions);
  mesh.normals = std::move(apart.normals);
  mesh.texCoords = std::move(apart.texCoords);
  mesh.triangles = std::move(apart.triangles);
}

}  // namespace

bool isPbrtQuadric(const std::string& kind) {
  return kind == "sphere" || kind == "disk" || kind == "cylinder";
}

std::optional<PbrtQuadric> pbrtQuadric(PbrtContext& context, const std::string& kind,
                                       const PbrtParameters& p) {
  const double radius = p.number("radius", 1.0);
  if (!(radius > 0.0)) {
    context.replace("its radius of {} is not above 0; it is left out", radius);
    return {};
  }
  PbrtQuadric made;
  made.kind = kind;
  made.placement = glm::scale(dmat4(1.0), dvec3(radius));
  made.part.phiMax = glm::radians(std::clamp(p.number("phimax", 360.0), 0.0, 360.0));
  if (kind == "disk") {
    made.placement[3][2] = p.number("height", 0.0);
    made.innerRadius = p.number("innerradius", 0.0) / radius;
    return made;
  }
  const double most = kind == "sphere" ? radius : 1.0;
  const double low = p.number("zmin", -most), high = p.number("zmax", most);
  made.part.zMin = std::min(low, high) / radius;
  made.part.zMax = std::max(low, high) / radius;
  return made;
}

std::string PbrtQuadric::key() const {
  return fmt::format("{} {} {} {} {}", kind, part.zMin, part.zMax, part.phiMax, innerRadius);
}

Mesh PbrtQuadric::mesh(bool reverse, double error) const {
  Mesh mesh = kind == "sphere" ? sphereMesh(part, error)
              : kind == "disk" ? diskMesh(1.0, innerRadius, 0.0, part.phiMax, error)
                               : cylinderMesh(part, error);
  for (vec2& uv : mesh.texCoords) uv.y = 1.0f - uv.y;
  orient(mesh, {.reverse = reverse, .version4 = true});
  return mesh;
}

std::optional<Mesh> pbrtMesh(PbrtContext& context, const std::string& kind,
                             const PbrtParameters& parameters, const PbrtFaces& faces) {
  Mesh mesh;
  if (kind == "trianglemesh") {
    mesh = triangleMesh(context, parameters);
    if (faces.textured && mesh.texCoords.empty()) addDefaultTexCoords(mesh);
  } else if (kind == "bilinearmesh") {
    mesh = Patches(context, parameters, faces.textured).take();
  } else {
    context.replace("shapes of this kind are not shown; it is left out");
    return {};
  }
  if (mesh.triangles.empty()) {
    context.replace("has no triangle; it is left out");
    return {};
  }
  orient(mesh, faces);
  return mesh;
}

std::optional<Mesh> pbrtPlyMesh(PbrtContext& context, const std::string& file,
                                const PbrtFaces& faces) {
  const std::filesystem::path path = findFile(context.folder, file);
  Scene read;
  try {
    ImportOptions options;
    options.loadTextures = false;
    read = readPly(path, options);
  } catch (const Error& e) {
    if (e.code() != ExitCode::kInput) throw;
    context.replace("{}; it is left out", e.what());
    return {};
  }
  context.note(path);
  for (const std::string& text : read.replaced.texts) context.scene.replaced.add(text);
  context.scene.droppedTriangles += read.droppedTriangles;
  if (read.meshes.empty() || read.meshes[0].triangles.empty()) {
    context.replace("{} has no triangle; it is left out", path.string());
    return {};
  }
  Mesh mesh = std::move(read.meshes[0]);
  mesh.colors.clear();
  mesh.material = 0;
  if (faces.textured && mesh.texCoords.empty()) addDefaultTexCoords(mesh);
  orient(mesh, faces);
  return mesh;
}

}  // namespace trex::detail
