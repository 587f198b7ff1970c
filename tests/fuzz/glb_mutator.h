// Mutates .glb files: the JSON chunk, its data or anything at all; mostly the lengths are put right
// afterwards.
#pragma once

#include <cstring>

#include "tests/fuzz/fuzz.h"
#include "tests/fuzz/json_mutator.h"

namespace trex::fuzz {

inline constexpr std::size_t kHeader = 12, kChunk = 8, kJson = kHeader + kChunk;

inline std::uint32_t word(const std::uint8_t* data) {
  std::uint32_t value;
  std::memcpy(&value, data, sizeof(value));
  return value;
}
inline void setWord(std::uint8_t* data, std::size_t value) {
  const auto narrow = static_cast<std::uint32_t>(value);
  std::memcpy(data, &narrow, sizeof(narrow));
}

inline std::size_t mutateGlb(std::uint8_t* data, std::size_t size, std::size_t maxSize,
                             unsigned seed) {
  std::minstd_rand random(seed);
  const bool whole = size >= kJson && word(data + kHeader) <= size - kJson;
  if (!whole || random() % 8 == 0) return LLVMFuzzerMutate(data, size, maxSize);
  const std::size_t jsonEnd = kJson + word(data + kHeader);
  if (random() % 4 == 0 && jsonEnd + kChunk < size) {
    LLVMFuzzerMutate(data + jsonEnd + kChunk, size - jsonEnd - kChunk, size - jsonEnd - kChunk);
    return size;
  }
  const char* json = reinterpret_cast<const char*>(data) + kJson;
  std::string text = mutateJson(json, jsonEnd - kJson, random);
  text.append((4 - text.size() % 4) % 4, ' ');
  const std::vector<std::uint8_t> rest(data + jsonEnd, data + size);
  const std::size_t total = kJson + text.size() + rest.size();
  if (text.empty() || total > maxSize) return LLVMFuzzerMutate(data, size, maxSize);
  std::memcpy(data + kJson, text.data(), text.size());
  if (!rest.empty()) std::memcpy(data + kJson + text.size(), rest.data(), rest.size());
  setWord(data + 8, total);
  setWord(data + kHeader, text.size());
  return total;
}

}  // namespace trex::fuzz
