#include "src/machines/identity.h"

#include <fmt/format.h>
#include <unistd.h>

#include "src/core/hash.h"
#include "src/core/version.h"

namespace trex::machines {
namespace {

constexpr const char* kNames[] = {"SSE4.2", "AVX", "AVX2", "FMA", "BMI2", "AVX512F", "AVX512VL"};

std::uint64_t instructionsOfThis() {
#if defined(__x86_64__)
  __builtin_cpu_init();
  const bool has[] = {
      __builtin_cpu_supports("sse4.2") != 0,  __builtin_cpu_supports("avx") != 0,
      __builtin_cpu_supports("avx2") != 0,    __builtin_cpu_supports("fma") != 0,
      __builtin_cpu_supports("bmi2") != 0,    __builtin_cpu_supports("avx512f") != 0,
      __builtin_cpu_supports("avx512vl") != 0};
  std::uint64_t bits = 0;
  for (std::size_t i = 0; i < std::size(has); ++i) bits |= std::uint64_t{has[i]} << i;
  return bits;
#else
  return 0;
#endif
}

}  // namespace

Hello helloOfThis(std::uint32_t threads, const std::filesystem::path& program) {
  char host[256] = "?";
  ::gethostname(host, sizeof(host) - 1);
  Hello hello;
  hello.version = kVersion;
  hello.host = host;
  hello.build = hashFile(program);
  hello.instructions = instructionsOfThis();
  hello.threads = threads;
  return hello;
}

std::string whyUnfit(const Hello& mine, const Hello& other) {
  if (mine.version == other.version && mine.build == other.build) return {};
  if (mine.version != other.version) {
    return fmt::format("runs trex {}, machine 0 runs {}; install the same build on all",
                       other.version, mine.version);
  }
  return fmt::format("runs another build of trex {} than machine 0; install the same on all",
                     mine.version);
}

std::string instructionText(std::uint64_t instructions) {
  std::string text;
  for (std::size_t i = 0; i < std::size(kNames); ++i) {
    if (instructions >> i & 1) text += (text.empty() ? "" : " ") + std::string(kNames[i]);
  }
  return text.empty() ? "none known" : text;
}

}  // namespace trex::machines
