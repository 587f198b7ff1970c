#include "src/frame/png.h"

#include <zlib.h>

#include <algorithm>
#include <cstdlib>
#include <new>
#include <string_view>

namespace trex {
namespace {

using Bytes = std::vector<std::uint8_t>;

constexpr int kFilters = 5;  // none, left, up, mean of both, Paeth's

void putNumber(Bytes& to, std::uint32_t n) {
  for (int shift = 24; shift >= 0; shift -= 8) to.push_back(static_cast<std::uint8_t>(n >> shift));
}

void putChunk(Bytes& to, std::string_view name, std::span<const std::uint8_t> data) {
  putNumber(to, static_cast<std::uint32_t>(data.size()));
  const std::size_t start = to.size();
  to.insert(to.end(), name.begin(), name.end());
  to.insert(to.end(), data.begin(), data.end());
  const uLong sum = crc32(0, to.data() + start, static_cast<uInt>(to.size() - start));
  putNumber(to, static_cast<std::uint32_t>(sum));
}

int paeth(int left, int up, int corner) {
  const int value = left + up - corner;
  const int l = std::abs(value - left), u = std::abs(value - up), c = std::abs(value - corner);
  return l <= u && l <= c ? left : u <= c ? up : corner;
}

int predicted(int filter, int left, int up, int corner) {
  switch (filter) {
    case 1:
      return left;
    case 2:
      return up;
    case 3:
      return (left + up) / 2;
    case 4:
      return paeth(left, up, corner);
    default:
      return 0;
  }
}

/// A row by each filter, of which the one is added that leaves the least.
class RowFilter {
 public:
  explicit RowFilter(std::size_t pixelBytes) : pixel_(pixelBytes) {}

  void add(std::span<const std::uint8_t> row, std::span<const std::uint8_t> above, Bytes& to) {
    long least = -1;
    for (int filter = 0; filter < kFilters; ++filter) {
      const long sum = apply(filter, row, above);
      if (least >= 0 && sum >= least) continue;
      least = sum;
      best_.swap(tried_);
    }
    to.insert(to.end(), best_.begin(), best_.end());
  }

 private:
  /// Into tried_; the sum of what is left of all bytes.
  long apply(int filter, std::span<const std::uint8_t> row, std::span<const std::uint8_t> above) {
    tried_.assign(1, static_cast<std::uint8_t>(filter));
    long sum = 0;
    for (std::size_t i = 0; i < row.size(); ++i) {
      const bool first = i < pixel_;
      const int left = first ? 0 : row[i - pixel_], up = above.empty() ? 0 : above[i],
                corner = first || above.empty() ? 0 : above[i - pixel_];
      const auto rest = static_cast<std::uint8_t>(row[i] - predicted(filter, left, up, corner));
      sum += rest < 128 ? rest : 256 - rest;
      tried_.push_back(rest);
    }
    return sum;
  }

  std::size_t pixel_;
  Bytes tried_, best_;
};

Bytes compressed(const Bytes& data) {
  uLongf size = compressBound(data.size());
  Bytes out(size);
  if (compress2(out.data(), &size, data.data(), data.size(), 6) != Z_OK) throw std::bad_alloc();
  out.resize(size);
  return out;
}

/// `values` as they lie in the file.
Bytes encode(std::uint32_t width, std::uint32_t height, bool alpha, int bits,
             std::span<const std::uint8_t> values) {
  const std::size_t pixelBytes = static_cast<std::size_t>((alpha ? 4 : 3) * bits / 8),
                    rowBytes = pixelBytes * width;
  Bytes rows;
  rows.reserve((rowBytes + 1) * height);
  RowFilter filter(pixelBytes);
  std::span<const std::uint8_t> above;
  for (std::size_t y = 0; y < height; ++y) {
    const auto row = values.subspan(y * rowBytes, rowBytes);
    filter.add(row, above, rows);
    above = row;
  }
  Bytes head;
  putNumber(head, width);
  putNumber(head, height);
  constexpr std::uint8_t kColor = 2, kColorAndAlpha = 6, kAsSeen = 0;
  head.insert(head.end(),
              {static_cast<std::uint8_t>(bits), alpha ? kColorAndAlpha : kColor, 0, 0, 0});
  Bytes file{0x89, 'P', 'N', 'G', '\r', '\n', 0x1a, '\n'};
  putChunk(file, "IHDR", head);
  putChunk(file, "sRGB", Bytes{kAsSeen});
  // A chunk holds less than 2^31 bytes.
  constexpr std::size_t kMost = std::size_t{1} << 30;
  const Bytes data = compressed(rows);
  for (std::size_t at = 0; at < data.size(); at += kMost) {
    putChunk(file, "IDAT", std::span(data).subspan(at, std::min(kMost, data.size() - at)));
  }
  putChunk(file, "IEND", {});
  return file;
}

}  // namespace

Bytes encodePng(std::uint32_t width, std::uint32_t height, bool alpha,
                std::span<const std::uint8_t> values) {
  return encode(width, height, alpha, 8, values);
}

Bytes encodePng(std::uint32_t width, std::uint32_t height, bool alpha,
                std::span<const std::uint16_t> values) {
  Bytes bytes;
  bytes.reserve(values.size() * 2);
  for (const std::uint16_t v : values) {
    bytes.push_back(static_cast<std::uint8_t>(v >> 8));
    bytes.push_back(static_cast<std::uint8_t>(v));
  }
  return encode(width, height, alpha, 16, bytes);
}

}  // namespace trex
