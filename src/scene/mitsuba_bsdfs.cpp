// BSDFs that hold others, and which reader is whose.
#include "src/scene/mitsuba_bsdfs.h"

#include <algorithm>

#include "src/scene/fresnel.h"
#include "src/scene/image_make.h"
#include "src/scene/texture_cache.h"

namespace trex::detail::mitsuba {
namespace {

Material black() {
  Material m;
  m.baseColor = vec4(0.0f, 0.0f, 0.0f, 1.0f);
  m.metallic = 0.0f;
  m.specular = 0.0f;
  return m;
}

vec4 grey(float value) { return {value, value, value, 1.0f}; }

/// Numbers of two materials mixed; textures are those of the one that counts more.
Material mixed(const Material& first, const Material& second, float weight) {
  const Material a = withMeanMetal(first), b = withMeanMetal(second);
  Material m = weight < 0.5f ? a : b;
  m.baseColor = glm::mix(a.baseColor, b.baseColor, weight);
  m.metallic = std::lerp(a.metallic, b.metallic, weight);
  m.roughness = std::lerp(a.roughness, b.roughness, weight);
  m.specular = std::lerp(a.specular, b.specular, weight);
  m.transmission = std::lerp(a.transmission, b.transmission, weight);
  return m;
}

}  // namespace

Look Bsdfs::plain(bool shines) const {
  Look look;
  look.material = black();
  look.material.name = "default";
  if (!shines) look.material.baseColor = grey(0.5f);
  return look;
}

const Look& Bsdfs::look(const Element& bsdf) {
  if (const auto found = looks_.find(&bsdf); found != looks_.end()) return found->second;
  Look made = read(bsdf);
  made.meshColors |= textures_.takeMeshColors();
  return looks_.emplace(&bsdf, std::move(made)).first->second;
}

Look Bsdfs::read(const Element& bsdf) {
  const Properties of(context_, bsdf);
  if (depth_ >= kMostNested) return unknown(of);
  ++depth_;
  Look look = readByType(of, bsdf.type());
  --depth_;
  of.tellUnused();
  const std::string_view id = bsdf.attribute("id");
  look.material.name = id.empty()
                           ? fmt::format("{} of {}", bsdf.type(), context_.document().where(bsdf))
                           : std::string(id);
  return look;
}

Look Bsdfs::readByType(const Properties& of, std::string_view type) {
  Look look;
  Material& m = look.material = black();
  const bool rough = type.starts_with("rough");
  if (type == "twosided") return readTwoSided(of);
  if (type == "mask" || type == "opacity") return readMask(of);
  if (type == "bumpmap") return readRelief(of, Look::Relief::kHeights);
  if (type == "normalmap") return readRelief(of, Look::Relief::kNormals);
  if (type == "blendbsdf" || type == "mixturebsdf") return readBlend(of);
  if (type == "coating" || type == "roughcoating") return readCoating(of);
  if (type == "null") {
    look.invisible = look.twosided = true;
  } else if (type == "diffuse" || type == "roughdiffuse" || type == "lambertian") {
    readDiffuse(of, m);
  } else if (type == "dielectric" || type == "thindielectric" || type == "roughdielectric") {
    look.twosided = true;
    readDielectric(of, m, rough, type == "thindielectric");
  } else if (type == "conductor" || type == "roughconductor") {
    readConductor(of, m, rough);
  } else if (type == "plastic" || type == "roughplastic" || type == "pplastic") {
    readPlastic(of, m, rough || type == "pplastic");
  } else if (type == "principled" || type == "principledthin") {
    readPrincipled(of, m, type == "principledthin");
  } else if (type == "phong" || type == "ward") {
    readPhong(of, m);
  } else {
    return unknown(of);
  }
  return look;
}

Look Bsdfs::unknown(const Properties& of) {
  const bool deep = depth_ >= kMostNested;
  context_.replace(of.element(),
                   fmt::format("bsdf '{:.40}' is {}; grey 0.5 is used", of.element().type(),
                               deep ? "nested too deeply" : "not known"));
  for (const Element* nested : of.objects("bsdf")) static_cast<void>(nested);
  return plain(false);
}

Look Bsdfs::readNested(const Properties& of) {
  const std::vector<const Element*> nested = of.objects("bsdf");
  if (!nested.empty()) return look(*nested.front());
  context_.replace(of.element(),
                   fmt::format("bsdf '{:.40}' holds none; grey 0.5 is used", of.element().type()));
  return plain(false);
}

Look Bsdfs::readTwoSided(const Properties& of) {
  Look look = readNested(of);
  look.twosided = true;
  if (of.objects("bsdf").size() > 1) {
    context_.replace(of.element(), "the back's bsdf is not shown; both sides have the front's");
  }
  return look;
}

Look Bsdfs::readMask(const Properties& of) {
  Look look = readNested(of);
  setOpacity(of, look.material, textures_.number(of, "opacity", 0.5f));
  return look;
}

void Bsdfs::setOpacity(const Properties& of, Material& m, const NumberInput& opacity) {
  m.alphaMode = AlphaMode::kBlend;
  m.baseColor.a *= std::clamp(opacity.factor, 0.0f, 1.0f);
  if (!opacity.texture.present()) return;
  const Texture cover =
      textures_.changed({vec3(1.0f), opacity.texture, opacity.srgb}, "as opacity", false,
                        [](const vec4& v) { return vec4(luminance(vec3(v))); });
  const Scene& scene = context_.scene();
  const Texture color = m.baseColorTexture;
  m.baseColorTexture = color.present() ? color : cover;
  Texture moved = cover;
  moved.image = m.baseColorTexture.image;
  if (!(moved == m.baseColorTexture)) {
    context_.replace(of.element(), "the opacity's texture is placed as the colour's is");
  }
  Image image = withOpacity(color.present() ? &scene.images[color.image] : nullptr,
                            scene.images[cover.image]);
  image.name = fmt::format("{} as opacity of {}", scene.images[cover.image].name, m.name);
  m.baseColorTexture.image = addImage(context_.scene(), std::move(image));
}

Look Bsdfs::readRelief(const Properties& of, Look::Relief relief) {
  Look look = readNested(of);
  const Element* map = of.find(relief == Look::Relief::kNormals ? "normalmap" : "arbitrary");
  const std::vector<const Element*> textures = of.objects("texture");
  if (map == nullptr && !textures.empty()) map = textures.front();
  look.reliefScale = static_cast<float>(of.number("scale", 1.0));
  if (map == nullptr) {
    context_.replace(of.element(), "there is no texture; the surface stays flat");
    return look;
  }
  look.reliefMap = textures_.read(*map);
  if (look.reliefMap.texture.present()) look.relief = relief;
  return look;
}

Look Bsdfs::readBlend(const Properties& of) {
  const std::vector<const Element*> nested = of.objects("bsdf");
  if (nested.size() < 2) return readNested(of);
  float weight = 0.5f;
  if (const Element* e = of.find("weight")) {
    weight = luminance(textures_.meanOf(textures_.read(*e)));
  } else if (const std::vector<double> weights = numbersOf(of.text("weights"));
             weights.size() >= 2) {
    weight = static_cast<float>(weights[1] / std::max(weights[0] + weights[1], 1e-9));
  }
  context_.replace(of.element(), "a blend of bsdfs is shown as one material of mixed numbers");
  Look a = look(*nested[0]);
  const Look b = look(*nested[1]);
  a.material = mixed(a.material, b.material, std::clamp(weight, 0.0f, 1.0f));
  a.invisible = a.invisible && b.invisible;
  a.twosided = a.twosided && b.twosided;
  return a;
}

Look Bsdfs::readCoating(const Properties& of) {
  of.ignore({"int_ior", "ext_ior", "thickness", "sigma_a", "alpha", "distribution",
             "specular_reflectance"});
  context_.replace(of.element(), "the coating is not shown; what is under it is");
  return readNested(of);
}

Material Bsdfs::finished(const Look& look, const UvFacts& facts) {
  Material m = look.material;
  if (look.relief == Look::Relief::kNone) return m;
  if (look.relief == Look::Relief::kNormals) {
    // There green points along normal x u, here up the image, against v.
    const float sign = facts.rightHanded ? -1.0f : 1.0f;
    m.normalTexture = textures_.changed(
        look.reliefMap, facts.rightHanded ? "normals, turned" : "normals", false,
        [&](const vec4& v) { return vec4(v.x, 0.5f + sign * (v.y - 0.5f), v.z, 1.0f); });
    return m;
  }
  const Texture heights = textures_.changed(look.reliefMap, "heights", false,
                                            [](const vec4& v) { return vec4(luminance(vec3(v))); });
  const double metres = double(look.reliefScale) * luminance(look.reliefMap.factor);
  setBumps(context_.scene(), heights, metres, facts, m);
  return m;
}

}  // namespace trex::detail::mitsuba
