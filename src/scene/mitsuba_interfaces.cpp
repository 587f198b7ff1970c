// BSDFs that are one interface: diffuse, glass, metal, plastic, and Disney's.
#include <algorithm>

#include "src/scene/fresnel.h"
#include "src/scene/image_make.h"
#include "src/scene/layered.h"
#include "src/scene/mitsuba_bsdfs.h"
#include "src/scene/texture_cache.h"

namespace trex::detail::mitsuba {
namespace {

bool nearlyWhite(const ColorInput& c) {
  return !c.texture.present() && glm::all(glm::greaterThan(c.factor, vec3(0.999f)));
}

}  // namespace

void Bsdfs::readDiffuse(const Properties& of, Material& m) {
  const bool old = of.has("diffuse_reflectance");
  textures_.setBaseColor(
      m, textures_.color(of, old ? "diffuse_reflectance" : "reflectance", vec3(0.5f)));
  if (of.has("alpha"))
    context_.note(of.element(), "rough diffuse surfaces are shown as smooth ones");
}

double Bsdfs::indexOf(const Properties& of, std::string_view name, const char* otherwise) {
  const Element* e = of.find(name);
  if (e == nullptr) return double(*dielectricNamed(otherwise));
  if (e->tag != "string") return std::clamp(numberOf(context_, *e, "value", 1.5), 0.1, 10.0);
  const auto named = dielectricNamed(std::string(e->attribute("value")));
  if (!named) {
    context_.replace(*e, fmt::format("'{:.40}' is no known dielectric; {} is used",
                                     e->attribute("value"), otherwise));
  }
  return double(named ? *named : *dielectricNamed(otherwise));
}

double Bsdfs::relativeIndex(const Properties& of, const char* inside) {
  return indexOf(of, "int_ior", inside) / indexOf(of, "ext_ior", "air");
}

/// The image of roughness and metallic where one of them is textured; `alpha`: roughness is given
/// as its square.
void Bsdfs::setRoughMetallic(Material& m, const NumberInput& roughness, const NumberInput& metallic,
                             bool alpha) {
  const auto kept = [&](float v) { return alpha ? std::sqrt(std::max(v, 0.0f)) : v; };
  m.roughness = std::clamp(kept(roughness.factor), 0.0f, 1.0f);
  m.metallic = std::clamp(metallic.factor, 0.0f, 1.0f);
  Texture maps[2] = {roughness.texture, metallic.texture};
  if (maps[0].present()) {
    const float factor = roughness.factor;
    m.roughness = 1.0f;
    maps[0] = textures_.changed(
        {vec3(1.0f), maps[0], roughness.srgb},
        fmt::format("times {} as {}", factor, alpha ? "alpha" : "roughness"), false,
        [&](const vec4& v) { return vec4(kept(luminance(vec3(v)) * factor)); });
  }
  if (maps[1].present()) {
    maps[1] = textures_.changed({vec3(1.0f), maps[1], metallic.srgb}, "as metallic", false,
                                [](const vec4& v) { return vec4(luminance(vec3(v))); });
  }
  if (!maps[0].present() && !maps[1].present()) return;
  Scene& scene = context_.scene();
  const auto imageOf = [&](const Texture& t) {
    return t.present() ? &scene.images[t.image] : nullptr;
  };
  m.metallicRoughnessTexture = maps[0].present() ? maps[0] : maps[1];
  Image image = roughnessAndMetallic(imageOf(maps[0]), imageOf(maps[1]));
  image.name = fmt::format("roughness and metallic of {}", m.name);
  m.metallicRoughnessTexture.image = addImage(scene, std::move(image));
}

void Bsdfs::setAlpha(const Properties& of, Material& m) {
  NumberInput alpha = textures_.number(of, "alpha", 0.1f);
  if (of.has("alpha_u") || of.has("alpha_v")) {
    const double u = of.number("alpha_u", 0.1, 0.0, 1.0), v = of.number("alpha_v", 0.1, 0.0, 1.0);
    alpha.factor = static_cast<float>(std::sqrt(u * v));
    if (u != v) context_.note(of.element(), "anisotropic roughness is shown as its mean");
  }
  const std::string kind = of.text("distribution", "beckmann");
  m.finish.beckmann = kind == "beckmann";
  if (kind != "ggx" && kind != "beckmann") {
    context_.note(of.element(), fmt::format("microfacets '{:.40}' are shown as ggx", kind));
  }
  of.ignore({"sample_visible"});
  setRoughMetallic(m, alpha, {m.metallic, {}, true}, true);
}

void Bsdfs::readDielectric(const Properties& of, Material& m, bool rough, bool thin) {
  m.ior = static_cast<float>(relativeIndex(of, "bk7"));
  m.transmission = 1.0f;
  m.volume = !thin;
  m.specular = 1.0f;
  m.roughness = 0.0f;
  if (rough) setAlpha(of, m);
  textures_.setBaseColor(m, textures_.color(of, "specular_transmittance", vec3(1.0f)));
  if (!nearlyWhite(textures_.color(of, "specular_reflectance", vec3(1.0f)))) {
    context_.note(of.element(), "what glass reflects is not coloured here");
  }
}

void Bsdfs::readConductor(const Properties& of, Material& m, bool rough) {
  const bool old = context_.document().version().starts_with("0.");
  const std::string name = of.text("material", old && !of.has("eta") ? "Cu" : "none");
  std::optional<ComplexIor> ior = conductorNamed(name);
  if (!ior) {
    context_.replace(of.element(), fmt::format("metal '{:.40}' is not known; Al is used", name));
    ior = conductorNamed("Al");
  }
  const float outside = static_cast<float>(indexOf(of, "ext_eta", "vacuum"));
  ior->eta = of.color("eta", ior->eta, ColorKind::kIndex) / outside;
  ior->k = of.color("k", ior->k, ColorKind::kIndex) / outside;
  m.roughness = 0.0f;
  m.metallic = 1.0f;
  if (rough) setAlpha(of, m);
  setMetal(*ior, m);
  textures_.setBaseColor(m, textures_.color(of, "specular_reflectance", vec3(1.0f)));
}

void Bsdfs::readPlastic(const Properties& of, Material& m, bool rough) {
  m.ior = static_cast<float>(relativeIndex(of, "polypropylene"));
  m.roughness = 0.0f;
  m.specular = 1.0f;
  m.specularColor = of.color("specular_reflectance", vec3(1.0f), ColorKind::kReflectance);
  if (rough) setAlpha(of, m);
  context_.note(of.element(),
                "what is under plastic keeps its albedo; by angle it differs a little");
  const PlasticGround ground(std::max(double(m.ior), 1.0), of.flag("nonlinear", false));
  const auto change = [&](const vec4& v) {
    vec4 base(1.0f);
    for (int c = 0; c < 3; ++c) base[c] = static_cast<float>(ground.baseColor(double(v[c])));
    return base;
  };
  const ColorInput color = textures_.color(of, "diffuse_reflectance", vec3(0.5f));
  if (!color.texture.present()) {
    m.baseColor = change(vec4(color.factor, 1.0f));
    return;
  }
  m.baseColor = vec4(1.0f);
  m.baseColorTexture = textures_.changed(
      color, fmt::format("under plastic of {:.4g}, {}", m.ior, of.flag("nonlinear", false)), true,
      [&](const vec4& v) { return change(v * vec4(color.factor, 1.0f)); });
}

/// Disney's lobes add up; here the interface takes from the ground, and metals keep their colour at
/// grazing angles: the base colour is the one with the same albedo.
void Bsdfs::readPrincipled(const Properties& of, Material& m, bool thin) {
  context_.note(of.element(), "principled: albedos are kept; by angle they differ a little");
  const NumberInput roughness = textures_.number(of, "roughness", 0.5f);
  const NumberInput metallic = textures_.number(of, "metallic", 0.0f);
  const double f0 = 0.08 * of.number("specular", 0.5, 0.0, 1.0);
  m.ior = static_cast<float>(of.number("eta", 2.0 / (1.0 - std::sqrt(f0)) - 1.0, 1.0, 10.0));
  m.specular = 1.0f;
  m.transmission = static_cast<float>(of.number("spec_trans", 0.0, 0.0, 1.0));
  m.volume = m.transmission > 0.0f && !thin;
  setRoughMetallic(m, roughness, metallic, false);
  const double metal = metallic.texture.present() ? 0.0 : double(m.metallic);
  const double ground =
      (1.0 - metal) * disneyDiffuseAlbedo(double(m.roughness)) / diffuseShare(double(m.ior));
  const auto change = [&](const vec4& v) {
    vec4 base(1.0f);
    for (int c = 0; c < 3; ++c) {
      const double color = double(v[c]);
      base[c] = static_cast<float>(
          std::min(1.0, ground * color + metal * (color + (1.0 - color) / 21.0)));
    }
    return base;
  };
  const ColorInput color = textures_.color(of, "base_color", vec3(0.5f));
  m.baseColor = vec4(1.0f);
  if (color.texture.present()) {
    m.baseColorTexture = textures_.changed(
        color, fmt::format("of principled {:.3g} {:.3g} {:.3g}", metal, m.roughness, m.ior), true,
        [&](const vec4& v) { return change(v * vec4(color.factor, 1.0f)); });
  } else {
    m.baseColor = change(vec4(color.factor, 1.0f));
  }
  of.ignore({"clearcoat_gloss", "sheen_tint", "diffuse_reflectance_sampling_rate",
             "main_specular_sampling_rate", "clearcoat_sampling_rate"});
  for (const char* lobe :
       {"clearcoat", "sheen", "anisotropic", "flatness", "spec_tint", "diff_trans"}) {
    if (of.number(lobe, 0.0) == 0.0) continue;
    context_.note(of.element(), fmt::format("principled: '{}' is not shown", lobe));
  }
}

void Bsdfs::readPhong(const Properties& of, Material& m) {
  context_.replace(of.element(), fmt::format("bsdf '{}' is shown as microfacets of like width",
                                             of.element().type()));
  textures_.setBaseColor(m, textures_.color(of, "diffuse_reflectance", vec3(0.5f)));
  const vec3 specular = of.color("specular_reflectance", vec3(0.2f), ColorKind::kReflectance);
  const float strongest = std::min(maxComponent(specular), 0.98f);
  if (strongest > 0.0f) {
    m.specular = 1.0f;
    m.specularColor = specular / strongest;
    m.ior = (1.0f + std::sqrt(strongest)) / (1.0f - std::sqrt(strongest));
  }
  const double exponent = of.number("exponent", 30.0, 0.0, 1e9);
  m.roughness = static_cast<float>(std::pow(2.0 / (exponent + 2.0), 0.25));
  if (of.has("alpha_u")) setAlpha(of, m);
}

}  // namespace trex::detail::mitsuba
