#include "src/machines/remote_file.h"

#include <algorithm>

namespace trex::machines {
namespace {

constexpr std::size_t kPartBytes = 4u << 20;  // of a file, asked for at once

}  // namespace

void RemoteFile::read(std::uint64_t offset, std::span<std::byte> out) const {
  while (!out.empty()) {
    const hccm::FilePart one{offset, out.first(std::min(out.size(), kPartBytes))};
    read_({&one, 1});
    offset += one.out.size();
    out = out.subspan(one.out.size());
  }
}

void RemoteFile::readAll(std::span<const hccm::FilePart> parts) const {
  while (!parts.empty()) {
    std::size_t count = 0;
    for (std::size_t bytes = 0; count < parts.size(); ++count) {
      bytes += parts[count].out.size();
      if (bytes > kPartBytes) break;
    }
    if (count == 0) {
      read(parts[0].offset, parts[0].out);
      count = 1;
    } else {
      read_(parts.first(count));
    }
    parts = parts.subspan(count);
  }
}

void giveOut(std::span<const std::byte> came, std::span<const hccm::FilePart> parts) {
  for (const hccm::FilePart& part : parts) {
    std::copy_n(came.begin(), part.out.size(), part.out.begin());
    came = came.subspan(part.out.size());
  }
}

}  // namespace trex::machines
