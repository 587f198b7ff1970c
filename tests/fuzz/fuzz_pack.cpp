// Any bytes as a page of clusters: as they are, and as plain streams (see plain_page.h), else
// nothing would get past zstd. What unpacks packs again to the same blobs.
#include <algorithm>

#include "hccmesh/pack.h"
#include "tests/fuzz/fuzz.h"
#include "tests/fuzz/plain_page.h"

namespace {

using trex::fuzz::require;

void unpack(std::span<const std::byte> packed) {
  hccm::ClusterPage page;
  try {
    page = hccm::unpackClusters(packed);
  } catch (const hccm::FormatError&) {
    return;  // expected
  }
  std::vector<std::span<const std::byte>> blobs;
  for (std::size_t i = 0; i < page.count(); ++i)
    blobs.emplace_back(page.blob(i), page.offsets[i + 1] - page.offsets[i]);
  const hccm::ClusterPage again = hccm::unpackClusters(hccm::packClusters(blobs));
  require(again.bytes == page.bytes && again.offsets == page.offsets);
}

}  // namespace

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const auto bytes = std::as_bytes(std::span(data, size));
  unpack(bytes);
  unpack(trex::fuzz::packedPageOf(bytes));
  return 0;
}
