#include "src/scene/mitsuba_textures.h"

#include <algorithm>

#include "src/scene/texels.h"
#include "src/scene/texture.h"
#include "src/scene/texture_cache.h"
#include "src/scene/texture_file.h"

namespace trex::detail::mitsuba {
namespace {

/// Rotation, scale and shift that a 2D matrix stands for; false if it shears.
bool decompose(const dmat4& m, Texture& texture) {
  const double a = m[0][0], b = m[1][0], c = m[0][1], d = m[1][1];
  const double sx = std::hypot(a, c);
  if (!(sx > 0.0)) return false;
  const double cosine = a / sx, sine = -c / sx;
  const double sy = d * cosine + b * sine;
  texture.rotation = static_cast<float>(std::atan2(sine, cosine));
  texture.scale = vec2(float(sx), float(sy));
  texture.offset = vec2(float(m[3][0]), float(m[3][1]));
  return std::abs(b * cosine - d * sine) <= 1e-6 * (std::abs(b) + std::abs(d));
}

}  // namespace

ColorInput Textures::color(const Properties& of, std::string_view name, const vec3& otherwise) {
  const Element* e = of.find(name);
  if (e == nullptr) return {otherwise, {}, true};
  ColorInput colored;
  return readMeshColors(*e, name, colored) ? colored : read(*e);
}

/// Colours that a mesh has, of what the base colour is made of.
bool Textures::readMeshColors(const Element& element, std::string_view parameter,
                              ColorInput& made) {
  const bool base =
      parameter == "reflectance" || parameter == "diffuse_reflectance" || parameter == "base_color";
  const std::string_view type = element.type();
  if (!base || element.tag != "texture" || (type != "mesh_attribute" && type != "vertexcolors")) {
    return false;
  }
  const Properties of(context_, element);
  const std::string name = of.text("name", "vertex_color");
  if (name != "vertex_color" && name != "face_color") return false;
  made.factor = vec3(static_cast<float>(of.number("scale", 1.0, 0.0, 1.0)));
  of.tellUnused();
  return meshColors_ = true;
}

NumberInput Textures::number(const Properties& of, std::string_view name, float otherwise) {
  const ColorInput read = color(of, name, vec3(otherwise));
  return {luminance(read.factor), read.texture, read.srgb};
}

ColorInput Textures::read(const Element& element) {
  if (isColor(element)) return {colorOf(context_, element, ColorKind::kReflectance), {}, true};
  const std::string_view type = element.type();
  if (element.tag == "texture" && depth_ < kMostNested) {
    ++depth_;
    ColorInput made;
    if (type == "bitmap") {
      made = readBitmap(element);
    } else if (type == "checkerboard") {
      made = readCheckerboard(element);
    } else if (type == "scale") {
      made = readScale(element);
    } else {
      context_.replace(element,
                       fmt::format("texture '{:.40}' is not known; grey 0.5 is used", type));
      made.factor = vec3(0.5f);
    }
    --depth_;
    return made;
  }
  context_.replace(element, fmt::format("<{:.40}> is no texture; grey 0.5 is used", element.tag));
  return {vec3(0.5f), {}, true};
}

ColorInput Textures::readBitmap(const Element& element) {
  const Properties of(context_, element);
  ColorInput made;
  const std::string name = of.text("filename");
  const bool linear = of.flag("raw", false) || of.number("gamma", -1.0) == 1.0;
  of.ignore({"filter_type", "max_anisotropy", "cache", "accel", "format"});
  made.texture.nearest = of.text("filter_type") == "nearest";
  wrap(of, made.texture);
  place(of, made.texture);
  if (of.has("channel")) context_.note(element, "all channels of a bitmap are used, not one");
  of.tellUnused();
  made.srgb = !linear;
  if (!context_.options().loadTextures) return {};
  made.texture.image =
      imageOfFile(context_.scene(), {}, context_.file(name).string(), !linear,
                  context_.document().where(element) + ": texture", "grey 0.5 is used");
  if (!made.texture.present()) return {vec3(0.5f), {}, true};
  return made;
}

void Textures::wrap(const Properties& of, Texture& texture) {
  const auto modeOf = [&](const std::string& name) {
    if (name == "mirror") return Texture::Wrap::kMirror;
    if (name == "clamp") return Texture::Wrap::kClamp;
    if (name != "repeat") {
      context_.replace(of.element(), fmt::format("wrap mode '{:.40}' is shown as repeat", name));
    }
    return Texture::Wrap::kRepeat;
  };
  const std::string both = of.text("wrap_mode", "repeat");
  texture.wrapS = modeOf(of.text("wrap_mode_u", both));
  texture.wrapT = modeOf(of.text("wrap_mode_v", both));
}

void Textures::place(const Properties& of, Texture& texture) {
  const dmat4 m = of.transform("to_uv");
  if (!decompose(m, texture)) {
    context_.replace(of.element(), "a to_uv that shears is shown without");
  }
  // A matrix of 3 by 3 shifts with its third column.
  if (m[2][0] != 0.0 || m[2][1] != 0.0) texture.offset += vec2(float(m[2][0]), float(m[2][1]));
  const double scale = of.number("uvscale", 1.0);
  texture.scale *= vec2(float(of.number("uscale", scale)), float(of.number("vscale", scale)));
  texture.offset += vec2(float(of.number("uoffset", 0.0)), float(of.number("voffset", 0.0)));
}

/// Two by two texels; of those, colour 0 is the first.
ColorInput Textures::readCheckerboard(const Element& element) {
  const Properties of(context_, element);
  ColorInput made;
  const vec3 colors[2] = {of.color("color0", vec3(0.4f), ColorKind::kReflectance),
                          of.color("color1", vec3(0.2f), ColorKind::kReflectance)};
  place(of, made.texture);
  of.tellUnused();
  Image image;
  image.width = image.height = 2;
  image.channels = 3;
  for (const int which : {0, 1, 1, 0}) {
    for (int c = 0; c < 3; ++c) image.floats.push_back(colors[which][c]);
  }
  image.name = fmt::format("checkerboard of {}", context_.document().where(element));
  const auto [found, fresh] =
      made_.try_emplace(image.name, static_cast<int>(context_.scene().images.size()));
  if (fresh) addImage(context_.scene(), std::move(image));
  made.texture.image = found->second;
  made.texture.nearest = true;
  return made;
}

ColorInput Textures::readScale(const Element& element) {
  const Properties of(context_, element);
  ColorInput made{vec3(1.0f), {}, true};
  const std::vector<const Element*> nested = of.objects("texture");
  if (!nested.empty()) made = read(*nested.front());
  const Element* scale = of.find("scale");
  if (scale != nullptr) made.factor *= colorOf(context_, *scale, ColorKind::kEmission);
  of.tellUnused();
  return made;
}

Texture Textures::changed(const ColorInput& input, const std::string& key, bool encode,
                          const std::function<vec4(const vec4&)>& change) {
  Texture made = input.texture;
  const Image& source = context_.scene().images[input.texture.image];
  const std::string name = fmt::format("{} {}{}", source.name, input.srgb ? "" : "linear, ", key);
  const auto [found, fresh] =
      made_.try_emplace(name, static_cast<int>(context_.scene().images.size()));
  made.image = found->second;
  if (!fresh) return made;
  Image image;
  image.name = name;
  image.width = source.width, image.height = source.height;
  image.channels = 3;
  image.bytes.reserve(std::size_t(image.width) * image.height * 3);
  for (int y = 0; y < image.height; ++y) {
    for (int x = 0; x < image.width; ++x) {
      const vec2 uv((float(x) + 0.5f) / float(image.width),
                    (float(y) + 0.5f) / float(image.height));
      const Texture exact{.image = 0, .nearest = true};
      const vec4 value = change(sampleTexture(source, exact, uv, input.srgb));
      for (int c = 0; c < 3; ++c) {
        const float v = std::clamp(value[c], 0.0f, 1.0f);
        image.bytes.push_back(
            static_cast<std::uint8_t>((encode ? encodeSrgb(v) : v) * 255.0f + 0.5f));
      }
    }
  }
  addImage(context_.scene(), std::move(image));
  return made;
}

void Textures::setBaseColor(Material& material, const ColorInput& input) {
  material.baseColor = vec4(glm::clamp(input.factor, 0.0f, 1.0f), material.baseColor.a);
  material.baseColorTexture = input.texture;
  if (!input.texture.present()) return;
  const bool deep = isDeep(context_.scene().images[input.texture.image]);
  if (input.srgb || deep) return;
  material.baseColorTexture = changed(input, "as colours", true, [](const vec4& v) { return v; });
}

vec3 Textures::meanOf(const ColorInput& input) const {
  if (!input.texture.present()) return input.factor;
  return input.factor * vec3(textureMean(context_.scene().images[input.texture.image], input.srgb));
}

}  // namespace trex::detail::mitsuba
