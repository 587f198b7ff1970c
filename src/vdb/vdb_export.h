// The one call into libtrex_vdb.so, which alone links OpenVDB: the program opens that library when
// a command needs it, so that nothing else pays for loading OpenVDB and what it brings.
#pragma once

#include <cstdint>

extern "C" {

/// A voxel as it goes into the grids; all but the place may be 0.
struct TrexVdbVoxel {
  std::int32_t place[3];  ///< index of the voxel
  float coverage;         ///< [0, 1]
  float albedo[3], normal[3], radiance[3];
};

/// Writes the grids coverage (float), albedo, normal and radiance (vectors) into a file. Voxel
/// (0, 0, 0) has its lower corner at `lower`; `edge` and `lower` in metres. Returns null, or what
/// went wrong; the text lives until the next call of the thread.
const char* trexWriteVdb(const char* path, const TrexVdbVoxel* voxels, std::uint64_t count,
                         double edge, const double lower[3]);

}  // extern "C"

/// Its type and its name in the library.
using TrexWriteVdb = decltype(trexWriteVdb);
inline constexpr const char* kTrexWriteVdb = "trexWriteVdb";
