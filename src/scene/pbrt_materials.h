// Materials of pbrt-v3 and v4 as metallic-roughness.
//
//   v3 matte, v4 diffuse: base colour; sigma (Oren and Nayar) is said and not shown
//   v3 plastic, uber: base colour Kd, specular Ks; uber's Kt: transmission, opacity: alpha
//   v3 substrate, v4 coateddiffuse: base colour; of substrate the ior that reflects Ks
//   v3 metal, mirror, v4 conductor: metallic, by eta and k
//   v3 glass, v4 dielectric: transmission with refraction, tinted by Kt
//   v4 thindielectric: transmission that goes straight on
//   disney: colour, metallic, roughness, eta, spectrans
//   interface, "", none: not seen; a medium inside is not shown either
//   mix, translucent, diffusetransmission, coatedconductor, subsurface, hair, measured, fourier:
//   approximated, which is said
//
// Roughness: pbrt's is remapped to GGX's alpha by its own formulas unless "remaproughness" is
// false; a material here has the root of alpha.
#pragma once

#include <map>
#include <memory>
#include <unordered_map>

#include "src/scene/pbrt_textures.h"

namespace trex::detail {

class PbrtMaterials {
 public:
  PbrtMaterials(PbrtContext& context, PbrtColors& colors, PbrtTextures& textures);

  /// Number 0 is the material of shapes that have none. Each call makes another one.
  int make(std::string type, const PbrtParameters& parameters, const std::string& name);
  void setName(const std::string& name, int number) { named_[name] = number; }
  /// Number of a named material; nothing if there is none.
  std::optional<int> find(const std::string& name) const;

  /// True if surfaces of it are not seen.
  bool invisible(int number) const { return made_[number].invisible; }
  const Material& material(int number) const { return made_[number].material; }

  bool hasRelief(int number) const { return made_[number].relief.varies(); }
  /// Of a material with a bump map: as a normal map of the surface that it is on.
  void applyRelief(int number, const Mesh& mesh, const dmat4& place, Material& m);

  /// Multiplies a material's alpha.
  void applyOpacity(const PbrtTexture& opacity, Material& m);

  /// Index into Scene::materials of an equal material, added if there is none.
  int indexOf(const Material& material);

 private:
  struct Made {
    Material material;
    bool invisible = false;
    PbrtTexture relief{};  ///< metres, if it varies
  };

  bool makeV3(const std::string& type, const PbrtParameters& p, Material& m);
  bool makeV4(const std::string& type, const PbrtParameters& p, Material& m);
  bool makeOthers(const std::string& type, const PbrtParameters& p, Material& m);
  void makeUber(const PbrtParameters& p, Material& m);
  void makeGlass(const PbrtParameters& p, Material& m);
  void makeDisney(const PbrtParameters& p, Material& m);
  void makeConductor(const PbrtParameters& p, std::string_view prefix, Material& m);
  void makeThroughDiffuse(const PbrtTexture& reflected, const PbrtTexture& transmitted,
                          Material& m);
  Made mix(const PbrtParameters& p);
  void setBase(const PbrtTexture& texture, Material& m);
  void setSpecular(const PbrtTexture& texture, Material& m);
  void setRoughness(const PbrtParameters& p, std::string_view prefix, float otherwise, bool v4,
                    Material& m);
  void setRelief(const PbrtParameters& p, Made& made);

  PbrtContext& context_;
  PbrtColors& colors_;
  PbrtTextures& textures_;
  std::vector<Made> made_;
  std::map<std::string, int> named_;
  std::unordered_multimap<std::size_t, int> indices_;
};

/// GGX's alpha of a roughness as pbrt-v3 and pbrt-v4 remap it.
float pbrtAlpha(float roughness, bool version4);

}  // namespace trex::detail
