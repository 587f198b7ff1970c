// Plain surfaces eight at a time: decoded triangles to points and normals, their materials to
// scattering. What makeSurface() and Bsdf do for any surface, with the same bits, for the
// commonest: opaque, not emitting, Lambertian or metallic-roughness that is not sharp, no normal
// map.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "src/core/maths.h"
#include "src/crays/microfacet.h"
#include "src/scene/scene.h"

namespace trex {

/// A material as plain surfaces have it, textures left out. Resolved once a scene.
struct PlainMaterial {
  bool plain = false;
  bool colorTexture = false, roughnessTexture = false;
  vec3 color{0.0f}, f0{0.0f};  ///< color: clamped
  float f90 = 0.0f, metallic = 0.0f, alpha = 1.0f;

  bool textured() const { return colorTexture || roughnessTexture; }
  /// With textures and the colour of vertices; `number`: of the material.
  PlainMaterial at(const Scene& scene, std::uint32_t number, const TexCoords& uv,
                   const vec4& vertexColor) const;
};

/// By material. A lobe of one with a roughness texture may turn out to be too sharp: of alpha up to
/// kClearAlpha.
std::vector<PlainMaterial> plainMaterials(const std::vector<Material>& materials);

/// Eight of them, a lane each. Lanes in no use may hold anything.
struct alignas(64) PlainLanes {
  static constexpr std::size_t kLanes = 8;
  using Floats = float[kLanes];
  using Doubles = double[kLanes];

  // What is known of a hit.
  Doubles u, v;
  Floats corner[3][3], cornerNormal[3][3];  ///< by corner and axis, render space
  Floats direction[3];                      ///< unit, of the ray
  Floats color[3], f0[3], f90, metallic, alpha;
  std::uint32_t smooth;  ///< bits: lanes whose corners have normals

  // The surface, as in a Surface.
  Doubles position[3];
  Floats geometricNormal[3], lift[2][3], bend;

  // Its scattering, as in a Bsdf.
  Floats facing[3], smoothNormal[3];  ///< geometric and smooth normal on the ray's side
  Floats tangent[3], bitangent[3], normal[3], out[3];
  Floats diffuse[3], masked, diffuseLobe, specularLobe;
  std::uint32_t front, lambertian;  ///< bits
  std::uint32_t odd;                ///< bits: degenerate, nothing else of these lanes holds

  static bool is(std::uint32_t bits, std::size_t lane) { return (bits >> lane & 1u) != 0; }
  template <typename T>
  static glm::vec<3, T> vector(const T (&of)[3][kLanes], std::size_t lane) {
    return {of[0][lane], of[1][lane], of[2][lane]};
  }
  /// As Bsdf::leavesFront().
  bool leavesFront(const vec3& to, std::size_t lane) const {
    return is(front, lane) == (glm::dot(to, vector(normal, lane)) > 0.0f);
  }
  /// As Bsdf::photonFactor().
  float photonFactor(const vec3& to, std::size_t lane) const {
    return trex::photonFactor(vector(facing, lane), vector(tangent, lane), vector(bitangent, lane),
                              vector(normal, lane), vector(out, lane), to);
  }
};

/// As Bsdf::value() of directions.
struct alignas(64) PlainValues {
  PlainLanes::Floats direction[3];  ///< asked for
  PlainLanes::Floats f[3], pdf;
};

/// As Bsdf::sample() by these numbers.
struct alignas(64) PlainSamples {
  PlainLanes::Floats choice, u, v;
  PlainLanes::Floats direction[3], weight[3], pdf, roughness;
  std::uint32_t found;  ///< bits: lanes whose path goes on
};

/// For the best instruction set of this processor; every one gives the same bits. Thread safe.
struct PlainKernels {
  void (*shade)(PlainLanes& lanes);
  void (*value)(const PlainLanes& lanes, PlainValues& values);
  void (*sample)(const PlainLanes& lanes, PlainSamples& samples);
};
/// Obeys hwy::SetSupportedTargetsForTest. Thread safe.
const PlainKernels* choosePlainKernels();

}  // namespace trex
