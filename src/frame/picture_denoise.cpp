#include "src/frame/picture_denoise.h"

#include <algorithm>
#include <cctype>
#include <cmath>

#include "src/core/error.h"
#include "src/frame/picture_reader.h"

namespace trex {
namespace {

std::string lower(std::string text) {
  for (char& c : text) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return text;
}

/// "VIEW.Layer" of "VIEW.Layer.R"; empty for "R".
std::string layerOf(const std::string& channel) {
  const std::size_t dot = channel.find_last_of('.');
  return dot == std::string::npos ? "" : channel.substr(0, dot);
}

/// Whether a layer has this name, whatever view it is of.
bool called(const std::string& layer, const std::string& name) {
  const std::string own = lower(layer), wanted = lower(name);
  return own == wanted || own.ends_with('.' + wanted);
}

vec3 finite(vec3 v, float least, float most) {
  for (int c = 0; c < 3; ++c) v[c] = std::isfinite(v[c]) ? std::clamp(v[c], least, most) : 0.0f;
  return v;
}

}  // namespace

PictureLayersFound::Layer PictureLayersFound::find(const Picture& picture,
                                                   std::initializer_list<const char*> names,
                                                   const char* letters) {
  for (const char* name : names) {
    for (const std::string& channel : picture.channels) {
      const std::string layer = layerOf(channel), before = layer.empty() ? "" : layer + '.';
      if (!called(layer, name)) continue;
      Layer found{layer.empty() ? "R, G, B" : layer};
      for (int c = 0; c < 3; ++c) {
        found.channels[c] = channelIndex(picture, before + letters[c]);
      }
      if (std::min({found.channels[0], found.channels[1], found.channels[2]}) >= 0) return found;
    }
  }
  return {};
}

PictureLayersFound::PictureLayersFound(const Picture& picture, const std::string& name)
    : color_(find(picture, {"", "Combined", "beauty"}, "RGB")),
      direct_(find(picture, {"direct"}, "RGB")),
      indirect_(find(picture, {"indirect"}, "RGB")),
      albedo_(find(picture, {"albedo", "Denoising Albedo"}, "RGB")),
      normal_(find(picture, {"normal", "Denoising Normal", "sh_normal", "nn", "Ns", "N"}, "XYZ")) {
  if (color_.name.empty()) {
    fail(ExitCode::kInput, "{}: has no colours: neither R, G, B nor those of Combined or beauty",
         name);
  }
  if (direct_.name.empty() || indirect_.name.empty() ||
      metadataOf(picture, "trex:version").empty()) {
    direct_ = indirect_ = {};  // of others they are something else
    if (isDenoised(picture)) {
      fail(ExitCode::kInput,
           "{}: is denoised already; render it with --denoise off, or with --aov direct,indirect",
           name);
    }
  }
}

std::vector<vec3> PictureLayersFound::values(const Picture& picture, const Layer& layer) {
  std::vector<vec3> out;
  if (layer.name.empty()) return out;
  const std::size_t stride = picture.channels.size();
  out.reserve(picture.values.size() / stride);
  for (std::size_t i = 0; i < picture.values.size(); i += stride) {
    out.emplace_back(picture.values[i + layer.channels[0]], picture.values[i + layer.channels[1]],
                     picture.values[i + layer.channels[2]]);
  }
  return out;
}

/// Without any filter: direct and indirect apart where they are there.
std::vector<std::vector<vec3>> PictureLayersFound::light(const Picture& picture) const {
  if (direct_.name.empty()) return {values(picture, color_)};
  return {values(picture, direct_), values(picture, indirect_)};
}

void PictureLayersFound::put(Picture& picture, const std::vector<vec3>& colors) const {
  const std::size_t stride = picture.channels.size();
  for (std::size_t i = 0; i < colors.size(); ++i) {
    for (int c = 0; c < 3; ++c) picture.values[i * stride + color_.channels[c]] = colors[i][c];
  }
}

void PictureLayersFound::denoise(Picture& picture, const Oidn& library) const {
  OidnGuides guides{picture.width, picture.height, values(picture, albedo_),
                    values(picture, normal_)};
  for (vec3& v : guides.albedo) v = finite(v, 0.0f, 1.0f);
  for (vec3& v : guides.normal) v = finite(v, -1.0f, 1.0f);
  put(picture, denoiseLight(library, std::move(guides), light(picture), true));
}

}  // namespace trex
