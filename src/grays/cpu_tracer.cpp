#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <tbb/parallel_reduce.h>
#include <tbb/task_group.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cassert>
#include <chrono>
#include <optional>

#include "src/core/error.h"
#include "src/core/memory.h"
#include "src/grays/cpu_photons.h"
#include "src/grays/grays.h"
#include "src/grays/resolve.h"

namespace trex {

namespace {

using Clock = std::chrono::steady_clock;
using shaderio::GatherQuery;
using shaderio::GatherResult;

static_assert(std::endian::native == std::endian::little, "sums are read as pairs of 32-bit words");

double since(Clock::time_point start) {
  return std::chrono::duration<double>(Clock::now() - start).count();
}

/// One of the two batches of cones that may be under way.
struct GatherSlot {
  std::vector<GatherQuery> queries;
  std::vector<GatherResult> results;
  tbb::task_group tasks;
  double seconds = 0.0;
  bool open = false;
  ~GatherSlot() noexcept {}  // the owner has waited: task_group cannot throw
};

struct PhotonCounts {
  std::uint64_t deposits = 0, lost = 0;
};

class CpuTracer final : public GRayTracer {
 public:
  CpuTracer(const asvo::Tree& tree, std::span<const shaderio::PhotonMaterial> materials,
            std::vector<asvo::uvec4> light, std::vector<asvo::uvec4> before)
      : tree_(tree),
        materials_(materials.begin(), materials.end()),
        light_(std::move(light), std::move(before)),
        cones_(tree),
        grid_(tree.info.leafCount > 0 ? makeGrid(tree, photonGridLevel(tree.info))
                                      : std::vector<std::uint32_t>()),
        bricks_(tree.info.leafCount > 0 ? makeBricks(tree) : std::vector<asvo::uvec4>()),
        tracer_(tree, photonGridLevel(tree.info), grid_, bricks_, light_.front(), {}) {
    if (materials_.empty()) materials_.push_back({});
  }

  ~CpuTracer() override { waitAll(); }

  std::string name() const override { return "cpu"; }
  bool sharesHostCores() const override { return true; }

  int submitGather(std::span<const GatherQuery> queries) override {
    GatherSlot& slot = slots_[next_ & 1u];
    assert(!slot.open && "at most two batches may be under way");
    if (cones_.stale() && tree_.info.leafCount > 0) refreshCones();
    slot.queries.assign(queries.begin(), queries.end());
    slot.results.resize(queries.size());
    slot.open = true;
    slot.tasks.run([this, &slot] {
      const auto start = Clock::now();  // not when it was asked for: threads do other things first
      gather(slot);
      slot.seconds = since(start);
    });
    return static_cast<int>(next_++);
  }

  std::span<const GatherResult> finishGather(int ticket) override {
    GatherSlot& slot = slots_[static_cast<unsigned>(ticket) & 1u];
    assert(slot.open && "a ticket is finished once");
    slot.tasks.wait();
    slot.open = false;
    statistics_.cones += slot.results.size();
    statistics_.gatherSeconds += slot.seconds;
    return slot.results;
  }

  void prepare() override {
    if (tree_.info.leafCount == 0) return;
    light_.prepare(tree_);
    makeSums();
  }

  void resetFlux() override {
    if (hasFlux_) {
      for (LargeVector<std::uint64_t>* sums : {&direct_, &indirect_}) {
        tbb::parallel_for(tbb::blocked_range<std::size_t>(0, sums->size(), 1u << 16),
                          [&](const tbb::blocked_range<std::size_t>& range) {
                            std::fill(sums->begin() + static_cast<std::ptrdiff_t>(range.begin()),
                                      sums->begin() + static_cast<std::ptrdiff_t>(range.end()), 0);
                          });
      }
    }
    hasFlux_ = false;
    light_.restart();
  }

  void refresh(std::span<const shaderio::PhotonMaterial> materials) override {
    waitAll();
    materials_.assign(materials.begin(), materials.end());
    if (materials_.empty()) materials_.push_back({});
    cones_.lightChanged();
  }

  void tracePhotons(std::span<const shaderio::PhotonRecord> records, double unit) override {
    const auto start = Clock::now();
    unit_ = unit;
    makeSums();
    light_.restart();
    statistics_.photonRecords += records.size();
    if (tree_.info.leafCount == 0) {
      statistics_.lostDeposits += records.size();
      return;
    }
    hasFlux_ = true;
    const photon::Photons photons(tracer_, materials_, direct_, indirect_);
    const auto countsPerWatt = static_cast<float>(1.0 / unit);
    const PhotonCounts counts = tbb::parallel_reduce(
        tbb::blocked_range<std::size_t>(0, records.size(), 64), PhotonCounts{},
        [&](const tbb::blocked_range<std::size_t>& range, PhotonCounts sum) {
          for (std::size_t i = range.begin(); i != range.end(); ++i) {
            auto path = photons.photonBegin(records[i], countsPerWatt);
            while (path.alive) photons.photonStep(path, countsPerWatt);
            sum.deposits += path.deposits;
            sum.lost += path.lost;
          }
          return sum;
        },
        [](const PhotonCounts& a, const PhotonCounts& b) {
          return PhotonCounts{a.deposits + b.deposits, a.lost + b.lost};
        });
    statistics_.photonDeposits += counts.deposits;
    statistics_.lostDeposits += counts.lost;
    statistics_.photonSeconds += since(start);
  }

  using GRayTracer::resolveLight;
  bool resolveLight(std::uint64_t emittedPhotons, const std::function<bool()>& keepGoing) override {
    waitAll();
    if (tree_.info.leafCount == 0 || emittedPhotons == 0) return true;
    makeSums();
    if (!light_.resolve(tree_, words(direct_), words(indirect_),
                        unit_ / static_cast<double>(emittedPhotons), emittedPhotons, keepGoing)) {
      return false;
    }
    cones_.lightChanged();
    return true;
  }

  std::span<const asvo::uvec4> light() const override { return light_.front(); }
  std::span<const asvo::uvec4> lightBefore() const override { return light_.before(); }
  GRayStatistics statistics() const override { return statistics_; }

 private:
  void makeSums() {
    direct_.resize(tree_.leaves.size() * kWordsPerLeaf / 2, 0);
    indirect_.resize(direct_.size(), 0);
  }

  static std::span<const std::uint32_t> words(const LargeVector<std::uint64_t>& sums) {
    return {reinterpret_cast<const std::uint32_t*>(sums.data()), sums.size() * 2};
  }

  /// Makes what cones read, or brings it up to date.
  void refreshCones() {
    waitAll();
    cones_.refresh(light_.front(), materials_);
    const std::uint32_t level = coneGridLevel(tree_.info);
    if (coneTracer_) return;
    coneGrid_ = makeGrid(tree_, level);
    coneTracer_.emplace(tree_, level, coneGrid_, bricks_, light_.front(), cones_.words());
  }

  void waitAll() {
    for (GatherSlot& slot : slots_) slot.tasks.wait();
  }

  void gather(GatherSlot& slot) const {
    if (tree_.info.leafCount == 0) {
      std::fill(slot.results.begin(), slot.results.end(), GatherResult{glm::vec3(0.0f), 1.0f});
      return;
    }
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, slot.queries.size(), 256),
                      [&](const tbb::blocked_range<std::size_t>& range) {
                        for (std::size_t i = range.begin(); i != range.end(); ++i) {
                          slot.results[i] = gatherOne(slot.queries[i]);
                        }
                      });
  }

  GatherResult gatherOne(const GatherQuery& q) const {
    const bool lit = (q.flags & shaderio::kQueryShadow) == 0;
    const auto cone =
        coneTracer_->asvoMarch(q.origin, q.direction, q.tanHalf, q.tmin, q.tmax, q.jitter, lit);
    return {cone.radiance, cone.transmittance};
  }

  const asvo::Tree& tree_;
  std::vector<shaderio::PhotonMaterial> materials_;
  LightBuffers light_;
  ConeTable cones_;
  std::vector<std::uint32_t> grid_;
  std::vector<asvo::uvec4> bricks_;
  const GridTracer tracer_;  // of photons
  std::vector<std::uint32_t> coneGrid_;
  std::optional<GridTracer> coneTracer_;          // made when a cone first asks
  LargeVector<std::uint64_t> direct_, indirect_;  // by prepare(), or when the first photons come
  bool hasFlux_ = false;
  double unit_ = 0.0;
  std::array<GatherSlot, 2> slots_;
  unsigned next_ = 0;
  GRayStatistics statistics_;
};

}  // namespace

std::unique_ptr<GRayTracer> makeCpuTracer(const asvo::Tree& tree,
                                          std::span<const shaderio::PhotonMaterial> materials,
                                          std::vector<asvo::uvec4> light,
                                          std::vector<asvo::uvec4> before) {
  light.resize(tree.nodes.size(), asvo::uvec4(0u));
  before.resize(tree.nodes.size(), asvo::uvec4(0u));
  return std::make_unique<CpuTracer>(tree, materials, std::move(light), std::move(before));
}

}  // namespace trex
