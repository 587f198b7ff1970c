// What the generators of src/scene/synth.h share. Not for other folders.
#pragma once

#include "src/scene/synth.h"

namespace trex::detail {

std::unique_ptr<TriangleStream> makeTerrain(const SynthRequest& request, const std::string& name);
std::unique_ptr<TriangleStream> makeScan(const SynthRequest& request, const std::string& name);
std::unique_ptr<TriangleStream> makeAssembly(const SynthRequest& request, const std::string& name);

/// A camera at `eye` that looks at `target`, y up; field of view in degrees.
Camera synthCamera(const char* name, const dvec3& eye, const dvec3& target, float degrees);

/// Lambertian or metal, for generated models.
Material synthMaterial(const char* name, const vec3& color, float metallic, float roughness);

/// splitmix64 [Steele et al. 2014]; random bits from a counter.
inline std::uint64_t mixBits(std::uint64_t x) {
  x += 0x9e3779b97f4a7c15ull;
  x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9ull;
  x = (x ^ (x >> 27)) * 0x94d049bb133111ebull;
  return x ^ (x >> 31);
}
/// In [0, 1).
inline float uniform(std::uint64_t key) {
  return static_cast<float>(mixBits(key) >> 40) * 0x1p-24f;
}

/// Appends the two triangles of a quad: corners counter-clockwise.
inline void addQuad(std::vector<vec3>& out, const vec3& a, const vec3& b, const vec3& c,
                    const vec3& d) {
  out.insert(out.end(), {a, b, c, a, c, d});
}

}  // namespace trex::detail
