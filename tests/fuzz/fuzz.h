// What the fuzz targets share. A target calls library code with hostile bytes; errors that users
// meet are expected, anything else (crash, sanitizer, other exception, broken promise) is a
// finding.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <span>
#include <string>
#include <string_view>

#include "src/scene/scene.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size);
extern "C" std::size_t LLVMFuzzerMutate(std::uint8_t* data, std::size_t size, std::size_t maxSize);
extern "C" std::size_t LLVMFuzzerCustomMutator(std::uint8_t* data, std::size_t size,
                                               std::size_t maxSize, unsigned seed);

namespace trex::fuzz {

using Bytes = std::span<const std::uint8_t>;

/// Ends the process if a promise of the library does not hold: libFuzzer keeps the input.
inline void require(bool holds, int line = __builtin_LINE(), const char* file = __builtin_FILE()) {
  if (holds) return;
  std::fprintf(stderr, "ERROR: %s:%d: a promise does not hold\n", file, line);
  std::abort();
}

/// Writes a file into a folder of this process in TMPDIR, which scripts/fuzz puts in memory.
std::filesystem::path writeInput(const std::string& name, Bytes bytes);

/// Imports a model without its pictures and checks what Scene promises; Error is expected. With an
/// `animation` of glTF too.
void importAndCheck(const std::filesystem::path& path, const std::string& animation = {});

/// Streams a model and checks what TriangleStream promises; Error is expected. With a size, points
/// of PLY clouds are shown.
void streamAndCheck(const std::filesystem::path& path, double pointSize = 0.0);

bool contains(Bytes bytes, std::string_view text);

/// Splits an input in two at the first line `separator`; the second part is empty without one.
std::pair<Bytes, Bytes> split(Bytes bytes, std::string_view separator);

}  // namespace trex::fuzz
