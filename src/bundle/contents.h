// What a bundle says of its scene, besides the large arrays: scene.json.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "src/bundle/requirements.h"
#include "src/crays/ray_scene.h"
#include "src/scene/scene.h"

namespace trex::bundle {

inline constexpr int kSceneVersion = 3;
/// Of Material::textures().
inline constexpr std::array<const char*, Material::kTextures> kTextureKeys = {
    "base_color_texture",       "metallic_roughness_texture", "normal_texture",
    "emissive_texture",         "transmission_texture",       "specular_texture",
    "specular_color_texture",   "clearcoat_texture",          "clearcoat_roughness_texture",
    "clearcoat_normal_texture", "sheen_color_texture",        "sheen_roughness_texture",
    "anisotropy_texture",       "iridescence_texture",        "iridescence_thickness_texture"};

/// By TexelKind.
inline constexpr std::array<const char*, 5> kTexelKeys = {"u8", "u16", "srgb16", "f16", "f32"};

/// A file that the bundle was baked from.
struct BakedFile {
  SourceFile file;         ///< its path is relative to the bundle's folder
  std::uint64_t hash = 0;  ///< XXH3-64 of its bytes
};

struct EmitterSize {
  std::size_t mesh = 0;  ///< index into Scene::meshes
  std::uint64_t positions = 0, triangles = 0;
};

struct Description {
  /// Images and the environment's map have their sizes but no texels, meshes no arrays.
  Scene scene;
  std::string bakedBy;  ///< "trex 0.1.0"
  std::string input;    ///< the model's file name
  std::vector<BakedFile> files;
  dvec3 renderOrigin{0.0};
  std::uint32_t sharedMeshes = 0;
  std::vector<RayScene::Parts::Placed> placed;
  std::vector<TexelKind> imageKinds;  ///< by image
  std::vector<EmitterSize> emitters;  ///< meshes whose arrays are kept
  int precisionBits = 24;
  int voxelDepth = 0;  ///< asked for; 0: no voxels
  std::vector<Requirement> requirements;
};

/// The text of scene.json; every number keeps its bits.
std::string writeDescription(const Description& description);

/// Reads scene.json. Throws Error(kInput) with `name` in front and the JSON pointer of what is
/// wrong: an unknown version or key, a missing one, a number that is not finite or out of range,
/// an index beyond its array.
Description readDescription(std::span<const std::byte> text, const std::string& name);

}  // namespace trex::bundle
