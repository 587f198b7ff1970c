// Pages of clusters with their streams as plain bytes: what a mutator can change to any effect.
#pragma once

#include <zstd.h>

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <span>
#include <stdexcept>
#include <vector>

namespace trex::fuzz {

inline constexpr std::size_t kPageHead = 12;

inline std::uint32_t word(std::span<const std::byte> bytes, std::size_t at) {
  std::uint32_t value = 0;
  if (at + 4 <= bytes.size()) std::memcpy(&value, bytes.data() + at, 4);
  return value;
}
inline void putWord(std::vector<std::byte>& out, std::size_t value) {
  const auto w = static_cast<std::uint32_t>(value);
  const auto* at = reinterpret_cast<const std::byte*>(&w);
  out.insert(out.end(), at, at + 4);
}

/// Head, then u32 size and plain bytes of each stream.
inline std::vector<std::byte> plainPageOf(std::span<const std::byte> packed) {
  std::vector<std::byte> out(packed.begin(), packed.begin() + kPageHead);
  for (std::size_t at = kPageHead; at < packed.size();) {
    const std::uint32_t plain = word(packed, at), size = word(packed, at + 4);
    std::vector<std::byte> bytes(plain);
    if (ZSTD_decompress(bytes.data(), plain, packed.data() + at + 8, size) != plain)
      throw std::runtime_error("a page that does not unpack");
    putWord(out, plain);
    out.insert(out.end(), bytes.begin(), bytes.end());
    at += 8 + size;
  }
  return out;
}

/// The page of it. A stream that is cut off ends where the bytes do.
inline std::vector<std::byte> packedPageOf(std::span<const std::byte> plain) {
  if (plain.size() < kPageHead) return {plain.begin(), plain.end()};
  std::vector<std::byte> out(plain.begin(), plain.begin() + kPageHead);
  for (std::size_t at = kPageHead; at + 4 <= plain.size();) {
    const std::size_t size = std::min<std::size_t>(word(plain, at), plain.size() - at - 4);
    std::vector<std::byte> frame(ZSTD_compressBound(size));
    frame.resize(ZSTD_compress(frame.data(), frame.size(), plain.data() + at + 4, size, 1));
    putWord(out, size);
    putWord(out, frame.size());
    out.insert(out.end(), frame.begin(), frame.end());
    at += 4 + size;
  }
  return out;
}

}  // namespace trex::fuzz
