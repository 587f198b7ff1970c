// Which page is loaded next, and which goes: decisions, no threads.
//
// The planner of src/schedule chooses, as it does for simulated machines: jobs are pages that rays
// wait for; the machine is one channel that brings pages and one device that traces, with times
// fitted to what was measured so far. Blocks, runs of pages that lie close together, are the
// stations of the forecast: shares of the rays traced in a block that went on to wait in each other
// one. What is expected says which pages stay, and which are better loaded once more rays wait:
// loads are what takes the time, and nobody minds a ray that waits.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "hccmesh/page_cache.h"
#include "src/paths/page_queues.h"
#include "src/paths/traffic_record.h"
#include "src/schedule/forecast.h"
#include "src/schedule/planner.h"

namespace trex {

/// One thread at a time. Lives as long as a picture: what it has learned serves the next paths.
class LoadChoice {
 public:
  /// Paths that begin come from here.
  static constexpr std::uint32_t kBegin = 0xffffffffu;

  /// `predict`: rays that are expected count, too; else those alone that wait, and what was used
  /// longest ago goes first. The table outlives it.
  explicit LoadChoice(const hccm::PageTable& table, bool predict = true);

  /// A set of paths begins. `record` (may be null) takes down what is planned.
  void begin(const hccm::PageCache& cache, const PageQueues& queues, TrafficRecord* record);
  /// The page to load now, taken to be on its way from here on; none if no ray waits for one.
  std::optional<std::uint32_t> next();
  /// It was not loaded after all.
  void putBack(std::uint32_t page);
  void loaded(std::uint32_t page, double seconds);
  /// The page to give up; none if all that are there are in use.
  std::optional<std::uint32_t> victim();
  /// Rays are traced against a page, and were: so many, and these are the pages where they wait
  /// now.
  void use(std::uint32_t page) { ++pages_[page].uses; }
  void used(std::uint32_t page, std::size_t rays, double seconds,
            std::span<const std::uint32_t> waitsNow);
  std::uint64_t bytesOf(std::uint32_t page) const {
    return hccm::PageCache::bytesOf(table_.pages[page]);
  }

 private:
  static constexpr std::size_t kCandidates = 32;  ///< of a plan
  static constexpr std::size_t kVictims = 48;     ///< that it may give up
  static constexpr double kAhead = 24;            ///< loads that are planned at a time, about
  static constexpr std::uint32_t kBlocks = 128;   ///< at most
  static constexpr std::size_t kSamples = 128;    ///< that times are fitted to

  struct Page {
    std::uint32_t uses = 0;
    bool coming = false, here = false;
    std::uint64_t last = 0;  ///< use
    double came = 0.0;       ///< rays that came to wait, ever
    double expected = 0.0;   ///< to come, as of the last plan
  };
  struct Ranked {
    double value;
    std::uint32_t page;
  };
  std::uint32_t blockOf(std::uint32_t page) const { return page / blockPages_; }
  void look();
  void expect();
  double worth(std::uint32_t page) const;
  void fit();
  std::vector<std::uint32_t> candidates() const;
  std::vector<std::uint32_t> leastNeeded() const;
  void choose();

  const hccm::PageTable& table_;
  const bool predict_;
  const std::uint32_t blockPages_, blocks_;
  const hccm::PageCache* cache_ = nullptr;
  const PageQueues* queues_ = nullptr;
  TrafficRecord* record_ = nullptr;
  std::vector<Page> pages_;
  std::vector<double> cameToBlock_;
  schedule::Forecast forecast_;        ///< one station more: paths that begin
  std::vector<std::uint32_t> here_;    ///< some of which may have gone
  std::vector<std::uint32_t> chosen_;  ///< the first last
  std::vector<std::uint32_t> going_;   ///< likewise
  std::vector<schedule::TimingSample> traced_, brought_;
  std::size_t tracedNext_ = 0, broughtNext_ = 0;
  schedule::Graph graph_;
  schedule::TimingModel timing_{1, 1};
  std::uint64_t clock_ = 0, loads_ = 0;  ///< loads_: of the cache, that are known
  std::uint64_t plans_ = 0;
};

}  // namespace trex
