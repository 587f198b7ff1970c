// Materials of OBJ files (Wavefront MTL), mapped to metallic-roughness.
//
//   Kd        base colour, linear; map_Kd multiplies it (sRGB). With a map and no Kd: white
//   Ke        emission, radiance, from both sides; map_Ke multiplies it
//   Ks        strength of the dielectric reflection: 0 none (Lambertian), 0.5 that of ior 1.5, as
//             common exporters write it; its hue is the specular colour; map_Ks multiplies it
//   Ns        Phong exponent: roughness = (2 / (Ns + 2))^(1/4) [Walter et al., EGSR 2007];
//             absent: 1
//   Pr Pm Ni  roughness (goes before Ns), metallic, index of refraction; map_Pr and map_Pm multiply
//   d         opacity: alpha blending. Tr alone is 1 - opacity, but for `Tr 1`, which exporters of
//             scans write for what is opaque. Of both, d counts; `d 0` with `Tr 0` is opaque
//   map_d     opacity, multiplied by d: the image's alpha if it has any, else its brightness
//   Pc Pcr Ps aniso anisor  clear coat, sheen (roughness 0.5), anisotropy (anisor: share of a turn)
//   norm      a normal map. map_Bump, bump: one too if its colours are those of normals, else
//             heights, whose slopes are taken a texel at a time
//
// Absent: base colour 0.6, no specular reflection. What is not shown (refl, disp, decal and
// others) is said. Statements are read as statements.h tells.
#pragma once

#include <filesystem>
#include <map>
#include <string>

#include "src/scene/import.h"

namespace trex::detail {

/// Appends the materials of a file to the scene and enters them in `names`. Images lie beside it
/// or, as some programs have it, beside the model; each file is loaded once. What can't be read is
/// in Scene::replaced, with file and line. Throws Error(kInput) if the file itself can't be read.
void readMtl(const std::filesystem::path& path, const std::filesystem::path& modelFolder,
             const ImportOptions& options, Scene& scene, std::map<std::string, int>& names);

}  // namespace trex::detail
