// The scene as imported: meshes stored once, instances that place them, materials, images, lights
// and cameras. Plain data: import fills it, edits change it, everything else reads it.
//
// Units: metres, radiometric RGB in linear Rec. 709; angles in radians. Right-handed, y up (glTF).
// World positions are double; meshes hold floats around a double origin of their own, so that a
// model far from the world's origin keeps its detail.
#pragma once

#include <array>
#include <cmath>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "src/core/maths.h"

namespace asvo {
class Medium;
}

namespace trex {

inline constexpr int kNone = -1;

/// What the values of an image are. Alpha is always linear.
enum class TexelKind : std::uint8_t {
  kByte,      ///< 8 bits of [0, 1]; sRGB or linear, as who reads them says
  kWord,      ///< 16 bits of [0, 1], linear
  kSrgbWord,  ///< 16 bits of [0, 1], sRGB
  kHalf,      ///< 16-bit floats, linear
  kFloat,     ///< 32-bit floats, linear
};

class PagedTexels;
class TextureCache;

/// An image as its file has it: no wider values than there. Rows go from top to bottom, as in glTF.
/// One of the four holds its width * height * channels values.
struct Image {
  std::string name;  ///< file name or "image 3 of model.glb", for messages
  int width = 0, height = 0;
  int channels = 0;                            ///< 1 grey, 2 grey and alpha, 3 RGB, 4 RGB and alpha
  std::vector<std::uint8_t> bytes{};           ///< kByte
  std::vector<std::uint16_t> words{};          ///< of `wordKind`
  std::vector<float> floats{};                 ///< kFloat
  std::shared_ptr<const PagedTexels> paged{};  ///< in tiles on disk (texture_cache.h)
  TexelKind wordKind = TexelKind::kWord;
};

/// Texture coordinates of a point, by Texture::set.
using TexCoords = std::array<vec2, 2>;

/// How a texture is read from an image. uv is transformed by offset + rotate(scale * uv)
/// (KHR_texture_transform), wrapped, and sampled bilinearly by default; (0, 0) is the upper left
/// corner.
struct Texture {
  enum class Wrap : std::uint8_t { kRepeat, kMirror, kClamp };
  int image = kNone;
  Wrap wrapS = Wrap::kRepeat, wrapT = Wrap::kRepeat;
  vec2 offset{0.0f}, scale{1.0f};
  float rotation = 0.0f;
  bool nearest = false;  ///< the nearest texel instead of a mix of four
  /// 0 or 1: the set of texture coordinates that uv is of. Directions along a texture (of normal
  /// maps and anisotropy) are those of set 0.
  std::uint8_t set = 0;
  bool present() const { return image != kNone; }
  bool operator==(const Texture&) const = default;
};

enum class AlphaMode : std::uint8_t { kOpaque, kMask, kBlend };

/// What lies on a material or turns its reflection: KHR_materials_clearcoat, _sheen, _anisotropy
/// and _iridescence; a metal's own reflectance; Beckmann's microfacets. Factors multiply textures.
struct Finish {
  float clearcoat = 0.0f, clearcoatRoughness = 0.0f;  ///< [0, 1]; a layer of index 1.5
  float clearcoatNormalScale = 1.0f;                  ///< of its normals along the texture
  vec3 sheenColor{0.0f};                              ///< [0, 1]
  float sheenRoughness = 0.0f;                        ///< [0, 1]
  float anisotropy = 0.0f;          ///< [0, 1]; how much rougher it is along its direction
  float anisotropyRotation = 0.0f;  ///< radians from the texture's u towards its v
  float iridescence = 0.0f;         ///< [0, 1], share of a thin film
  float iridescenceIor = 1.3f;
  float iridescenceThinnest = 100.0f, iridescenceThickest = 400.0f;  ///< nanometres
  /// Complex index of the metallic part, by colour: its base colour times Fresnel's reflectance at
  /// each angle. Both 0: its base colour at all angles.
  vec3 metalEta{0.0f}, metalK{0.0f};
  static constexpr float kMostMetalIndex = 1e4f;
  bool beckmann = false;                ///< instead of GGX, where nothing is anisotropic
  Texture clearcoatTexture;             ///< R
  Texture clearcoatRoughnessTexture;    ///< G
  Texture clearcoatNormalTexture;       ///< of the coat alone; the normal map does not bend it
  Texture sheenColorTexture;            ///< sRGB
  Texture sheenRoughnessTexture;        ///< A
  Texture anisotropyTexture;            ///< RG direction, B strength
  Texture iridescenceTexture;           ///< R
  Texture iridescenceThicknessTexture;  ///< G, from the thinnest to the thickest
  bool coats() const { return clearcoat > 0.0f; }
  bool sheens() const { return sheenColor.x > 0.0f || sheenColor.y > 0.0f || sheenColor.z > 0.0f; }
  bool conducts() const { return metalEta != vec3(0.0f) || metalK != vec3(0.0f); }
  bool present() const {
    return coats() || sheens() || anisotropy > 0.0f || iridescence > 0.0f || conducts() || beckmann;
  }
  bool operator==(const Finish&) const = default;
};

/// glTF metallic-roughness with the KHR extensions we support. Factors multiply textures.
struct Material {
  std::string name;
  vec4 baseColor{1.0f};  ///< linear, [0, 1]
  float metallic = 1.0f, roughness = 1.0f;
  vec3 emission{0.0f};  ///< emissiveFactor * emissiveStrength, radiance
  float normalScale = 1.0f;
  AlphaMode alphaMode = AlphaMode::kOpaque;
  float alphaCutoff = 0.5f;
  bool doubleSided = false;  ///< emission from both sides; surfaces always scatter on both
  bool unlit = false;        ///< KHR_materials_unlit: radiance is the base colour
  float specular = 1.0f;     ///< KHR_materials_specular; 0 makes the dielectric Lambertian
  vec3 specularColor{1.0f};
  float ior = 1.5f;
  float transmission = 0.0f;
  bool volume = false;  ///< KHR_materials_volume with thickness > 0: refracts; else thin
  vec3 attenuationColor{1.0f};
  float attenuationDistance = kInfinity;  ///< metres
  Texture baseColorTexture;               ///< sRGB, alpha in the fourth channel
  Texture metallicRoughnessTexture;       ///< G roughness, B metallic
  Texture normalTexture, emissiveTexture;
  Texture transmissionTexture;   ///< R
  Texture specularTexture;       ///< A
  Texture specularColorTexture;  ///< sRGB
  Finish finish;
  bool emits() const { return emission.x > 0.0f || emission.y > 0.0f || emission.z > 0.0f; }
  static constexpr std::size_t kTextures = 15;
  std::array<const Texture*, kTextures> textures() const {
    return texturesOf<const Texture>(*this);
  }
  std::array<Texture*, kTextures> textures() { return texturesOf<Texture>(*this); }
  bool textured() const {
    for (const Texture* t : textures()) {
      if (t->present()) return true;
    }
    return false;
  }
  bool operator==(const Material&) const = default;

 private:
  template <typename T, typename M>
  static std::array<T*, kTextures> texturesOf(M& m) {
    auto& f = m.finish;
    return {&m.baseColorTexture,       &m.metallicRoughnessTexture, &m.normalTexture,
            &m.emissiveTexture,        &m.transmissionTexture,      &m.specularTexture,
            &m.specularColorTexture,   &f.clearcoatTexture,         &f.clearcoatRoughnessTexture,
            &f.clearcoatNormalTexture, &f.sheenColorTexture,        &f.sheenRoughnessTexture,
            &f.anisotropyTexture,      &f.iridescenceTexture,       &f.iridescenceThicknessTexture};
  }
};

/// A vertex colour as it is kept: red, green and blue by the transfer function of sRGB, which has
/// steps that the eye does not see in the dark, alpha linear. Clamped to [0, 1]; not-a-number is 0.
glm::u8vec4 packVertexColor(const vec4& linear);
/// The linear colour of one that is kept, or of one whose channels are in [0, 1].
vec4 unpackVertexColor(glm::u8vec4 packed);
vec4 unpackVertexColor(const vec4& packed);

/// Triangles of one material. Arrays are either empty or as long as positions.
struct Mesh {
  std::string name;
  dvec3 origin{0.0};  ///< added to every position
  std::vector<vec3> positions;
  std::vector<glm::uvec3> triangles;  ///< indices into positions, all in range
  std::vector<vec3> normals;          ///< unit; empty: flat faces
  std::vector<vec2> texCoords;
  std::vector<vec2> secondTexCoords;  ///< of set 1; only with texCoords
  std::vector<glm::u8vec4> colors;    ///< see packVertexColor(); multiplies the base colour
  int material = 0;                   ///< index into Scene::materials, always valid
  int sameGeometryAs = kNone;         ///< earlier mesh with equal arrays and another material
};

/// One placement of a mesh. The transform is finite and invertible. A mirroring transform (negative
/// determinant) keeps the side that is the front in the mesh (glTF 2.0, 3.7.4).
struct Instance {
  std::string name;
  int mesh = 0;
  dmat4 transform{1.0};  ///< mesh (origin included) to world
  int object = 0;        ///< index of the node it came from
};

struct Light {
  enum class Type : std::uint8_t { kPoint, kSpot, kDirectional };
  Type type = Type::kPoint;
  std::string name;
  dvec3 position{0.0};
  vec3 direction{0.0f, 0.0f, -1.0f};  ///< the light travels this way; unit
  vec3 intensity{1.0f};               ///< W/sr (point, spot), W/m^2 (directional); colour included
  float range = kInfinity;
  float innerConeAngle = 0.0f, outerConeAngle = 0.785398f;
  float radius = 0.0f;  ///< metres, of the ball that point and spot lights shine from; 0: a point
  bool operator==(const Light&) const = default;
};

/// A pinhole camera, or one with a thin lens. World to image: right, up, -forward as in glTF.
struct Camera {
  /// Height of the sensor that an f-number counts on, metres: that of a full frame. The focal
  /// length is the one that gives the field of view with it: kSensorHeight / (2 tan(verticalFov /
  /// 2)).
  static constexpr float kSensorHeight = 0.024f;

  std::string name;
  dvec3 eye{0.0};
  vec3 forward{0.0f, 0.0f, -1.0f}, up{0.0f, 1.0f, 0.0f};  ///< orthonormal
  float verticalFov = 0.7f;                               ///< radians
  bool orthographic = false;
  float orthographicHeight = 1.0f;  ///< metres, whole height
  float fstop = 0.0f;    ///< focal length over the lens's diameter; 0: a pinhole, all is sharp
  float focus = 0.0f;    ///< with a lens: metres along `forward` to the plane that is sharp
  bool framing = false;  ///< of framingCamera(): it shows all of a model in a square picture
  /// Of the lens, metres; 0 of a pinhole.
  float lensRadius() const {
    if (!(fstop > 0.0f) || orthographic) return 0.0f;
    return kSensorHeight / (4.0f * std::tan(0.5f * verticalFov) * fstop);
  }
  bool operator==(const Camera&) const = default;
};

/// What surrounds the scene. Radiance towards the scene; black by default.
struct Environment {
  vec3 color{0.0f};  ///< of a constant sky; the factor of a map
  std::shared_ptr<const Image>
      map;                ///< latitude-longitude, +y up, three float channels; may be null
  float rotation = 0.0f;  ///< radians about +y, of the map; counter-clockwise from above
  bool present() const { return map != nullptr || color.x > 0 || color.y > 0 || color.z > 0; }
  bool operator==(const Environment&) const = default;
};

/// Fog, smoke or fire: a grid of voxels that scatters, absorbs and shines (volume.h).
struct Medium {
  std::string name;                          ///< its file's
  std::shared_ptr<const asvo::Medium> grid;  ///< never null
  dmat4 transform{1.0};     ///< voxels of the grid, whose centres are whole numbers, to the world
  float density = 1.0f;     ///< extinction of a unit of the grid's density, 1/m
  vec3 albedo{0.9f};        ///< share of the extinction that scatters, [0, 1]
  float anisotropy = 0.0f;  ///< g of Henyey and Greenstein, (-1, 1); more than 0: forward
  /// Radiance a metre of a unit of the grid's emission; of its density if it has no emission.
  vec3 emission{0.0f};
  bool emits() const { return emission.x > 0.0f || emission.y > 0.0f || emission.z > 0.0f; }
};

/// A file that an import read, as it was when it was opened.
struct SourceFile {
  std::string path;
  std::uint64_t bytes = 0;
  std::int64_t modifiedNanoseconds = 0;  ///< since 1970
};

/// Parts of a file that are not shown as the file has them: broken, missing, or not known here.
struct Replaced {
  static constexpr std::size_t kMostTexts = 200;
  std::vector<std::string> texts;  ///< which part, what is wrong with it, what is shown instead
  std::uint64_t count = 0;         ///< of all such parts; more than texts if there are many

  /// Adds `parts` parts that one text speaks of. A text is kept once.
  void add(std::string text, std::uint64_t parts = 1);
};

struct Scene {
  static constexpr std::uint32_t kAnyBounces = ~std::uint32_t{0};

  std::string source;             ///< path as given
  std::vector<SourceFile> files;  ///< all that the import read, the model's own first
  std::vector<Mesh> meshes;
  std::vector<Instance> instances;
  std::vector<Material> materials;  ///< at least one
  std::vector<Image> images;
  std::shared_ptr<TextureCache> textures;  ///< that images keep to; null: all are in memory
  std::vector<Light> lights;
  std::vector<Camera> cameras;  ///< at least one after importScene
  Environment environment;
  std::vector<Medium> media;
  std::vector<std::string> objects;    ///< names by object id
  std::vector<std::string> warnings;   ///< said once on import
  Replaced replaced;                   ///< said like warnings; errors with ImportOptions::strict
  std::uint64_t droppedTriangles = 0;  ///< with non-finite vertices
  /// Light that was reflected or scattered more often on its way to the camera is not shown; 0:
  /// emission alone, 1: direct light too. Surfaces that are not all there and smooth glass that
  /// light goes through do not count.
  std::uint32_t maxBounces = kAnyBounces;

  std::uint64_t triangleCount() const;        ///< instances counted each time
  std::uint64_t uniqueTriangleCount() const;  ///< meshes of equal geometry counted once
  Box3d bounds() const;                       ///< of all instances, tight; empty for an empty scene
};

}  // namespace trex
