// Generated models for tests of scale: synth:NAME?triangles=N&seed=S
//
//   terrain    a square kilometre of hills, open below
//   scan       a bumpy closed surface about 2 m across, like a statue's scan
//   assembly   a hall of thousands of different parts, from bolts of 2 cm to pipes of 20 m: pipes,
//              riveted plates, gears, springs, tanks, lit by emissive panels; several materials
//
// Every triangle is unique (nothing is instanced), neighbours share vertices to the bit, and any
// piece of a model is made without the rest. `triangles` is 1 to 1e10 (default 1e6) and met as
// closely as whole parts allow; `seed` is 0 to 2^64 - 1 (default 1).
#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include "src/scene/triangle_stream.h"

namespace trex {

/// Whether an input's name asks for a generated model.
bool isSynthName(const std::string& name);

/// What a name asks for.
struct SynthRequest {
  enum class Kind : std::uint8_t { kTerrain, kScan, kAssembly };
  Kind kind = Kind::kTerrain;
  std::uint64_t triangles = 1'000'000, seed = 1;
};

/// Reads a name. Throws Error(kUsage) for an unknown model or parameter, or a value out of range.
SynthRequest parseSynthName(const std::string& name);

/// The model as a stream. Throws as parseSynthName().
std::unique_ptr<TriangleStream> openSynth(const std::string& name);

/// The model in memory, for small counts. Throws as parseSynthName(), and Error(kMemoryOrDevice)
/// beyond kMostInMemory triangles.
Scene makeSynth(const std::string& name);
inline constexpr std::uint64_t kMostSynthInMemory = 50'000'000;

}  // namespace trex
