// Volumes: .vdb files as media of a scene.
//
// Of a file's grids, `density` (or else its one fog volume) is the density. What shines, per metre:
//   emission     a grid of vectors (radiance), or of floats (white)
//   flames       a grid of floats, in the colour of `temperature` if that is there, else white
//   temperature  alone: the density, in the colour and brightness of a black body
//   none of them the density, if `emission` is asked for
// The black body is Planck's law through the observer of CIE 1931 [fit of Wyman, Sloan and Shirley,
// JCGT 2013], with luminance 1 at 1500 K; colours outside of Rec. 709 are clipped.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>

#include "src/core/maths.h"

namespace trex {

struct Scene;

/// What --volume and extras ask for.
struct VolumeRequest {
  std::string file;
  float density = 1.0f;          ///< Medium::density, [0, 1e12]
  vec3 albedo{0.9f};             ///< [0, 1]
  float anisotropy = 0.0f;       ///< g, [-0.99, 0.99]
  std::optional<vec3> emission;  ///< Medium::emission, [0, 1e12]; none: 1 if a grid shines, else 0
  float kelvin = 1.0f;           ///< of a unit of the temperature grid
  dmat4 transform{1.0};          ///< of the file's own space to the world
};

/// Sets density, albedo, g, emission or kelvin (numbers, one or three for a colour), or scale and
/// move (metres). Returns what is wrong, or nothing.
std::string setVolumeOption(VolumeRequest& request, const std::string& key,
                            std::span<const double> numbers);

/// Of --volume, for --help.
inline constexpr const char* kVolumeHelp =
    "Fog, smoke or fire: FILE.vdb, or FILE.vdb?density=1&albedo=R,G,B&g=0&emission=1&kelvin=1&"
    "scale=1&move=X,Y,Z; may be repeated";

/// Parses FILE.vdb?key=value&key=value, such as smoke.vdb?density=2&albedo=0.9,0.8,0.7&g=0.3.
/// Throws Error(kUsage).
VolumeRequest parseVolume(const std::string& text);

/// Reads a volume into Scene::media and notes its file. `maxMemory`: bytes this process may use; 0:
/// what the machine has. Throws Error(kInput), Error(kMemoryOrDevice). A volume without voxels is a
/// warning and adds nothing.
void addVolume(Scene& scene, const VolumeRequest& request, std::uint64_t maxMemory);
void addVolumes(Scene& scene, std::span<const VolumeRequest> requests, std::uint64_t maxMemory);

/// Linear Rec. 709 of a black body, luminance 1 at 1500 K; 0 below 300 K. kelvin: up to 20000, more
/// counts as that.
vec3 blackBody(float kelvin);

}  // namespace trex
