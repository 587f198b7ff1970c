#include "src/bundle/page_file.h"

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>

namespace trex::bundle {

FilePages::FilePages(const std::filesystem::path& path, std::uint64_t start, ExitCode code)
    : name_(path.string()),
      start_(start),
      code_(code),
      file_(::open(path.c_str(), O_RDONLY | O_CLOEXEC)) {
  if (file_ < 0) fail(code_, "{}: can't be opened: {}", name_, std::strerror(errno));
}

FilePages::~FilePages() { ::close(file_); }

void FilePages::read(std::uint64_t offset, std::span<std::byte> out) const {
  const std::string where = place(offset);
  for (offset += start_; !out.empty();) {
    const ssize_t got = ::pread(file_, out.data(), out.size(), static_cast<off_t>(offset));
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) fail(code_, "{}: can't be read: {}", where, std::strerror(errno));
    if (got == 0)
      fail(code_, "{}: the file ends before; it was cut off since it was opened", where);
    out = out.subspan(static_cast<std::size_t>(got));
    offset += static_cast<std::uint64_t>(got);
  }
}

void FilePages::readAhead(std::uint64_t offset, std::uint64_t bytes) const {
  ::posix_fadvise(file_, static_cast<off_t>(start_ + offset), static_cast<off_t>(bytes),
                  POSIX_FADV_WILLNEED);
}

std::string FilePages::place(std::uint64_t offset) const {
  return fmt::format("{}, byte {}", name_, start_ + offset);
}

void MemoryPages::read(std::uint64_t offset, std::span<std::byte> out) const {
  if (offset > section_.size() || out.size() > section_.size() - offset) {
    fail(ExitCode::kInput, "{}: lies outside of its section; bake again", place(offset));
  }
  if (!out.empty()) std::memcpy(out.data(), section_.data() + offset, out.size());
}

std::string MemoryPages::place(std::uint64_t offset) const {
  return fmt::format("{}, byte {}", name_, start_ + offset);
}

}  // namespace trex::bundle
