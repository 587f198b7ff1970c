// The calls into libtrex_vdb.so, which alone links OpenVDB: the program opens that library when a
// command needs it (vdb_library.h), so that nothing else pays for loading OpenVDB and what it
// brings.
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

/// What trexReadVdb() writes first, 152 bytes.
struct TrexVdbHead {
  std::uint64_t bricks, arrays;
  double toWorld[16];      ///< from voxels (their centres are whole numbers), column after column
  std::uint32_t channels;  ///< bits TrexVdbChannel; density is always there
  std::uint32_t reserved;
};

enum TrexVdbChannel : std::uint32_t {
  kTrexVdbTemperature = 1,  ///< a float a voxel
  kTrexVdbFlames = 2,       ///< a float a voxel
  kTrexVdbEmission = 4,     ///< three floats a voxel
};

/// 8x8x8 voxels, 20 bytes.
struct TrexVdbBrick {
  std::int32_t origin[3];  ///< the first voxel, a multiple of 8 in each axis
  std::uint32_t array;     ///< its number among the arrays; all ones: `density` is in all voxels
  float density;
};

/// Reads the fog of a file and writes it to a file descriptor: a head, then the bricks, then for
/// each channel (density first, then in the order of the bits) the arrays, of 512 voxels each, x *
/// 64 + y * 8 + z. Values are as the file has them, NaN included; inactive voxels are 0. Returns a
/// TrexVdbResult; for all but the first, one line of text is written instead. A hostile file may
/// crash OpenVDB: readFog() calls this in a process of its own.
int trexReadVdb(const char* path, std::uint64_t maxBytes, int output);

enum TrexVdbResult : int {
  kTrexVdbRead = 0,
  kTrexVdbBad = 1,       ///< no file of OpenVDB, or none with fog
  kTrexVdbTooLarge = 2,  ///< needs more than maxBytes
};

}  // extern "C"

/// Types, and names in the library.
using TrexWriteVdb = decltype(trexWriteVdb);
inline constexpr const char* kTrexWriteVdb = "trexWriteVdb";
using TrexReadVdb = decltype(trexReadVdb);
inline constexpr const char* kTrexReadVdb = "trexReadVdb";
