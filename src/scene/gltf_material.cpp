#include <algorithm>

#include "src/scene/gltf_detail.h"
#include "src/scene/texture.h"

namespace trex::detail {
namespace {

constexpr GltfMaterials::Sets kNoSets = [] {
  GltfMaterials::Sets sets{};
  sets.fill(-1);
  return sets;
}();

const tinygltf::Value* member(const tinygltf::Value& object, const char* key) {
  if (!object.IsObject() || !object.Has(key)) return nullptr;
  return &object.Get(key);
}

Texture::Wrap wrapOf(int mode) {
  if (mode == TINYGLTF_TEXTURE_WRAP_CLAMP_TO_EDGE) return Texture::Wrap::kClamp;
  if (mode == TINYGLTF_TEXTURE_WRAP_MIRRORED_REPEAT) return Texture::Wrap::kMirror;
  return Texture::Wrap::kRepeat;
}

float finiteOr(const tinygltf::Value* value, float fallback) {
  if (value == nullptr || !value->IsNumber()) return fallback;
  const float f = static_cast<float>(value->GetNumberAsDouble());
  return std::isfinite(f) ? f : fallback;
}

vec2 pairOr(const tinygltf::Value* value, vec2 fallback) {
  if (value == nullptr || !value->IsArray() || value->ArrayLen() != 2) return fallback;
  return {finiteOr(&value->Get(0), fallback.x), finiteOr(&value->Get(1), fallback.y)};
}

}  // namespace

GltfMaterials::GltfMaterials(GltfContext& context) : context_(context) {
  const std::size_t count = context.model.materials.size();
  context.scene.materials.resize(count);
  converted_.resize(count);
  texCoordSets_.assign(count, kNoSets);
  for (std::size_t i = 0; i < count; ++i) {
    context.scene.materials[i].name = context.model.materials[i].name;
  }
}

int GltfMaterials::use(int index) {
  if (index < 0) {
    if (defaultMaterial_ == kNone) {
      defaultMaterial_ = static_cast<int>(context_.scene.materials.size());
      context_.scene.materials.emplace_back().name = "default";
      texCoordSets_.push_back(kNoSets);
    }
    return defaultMaterial_;
  }
  if (std::size_t(index) >= converted_.size()) {
    context_.replace("material {} does not exist; there are {}; the default one is used", index,
                     converted_.size());
    return use(kNone);
  }
  if (!converted_[index]) convert(index);
  return index;
}

float GltfMaterials::inRange(double value, double low, double high, const char* what) {
  if (value >= low && value <= high) return static_cast<float>(value);
  const double clamped = std::isnan(value) ? low : std::clamp(value, low, high);
  context_.replace("{}: {} {} is outside its range; {} is used", currentName_, what, value,
                   clamped);
  return static_cast<float>(clamped);
}

float GltfMaterials::number(const tinygltf::Value& object, const char* key, double fallback,
                            double low, double high) {
  const tinygltf::Value* value = member(object, key);
  if (value == nullptr) return static_cast<float>(fallback);
  if (!value->IsNumber()) {
    context_.replace("{}: {} is not a number; {} is used", currentName_, key, fallback);
    return static_cast<float>(fallback);
  }
  return inRange(value->GetNumberAsDouble(), low, high, key);
}

vec3 GltfMaterials::color(const tinygltf::Value& object, const char* key, double high,
                          double fallback) {
  const tinygltf::Value* value = member(object, key);
  vec3 c(static_cast<float>(fallback));
  if (value == nullptr) return c;
  for (int k = 0; k < 3; ++k) {
    if (!value->IsArray() || value->ArrayLen() != 3 || !value->Get(k).IsNumber()) {
      context_.replace("{}: {} must have 3 numbers; {} is used", currentName_, key, fallback);
      return vec3(static_cast<float>(fallback));
    }
    c[k] = inRange(value->Get(k).GetNumberAsDouble(), 0.0, high, key);
  }
  return c;
}

const tinygltf::Value* GltfMaterials::extension(const tinygltf::ExtensionMap& map,
                                                const char* key) const {
  const auto found = map.find(key);
  return found == map.end() ? nullptr : &found->second;
}

void GltfMaterials::convert(int index) {
  const tinygltf::Material& from = context_.model.materials[index];
  const tinygltf::PbrMetallicRoughness& pbr = from.pbrMetallicRoughness;
  Material to;
  to.name = from.name;
  currentName_ = fmt::format("material {} ('{}')", index, from.name);
  currentSets_ = kNoSets;
  for (int k = 0; k < 4; ++k) {
    to.baseColor[k] = inRange(pbr.baseColorFactor[k], 0.0, 1.0, "baseColorFactor");
  }
  to.metallic = inRange(pbr.metallicFactor, 0.0, 1.0, "metallicFactor");
  to.roughness = inRange(pbr.roughnessFactor, 0.0, 1.0, "roughnessFactor");
  for (int k = 0; k < 3; ++k) {
    to.emission[k] = inRange(from.emissiveFactor[k], 0.0, 1.0, "emissiveFactor");
  }
  to.normalScale = inRange(from.normalTexture.scale, -1e6, 1e6, "normalTexture.scale");
  to.doubleSided = from.doubleSided;
  to.alphaCutoff = inRange(from.alphaCutoff, 0.0, 1e6, "alphaCutoff");
  if (from.alphaMode == "MASK") {
    to.alphaMode = AlphaMode::kMask;
  } else if (from.alphaMode == "BLEND") {
    to.alphaMode = AlphaMode::kBlend;
  } else if (!from.alphaMode.empty() && from.alphaMode != "OPAQUE") {
    context_.replace("{}: unknown alphaMode '{}'; opaque is used", currentName_, from.alphaMode);
  }
  const auto& base = pbr.baseColorTexture;
  to.baseColorTexture = texture(kBase, base.index, base.texCoord, base.extensions, true);
  const auto& rough = pbr.metallicRoughnessTexture;
  to.metallicRoughnessTexture =
      texture(kMetallicRoughness, rough.index, rough.texCoord, rough.extensions, false);
  const auto& normal = from.normalTexture;
  to.normalTexture = texture(kNormal, normal.index, normal.texCoord, normal.extensions, false);
  if (to.emits()) {
    const auto& emissive = from.emissiveTexture;
    to.emissiveTexture =
        texture(kEmissive, emissive.index, emissive.texCoord, emissive.extensions, true);
  }
  convertExtensions(from, to);
  const int second = keptSets(currentSets_)[1];
  const auto textures = to.textures();
  for (std::size_t k = 0; k < textures.size(); ++k) {
    textures[k]->set = textures[k]->present() && currentSets_[k] == second ? 1 : 0;
  }
  context_.scene.materials[index] = std::move(to);
  texCoordSets_[index] = currentSets_;
  converted_[index] = true;
}

void GltfMaterials::convertExtensions(const tinygltf::Material& from, Material& to) {
  const auto& map = from.extensions;
  if (const auto* e = extension(map, "KHR_materials_emissive_strength")) {
    to.emission *= number(*e, "emissiveStrength", 1.0, 0.0, 1e30);
  }
  if (const auto* e = extension(map, "KHR_materials_specular")) {
    to.specular = number(*e, "specularFactor", 1.0, 0.0, 1.0);
    to.specularColor = color(*e, "specularColorFactor", 1e6);
    to.specularTexture = textureProperty(kSpecular, *e, "specularTexture", false);
    to.specularColorTexture = textureProperty(kSpecularColor, *e, "specularColorTexture", true);
  }
  if (const auto* e = extension(map, "KHR_materials_ior")) {
    // 0 stands for "no refraction, full reflectance" in the standard; a huge index comes close.
    const auto* value = member(*e, "ior");
    const bool zero = value != nullptr && value->IsNumber() && value->GetNumberAsDouble() == 0.0;
    to.ior = zero ? 1000.0f : number(*e, "ior", 1.5, 1.0, 1000.0);
  }
  if (const auto* e = extension(map, "KHR_materials_transmission")) {
    to.transmission = number(*e, "transmissionFactor", 0.0, 0.0, 1.0);
    if (to.transmission > 0.0f) {
      to.transmissionTexture = textureProperty(kTransmission, *e, "transmissionTexture", false);
    }
  }
  if (const auto* e = extension(map, "KHR_materials_volume")) {
    to.volume = number(*e, "thicknessFactor", 0.0, 0.0, 1e30) > 0.0f;
    to.attenuationColor = color(*e, "attenuationColor", 1.0);
    if (member(*e, "attenuationDistance") != nullptr) {
      to.attenuationDistance = number(*e, "attenuationDistance", 0.0, 1e-30, 1e30);
    }
  }
  to.unlit = extension(map, "KHR_materials_unlit") != nullptr;
  if (const auto* e = extension(map, "KHR_materials_pbrSpecularGlossiness")) {
    convertSpecularGlossiness(*e, to);
  }
  convertFinish(from, to.finish);
  convertSeparateMaps(from, to);
}

void GltfMaterials::convertFinish(const tinygltf::Material& from, Finish& to) {
  if (const auto* e = extension(from.extensions, "KHR_materials_clearcoat")) {
    to.clearcoat = number(*e, "clearcoatFactor", 0.0, 0.0, 1.0);
    to.clearcoatRoughness = number(*e, "clearcoatRoughnessFactor", 0.0, 0.0, 1.0);
    if (to.coats()) {
      to.clearcoatTexture = textureProperty(kClearcoat, *e, "clearcoatTexture", false);
      to.clearcoatRoughnessTexture =
          textureProperty(kClearcoatRoughness, *e, "clearcoatRoughnessTexture", false);
      to.clearcoatNormalTexture =
          textureProperty(kClearcoatNormal, *e, "clearcoatNormalTexture", false);
      if (const auto* info = member(*e, "clearcoatNormalTexture")) {
        to.clearcoatNormalScale = number(*info, "scale", 1.0, -1e6, 1e6);
      }
    }
  }
  if (const auto* e = extension(from.extensions, "KHR_materials_sheen")) {
    to.sheenColor = color(*e, "sheenColorFactor", 1.0, 0.0);
    to.sheenRoughness = number(*e, "sheenRoughnessFactor", 0.0, 0.0, 1.0);
    if (to.sheens()) {
      to.sheenColorTexture = textureProperty(kSheenColor, *e, "sheenColorTexture", true);
      to.sheenRoughnessTexture =
          textureProperty(kSheenRoughness, *e, "sheenRoughnessTexture", false);
    }
  }
  if (const auto* e = extension(from.extensions, "KHR_materials_anisotropy")) {
    to.anisotropy = number(*e, "anisotropyStrength", 0.0, 0.0, 1.0);
    to.anisotropyRotation = number(*e, "anisotropyRotation", 0.0, -1e6, 1e6);
    if (to.anisotropy > 0.0f) {
      currentSets_[kAnisotropy] = 0;  // whose u is the direction, without a texture too
      to.anisotropyTexture = textureProperty(kAnisotropy, *e, "anisotropyTexture", false);
    }
  }
  if (const auto* e = extension(from.extensions, "KHR_materials_iridescence")) {
    to.iridescence = number(*e, "iridescenceFactor", 0.0, 0.0, 1.0);
    to.iridescenceIor = number(*e, "iridescenceIor", 1.3, 1.0, 100.0);
    to.iridescenceThinnest = number(*e, "iridescenceThicknessMinimum", 100.0, 0.0, 1e6);
    to.iridescenceThickest = number(*e, "iridescenceThicknessMaximum", 400.0, 0.0, 1e6);
    if (to.iridescence > 0.0f) {
      to.iridescenceTexture = textureProperty(kIridescence, *e, "iridescenceTexture", false);
      to.iridescenceThicknessTexture =
          textureProperty(kIridescenceThickness, *e, "iridescenceThicknessTexture", false);
    }
  }
}

/// A dielectric whose reflection at normal incidence is the specular colour.
void GltfMaterials::convertSpecularGlossiness(const tinygltf::Value& e, Material& to) {
  to.metallic = 0.0f;
  to.metallicRoughnessTexture = {};
  const float glossiness = number(e, "glossinessFactor", 1.0, 0.0, 1.0);
  to.roughness = 1.0f - glossiness;
  const auto* diffuse = member(e, "diffuseFactor");
  to.baseColor = vec4(1.0f);
  for (int k = 0; diffuse != nullptr && diffuse->IsArray() && diffuse->ArrayLen() == 4 && k < 4;
       ++k) {
    if (!diffuse->Get(k).IsNumber()) continue;
    to.baseColor[k] = inRange(diffuse->Get(k).GetNumberAsDouble(), 0.0, 1.0, "diffuseFactor");
  }
  to.baseColorTexture = textureProperty(kBase, e, "diffuseTexture", true);
  constexpr float kReflectance = 0.04f;  // of the index 1.5 that is kept
  to.specular = 1.0f;
  to.specularColor = color(e, "specularFactor", 1.0) / kReflectance;
  to.specularColorTexture = textureProperty(kSpecularColor, e, "specularGlossinessTexture", true);
  if (!to.specularColorTexture.present() || glossiness == 0.0f) return;
  to.metallicRoughnessTexture = to.specularColorTexture;
  to.metallicRoughnessTexture.image = madeImage({.make = PendingImage::Make::kOfGlossiness,
                                                 .first = to.specularColorTexture.image,
                                                 .glossiness = glossiness});
  currentSets_[kMetallicRoughness] = currentSets_[kSpecularColor];
  to.roughness = 1.0f;
}

/// A map that shares its slot with the one `beside`, whose place on the surface it takes.
Texture GltfMaterials::separateMap(Slot slot, const tinygltf::Value& maps, const char* key,
                                   const Texture& beside) {
  const int set = currentSets_[slot];
  const Texture map = textureProperty(slot, maps, key, false);
  if (!beside.present() || !map.present()) return map;
  Texture moved = map;
  moved.image = beside.image;
  if (!(moved == beside) || currentSets_[slot] != set) {
    context_.replace("{}: its map of {} is placed as the one beside it", currentName_, key);
  }
  currentSets_[slot] = set;
  return map;
}

/// Formats other than glTF keep roughness, metalness and opacity in images of their own.
void GltfMaterials::convertSeparateMaps(const tinygltf::Material& from, Material& to) {
  const tinygltf::Value* maps = member(from.extras, "trex_maps");
  if (!context_.handedOver || maps == nullptr || !maps->IsObject()) return;
  const Texture rough = separateMap(kMetallicRoughness, *maps, "roughness", {});
  const Texture metal = separateMap(kMetallicRoughness, *maps, "metalness", rough);
  if (rough.present() || metal.present()) {
    to.metallicRoughnessTexture = rough.present() ? rough : metal;
    to.metallicRoughnessTexture.image =
        madeImage({.make = PendingImage::Make::kRoughnessAndMetallic,
                   .first = rough.image,
                   .second = metal.image});
  }
  const Texture color = to.baseColorTexture;
  const Texture opacity = separateMap(kBase, *maps, "opacity", color);
  if (!opacity.present()) return;
  if (!color.present()) to.baseColorTexture = opacity;
  to.baseColorTexture.image = madeImage(
      {.make = PendingImage::Make::kWithOpacity, .first = color.image, .second = opacity.image});
}

std::array<int, 2> GltfMaterials::keptSets(const Sets& sets) {
  std::array<int, 2> kept = {-1, -1};
  const auto keep = [&](int set) {
    if (set < 0 || set == kept[0]) return;
    int& place = kept[kept[0] < 0 ? 0 : 1];
    if (place < 0) place = set;
  };
  for (const Slot slot : {kNormal, kClearcoatNormal, kAnisotropy}) {
    if (kept[0] < 0) keep(sets[slot]);
  }
  for (const int set : sets) keep(set);
  return kept;
}

GltfMaterials::SetMaps GltfMaterials::usualMaps(int sceneMaterial) const {
  const Sets& sets = texCoordSets_[sceneMaterial];
  const int second = keptSets(sets)[1];
  SetMaps maps;
  for (const int set : sets) {
    if (set >= 0) maps[set].set = set == second ? 1 : 0;
  }
  return maps;
}

int GltfMaterials::withMaps(int sceneMaterial, const SetMaps& maps) {
  const int next = static_cast<int>(context_.scene.materials.size());
  const auto [at, isNew] = withMaps_.try_emplace({sceneMaterial, maps}, next);
  if (!isNew) return at->second;
  Material made = context_.scene.materials[sceneMaterial];
  const Sets sets = texCoordSets_[sceneMaterial];
  const auto textures = made.textures();
  for (std::size_t k = 0; k < textures.size(); ++k) {
    Texture& t = *textures[k];
    if (!t.present()) continue;
    const SetMap& map = maps.at(sets[k]);
    t.offset = transformUv(t, map.offset);
    t.scale *= map.scale;
    t.set = map.set;
  }
  context_.scene.materials.push_back(std::move(made));
  texCoordSets_.push_back(sets);
  return next;
}

Texture GltfMaterials::textureProperty(Slot slot, const tinygltf::Value& object, const char* key,
                                       bool srgb) {
  const tinygltf::Value* info = member(object, key);
  if (info == nullptr) return {};
  const tinygltf::Value* index = member(*info, "index");
  const tinygltf::Value* texCoord = member(*info, "texCoord");
  if (index == nullptr || !index->IsNumber() || indexOf(*index) < 0) {
    context_.replace("{}: {} has no index; it is left out", currentName_, key);
    return {};
  }
  tinygltf::ExtensionMap extensions;
  if (const auto* list = member(*info, "extensions"); list != nullptr) {
    if (const auto* transform = member(*list, "KHR_texture_transform")) {
      extensions["KHR_texture_transform"] = *transform;
    }
  }
  const int set = texCoord != nullptr && texCoord->IsNumber() ? indexOf(*texCoord) : 0;
  return texture(slot, indexOf(*index), set, extensions, srgb);
}

Texture GltfMaterials::texture(Slot slot, int index, int texCoord,
                               const tinygltf::ExtensionMap& extensions, bool srgb) {
  if (index == -1 || !context_.options.loadTextures) return {};
  const auto& textures = context_.model.textures;
  if (index < 0 || std::size_t(index) >= textures.size()) {
    context_.replace("{}: texture {} does not exist; there are {}; it is left out", currentName_,
                     index, textures.size());
    return {};
  }
  const tinygltf::Texture& from = textures[index];
  int source = from.source;
  if (const auto* webp = extension(from.extensions, "EXT_texture_webp")) {
    const auto* value = member(*webp, "source");
    if (value != nullptr && value->IsNumber()) source = indexOf(*value);
  }
  if (source < 0 || std::size_t(source) >= context_.images.size()) {
    context_.replace("{}: texture {} has no image that can be read; it is left out", currentName_,
                     index);
    return {};
  }
  Texture to;
  to.image = sceneImage(source, srgb);
  if (from.sampler >= 0) {
    if (std::size_t(from.sampler) < context_.model.samplers.size()) {
      const tinygltf::Sampler& sampler = context_.model.samplers[from.sampler];
      to.wrapS = wrapOf(sampler.wrapS);
      to.wrapT = wrapOf(sampler.wrapT);
      to.nearest = sampler.magFilter == TINYGLTF_TEXTURE_FILTER_NEAREST;
    } else {
      context_.replace("texture {}: sampler {} does not exist; it repeats", index, from.sampler);
    }
  }
  if (const auto* transform = extension(extensions, "KHR_texture_transform")) {
    to.offset = pairOr(member(*transform, "offset"), vec2(0.0f));
    to.scale = pairOr(member(*transform, "scale"), vec2(1.0f));
    to.rotation = finiteOr(member(*transform, "rotation"), 0.0f);
    const auto* set = member(*transform, "texCoord");
    if (set != nullptr && set->IsNumber()) texCoord = indexOf(*set);
  }
  currentSets_[slot] = std::max(texCoord, 0);
  return to;
}

}  // namespace trex::detail
