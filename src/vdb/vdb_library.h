// Opens libtrex_vdb.so, which lies beside the program, and reads fog through it.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <span>
#include <vector>

#include "src/core/maths.h"
#include "src/core/module.h"
#include "src/vdb/vdb.h"

namespace trex {

/// A function of the library. Throws Error(kMemoryOrDevice) if it can't be loaded.
template <typename Function>
Function* vdbFunction(const char* name) {
  return moduleFunction<Function>("libtrex_vdb.so", name, "OpenVDB");
}

/// Fog as trexReadVdb() gives it. Spans point into `memory`.
struct VdbFog {
  std::shared_ptr<const std::span<const std::byte>> memory;
  dmat4 toWorld{1.0};  ///< from voxels, whose centres are whole numbers; affine and finite
  std::span<const TrexVdbBrick> bricks;
  /// 512 values a brick with an array; empty if the file has no such grid, but for the density.
  std::span<const float> density, temperature, flames;
  std::span<const vec3> emission;
};

/// Reads a .vdb file in a process of its own, so that a hostile one can't harm this one.
/// `maxBytes`: of all values. Throws Error(kInput) that names the file and what is wrong in it,
/// Error(kMemoryOrDevice) if it is too large or OpenVDB can't be used. Not to be called by several
/// threads at a time.
VdbFog readFog(const std::filesystem::path& path, std::uint64_t maxBytes);

}  // namespace trex
