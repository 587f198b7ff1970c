#include "src/vdb/vdb_library.h"

#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <memory>
#include <string>

#include "src/core/child.h"
#include "src/core/error.h"

namespace trex {
namespace {

namespace fs = std::filesystem;
using Bytes = std::span<const std::byte>;

constexpr std::size_t kVoxels = 512;
constexpr std::uint64_t kSpareBytes = std::uint64_t{256} << 20;  // of OpenVDB, beside the values

/// Bytes of private memory that this process has mapped; 0 if unknown.
std::uint64_t dataBytes() {
  std::FILE* file = std::fopen("/proc/self/statm", "r");
  if (file == nullptr) return 0;
  unsigned long long pages = 0;
  const int found = std::fscanf(file, "%*u %*u %*u %*u %*u %llu", &pages);
  std::fclose(file);
  return found == 1 ? pages * static_cast<std::uint64_t>(::sysconf(_SC_PAGESIZE)) : 0;
}

/// In the process of the reader: whatever happens there stays there.
[[noreturn]] void readAlone(TrexReadVdb* read, const char* path, std::uint64_t maxBytes,
                            std::uint64_t fileBytes, std::uint64_t before, int output) {
  becomeReader();
  limitProcess(RLIMIT_CPU, readingSeconds(fileBytes));
  if (before > 0) limitProcess(RLIMIT_DATA, before + 2 * maxBytes + kSpareBytes);
  ::_exit(read(path, maxBytes, output));
}

/// Takes the answer apart; false if its parts are not as long as it says.
bool takeApart(Bytes from, VdbFog& fog) {
  TrexVdbHead head;
  if (from.size() < sizeof(head)) return false;
  std::memcpy(&head, from.data(), sizeof(head));
  from = from.subspan(sizeof(head));
  const auto take = [&from](std::uint64_t count, std::size_t size) {
    const bool there = count <= from.size() / size;
    const Bytes part = from.first(there ? count * size : 0);
    from = from.subspan(part.size());
    return there ? part.data() : nullptr;
  };
  const auto channel = [&](std::uint32_t bit, auto& out) {
    using Value = std::remove_reference_t<decltype(out[0])>;
    if (bit != 0 && (head.channels & bit) == 0) return true;
    const std::byte* start = take(head.arrays * kVoxels, sizeof(Value));
    if (start != nullptr) out = {reinterpret_cast<Value*>(start), head.arrays * kVoxels};
    return start != nullptr;
  };
  if (head.arrays > from.size() / kVoxels) return false;
  const std::byte* bricks = take(head.bricks, sizeof(TrexVdbBrick));
  if (bricks == nullptr) return false;
  fog.bricks = {reinterpret_cast<const TrexVdbBrick*>(bricks), head.bricks};
  for (int i = 0; i < 16; ++i) fog.toWorld[i / 4][i % 4] = head.toWorld[i];
  return channel(0, fog.density) && channel(kTrexVdbTemperature, fog.temperature) &&
         channel(kTrexVdbFlames, fog.flames) && channel(kTrexVdbEmission, fog.emission) &&
         from.empty();
}

void check(const VdbFog& fog, const std::string& name) {
  constexpr std::int32_t kMostPlace = 1 << 29;
  const std::size_t arrays = fog.density.size() / kVoxels;
  for (const TrexVdbBrick& b : fog.bricks) {
    for (const std::int32_t place : b.origin) {
      if ((place & 7) != 0 || place < -kMostPlace || place > kMostPlace) {
        fail(ExitCode::kInput, "{}: a voxel at {} is out of range", name, place);
      }
    }
    if (b.array != 0xffffffffu && b.array >= arrays) {
      fail(ExitCode::kInput, "{}: its parts do not fit together", name);
    }
  }
  for (int i = 0; i < 16; ++i) {
    if (!std::isfinite(fog.toWorld[i / 4][i % 4])) {
      fail(ExitCode::kInput, "{}: its transform is not finite", name);
    }
  }
}

}  // namespace

VdbFog readFog(const fs::path& path, std::uint64_t maxBytes) {
  const std::string name = path.string();
  std::error_code error;
  const std::uint64_t fileBytes = fs::file_size(path, error);
  if (error) fail(ExitCode::kInput, "{}: can't be opened: {}", name, error.message());
  auto* const read = vdbFunction<TrexReadVdb>(kTrexReadVdb);
  const MemoryFile output;
  const std::uint64_t before = dataBytes();
  const pid_t child = ::fork();
  if (child < 0) {
    fail(ExitCode::kMemoryOrDevice, "{}: no process to read it: {}", name, std::strerror(errno));
  }
  if (child == 0) readAlone(read, name.c_str(), maxBytes, fileBytes, before, output.descriptor());
  const int status = waitForChild(child);
  if (!WIFEXITED(status)) {
    fail(ExitCode::kInput, "{}: is damaged: OpenVDB crashed on it (signal {})", name,
         WTERMSIG(status));
  }
  VdbFog fog;
  fog.memory = output.map();
  if (WEXITSTATUS(status) == kTrexVdbTooLarge) {
    fail(ExitCode::kMemoryOrDevice, "{}: {}; make --max-memory larger", name, textOf(*fog.memory));
  }
  if (WEXITSTATUS(status) != kTrexVdbRead) {
    fail(ExitCode::kInput, "{}: {}", name, textOf(*fog.memory));
  }
  if (!takeApart(*fog.memory, fog)) fail(ExitCode::kInput, "{}: its parts do not fit", name);
  check(fog, name);
  return fog;
}

}  // namespace trex
