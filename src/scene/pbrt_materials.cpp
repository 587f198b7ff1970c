#include "src/scene/pbrt_materials.h"

#include <algorithm>
#include <cmath>

#include "src/scene/fresnel.h"
#include "src/scene/image_make.h"
#include "src/scene/import_detail.h"
#include "src/scene/relief.h"
#include "src/scene/texture_file.h"

namespace trex::detail {
namespace {

Material diffuse(vec3 color) {
  Material m;
  m.baseColor = vec4(color, 1.0f);
  m.metallic = 0.0f;
  m.specular = 0.0f;
  return m;
}

/// Index of the dielectric that reflects as much straight on; as far as materials go.
float indexOfReflectance(float f0) {
  const float root = std::sqrt(std::min(clampedUnit(f0), 0.66f));
  return (1.0f + root) / (1.0f - root);
}

/// In between in every number; textures are those of the larger share.
Material between(const Material& a, const Material& b, float share) {
  Material m = share < 0.5f ? a : b;
  if (!a.baseColorTexture.present() && !b.baseColorTexture.present()) {
    m.baseColor = glm::mix(a.baseColor, b.baseColor, share);
    m.metallic = std::lerp(a.metallic, b.metallic, share);
    m.roughness = std::lerp(a.roughness, b.roughness, share);
    m.specular = std::lerp(a.specular, b.specular, share);
    m.specularColor = glm::mix(a.specularColor, b.specularColor, share);
    m.transmission = std::lerp(a.transmission, b.transmission, share);
  }
  return m;
}

std::size_t hashOf(const Material& m) {
  std::size_t hash = std::hash<std::string>()(m.name);
  const auto add = [&](float value) { hash = hash * 1'000'003u ^ std::hash<float>()(value); };
  for (int c = 0; c < 4; ++c) add(m.baseColor[c]);
  for (int c = 0; c < 3; ++c) add(m.emission[c]), add(m.finish.metalK[c]);
  add(m.metallic);
  add(m.roughness);
  add(static_cast<float>(m.baseColorTexture.image));
  return hash;
}

}  // namespace

float pbrtAlpha(float roughness, bool version4) {
  if (version4) return std::sqrt(std::max(roughness, 0.0f));
  const float x = std::log(std::max(roughness, 1e-3f));
  return 1.62142f + x * (0.819955f + x * (0.1734f + x * (0.0171201f + x * 0.000640711f)));
}

PbrtMaterials::PbrtMaterials(PbrtContext& context, PbrtColors& colors, PbrtTextures& textures)
    : context_(context), colors_(colors), textures_(textures) {
  Made made;
  made.material = diffuse(vec3(0.5f));
  made.material.name = "default";
  made_.push_back(std::move(made));
}

std::optional<int> PbrtMaterials::find(const std::string& name) const {
  const auto found = named_.find(name);
  return found == named_.end() ? std::nullopt : std::optional(found->second);
}

int PbrtMaterials::indexOf(const Material& material) {
  const std::size_t hash = hashOf(material);
  const auto [first, last] = indices_.equal_range(hash);
  std::vector<Material>& all = context_.scene.materials;
  for (auto at = first; at != last; ++at) {
    if (all[at->second] == material) return at->second;
  }
  const int index = static_cast<int>(all.size());
  all.push_back(material);
  indices_.emplace(hash, index);
  return index;
}

int PbrtMaterials::make(std::string type, const PbrtParameters& parameters,
                        const std::string& name) {
  Made made;
  made.material = diffuse(vec3(0.5f));
  if (type.empty() || type == "none" || type == "interface") {
    made.invisible = true;
    parameters.ignoreAll();
  } else if (type == "mix") {
    made = mix(parameters);
  } else if (!makeV3(type, parameters, made.material) && !makeV4(type, parameters, made.material) &&
             !makeOthers(type, parameters, made.material)) {
    context_.replace("this material is not known; grey 0.5 is shown");
    parameters.ignoreAll();
  }
  if (!made.invisible) setRelief(parameters, made);
  made.material.name = utf8Of(name.empty() ? type : name);
  made_.push_back(std::move(made));
  return static_cast<int>(made_.size()) - 1;
}

bool PbrtMaterials::makeV3(const std::string& type, const PbrtParameters& p, Material& m) {
  if (type == "matte") {
    setBase(textures_.color(p, "Kd", vec3(0.5f)), m);
    const float sigma = textures_.meanNumber(textures_.number(p, "sigma", 0.0f));
    if (sigma > 0.0f) context_.replace("its sigma of {} is not shown; it is Lambertian", sigma);
  } else if (type == "plastic") {
    setBase(textures_.color(p, "Kd", vec3(0.25f)), m);
    setSpecular(textures_.color(p, "Ks", vec3(0.25f)), m);
    setRoughness(p, "", 0.1f, false, m);
  } else if (type == "uber") {
    makeUber(p, m);
  } else if (type == "substrate") {
    setBase(textures_.color(p, "Kd", vec3(0.5f)), m);
    const PbrtTexture ks = textures_.color(p, "Ks", vec3(0.5f));
    m.ior = indexOfReflectance(maxComponent(textures_.mean(ks)));
    setSpecular(ks, m);
    m.specular = 1.0f;
    setRoughness(p, "", 0.1f, false, m);
  } else if (type == "metal") {
    setMetal(colors_.conductor(p, "eta", "k"), m);
    setRoughness(p, "", 0.01f, false, m);
  } else if (type == "mirror") {
    setBase(textures_.color(p, "Kr", vec3(0.9f)), m);
    m.metallic = 1.0f;
    m.roughness = 0.0f;
  } else if (type == "glass") {
    makeGlass(p, m);
  } else if (type == "translucent") {
    const PbrtTexture kd = textures_.color(p, "Kd", vec3(0.25f));
    makeThroughDiffuse(textures_.product(kd, textures_.color(p, "reflect", vec3(0.5f))),
                       textures_.product(kd, textures_.color(p, "transmit", vec3(0.5f))), m);
    p.ignore({"Ks", "roughness", "remaproughness"});
  } else if (type == "disney") {
    makeDisney(p, m);
  } else {
    return false;
  }
  return true;
}

void PbrtMaterials::makeUber(const PbrtParameters& p, Material& m) {
  const PbrtTexture kd = textures_.color(p, "Kd", vec3(0.25f));
  const PbrtTexture kr = textures_.color(p, "Kr", vec3(0.0f));
  const PbrtTexture kt = textures_.color(p, "Kt", vec3(0.0f));
  PbrtTexture ks = textures_.color(p, "Ks", vec3(0.25f));
  setRoughness(p, "", 0.1f, false, m);
  if (maxComponent(textures_.mean(kr)) > maxComponent(textures_.mean(ks))) {
    context_.replace("of its Kr and Ks the stronger, Kr, is shown");
    ks = kr;
    m.roughness = 0.0f;
    m.metallicRoughnessTexture = {};
  }
  setSpecular(ks, m);
  m.ior = colors_.index(p, p.find("index") != nullptr ? "index" : "eta", 1.5f);
  const float reflected = luminance(textures_.mean(kd));
  const float through = luminance(textures_.mean(kt));
  if (through > 0.0f) {
    context_.replace("its Kt is shown as a share {:.3g} of the base colour",
                     through / (reflected + through));
    m.transmission = clampedUnit(through / (reflected + through));
    m.volume = true;
    m.roughness = 0.0f;
    m.metallicRoughnessTexture = {};
  }
  if (through > reflected) {
    setBase({kt.factor + textures_.mean(kd), kt.image}, m);
  } else {
    setBase({kd.factor + textures_.mean(kt), kd.image}, m);
  }
  PbrtTexture opacity = textures_.color(p, "opacity", vec3(1.0f));
  applyOpacity(opacity, m);
}

void PbrtMaterials::makeGlass(const PbrtParameters& p, Material& m) {
  const PbrtTexture kr = textures_.color(p, "Kr", vec3(1.0f));
  setBase(textures_.color(p, "Kt", vec3(1.0f)), m);
  if (maxComponent(glm::abs(textures_.mean(kr) - vec3(1.0f))) > 1e-3f) {
    context_.replace("its Kr is not shown; it reflects as its index has it");
  }
  m.ior = colors_.index(p, p.find("eta") != nullptr ? "eta" : "index", 1.5f);
  m.specular = 1.0f;
  m.transmission = 1.0f;
  m.volume = true;
  setRoughness(p, "", 0.0f, false, m);
  const float flat = 0.0f;
  const auto smooth = [&](const char* name) {
    const PbrtTexture r = textures_.number(p, name, flat);
    return !r.varies() && r.factor.x == 0.0f;
  };
  if (smooth("uroughness") && smooth("vroughness") && smooth("roughness")) m.roughness = 0.0f;
}

void PbrtMaterials::makeDisney(const PbrtParameters& p, Material& m) {
  setBase(textures_.color(p, "color", vec3(0.5f)), m);
  const auto number = [&](const char* name, float otherwise) {
    const PbrtTexture value = textures_.number(p, name, otherwise);
    if (value.varies()) context_.replace("of its {} the mean is shown", name);
    return clampedUnit(textures_.meanNumber(value));
  };
  m.metallic = number("metallic", 0.0f);
  m.roughness = number("roughness", 0.5f);
  m.specular = 1.0f;
  m.ior = colors_.index(p, "eta", 1.5f);
  m.transmission = number("spectrans", 0.0f);
  m.volume = m.transmission > 0.0f && !p.flag("thin", false);
  p.ignore({"sheentint", "clearcoatgloss", "scatterdistance"});
  for (const char* name :
       {"sheen", "clearcoat", "anisotropic", "speculartint", "flatness", "difftrans"}) {
    if (number(name, 0.0f) > 0.0f) context_.replace("its {} is not shown", name);
  }
}

bool PbrtMaterials::makeV4(const std::string& type, const PbrtParameters& p, Material& m) {
  const bool known = type == "diffuse" || type == "coateddiffuse" || type == "conductor" ||
                     type == "coatedconductor" || type == "dielectric" ||
                     type == "thindielectric" || type == "diffusetransmission";
  if (!known) return false;
  colors_.version4 = true;
  if (type == "diffuse" || type == "coateddiffuse") {
    setBase(textures_.color(p, "reflectance", vec3(0.5f)), m);
  }
  if (type == "coateddiffuse") {
    setRoughness(p, "", 0.0f, true, m);
    m.specular = 1.0f;
    m.ior = colors_.index(p, "eta", 1.5f);
    p.ignore({"thickness", "g", "albedo", "maxdepth", "nsamples"});
  } else if (type == "conductor") {
    makeConductor(p, "", m);
  } else if (type == "coatedconductor") {
    context_.replace("its coat is not shown");
    makeConductor(p, "conductor.", m);
    p.ignore({"interface.roughness", "interface.uroughness", "interface.vroughness",
              "interface.eta", "thickness", "g", "albedo", "maxdepth", "nsamples"});
  } else if (type == "dielectric" || type == "thindielectric") {
    setBase({vec3(1.0f), {}}, m);
    m.specular = 1.0f;
    m.transmission = 1.0f;
    m.volume = type == "dielectric";
    m.ior = colors_.index(p, "eta", 1.5f);
    setRoughness(p, "", 0.0f, true, m);
  } else if (type == "diffusetransmission") {
    const PbrtTexture scale = textures_.number(p, "scale", 1.0f);
    makeThroughDiffuse(textures_.product(textures_.color(p, "reflectance", vec3(0.25f)), scale),
                       textures_.product(textures_.color(p, "transmittance", vec3(0.25f)), scale),
                       m);
  }
  return true;
}

void PbrtMaterials::makeConductor(const PbrtParameters& p, std::string_view prefix, Material& m) {
  const std::string before(prefix);
  const bool plain = p.find(before + "reflectance") != nullptr ||
                     (!before.empty() && p.find("reflectance") != nullptr);
  if (plain) {
    setBase(textures_.color(p, p.find("reflectance") ? "reflectance" : before + "reflectance",
                            vec3(0.5f)),
            m);
  } else {
    setMetal(colors_.conductor(p, before + "eta", before + "k"), m);
  }
  m.metallic = 1.0f;
  setRoughness(p, prefix, 0.0f, true, m);
}

/// Materials that only their colour is shown of.
bool PbrtMaterials::makeOthers(const std::string& type, const PbrtParameters& p, Material& m) {
  if (type == "subsurface" || type == "kdsubsurface") {
    const char* name = p.find("reflectance") != nullptr ? "reflectance" : "Kd";
    const PbrtTexture color = textures_.color(p, name, vec3(0.5f));
    setBase(color, m);
    m.specular = 1.0f;
    m.ior = colors_.index(p, "eta", 1.33f);
    setRoughness(p, "", 0.0f, colors_.version4, m);
    p.ignore({"name", "sigma_a", "sigma_s", "mfp", "scale", "g", "Kr", "Kt"});
  } else if (type == "hair") {
    const char* name = p.find("reflectance") != nullptr ? "reflectance" : "color";
    setBase(textures_.color(p, name, vec3(0.12f, 0.07f, 0.04f)), m);
    p.ignore({"sigma_a", "eumelanin", "pheomelanin", "eta", "beta_m", "beta_n", "alpha"});
  } else if (type == "measured" || type == "fourier") {
    p.ignore({"filename", "bsdffile"});
  } else {
    return false;
  }
  context_.replace(
      "what scatters below the surface or was measured is not shown; its colour "
      "{:.3g} {:.3g} {:.3g} is",
      m.baseColor.x, m.baseColor.y, m.baseColor.z);
  return true;
}

void PbrtMaterials::makeThroughDiffuse(const PbrtTexture& reflected, const PbrtTexture& transmitted,
                                       Material& m) {
  const float back = luminance(textures_.mean(reflected));
  const float through = luminance(textures_.mean(transmitted));
  const float sum = std::max(back + through, 1e-6f);
  const PbrtTexture& stronger = back < through ? transmitted : reflected;
  const float share = std::max(std::max(back, through) / sum, 1e-6f);
  setBase({stronger.factor / share, stronger.image}, m);
  m.transmission = clampedUnit(through / sum);
  m.roughness = 1.0f;
  context_.replace(
      "the diffuse light that it lets through is shown as rough thin glass, a share "
      "of {:.3g}",
      m.transmission);
}

PbrtMaterials::Made PbrtMaterials::mix(const PbrtParameters& p) {
  // pbrt-v3 has `amount` of the first material, pbrt-v4 of the second.
  const bool version4 = p.find("materials") != nullptr;
  std::vector<std::string> names;
  if (version4) {
    const auto given = p.texts("materials");
    names.assign(given.begin(), given.end());
  } else {
    names = {p.text("namedmaterial1"), p.text("namedmaterial2")};
  }
  names.resize(2);
  const auto one = find(names[0]), two = find(names[1]);
  if (!one || !two) {
    context_.replace("there is no material '{:.80}'; grey 0.5 is shown", one ? names[1] : names[0]);
  }
  const Made& a = made_[one.value_or(0)];
  const Made& b = made_[two.value_or(0)];
  const PbrtTexture amount =
      version4 ? textures_.number(p, "amount", 0.5f) : textures_.color(p, "amount", vec3(0.5f));
  float share = clampedUnit(textures_.meanNumber(amount));
  if (!version4) share = 1.0f - share;
  if (a.invisible || b.invisible) {
    Made made = a.invisible ? b : a;
    made.material.baseColor.a *= a.invisible ? share : 1.0f - share;
    made.material.alphaMode = AlphaMode::kBlend;
    return made;
  }
  if (share > 0.0f && share < 1.0f) {
    context_.replace("of the two materials one in between is shown, a share of {:.3g} of '{:.80}'",
                     share, names[1]);
  }
  return {between(withMeanMetal(a.material), withMeanMetal(b.material), share), false,
          share < 0.5f ? a.relief : b.relief};
}

void PbrtMaterials::setBase(const PbrtTexture& texture, Material& m) {
  const PbrtTexture within = textures_.withinOne(texture);
  m.baseColor = vec4(within.factor, m.baseColor.a);
  m.baseColorTexture = within.image;
}

void PbrtMaterials::setSpecular(const PbrtTexture& texture, Material& m) {
  const PbrtTexture within = textures_.withinOne(texture);
  m.specular = maxComponent(within.factor);
  m.specularColor = m.specular > 0.0f ? within.factor / m.specular : vec3(1.0f);
  m.specularColorTexture = within.image;
}

void PbrtMaterials::setRoughness(const PbrtParameters& p, std::string_view prefix, float otherwise,
                                 bool v4, Material& m) {
  const std::string before(prefix);
  const PbrtTexture both = textures_.number(p, before + "roughness", otherwise);
  const auto along = [&](const char* name) {
    return p.find(before + name) != nullptr ? textures_.number(p, before + name, otherwise) : both;
  };
  const PbrtTexture u = along("uroughness"), v = along("vroughness");
  const bool remap = p.flag("remaproughness", true);
  const auto alpha = [&](float value) { return remap ? pbrtAlpha(value, v4) : value; };
  if (u.varies()) {
    const auto texel = [&](float value) {
      return vec3(1.0f, std::sqrt(clampedUnit(alpha(value))), 1.0f);
    };
    m.roughness = 1.0f;
    m.metallicRoughnessTexture = u.image;
    m.metallicRoughnessTexture.image = textures_.imageNamed(
        fmt::format("roughness of {} times {}{}{}", textures_.imageOf(u).name, u.factor.x,
                    remap ? "" : ", not remapped", v4 ? ", version 4" : ""),
        [&] { return textures_.bytesOf(u, 3, texel); });
    return;
  }
  const float alphaU = alpha(textures_.meanNumber(u)), alphaV = alpha(textures_.meanNumber(v));
  const float mean = std::sqrt(std::max(alphaU * alphaV, 0.0f));
  if (std::abs(alphaU - alphaV) > 1e-3f) {
    context_.replace("its roughness along u and v, alpha {:.3g} and {:.3g}, is shown as {:.3g}",
                     alphaU, alphaV, mean);
  }
  if (mean > 1.005f) context_.replace("its roughness, alpha {:.3g}, is shown as 1", mean);
  m.roughness = std::sqrt(clampedUnit(mean));
}

void PbrtMaterials::applyOpacity(const PbrtTexture& opacity, Material& m) {
  if (!opacity.varies()) {
    const float a = clampedUnit(textures_.meanNumber(opacity));
    m.baseColor.a *= a;
    if (a < 1.0f) m.alphaMode = AlphaMode::kBlend;
    return;
  }
  const std::vector<Image>& images = context_.scene.images;
  const bool textured = m.baseColorTexture.present();
  Texture place = textured ? m.baseColorTexture : opacity.image;
  Texture other = opacity.image;
  other.image = place.image;
  if (!(other == place)) {
    context_.replace("its opacity is placed as its colour is");
  }
  const std::string name =
      fmt::format("{} with the opacity of {} times {}", textured ? images[place.image].name : "1",
                  images[opacity.image.image].name, opacity.factor.x);
  place.image = textures_.imageNamed(name, [&] {
    const Image mask = textures_.bytesOf(opacity, 1, [](float value) { return vec3(value); });
    return withOpacity(textured ? &images[place.image] : nullptr, mask);
  });
  m.baseColorTexture = place;
  m.alphaMode = AlphaMode::kBlend;
}

/// Version 3 has a bumpmap; what version 4 calls displacement of a material is one too.
void PbrtMaterials::setRelief(const PbrtParameters& p, Made& made) {
  for (const char* name : {"bumpmap", "displacement"}) {
    if (p.find(name) != nullptr) made.relief = textures_.number(p, name, 0.0f);
  }
  const std::string file = p.text("normalmap");
  if (file.empty() || !context_.options.loadTextures) return;
  made.material.normalTexture.image =
      imageOfFile(context_.scene, context_.folder, file, false, context_.where() + ": normalmap",
                  "it is left out");
}

void PbrtMaterials::applyRelief(int number, const Mesh& mesh, const dmat4& place, Material& m) {
  const PbrtTexture& relief = made_[number].relief;
  if (!relief.varies() || mesh.texCoords.empty() || m.normalTexture.present()) return;
  PbrtTexture heights{vec3(1.0f), relief.image};
  heights.image.image = textures_.imageNamed("heights of " + textures_.imageOf(relief).name, [&] {
    return textures_.bytesOf(heights, 1, [](float value) { return vec3(value); });
  });
  const double metres = (double(relief.factor.x) + relief.factor.y + relief.factor.z) / 3.0;
  setBumps(context_.scene, heights.image, metres, uvFactsOf(mesh, place), m);
}

}  // namespace trex::detail
