#include "src/assimp/convert.h"

#include <assimp/commonMetaData.h>
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <string_view>

#include "src/assimp/gltf_writer.h"
#include "src/assimp/lights.h"
#include "src/assimp/materials.h"
#include "src/scene/polygon.h"

namespace trex {
namespace {

using Json = GltfWriter::Json;

Json matrixOf(const aiMatrix4x4& m) {
  Json out = Json::array();
  for (unsigned column = 0; column < 4; ++column) {
    for (unsigned row = 0; row < 4; ++row) out.push_back(m[row][column]);
  }
  return out;
}

std::vector<float> floatsOf(const aiVector3D* values, unsigned count) {
  std::vector<float> out;
  out.reserve(std::size_t{count} * 3);
  for (unsigned i = 0; i < count; ++i) {
    out.insert(out.end(), {values[i].x, values[i].y, values[i].z});
  }
  return out;
}

/// Metres of a unit of the scene's root. Importers of the other formats that know theirs apply it
/// to the root.
double unitOf(const aiScene& scene) {
  double centimetres = 0.0;
  float narrow = 0.0f;
  if (scene.mMetaData == nullptr) return 1.0;
  if (!scene.mMetaData->Get("UnitScaleFactor", centimetres) &&
      scene.mMetaData->Get("UnitScaleFactor", narrow)) {
    centimetres = narrow;
  }
  return centimetres > 0.0 && std::isfinite(centimetres) ? centimetres * 0.01 : 1.0;
}

/// From the axes that an FBX file counts on, and Blender's, to y up, -z forward.
aiMatrix4x4 axesOf(const aiScene& scene) {
  int up = 1, sign = 1;
  if (scene.mMetaData == nullptr) return {};
  aiString format;
  scene.mMetaData->Get(AI_METADATA_SOURCE_FORMAT, format);
  if (std::string_view(format.C_Str()).starts_with("Blender")) up = 2;
  if (!scene.mMetaData->Get("UpAxis", up) && up == 1) return {};
  scene.mMetaData->Get("UpAxisSign", sign);
  const ai_real s = sign < 0 ? -1.0f : 1.0f;
  if (up == 2) return {1, 0, 0, 0, 0, 0, s, 0, 0, -s, 0, 0, 0, 0, 0, 1};
  if (up == 0) return {0, -s, 0, 0, s, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1};
  return s > 0 ? aiMatrix4x4() : aiMatrix4x4(1, 0, 0, 0, 0, -1, 0, 0, 0, 0, -1, 0, 0, 0, 0, 1);
}

/// Whether vertices have colours. Importers fill those that a file does not give with one of two
/// values that no file would have everywhere.
bool hasColors(const aiMesh& mesh) {
  if (!mesh.HasVertexColors(0)) return false;
  const aiColor4D unset[] = {aiColor4D(0, 0, 0, 0), aiColor4D(0.6f, 0.6f, 0.6f, 0.6f)};
  return std::any_of(mesh.mColors[0], mesh.mColors[0] + mesh.mNumVertices,
                     [&](const aiColor4D& c) { return c != unset[0] && c != unset[1]; });
}

class Converter {
 public:
  Converter(aiScene& scene, GltfWriter& out) : scene_(scene), out_(out), materials_(scene, out) {}

  void convert() {
    for (unsigned i = 0; i < scene_.mNumMeshes; ++i) primitives_.push_back(primitive(i));
    const double unit = unitOf(scene_);
    aiMatrix4x4 root;
    aiMatrix4x4::Scaling(aiVector3D(static_cast<ai_real>(unit)), root);
    root = root * axesOf(scene_);
    const int top = out_.add("nodes", {{"name", "root"}, {"matrix", matrixOf(root)}});
    if (scene_.mRootNode != nullptr) {
      measure(*scene_.mRootNode, aiMatrix4x4());
      const double size = bounds_.empty() ? 1.0 : glm::length(bounds_.upper - bounds_.lower);
      const double scale = std::cbrt(std::abs(scene_.mRootNode->mTransformation.Determinant()));
      const LightWriter lights(scene_, unit * scale, 0.5 * size * unit, out_);
      out_.root()["nodes"][static_cast<std::size_t>(top)]["children"] = {
          node(*scene_.mRootNode, lights)};
    }
    out_.add("scenes", {{"nodes", {top}}});
    tellWhatIsLeftOut();
  }

 private:
  /// Empty of a mesh without faces.
  Json primitive(unsigned number) {
    aiMesh& mesh = *scene_.mMeshes[number];
    const std::vector<std::uint32_t> indices = trianglesOf(mesh);
    Box3d& box = boxes_.emplace_back();
    for (unsigned v = 0; v < mesh.mNumVertices; ++v) {
      const vec3 p(mesh.mVertices[v].x, mesh.mVertices[v].y, mesh.mVertices[v].z);
      if (isFinite(p)) box.extend(dvec3(p));
    }
    if (mesh.mNumBones > 0) ++skins_;
    if (mesh.mNumAnimMeshes > 0) ++shapes_;
    Json out;
    if (!indices.empty()) {
      Json& attributes = out["attributes"];
      attributes["POSITION"] =
          out_.addFloats(floatsOf(mesh.mVertices, mesh.mNumVertices), "VEC3", 3);
      if (mesh.HasNormals()) {
        attributes["NORMAL"] =
            out_.addFloats(floatsOf(mesh.mNormals, mesh.mNumVertices), "VEC3", 3);
      }
      addTexCoords(mesh, attributes);
      addColors(mesh, attributes);
      out["indices"] = out_.addIndices(indices);
      out["material"] = materials_.write(mesh.mMaterialIndex, hasColors(mesh));
    }
    delete scene_.mMeshes[number];
    scene_.mMeshes[number] = new aiMesh;  // what is written is not held twice
    return out;
  }

  std::vector<std::uint32_t> trianglesOf(const aiMesh& mesh) {
    std::vector<std::uint32_t> out;
    std::vector<dvec3> corners;
    out.reserve(std::size_t{mesh.mNumFaces} * 3);
    for (unsigned f = 0; f < mesh.mNumFaces; ++f) {
      const aiFace& face = mesh.mFaces[f];
      if (face.mNumIndices < 3) {
        ++linesAndPoints_;
        continue;
      }
      corners.assign(face.mNumIndices, dvec3(0.0));
      for (unsigned k = 0; face.mNumIndices > 3 && k < face.mNumIndices; ++k) {
        if (face.mIndices[k] >= mesh.mNumVertices) continue;
        const aiVector3D& p = mesh.mVertices[face.mIndices[k]];
        corners[k] = dvec3(p.x, p.y, p.z);
      }
      for (const glm::uvec3& t : cutter_.cut(corners)) {
        for (int k = 0; k < 3; ++k) out.push_back(face.mIndices[t[k]]);
      }
    }
    return out;
  }

  void addTexCoords(const aiMesh& mesh, Json& attributes) {
    for (unsigned set = 0; set < AI_MAX_NUMBER_OF_TEXTURECOORDS; ++set) {
      if (!mesh.HasTextureCoords(set)) continue;
      std::vector<float> values;
      for (unsigned i = 0; i < mesh.mNumVertices; ++i) {
        const aiVector3D& uv = mesh.mTextureCoords[set][i];
        values.insert(values.end(), {uv.x, 1.0f - uv.y});
      }
      attributes[fmt::format("TEXCOORD_{}", set)] = out_.addFloats(values, "VEC2", 2);
    }
  }

  /// Colours are taken for sRGB, as those of OBJ files.
  void addColors(const aiMesh& mesh, Json& attributes) {
    if (!hasColors(mesh)) return;
    std::vector<float> values;
    for (unsigned i = 0; i < mesh.mNumVertices; ++i) {
      const aiColor4D& c = mesh.mColors[0][i];
      for (const float channel : {c.r, c.g, c.b}) {
        values.push_back(decodeSrgb(std::clamp(channel, 0.0f, 1.0f)));
      }
      values.push_back(c.a);
    }
    attributes["COLOR_0"] = out_.addFloats(values, "VEC4", 4);
  }

  void measure(const aiNode& from, const aiMatrix4x4& parent) {
    const aiMatrix4x4 world = parent * from.mTransformation;
    for (unsigned i = 0; i < from.mNumMeshes; ++i) {
      if (from.mMeshes[i] >= boxes_.size() || boxes_[from.mMeshes[i]].empty()) continue;
      const Box3d& box = boxes_[from.mMeshes[i]];
      for (int k = 0; k < 8; ++k) {
        const dvec3 c(k & 1 ? box.upper.x : box.lower.x, k & 2 ? box.upper.y : box.lower.y,
                      k & 4 ? box.upper.z : box.lower.z);
        const aiVector3D p =
            world * aiVector3D(static_cast<ai_real>(c.x), static_cast<ai_real>(c.y),
                               static_cast<ai_real>(c.z));
        if (isFinite(vec3(p.x, p.y, p.z))) bounds_.extend(dvec3(p.x, p.y, p.z));
      }
    }
    for (unsigned i = 0; i < from.mNumChildren; ++i) measure(*from.mChildren[i], world);
  }

  int node(const aiNode& from, const LightWriter& lights) {
    Json to = {{"name", from.mName.C_Str()}, {"matrix", matrixOf(from.mTransformation)}};
    const int number = out_.add("nodes", std::move(to));
    if (const int mesh = meshOf(from); mesh >= 0) at(number)["mesh"] = mesh;
    std::vector<int> children = lights.nodesOf(from.mName.C_Str());
    for (unsigned i = 0; i < from.mNumChildren; ++i) {
      children.push_back(node(*from.mChildren[i], lights));
    }
    if (!children.empty()) at(number)["children"] = children;
    return number;
  }
  Json& at(int node) { return out_.root()["nodes"][static_cast<std::size_t>(node)]; }

  /// -1 if the node has no faces.
  int meshOf(const aiNode& from) {
    const std::vector<unsigned> parts(from.mMeshes, from.mMeshes + from.mNumMeshes);
    const auto [known, isNew] = meshes_.try_emplace(parts, -1);
    if (!isNew) return known->second;
    Json primitives = Json::array();
    for (const unsigned part : parts) {
      if (part < primitives_.size() && !primitives_[part].is_null()) {
        primitives.push_back(primitives_[part]);
      }
    }
    if (primitives.empty()) return -1;
    return known->second =
               out_.add("meshes", {{"name", from.mName.C_Str()}, {"primitives", primitives}});
  }

  void tellWhatIsLeftOut() {
    const auto tell = [&](std::size_t count, const char* what) {
      if (count > 0) out_.replaced(fmt::format("{} {}", count, what));
    };
    tell(linesAndPoints_, "lines and points are left out");
    tell(scene_.mNumAnimations, "animations are left out; all is shown at rest");
    tell(skins_, "skinned meshes are shown as they were bound");
    tell(shapes_, "meshes have targets to change their shapes, which are left out");
  }

  aiScene& scene_;
  GltfWriter& out_;
  MaterialWriter materials_;
  detail::PolygonCutter cutter_;
  std::vector<Json> primitives_;                 ///< by mesh of the scene
  std::map<std::vector<unsigned>, int> meshes_;  ///< of nodes
  std::vector<Box3d> boxes_;                     ///< by mesh of the scene
  Box3d bounds_;                                 ///< of the scene, its units
  std::size_t linesAndPoints_ = 0, skins_ = 0, shapes_ = 0;
};

}  // namespace

std::vector<std::uint8_t> gltfOf(aiScene& scene, std::vector<std::string> files) {
  GltfWriter out;
  out.usedFiles(std::move(files));
  Converter(scene, out).convert();
  return out.finish();
}

}  // namespace trex
