// The streams of an arranged page, and what packing and unpacking must agree on; pack.cpp says what
// is in them.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "hccmesh/layout.h"
#include "hccmesh/pack.h"

namespace hccm {

using Stream = std::vector<std::byte>;

inline constexpr std::size_t kPageHead = 12;             ///< bytes before the streams
inline constexpr std::uint32_t kRaw = 0, kArranged = 1;  ///< modes

struct Streams {
  Stream headers, heads, references, attributes;
  std::array<Stream, 12> planes;    ///< x, y, z: four bytes of each, the lowest first
  std::vector<std::uint32_t> rest;  ///< work of unpacking

  template <typename Each>
  void forEach(const Each& each) {
    for (Stream* s : {&headers, &heads, &references, &attributes}) each(*s);
    for (Stream& s : planes) each(s);
  }
};

/// Of a strip with triangles from these `starts` on (bit p: from entry p): bit e where entry e is
/// the last of a triangle whose neighbour before starts an entry earlier. Its vertex is predicted
/// to make a parallelogram with that neighbour.
constexpr std::uint32_t parallelograms(std::uint32_t starts) { return (starts & starts >> 1) << 3; }

/// Throws FormatError: a page is damaged so.
[[noreturn]] void refusePage(const char* what);

/// Puts the blobs of a page together from its streams, which get a few bytes more. `page` has its
/// bytes, all zero, and no offsets. `known` as of unpackClusters(). Throws FormatError. Obeys
/// hwy::SetSupportedTargetsForTest. Thread safe.
void assembleClusters(Streams& streams, std::span<const layout::ClusterHeader> headers, bool known,
                      ClusterPage& page);

}  // namespace hccm
