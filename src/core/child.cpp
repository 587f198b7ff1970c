#include "src/core/child.h"

#include <fcntl.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <csignal>
#include <cstring>

#include "src/core/error.h"

namespace trex {
namespace {

[[noreturn]] void noMemory() {
  fail(ExitCode::kMemoryOrDevice, "no memory for what another process reads: {}",
       std::strerror(errno));
}

}  // namespace

MemoryFile::MemoryFile() : file_(::memfd_create("reader", MFD_CLOEXEC)) {
  if (file_ < 0) noMemory();
}
MemoryFile::~MemoryFile() { ::close(file_); }

std::shared_ptr<const std::span<const std::byte>> MemoryFile::map() const {
  using Bytes = std::span<const std::byte>;
  struct stat status {};
  if (::fstat(file_, &status) != 0 || status.st_size == 0) return std::make_shared<Bytes>();
  const auto size = static_cast<std::size_t>(status.st_size);
  void* const start = ::mmap(nullptr, size, PROT_READ, MAP_PRIVATE, file_, 0);
  if (start == MAP_FAILED) noMemory();
  return {new Bytes(static_cast<const std::byte*>(start), size), [](const Bytes* bytes) {
            ::munmap(const_cast<std::byte*>(bytes->data()), bytes->size());
            delete bytes;
          }};
}

std::filesystem::path besideProgram(const std::string& name) {
  std::error_code error;
  return std::filesystem::read_symlink("/proc/self/exe", error).parent_path() / name;
}

void becomeReader() {
  for (const int number :
       {SIGSEGV, SIGBUS, SIGABRT, SIGFPE, SIGILL, SIGINT, SIGTERM, SIGXCPU, SIGXFSZ}) {
    std::signal(number, SIG_DFL);
  }
  ::prctl(PR_SET_PDEATHSIG, SIGKILL);
  limitProcess(RLIMIT_CORE, 0);
  const int nowhere = ::open("/dev/null", O_WRONLY | O_CLOEXEC);
  if (nowhere >= 0) ::dup2(nowhere, STDERR_FILENO);
}

void limitProcess(int what, std::uint64_t value) {
  const rlimit l{value, value};
  ::setrlimit(static_cast<__rlimit_resource>(what), &l);
}

std::uint64_t readingSeconds(std::uint64_t fileBytes) { return 60 + fileBytes / 1'000'000; }

int waitForChild(int child) {
  int status = 0;
  while (::waitpid(child, &status, 0) < 0 && errno == EINTR) {
  }
  return status;
}

std::string textOf(std::span<const std::byte> bytes) {
  constexpr std::size_t kMost = 1000;
  std::string text(reinterpret_cast<const char*>(bytes.data()), std::min(bytes.size(), kMost));
  for (char& c : text) {
    if (c != '\n' && (c < ' ' || c > '~')) c = '?';
  }
  return oneLine(std::move(text));
}

}  // namespace trex
