#include "src/scene/mitsuba_geometry.h"

#include <algorithm>
#include <glm/gtc/matrix_transform.hpp>
#include <iterator>
#include <numbers>

#include "src/scene/mesh_normals.h"

namespace trex::detail::mitsuba {
namespace {

bool ofFile(std::string_view kind) {
  return kind == "obj" || kind == "ply" || kind == "serialized";
}

/// A frame whose z axis goes along a vector and is as long; the others have the length `radius`.
dmat4 alongAxis(const dvec3& from, const dvec3& to, double radius) {
  const dvec3 axis = to - from;
  const dvec3 z = glm::normalize(axis);
  const dvec3 side = std::abs(z.x) < 0.9 ? dvec3(1.0, 0.0, 0.0) : dvec3(0.0, 1.0, 0.0);
  const dvec3 x = glm::normalize(side - glm::dot(side, z) * z);
  return dmat4(glm::dvec4(radius * x, 0.0), glm::dvec4(radius * glm::cross(z, x), 0.0),
               glm::dvec4(axis, 0.0), glm::dvec4(from, 1.0));
}

/// Triangles turn the way that their normals point.
void turnByNormals(Mesh& mesh) {
  double agreement = 0.0;
  for (const glm::uvec3& t : mesh.triangles) {
    const dvec3 a(mesh.positions[t.x]);
    const dvec3 face = glm::cross(dvec3(mesh.positions[t.y]) - a, dvec3(mesh.positions[t.z]) - a);
    agreement += glm::dot(face, dvec3(mesh.normals[t.x] + mesh.normals[t.y] + mesh.normals[t.z]));
  }
  if (agreement >= 0.0) return;
  for (glm::uvec3& t : mesh.triangles) std::swap(t.y, t.z);
}

void turnOver(Mesh& mesh) {
  for (glm::uvec3& t : mesh.triangles) std::swap(t.y, t.z);
  for (vec3& n : mesh.normals) n = -n;
}

std::vector<Mesh> readFile(Context& context, const Element& at, const Geometry& g) {
  const std::string where = context.document().where(at);
  std::error_code error;
  if (!std::filesystem::is_regular_file(g.file, error)) {
    fail(ExitCode::kInput, "{}: no file {}", where, g.file);
  }
  noteFile(context.scene(), g.file);
  std::vector<Mesh> meshes;
  if (g.kind == "serialized") {
    meshes.push_back(readSerialized(g.file, g.index, where));
    return meshes;
  }
  ImportOptions options;
  options.geometryOnly = true;
  options.loadTextures = false;
  Scene read = g.kind == "obj" ? readObj(g.file, options) : readPly(g.file, options);
  for (const std::string& text : read.replaced.texts) context.scene().replaced.add(text);
  context.scene().droppedTriangles += read.droppedTriangles;
  return std::move(read.meshes);
}

void finish(Context& context, const Element& at, const Geometry& g, Mesh& mesh) {
  if (!g.colored) mesh.colors.clear();
  // Of Mitsuba's files v counts from the top, as here.
  for (vec2& uv : mesh.texCoords) {
    if (g.flipV) uv.y = 1.0f - uv.y;
  }
  if (g.kind == "serialized") {
    sanitiseMesh(context.scene(), mesh, context.document().where(at) + ": " + g.file);
  }
  const bool bare = mesh.normals.empty() || g.faceNormals || g.smoothAngle >= 0.0;
  if (g.faceNormals) {
    mesh.normals.clear();
  } else if (g.smoothAngle >= 0.0) {
    makeNormalsByAngle(mesh, g.smoothAngle);
  } else if (mesh.normals.empty()) {
    makeSmoothNormals(mesh);
  } else {
    turnByNormals(mesh);
  }
  if (bare && g.mirrored) turnOver(mesh);
}

void describeFile(const Properties& shape, Geometry& out) {
  const std::string name = shape.text("filename");
  if (name.empty()) {
    fail(ExitCode::kInput, "{}: shape '{}' without a filename",
         shape.context().document().where(shape.element()), out.kind);
  }
  out.file = shape.context().file(name).string();
  out.faceNormals = shape.flag("face_normals", false);
  const bool obj = out.kind == "obj";
  // Our readers of both turn v; Mitsuba turns that of .obj alone.
  out.flipV = shape.flag("flip_tex_coords", obj) == (out.kind == "serialized");
  if (shape.has("max_smooth_angle")) {
    out.smoothAngle = glm::radians(shape.number("max_smooth_angle", 0.0, 0.0, 180.0));
  }
  out.index = static_cast<std::uint32_t>(shape.number("shape_index", 0.0, 0.0, 4e9));
  shape.ignore({"collapse", "srgb", "load_materials", "merge_vertices"});
}

}  // namespace

void Geometry::setMirrored(bool isMirrored) {
  // A ball that is mirrored has a negative radius in Mitsuba, and its outside within.
  if (isMirrored && kind == "sphere") flip = !flip;
  mirrored = isMirrored && !file.empty();
  if (mirrored || (isMirrored && kind == "sphere")) key += " mirrored";
}

void Geometry::setColored(bool isColored) {
  colored = isColored;
  if (colored) key += " colored";
}

void Geometry::setError(double value) {
  error = value;
  key += fmt::format(" within {}", value);
}

bool describeGeometry(const Properties& shape, Geometry& out) {
  out.kind = shape.element().type();
  out.flip = shape.flag("flip_normals", false);
  if (ofFile(out.kind)) {
    describeFile(shape, out);
  } else if (out.kind == "sphere") {
    const double r = shape.number("radius", 1.0, 1e-18, 1e18);
    out.place = glm::translate(dmat4(1.0), shape.vector("center", dvec3(0.0)));
    out.place = glm::scale(out.place, dvec3(r));
  } else if (out.kind == "cylinder") {
    const double r = shape.number("radius", 1.0, 1e-18, 1e18);
    out.place =
        alongAxis(shape.vector("p0", dvec3(0.0)), shape.vector("p1", dvec3(0.0, 0.0, 1.0)), r);
  } else if (out.kind != "rectangle" && out.kind != "cube" && out.kind != "disk") {
    shape.context().replace(shape.element(),
                            fmt::format("shape '{:.40}' is not known; it is left out", out.kind));
    return false;
  }
  out.key = fmt::format("{} {} {} {} {} {} {}", out.kind, out.file, out.faceNormals, out.flip,
                        out.flipV, out.smoothAngle, out.index);
  return true;
}

std::vector<Mesh> makeGeometry(Context& context, const Element& at, const Geometry& g) {
  std::vector<Mesh> meshes;
  if (ofFile(g.kind)) {
    meshes = readFile(context, at, g);
    for (Mesh& mesh : meshes) finish(context, at, g, mesh);
  } else if (g.kind == "sphere") {
    meshes.push_back(sphereMesh({}, g.error));
    for (vec2& uv : meshes[0].texCoords) uv.y = 1.0f - uv.y;
  } else if (g.kind == "cylinder") {
    meshes.push_back(cylinderMesh({.radius = 1.0, .zMin = 0.0, .zMax = 1.0}, g.error));
  } else if (g.kind == "disk") {
    meshes.push_back(diskMesh(1.0, 0.0, 0.0, 2.0 * std::numbers::pi, g.error));
    for (vec2& uv : meshes[0].texCoords) uv = vec2(1.0f - uv.y, uv.x);
  } else {
    meshes.push_back(g.kind == "cube" ? cubeMesh() : rectangleMesh());
  }
  const auto plain = [](const Mesh& mesh) { return mesh.colors.empty(); };
  if (g.colored && std::any_of(meshes.begin(), meshes.end(), plain)) {
    context.replace(at, "its mesh has no colours of vertices or faces; white is shown");
  }
  if (g.flip) std::for_each(meshes.begin(), meshes.end(), turnOver);
  return meshes;
}

}  // namespace trex::detail::mitsuba
