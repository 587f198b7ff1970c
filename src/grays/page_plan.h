// How a tree that does not fit is shared out on the device: what is always there, the pool of
// pages, the grid, batches of cones. Private to src/grays.
#pragma once

#include <cstdint>

#include "asvo/asvo.h"

namespace trex {

/// What a device gives; bytes.
struct PageLimits {
  std::uint64_t maxBytes = 0;     ///< in all
  std::uint64_t maxBuffer = 0;    ///< of one buffer
  std::uint64_t maxElements = 0;  ///< of one texel buffer, 2^24 or more; 0: none are used
  bool staged = false;            ///< memory is not mapped: copies need room of their own
};

struct PagePlan {
  std::uint32_t pageBits = 0;   ///< a page is 2^pageBits nodes, 32 bytes each
  std::uint32_t pages = 0;      ///< of the tree
  std::uint32_t slots = 0;      ///< of the pool
  std::uint32_t resident = 0;   ///< first pages, which stay: all voxels in the grid, and more
  std::uint32_t gridLevel = 0;  ///< the finest in the grid of cones
  std::uint32_t queries = 0;    ///< cones of a batch
  std::uint32_t loads = 0;      ///< pages loaded before a batch, at most
  bool texels = false;          ///< read through texel buffers
  std::uint64_t bytes = 0;      ///< all buffers together
  std::uint64_t largest = 0;    ///< bytes of the largest buffer
  std::uint64_t pageNodes() const { return std::uint64_t{1} << pageBits; }
};

/// Nodes of a page: 2^10 (docs/cones.md).
inline constexpr std::uint32_t kPageBits = 10;
/// Share of the device's memory that upper levels keep for ever.
inline constexpr double kResidentShare = 0.15;

/// The plan within the limits. If they are too low it is the least there can be, above them in
/// `bytes` or `largest`. The tree must not be empty.
PagePlan planPages(const asvo::Tree& tree, const PageLimits& limits,
                   std::uint32_t pageBits = kPageBits);

}  // namespace trex
