#include "hccmesh/stream_file.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>

#include "hccmesh/stream.h"

namespace hccm {
namespace {

int flagsOf(StreamFile::Mode mode) {
  switch (mode) {
    case StreamFile::Mode::kCreate:
      return O_RDWR | O_CREAT | O_TRUNC | O_CLOEXEC;
    case StreamFile::Mode::kAppend:
      return O_RDWR | O_CLOEXEC;
    default:
      return O_RDONLY | O_CLOEXEC;
  }
}

}  // namespace

StreamFile::StreamFile(const std::filesystem::path& path, Mode mode)
    : path_(path), file_(::open(path.c_str(), flagsOf(mode), 0666)) {
  if (file_ < 0) throw FileError(errno, path_.string());
}

StreamFile::~StreamFile() { ::close(file_); }

void StreamFile::write(std::uint64_t offset, std::span<const std::byte> bytes) {
  while (!bytes.empty()) {
    const ssize_t done = ::pwrite(file_, bytes.data(), bytes.size(), static_cast<off_t>(offset));
    if (done < 0 && errno == EINTR) continue;
    if (done <= 0) throw FileError(done < 0 ? errno : ENOSPC, path_.string());
    bytes = bytes.subspan(static_cast<std::size_t>(done));
    offset += static_cast<std::uint64_t>(done);
  }
}

void StreamFile::read(std::uint64_t offset, std::span<std::byte> out) const {
  while (!out.empty()) {
    const ssize_t done = ::pread(file_, out.data(), out.size(), static_cast<off_t>(offset));
    if (done < 0 && errno == EINTR) continue;
    if (done < 0) throw FileError(errno, path_.string());
    if (done == 0) throw FileError(EIO, path_.string() + ": ends early");
    out = out.subspan(static_cast<std::size_t>(done));
    offset += static_cast<std::uint64_t>(done);
  }
}

std::uint64_t StreamFile::size() const {
  struct stat status {};
  if (::fstat(file_, &status) != 0) throw FileError(errno, path_.string());
  return static_cast<std::uint64_t>(status.st_size);
}

}  // namespace hccm
