// Samples as bytes, on their way to the machine that adds them up: what its frame keeps, and no
// more.
//
//   how        u8: 0 what follows as it is, 1 a zstd frame of that, arranged
//   pairs      a bit a sample, if the frame has pairs: whether it is traced exactly as well
//   samples    floats of each: guess 3 | exact 3 if paired | light 3 and feature 11 | alpha 1 |
//              first 3 | direct 3 | direct of exact 3 if paired | rays u32 | C-rays and G-rays u32
//              | photons' noise 3
//
// Arranged: behind the pairs first the samples that are not paired, then the others; of either set
// the first byte of each sample, then the second of each, and so on, as the difference (exclusive
// or) from that of the sample before. Neighbours show the same surface, so most of them are 0.
#pragma once

#include <span>

#include "src/machines/messages.h"
#include "src/session/frame_buffers.h"
#include "src/session/taken_samples.h"

namespace trex::machines {

/// What is known of each sample besides its guess.
enum SampleContents : std::uint32_t {
  kPairs = 1,
  kFeatures = 2,
  kCoverage = 4,
  kFirstHits = 8,
  kDirect = 16,
  kRays = 32,
  kRayClasses = 64,
  kPhotonNoise = 128,
};

/// What a frame keeps.
std::uint32_t contentsOf(const FrameBuffers& frame, bool pairs);

/// Bytes of `samples` samples, all of them paired.
std::uint64_t mostBytesOf(std::uint32_t contents, std::uint64_t samples);

/// `isShort`: over a slow link; then they are made so if there is more of each than its light.
Bytes packSamples(std::span<const TakenSample> samples, std::uint32_t contents, bool isShort);
/// Exactly `count` samples. Takes anything; throws MessageError.
std::vector<TakenSample> unpackSamples(ByteView bytes, std::uint32_t contents, std::size_t count);

}  // namespace trex::machines
