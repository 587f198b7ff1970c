// A leaf's record: its strip, and which vertices of the cluster that is about. FORMAT.md,
// "Records".
#pragma once

#include <bit>
#include <cstdint>

#include "hccmesh/layout.h"

namespace hccm {

/// What a record says. Lanes are triangles in the order of the leaf.
struct LeafTopology {
  std::uint32_t triangles = 0, locals = 0, fresh = 0, firstFresh = 0;
  std::uint32_t bytes = 0;         ///< of the record
  std::uint32_t headBytes = 0;     ///< of them before the references
  std::uint32_t size = 0;          ///< entries
  std::uint32_t starts = 0;        ///< bit p: a triangle starts at entry p
  std::uint8_t entry[16] = {};     ///< local numbers
  std::uint8_t vertex[16] = {};    ///< of the cluster, by local number
  std::uint8_t corner[3][8] = {};  ///< local numbers by corner and lane, 0 to 15
  bool canonical = true;  ///< spare bits zero; no entry, reference or start points ahead of itself
};

/// One bit after the other; reads up to 24 bytes behind the record's start, whatever it holds.
inline LeafTopology readLeaf(const std::byte* record) {
  LeafTopology t;
  std::uint32_t at = 12;
  const std::uint32_t more = layout::readBits(record, 8, 4);  // entries behind the first three
  const auto bits = [&](std::uint32_t count) {
    at += count;
    return layout::readBits(record, at - count, count);
  };
  if (more > layout::kMaxEntries - 3) t.canonical = false;
  const std::uint32_t size = t.size = 3 + (t.canonical ? more : layout::kMaxEntries - 3);
  const std::uint32_t starts = t.starts = 1u | bits(size - 3) << 1;
  const std::uint32_t next = 7u | bits(size - 3) << 3;
  t.firstFresh = std::to_integer<std::uint32_t>(record[0]);
  t.locals = static_cast<std::uint32_t>(std::popcount(next));
  const std::uint32_t fresh = bits(t.locals);
  t.fresh = static_cast<std::uint32_t>(std::popcount(fresh));
  std::uint8_t* entry = t.entry;
  for (std::uint32_t i = 0, count = 0; i < size; ++i) {
    entry[i] = static_cast<std::uint8_t>((next >> i & 1u) ? count++ : bits(4));
    t.canonical = t.canonical && entry[i] < count;
  }
  for (; at % 8u != 0;) t.canonical = bits(1) == 0 && t.canonical;
  t.headBytes = at / 8u;
  std::uint32_t number = t.firstFresh;
  for (std::uint32_t i = 0; i < t.locals; ++i) {
    const std::uint32_t v = (fresh >> i & 1u) ? number++ : bits(8);
    t.vertex[i] = static_cast<std::uint8_t>(v);
    t.canonical = t.canonical && v < 256u && ((fresh >> i & 1u) || v < t.firstFresh);
  }
  t.bytes = at / 8u;
  if (std::popcount(starts) > 8 || (starts >> (size - 3)) != 1u) t.canonical = false;
  for (std::uint32_t p = 0; p + 2 < size && t.triangles < layout::kLeafSize; ++p) {
    if (!(starts >> p & 1u)) continue;
    t.corner[0][t.triangles] = entry[p + p % 2u];
    t.corner[1][t.triangles] = entry[p + 1u - p % 2u];
    t.corner[2][t.triangles++] = entry[p + 2u];
  }
  return t;
}

}  // namespace hccm
