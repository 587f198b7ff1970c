// Lights and cameras of assimp as nodes of glTF.
#pragma once

#include <assimp/scene.h>

#include <map>
#include <string>
#include <vector>

#include "src/assimp/gltf_writer.h"

namespace trex {

class LightWriter {
 public:
  /// `unit`: metres of the file's; `radius` of what the lights shine on, metres.
  LightWriter(const aiScene& scene, double unit, double radius, GltfWriter& out);

  /// Nodes with the lights and cameras that belong to the scene's node of a name.
  std::vector<int> nodesOf(const std::string& name) const;

 private:
  void addLight(const aiLight& light, double unit, double radius);
  void addCamera(const aiCamera& camera);

  GltfWriter& out_;
  std::multimap<std::string, int> nodes_;
};

}  // namespace trex
