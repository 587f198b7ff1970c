// Small sources, page files in memory, and streamed meshes for tests.
#pragma once

#include <sys/mman.h>
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <filesystem>
#include <numeric>
#include <string>
#include <thread>
#include <vector>

#include "hccmesh/page_cache.h"
#include "hccmesh/stream.h"
#include "tests/unit/hccmesh_meshes.h"

namespace hccm::test {

/// Triangles in memory, a few a batch.
class SoupSource : public StreamSource {
 public:
  SoupSource(const Soup& soup, std::size_t perBatch = 100, std::uint32_t materials = 1)
      : soup_(soup), perBatch_(perBatch), materials_(materials) {
    for (const glm::uvec3& t : soup.triangles)
      for (int k = 0; k < 3; ++k) {
        positions_.push_back(soup.positions[t[k]]);
        if (!soup.normals.empty()) normals_.push_back(soup.normals[t[k]]);
        if (!soup.texCoords.empty()) texCoords_.push_back(soup.texCoords[t[k]]);
        if (!soup.secondTexCoords.empty()) secondTexCoords_.push_back(soup.secondTexCoords[t[k]]);
        if (!soup.colors.empty()) colors_.push_back(soup.colors[t[k]]);
      }
  }
  std::uint64_t batchCount() const override {
    return (soup_.triangles.size() + perBatch_ - 1) / perBatch_;
  }
  void read(std::uint64_t number,
            const std::function<void(const StreamBatch&)>& use) const override {
    const std::size_t first = number * perBatch_;
    const std::size_t count = std::min(perBatch_, soup_.triangles.size() - first);
    const auto part = [&](const auto& array) {
      return array.empty() ? std::span(array) : std::span(array).subspan(3 * first, 3 * count);
    };
    std::vector<StreamBatch::Run> runs;
    for (std::size_t i = 0; i < count; i += 10) {
      const auto kind = static_cast<std::uint32_t>((first + i) / 10 % materials_);
      runs.push_back({kind, kind * 7, std::min<std::size_t>(10, count - i)});
    }
    use({glm::dvec3(0.0), part(positions_), part(normals_), part(texCoords_), part(colors_),
         part(secondTexCoords_), runs});
  }

 private:
  const Soup& soup_;
  std::size_t perBatch_;
  std::uint32_t materials_;
  std::vector<glm::vec3> positions_, normals_;
  std::vector<glm::vec2> texCoords_, secondTexCoords_;
  std::vector<glm::u8vec4> colors_;
};

/// Pages in memory; counts reads, and fails where it is told to.
class TestPages : public PageFile {
 public:
  std::vector<std::byte> bytes;
  mutable std::atomic<std::uint64_t> reads{0};
  std::uint64_t failAt = ~std::uint64_t{0};  ///< offset that can't be read
  double readSeconds = 0.0;                  ///< that each read takes
  unsigned atOnce = 1;                       ///< parts that are to be asked for at once
  mutable std::atomic<std::size_t> most{0};  ///< that were
  FileSpeed told{};                          ///< what is said to be known of it
  void read(std::uint64_t offset, std::span<std::byte> out) const override {
    ++reads;
    if (readSeconds > 0.0) std::this_thread::sleep_for(std::chrono::duration<double>(readSeconds));
    if (offset == failAt) throw std::runtime_error(place(offset) + ": can't be read");
    if (offset + out.size() > bytes.size()) throw std::runtime_error("read beyond the end");
    std::copy_n(bytes.begin() + static_cast<std::ptrdiff_t>(offset), out.size(), out.begin());
  }
  void readAll(std::span<const FilePart> parts) const override {
    if (parts.size() > most) most = parts.size();
    PageFile::readAll(parts);
  }
  unsigned partsAtOnce() const override { return atOnce; }
  FileSpeed speed() const override { return told; }
  void readAhead(std::uint64_t, std::uint64_t) const override {}
  std::string place(std::uint64_t offset) const override {
    return "pages.bin, byte " + std::to_string(offset);
  }
};

struct Streamed {
  Spill spill;
  PageTable table;
  std::unique_ptr<TestPages> pages = std::make_unique<TestPages>();
  std::size_t buckets = 0;

  PagedMesh mesh(std::uint64_t cacheBytes = std::uint64_t{1} << 30,
                 std::unique_ptr<UnpackedPages> kept = {}) {
    return PagedMesh(table, std::move(pages), cacheBytes, 0xffffffffu, std::move(kept));
  }
};

/// A file of so many bytes at most, whose descriptor goes to `file`, for pages that are kept
/// however long that takes.
inline std::unique_ptr<UnpackedPages> keptPages(std::size_t pages, std::uint64_t limit = ~0ull,
                                                int* file = nullptr) {
  const int descriptor = ::memfd_create("trex-test", MFD_CLOEXEC);
  if (file != nullptr) *file = descriptor;
  return std::make_unique<UnpackedPages>(descriptor, limit, pages, false);
}

inline std::filesystem::path spillPath() {
  return std::filesystem::temp_directory_path() / ("trex-spill-test-" + std::to_string(::getpid()));
}

/// Builds with buckets of 16384 triangles, the least.
inline Streamed stream(const StreamSource& source, const glm::dvec3& lower, const glm::dvec3& upper,
                       std::uint64_t memoryBytes = 1) {
  StreamOptions options;
  options.grid = StreamGrid::make(lower, upper, 24);
  options.memoryBytes = memoryBytes;
  const std::filesystem::path file = spillPath();
  Streamed out;
  out.spill = spillTriangles(source, options, file);
  const std::vector<Bucket> buckets = planBuckets(out.spill, options);
  out.buckets = buckets.size();
  out.table.stepExponent = options.grid.stepExponent;
  buildPages(
      file, out.spill, buckets, 0, options,
      [&](const BuiltPage& page) {
        out.table.add(page);
        out.pages->bytes.insert(out.pages->bytes.end(), page.packed.begin(), page.packed.end());
      },
      [](std::size_t) {});
  std::filesystem::remove(file);
  return out;
}

inline Streamed stream(const Soup& soup, std::uint32_t materials = 1) {
  glm::dvec3 lower(1e300), upper(-1e300);
  for (const glm::vec3& p : soup.positions) {
    if (!std::isfinite(p.x + p.y + p.z)) continue;
    lower = glm::min(lower, glm::dvec3(p));
    upper = glm::max(upper, glm::dvec3(p));
  }
  if (!(lower.x <= upper.x)) lower = upper = glm::dvec3(0.0);
  return stream(SoupSource(soup, 100, materials), lower, upper);
}

}  // namespace hccm::test
