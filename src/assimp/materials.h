// Materials and textures of assimp as those of glTF.
#pragma once

#include <assimp/scene.h>

#include <map>
#include <string>

#include "src/assimp/gltf_writer.h"

namespace trex {

class MaterialWriter {
 public:
  MaterialWriter(const aiScene& scene, GltfWriter& out) : scene_(scene), out_(out) {}

  /// Number of the glTF material of one of the scene's; `colored`: of meshes with vertex colours.
  int write(unsigned material, bool colored);

 private:
  using Json = GltfWriter::Json;

  void writeColors(const aiMaterial& from, bool colored, Json& to);
  void writeSurface(const aiMaterial& from, Json& to);
  void writeEmission(const aiMaterial& from, Json& to);
  void writeTextures(const aiMaterial& from, Json& to);
  float opacity(const aiMaterial& from);
  /// The first texture of some kinds, as glTF's textureInfo; null if there is none.
  Json texture(const aiMaterial& from, std::initializer_list<aiTextureType> kinds);
  int image(const std::string& path);
  Json embedded(const aiTexture& texture);

  const aiScene& scene_;
  GltfWriter& out_;
  std::map<std::pair<unsigned, bool>, int> done_;
  std::map<std::string, int> images_;
  std::string name_;  ///< of the material under way
};

}  // namespace trex
