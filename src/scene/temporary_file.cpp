#include "src/scene/temporary_file.h"

#include <fcntl.h>
#include <sys/mman.h>
#include <unistd.h>

#include <cerrno>
#include <cstdlib>
#include <cstring>

#include "src/core/error.h"

namespace trex::detail {

int openTemporaryFile(const std::filesystem::path& folder) {
  int file = ::open(folder.c_str(), O_TMPFILE | O_RDWR | O_CLOEXEC, 0600);
  if (file < 0) {  // file systems without such files
    std::string name = (folder / ".trex-XXXXXX").string();
    file = ::mkostemp(name.data(), O_CLOEXEC);
    if (file >= 0) ::unlink(name.c_str());
  }
  if (file < 0) {
    fail(ExitCode::kOutput, "{}: no temporary file can be made there: {}", folder.string(),
         std::strerror(errno));
  }
  return file;
}

TemporaryTexels::TemporaryTexels(std::filesystem::path folder)
    : folder_(std::move(folder)), file_(openTemporaryFile(folder_)) {}

TemporaryTexels::~TemporaryTexels() { ::close(file_); }

std::uint64_t TemporaryTexels::append(std::span<const std::byte> bytes) {
  const std::uint64_t start = size_;
  while (!bytes.empty()) {
    const ssize_t done = ::pwrite(file_, bytes.data(), bytes.size(), static_cast<off_t>(size_));
    if (done < 0 && errno == EINTR) continue;
    if (done <= 0) {
      fail(ExitCode::kOutput,
           "{}: textures beyond --texture-memory can't be put aside in a temporary file there: {}",
           folder_.string(), std::strerror(done < 0 ? errno : ENOSPC));
    }
    size_ += static_cast<std::uint64_t>(done);
    bytes = bytes.subspan(static_cast<std::size_t>(done));
  }
  return start;
}

void TemporaryTexels::read(std::uint64_t offset, std::span<std::byte> out) const {
  while (!out.empty()) {
    const ssize_t got = ::pread(file_, out.data(), out.size(), static_cast<off_t>(offset));
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) bad(offset, std::string("can't be read: ") + std::strerror(errno));
    if (got == 0) bad(offset, "ends early");
    out = out.subspan(static_cast<std::size_t>(got));
    offset += static_cast<std::uint64_t>(got);
  }
}

void TemporaryTexels::readAhead(std::uint64_t offset, std::uint64_t bytes) const {
  ::posix_fadvise(file_, static_cast<off_t>(offset), static_cast<off_t>(bytes),
                  POSIX_FADV_WILLNEED);
}

std::shared_ptr<const std::span<const std::byte>> TemporaryTexels::map(std::uint64_t offset,
                                                                       std::uint64_t bytes) const {
  const auto page = static_cast<std::uint64_t>(::sysconf(_SC_PAGESIZE));
  const std::uint64_t before = offset % page, length = before + bytes;
  void* const at =
      ::mmap(nullptr, length, PROT_READ, MAP_SHARED, file_, static_cast<off_t>(offset - before));
  if (at == MAP_FAILED) bad(offset, std::string("can't be mapped: ") + std::strerror(errno));
  using Bytes = std::span<const std::byte>;
  return {new Bytes(static_cast<const std::byte*>(at) + before, bytes),
          [at, length](const Bytes* view) {
            ::munmap(at, length);
            delete view;
          }};
}

void TemporaryTexels::bad(std::uint64_t offset, const std::string& what) const {
  fail(ExitCode::kOutput, "{}: temporary file of textures, byte {}: {}", folder_.string(), offset,
       what);
}

}  // namespace trex::detail
