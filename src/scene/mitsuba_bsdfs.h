// BSDFs of a Mitsuba scene as materials.
#pragma once

#include <map>

#include "src/scene/mitsuba_textures.h"
#include "src/scene/relief.h"

namespace trex::detail::mitsuba {

/// A material, and what can be told only with the surface that it is on.
struct Look {
  Material material;
  bool invisible = false;   ///< `null`: light passes as if nothing were there
  bool twosided = false;    ///< or one whose back is its own, as of glass
  bool meshColors = false;  ///< the base colour is that of the mesh, times the material's
  enum class Relief : std::uint8_t { kNone, kHeights, kNormals } relief = Relief::kNone;
  ColorInput reliefMap;
  float reliefScale = 1.0f;  ///< metres of a height of 1; of normals none
};

class Bsdfs {
 public:
  Bsdfs(Context& context, Textures& textures) : context_(context), textures_(textures) {}

  /// The look of a bsdf; the same object is read once.
  const Look& look(const Element& bsdf);
  /// Of a surface without any: grey 0.5, black if it shines.
  Look plain(bool shines) const;
  /// The material with its relief as a normal map of the surface.
  Material finished(const Look& look, const UvFacts& facts);

 private:
  Look read(const Element& bsdf);
  Look readNested(const Properties& of);
  Look readByType(const Properties& of, std::string_view type);
  Look readTwoSided(const Properties& of);
  Look readMask(const Properties& of);
  Look readRelief(const Properties& of, Look::Relief relief);
  Look readBlend(const Properties& of);
  Look readCoating(const Properties& of);
  Look unknown(const Properties& of);
  void setOpacity(const Properties& of, Material& m, const NumberInput& opacity);

  void readDiffuse(const Properties& of, Material& m);
  void readDielectric(const Properties& of, Material& m, bool rough, bool thin);
  void readConductor(const Properties& of, Material& m, bool rough);
  void readPlastic(const Properties& of, Material& m, bool rough);
  void readPrincipled(const Properties& of, Material& m, bool thin);
  void readPhong(const Properties& of, Material& m);
  double indexOf(const Properties& of, std::string_view name, const char* otherwise);
  double relativeIndex(const Properties& of, const char* inside);
  void setAlpha(const Properties& of, Material& m);
  void setRoughMetallic(Material& m, const NumberInput& roughness, const NumberInput& metallic,
                        bool alpha);

  Context& context_;
  Textures& textures_;
  std::map<const Element*, Look> looks_;
  int depth_ = 0;
};

}  // namespace trex::detail::mitsuba
