// scene.json, read.
#include <charconv>
#include <cmath>
#include <numbers>

#include "src/bundle/contents.h"
#include "src/core/json_object.h"
#include "src/scene/scene_json.h"

namespace trex::bundle {
namespace {

using nlohmann::json;

constexpr int kMaxImageSide = 1 << 16;
constexpr std::uint64_t kMaxTexels = std::uint64_t{1} << 30;
constexpr std::uint64_t kMaxElements = 0xfffffff0u;  // of a mesh: indices are 32 bits wide

Texture readTexture(const JsonObject& material, const char* key, std::size_t images) {
  Texture t;
  if (!material.has(key)) return t;
  const JsonObject o = material.object(key);
  o.allow({"image", "wrap_s", "wrap_t", "offset", "scale", "rotation", "nearest", "set"});
  t.image = static_cast<int>(o.index("image", images));
  t.wrapS = static_cast<Texture::Wrap>(o.oneOf("wrap_s", {"repeat", "mirror", "clamp"}));
  t.wrapT = static_cast<Texture::Wrap>(o.oneOf("wrap_t", {"repeat", "mirror", "clamp"}));
  o.reals("offset", &t.offset[0], 2);
  o.reals("scale", &t.scale[0], 2);
  t.rotation = o.real("rotation");
  t.nearest = o.has("nearest") && o.boolean("nearest");
  if (o.has("set")) t.set = static_cast<std::uint8_t>(o.integer("set", 0, 1));
  return t;
}

Material readMaterial(const JsonObject& o, std::size_t images) {
  std::vector<const char*> keys = materialKeys();
  keys.insert(keys.end(), kTextureKeys.begin(), kTextureKeys.end());
  o.allow(keys);
  Material m;
  readMaterialJson(o, m, true);
  const auto textures = m.textures();
  for (std::size_t i = 0; i < textures.size(); ++i) {
    *textures[i] = readTexture(o, kTextureKeys[i], images);
  }
  return m;
}

Image readImage(const JsonObject& o, TexelKind& kind) {
  o.allow({"name", "width", "height", "channels", "format"});
  Image image;
  image.name = o.text("name");
  image.width = static_cast<int>(o.integer("width", 1, kMaxImageSide));
  image.height = static_cast<int>(o.integer("height", 1, kMaxImageSide));
  image.channels = static_cast<int>(o.integer("channels", 1, 4));
  kind = static_cast<TexelKind>(o.oneOf(
      "format", {kTexelKeys[0], kTexelKeys[1], kTexelKeys[2], kTexelKeys[3], kTexelKeys[4]}));
  if (std::uint64_t(image.width) * std::uint64_t(image.height) > kMaxTexels) {
    o.bad("height", "the image has more than {} texels", kMaxTexels);
  }
  return image;
}

Environment readEnvironment(const JsonObject& o) {
  o.allow({"color", "map", "rotation"});
  Environment environment;
  environment.color = jsonVector(o, "color", 0.0f);
  if (o.has("rotation")) environment.rotation = o.real("rotation", -1e4f, 1e4f);
  if (!o.has("map")) return environment;
  TexelKind kind{};
  const JsonObject size = o.object("map");
  auto map = std::make_shared<Image>(readImage(size, kind));
  if (map->channels != 3) size.bad("channels", "must be 3");
  if (kind != TexelKind::kFloat) size.bad("format", "must be f32");
  environment.map = std::move(map);
  return environment;
}

/// An affine matrix, column after column.
void readTransform(const JsonObject& o, dmat4& out) {
  o.numbers("transform", &out[0][0], 16);
  for (int column = 0; column < 4; ++column) {
    if (out[column][3] != (column == 3 ? 1.0 : 0.0)) o.bad("transform", "is not affine");
  }
}

/// A medium without its grid.
Medium readMedium(const JsonObject& o) {
  o.allow({"name", "transform", "density", "albedo", "anisotropy", "emission"});
  Medium m;
  m.name = o.text("name");
  readTransform(o, m.transform);
  const double determinant = glm::determinant(glm::dmat3(m.transform));
  if (!std::isnormal(determinant)) o.bad("transform", "has no volume");
  m.density = o.real("density", 0.0f, 1e12f);
  o.reals("albedo", &m.albedo[0], 3, 0.0f, 1.0f);
  m.anisotropy = o.real("anisotropy", -0.99f, 0.99f);
  o.reals("emission", &m.emission[0], 3, 0.0f, 1e12f);
  return m;
}

Instance readInstance(const JsonObject& o, std::size_t meshes, std::size_t objects) {
  o.allow({"name", "mesh", "object", "transform"});
  Instance i;
  i.name = o.text("name");
  i.mesh = static_cast<int>(o.index("mesh", meshes));
  i.object = static_cast<int>(o.index("object", objects));
  readTransform(o, i.transform);
  return i;
}

BakedFile readFile(const JsonObject& o) {
  o.allow({"path", "bytes", "modified_nanoseconds", "xxh3"});
  BakedFile f;
  f.file.path = o.text("path");
  f.file.bytes = o.integer("bytes", 0, std::uint64_t{1} << 62);
  f.file.modifiedNanoseconds = o.signedInteger("modified_nanoseconds");
  const std::string hash = o.text("xxh3");
  const char* end = hash.data() + hash.size();
  const auto [at, problem] = std::from_chars(hash.data(), end, f.hash, 16);
  if (hash.size() != 16 || at != end || problem != std::errc()) {
    o.bad("xxh3", "is not 16 hexadecimal digits");
  }
  return f;
}

Requirement readRequirement(const JsonObject& o) {
  o.allow({"name", "required", "reason", "saved_bytes"});
  return {o.text("name"), o.boolean("required"), o.text("reason"),
          o.integer("saved_bytes", 0, ~std::uint64_t{0})};
}

std::vector<std::string> texts(const JsonObject& o, const char* key) {
  std::vector<std::string> out;
  for (const json& value : o.array(key)) {
    if (!value.is_string()) o.bad(key, "has an element that is not a string");
    out.push_back(value.get<std::string>());
  }
  return out;
}

/// Calls add(object) for each element of an array.
template <typename Function>
void forEach(const JsonObject& o, const char* key, Function add) {
  const std::size_t count = o.array(key).size();
  if (count > 0x7fffffffu) o.bad(key, "has too many elements");
  for (std::size_t i = 0; i < count; ++i) add(o.element(key, i));
}

void readMeshes(const JsonObject& root, Description& d) {
  forEach(root, "meshes", [&](const JsonObject& o) {
    o.allow({"name", "origin", "material", "same_geometry_as", "emitter"});
    const std::size_t number = d.scene.meshes.size();
    Mesh m;
    m.name = o.text("name");
    o.numbers("origin", &m.origin[0], 3);
    m.material = static_cast<int>(o.index("material", d.scene.materials.size()));
    const bool emits = d.scene.materials[static_cast<std::size_t>(m.material)].emits();
    if (o.has("same_geometry_as")) {
      m.sameGeometryAs = static_cast<int>(o.index("same_geometry_as", number));
    }
    if (o.has("emitter") != emits) o.bad("emitter", "must be there just where the material emits");
    if (emits) {
      const JsonObject e = o.object("emitter");
      e.allow({"positions", "triangles"});
      d.emitters.push_back({number, e.integer("positions", 0, kMaxElements),
                            e.integer("triangles", 0, kMaxElements)});
    }
    d.scene.meshes.push_back(std::move(m));
  });
}

void readPlacements(const JsonObject& root, Description& d) {
  forEach(root, "placements", [&](const JsonObject& o) {
    o.allow({"instance", "hccmesh"});
    RayScene::Parts::Placed placed{RayScene::Parts::kNoInstance,
                                   static_cast<std::uint32_t>(o.index("hccmesh", d.sharedMeshes))};
    if (o.has("instance")) {
      placed.instance = static_cast<std::uint32_t>(o.index("instance", d.scene.instances.size()));
    }
    d.placed.push_back(placed);
  });
}

void readScene(const JsonObject& root, Description& d) {
  Scene& s = d.scene;
  s.warnings = texts(root, "warnings");
  s.replaced.texts = texts(root, "replaced");
  s.replaced.count = root.integer("replaced_parts", s.replaced.texts.size(), ~std::uint64_t{0});
  if (s.replaced.count > 0 && s.replaced.texts.empty()) root.bad("replaced", "is empty");
  s.objects = texts(root, "objects");
  s.droppedTriangles = root.integer("dropped_triangles", 0, ~std::uint64_t{0});
  forEach(root, "cameras", [&](const JsonObject& o) { s.cameras.push_back(readCameraJson(o)); });
  forEach(root, "lights", [&](const JsonObject& o) { s.lights.push_back(readLightJson(o)); });
  s.environment = readEnvironment(root.object("environment"));
  if (root.has("media")) {
    forEach(root, "media", [&](const JsonObject& o) { s.media.push_back(readMedium(o)); });
  }
  if (root.has("max_bounces")) {
    s.maxBounces =
        static_cast<std::uint32_t>(root.integer("max_bounces", 0, Scene::kAnyBounces - 1));
  }
  forEach(root, "images", [&](const JsonObject& o) {
    TexelKind kind{};
    s.images.push_back(readImage(o, kind));
    d.imageKinds.push_back(kind);
  });
  forEach(root, "materials",
          [&](const JsonObject& o) { s.materials.push_back(readMaterial(o, s.images.size())); });
  if (s.materials.empty()) root.bad("materials", "is empty");
  readMeshes(root, d);
  forEach(root, "instances", [&](const JsonObject& o) {
    s.instances.push_back(readInstance(o, s.meshes.size(), s.objects.size()));
  });
  if (s.cameras.empty()) root.bad("cameras", "is empty");
}

Description read(const JsonObject& root) {
  if (root.integer("trex", 0, 1u << 30) != kSceneVersion) {
    root.bad("trex", "this program reads version {}", kSceneVersion);
  }
  root.allow({"trex",          "baked_by",       "input",
              "sources",       "precision_bits", "voxel_depth",
              "requirements",  "warnings",       "dropped_triangles",
              "replaced",      "replaced_parts", "render_origin",
              "cameras",       "lights",         "environment",
              "images",        "materials",      "meshes",
              "shared_meshes", "objects",        "instances",
              "placements",    "media",          "max_bounces"});
  Description d;
  d.bakedBy = root.text("baked_by");
  d.input = root.text("input");
  forEach(root, "sources", [&](const JsonObject& o) { d.files.push_back(readFile(o)); });
  d.precisionBits = static_cast<int>(root.integer("precision_bits", 8, 24));
  d.voxelDepth = static_cast<int>(root.integer("voxel_depth", 0, 32));
  forEach(root, "requirements",
          [&](const JsonObject& o) { d.requirements.push_back(readRequirement(o)); });
  root.numbers("render_origin", &d.renderOrigin[0], 3);
  d.sharedMeshes = static_cast<std::uint32_t>(root.integer("shared_meshes", 0, 1u << 19));
  readScene(root, d);
  readPlacements(root, d);
  return d;
}

}  // namespace

Description readDescription(std::span<const std::byte> text, const std::string& name) {
  const char* first = reinterpret_cast<const char*>(text.data());
  json document;
  try {
    document = json::parse(first, first + text.size());
  } catch (const json::exception& e) {
    fail(ExitCode::kInput, "{}: scene.json is not JSON: {:.200}; bake again", name, e.what());
  }
  const JsonDocument place{name + ": scene.json", "; bake again"};
  return read(JsonObject(document, place, ""));
}

}  // namespace trex::bundle
