#include "src/grays/query_order.h"

#include <tbb/parallel_for.h>

#include <algorithm>

namespace trex {

using shaderio::GatherQuery;

std::uint16_t QueryOrder::key(const GatherQuery& q) const {
  const bool wide = tracer_.asvoStartsWide(q.tanHalf, q.tmin, q.jitter);
  const float cells = static_cast<float>(1u << kCellBits);
  const glm::vec3 g = tracer_.asvoGridPosition(q.origin, kCellBits);
  std::uint32_t cell = 0;
  // From the bits of the three numbers, highest first: a Morton code. NaN becomes 0.
  std::uint32_t place[3];
  for (int axis = 0; axis < 3; ++axis) {
    place[axis] = static_cast<std::uint32_t>(std::min(std::max(0.0f, g[axis]), cells - 1.0f));
  }
  for (std::uint32_t bit = kCellBits; bit-- > 0;) {
    for (const std::uint32_t p : place) cell = cell << 1 | (p >> bit & 1u);
  }
  const std::uint32_t octant = (q.direction.x < 0.0f ? 1u : 0u) | (q.direction.y < 0.0f ? 2u : 0u) |
                               (q.direction.z < 0.0f ? 4u : 0u);
  return static_cast<std::uint16_t>((wide ? 0u : kKeys / 2) | cell << 3 | octant);
}

std::uint32_t QueryOrder::write(std::span<const GatherQuery> queries, GatherQuery* out) {
  const std::size_t chunks = (queries.size() + kChunk - 1) / kChunk;
  keys_.resize(queries.size());
  places_.assign(chunks * kKeys, 0);
  const auto forChunk = [&](std::size_t chunk, const auto& function) {
    const std::size_t end = std::min(queries.size(), (chunk + 1) * kChunk);
    for (std::size_t i = chunk * kChunk; i < end; ++i) function(i, &places_[chunk * kKeys]);
  };
  tbb::parallel_for(std::size_t{0}, chunks, [&](std::size_t chunk) {
    forChunk(chunk, [&](std::size_t i, std::uint32_t* counts) {
      keys_[i] = key(queries[i]);
      ++counts[keys_[i]];
    });
  });
  std::uint32_t next = 0, wide = 0;
  for (std::uint32_t k = 0; k < kKeys; ++k) {
    if (k == kKeys / 2) wide = next;
    for (std::size_t chunk = 0; chunk < chunks; ++chunk) {
      const std::uint32_t count = places_[chunk * kKeys + k];
      places_[chunk * kKeys + k] = next;
      next += count;
    }
  }
  tbb::parallel_for(std::size_t{0}, chunks, [&](std::size_t chunk) {
    forChunk(chunk, [&](std::size_t i, std::uint32_t* places) {
      GatherQuery& to = out[places[keys_[i]]++];
      to = queries[i];
      to.index = static_cast<std::uint32_t>(i);
    });
  });
  return wide;
}

}  // namespace trex
