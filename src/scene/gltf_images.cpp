// The images that the materials of a glTF file read.
#include <algorithm>

#include "src/scene/gltf_detail.h"
#include "src/scene/gltf_file.h"
#include "src/scene/image_make.h"
#include "src/scene/texels.h"
#include "src/scene/texture_cache.h"

namespace trex::detail {

int GltfMaterials::sceneImage(int gltfImage, bool srgb) {
  const auto [at, isNew] = imageIndex_.try_emplace(gltfImage, static_cast<int>(pending_.size()));
  if (isNew) pending_.push_back({.first = gltfImage, .srgb = srgb});
  pending_[at->second].srgb |= srgb;
  return at->second;
}

/// The scene image that will be made of others once they are loaded.
int GltfMaterials::madeImage(const PendingImage& wanted) {
  const auto at = std::find(pending_.begin(), pending_.end(), wanted);
  const auto index = static_cast<int>(at - pending_.begin());
  if (at == pending_.end()) pending_.push_back(wanted);
  return index;
}

Image GltfMaterials::make(const PendingImage& wanted) {
  if (wanted.make == PendingImage::Make::kDecode) {
    return decodeGltfImage(context_, wanted.first, wanted.srgb);
  }
  const auto& images = context_.scene.images;
  const auto source = [&](int number) {  // null where it could not be decoded
    return number == kNone || images[number].width == 0 ? nullptr : &images[number];
  };
  const Image *first = source(wanted.first), *second = source(wanted.second);
  if (wanted.make == PendingImage::Make::kOfGlossiness) {
    return roughnessOfGlossiness(images[wanted.first], wanted.glossiness);
  }
  if (wanted.make == PendingImage::Make::kRoughnessAndMetallic) {
    return first || second ? roughnessAndMetallic(first, second) : Image{};
  }
  return second ? withOpacity(first, *second) : first ? *first : Image{};
}

void GltfMaterials::loadImages() {
  // One after the other: decoding in parallel crashed now and then with OpenImageIO 2.4.7 (2 of
  // about 65 runs on 15 textures, cause not found), for 0.04 s gained.
  for (const PendingImage& pending : pending_) {
    Image made;
    context_.attempt("textures of it are left out", [&] { made = make(pending); });
    addImage(context_.scene, std::move(made));
  }
  for (std::size_t i = 0; i < pending_.size(); ++i) separateNumbers(i);
}

/// Of 16 bits an image is decoded as it is read: textures of numbers that share one with colours
/// get their own.
void GltfMaterials::separateNumbers(std::size_t decoded) {
  Scene& scene = context_.scene;
  const PendingImage& pending = pending_[decoded];
  if (pending.make != PendingImage::Make::kDecode ||
      texelKind(scene.images[decoded]) != TexelKind::kSrgbWord) {
    return;
  }
  int own = kNone;
  for (Material& m : scene.materials) {
    for (Texture* t : m.textures()) {
      const bool color = t == &m.baseColorTexture || t == &m.emissiveTexture ||
                         t == &m.specularColorTexture || t == &m.finish.sheenColorTexture;
      if (color || t->image != static_cast<int>(decoded)) continue;
      if (own == kNone) {
        Image made;
        context_.attempt("textures of it are left out",
                         [&] { made = decodeGltfImage(context_, pending.first, false); });
        own = addImage(scene, std::move(made));
      }
      t->image = own;
    }
  }
}

}  // namespace trex::detail
