// Textures of a Mitsuba scene: images, and what is made into one.
#pragma once

#include <functional>
#include <map>
#include <string>
#include <utility>

#include "src/scene/mitsuba_context.h"

namespace trex::detail::mitsuba {

/// A colour times a texture, if there is one.
struct ColorInput {
  vec3 factor{1.0f};
  Texture texture;
  bool srgb = true;  ///< 8-bit texels are encoded
};

/// The same of a number, which is the texture's brightness.
struct NumberInput {
  float factor = 1.0f;
  Texture texture;
  bool srgb = true;
};

class Textures {
 public:
  explicit Textures(Context& context) : context_(context) {}

  ColorInput color(const Properties& of, std::string_view name, const vec3& otherwise);
  NumberInput number(const Properties& of, std::string_view name, float otherwise);
  /// A texture or value by its element.
  ColorInput read(const Element& element);

  /// The texture with an image whose texels are `change`d, values as they are stored: linear
  /// colours in, encoded 8-bit colours out if `encode`, else plain values. Made once for each
  /// `key`.
  Texture changed(const ColorInput& input, const std::string& key, bool encode,
                  const std::function<vec4(const vec4& linear)>& change);

  /// As a base colour wants it: factors of [0, 1], texels of sRGB.
  void setBaseColor(Material& material, const ColorInput& input);

  vec3 meanOf(const ColorInput& input) const;

  /// Whether a colour that was read since the last call is that of a mesh's vertices or faces, for
  /// which white stands.
  bool takeMeshColors() { return std::exchange(meshColors_, false); }

 private:
  bool readMeshColors(const Element& element, std::string_view parameter, ColorInput& made);
  ColorInput readBitmap(const Element& element);
  ColorInput readCheckerboard(const Element& element);
  ColorInput readScale(const Element& element);
  void place(const Properties& of, Texture& texture);
  void wrap(const Properties& of, Texture& texture);

  Context& context_;
  std::map<std::string, int> made_;
  int depth_ = 0;
  bool meshColors_ = false;
};

}  // namespace trex::detail::mitsuba
