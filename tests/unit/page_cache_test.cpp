// Pages on disk: the same hits whatever is in memory, a limit that holds, and every damage noticed.
#include "hccmesh/page_cache.h"

#include <gtest/gtest.h>

#include <atomic>
#include <thread>

#include "tests/unit/stream_meshes.h"

namespace hccm::test {
namespace {

Streamed bumpy() { return stream(sheet(110)); }

struct Answer {
  bool hit, occluded;
  Hit best;
};

/// Rays against all groups, in an order of their own.
std::vector<Answer> traceAll(const PagedMesh& mesh, int rays, unsigned seed, bool backwards) {
  std::mt19937 random(seed);
  std::vector<Answer> out;
  for (int i = 0; i < rays; ++i) {
    const glm::vec3 from = randomPoint(random, 0.6f) + glm::vec3(0.0f, 0.0f, 0.3f);
    const glm::vec3 to = randomPoint(random, 0.5f) * glm::vec3(1.0f, 1.0f, 0.2f);
    const Ray ray{from, 0.0f, to - from, std::numeric_limits<float>::infinity()};
    PreparedRay nearest = mesh.prepare(ray), any = mesh.prepare(ray);
    PagedMesh::Pin pin;
    Answer a{};
    for (std::uint32_t k = 0; k < mesh.groupCount(); ++k) {
      const std::uint32_t group = backwards ? mesh.groupCount() - 1 - k : k;
      if (!a.occluded) a.occluded = mesh.occluded(group, any, pin);
      a.hit |= mesh.intersect(group, nearest, a.best, pin);
    }
    out.push_back(a);
  }
  return out;
}

bool same(const Answer& a, const Answer& b) {
  return a.hit == b.hit && a.occluded == b.occluded && a.best.t == b.best.t &&
         a.best.u == b.best.u && a.best.v == b.best.v && a.best.cluster == b.best.cluster &&
         a.best.triangle == b.best.triangle;
}

TEST(PageCache, HitsAreThoseOfAMeshInMemory) {
  const Soup soup = sheet(110);
  Streamed s = stream(soup);
  BuildOptions options;
  options.chooseOrigin = false;
  options.stepExponent = s.table.stepExponent;
  const Mesh whole = build(soup, options);
  const PagedMesh mesh = s.mesh();
  std::mt19937 random(3);
  int hits = 0;
  for (int i = 0; i < 300; ++i) {
    const glm::vec3 from = randomPoint(random, 0.6f), to = randomPoint(random, 0.4f);
    const Ray ray{from, 0.0f, to - from, 10.0f};
    PreparedRay a = mesh.prepare(ray), b = whole.prepare(ray);
    Hit paged, expected;
    PagedMesh::Pin pin;
    for (std::uint32_t g = 0; g < mesh.groupCount(); ++g) mesh.intersect(g, a, paged, pin);
    for (std::uint32_t c = 0; c < whole.clusterCount(); ++c) whole.intersect(c, b, expected);
    pin.release();
    ASSERT_EQ(paged.cluster == Hit::kNothing, expected.cluster == Hit::kNothing);
    if (paged.cluster == Hit::kNothing) continue;
    ++hits;
    // Not equal bits: another cluster may begin a triangle at another of its corners.
    EXPECT_NEAR(paged.t, expected.t, 4e-7f * expected.t);
    const Triangle t = mesh.triangle(paged.cluster, paged.triangle);
    EXPECT_LT(std::abs(t.position[0].z), 0.11f);
  }
  EXPECT_GT(hits, 50);
}

/// The nearest hit of all groups.
Hit nearest(const PagedMesh& mesh, const Ray& ray) {
  PreparedRay prepared = mesh.prepare(ray);
  PagedMesh::Pin pin;
  Hit hit;
  for (std::uint32_t g = 0; g < mesh.groupCount(); ++g) mesh.intersect(g, prepared, hit, pin);
  return hit;
}
bool occluded(const PagedMesh& mesh, const Ray& ray) {
  PreparedRay prepared = mesh.prepare(ray);
  PagedMesh::Pin pin;
  for (std::uint32_t g = 0; g < mesh.groupCount(); ++g) {
    if (mesh.occluded(g, prepared, pin)) return true;
  }
  return false;
}

/// The triangles that a ray leaves and ends on are left out wherever their page is, and no triangle
/// of the same number in another page is.
TEST(PageCache, TheTrianglesThatARayJoinsAreThoseOfTheirPage) {
  Streamed s = bumpy();
  const PagedMesh mesh = s.mesh();
  const auto pages = static_cast<std::uint32_t>(s.table.pages.size());
  std::mt19937 random(5);
  int tried = 0;
  for (int i = 0; i < 100; ++i) {
    const glm::vec3 from = randomPoint(random, 0.3f) + glm::vec3(0.0f, 0.0f, 0.5f);
    const glm::vec3 to = randomPoint(random, 0.3f) * glm::vec3(1.0f, 1.0f, 0.0f);
    const Ray ray{from, 0.0f, to - from, std::numeric_limits<float>::infinity()};
    const Hit hit = nearest(mesh, ray);
    if (hit.cluster == Hit::kNothing) continue;
    ++tried;
    const std::uint32_t place = hit.cluster % kPageClusters, page = hit.cluster / kPageClusters;
    for (const std::uint32_t other : {0u, pages / 2, pages - 1, page}) {
      for (const bool leaves : {true, false}) {
        Ray joined = ray;
        (leaves ? joined.fromCluster : joined.toCluster) = other * kPageClusters + place;
        (leaves ? joined.fromTriangle : joined.toTriangle) = hit.triangle;
        const Hit found = nearest(mesh, joined);
        const bool same = found.cluster == hit.cluster && found.triangle == hit.triangle;
        EXPECT_EQ(same, other != page) << "page " << page << ", named " << other;
        joined.tfar = hit.t * 1.0001f;
        EXPECT_TRUE(other == page || occluded(mesh, joined)) << page << ", named " << other;
      }
    }
  }
  EXPECT_GT(tried, 30);
}

TEST(PageCache, AnyOrderAndAnyCacheGiveTheSameBits) {
  Streamed a = bumpy(), b = bumpy();
  const std::uint64_t least = PageCache::leastBytes(b.table);
  ASSERT_GT(a.table.pages.size(), 20u);
  const PagedMesh all = a.mesh(), few = b.mesh(2 * least);
  const std::vector<Answer> x = traceAll(all, 60, 1, false), y = traceAll(few, 60, 1, true);
  for (std::size_t i = 0; i < x.size(); ++i) EXPECT_TRUE(same(x[i], y[i])) << i;
  EXPECT_EQ(all.statistics().evictions, 0u);
  EXPECT_GT(few.statistics().evictions, 100u);
  EXPECT_LE(few.statistics().peakBytes, 2 * least);
}

TEST(PageCache, TheLimitHoldsWithManyThreads) {
  Streamed s = bumpy(), t = bumpy();
  const std::uint64_t limit = 2 * PageCache::leastBytes(s.table);
  const PagedMesh mesh = s.mesh(limit), all = t.mesh();
  std::atomic<int> wrong{0};
  std::vector<std::thread> threads;
  for (unsigned n = 0; n < 6; ++n) {
    threads.emplace_back([&, n] {
      const std::vector<Answer> x = traceAll(mesh, 12, n, n % 2 == 0),
                                y = traceAll(all, 12, n, false);
      for (std::size_t i = 0; i < x.size(); ++i) wrong += !same(x[i], y[i]);
    });
  }
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(wrong, 0);
  EXPECT_LE(mesh.statistics().peakBytes, limit);
}

TEST(PageCache, APinnedPageStays) {
  Streamed s = bumpy();
  const PagedMesh mesh = s.mesh(3 * PageCache::leastBytes(s.table));
  const PagedMesh::Pin pin = mesh.page(0);
  const Mesh* before = &pin.mesh();
  const auto first = std::vector<std::byte>(pin.mesh().bytes().begin(), pin.mesh().bytes().end());
  for (std::uint32_t p = 1; p < mesh.table().pages.size(); ++p) mesh.page(p);
  EXPECT_GT(mesh.statistics().evictions, 0u);
  const PagedMesh::Pin again = mesh.page(0);
  EXPECT_EQ(&again.mesh(), before);
  EXPECT_TRUE(std::equal(first.begin(), first.end(), pin.mesh().bytes().begin()));
}

TEST(PageCache, ALimitBelowAPageIsRefused) {
  Streamed s = bumpy();
  EXPECT_THROW(s.mesh(PageCache::leastBytes(s.table) - 1), std::invalid_argument);
}

TEST(PageCache, EveryFlippedBitOfAPageIsNoticed) {
  Streamed s = stream(sheet(12));
  ASSERT_FALSE(s.table.pages.empty());
  const PageEntry& entry = s.table.pages[0];
  for (std::uint64_t bit = 0; bit < 8ull * entry.packedBytes; ++bit) {
    std::byte& b = s.pages->bytes[entry.offset + bit / 8];
    b ^= std::byte(1u << bit % 8);
    ASSERT_THROW(loadPage(*s.pages, s.table, 0), FormatError) << bit;
    b ^= std::byte(1u << bit % 8);
  }
  EXPECT_NO_THROW(loadPage(*s.pages, s.table, 0));
}

TEST(PageCache, ErrorsNameThePlaceAndDoNotStick) {
  Streamed s = bumpy();
  TestPages& pages = *s.pages;
  const PagedMesh mesh = s.mesh();
  const std::uint64_t at = mesh.table().pages[2].offset;
  pages.failAt = at;
  for (int i = 0; i < 2; ++i) {
    try {
      mesh.page(2);
      FAIL();
    } catch (const std::runtime_error& e) {
      EXPECT_NE(std::string(e.what()).find("pages.bin, byte " + std::to_string(at)),
                std::string::npos);
    }
  }
  pages.failAt = ~std::uint64_t{0};
  EXPECT_NO_THROW(mesh.page(2));
  const std::uint64_t bytes = mesh.statistics().bytes;
  EXPECT_EQ(bytes, PageCache::bytesOf(mesh.table().pages[2]));
}

TEST(PageCache, PagesThatDifferFromTheTableAreErrors) {
  Streamed s = bumpy();
  const auto bad = [&](auto change) {
    PageTable t = s.table;
    change(t.pages[1]);
    EXPECT_THROW(loadPage(*s.pages, t, 1), FormatError);
  };
  bad([](PageEntry& e) { ++e.clusters; });
  bad([](PageEntry& e) { e.bytes += 4; });
  bad([](PageEntry& e) { ++e.checksum; });
  bad([](PageEntry& e) { --e.packedBytes; });
}

TEST(PageTable, EveryFlippedBitAndEveryCutIsNoticed) {
  const Streamed s = stream(sheet(12));
  const std::vector<std::byte> good = s.table.toBytes();
  const std::uint64_t bytes = s.table.packedBytes();
  EXPECT_EQ(PageTable::fromBytes(good, bytes).toBytes(), good);
  std::vector<std::byte> bad = good;
  for (std::size_t bit = 0; bit < 8 * bad.size(); ++bit) {
    bad[bit / 8] ^= std::byte(1u << bit % 8);
    ASSERT_THROW(PageTable::fromBytes(bad, bytes), FormatError) << bit;
    bad[bit / 8] ^= std::byte(1u << bit % 8);
  }
  for (std::size_t n = 0; n < good.size(); n += 3)
    ASSERT_THROW(PageTable::fromBytes(std::span(good).first(n), bytes), FormatError) << n;
  bad.push_back(std::byte{0});
  EXPECT_THROW(PageTable::fromBytes(bad, bytes), FormatError);
  EXPECT_THROW(PageTable::fromBytes(good, bytes + 1), FormatError);
  EXPECT_THROW(PageTable::fromBytes(good, bytes - 1), FormatError);
}

}  // namespace
}  // namespace hccm::test
