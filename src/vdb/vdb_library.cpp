#include "src/vdb/vdb_library.h"

#include <dlfcn.h>
#include <fcntl.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <memory>
#include <string>

#include "src/core/error.h"

namespace trex {
namespace {

namespace fs = std::filesystem;
using Bytes = std::span<const std::byte>;

constexpr std::size_t kVoxels = 512;
constexpr std::uint64_t kSpareBytes = std::uint64_t{256} << 20;  // of OpenVDB, beside the values

/// A file without a name, in memory.
class MemoryFile {
 public:
  MemoryFile() : file_(::memfd_create("fog", MFD_CLOEXEC)) {
    if (file_ < 0) {
      fail(ExitCode::kMemoryOrDevice, "no memory to read a volume: {}", std::strerror(errno));
    }
  }
  ~MemoryFile() { ::close(file_); }
  MemoryFile(const MemoryFile&) = delete;
  MemoryFile& operator=(const MemoryFile&) = delete;
  int descriptor() const { return file_; }
  /// What was written.
  std::shared_ptr<const Bytes> map() const {
    struct stat status {};
    if (::fstat(file_, &status) != 0 || status.st_size == 0) return std::make_shared<Bytes>();
    const auto size = static_cast<std::size_t>(status.st_size);
    void* const start = ::mmap(nullptr, size, PROT_READ, MAP_PRIVATE, file_, 0);
    if (start == MAP_FAILED) {
      fail(ExitCode::kMemoryOrDevice, "no memory to read a volume: {}", std::strerror(errno));
    }
    return {new Bytes(static_cast<const std::byte*>(start), size), [](const Bytes* bytes) {
              ::munmap(const_cast<std::byte*>(bytes->data()), bytes->size());
              delete bytes;
            }};
  }

 private:
  int file_;
};

/// Bytes of private memory that this process has mapped; 0 if unknown.
std::uint64_t dataBytes() {
  std::FILE* file = std::fopen("/proc/self/statm", "r");
  if (file == nullptr) return 0;
  unsigned long long pages = 0;
  const int found = std::fscanf(file, "%*u %*u %*u %*u %*u %llu", &pages);
  std::fclose(file);
  return found == 1 ? pages * static_cast<std::uint64_t>(::sysconf(_SC_PAGESIZE)) : 0;
}

void limit(__rlimit_resource what, std::uint64_t value) {
  const rlimit l{value, value};
  ::setrlimit(what, &l);
}

/// In the process of the reader: whatever happens there stays there.
[[noreturn]] void readAlone(TrexReadVdb* read, const char* path, std::uint64_t maxBytes,
                            std::uint64_t fileBytes, std::uint64_t before, int output) {
  for (const int number : {SIGSEGV, SIGBUS, SIGABRT, SIGFPE, SIGILL, SIGINT, SIGTERM}) {
    std::signal(number, SIG_DFL);
  }
  limit(RLIMIT_CORE, 0);
  limit(RLIMIT_CPU, 60 + fileBytes / 1'000'000);
  if (before > 0) limit(RLIMIT_DATA, before + 2 * maxBytes + kSpareBytes);
  const int nowhere = ::open("/dev/null", O_WRONLY | O_CLOEXEC);
  if (nowhere >= 0) ::dup2(nowhere, STDERR_FILENO);
  ::_exit(read(path, maxBytes, output));
}

/// One line of plain characters: names of grids come from the file.
std::string textOf(Bytes bytes) {
  constexpr std::size_t kMost = 1000;
  std::string text(reinterpret_cast<const char*>(bytes.data()), std::min(bytes.size(), kMost));
  for (char& c : text) {
    if (c != '\n' && (c < ' ' || c > '~')) c = '?';
  }
  return oneLine(std::move(text));
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

void* findVdbFunction(const char* name) {
  std::error_code error;
  const fs::path path = fs::read_symlink("/proc/self/exe", error).parent_path() / "libtrex_vdb.so";
  void* library = dlopen(path.c_str(), RTLD_NOW | RTLD_LOCAL);  // kept until the program ends
  void* function = library != nullptr ? dlsym(library, name) : nullptr;
  if (function == nullptr) {
    fail(ExitCode::kMemoryOrDevice, "OpenVDB can't be used ({}): build the target trex_vdb",
         dlerror());
  }
  return function;
}

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
  int status = 0;
  while (::waitpid(child, &status, 0) < 0 && errno == EINTR) {
  }
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
