// From sums of flux to irradiance. Private to src/grays; both tracers share it, so the same sums
// give the same light on every device.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "asvo/asvo.h"

namespace trex {

/// 32-bit words of one array of sums: leaf x side x rgb x (low, high).
inline constexpr std::uint64_t kWordsPerLeaf = 12;

/// Fills light[] (a node each, asvo_layout.h) from sums of counts of direct and indirect flux, one
/// count being `wattsPerCount`. Sums of flux over sums of area go up the tree, sides exchanged
/// where a child faces against its parent. A voxel side with less than kLeastArea of a leaf's face
/// takes the quotient of its next ancestor that has more, for a small area makes a noisy quotient.
/// Runs on the calling oneTBB arena; same bits for any number of threads.
void resolveLight(const asvo::Tree& tree, std::span<const std::uint32_t> direct,
                  std::span<const std::uint32_t> indirect, double wattsPerCount,
                  std::span<asvo::uvec4> light);

inline constexpr float kLeastArea = 0.2f;

}  // namespace trex
