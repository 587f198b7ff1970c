#include "src/assimp/materials.h"

#include <assimp/GltfMaterial.h>
#include <assimp/material.h>
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <optional>

#include "src/scene/phong.h"

namespace trex {
namespace {

using Json = nlohmann::json;

std::optional<float> numberOf(const aiMaterial& from, const char* key, unsigned type,
                              unsigned index) {
  ai_real value = 0;
  if (from.Get(key, type, index, value) != AI_SUCCESS || !std::isfinite(value)) return {};
  return value;
}

std::optional<vec3> colorOf(const aiMaterial& from, const char* key, unsigned type,
                            unsigned index) {
  aiColor4D c;
  if (from.Get(key, type, index, c) != AI_SUCCESS) return {};
  const vec3 color(c.r, c.g, c.b);
  if (!isFinite(color)) return {};
  return glm::max(color, vec3(0.0f));
}

Json listOf(const vec3& v) { return {v.x, v.y, v.z}; }

int wrapOf(aiTextureMapMode mode) {
  if (mode == aiTextureMapMode_Clamp || mode == aiTextureMapMode_Decal) return 33071;
  return mode == aiTextureMapMode_Mirror ? 33648 : 10497;
}

/// assimp counts v from the bottom, and turns about the middle.
Json transformOf(const aiUVTransform& t) {
  const float c = std::cos(t.mRotation), s = std::sin(t.mRotation);
  const float sy = t.mScaling.y;
  const vec2 offset(t.mTranslation.x + 0.5f - 0.5f * c - s * (sy - 0.5f),
                    0.5f - t.mTranslation.y + 0.5f * s - c * (sy - 0.5f));
  return {
      {"offset", {offset.x, offset.y}}, {"scale", {t.mScaling.x, sy}}, {"rotation", t.mRotation}};
}

/// Uncompressed texels as an image file (Truevision TGA, 32 bits, from the top).
std::vector<std::uint8_t> targa(const aiTexture& t) {
  std::vector<std::uint8_t> out = {0, 0, 2, 0, 0, 0, 0, 0, 0, 0, 0, 0};
  for (const unsigned side : {t.mWidth, t.mHeight}) {
    out.push_back(static_cast<std::uint8_t>(side));
    out.push_back(static_cast<std::uint8_t>(side >> 8));
  }
  out.insert(out.end(), {32, 0x28});
  const auto* texels = reinterpret_cast<const std::uint8_t*>(t.pcData);
  out.insert(out.end(), texels, texels + std::size_t{t.mWidth} * t.mHeight * sizeof(aiTexel));
  return out;
}

/// The first texture of some kind; empty if there is none.
std::string pathOf(const aiMaterial& from, aiTextureType kind) {
  aiString name;
  return from.GetTexture(kind, 0, &name) == AI_SUCCESS ? std::string(name.C_Str()) : "";
}

bool anyTexture(const aiMaterial& from, std::initializer_list<aiTextureType> kinds) {
  return std::any_of(kinds.begin(), kinds.end(),
                     [&](aiTextureType kind) { return !pathOf(from, kind).empty(); });
}

/// A file name as a URI that our reader takes for the same name.
std::string uriOf(std::string path) {
  const bool drive = path.size() > 2 && path[1] == ':';
  std::string uri;
  for (const char c : drive ? path.substr(2) : path) {
    if (c == '%' || c == ':') {
      uri += fmt::format("%{:02X}", static_cast<unsigned char>(c));
    } else {
      uri.push_back(c);
    }
  }
  return uri;
}

}  // namespace

int MaterialWriter::write(unsigned material, bool colored) {
  const auto [at, isNew] = done_.try_emplace({material, colored}, 0);
  if (!isNew) return at->second;
  Json to = {{"doubleSided", true}};
  if (material < scene_.mNumMaterials) {
    const aiMaterial& from = *scene_.mMaterials[material];
    name_ = from.GetName().C_Str();
    to["name"] = name_;
    int both = 1;
    if (from.Get(AI_MATKEY_TWOSIDED, both) == AI_SUCCESS) to["doubleSided"] = both != 0;
    writeColors(from, colored, to);
    writeSurface(from, to);
    writeEmission(from, to);
    writeTextures(from, to);
  }
  return at->second = out_.add("materials", std::move(to));
}

/// 0 is what some exporters write of what they can see, as OBJ's `Tr 1` is.
float MaterialWriter::opacity(const aiMaterial& from) {
  const float value = std::clamp(numberOf(from, AI_MATKEY_OPACITY).value_or(1.0f), 0.0f, 1.0f);
  if (value > 0.0f) return value;
  out_.warn(fmt::format("material '{}': an opacity of 0 is taken for opaque", name_));
  return 1.0f;
}

void MaterialWriter::writeColors(const aiMaterial& from, bool colored, Json& to) {
  const auto base = colorOf(from, AI_MATKEY_BASE_COLOR);
  const bool textured = anyTexture(from, {aiTextureType_DIFFUSE, aiTextureType_BASE_COLOR});
  // A colour of 0 beside a texture is one that its exporter left out.
  const vec3 plain = textured || colored ? vec3(1.0f) : vec3(0.6f);
  vec3 color = base ? *base : colorOf(from, AI_MATKEY_COLOR_DIFFUSE).value_or(plain);
  if (name_ == AI_DEFAULT_MATERIAL_NAME && color == vec3(1.0f)) color = plain;  // none is given
  if (textured && maxComponent(color) == 0.0f) color = vec3(1.0f);
  if (maxComponent(color) > 1.0f) {
    out_.replaced(fmt::format("material '{}': its colour is beyond 1; 1 is used", name_));
    color = glm::min(color, vec3(1.0f));
  }
  const float alpha = opacity(from);
  to["pbrMetallicRoughness"]["baseColorFactor"] = {color.x, color.y, color.z, alpha};
  ai_real cutoff = 0.5f;
  aiString mode;
  if (from.Get(AI_MATKEY_GLTF_ALPHAMODE, mode) == AI_SUCCESS) {
    to["alphaMode"] = mode.C_Str();
    if (from.Get(AI_MATKEY_GLTF_ALPHACUTOFF, cutoff) == AI_SUCCESS) to["alphaCutoff"] = cutoff;
  } else if (alpha < 1.0f) {
    to["alphaMode"] = "BLEND";
  }
}

void MaterialWriter::writeSurface(const aiMaterial& from, Json& to) {
  Json& pbr = to["pbrMetallicRoughness"];
  const auto metallic = numberOf(from, AI_MATKEY_METALLIC_FACTOR);
  const auto roughness = numberOf(from, AI_MATKEY_ROUGHNESS_FACTOR);
  pbr["metallicFactor"] = std::clamp(metallic.value_or(0.0f), 0.0f, 1.0f);
  int model = 0;
  const bool known = from.Get(AI_MATKEY_SHADING_MODEL, model) == AI_SUCCESS;
  if (known && model == aiShadingMode_NoShading) {
    out_.useExtension("KHR_materials_unlit");
    to["extensions"]["KHR_materials_unlit"] = Json::object();
  }
  if (const auto ior = numberOf(from, AI_MATKEY_REFRACTI); ior && *ior > 1.0f && *ior <= 10.0f) {
    out_.useExtension("KHR_materials_ior");
    to["extensions"]["KHR_materials_ior"]["ior"] = *ior;
  }
  if (const auto t = numberOf(from, AI_MATKEY_TRANSMISSION_FACTOR); t && *t > 0.0f) {
    out_.useExtension("KHR_materials_transmission");
    to["extensions"]["KHR_materials_transmission"]["transmissionFactor"] = std::min(*t, 1.0f);
  }
  if (metallic || roughness) {
    pbr["roughnessFactor"] = std::clamp(roughness.value_or(1.0f), 0.0f, 1.0f);
    return;
  }
  const bool dull = known && (model == aiShadingMode_Flat || model == aiShadingMode_Gouraud ||
                              model == aiShadingMode_OrenNayar);
  const vec3 given = colorOf(from, AI_MATKEY_COLOR_SPECULAR).value_or(vec3(0.0f));
  const float strength = numberOf(from, AI_MATKEY_SHININESS_STRENGTH).value_or(1.0f);
  const float exponent = numberOf(from, AI_MATKEY_SHININESS).value_or(0.0f);
  const bool shines = !dull && exponent > 0.0f && strength > 0.0f;
  vec3 color(1.0f);
  const float specular = detail::specularOf(shines ? given * strength : vec3(0.0f), color);
  if (specular > 0.0f) pbr["roughnessFactor"] = detail::roughnessOf(exponent);
  out_.useExtension("KHR_materials_specular");
  to["extensions"]["KHR_materials_specular"] = {{"specularFactor", specular},
                                                {"specularColorFactor", listOf(color)}};
}

void MaterialWriter::writeEmission(const aiMaterial& from, Json& to) {
  vec3 emission = colorOf(from, AI_MATKEY_COLOR_EMISSIVE).value_or(vec3(0.0f));
  emission *= std::max(numberOf(from, AI_MATKEY_EMISSIVE_INTENSITY).value_or(1.0f), 0.0f);
  const bool textured = anyTexture(from, {aiTextureType_EMISSIVE, aiTextureType_EMISSION_COLOR});
  if (textured && maxComponent(emission) == 0.0f) emission = vec3(1.0f);
  const float strongest = maxComponent(emission);
  if (strongest <= 0.0f || !isFinite(emission)) return;
  to["emissiveFactor"] = listOf(strongest > 1.0f ? emission / strongest : emission);
  if (strongest <= 1.0f) return;
  out_.useExtension("KHR_materials_emissive_strength");
  to["extensions"]["KHR_materials_emissive_strength"]["emissiveStrength"] = strongest;
}

void MaterialWriter::writeTextures(const aiMaterial& from, Json& to) {
  const auto set = [&](Json& object, const char* key, std::initializer_list<aiTextureType> kinds) {
    Json info = texture(from, kinds);
    if (!info.is_null()) object[key] = std::move(info);
  };
  Json& pbr = to["pbrMetallicRoughness"];
  set(pbr, "baseColorTexture", {aiTextureType_BASE_COLOR, aiTextureType_DIFFUSE});
  set(to, "emissiveTexture", {aiTextureType_EMISSION_COLOR, aiTextureType_EMISSIVE});
  set(to, "normalTexture", {aiTextureType_NORMALS, aiTextureType_NORMAL_CAMERA});
  set(pbr, "metallicRoughnessTexture", {aiTextureType_UNKNOWN});
  // A map of its own is as good as a factor of 1, which some exporters leave at 0 beside it.
  Json maps = Json::object();
  if (!pbr.contains("metallicRoughnessTexture")) {
    set(maps, "roughness", {aiTextureType_DIFFUSE_ROUGHNESS});
    set(maps, "metalness", {aiTextureType_METALNESS});
    if (maps.contains("roughness")) pbr["roughnessFactor"] = 1.0f;
    if (maps.contains("metalness")) pbr["metallicFactor"] = 1.0f;
  }
  const std::string mask = pathOf(from, aiTextureType_OPACITY);
  if (!mask.empty()) {
    if (!to.contains("alphaMode")) to["alphaMode"] = "BLEND";
    const std::initializer_list colors = {aiTextureType_BASE_COLOR, aiTextureType_DIFFUSE};
    const bool same = std::any_of(colors.begin(), colors.end(),
                                  [&](aiTextureType kind) { return mask == pathOf(from, kind); });
    if (!same) set(maps, "opacity", {aiTextureType_OPACITY});
  }
  if (!maps.empty()) to["extras"]["trex_maps"] = std::move(maps);
  constexpr std::pair<aiTextureType, const char*> kLeftOut[] = {
      {aiTextureType_SPECULAR, "reflection"},
      {aiTextureType_HEIGHT, "heights"},
      {aiTextureType_DISPLACEMENT, "heights"},
      {aiTextureType_SHININESS, "shininess"},
      {aiTextureType_REFLECTION, "surroundings"}};
  for (const auto& [kind, name] : kLeftOut) {
    if (!anyTexture(from, {kind})) continue;
    out_.replaced(fmt::format("material '{}': its map of {} is left out", name_, name));
  }
}

Json MaterialWriter::texture(const aiMaterial& from, std::initializer_list<aiTextureType> kinds) {
  for (const aiTextureType kind : kinds) {
    aiString path;
    unsigned set = 0;
    aiTextureMapMode modes[3] = {aiTextureMapMode_Wrap, aiTextureMapMode_Wrap,
                                 aiTextureMapMode_Wrap};
    if (from.GetTexture(kind, 0, &path, nullptr, &set, nullptr, nullptr, modes) != AI_SUCCESS ||
        path.length == 0) {
      continue;
    }
    const int sampler =
        out_.add("samplers", {{"wrapS", wrapOf(modes[0])}, {"wrapT", wrapOf(modes[1])}});
    Json info = {{"texCoord", set}};
    info["index"] = out_.add("textures", {{"source", image(path.C_Str())}, {"sampler", sampler}});
    aiUVTransform transform;
    if (from.Get(AI_MATKEY_UVTRANSFORM(kind, 0), transform) == AI_SUCCESS) {
      out_.useExtension("KHR_texture_transform");
      info["extensions"]["KHR_texture_transform"] = transformOf(transform);
    }
    return info;
  }
  return {};
}

int MaterialWriter::image(const std::string& path) {
  const auto [at, isNew] = images_.try_emplace(path, 0);
  if (!isNew) return at->second;
  const aiTexture* texture = scene_.GetEmbeddedTexture(path.c_str());
  Json object = texture != nullptr ? embedded(*texture) : Json{{"uri", uriOf(path)}};
  return at->second = out_.add("images", std::move(object));
}

Json MaterialWriter::embedded(const aiTexture& texture) {
  constexpr unsigned kMostSide = 0xffff;
  Json object = {{"name", texture.mFilename.C_Str()}, {"mimeType", "image/png"}};
  if (texture.mHeight == 0) {
    object["bufferView"] =
        out_.addView({reinterpret_cast<const std::uint8_t*>(texture.pcData), texture.mWidth});
  } else if (texture.mWidth <= kMostSide && texture.mHeight <= kMostSide) {
    object["bufferView"] = out_.addView(targa(texture));
  }
  return object;
}

}  // namespace trex
