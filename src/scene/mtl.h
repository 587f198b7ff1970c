// Materials of OBJ files (Wavefront MTL), mapped to metallic-roughness.
//
//   Kd        base colour, linear; map_Kd multiplies it (sRGB). With a map and no Kd: white
//   Ke        emission, radiance, from both sides; map_Ke multiplies it
//   Ks        strength of the dielectric reflection: 0 none (Lambertian), 0.5 that of ior 1.5, as
//             common exporters write it; its hue is the specular colour
//   Ns        Phong exponent: roughness = (2 / (Ns + 2))^(1/4) [Walter et al., EGSR 2007]; absent:
//   1 Pr Pm Ni  roughness (goes before Ns), metallic, index of refraction d, Tr     opacity, or 1 -
//   opacity: alpha blending
//
// Absent: base colour 0.6, no specular reflection.
#pragma once

#include <filesystem>
#include <map>
#include <string>

#include "src/scene/import.h"

namespace trex::detail {

/// Appends the materials of a file to the scene and enters them in `names`. Images are loaded once
/// for each file name. Throws Error(kInput) that names file and line.
void readMtl(const std::filesystem::path& path, const ImportOptions& options, Scene& scene,
             std::map<std::string, int>& names);

}  // namespace trex::detail
