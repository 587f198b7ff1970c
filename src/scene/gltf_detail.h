// Parts of the glTF reader. tinygltf parses the JSON and loads buffers; every index and range that
// it hands out is checked here before use, in 64 bits.
#pragma once

// Images are decoded by image_io, on demand; tinygltf reads none.
#define TINYGLTF_NO_STB_IMAGE
#define TINYGLTF_NO_STB_IMAGE_WRITE
#define TINYGLTF_NO_EXTERNAL_IMAGE
#include <tiny_gltf.h>

#include <array>
#include <cmath>
#include <cstring>
#include <map>
#include <memory>
#include <set>
#include <span>
#include <string>
#include <tuple>
#include <vector>

#include "src/scene/import_detail.h"

namespace trex::detail {

/// What is shown instead of a broken part: nothing.
inline constexpr const char* kLeftOut = "it is left out";

/// Bytes of a buffer, wherever they lie.
struct GltfBuffer {
  std::span<const std::uint8_t> bytes;
  std::shared_ptr<const void> owner;  ///< of the bytes; null if they are the file's own
  std::string problem;                ///< why there are none
};

/// An image as the file names it: by a URI, or else a buffer view.
struct GltfImage {
  std::string name, uri;
  int bufferView = kNone;
};

/// What all parts of the reader need: the parsed file and where messages go.
struct GltfContext {
  std::filesystem::path path;
  std::string name;  ///< of the file, for messages
  ImportOptions options;
  tinygltf::Model model;  ///< without buffers and images
  std::vector<GltfBuffer> buffers;
  std::vector<GltfImage> images;
  bool handedOver = false;  ///< by the reader of another format (src/assimp/child.h)
  Scene scene;
  std::set<std::string> said;  ///< warnings already in the scene

  template <typename... Args>
  [[noreturn]] void bad(fmt::format_string<Args...> format, Args&&... args) const {
    fail(ExitCode::kInput, "{}: {}", name, fmt::format(format, std::forward<Args>(args)...));
  }
  /// Notes a part that is not shown as the file has it.
  template <typename... Args>
  void replace(fmt::format_string<Args...> format, Args&&... args) {
    scene.replaced.add(name + ": " + fmt::format(format, std::forward<Args>(args)...));
  }
  /// Does something with a part of the file; if it is broken, says so and that `instead`. False
  /// then.
  template <typename Use>
  bool attempt(const std::string& instead, Use use) {
    try {
      use();
      return true;
    } catch (const Error& e) {
      if (e.code() != ExitCode::kInput) throw;
      scene.replaced.add(fmt::format("{}; {}", e.what(), instead));
      return false;
    }
  }
  template <typename... Args>
  void warn(fmt::format_string<Args...> format, Args&&... args) {
    std::string text = name + ": " + fmt::format(format, std::forward<Args>(args)...);
    if (said.insert(text).second) scene.warnings.push_back(std::move(text));
  }
};

/// A number as an index; kNone if it is not one (a fraction, or out of range).
inline int indexOf(const tinygltf::Value& number) {
  const double value = number.GetNumberAsDouble();
  return value >= 0.0 && value <= 2147483647.0 && value == std::floor(value)
             ? static_cast<int>(value)
             : kNone;
}

/// The checked memory of an accessor: `count` elements of `components` values each.
class GltfAccessor {
 public:
  /// Checks all ranges; throws Error(kInput) that names the accessor. Sparse accessors are copied
  /// and patched, all others are read where they lie.
  GltfAccessor(const GltfContext& context, int index);

  std::uint64_t count() const { return count_; }
  int components() const { return components_; }
  int componentType() const { return componentType_; }
  bool normalized() const { return normalized_; }
  /// Makes integers count as normalized.
  void normalize() { normalized_ = true; }

  /// One value as float; integers are scaled to [0, 1] or [-1, 1] if the accessor is normalized.
  float value(std::uint64_t element, int component) const;

  /// One value of an unsigned integer type, for indices.
  std::uint32_t index(std::uint64_t element) const;

 private:
  const std::uint8_t* viewData(const GltfContext& context, int view, std::uint64_t offset,
                               std::uint64_t bytes, const char* what, std::uint64_t& stride) const;
  void applySparse(const GltfContext& context, const tinygltf::Accessor& accessor);

  int number_ = 0;  ///< of the accessor, for messages
  std::uint64_t count_ = 0, stride_ = 0, elementSize_ = 0;
  int components_ = 0, componentType_ = 0, componentSize_ = 0;
  bool normalized_ = false;
  const std::uint8_t* data_ = nullptr;
  std::vector<std::uint8_t> patched_;
};

/// Turns glTF materials and textures into ours; images are decoded for materials in use alone.
class GltfMaterials {
 public:
  explicit GltfMaterials(GltfContext& context);

  /// Index into Scene::materials of a glTF material, -1 for the default one. The first call for a
  /// material converts it.
  int use(int gltfMaterial);

  /// The texture coordinate set of each of Material::textures(); -1 if it has none.
  using Sets = std::array<int, Material::kTextures>;
  const Sets& texCoordSets(int sceneMaterial) const { return texCoordSets_[sceneMaterial]; }
  /// The sets of the file that become 0 and 1 of the scene; -1 for none. The first is the one that
  /// directions along a texture are of, as glTF has them follow the normal map.
  static std::array<int, 2> keptSets(const Sets& sets);
  /// What stands for a set of the file: `set` of the scene, scaled and shifted.
  struct SetMap {
    std::uint8_t set = 0;
    vec2 scale{1.0f}, offset{0.0f};
    auto operator<=>(const SetMap& o) const {
      return std::tie(set, scale.x, scale.y, offset.x, offset.y) <=>
             std::tie(o.set, o.scale.x, o.scale.y, o.offset.x, o.offset.y);
    }
    bool operator==(const SetMap&) const = default;
  };
  using SetMaps = std::map<int, SetMap>;  ///< by set of the file
  /// How the material's textures read sets if nothing else is said: keptSets() as they are, the
  /// first for others.
  SetMaps usualMaps(int sceneMaterial) const;
  /// The material with textures that read sets by these maps.
  int withMaps(int sceneMaterial, const SetMaps& maps);

  /// Decodes all images that used materials refer to.
  void loadImages();

 private:
  /// An image of the file, or one that is made of images before it.
  struct PendingImage {
    enum class Make { kDecode, kOfGlossiness, kRoughnessAndMetallic, kWithOpacity };
    Make make = Make::kDecode;
    int first = kNone;   ///< glTF image to decode; of others the scene image of the glossiness,
                         ///< the roughness or the colour
    int second = kNone;  ///< scene image of the metalness or the opacity
    bool srgb = false;   ///< of what is decoded
    float glossiness = 0.0f;  ///< factor
    bool operator==(const PendingImage&) const = default;
  };

  void convert(int index);
  void convertExtensions(const tinygltf::Material& from, Material& to);
  /// Of Material::textures().
  enum Slot {
    kBase,
    kMetallicRoughness,
    kNormal,
    kEmissive,
    kTransmission,
    kSpecular,
    kSpecularColor,
    kClearcoat,
    kClearcoatRoughness,
    kClearcoatNormal,
    kSheenColor,
    kSheenRoughness,
    kAnisotropy,
    kIridescence,
    kIridescenceThickness
  };

  void convertFinish(const tinygltf::Material& from, Finish& to);
  void convertSpecularGlossiness(const tinygltf::Value& e, Material& to);
  Texture texture(Slot slot, int index, int texCoord, const tinygltf::ExtensionMap& extensions,
                  bool srgb);
  Texture textureProperty(Slot slot, const tinygltf::Value& object, const char* key, bool srgb);
  int sceneImage(int gltfImage, bool srgb);
  int madeImage(const PendingImage& wanted);
  void separateNumbers(std::size_t decoded);
  Image make(const PendingImage& wanted);
  void convertSeparateMaps(const tinygltf::Material& from, Material& to);
  Texture separateMap(Slot slot, const tinygltf::Value& maps, const char* key,
                      const Texture& beside);
  float inRange(double value, double low, double high, const char* what);
  float number(const tinygltf::Value& object, const char* key, double fallback, double low,
               double high);
  vec3 color(const tinygltf::Value& object, const char* key, double high, double fallback = 1.0);
  const tinygltf::Value* extension(const tinygltf::ExtensionMap& map, const char* key) const;

  GltfContext& context_;
  std::vector<bool> converted_;
  std::vector<Sets> texCoordSets_;  ///< by scene material
  std::map<std::pair<int, SetMaps>, int> withMaps_;
  std::vector<PendingImage> pending_;  ///< by index into Scene::images
  std::map<int, int> imageIndex_;      ///< glTF image to scene image
  Sets currentSets_{};                 ///< of the material being converted
  std::string currentName_;
  int defaultMaterial_ = kNone;
};

struct GltfDeformation;

/// Turns primitives into meshes; equal ones are stored once.
class GltfMeshes {
 public:
  /// Throws Error(kUsage) if the file has no such variant of its materials.
  GltfMeshes(GltfContext& context, GltfMaterials& materials);

  /// Indices into Scene::meshes of the triangle primitives of a glTF mesh. Deformed ones are made
  /// anew each time.
  std::vector<int> use(int gltfMesh, const GltfDeformation& deformation);

 private:
  std::vector<int> primitives(int gltfMesh, const GltfDeformation& deformation);
  int primitive(const tinygltf::Primitive& compressed, const std::string& where,
                const std::string& name, const GltfDeformation& deformation);
  int materialOf(const tinygltf::Primitive& p) const;
  /// Accessors of the sets of texture coordinates that a mesh keeps; -1 for none.
  using TexCoordAccessors = std::array<int, 2>;
  int chooseSets(int material, const tinygltf::Primitive& p, const std::string& where,
                 TexCoordAccessors& kept);
  void tellTangents(const tinygltf::Primitive& p, const std::vector<std::uint32_t>& used,
                    const std::string& where, const Mesh& mesh);
  void readGeometry(const tinygltf::Primitive& p, const TexCoordAccessors& texCoords,
                    const std::string& where, const GltfDeformation& deformation, Mesh& mesh);
  std::vector<std::uint32_t> readIndices(const tinygltf::Primitive& p, std::uint64_t vertices,
                                         const std::string& where);

  GltfContext& context_;
  GltfMaterials& materials_;
  std::map<int, std::vector<int>> done_;
  std::map<std::string, int> byGeometry_;
  std::map<std::pair<int, int>, int> byMaterial_;  ///< (first mesh of the geometry, material)
  int variant_ = kNone;                            ///< that is shown
  LocalFrame skinFrame_;                           ///< of all meshes with a skin
};

}  // namespace trex::detail
