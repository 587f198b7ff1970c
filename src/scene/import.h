// Reading models: .gltf .glb .ply .obj .stl, Mitsuba's .xml, .pbrt (docs/formats.md), and what
// assimp knows (assimp_file.cpp). Every file may be hostile; sizes are checked before use.
//
// glTF 2.0: triangles, strips and fans, all index and sparse accessors, vertex colours, node
// transforms and instances, skins and morph targets at rest or at a moment of an animation,
// cameras, images (files, data URIs, buffer views), and of the extensions KHR_lights_punctual,
// KHR_materials_{emissive_strength, specular, ior, transmission, volume, unlit,
// pbrSpecularGlossiness, clearcoat, sheen, anisotropy, iridescence, variants},
// KHR_texture_transform, KHR_mesh_quantization, EXT_texture_webp, EXT_mesh_gpu_instancing,
// EXT_meshopt_compression, KHR_draco_mesh_compression. Textures of a material read up to two sets
// of coordinates. A required extension that is not in this list is an error that names it, unless
// it only says how surfaces look; one that is only used is a warning.
//
// PLY: ASCII and binary of both byte orders; x y z (float or double), nx ny nz, (s t | u v |
// texture_u texture_v), red green blue [alpha] of vertices or faces (integers are sRGB, floats
// linear), polygons, tristrips, `comment TextureFile` with coordinates of vertices or wedges;
// points. OBJ: v (with colours), vt, vn, f with negative indices and such that come later, s, o, g,
// usemtl, mtllib; see statements.h for its text and mtl.h for materials. STL: text and binary.
// Polygons: see polygon.h. PLY and OBJ count texture rows from the bottom; v is flipped on import.
// A surface without a material is Lambertian grey, 0.6 (white if it has vertex colours); a glTF one
// is the white rough metal that the standard asks for.
#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <string>

#include "src/scene/scene.h"
#include "src/scene/volume.h"

namespace trex {

struct ImportOptions {
  bool loadTextures = true;
  bool environmentGiven = false;  ///< the caller sets Scene::environment itself: no default sky
  std::vector<VolumeRequest> volumes{};  ///< media besides those of the file
  std::uint64_t maxMemory = 0;           ///< bytes this process may use; 0: what the machine has
  bool strict = false;                   ///< a part that can't be shown as it is is an error
  /// Folder for the temporary files of streams (triangle_stream.h); empty: the system's.
  std::filesystem::path scratch{};
  /// Of formats that know neither (all but glTF, FBX, COLLADA, IFC, X3D, BLEND): metres of one of
  /// the file's units, and whether its z is up. Error(kUsage) with others.
  double unit = 1.0;
  bool zUp = false;
  /// Of PLY, Error(kUsage) with others: metres across that a point of a cloud is shown; 0: clouds
  /// are refused.
  double pointSize = 0.0;
  /// Of glTF, Error(kUsage) with others: names or numbers of a scene, of a variant of materials
  /// (KHR_materials_variants), and of an animation with its moment; empty: the file's default scene
  /// and materials, and the rest pose.
  std::string scene{}, variant{}, animation{};
  double atSeconds = 0.0;
  /// Of Mitsuba's XML, Error(kUsage) with others: NAME=VALUE of its parameters.
  std::vector<std::string> defines{};
  /// Scene::maxBounces instead of the file's.
  std::optional<std::uint32_t> maxBounces{};
  /// That images of the scene keep to; null: all are in memory.
  std::shared_ptr<TextureCache> textures{};
  /// Of a mesh file that a scene file names: triangles, normals and all texture coordinates;
  /// neither materials nor groups nor smoothing.
  bool geometryOnly = false;

  /// What decides the scene besides the files, as a text; empty if all is as it is without options.
  std::string key() const;
  /// From the file's axes and units to the world.
  dmat4 toWorld() const;
};

/// Metres of "mm", "cm", "m", "in", "ft" or a positive number. Throws Error(kUsage).
double parseUnit(const std::string& text);

/// Scene::maxBounces as the command line has it: a number, or "all".
std::string bouncesText(std::uint32_t most);

/// Reads a model by its extension, or makes it if the path is a synth: name (synth.h). Throws
/// Error(kInput) that names the file, what is wrong in it and where. Triangles with a non-finite
/// vertex are dropped and counted; a scene without any triangle is an error, as is one that reaches
/// beyond 1e18 m. A model with no light gets a soft sky, one with no camera a framing camera; both
/// are said in Scene::warnings. A broken part does not refuse the rest: what is shown instead of it
/// is said in Scene::replaced, an error with `strict`. All of it is also logged. Thread safe.
Scene importScene(const std::filesystem::path& path, const ImportOptions& options = {});

/// Logs what was said on import: the warnings, and the first of the parts that were replaced.
/// With `strict` it is refuseReplaced() instead of the latter.
void tellReplaced(const Scene& scene, bool strict);

/// Throws Error(kInput) with the first part of a scene that was replaced, if any was.
void refuseReplaced(const Scene& scene);

/// Size and time of a file. Throws Error(kInput) if it can't be examined.
SourceFile examineSource(const std::filesystem::path& path);

/// True if anything shines: an emissive material that an instance uses, a light, or the
/// environment.
bool hasLight(const Scene& scene);

/// What importScene does last: softSky() if nothing shines (unless
/// environmentGiven) and a framing camera if there is none. For scenes made without a file.
void addDefaultLightAndCamera(Scene& scene, bool environmentGiven);

/// Of --env, for --help.
inline constexpr const char* kEnvironmentHelp =
    "Environment: R,G,B, or a latitude-longitude .hdr or .exr: FILE or "
    "FILE?rotate=DEGREES&strength=S"
    "; its centre lies at -z, what is right of it towards +x; rotate turns it counter-clockwise as "
    "seen from above";

/// Parses "R,G,B" (radiance, W/sr/m^2, not negative) or a file name (latitude-longitude .hdr or
/// .exr, at most 32768 wide) into an environment; the file may be followed by
/// "?rotate=DEGREES&strength=S", either or both. The map's top is +y, its centre lies at -z, where
/// a camera of glTF looks that is not turned, and what is right of the centre towards +x; it is
/// rotated about +y, counter-clockwise as seen from above, and multiplied by the strength.
/// Non-finite and negative texels become 0 with a warning. Throws Error(kUsage) for a malformed
/// triple or option, Error(kInput) for a bad file.
Environment parseEnvironment(const std::string& text);

/// The file of such a text, without options; R,G,B as it is.
std::string environmentFile(const std::string& text);

/// The sky of models that bring no light: bright above, dim below, with a broad glow from the upper
/// right of glTF's front, so that shapes show.
Environment softSky();

/// Of --camera, for --help.
inline constexpr const char* kCameraHelp =
    "Camera's name, or EYE/TARGET/UP/VFOV: x,y,z/x,y,z/x,y,z/degrees; with ?fstop=N&focus=METRES "
    "it "
    "has a lens before a sensor 24 mm high";

/// Parses "NAME" (a camera of the scene) or "EYE/TARGET/UP/VFOV": three comma-separated triples in
/// metres and the vertical field of view in degrees, in (0, 180). Either may be followed by
/// "?fstop=N&focus=METRES" for a thin lens, see Camera::fstop. Throws Error(kUsage).
Camera parseCamera(const std::string& text, const Scene& scene);

/// A camera as EYE/TARGET/UP/VFOV, with its lens, which parseCamera() reads back; its name if it is
/// orthographic.
std::string cameraText(const Camera& camera);

/// A camera that sees the whole box from the front (+z), slightly above, in a square picture.
Camera framingCamera(const Box3d& bounds);

/// A framing camera for a picture: in one that is taller than wide its field of view is widened, so
/// that it shows what a square one shows. Other cameras are as they are.
Camera framedFor(Camera camera, std::uint32_t width, std::uint32_t height);

}  // namespace trex
