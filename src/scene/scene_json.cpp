#include "src/scene/scene_json.h"

#include <cmath>
#include <numbers>

namespace trex {
namespace {

constexpr float kLeast = std::numeric_limits<float>::denorm_min();
constexpr auto kAlphaModes = {"opaque", "mask", "blend"};
constexpr auto kLightTypes = {"point", "spot", "directional"};

template <typename Enum>
const char* word(std::initializer_list<const char*> words, Enum value) {
  return words.begin()[static_cast<std::size_t>(value)];
}

/// Left out where infinite, which JSON can't say.
void put(OrderedJson& out, const char* key, float value) {
  if (std::isfinite(value)) out[key] = double{value};
}

struct FinishNumber {
  const char* key;
  float Finish::*value;
  float low, high;
};
constexpr float kMostNanometres = 1e6f;
constexpr FinishNumber kFinishNumbers[] = {
    {"clearcoat", &Finish::clearcoat, 0.0f, 1.0f},
    {"clearcoat_roughness", &Finish::clearcoatRoughness, 0.0f, 1.0f},
    {"clearcoat_normal_scale", &Finish::clearcoatNormalScale, -1e6f, 1e6f},
    {"sheen_roughness", &Finish::sheenRoughness, 0.0f, 1.0f},
    {"anisotropy", &Finish::anisotropy, 0.0f, 1.0f},
    {"anisotropy_rotation_radians", &Finish::anisotropyRotation, -1e6f, 1e6f},
    {"iridescence", &Finish::iridescence, 0.0f, 1.0f},
    {"iridescence_ior", &Finish::iridescenceIor, 1.0f, 100.0f},
    {"iridescence_thinnest_nanometres", &Finish::iridescenceThinnest, 0.0f, kMostNanometres},
    {"iridescence_thickest_nanometres", &Finish::iridescenceThickest, 0.0f, kMostNanometres}};

/// What a plain material has too is left out.
void putFinish(OrderedJson& out, const Finish& finish) {
  const Finish plain;
  for (const FinishNumber& n : kFinishNumbers) {
    if (finish.*n.value != plain.*n.value) out[n.key] = double{finish.*n.value};
  }
  if (finish.sheens()) out["sheen_color"] = jsonList(finish.sheenColor);
  if (finish.conducts()) {
    out["metal_eta"] = jsonList(finish.metalEta);
    out["metal_k"] = jsonList(finish.metalK);
  }
  if (finish.beckmann) out["beckmann"] = true;
}

void readFinish(const JsonObject& o, Finish& finish) {
  for (const FinishNumber& n : kFinishNumbers) {
    if (o.has(n.key)) finish.*n.value = o.real(n.key, n.low, n.high);
  }
  if (o.has("sheen_color")) finish.sheenColor = jsonVector(o, "sheen_color", 0.0f, 1.0f);
  if (o.has("metal_eta"))
    finish.metalEta = jsonVector(o, "metal_eta", 0.0f, Finish::kMostMetalIndex);
  if (o.has("metal_k")) finish.metalK = jsonVector(o, "metal_k", 0.0f, Finish::kMostMetalIndex);
  if (o.has("beckmann")) finish.beckmann = o.boolean("beckmann");
}

}  // namespace

vec3 jsonVector(const JsonObject& o, const char* key, float low, float high) {
  vec3 v;
  o.reals(key, &v[0], 3, low, high);
  return v;
}

vec3 jsonUnitVector(const JsonObject& o, const char* key) {
  const vec3 v = jsonVector(o, key, -1.1f, 1.1f);
  if (std::abs(glm::length(v) - 1.0f) > 1e-3f) o.bad(key, "is not of length 1");
  return v;
}

OrderedJson materialJson(const Material& m) {
  OrderedJson out = {{"name", m.name},
                     {"base_color", jsonList(m.baseColor)},
                     {"metallic", m.metallic},
                     {"roughness", m.roughness},
                     {"emission", jsonList(m.emission)},
                     {"normal_scale", m.normalScale},
                     {"alpha_mode", word(kAlphaModes, m.alphaMode)},
                     {"alpha_cutoff", m.alphaCutoff},
                     {"double_sided", m.doubleSided},
                     {"unlit", m.unlit},
                     {"specular", m.specular},
                     {"specular_color", jsonList(m.specularColor)},
                     {"ior", m.ior},
                     {"transmission", m.transmission},
                     {"volume", m.volume},
                     {"attenuation_color", jsonList(m.attenuationColor)}};
  put(out, "attenuation_distance_metres", m.attenuationDistance);
  putFinish(out, m.finish);
  return out;
}

OrderedJson lightJson(const Light& l) {
  OrderedJson out = {{"name", l.name},
                     {"type", word(kLightTypes, l.type)},
                     {"position", jsonList(l.position)},
                     {"direction", jsonList(l.direction)},
                     {"intensity", jsonList(l.intensity)},
                     {"inner_cone_angle_radians", l.innerConeAngle},
                     {"outer_cone_angle_radians", l.outerConeAngle}};
  put(out, "range_metres", l.range);
  if (l.radius > 0.0f) out["radius_metres"] = double{l.radius};
  return out;
}

OrderedJson cameraJson(const Camera& c) {
  OrderedJson out = {{"name", c.name},
                     {"eye", jsonList(c.eye)},
                     {"forward", jsonList(c.forward)},
                     {"up", jsonList(c.up)},
                     {"vertical_fov_radians", c.verticalFov},
                     {"orthographic", c.orthographic},
                     {"orthographic_height_metres", c.orthographicHeight}};
  if (c.fstop > 0.0f) {
    out["fstop"] = double{c.fstop};
    out["focus_metres"] = double{c.focus};
  }
  if (c.framing) out["framing"] = true;
  return out;
}

const std::vector<const char*>& materialKeys() {
  static const std::vector<const char*> keys = {"name",
                                                "base_color",
                                                "metallic",
                                                "roughness",
                                                "emission",
                                                "normal_scale",
                                                "alpha_mode",
                                                "alpha_cutoff",
                                                "double_sided",
                                                "unlit",
                                                "specular",
                                                "ior",
                                                "transmission",
                                                "specular_color",
                                                "volume",
                                                "attenuation_color",
                                                "attenuation_distance_metres",
                                                "clearcoat",
                                                "clearcoat_roughness",
                                                "clearcoat_normal_scale",
                                                "sheen_color",
                                                "sheen_roughness",
                                                "anisotropy",
                                                "anisotropy_rotation_radians",
                                                "iridescence",
                                                "iridescence_ior",
                                                "iridescence_thinnest_nanometres",
                                                "iridescence_thickest_nanometres",
                                                "metal_eta",
                                                "metal_k",
                                                "beckmann"};
  return keys;
}

void readMaterialJson(const JsonObject& o, Material& m, bool all) {
  const auto wanted = [&](const char* key) { return all || o.has(key); };
  if (wanted("name")) m.name = o.text("name");
  if (wanted("base_color")) o.reals("base_color", &m.baseColor[0], 4, 0.0f, 1.0f);
  if (wanted("metallic")) m.metallic = o.real("metallic", 0.0f, 1.0f);
  if (wanted("roughness")) m.roughness = o.real("roughness", 0.0f, 1.0f);
  if (wanted("emission")) m.emission = jsonVector(o, "emission", 0.0f);
  if (wanted("normal_scale")) m.normalScale = o.real("normal_scale");
  if (wanted("alpha_mode"))
    m.alphaMode = static_cast<AlphaMode>(o.oneOf("alpha_mode", kAlphaModes));
  if (wanted("alpha_cutoff")) m.alphaCutoff = o.real("alpha_cutoff", 0.0f);
  if (wanted("double_sided")) m.doubleSided = o.boolean("double_sided");
  if (wanted("unlit")) m.unlit = o.boolean("unlit");
  if (wanted("specular")) m.specular = o.real("specular", 0.0f, 1.0f);
  if (wanted("specular_color")) m.specularColor = jsonVector(o, "specular_color", 0.0f);
  if (wanted("ior")) m.ior = o.real("ior", 1.0f);
  if (wanted("transmission")) m.transmission = o.real("transmission", 0.0f, 1.0f);
  if (wanted("volume")) m.volume = o.boolean("volume");
  if (wanted("attenuation_color")) {
    m.attenuationColor = jsonVector(o, "attenuation_color", 0.0f, 1.0f);
  }
  if (o.has("attenuation_distance_metres")) {
    m.attenuationDistance = o.real("attenuation_distance_metres", 0.0f);
    if (m.attenuationDistance >= std::numeric_limits<float>::max()) {
      m.attenuationDistance = kInfinity;
    }
  }
  readFinish(o, m.finish);
}

Light readLightJson(const JsonObject& o) {
  o.allow({"name", "type", "position", "direction", "intensity", "inner_cone_angle_radians",
           "outer_cone_angle_radians", "range_metres", "radius_metres"});
  constexpr float kLargest = static_cast<float>(std::numbers::pi);
  Light l;
  l.name = o.text("name");
  l.type = static_cast<Light::Type>(o.oneOf("type", kLightTypes));
  o.numbers("position", &l.position[0], 3);
  l.direction = jsonUnitVector(o, "direction");
  l.intensity = jsonVector(o, "intensity", 0.0f);
  l.outerConeAngle = o.real("outer_cone_angle_radians", 0.0f, kLargest);
  l.innerConeAngle = o.real("inner_cone_angle_radians", 0.0f, l.outerConeAngle);
  if (o.has("range_metres")) l.range = o.real("range_metres", 0.0f);
  if (o.has("radius_metres")) l.radius = o.real("radius_metres", 0.0f);
  return l;
}

Camera readCameraJson(const JsonObject& o) {
  o.allow({"name", "eye", "forward", "up", "vertical_fov_radians", "orthographic",
           "orthographic_height_metres", "fstop", "focus_metres", "framing"});
  Camera c;
  c.name = o.text("name");
  o.numbers("eye", &c.eye[0], 3);
  c.forward = jsonUnitVector(o, "forward");
  c.up = jsonUnitVector(o, "up");
  if (std::abs(glm::dot(c.forward, c.up)) > 1e-3f) o.bad("up", "is not at right angles to forward");
  c.verticalFov = o.real("vertical_fov_radians", kLeast, 3.1415925f);
  c.orthographic = o.boolean("orthographic");
  c.orthographicHeight = o.real("orthographic_height_metres", kLeast);
  if (o.has("fstop")) {
    c.fstop = o.real("fstop", kLeast);
    c.focus = o.real("focus_metres", kLeast);
  }
  c.framing = o.has("framing") && o.boolean("framing");
  return c;
}

}  // namespace trex
