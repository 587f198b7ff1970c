// glTF 2.0: the file, its nodes, cameras and lights.
#include <algorithm>
#include <glm/gtc/quaternion.hpp>
#include <optional>

#include "src/scene/gltf_compressed.h"
#include "src/scene/gltf_detail.h"
#include "src/scene/gltf_file.h"
#include "src/scene/gltf_pose.h"
#include "src/scene/mapped_file.h"

namespace trex::detail {
namespace {

const std::set<std::string> kSupported = {
    "KHR_lights_punctual",        "KHR_materials_emissive_strength",
    "KHR_materials_specular",     "KHR_materials_ior",
    "KHR_materials_transmission", "KHR_materials_volume",
    "KHR_materials_unlit",        "KHR_texture_transform",
    "KHR_mesh_quantization",      "EXT_texture_webp",
    "EXT_mesh_gpu_instancing",    "KHR_node_visibility",
    "EXT_meshopt_compression",    "KHR_materials_variants",
    "KHR_materials_clearcoat",    "KHR_materials_sheen",
    "KHR_materials_anisotropy",   "KHR_materials_iridescence",
    "KHR_draco_mesh_compression", "KHR_materials_pbrSpecularGlossiness"};

/// Extensions without which the geometry is what it is: how a surface looks, and what is no part of
/// a picture.
bool isHarmless(const std::string& name) {
  for (const char* start : {"KHR_materials_",
                            "KHR_texture_",
                            "EXT_texture_",
                            "MSFT_texture_",
                            "KHR_xmp",
                            "KHR_animation_",
                            "KHR_audio",
                            "KHR_interactivity",
                            "KHR_physics",
                            "KHR_techniques",
                            "EXT_lights_",
                            "EXT_materials_",
                            "ADOBE_materials_",
                            "MSFT_lod",
                            "MSFT_packing",
                            "AGI_",
                            "EXT_mesh_features",
                            "EXT_structural_metadata",
                            "KHR_node_selectability",
                            "KHR_node_hoverability"}) {
    if (name.starts_with(start)) return true;
  }
  return false;
}

/// What the reader of another format that made this file has to say (src/assimp/child.h).
void takeNotes(GltfContext& context) {
  const tinygltf::Value& extras = context.model.asset.extras;
  const auto each = [&](const char* key, const auto& use) {
    if (!extras.IsObject() || !extras.Has(key) || !extras.Get(key).IsArray()) return;
    const tinygltf::Value& list = extras.Get(key);
    for (std::size_t i = 0; i < list.ArrayLen(); ++i) {
      const tinygltf::Value& text = list.Get(static_cast<int>(i));
      if (text.IsString()) use(oneLine(text.Get<std::string>()));
    }
  };
  each("replaced", [&](const std::string& text) { context.replace("{}", text); });
  each("warnings", [&](const std::string& text) { context.warn("{}", text); });
  each("files", [&](const std::string& file) {
    if (file != context.name) noteFile(context.scene, file);
  });
}

void checkVersionAndExtensions(GltfContext& context) {
  const tinygltf::Model& model = context.model;
  if (model.asset.version.substr(0, 2) != "2.") {
    context.bad("glTF version {} can't be read, only 2.x", model.asset.version);
  }
  for (const std::string& name : model.extensionsRequired) {
    if (kSupported.contains(name)) continue;
    if (!isHarmless(name)) {
      context.bad("requires the extension {}, which is not supported; export it without", name);
    }
    context.replace("requires the extension {}, which is not shown", name);
  }
  for (const std::string& name : model.extensionsUsed) {
    if (!kSupported.contains(name)) context.warn("the extension {} is ignored", name);
  }
}

bool isFiniteMatrix(const dmat4& m) {
  for (int c = 0; c < 4; ++c) {
    for (int r = 0; r < 4; ++r) {
      if (!std::isfinite(m[c][r])) return false;
    }
  }
  return true;
}

/// Reads the nodes of one scene.
class NodeReader {
 public:
  explicit NodeReader(GltfContext& context)
      : context_(context),
        materials_(context),
        meshes_(context, materials_),
        pose_(context),
        visited_(context.model.nodes.size()),
        hidden_(context.model.nodes.size()),
        world_(context.model.nodes.size(), dmat4(1.0)) {}

  void read() {
    nameObjects();
    // Skins ask for the transforms of other nodes, so these come first.
    const std::vector<int> order = placeNodes();
    for (const int index : order) readNode(context_.model.nodes[index], index, world_[index]);
    materials_.loadImages();
    if (context_.scene.materials.empty()) context_.scene.materials.emplace_back();
  }

 private:
  void nameObjects() {
    const auto& nodes = context_.model.nodes;
    for (std::size_t i = 0; i < nodes.size(); ++i) {
      context_.scene.objects.push_back(nodes[i].name.empty() ? fmt::format("node {}", i)
                                                             : nodes[i].name);
    }
  }

  std::vector<int> rootNodes() {
    const tinygltf::Model& model = context_.model;
    const std::string& wanted = context_.options.scene;
    for (std::size_t i = 0; !wanted.empty() && i < model.scenes.size(); ++i) {
      if (model.scenes[i].name == wanted || std::to_string(i) == wanted) {
        return model.scenes[i].nodes;
      }
    }
    if (!wanted.empty()) {
      std::string names;
      for (std::size_t i = 0; i < std::min<std::size_t>(model.scenes.size(), 20); ++i) {
        names += (i > 0 ? ", " : "") + fmt::format("{} '{}'", i, model.scenes[i].name);
      }
      fail(ExitCode::kUsage, "{}: has no scene '{}'; it has {}", context_.name, wanted,
           names.empty() ? "none" : names);
    }
    if (!model.scenes.empty()) {
      const int index = std::max(model.defaultScene, 0);
      if (std::size_t(index) < model.scenes.size()) return model.scenes[index].nodes;
      context_.replace("scene {} does not exist; there are {}; scene 0 is shown", index,
                       model.scenes.size());
      return model.scenes[0].nodes;
    }
    std::vector<bool> isChild(model.nodes.size());
    for (const tinygltf::Node& node : model.nodes) {
      for (const int child : node.children) {
        if (child >= 0 && std::size_t(child) < isChild.size()) isChild[child] = true;
      }
    }
    std::vector<int> roots;
    for (std::size_t i = 0; i < isChild.size(); ++i) {
      if (!isChild[i]) roots.push_back(static_cast<int>(i));
    }
    return roots;
  }

  /// Fills `world_`; returns the nodes of the scene in their order.
  std::vector<int> placeNodes() {
    std::vector<int> order;
    std::vector<std::pair<int, dmat4>> open;  // a stack: hostile trees may be deep
    const std::vector<int> roots = rootNodes();
    for (auto it = roots.rbegin(); it != roots.rend(); ++it) open.emplace_back(*it, dmat4(1.0));
    while (!open.empty()) {
      const auto [index, parent] = open.back();
      open.pop_back();
      if (!visit(index)) continue;
      const tinygltf::Node& node = context_.model.nodes[index];
      hidden_[index] = hidden_[index] || saysHidden(node);
      const dmat4 world = parent * pose_.local(index);
      if (!isFiniteMatrix(world)) {
        context_.replace("node {} ('{}'): its transform is not finite; it is left out", index,
                         node.name);
        continue;
      }
      world_[index] = world;
      order.push_back(index);
      for (auto it = node.children.rbegin(); it != node.children.rend(); ++it) {
        if (hidden_[index] && std::size_t(*it) < hidden_.size()) hidden_[*it] = true;
        open.emplace_back(*it, world);
      }
    }
    return order;
  }

  static bool saysHidden(const tinygltf::Node& node) {
    const auto found = node.extensions.find("KHR_node_visibility");
    if (found == node.extensions.end() || !found->second.IsObject()) return false;
    const tinygltf::Value& visible = found->second.Get("visible");
    return visible.IsBool() && !visible.Get<bool>();
  }

  /// Whether a node is there and was not shown before.
  bool visit(int index) {
    if (index < 0 || std::size_t(index) >= visited_.size()) {
      context_.replace("node {} does not exist; there are {}; it is left out", index,
                       visited_.size());
      return false;
    }
    if (visited_[index]) {
      context_.replace("node {} has two parents or is its own ancestor; it is shown once", index);
      return false;
    }
    visited_[index] = true;
    return true;
  }

  void readNode(const tinygltf::Node& node, int index, const dmat4& world) {
    if (node.camera >= 0) context_.attempt(kLeftOut, [&] { readCamera(node, world); });
    if (hidden_[index]) return;
    if (node.mesh >= 0) readMesh(node, index, world);
    if (node.extras.IsObject() && node.extras.Has("trex_volume")) {
      context_.attempt(kLeftOut, [&] { readVolume(node.extras.Get("trex_volume"), index, world); });
    }
    const auto light = node.extensions.find("KHR_lights_punctual");
    if (light == node.extensions.end()) return;
    context_.attempt(kLeftOut, [&] { readLight(node, index, light->second, world); });
  }

  void readMesh(const tinygltf::Node& node, int index, const dmat4& world) {
    GltfDeformation deformation;
    deformation.weights = pose_.weights(index);
    if (node.skin >= 0) {
      context_.attempt("the mesh is shown unbent",
                       [&] { deformation.joints = skinMatrices(context_, node.skin, world_); });
    }
    // The joints place a skinned mesh; its node does not.
    const dmat4 placed = deformation.joints.empty() ? world : dmat4(1.0);
    const std::vector<int> meshes = meshes_.use(node.mesh, deformation);
    const auto instances = node.extensions.find("EXT_mesh_gpu_instancing");
    if (instances != node.extensions.end() && context_.attempt("one is shown", [&] {
          for (const dmat4& m : readInstances(instances->second)) {
            for (const int mesh : meshes) place(mesh, index, placed * m);
          }
        })) {
      return;
    }
    for (const int mesh : meshes) place(mesh, index, placed);
  }

  /// Transforms of EXT_mesh_gpu_instancing, from the instance to the node.
  std::vector<dmat4> readInstances(const tinygltf::Value& extension) {
    std::array<std::optional<GltfAccessor>, 3> values;
    constexpr std::array<const char*, 3> kNames = {"TRANSLATION", "ROTATION", "SCALE"};
    std::uint64_t count = 0;
    const bool given = extension.IsObject() && extension.Has("attributes") &&
                       extension.Get("attributes").IsObject();
    for (std::size_t k = 0; given && k < 3; ++k) {
      const tinygltf::Value& attributes = extension.Get("attributes");
      if (!attributes.Has(kNames[k]) || !attributes.Get(kNames[k]).IsNumber()) continue;
      values[k].emplace(context_, indexOf(attributes.Get(kNames[k])));
      if (values[k]->components() != (k == 1 ? 4 : 3)) {
        context_.bad("EXT_mesh_gpu_instancing: {} has the wrong type", kNames[k]);
      }
      if (count > 0 && values[k]->count() != count) {
        context_.bad("EXT_mesh_gpu_instancing: its attributes differ in their counts");
      }
      count = values[k]->count();
    }
    constexpr std::uint64_t kMostInstances = 50'000'000;
    if (count == 0 || count > kMostInstances) {
      context_.bad("EXT_mesh_gpu_instancing: {} instances are not possible", count);
    }
    std::vector<dmat4> out(count, dmat4(1.0));
    for (std::uint64_t i = 0; i < count; ++i) {
      const auto at = [&](int k, int c) { return double{values[k]->value(i, c)}; };
      dmat4& m = out[i];
      if (values[1]) {
        const glm::dquat q(at(1, 3), at(1, 0), at(1, 1), at(1, 2));
        if (glm::length(q) > 0.0) m = glm::mat4_cast(glm::normalize(q));
      }
      for (int c = 0; values[2] && c < 3; ++c) m[c] *= at(2, c);
      for (int c = 0; values[0] && c < 3; ++c) m[3][c] = at(0, c);
      if (!isFiniteMatrix(m)) context_.bad("EXT_mesh_gpu_instancing: instance {} is not finite", i);
    }
    return out;
  }

  void place(int mesh, int node, const dmat4& world) {
    Instance instance;
    instance.name = context_.scene.objects[node];
    instance.mesh = mesh;
    instance.transform = world;
    instance.object = node;
    const double scale =
        glm::length(dvec3(world[0])) * glm::length(dvec3(world[1])) * glm::length(dvec3(world[2]));
    const double determinant = glm::determinant(glm::dmat3(world));
    if (!(std::abs(determinant) > 1e-12 * scale) || !std::isnormal(determinant)) {
      flatten(instance);
    }
    context_.scene.instances.push_back(std::move(instance));
  }

  /// A transform that can't be inverted (a scale of 0) is applied to a copy of the mesh.
  void flatten(Instance& instance) {
    context_.warn("node '{}': its transform has no volume", instance.name);
    Mesh mesh = context_.scene.meshes[instance.mesh];
    for (vec3& p : mesh.positions) {
      p = vec3(dvec3(instance.transform * glm::dvec4(mesh.origin + dvec3(p), 1.0)));
    }
    mesh.origin = dvec3(0.0);
    mesh.normals.clear();
    mesh.sameGeometryAs = kNone;
    sanitiseMesh(context_.scene, mesh, context_.name + ": node '" + instance.name + "'");
    instance.mesh = static_cast<int>(context_.scene.meshes.size());
    instance.transform = dmat4(1.0);
    context_.scene.meshes.push_back(std::move(mesh));
  }

  vec3 axis(const dmat4& world, int column, const vec3& fallback) const {
    const dvec3 a(world[column]);
    const double length = glm::length(a);
    return length > 0.0 && std::isfinite(length) ? vec3(a / length) : fallback;
  }

  void readCamera(const tinygltf::Node& node, const dmat4& world) {
    const auto& cameras = context_.model.cameras;
    if (std::size_t(node.camera) >= cameras.size()) {
      context_.bad("node '{}': camera {} does not exist", node.name, node.camera);
    }
    const tinygltf::Camera& from = cameras[node.camera];
    Camera to;
    to.name = !from.name.empty()   ? from.name
              : !node.name.empty() ? node.name
                                   : fmt::format("camera {}", context_.scene.cameras.size());
    to.eye = dvec3(world[3]);
    to.forward = -axis(world, 2, vec3(0.0f, 0.0f, 1.0f));
    const vec3 up = axis(world, 1, vec3(0.0f, 1.0f, 0.0f));
    const vec3 straight = up - glm::dot(up, to.forward) * to.forward;
    to.up = glm::length(straight) > 1e-6f ? glm::normalize(straight) : Basis(to.forward).tangent;
    if (from.type == "orthographic") {
      to.orthographic = true;
      to.orthographicHeight = static_cast<float>(2.0 * std::abs(from.orthographic.ymag));
      if (!(to.orthographicHeight > 0.0f) || !std::isfinite(to.orthographicHeight)) {
        context_.bad("camera '{}': ymag must be more than 0", to.name);
      }
    } else {
      to.verticalFov = static_cast<float>(from.perspective.yfov);
      if (!(to.verticalFov > 0.0f && to.verticalFov < kPi)) {
        context_.bad("camera '{}': yfov {} must be between 0 and pi", to.name,
                     from.perspective.yfov);
      }
    }
    context_.scene.cameras.push_back(std::move(to));
  }

  void readLight(const tinygltf::Node& node, int index, const tinygltf::Value& extension,
                 const dmat4& world) {
    const auto& lights = context_.model.lights;
    if (!extension.IsObject() || !extension.Has("light") || !extension.Get("light").IsNumber()) {
      context_.bad("node {} ('{}'): KHR_lights_punctual has no light", index, node.name);
    }
    const int number = indexOf(extension.Get("light"));
    if (number < 0 || std::size_t(number) >= lights.size()) {
      context_.bad("node {} ('{}'): light {} does not exist", index, node.name, number);
    }
    const tinygltf::Light& from = lights[number];
    Light to;
    to.name = from.name.empty() ? node.name : from.name;
    if (from.type == "directional") {
      to.type = Light::Type::kDirectional;
    } else if (from.type == "spot") {
      to.type = Light::Type::kSpot;
      readCone(from, to);
    } else if (from.type != "point") {
      context_.bad("light {} ('{}'): unknown type '{}'", number, from.name, from.type);
    }
    to.position = dvec3(world[3]);
    to.direction = -axis(world, 2, vec3(0.0f, 0.0f, 1.0f));
    vec3 color(1.0f);
    for (std::size_t k = 0; k < 3 && from.color.size() == 3; ++k) {
      color[int(k)] = static_cast<float>(from.color[k]);
    }
    to.intensity = color * static_cast<float>(from.intensity);
    for (int k = 0; k < 3; ++k) {
      if (to.intensity[k] >= 0.0f && std::isfinite(to.intensity[k])) continue;
      context_.replace("light {} ('{}'): negative or non-finite intensity; 0 is used", number,
                       from.name);
      to.intensity[k] = 0.0f;
    }
    if (from.range > 0.0) to.range = static_cast<float>(from.range);
    context_.scene.lights.push_back(std::move(to));
  }

  /// A volume that the node places: the keys of --volume, and `file` beside the model.
  void readVolume(const tinygltf::Value& from, int index, const dmat4& world) {
    const auto bad = [&](const std::string& what) {
      context_.bad("node {} ('{}'): trex_volume: {}", index, context_.scene.objects[index], what);
    };
    if (!from.IsObject() || !from.Has("file") || !from.Get("file").IsString()) {
      bad("has no file");
    }
    const auto name = from.Get("file").Get<std::string>();
    if (name.find("://") != std::string::npos) bad("'" + name.substr(0, 80) + "' is no file name");
    VolumeRequest request;
    request.file = (context_.path.parent_path() / name).string();
    request.transform = world;
    for (const std::string& key : from.Keys()) {
      if (key == "file") continue;
      const tinygltf::Value& value = from.Get(key);
      std::vector<double> numbers;
      const std::size_t count = value.IsArray() ? value.ArrayLen() : 1;
      for (std::size_t i = 0; i < std::min<std::size_t>(count, 4); ++i) {
        const tinygltf::Value& number = value.IsArray() ? value.Get(static_cast<int>(i)) : value;
        if (!number.IsNumber()) bad("'" + key + "' is not a number or a list of them");
        numbers.push_back(number.GetNumberAsDouble());
      }
      const std::string problem = setVolumeOption(request, key, numbers);
      if (!problem.empty()) bad(problem);
    }
    addVolume(context_.scene, request, context_.options.maxMemory);
  }

  void readCone(const tinygltf::Light& from, Light& to) {
    const double outer = std::clamp(from.spot.outerConeAngle, 1e-4, 0.5 * std::numbers::pi);
    const double inner = std::clamp(from.spot.innerConeAngle, 0.0, outer);
    if (outer != from.spot.outerConeAngle || inner != from.spot.innerConeAngle) {
      context_.replace("light '{}': cone angles out of range; the nearest in it are used",
                       from.name);
    }
    to.outerConeAngle = static_cast<float>(outer);
    to.innerConeAngle = static_cast<float>(inner);
  }

  GltfContext& context_;
  GltfMaterials materials_;
  GltfMeshes meshes_;
  GltfPose pose_;
  std::vector<bool> visited_, hidden_;
  std::vector<dmat4> world_;  ///< from each node of the scene
};

}  // namespace

namespace {

Scene read(std::span<const std::uint8_t> bytes, const std::filesystem::path& path,
           const ImportOptions& options, bool handedOver) {
  GltfContext context;
  context.path = path;
  context.name = path.string();
  context.options = options;
  context.scene.textures = options.textures;
  context.handedOver = handedOver;
  parseGltf(context, bytes);
  if (handedOver) takeNotes(context);
  checkVersionAndExtensions(context);
  decodeMeshopt(context);
  NodeReader(context).read();
  return std::move(context.scene);
}

}  // namespace

Scene readGltf(const std::filesystem::path& path, const ImportOptions& options) {
  const MappedFile file(path);
  return read({file.data(), file.size()}, path, options, false);
}

Scene readHandedOver(std::span<const std::uint8_t> bytes, const std::filesystem::path& path,
                     const ImportOptions& options) {
  return read(bytes, path, options, true);
}

}  // namespace trex::detail
