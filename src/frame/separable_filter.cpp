#include "src/frame/separable_filter.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>

namespace trex {
namespace {

/// out += factor * in; vectorised by the compiler.
void addScaled(float* out, const float* in, float factor, std::size_t count) {
  for (std::size_t i = 0; i < count; ++i) out[i] += factor * in[i];
}

template <typename Row>
void forRows(std::uint32_t height, const Row& row) {
  tbb::parallel_for(tbb::blocked_range<std::uint32_t>(0, height),
                    [&](const tbb::blocked_range<std::uint32_t>& range) {
                      for (std::uint32_t y = range.begin(); y < range.end(); ++y) row(y);
                    });
}

}  // namespace

Plane filterRows(const Plane& in, const Kernel& across) {
  const std::size_t radius = across.size() / 2;
  Plane out(in.width, in.height);
  forRows(in.height, [&](std::uint32_t y) {
    const float* source = in.row(y);
    std::vector<float> padded(in.width + 2 * radius);
    std::fill_n(padded.begin(), radius, source[0]);
    std::copy_n(source, in.width, padded.begin() + static_cast<std::ptrdiff_t>(radius));
    std::fill_n(padded.end() - static_cast<std::ptrdiff_t>(radius), radius, source[in.width - 1]);
    for (std::size_t t = 0; t < across.size(); ++t) {
      addScaled(out.row(y), padded.data() + t, across[t], in.width);
    }
  });
  return out;
}

Plane filterColumns(const Plane& in, const Kernel& down) {
  const auto radius = static_cast<std::int64_t>(down.size() / 2);
  Plane out(in.width, in.height);
  forRows(in.height, [&](std::uint32_t y) {
    for (std::size_t t = 0; t < down.size(); ++t) {
      const std::int64_t from = std::clamp<std::int64_t>(
          std::int64_t{y} + static_cast<std::int64_t>(t) - radius, 0, std::int64_t{in.height} - 1);
      addScaled(out.row(y), in.row(static_cast<std::uint32_t>(from)), down[t], in.width);
    }
  });
  return out;
}

}  // namespace trex
