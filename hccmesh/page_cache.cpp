#include "hccmesh/page_cache.h"

#include <algorithm>
#include <bit>
#include <chrono>
#include <cmath>

namespace hccm {
namespace {

/// No triangles, just the grid.
Mesh emptyMesh(int stepExponent) {
  BuildOptions options;
  options.chooseOrigin = false;
  options.stepExponent = stepExponent;
  return Mesh::build({}, options);
}

/// A ray against a box, wider than the tests inside. Where it is entered goes to `entry`, cells.
bool meets(const float* lower, const float* upper, const PreparedRay& ray, float& entry) {
  constexpr float kTolerance = 0x1p-18f;  // twice that of trace.cpp
  float nearest = ray.tnear, farthest = ray.tfar;
  for (int k = 0; k < 3; ++k) {
    const auto cell = static_cast<float>(ray.cell[k]);
    const float a = (lower[k] * ray.cells - cell - ray.origin[k]) * ray.inverse[k];
    const float b = (upper[k] * ray.cells - cell - ray.origin[k]) * ray.inverse[k];
    nearest = std::max(nearest, std::min(a, b));
    farthest = std::min(farthest, std::max(a, b));
  }
  entry = nearest - std::abs(nearest) * kTolerance;
  return entry <= farthest + std::abs(farthest) * kTolerance;
}

bool meets(const Mesh& mesh, std::uint32_t cluster, const PreparedRay& ray, float& entry) {
  glm::vec3 lower, upper;
  mesh.clusterBounds(cluster, lower, upper);
  return meets(&lower.x, &upper.x, ray, entry);
}

constexpr std::uint64_t kOverhead = 512;  ///< of a page: the object and its allocations, bytes
constexpr std::uint32_t kReadAhead = 3;   ///< pages behind a missing one

thread_local double waited = 0.0;

/// Counts its life as waiting of the thread.
class WaitClock {
 public:
  WaitClock() : start_(std::chrono::steady_clock::now()) {}
  ~WaitClock() {
    waited += std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count();
  }
  WaitClock(const WaitClock&) = delete;
  WaitClock& operator=(const WaitClock&) = delete;

 private:
  std::chrono::steady_clock::time_point start_;
};

}  // namespace

void PageCache::Pin::release() {
  if (cache_ != nullptr) std::exchange(cache_, nullptr)->unpin(page_);
}

PageCache::PageCache(const PageFile& file, const PageTable& table, std::uint64_t limit,
                     std::uint32_t materials, std::unique_ptr<UnpackedPages> kept)
    : file_(file),
      table_(table),
      limit_(limit),
      materials_(materials),
      kept_(std::move(kept)),
      grid_(emptyMesh(table.stepExponent)),
      slots_(table.pages.size()) {
  if (limit < leastBytes(table))
    throw std::invalid_argument("a cache of " + std::to_string(limit) +
                                " bytes does not hold the largest page, which takes " +
                                std::to_string(leastBytes(table)));
}

PageCache::~PageCache() = default;

std::uint64_t PageCache::bytesOf(const PageEntry& entry) {
  return entry.bytes + 4ull * entry.clusters + kOverhead;
}

std::uint64_t PageCache::leastBytes(const PageTable& table) {
  std::uint64_t most = 0;
  for (const PageEntry& p : table.pages) most = std::max(most, bytesOf(p));
  return most;
}

bool PageCache::holdsAll() const {
  std::uint64_t all = 0;
  for (const PageEntry& page : table_.pages) all += bytesOf(page);
  return all <= limit_;
}

bool PageCache::tryPin(Slot& slot) {
  std::int32_t pins = slot.state.load(std::memory_order_relaxed);
  while (pins >= 0)
    if (slot.state.compare_exchange_weak(pins, pins + 1, std::memory_order_acquire)) return true;
  return false;
}

/// Of a page that the caller has pinned.
PageCache::Pin PageCache::pinned(std::uint32_t page) {
  Slot& slot = slots_[page];
  if (slot.used.load(std::memory_order_relaxed) == 0) slot.used.store(1, std::memory_order_relaxed);
  Pin out;
  out.cache_ = this;
  out.page_ = page;
  out.mesh_ = slot.mesh.get();
  return out;
}

PageCache::Pin PageCache::pin(std::uint32_t page) {
  return tryPin(slots_[page]) ? pinned(page) : load(page, {});
}

PageCache::Pin PageCache::pin(std::uint32_t page, std::span<const std::byte> packed) {
  return tryPin(slots_[page]) ? pinned(page) : load(page, packed);
}

double PageCache::secondsWaited() { return waited; }

void PageCache::wait(std::unique_lock<std::mutex>& lock) {
  const WaitClock clock;
  changed_.wait(lock);
}

PageCache::Pin PageCache::pinIfHere(std::uint32_t page) {
  return tryPin(slots_[page]) ? pinned(page) : Pin();
}

void PageCache::unpin(std::uint32_t page) {
  slots_[page].state.fetch_sub(1);
  if (waiting_.load() == 0) return;
  const std::lock_guard lock(mutex_);  // so that no waiter misses it between test and wait
  changed_.notify_all();
}

/// Evicts a page of present_. False if it is pinned. The lock is held.
bool PageCache::giveUp(std::size_t place) {
  const std::uint32_t page = present_[place];
  Slot& slot = slots_[page];
  std::int32_t unpinned = 0;
  if (!slot.state.compare_exchange_strong(unpinned, kBusy)) return false;
  slot.mesh.reset();
  slot.state.store(kAbsent);
  present_[place] = present_.back();
  slots_[present_[place]].place = static_cast<std::uint32_t>(place);
  present_.pop_back();
  statistics_.bytes -= bytesOf(table_.pages[page]);
  ++statistics_.evictions;
  return true;
}

bool PageCache::evict(std::uint32_t page) {
  const std::lock_guard lock(mutex_);
  // Pages are there for good only while the lock is held: one that is being loaded has no place.
  const std::size_t place = slots_[page].place;
  return place < present_.size() && present_[place] == page && giveUp(place);
}

/// Evicts the next page that is neither pinned nor was used since the hand passed it last. False if
/// all are pinned. The lock is held.
bool PageCache::evictOne() {
  for (std::size_t step = 0; step < 2 * present_.size(); ++step) {
    if (hand_ >= present_.size()) hand_ = 0;
    Slot& slot = slots_[present_[hand_]];
    if (slot.used.exchange(0, std::memory_order_relaxed) == 0 && giveUp(hand_)) return true;
    ++hand_;
  }
  return false;
}

/// Makes room, and counts the bytes as taken.
void PageCache::reserve(std::uint64_t bytes, std::unique_lock<std::mutex>& lock) {
  while (statistics_.bytes + bytes > limit_) {
    if (evictOne()) continue;
    ++waiting_;
    // An unpin between evictOne() and here is seen by the second look.
    if (!evictOne()) wait(lock);
    --waiting_;
  }
  statistics_.bytes += bytes;
  statistics_.peakBytes = std::max(statistics_.peakBytes, statistics_.bytes);
}

/// A page that was unpacked before, or null.
std::unique_ptr<Mesh> PageCache::restore(std::uint32_t page) {
  if (!isKept(page)) return {};
  const PageEntry& entry = table_.pages[page];
  const std::size_t size = Mesh::pageBytes(entry.clusters, entry.bytes);
  std::shared_ptr<std::byte[]> bytes = std::make_unique_for_overwrite<std::byte[]>(size);
  const std::span<std::byte> all(bytes.get(), size);
  if (!kept_->read(page, all)) return {};
  return std::make_unique<Mesh>(Mesh::fromPageAgain(all, std::move(bytes), grid_));
}

std::unique_ptr<Mesh> PageCache::unpack(std::uint32_t page, std::span<const std::byte> packed) {
  const ThreadMoment start = threadMoment();
  bool& known = slots_[page].known;
  auto mesh =
      std::make_unique<Mesh>(Mesh::fromPage(unpackPage(file_, table_, page, packed, known), grid_));
  for (std::uint32_t c = 0; c < mesh->clusterCount() && !known; ++c)
    if (mesh->clusterMaterial(c) >= materials_)
      throw FormatError(file_.place(table_.pages[page].offset) + ": page " + std::to_string(page) +
                        " has a material that does not exist");
  known = true;
  if (kept_) {
    const double unpacked = secondsTaken(start, threadMoment());
    kept_->keep(page, mesh->bytes(), unpacked + secondsToSend(page));
  }
  return mesh;
}

/// Of a file that another machine has, where that takes a link's time.
double PageCache::secondsToSend(std::uint32_t page) const {
  const FileSpeed speed = file_.speed();
  return speed.bandwidth > 0.0 ? table_.pages[page].packedBytes / speed.bandwidth : 0.0;
}

/// Pages behind one that is about to be read.
void PageCache::readAhead(std::uint32_t page) const {
  const std::uint32_t last =
      std::min<std::uint32_t>(page + kReadAhead, static_cast<std::uint32_t>(slots_.size()) - 1);
  if (last == page) return;
  const PageEntry& next = table_.pages[page + 1];
  file_.readAhead(next.offset,
                  table_.pages[last].offset + table_.pages[last].packedBytes - next.offset);
}

/// `packed`: its bytes, or nothing: then they are read.
PageCache::Pin PageCache::load(std::uint32_t page, std::span<const std::byte> packed) {
  Slot& slot = slots_[page];
  const PageEntry& entry = table_.pages[page];
  std::unique_lock lock(mutex_);
  for (;;) {  // until the page is there, or is ours to load
    if (tryPin(slot)) break;
    std::int32_t absent = kAbsent;
    if (!slot.state.compare_exchange_strong(absent, kBusy)) {
      wait(lock);
      continue;
    }
    bool restored = false;
    try {
      reserve(bytesOf(entry), lock);
      lock.unlock();
      slot.mesh = packed.empty() ? restore(page) : nullptr;
      restored = slot.mesh != nullptr;
      if (!restored) {
        thread_local std::vector<std::byte> bytes;  // one a thread, not counted by the limit
        if (packed.empty()) {
          readAhead(page);
          const WaitClock clock;
          readPage(file_, table_, page, bytes);
        }
        slot.mesh = unpack(page, packed.empty() ? bytes : packed);
      }
      lock.lock();
    } catch (...) {
      if (!lock.owns_lock()) lock.lock();
      statistics_.bytes -= bytesOf(entry);
      slot.state.store(kAbsent);
      changed_.notify_all();
      throw;
    }
    slot.place = static_cast<std::uint32_t>(present_.size());
    present_.push_back(page);
    ++statistics_.loads;
    statistics_.restored += restored;
    if (!restored) statistics_.bytesRead += entry.packedBytes;
    slot.state.store(1);
    changed_.notify_all();
    break;
  }
  return pinned(page);
}

PageCache::Statistics PageCache::statistics() const {
  const std::lock_guard lock(mutex_);
  Statistics all = statistics_;
  if (kept_) all.keptBytes = kept_->bytes();
  return all;
}

PagedMesh::PagedMesh(PageTable table, std::unique_ptr<PageFile> file, std::uint64_t cacheBytes,
                     std::uint32_t materials, std::unique_ptr<UnpackedPages> kept)
    : table_(std::move(table)),
      file_(std::move(file)),
      grid_(emptyMesh(table_.stepExponent)),
      cache_(*file_, table_, cacheBytes, materials, std::move(kept)) {}

double PagedMesh::errorBound() const { return std::sqrt(0.75) * grid_.step(); }

void PagedMesh::reach(std::uint32_t page, Pin& pin) const {
  if (pin.holds(page)) return;
  pin.release();  // a thread that waits holds nothing
  pin = cache_.pin(page);
}

float PagedMesh::entry(std::uint32_t group, const PreparedRay& ray) const {
  constexpr float kRounding = 0x1p-20f;
  const PageGroup& g = table_.groups[group];
  float cells;
  meets(g.lower, g.upper, ray, cells);
  const auto t = static_cast<float>((double(cells) + ray.shift) / double(ray.cells));
  return t - std::abs(t) * kRounding;
}

bool PagedMesh::comes(std::uint32_t group, Pin& pin) const {
  const std::uint32_t page = table_.groups[group].page;
  if (fetcher_ == nullptr || waits_.load(std::memory_order_relaxed)) {
    reach(page, pin);
    return true;
  }
  if (reachIfHere(group, pin)) return true;
  fetcher_->miss(page);
  return false;
}

bool PagedMesh::reachIfHere(std::uint32_t group, Pin& pin) const {
  const std::uint32_t page = table_.groups[group].page;
  if (!pin.holds(page)) pin = cache_.pinIfHere(page);
  return pin.holds(page);
}

namespace {

/// While it lives, the triangles that a ray leaves and ends on are named as the page names them.
class AsInPage {
 public:
  AsInPage(PreparedRay& ray, std::uint32_t base) : ray_(ray), base_(base) {
    ray_.fromCluster -= base_, ray_.toCluster -= base_;
  }
  ~AsInPage() { ray_.fromCluster += base_, ray_.toCluster += base_; }
  AsInPage(const AsInPage&) = delete;
  AsInPage& operator=(const AsInPage&) = delete;

 private:
  PreparedRay& ray_;
  std::uint32_t base_;
};

}  // namespace

bool PagedMesh::intersect(std::uint32_t group, PreparedRay& ray, Hit& hit, Pin& pin) const {
  const PageGroup& g = table_.groups[group];
  reach(g.page, pin);
  const std::uint32_t base = g.page * kPageClusters;
  // Inside the page clusters count from 0; what was hit in another is below or above all of these.
  Hit local = hit;
  if (hit.cluster != Hit::kNothing) {
    const std::uint32_t page = hit.cluster / kPageClusters;
    if (page == g.page) {
      local.cluster = hit.cluster - base;
    } else if (page > g.page) {
      local.cluster = Hit::kNothing;
    } else {
      local.cluster = local.triangle = 0;
    }
  }
  const Mesh& mesh = pin.mesh();
  const AsInPage inPage(ray, base);
  bool found = false;
  if (g.count == 1) {
    found = mesh.intersect(g.first, ray, local);
  } else {
    float entry[kGroupClusters];
    std::uint32_t met = 0;
    for (std::uint32_t i = 0; i < g.count; ++i)
      if (meets(mesh, g.first + i, ray, entry[i])) met |= 1u << i;
    while (met != 0) {  // nearest box first
      int next = std::countr_zero(met);
      for (std::uint32_t rest = met & (met - 1); rest != 0; rest &= rest - 1)
        if (entry[std::countr_zero(rest)] < entry[next]) next = std::countr_zero(rest);
      if (entry[next] > ray.tfar) break;
      met &= ~(1u << next);
      found |= mesh.intersect(g.first + static_cast<std::uint32_t>(next), ray, local);
    }
  }
  if (!found) return false;
  hit = local;
  hit.cluster += base;
  return true;
}

bool PagedMesh::occluded(std::uint32_t group, PreparedRay& ray, Pin& pin) const {
  const PageGroup& g = table_.groups[group];
  reach(g.page, pin);
  const Mesh& mesh = pin.mesh();
  const AsInPage inPage(ray, g.page * kPageClusters);
  bool found = false;
  for (std::uint32_t c = g.first; !found && c < std::uint32_t{g.first} + g.count; ++c) {
    float entry;
    found = (g.count == 1 || meets(mesh, c, ray, entry)) && mesh.occluded(c, ray);
  }
  return found;
}

namespace {

/// One that is as good as any other, for who will not use what it leads to.
Triangle someTriangle() {
  Triangle t{};
  t.position[1].x = t.position[2].y = 1.0f;
  return t;
}

}  // namespace

Triangle PagedMesh::triangle(std::uint32_t cluster, std::uint32_t index) const {
  const std::uint32_t page = cluster / kPageClusters;
  if (fetcher_ != nullptr && !waits_.load(std::memory_order_relaxed)) {
    const Pin here = cache_.pinIfHere(page);
    if (here.holds(page)) return here.mesh().triangle(cluster % kPageClusters, index);
    fetcher_->miss(page);
    return someTriangle();
  }
  const Pin pin = cache_.pin(page);
  return pin.mesh().triangle(cluster % kPageClusters, index);
}

}  // namespace hccm
