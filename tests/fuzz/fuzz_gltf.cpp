// Any bytes as a .gltf file.
#include <cstring>

#include "tests/fuzz/fuzz.h"
#include "tests/fuzz/json_mutator.h"

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const auto path = trex::fuzz::writeInput("input.gltf", {data, size});
  // Half of those that may move are posed: both ways read what comes before the pose alike.
  const bool posed = size % 2 == 0 && trex::fuzz::contains({data, size}, "animations");
  trex::fuzz::importAndCheck(path, posed ? "0" : "");
  return 0;
}

std::size_t LLVMFuzzerCustomMutator(std::uint8_t* data, std::size_t size, std::size_t maxSize,
                                    unsigned seed) {
  std::minstd_rand random(seed);
  if (random() % 4 != 0) {
    const std::string text =
        trex::fuzz::mutateJson(reinterpret_cast<const char*>(data), size, random);
    if (!text.empty() && text.size() <= maxSize) {
      std::memcpy(data, text.data(), text.size());
      return text.size();
    }
  }
  return LLVMFuzzerMutate(data, size, maxSize);
}
