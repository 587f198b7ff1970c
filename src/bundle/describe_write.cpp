// scene.json, written.
#include <fmt/format.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "src/bundle/contents.h"
#include "src/scene/scene_json.h"

namespace trex::bundle {
namespace {

using Json = OrderedJson;

Json list(const dmat4& m) {
  Json out = Json::array();
  for (int column = 0; column < 4; ++column) {
    for (int row = 0; row < 4; ++row) out.push_back(m[column][row]);
  }
  return out;
}

template <typename Items, typename Function>
Json each(const Items& items, Function function) {
  Json out = Json::array();
  for (const auto& item : items) out.push_back(function(item));
  return out;
}

const char* nameOf(Texture::Wrap wrap) {
  return wrap == Texture::Wrap::kRepeat   ? "repeat"
         : wrap == Texture::Wrap::kMirror ? "mirror"
                                          : "clamp";
}

void put(Json& out, const char* key, const Texture& t) {
  if (!t.present()) return;
  out[key] = {{"image", t.image},           {"wrap_s", nameOf(t.wrapS)},
              {"wrap_t", nameOf(t.wrapT)},  {"offset", jsonList(t.offset)},
              {"scale", jsonList(t.scale)}, {"rotation", t.rotation}};
  if (t.nearest) out[key]["nearest"] = true;
  if (t.set != 0) out[key]["set"] = t.set;
}

Json toJson(const Material& m) {
  Json out = materialJson(m);
  const auto textures = m.textures();
  for (std::size_t i = 0; i < textures.size(); ++i) put(out, kTextureKeys[i], *textures[i]);
  return out;
}

Json toJson(const Light& l) { return lightJson(l); }
Json toJson(const Camera& c) { return cameraJson(c); }

Json toJson(const Instance& i) {
  return {
      {"name", i.name}, {"mesh", i.mesh}, {"object", i.object}, {"transform", list(i.transform)}};
}

Json toJson(const BakedFile& f) {
  return {{"path", f.file.path},
          {"bytes", f.file.bytes},
          {"modified_nanoseconds", f.file.modifiedNanoseconds},
          {"xxh3", fmt::format("{:016x}", f.hash)}};
}

Json toJson(const Requirement& r) {
  return {{"name", r.name},
          {"required", r.required},
          {"reason", r.reason},
          {"saved_bytes", r.savedBytes}};
}

Json toJson(const Medium& m) {
  return {{"name", m.name},
          {"transform", list(m.transform)},
          {"density", m.density},
          {"albedo", jsonList(m.albedo)},
          {"anisotropy", m.anisotropy},
          {"emission", jsonList(m.emission)}};
}

Json size(const Image& image, TexelKind kind) {
  return {{"name", image.name},
          {"width", image.width},
          {"height", image.height},
          {"channels", image.channels},
          {"format", kTexelKeys[static_cast<std::size_t>(kind)]}};
}

Json meshes(const Description& d) {
  Json out = each(d.scene.meshes, [](const Mesh& m) {
    Json mesh = {{"name", m.name}, {"origin", jsonList(m.origin)}, {"material", m.material}};
    if (m.sameGeometryAs != kNone) mesh["same_geometry_as"] = m.sameGeometryAs;
    return mesh;
  });
  for (const EmitterSize& e : d.emitters) {
    out[e.mesh]["emitter"] = {{"positions", e.positions}, {"triangles", e.triangles}};
  }
  return out;
}

Json toJson(const Environment& environment) {
  Json out = {{"color", jsonList(environment.color)}};
  if (environment.map) out["map"] = size(*environment.map, TexelKind::kFloat);
  if (environment.rotation != 0.0f) out["rotation"] = double{environment.rotation};
  return out;
}

}  // namespace

std::string writeDescription(const Description& d) {
  const Scene& scene = d.scene;
  Json images = Json::array();
  for (std::size_t i = 0; i < scene.images.size(); ++i) {
    images.push_back(size(scene.images[i], d.imageKinds[i]));
  }
  const auto plain = [](const auto& item) { return toJson(item); };
  Json out = {{"trex", kSceneVersion},
              {"baked_by", d.bakedBy},
              {"input", d.input},
              {"sources", each(d.files, plain)},
              {"precision_bits", d.precisionBits},
              {"voxel_depth", d.voxelDepth},
              {"requirements", each(d.requirements, plain)},
              {"warnings", scene.warnings},
              {"replaced", scene.replaced.texts},
              {"replaced_parts", scene.replaced.count},
              {"dropped_triangles", scene.droppedTriangles},
              {"render_origin", jsonList(d.renderOrigin)},
              {"cameras", each(scene.cameras, plain)},
              {"lights", each(scene.lights, plain)},
              {"environment", toJson(scene.environment)},
              {"images", images},
              {"materials", each(scene.materials, plain)},
              {"meshes", meshes(d)},
              {"shared_meshes", d.sharedMeshes},
              {"objects", scene.objects},
              {"instances", each(scene.instances, plain)},
              {"placements", each(d.placed, [](const RayScene::Parts::Placed& p) {
                 Json placement{{"hccmesh", p.mesh}};
                 if (p.instance != RayScene::Parts::kNoInstance) placement["instance"] = p.instance;
                 return placement;
               })}};
  if (!scene.media.empty()) out["media"] = each(scene.media, plain);
  if (scene.maxBounces != Scene::kAnyBounces) out["max_bounces"] = scene.maxBounces;
  return out.dump(-1, ' ', false, Json::error_handler_t::replace) + "\n";
}

}  // namespace trex::bundle
