// Records exchanged between host and device, included by C++ and GLSL. std430 sizes are asserted.
#ifndef TREX_SHADERIO_H
#define TREX_SHADERIO_H

#ifdef __cplusplus
#include <cstdint>
#include <glm/glm.hpp>
namespace trex::shaderio {
using uint = std::uint32_t;
using glm::uvec4;
using glm::vec3;
using glm::vec4;
#define SHADERIO_CONST inline constexpr
#else
#define SHADERIO_CONST const
#endif

SHADERIO_CONST uint kWorkgroupSize = 64u;
/// Of gathering: larger, as its invocations end at about the same time.
SHADERIO_CONST uint kGatherGroupSize = 256u;

/// Entry of the page table for a page that is not on the device.
SHADERIO_CONST uint kNoSlot = 0xffffffffu;
/// Photon numbers are below that. Added to the number of a record: kLastLanding, the record is all
/// that the device adds of the photon, no bounces; kLaterLanding, the photon has bounced before.
SHADERIO_CONST uint kPhotonNumbers = 0x40000000u;
SHADERIO_CONST uint kLaterLanding = 0x40000000u;
SHADERIO_CONST uint kLastLanding = 0x80000000u;
/// Ends of rays of a photon, at most.
SHADERIO_CONST uint kMostPhotonBounces = 256u;

/// Bits of GatherQuery::flags.
SHADERIO_CONST uint kQueryShadow = 1u;  // transmittance alone; radiance is 0

/// One G-ray: a cone through the ASVO. 48 bytes.
struct GatherQuery {
  vec3 origin;
  float tanHalf;
  vec3 direction;
  float tmin;
  float tmax;
  float jitter;  // [0, 1)
  uint flags;
  uint index;  // of its result; set by the tracer
};

/// Its answer. 16 bytes.
struct GatherResult {
  vec3 radiance;
  float transmittance;  // negative: the cone met what voxels do not know; a ray has to answer
};

/// A photon where it met a surface at the end of a C-ray: its first diffuse one, or one that it
/// counts at and no more. 32 bytes.
struct PhotonRecord {
  vec3 position;  // render space, on the surface
  uint normal;    // octahedral 2 x unorm16, geometric, on the side the light arrives at
  vec3 power;     // W, arriving
  uint index;     // photon number, the key of its random numbers; kLastLanding may be added
};

/// What a photon needs of a material when it meets a voxel. 16 bytes.
struct PhotonMaterial {
  float metallic;
  float roughness;
  uint baseColor;  // 4 x unorm8 linear: reflectance of the metal part
  uint flags;
};

#ifdef __cplusplus
static_assert(sizeof(GatherQuery) == 48);
static_assert(sizeof(GatherResult) == 16);
static_assert(sizeof(PhotonRecord) == 32);
static_assert(sizeof(PhotonMaterial) == 16);
}  // namespace trex::shaderio
#endif
#endif
