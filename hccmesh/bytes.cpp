#include "hccmesh/bytes.h"

#include <sys/mman.h>

#include <cstdlib>
#include <cstring>
#include <new>

namespace hccm {
namespace {

constexpr std::size_t kHugePage = std::size_t{2} << 20;

}  // namespace

Bytes::Bytes(std::size_t size) : size_(size) {
  const bool huge = size >= 4 * kHugePage;
  const std::size_t unit = huge ? kHugePage : 64;
  const std::size_t whole = (size + unit - 1) / unit * unit;
  data_.reset(static_cast<std::byte*>(std::aligned_alloc(unit, whole > 0 ? whole : unit)));
  if (!data_) throw std::bad_alloc();
  if (huge) (void)madvise(data_.get(), whole, MADV_HUGEPAGE);  // a hint: may fail
  std::memset(data_.get(), 0, size);
}

void Bytes::Free::operator()(std::byte* at) const { std::free(at); }

}  // namespace hccm
