#include "src/scene/pbrt_textures.h"

#include <algorithm>
#include <cmath>

#include "src/scene/image_io.h"
#include "src/scene/texels.h"
#include "src/scene/texture.h"
#include "src/scene/texture_cache.h"
#include "src/scene/texture_file.h"

namespace trex::detail {
namespace {

/// Texels of images that are made of others, of one scene.
constexpr std::int64_t kMaxMadeTexels = kMaxTexels;

std::uint8_t byteOf(float value) {
  return static_cast<std::uint8_t>(clampedUnit(value) * 255.0f + 0.5f);
}

/// Bytes or words decoded by a power, as floats.
Image decoded(const Image& image, float gamma) {
  Image made = inMemory(image);
  const auto decode = [&](const auto& values, float largest) {
    made.floats.reserve(values.size());
    for (const auto value : values) {
      made.floats.push_back(std::pow(static_cast<float>(value) / largest, gamma));
    }
  };
  decode(made.bytes, 255.0f);
  decode(made.words, 65535.0f);
  made.bytes.clear();
  made.words.clear();
  return made;
}

vec3 colorAt(const Image& image, int x, int y, int width, int height) {
  const vec2 uv((static_cast<float>(x) + 0.5f) / static_cast<float>(width),
                (static_cast<float>(y) + 0.5f) / static_cast<float>(height));
  return vec3(sampleTexture(image, {}, uv, true));
}

/// Values in [0, 1] as bytes of sRGB, others as they are.
Image imageOfValues(int width, int height, const std::vector<vec3>& values) {
  Image image;
  image.width = width;
  image.height = height;
  image.channels = 3;
  const bool within = std::all_of(values.begin(), values.end(), [](const vec3& v) {
    return glm::all(glm::lessThanEqual(v, vec3(1.0f))) &&
           glm::all(glm::greaterThanEqual(v, vec3(0.0f)));
  });
  for (const vec3& v : values) {
    const vec3 light = clampedLight(v);
    for (int c = 0; c < 3; ++c) {
      if (within) {
        image.bytes.push_back(byteOf(encodeSrgb(light[c])));
      } else {
        image.floats.push_back(light[c]);
      }
    }
  }
  return image;
}

/// The power that decodes bytes by the parameters of an imagemap; 0: they are sRGB.
float gammaOf(const PbrtParameters& parameters) {
  const PbrtParameter* gamma = parameters.find("gamma");
  if (gamma != nullptr && !gamma->strings.empty()) {
    return gamma->strings[0] == "true" ? 0.0f : 1.0f;
  }
  if (gamma != nullptr && !gamma->numbers.empty()) {
    return std::clamp(static_cast<float>(gamma->numbers[0]), 0.1f, 10.0f);
  }
  const std::string encoding = parameters.text("encoding", "sRGB");
  if (encoding == "linear") return 1.0f;
  double power = 0.0;
  if (encoding.starts_with("gamma ") && parseDouble(trimmed(encoding.substr(6)), power) &&
      power >= 0.1 && power <= 10.0) {
    return static_cast<float>(power);
  }
  return 0.0f;
}

}  // namespace

int PbrtTextures::imageNamed(const std::string& name, const std::function<Image()>& make) {
  const auto known = imagesByName_.find(name);
  if (known != imagesByName_.end()) return known->second;
  Image image = make();
  image.name = name;
  return imagesByName_[name] = addImage(context_.scene, std::move(image));
}

int PbrtTextures::imageOfFileName(const std::string& name, float gamma,
                                  const std::string& instead) {
  const std::string key = fmt::format("{}{}", name, gamma > 0.0f ? fmt::format(" ^{}", gamma) : "");
  const auto known = imagesByName_.find(key);
  if (known != imagesByName_.end()) return known->second;
  int image = imageOfFile(context_.scene, context_.folder, name, gamma == 0.0f,
                          context_.where() + ": texture", instead);
  // Words that are linear are so already; floats are.
  const TexelKind kind =
      image == kNone ? TexelKind::kFloat : texelKind(context_.scene.images[image]);
  const bool words = kind == TexelKind::kWord && gamma != 1.0f;
  if (gamma > 0.0f && (kind == TexelKind::kByte || words)) {
    image = imageNamed(key, [&] { return decoded(context_.scene.images[image], gamma); });
  }
  imagesByName_[key] = image;
  return image;
}

vec3 PbrtTextures::mean(const PbrtTexture& texture) const {
  return texture.varies() ? texture.factor * vec3(textureMean(imageOf(texture), true))
                          : texture.factor;
}

float PbrtTextures::meanNumber(const PbrtTexture& texture) const {
  const vec3 value = mean(texture);
  return (value.x + value.y + value.z) / 3.0f;
}

Image PbrtTextures::bytesOf(const PbrtTexture& texture, int channels,
                            const std::function<vec3(float value)>& f) const {
  const Image& source = imageOf(texture);
  Image image;
  image.width = source.width;
  image.height = source.height;
  image.channels = channels;
  for (int y = 0; y < source.height; ++y) {
    for (int x = 0; x < source.width; ++x) {
      const vec3 value = texture.factor * colorAt(source, x, y, source.width, source.height);
      const vec3 made = f((value.x + value.y + value.z) / 3.0f);
      for (int c = 0; c < channels; ++c) image.bytes.push_back(byteOf(made[c]));
    }
  }
  return image;
}

PbrtTexture PbrtTextures::withinOne(PbrtTexture texture) {
  if (texture.varies() && maxComponent(texture.factor) > 1.0f) {
    name_ = fmt::format("{} times {} {} {}", imageOf(texture).name, texture.factor.x,
                        texture.factor.y, texture.factor.z);
    const auto known = imagesByName_.find(name_);
    if (known != imagesByName_.end()) {
      texture.image.image = known->second;
      texture.factor = vec3(1.0f);
    } else {
      const std::string name = name_;
      texture = combine({texture}, [](const Values& v) { return glm::min(v[0], vec3(1.0f)); });
      if (texture.varies()) imagesByName_[name] = texture.image.image;
    }
  }
  for (int c = 0; c < 3; ++c) texture.factor[c] = clampedUnit(texture.factor[c]);
  return texture;
}

PbrtTexture PbrtTextures::product(const PbrtTexture& a, const PbrtTexture& b) {
  if (!a.varies() || !b.varies()) return {a.factor * b.factor, a.varies() ? a.image : b.image};
  return combine({a, b}, [](const Values& v) { return v[0] * v[1]; });
}

const PbrtTexture* PbrtTextures::findTexture(const std::string& name, bool numberWanted) const {
  for (const auto* table :
       {numberWanted ? &numbers_ : &colorTextures_, numberWanted ? &colorTextures_ : &numbers_}) {
    const auto found = table->find(name);
    if (found != table->end()) return &found->second;
  }
  return nullptr;
}

PbrtTexture PbrtTextures::valueOf(const PbrtParameters& parameters, std::string_view name,
                                  vec3 otherwise) {
  return isNumber_ ? number(parameters, name, otherwise.x) : color(parameters, name, otherwise);
}

PbrtTexture PbrtTextures::color(const PbrtParameters& parameters, std::string_view name,
                                vec3 otherwise) {
  if (const std::string texture = parameters.texture(name); !texture.empty()) {
    if (const PbrtTexture* found = findTexture(texture, false)) return *found;
    context_.replace("there is no texture '{:.80}'; the default is shown", texture);
  }
  return {colors_.reflectance(parameters, name).value_or(otherwise), {}};
}

PbrtTexture PbrtTextures::number(const PbrtParameters& parameters, std::string_view name,
                                 float otherwise) {
  const std::string texture = parameters.texture(name);
  if (texture.empty()) {
    return {vec3(static_cast<float>(parameters.number(name, double{otherwise}))), {}};
  }
  if (const PbrtTexture* found = findTexture(texture, true)) return *found;
  context_.replace("there is no texture '{:.80}'; the default is shown", texture);
  return {vec3(otherwise), {}};
}

void PbrtTextures::define(const std::string& name, const std::string& valueType,
                          const std::string& kind, const PbrtParameters& parameters) {
  name_ = name;
  isNumber_ = valueType == "float";
  if (!isNumber_ && valueType != "spectrum" && valueType != "color") {
    context_.replace("textures of '{:.40}' are not known; it is left out", valueType);
    parameters.ignoreAll();
    return;
  }
  PbrtTexture made = make(kind, parameters);
  (isNumber_ ? numbers_ : colorTextures_)[name] = made;
}

PbrtTexture PbrtTextures::make(const std::string& kind, const PbrtParameters& parameters) {
  if (kind == "constant") return valueOf(parameters, "value", vec3(1.0f));
  if (kind == "imagemap") return imageMap(parameters);
  if (kind == "checkerboard") return checkerboard(parameters);
  if (kind == "scale") {
    // pbrt-v3 multiplies tex1 and tex2, pbrt-v4 tex and scale.
    const bool version4 = parameters.find("tex") != nullptr;
    return product(
        valueOf(parameters, version4 ? "tex" : "tex1", vec3(1.0f)),
        version4 ? number(parameters, "scale", 1.0f) : valueOf(parameters, "tex2", vec3(1.0f)));
  }
  if (kind == "mix" || kind == "directionmix") {
    if (kind == "directionmix") context_.replace("its amount is taken for 0.5 from all directions");
    return combine({valueOf(parameters, "tex1", vec3(0.0f)),
                    valueOf(parameters, "tex2", vec3(1.0f)), number(parameters, "amount", 0.5f)},
                   [](const Values& v) { return glm::mix(v[0], v[1], v[2].x); });
  }
  vec3 average(0.5f);
  if (kind == "dots") {
    average = 0.5f * (mean(valueOf(parameters, "inside", vec3(1.0f))) +
                      mean(valueOf(parameters, "outside", vec3(0.0f))));
  } else if (kind == "bilerp") {
    average = vec3(0.0f);
    for (const char* corner : {"v00", "v01", "v10", "v11"}) {
      average += 0.25f * mean(valueOf(parameters, corner, vec3(corner[2] == '0' ? 0.0f : 1.0f)));
    }
  }
  parameters.ignoreAll();
  context_.replace("is not shown as a texture; {:.3g} {:.3g} {:.3g} is", average.x, average.y,
                   average.z);
  return {average, {}};
}

PbrtTexture PbrtTextures::imageMap(const PbrtParameters& parameters) {
  parameters.ignore({"maxanisotropy", "trilinear"});
  PbrtTexture made;
  made.factor = vec3(static_cast<float>(parameters.number("scale", 1.0)));
  const float gamma = gammaOf(parameters);
  const bool invert = parameters.flag("invert", false);
  readWrap(parameters, made.image);
  place(parameters, 1.0f, made.image);
  if (context_.options.loadTextures) {
    made.image.image =
        imageOfFileName(parameters.text("filename"), gamma, "grey 0.5 is shown instead of it");
  }
  if (!made.varies()) made.factor *= 0.5f;
  if (!invert) return made;
  return combine({made}, [](const Values& v) { return glm::max(vec3(1.0f) - v[0], vec3(0.0f)); });
}

void PbrtTextures::readWrap(const PbrtParameters& parameters, Texture& texture) {
  const std::string wrap = parameters.text("wrap", "repeat");
  if (wrap != "repeat") texture.wrapS = texture.wrapT = Texture::Wrap::kClamp;
  if (wrap != "repeat" && wrap != "clamp") {
    context_.replace("the wrap mode '{:.40}' is not shown; clamp is", wrap);
  }
  texture.nearest = parameters.text("filter") == "point";
}

/// Places an image that covers `period` units of s and t.
void PbrtTextures::place(const PbrtParameters& parameters, float period, Texture& texture) {
  const auto value = [&](const char* name, double otherwise) {
    return static_cast<float>(parameters.number(name, otherwise)) / period;
  };
  if (const std::string mapping = parameters.text("mapping", "uv"); mapping != "uv") {
    context_.replace("the mapping '{:.40}' is not shown; uv is", mapping);
    parameters.ignore({"v1", "v2"});
  }
  texture.scale = {value("uscale", 1.0), value("vscale", 1.0)};
  texture.offset = {value("udelta", 0.0), 1.0f - texture.scale.y - value("vdelta", 0.0)};
}

PbrtTexture PbrtTextures::checkerboard(const PbrtParameters& parameters) {
  parameters.ignore({"aamode"});
  const vec3 first = mean(valueOf(parameters, "tex1", vec3(1.0f)));
  const vec3 second = mean(valueOf(parameters, "tex2", vec3(0.0f)));
  if (parameters.number("dimension", 2.0) != 2.0) {
    context_.replace("a checkerboard of space is not shown; its mean is");
    return {0.5f * (first + second), {}};
  }
  for (const char* part : {"tex1", "tex2"}) {
    if (valueOf(parameters, part, vec3(1.0f)).varies()) {
      context_.replace("of the texture in '{}' the mean is shown", part);
    }
  }
  PbrtTexture made;
  made.image.nearest = true;
  place(parameters, 2.0f, made.image);
  const float largest = std::max({maxComponent(first), maxComponent(second), 1.0f});
  made.factor = vec3(largest);
  // Rows from the top: the first one has t from 1 to 2.
  made.image.image = imageNamed(fmt::format("{} (line {})", name_, context_.line), [&] {
    return imageOfValues(2, 2,
                         {second / largest, first / largest, first / largest, second / largest});
  });
  return made;
}

bool PbrtTextures::anotherPlace(const Texture& a, const Texture& b) const {
  Texture moved = b;
  moved.image = a.image;
  return !(moved == a);
}

/// A function of several textures: an image where those that vary lie alike.
PbrtTexture PbrtTextures::combine(std::vector<PbrtTexture> parts, const Combine& f) {
  const PbrtTexture* largest = nullptr;
  const auto texels = [&](const PbrtTexture& t) {
    return std::int64_t{imageOf(t).width} * imageOf(t).height;
  };
  for (PbrtTexture& part : parts) {
    if (!part.varies()) continue;
    if (largest != nullptr && anotherPlace(part.image, largest->image)) {
      context_.replace("{} is placed differently from {}; its mean is shown", imageOf(part).name,
                       imageOf(*largest).name);
      part = {mean(part), {}};
    } else if (largest == nullptr || texels(part) > texels(*largest)) {
      largest = &part;
    }
  }
  if (largest != nullptr && texelsMade_ + texels(*largest) > kMaxMadeTexels) {
    context_.replace("there are too many images to make of others; its mean is shown");
    for (PbrtTexture& part : parts) part = {mean(part), {}};
    largest = nullptr;
  }
  Values values(parts.size());
  const int width = largest ? imageOf(*largest).width : 1;
  const int height = largest ? imageOf(*largest).height : 1;
  std::vector<vec3> made;
  made.reserve(std::size_t(width) * height);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      for (std::size_t i = 0; i < parts.size(); ++i) {
        values[i] = parts[i].factor;
        if (parts[i].varies()) values[i] *= colorAt(imageOf(parts[i]), x, y, width, height);
      }
      made.push_back(f(values));
    }
  }
  if (largest == nullptr) return {made[0], {}};
  texelsMade_ += texels(*largest);
  PbrtTexture result{vec3(1.0f), largest->image};
  result.image.image =
      imageNamed(fmt::format("{} (line {}, {})", name_, context_.line, imagesByName_.size()),
                 [&] { return imageOfValues(width, height, made); });
  return result;
}

}  // namespace trex::detail
