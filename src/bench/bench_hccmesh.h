// HCCMesh against Embree's own triangles: bytes a triangle and rays a second.
#pragma once

#include <cstdint>
#include <nlohmann/json.hpp>
#include <string>

namespace trex {

struct HccmeshBenchArguments {
  std::string input;              ///< model file
  std::string camera;             ///< as of `trex render --camera`; empty: the scene's first
  int precisionBits = 24;         ///< 8 to 24
  int runs = 5;                   ///< medians of so many
  std::uint64_t rays = 1u << 20;  ///< of each kind, about
  bool embree = true;  ///< false: HCCMesh alone, for meshes that Embree has no memory for
};

/// The same rays through both, in turns: coherent ones of a camera by tiles of 32 x 32 pixels, one
/// diffuse ray and one shadow ray from each point that they hit. Embree gets all placements of all
/// meshes as plain triangles with its robust flag, once by default and once compact; its bytes
/// count its copy of the mesh.
///
/// The document: {"bench": "hccmesh", "input", "triangles", "bytes_per_triangle",
/// "bytes_per_triangle_by_part": {..}, "disk_bytes_per_triangle", "embree_bytes_per_triangle",
/// "embree_compact_bytes_per_triangle", "rays_per_second": {"coherent", "diffuse", "shadow":
/// {"hccmesh", "embree", "embree_compact"}}, "different_hits": {..}, ..}. Triangles are those that
/// are stored, so that instances count once. Throws Error.
nlohmann::ordered_json benchHccmesh(const HccmeshBenchArguments& arguments);

/// As a table for people.
void printHccmeshBench(const nlohmann::ordered_json& document);

}  // namespace trex
