#include <algorithm>

#include "src/scene/gltf_detail.h"
#include "src/scene/image_io.h"

namespace trex::detail {
namespace {

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

/// "%20" and the like in a URI.
std::string percentDecoded(const std::string& text) {
  std::string decoded;
  const auto digit = [](char c) {
    return c >= '0' && c <= '9'   ? c - '0'
           : c >= 'a' && c <= 'f' ? c - 'a' + 10
           : c >= 'A' && c <= 'F' ? c - 'A' + 10
                                  : -1;
  };
  for (std::size_t i = 0; i < text.size(); ++i) {
    if (text[i] == '%' && i + 2 < text.size() && digit(text[i + 1]) >= 0 &&
        digit(text[i + 2]) >= 0) {
      decoded.push_back(static_cast<char>(digit(text[i + 1]) * 16 + digit(text[i + 2])));
      i += 2;
    } else {
      decoded.push_back(text[i]);
    }
  }
  return decoded;
}

}  // namespace

GltfMaterials::GltfMaterials(GltfContext& context) : context_(context) {
  const std::size_t count = context.model.materials.size();
  context.scene.materials.resize(count);
  converted_.resize(count);
  texCoordSets_.assign(count, -1);
  for (std::size_t i = 0; i < count; ++i) {
    context.scene.materials[i].name = context.model.materials[i].name;
  }
}

int GltfMaterials::use(int index) {
  if (index < 0) {
    if (defaultMaterial_ == kNone) {
      defaultMaterial_ = static_cast<int>(context_.scene.materials.size());
      context_.scene.materials.emplace_back().name = "default";
      texCoordSets_.push_back(-1);
    }
    return defaultMaterial_;
  }
  if (std::size_t(index) >= converted_.size()) {
    context_.bad("material {} does not exist; there are {}", index, converted_.size());
  }
  if (!converted_[index]) convert(index);
  return index;
}

float GltfMaterials::inRange(double value, double low, double high, const char* what) {
  if (!std::isfinite(value)) context_.bad("{}: {} is not finite", currentName_, what);
  if (value >= low && value <= high) return static_cast<float>(value);
  const double clamped = std::clamp(value, low, high);
  context_.warn("{}: {} {} is outside its range; {} is used", currentName_, what, value, clamped);
  return static_cast<float>(clamped);
}

float GltfMaterials::number(const tinygltf::Value& object, const char* key, double fallback,
                            double low, double high) {
  const tinygltf::Value* value = member(object, key);
  if (value == nullptr) return static_cast<float>(fallback);
  if (!value->IsNumber()) context_.bad("{}: {} is not a number", currentName_, key);
  return inRange(value->GetNumberAsDouble(), low, high, key);
}

vec3 GltfMaterials::color(const tinygltf::Value& object, const char* key, double high) {
  const tinygltf::Value* value = member(object, key);
  if (value == nullptr) return vec3(1.0f);
  if (!value->IsArray() || value->ArrayLen() != 3) {
    context_.bad("{}: {} must have 3 numbers", currentName_, key);
  }
  vec3 c;
  for (int k = 0; k < 3; ++k) {
    if (!value->Get(k).IsNumber()) context_.bad("{}: {} must have 3 numbers", currentName_, key);
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
  currentSet_ = -1;
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
    context_.warn("{}: unknown alphaMode '{}'; opaque is used", currentName_, from.alphaMode);
  }
  // The base colour comes first: its texture coordinate set decides.
  const auto& base = pbr.baseColorTexture;
  to.baseColorTexture = texture(base.index, base.texCoord, base.extensions, true);
  const auto& rough = pbr.metallicRoughnessTexture;
  to.metallicRoughnessTexture = texture(rough.index, rough.texCoord, rough.extensions, false);
  const auto& normal = from.normalTexture;
  to.normalTexture = texture(normal.index, normal.texCoord, normal.extensions, false);
  if (to.emits()) {
    const auto& emissive = from.emissiveTexture;
    to.emissiveTexture = texture(emissive.index, emissive.texCoord, emissive.extensions, true);
  }
  convertExtensions(from, to);
  context_.scene.materials[index] = std::move(to);
  texCoordSets_[index] = currentSet_;
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
    to.specularTexture = textureProperty(*e, "specularTexture", false);
    to.specularColorTexture = textureProperty(*e, "specularColorTexture", true);
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
      to.transmissionTexture = textureProperty(*e, "transmissionTexture", false);
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
}

Texture GltfMaterials::textureProperty(const tinygltf::Value& object, const char* key, bool srgb) {
  const tinygltf::Value* info = member(object, key);
  if (info == nullptr) return {};
  const tinygltf::Value* index = member(*info, "index");
  const tinygltf::Value* texCoord = member(*info, "texCoord");
  if (index == nullptr || !index->IsNumber() || indexOf(*index) < 0) {
    context_.bad("{}: {} has no index", currentName_, key);
  }
  tinygltf::ExtensionMap extensions;
  if (const auto* list = member(*info, "extensions"); list != nullptr) {
    if (const auto* transform = member(*list, "KHR_texture_transform")) {
      extensions["KHR_texture_transform"] = *transform;
    }
  }
  const int set = texCoord != nullptr && texCoord->IsNumber() ? indexOf(*texCoord) : 0;
  return texture(indexOf(*index), set, extensions, srgb);
}

Texture GltfMaterials::texture(int index, int texCoord, const tinygltf::ExtensionMap& extensions,
                               bool srgb) {
  if (index == -1 || !context_.options.loadTextures) return {};
  const auto& textures = context_.model.textures;
  if (index < 0 || std::size_t(index) >= textures.size()) {
    context_.bad("{}: texture {} does not exist; there are {}", currentName_, index,
                 textures.size());
  }
  const tinygltf::Texture& from = textures[index];
  int source = from.source;
  if (const auto* webp = extension(from.extensions, "EXT_texture_webp")) {
    const auto* value = member(*webp, "source");
    if (value != nullptr && value->IsNumber()) source = indexOf(*value);
  }
  if (source < 0) {
    context_.warn("{}: texture {} has no image that can be read; it is left out", currentName_,
                  index);
    return {};
  }
  Texture to;
  to.image = sceneImage(source, srgb);
  if (from.sampler >= 0) {
    if (std::size_t(from.sampler) >= context_.model.samplers.size()) {
      context_.bad("texture {}: sampler {} does not exist", index, from.sampler);
    }
    const tinygltf::Sampler& sampler = context_.model.samplers[from.sampler];
    to.wrapS = wrapOf(sampler.wrapS);
    to.wrapT = wrapOf(sampler.wrapT);
  }
  if (const auto* transform = extension(extensions, "KHR_texture_transform")) {
    to.offset = pairOr(member(*transform, "offset"), vec2(0.0f));
    to.scale = pairOr(member(*transform, "scale"), vec2(1.0f));
    to.rotation = finiteOr(member(*transform, "rotation"), 0.0f);
    const auto* set = member(*transform, "texCoord");
    if (set != nullptr && set->IsNumber()) texCoord = indexOf(*set);
  }
  if (currentSet_ < 0) currentSet_ = std::max(texCoord, 0);
  if (texCoord != currentSet_) {
    context_.warn("{}: its textures use coordinate sets {} and {}; set {} is used for all",
                  currentName_, currentSet_, texCoord, currentSet_);
  }
  return to;
}

int GltfMaterials::sceneImage(int gltfImage, bool srgb) {
  if (gltfImage < 0 || std::size_t(gltfImage) >= context_.model.images.size()) {
    context_.bad("image {} does not exist; there are {}", gltfImage, context_.model.images.size());
  }
  const auto [at, isNew] = imageIndex_.try_emplace(gltfImage, static_cast<int>(pending_.size()));
  if (isNew) pending_.push_back({gltfImage, srgb});
  pending_[at->second].srgb |= srgb;
  return at->second;
}

Image GltfMaterials::loadImage(const PendingImage& pending) const {
  const tinygltf::Image& image = context_.model.images[pending.gltfImage];
  const std::string name = fmt::format("{}: image {} ('{}')", context_.name, pending.gltfImage,
                                       image.uri.empty() ? image.name : image.uri.substr(0, 80));
  if (image.bufferView >= 0) {
    const tinygltf::BufferView& view = context_.model.bufferViews.at(image.bufferView);
    const auto& data = context_.model.buffers.at(view.buffer).data;
    if (view.byteOffset > data.size() || view.byteLength > data.size() - view.byteOffset) {
      fail(ExitCode::kInput, "{}: bufferView {} lies outside its buffer", name, image.bufferView);
    }
    return decodeImage({data.data() + view.byteOffset, view.byteLength}, name, pending.srgb);
  }
  if (image.uri.empty()) return decodeImage(image.image, name, pending.srgb);
  if (image.uri.find(':') < 12 && image.uri.find('/') > image.uri.find(':')) {
    fail(ExitCode::kInput, "{}: only files and base64 data URIs of common types can be read", name);
  }
  const std::filesystem::path path = context_.path.parent_path() / percentDecoded(image.uri);
  noteFile(context_.scene, path);
  return decodeImage(readWholeFile(path, name), name, pending.srgb);
}

void GltfMaterials::loadImages() {
  // One after the other: decoding in parallel crashed now and then with OpenImageIO 2.4.7 (2 of
  // about 65 runs on 15 textures, cause not found), for 0.04 s gained.
  for (const PendingImage& image : pending_) context_.scene.images.push_back(loadImage(image));
}

}  // namespace trex::detail
