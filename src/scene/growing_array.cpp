#include "src/scene/growing_array.h"

#include <fcntl.h>
#include <sys/mman.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <new>
#include <string>

#include "src/core/error.h"
#include "src/scene/temporary_file.h"

namespace trex::detail {

GrowingMemory::~GrowingMemory() {
  if (data_ != nullptr) ::munmap(data_, capacity_);
  if (file_ >= 0) ::close(file_);
}

GrowingMemory& GrowingMemory::operator=(GrowingMemory&& other) noexcept {
  std::swap(folder_, other.folder_);
  std::swap(file_, other.file_);
  std::swap(data_, other.data_);
  std::swap(capacity_, other.capacity_);
  return *this;
}

void GrowingMemory::openFile() {
  if (file_ >= 0) return;
  file_ = openTemporaryFile(folder_);
}

void GrowingMemory::reserve(std::size_t bytes) {
  if (bytes <= capacity_) return;
  constexpr std::size_t kLeast = std::size_t{1} << 16;
  std::size_t wanted = std::max({bytes, capacity_ + capacity_ / 2, kLeast});
  wanted = (wanted + kLeast - 1) / kLeast * kLeast;
  if (inFile()) {
    openFile();
    // Pages without blocks on the disk would be a signal, not an error, when it is full.
    const int error = ::posix_fallocate(file_, 0, static_cast<off_t>(wanted));
    if (error != 0) {
      fail(ExitCode::kOutput, "{}: {} bytes of a temporary file can't be written: {}",
           folder_.string(), wanted, std::strerror(error));
    }
  }
  void* at = data_ != nullptr
                 ? ::mremap(data_, capacity_, wanted, MREMAP_MAYMOVE)
                 : ::mmap(nullptr, wanted, PROT_READ | PROT_WRITE,
                          inFile() ? MAP_SHARED : MAP_PRIVATE | MAP_ANONYMOUS, file_, 0);
  if (at == MAP_FAILED) throw std::bad_alloc();
  data_ = static_cast<std::byte*>(at);
  capacity_ = wanted;
}

void GrowingMemory::forget() const {
  if (inFile() && data_ != nullptr) ::madvise(data_, capacity_, MADV_DONTNEED);
}

}  // namespace trex::detail
