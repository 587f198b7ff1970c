#include "src/bundle/page_disk.h"

#include <sys/vfs.h>

#include "src/core/error.h"
#include "src/core/log.h"
#include "src/scene/temporary_file.h"

namespace trex {
namespace {

// Of statfs(2): tmpfs and ramfs.
constexpr auto kTmpfs = 0x01021994, kRamfs = static_cast<int>(0x858458f6);

}  // namespace

std::uint64_t spareDisk(const std::filesystem::path& folder) {
  struct statfs disk {};
  if (::statfs(folder.c_str(), &disk) != 0) return 0;
  const auto type = static_cast<int>(disk.f_type);
  if (type == kTmpfs || type == kRamfs) return 0;
  return std::uint64_t{disk.f_bavail} * static_cast<std::uint64_t>(disk.f_bsize) / 2;
}

int openPageDisk(const std::filesystem::path& folder, std::uint64_t limit, const char* instead) {
  if (limit == 0) return -1;
  try {
    return detail::openTemporaryFile(folder);
  } catch (const Error& e) {
    logWarning("{}; {}", e.what(), instead);
    return -1;
  }
}

std::unique_ptr<hccm::UnpackedPages> openUnpackedPages(const std::filesystem::path& folder,
                                                       std::uint64_t limit, std::size_t pages) {
  const int file = openPageDisk(folder, limit, "pages are unpacked each time that they are loaded");
  if (file < 0) return {};
  return std::make_unique<hccm::UnpackedPages>(file, limit, pages);
}

}  // namespace trex
