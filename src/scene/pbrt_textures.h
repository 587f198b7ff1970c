// Textures of pbrt, as a factor and an image.
//
//   constant, imagemap, scale, mix   as they are; of images that are placed alike, a new one is
//   made checkerboard                     of two constants: an image of 2x2 texels, read without a
//   mix others                           their mean colour, which is said
//
// Images keep their bytes if they are sRGB, as pbrt takes them to be by default, and become floats
// if the file says otherwise ("gamma", "encoding"). pbrt counts t from the bottom; coordinates here
// are (u, 1 - v).
#pragma once

#include <functional>
#include <map>

#include "src/scene/pbrt_colors.h"
#include "src/scene/pbrt_context.h"

namespace trex::detail {

/// A value that may vary over the surface: a factor times an image (bytes of which are sRGB).
struct PbrtTexture {
  vec3 factor{1.0f};
  Texture image;
  bool varies() const { return image.present(); }
};

class PbrtTextures {
 public:
  PbrtTextures(PbrtContext& context, PbrtColors& colors) : context_(context), colors_(colors) {}

  /// The directive Texture.
  void define(const std::string& name, const std::string& valueType, const std::string& kind,
              const PbrtParameters& parameters);

  /// What a parameter of a material says: a texture, a colour or a number.
  PbrtTexture color(const PbrtParameters& parameters, std::string_view name, vec3 otherwise);
  PbrtTexture number(const PbrtParameters& parameters, std::string_view name, float otherwise);

  /// Mean over the image.
  vec3 mean(const PbrtTexture& texture) const;
  /// The same as one number. Not a luminance: pbrt averages the channels of numbers.
  float meanNumber(const PbrtTexture& texture) const;
  /// Bytes f(value) of an image that varies, linear: `channels` of them.
  Image bytesOf(const PbrtTexture& texture, int channels,
                const std::function<vec3(float value)>& f) const;

  /// Index of an image that is made, of a name of its own; made at the first call.
  int imageNamed(const std::string& name, const std::function<Image()>& make);
  const Image& imageOf(const PbrtTexture& texture) const {
    return context_.scene.images[texture.image.image];
  }
  /// A texture whose colours are in [0, 1]: its image holds what its factor has above 1.
  PbrtTexture withinOne(PbrtTexture texture);
  PbrtTexture product(const PbrtTexture& a, const PbrtTexture& b);

  /// Index into Scene::images of a file's picture, or kNone, which is said. `gamma`: 0 if bytes are
  /// sRGB, else the power that decodes them.
  int imageOfFileName(const std::string& name, float gamma, const std::string& instead);

 private:
  using Values = std::vector<vec3>;
  using Combine = std::function<vec3(const Values& values)>;

  PbrtTexture make(const std::string& kind, const PbrtParameters& parameters);
  PbrtTexture imageMap(const PbrtParameters& parameters);
  PbrtTexture checkerboard(const PbrtParameters& parameters);
  PbrtTexture combine(std::vector<PbrtTexture> parts, const Combine& f);
  PbrtTexture valueOf(const PbrtParameters& parameters, std::string_view name, vec3 otherwise);
  void place(const PbrtParameters& parameters, float period, Texture& texture);
  void readWrap(const PbrtParameters& parameters, Texture& texture);
  bool anotherPlace(const Texture& a, const Texture& b) const;
  const PbrtTexture* findTexture(const std::string& name, bool numberWanted) const;

  PbrtContext& context_;
  PbrtColors& colors_;
  std::map<std::string, PbrtTexture> numbers_, colorTextures_;
  std::map<std::string, int> imagesByName_;
  std::string name_;  ///< of the texture that is made
  bool isNumber_ = false;
  std::int64_t texelsMade_ = 0;
};

}  // namespace trex::detail
