// scene.json, written.
#include <fmt/format.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "src/bundle/contents.h"

namespace trex::bundle {
namespace {

using Json = nlohmann::ordered_json;

template <typename Vector>
Json list(const Vector& v) {
  Json out = Json::array();
  for (int i = 0; i < v.length(); ++i) out.push_back(double{v[i]});
  return out;
}

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
  out[key] = {{"image", t.image},         {"wrap_s", nameOf(t.wrapS)}, {"wrap_t", nameOf(t.wrapT)},
              {"offset", list(t.offset)}, {"scale", list(t.scale)},    {"rotation", t.rotation}};
}

/// Left out where infinite, which JSON can't say.
void put(Json& out, const char* key, float value) {
  if (std::isfinite(value)) out[key] = double{value};
}

Json json(const Material& m) {
  Json out = {{"name", m.name},
              {"base_color", list(m.baseColor)},
              {"metallic", m.metallic},
              {"roughness", m.roughness},
              {"emission", list(m.emission)},
              {"normal_scale", m.normalScale},
              {"alpha_mode", m.alphaMode == AlphaMode::kOpaque ? "opaque"
                             : m.alphaMode == AlphaMode::kMask ? "mask"
                                                               : "blend"},
              {"alpha_cutoff", m.alphaCutoff},
              {"double_sided", m.doubleSided},
              {"unlit", m.unlit},
              {"specular", m.specular},
              {"specular_color", list(m.specularColor)},
              {"ior", m.ior},
              {"transmission", m.transmission},
              {"volume", m.volume},
              {"attenuation_color", list(m.attenuationColor)}};
  put(out, "attenuation_distance_metres", m.attenuationDistance);
  put(out, "base_color_texture", m.baseColorTexture);
  put(out, "metallic_roughness_texture", m.metallicRoughnessTexture);
  put(out, "normal_texture", m.normalTexture);
  put(out, "emissive_texture", m.emissiveTexture);
  put(out, "transmission_texture", m.transmissionTexture);
  put(out, "specular_texture", m.specularTexture);
  put(out, "specular_color_texture", m.specularColorTexture);
  return out;
}

Json json(const Light& l) {
  Json out = {{"name", l.name},
              {"type", l.type == Light::Type::kPoint  ? "point"
                       : l.type == Light::Type::kSpot ? "spot"
                                                      : "directional"},
              {"position", list(l.position)},
              {"direction", list(l.direction)},
              {"intensity", list(l.intensity)},
              {"inner_cone_angle_radians", l.innerConeAngle},
              {"outer_cone_angle_radians", l.outerConeAngle}};
  put(out, "range_metres", l.range);
  return out;
}

Json json(const Camera& c) {
  return {{"name", c.name},
          {"eye", list(c.eye)},
          {"forward", list(c.forward)},
          {"up", list(c.up)},
          {"vertical_fov_radians", c.verticalFov},
          {"orthographic", c.orthographic},
          {"orthographic_height_metres", c.orthographicHeight}};
}

Json json(const Instance& i) {
  return {
      {"name", i.name}, {"mesh", i.mesh}, {"object", i.object}, {"transform", list(i.transform)}};
}

Json json(const BakedFile& f) {
  return {{"path", f.file.path},
          {"bytes", f.file.bytes},
          {"modified_nanoseconds", f.file.modifiedNanoseconds},
          {"xxh3", fmt::format("{:016x}", f.hash)}};
}

Json json(const Requirement& r) {
  return {{"name", r.name},
          {"required", r.required},
          {"reason", r.reason},
          {"saved_bytes", r.savedBytes}};
}

Json size(const Image& image, bool isFloat) {
  return {{"name", image.name},
          {"width", image.width},
          {"height", image.height},
          {"channels", image.channels},
          {"format", isFloat ? "f32" : "u8"}};
}

Json meshes(const Description& d) {
  Json out = each(d.scene.meshes, [](const Mesh& m) {
    Json mesh = {{"name", m.name}, {"origin", list(m.origin)}, {"material", m.material}};
    if (m.sameGeometryAs != kNone) mesh["same_geometry_as"] = m.sameGeometryAs;
    return mesh;
  });
  for (const EmitterSize& e : d.emitters) {
    out[e.mesh]["emitter"] = {{"positions", e.positions}, {"triangles", e.triangles}};
  }
  return out;
}

Json json(const Environment& environment) {
  Json out = {{"color", list(environment.color)}};
  if (environment.map) out["map"] = size(*environment.map, true);
  return out;
}

}  // namespace

std::string writeDescription(const Description& d) {
  const Scene& scene = d.scene;
  Json images = Json::array();
  for (std::size_t i = 0; i < scene.images.size(); ++i) {
    images.push_back(size(scene.images[i], d.floatImages[i]));
  }
  const auto plain = [](const auto& item) { return json(item); };
  const Json out = {{"trex", kSceneVersion},
                    {"baked_by", d.bakedBy},
                    {"input", d.input},
                    {"sources", each(d.files, plain)},
                    {"precision_bits", d.precisionBits},
                    {"voxel_depth", d.voxelDepth},
                    {"requirements", each(d.requirements, plain)},
                    {"warnings", scene.warnings},
                    {"dropped_triangles", scene.droppedTriangles},
                    {"render_origin", list(d.renderOrigin)},
                    {"cameras", each(scene.cameras, plain)},
                    {"lights", each(scene.lights, plain)},
                    {"environment", json(scene.environment)},
                    {"images", images},
                    {"materials", each(scene.materials, plain)},
                    {"meshes", meshes(d)},
                    {"shared_meshes", d.sharedMeshes},
                    {"objects", scene.objects},
                    {"instances", each(scene.instances, plain)},
                    {"placements", each(d.placed, [](const RayScene::Parts::Placed& p) {
                       return Json{{"instance", p.instance}, {"hccmesh", p.mesh}};
                     })}};
  return out.dump(-1, ' ', false, Json::error_handler_t::replace) + "\n";
}

}  // namespace trex::bundle
