// Memory that is going to be read, asked for early.
#pragma once

#include <cstddef>

namespace trex {

/// Asks for the cache lines of `bytes` from `at` on. Any address does, readable or not.
inline void prefetch(const void* at, std::size_t bytes) {
  const auto* first = static_cast<const char*>(at);
  for (std::size_t i = 0; i < bytes; i += 64) __builtin_prefetch(first + i);
}

}  // namespace trex
