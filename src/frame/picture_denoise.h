// Pictures that were made before, denoised by Open Image Denoise with the layers of their files, of
// this program or others. The filter of denoise.h needs what no file holds: what is seen of
// emitters apart, and both surfaces of pixels at rims.
#pragma once

#include <initializer_list>
#include <string>
#include <vector>

#include "src/frame/image_file.h"
#include "src/frame/oidn.h"

namespace trex {

/// The layers that tell what a picture shows, by the names that renderers give them: of this
/// program, Blender's Cycles ("Denoising Albedo", "Denoising Normal"), Mitsuba (aov), pbrt, Arnold.
/// The picture itself is R, G, B, or Combined, or beauty.
class PictureLayersFound {
 public:
  /// Throws Error(kInput), beginning with `name`, if there is no picture among the channels, or if
  /// it is denoised and its direct and indirect layers, which are not, are missing.
  PictureLayersFound(const Picture& picture, const std::string& name);

  /// Empty where there is none.
  const std::string& albedo() const { return albedo_.name; }
  const std::string& normal() const { return normal_.name; }
  /// The picture's, row by row.
  std::vector<vec3> colors(const Picture& picture) const { return values(picture, color_); }

  /// Replaces the colours. Layers that are missing only make it worse. Throws
  /// Error(kMemoryOrDevice).
  void denoise(Picture& picture, const Oidn& library) const;

 private:
  struct Layer {
    std::string name;
    int channels[3] = {-1, -1, -1};
  };
  static Layer find(const Picture& picture, std::initializer_list<const char*> names,
                    const char* letters);
  static std::vector<vec3> values(const Picture& picture, const Layer& layer);
  std::vector<std::vector<vec3>> light(const Picture& picture) const;
  void put(Picture& picture, const std::vector<vec3>& colors) const;

  Layer color_, direct_, indirect_, albedo_, normal_;
};

}  // namespace trex
