// Which page is read next, which is unpacked, and which goes: decisions, no threads.
//
// Where reads take long the planner of src/schedule chooses, as it does for simulated machines:
// jobs are pages that rays wait for, to be unpacked and traced; the machine is one channel that
// reads, one that brings pages that were kept unpacked, and one device, with times fitted to what
// was measured so far. Where they do not (the file is in the system's cache) no channel is worth a
// plan: what is worth most comes first. Blocks, runs of pages that lie close together, are the
// stations of the forecast: shares of the rays traced in a block that went on to wait in each other
// one. What is expected says which pages stay, which are better loaded once more rays wait (loads
// are what takes the time, and nobody minds a ray that waits), and which are read before any ray
// waits, where the channel has nothing else to do.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "hccmesh/page_cache.h"
#include "src/paths/load_order.h"
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

  /// Without prediction (all but LoadOrder::kPlan) rays count alone that wait, and what was used
  /// longest ago goes first. The table outlives it.
  explicit LoadChoice(const hccm::PageTable& table, LoadOrder order = LoadOrder::kPlan);

  /// A set of paths begins. `record` (may be null) takes down what is planned.
  void begin(const hccm::PageCache& cache, const PageQueues& queues, TrafficRecord* record);
  /// So many paths are still to begin.
  void toBegin(std::uint64_t paths) { queued_[blocks_] = static_cast<double>(paths); }
  /// Pages may have gone without a word.
  void lookAgain() { ++changes_; }
  /// The page to read now, taken to be on its way from here on; none if no ray waits for one.
  std::optional<std::uint32_t> next();
  /// That where most rays are expected, though none waits for it yet; as next().
  std::optional<std::uint32_t> ahead();
  /// It is not on its way after all.
  void putBack(std::uint32_t page) { pages_[page].coming = false; }
  /// Of having it in memory now, rays; 0 if none waits for it.
  double worth(std::uint32_t page) const;
  /// Rays that are still to come there, as of the last plan.
  double expected(std::uint32_t page) const {
    return share_[blockOf(page)] * static_cast<double>(pages_[page].came);
  }
  /// A read has ended, of pages that take so many bytes in memory.
  void read(std::uint64_t bytes, double seconds);
  /// A page was unpacked, or had been `kept` so.
  void loaded(std::uint32_t page, double seconds, bool kept = false);
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
  /// Whether pages had better be read before a thread needs them: a read takes long, as most of
  /// them lately did. Not by rays that wait alone.
  bool readsAhead() const { return order_ != LoadOrder::kWaiting && readSeconds_ > kSlow; }
  double readSeconds() const { return readSeconds_; }
  std::uint32_t packedBytesOf(std::uint32_t page) const { return table_.pages[page].packedBytes; }

 private:
  static constexpr std::size_t kCandidates = 48;  ///< chosen at once
  static constexpr std::size_t kPlanned = 24;     ///< of them, of a plan
  static constexpr std::size_t kVictims = 48;     ///< that it may give up
  static constexpr std::uint32_t kBlocks = 128;   ///< at most
  /// Of many pages so many are listed when all are looked at, as a share of them; what is next is
  /// chosen of the list until half of it has been loaded.
  static constexpr std::size_t kListed = 64;
  static constexpr std::size_t kListedFree = 8;  ///< likewise of those that may go
  static constexpr std::size_t kSamples = 128;   ///< that times are fitted to

  static constexpr double kSlow = 4e-5;       ///< seconds of a read; from memory it takes 1e-5
  static constexpr double kLeastAhead = 1.0;  ///< rays that make a page worth reading ahead

  struct Page {
    std::uint32_t uses = 0;
    bool coming = false, here = false;
    std::uint64_t last = 0;  ///< use
    std::uint64_t came = 0;  ///< rays that came to wait, ever
  };
  /// Pages that were the best when all were looked at, as of so many loads.
  struct List {
    std::vector<std::uint32_t> pages{};
    std::uint64_t since = 0;
    bool isOld(std::uint64_t loads) const { return 2 * (loads - since) >= pages.size(); }
  };
  std::uint32_t blockOf(std::uint32_t page) const { return page / blockPages_; }
  void look();
  void expect();
  bool isWanted(std::uint32_t page) const;
  bool mayGo(std::uint32_t page) const;
  double need(std::uint32_t page) const;
  void fit();
  void listAwaited();
  void listFree();
  std::vector<std::uint32_t> candidates();
  std::vector<std::uint32_t> expectedMost() const;
  std::vector<std::uint32_t> leastNeeded();
  void choose();
  void planLoads(std::span<const std::uint32_t> wanted);
  void recordInOrder(std::span<const std::uint32_t> wanted);
  void chooseInTurn();

  const hccm::PageTable& table_;
  const LoadOrder order_;
  const std::uint32_t blockPages_, blocks_;
  const hccm::PageCache* cache_ = nullptr;
  const PageQueues* queues_ = nullptr;
  TrafficRecord* record_ = nullptr;
  std::vector<Page> pages_;
  std::vector<double> cameToBlock_, queued_;  ///< queued_: rays there now, and paths to begin
  std::vector<double> share_;                 ///< by block: rays to come, of those that ever came
  schedule::Forecast forecast_;               ///< one station more: paths that begin
  std::vector<std::uint32_t> here_;           ///< some of which may have gone
  List wanted_, free_;                        ///< of those that rays wait for, and of here_
  std::vector<std::uint32_t> chosen_;         ///< the first last
  std::vector<std::uint32_t> ahead_;          ///< likewise
  bool aheadIsOld_ = false;                   ///< it is to be chosen anew, when it is asked for
  std::vector<std::uint32_t> going_;          ///< likewise
  double readSeconds_ = 1e-5;                 ///< half of the reads take longer
  std::vector<schedule::TimingSample> traced_, unpacked_, brought_;
  std::size_t tracedNext_ = 0, unpackedNext_ = 0, broughtNext_ = 0;
  schedule::Graph graph_;
  schedule::TimingModel timing_{1, 1};
  std::uint64_t clock_ = 0, loads_ = 0;  ///< loads_: of the cache, that are known
  std::uint64_t loaded_ = 0;             ///< pages, by loaded()
  std::uint64_t plans_ = 0;
  std::uint32_t turn_ = 0;                   ///< the block whose turn it is, of LoadOrder::kInTurn
  std::uint64_t changes_ = 0, planned_ = 0;  ///< planned_: the last one that a plan knew of
};

}  // namespace trex
