// Runs a fuzz target without libFuzzer, so that the tests under gcc's sanitizers have a smoke of
// it: every seed as it is, then changed ones. Usage: fuzz_NAME SEED_FOLDER RUNS
//
// Changes are those of the target's own mutator, or plain ones of bytes. The same every time.
#include <algorithm>
#include <cstring>
#include <fstream>
#include <iterator>
#include <random>
#include <vector>

#include "tests/fuzz/fuzz.h"

extern "C" [[gnu::weak]] std::size_t LLVMFuzzerCustomMutator(std::uint8_t* data, std::size_t size,
                                                             std::size_t maxSize, unsigned seed);

namespace {

using Input = std::vector<std::uint8_t>;

constexpr std::size_t kRoom = 4096;  // that an input may grow by

std::mt19937& generator() {
  static std::mt19937 shared(1);
  return shared;
}

/// In [0, count).
std::size_t below(std::size_t count) { return count > 0 ? generator()() % count : 0; }

std::vector<Input> readSeeds(const std::filesystem::path& folder) {
  std::vector<std::filesystem::path> paths;
  for (const auto& entry : std::filesystem::directory_iterator(folder)) {
    paths.push_back(entry.path());
  }
  std::sort(paths.begin(), paths.end());
  std::vector<Input> seeds;
  for (const auto& path : paths) {
    std::ifstream file(path, std::ios::binary);
    seeds.emplace_back(std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>());
  }
  return seeds;
}

}  // namespace

/// One change: a bit, a byte, a number, or a run that is copied, cut out or doubled.
std::size_t LLVMFuzzerMutate(std::uint8_t* data, std::size_t size, std::size_t maxSize) {
  if (size == 0) return 0;
  const std::size_t at = below(size), run = 1 + below(std::min<std::size_t>(size - at, 32));
  switch (below(6)) {
    case 0:
      data[at] ^= static_cast<std::uint8_t>(1u << below(8));
      return size;
    case 1:
      data[at] = static_cast<std::uint8_t>(generator()());
      return size;
    case 2: {
      constexpr std::uint32_t kNumbers[] = {0u, 1u, 0x7fffffffu, 0x80000000u, 0xffffffffu};
      const std::uint32_t number = kNumbers[below(std::size(kNumbers))];
      std::memcpy(data + at, &number, std::min<std::size_t>(sizeof(number), size - at));
      return size;
    }
    case 3:
      std::memmove(data + below(size - run + 1), data + at, run);
      return size;
    case 4:
      std::memmove(data + at, data + at + run, size - at - run);
      return std::max<std::size_t>(size - run, 1);
    default:
      if (size + run > maxSize) return size;
      std::memmove(data + at + run, data + at, size - at);
      return size + run;
  }
}

int main(int argc, char** argv) {
  if (argc != 3) {
    std::fprintf(stderr, "usage: %s SEED_FOLDER RUNS\n", argv[0]);
    return 2;
  }
  const std::vector<Input> seeds = readSeeds(argv[1]);
  const long runs = std::strtol(argv[2], nullptr, 10);
  if (seeds.empty() || runs <= 0) {
    std::fprintf(stderr, "%s: no seeds in %s, or no runs\n", argv[0], argv[1]);
    return 1;
  }
  for (const Input& seed : seeds) LLVMFuzzerTestOneInput(seed.data(), seed.size());
  for (long i = 0; i < runs; ++i) {
    Input input = seeds[below(seeds.size())];
    std::size_t size = input.size();
    input.resize(size + kRoom);
    for (std::size_t k = 1 + below(4); k > 0; --k) {
      size =
          LLVMFuzzerCustomMutator != nullptr
              ? LLVMFuzzerCustomMutator(input.data(), size, input.size(), unsigned(generator()()))
              : LLVMFuzzerMutate(input.data(), size, input.size());
    }
    // In memory of its own size, so that a read beyond its end is seen.
    const Input exact(input.begin(), input.begin() + static_cast<std::ptrdiff_t>(size));
    LLVMFuzzerTestOneInput(exact.data(), exact.size());
  }
  std::printf("%zu seeds, %ld changed inputs: no finding\n", seeds.size(), runs);
  return 0;
}
