// glTF: where nodes are at a moment of an animation, and how skins and morph targets bend meshes.
#pragma once

#include <glm/gtc/quaternion.hpp>
#include <optional>
#include <vector>

#include "src/scene/gltf_detail.h"

namespace trex::detail {

/// The transforms of all nodes, at rest or at a moment of an animation (ImportOptions::animation).
class GltfPose {
 public:
  /// Throws Error(kUsage) if the file has no animation of that name.
  explicit GltfPose(GltfContext& context);

  /// From the node to its parent. What is wrong in it is replaced and said.
  dmat4 local(int node);
  /// Weights of the morph targets of the node's mesh; empty if it has none.
  std::vector<float> weights(int node) const;

 private:
  struct Moved {
    std::optional<dvec3> translation, scale;
    std::optional<glm::dquat> rotation;
    std::vector<float> weights;
  };

  void animate(const tinygltf::Animation& animation, double seconds);
  void move(const tinygltf::AnimationChannel& channel, const std::vector<double>& value);
  std::vector<double> valueAt(const tinygltf::AnimationSampler& sampler, double seconds,
                              bool rotation) const;
  dmat4 affine(const tinygltf::Node& node, int index);

  GltfContext& context_;
  std::vector<Moved> moved_;  ///< by node; empty without an animation
};

/// How the vertices of a mesh move before it is placed.
struct GltfDeformation {
  std::vector<float> weights;  ///< of morph targets
  std::vector<dmat4> joints;   ///< of the skin, from the mesh to the world; empty: no skin
  bool none() const { return weights.empty() && joints.empty(); }
};

/// The world matrices of a skin's joints times the inverse of where they were bound. `world` has a
/// matrix for each node. Throws Error(kInput) if the skin is broken.
std::vector<dmat4> skinMatrices(GltfContext& context, int skin, const std::vector<dmat4>& world);

/// Bends a mesh: `used` are the numbers that its vertices have in the primitive's accessors. With a
/// skin, positions become those of the world around `frame`. Throws Error(kInput).
void deform(GltfContext& context, const tinygltf::Primitive& p,
            const std::vector<std::uint32_t>& used, const GltfDeformation& deformation,
            const std::string& where, LocalFrame& frame, Mesh& mesh);

}  // namespace trex::detail
