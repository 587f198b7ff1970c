#include "src/paths/load_choice.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <utility>

#include "src/core/clock.h"

namespace trex {
namespace {

constexpr int kSteps = 2;               // of the forecast, as of the simulated scheduler
constexpr double kFirstBytes = 50e6;    // a second, until some were measured
constexpr double kFirstRays = 5e5;      // likewise
constexpr double kFirstUnpacked = 1e8;  // bytes, likewise
constexpr double kKeptBytes = 1e12;     // a second: it is the latency that is measured
constexpr std::uint64_t kPlansAFit = 16;
constexpr double kPatience = 0.5;  // see worth(); of 0, 0.1 and 0.5 that with fewest loads

struct Ranked {
  double value;  ///< the less the sooner
  std::uint32_t page;
  bool operator<(const Ranked& o) const {
    return value != o.value ? value < o.value : page < o.page;
  }
};

/// Leaves the first so many, in any order.
void keepFirst(std::vector<Ranked>& all, std::size_t most) {
  if (all.size() <= most) return;
  std::nth_element(all.begin(), all.begin() + static_cast<std::ptrdiff_t>(most), all.end());
  all.resize(most);
}

/// The first so many, in order.
std::vector<std::uint32_t> firstOf(std::vector<Ranked>& all, std::size_t most) {
  keepFirst(all, most);
  std::sort(all.begin(), all.end());
  std::vector<std::uint32_t> out;
  std::transform(all.begin(), all.end(), std::back_inserter(out),
                 [](const Ranked& r) { return r.page; });
  return out;
}

/// firstOf() of many pages that come by their numbers, where a bound tells of most that they are
/// not among the first.
class First {
 public:
  explicit First(std::size_t most) : most_(most) {}
  /// Whether the next page may be among them if its value is not less than this.
  bool takes(double least) const { return least < last_; }
  void add(double value, std::uint32_t page) {
    all_.push_back({value, page});
    if (all_.size() < 2 * most_) return;
    keepFirst(all_, most_);
    last_ = std::max_element(all_.begin(), all_.end())->value;
  }
  std::vector<std::uint32_t> take() { return firstOf(all_, most_); }

 private:
  std::size_t most_;
  double last_ = HUGE_VAL;
  std::vector<Ranked> all_;
};

/// The newest samples, in any order.
void keep(std::vector<schedule::TimingSample>& samples, std::size_t& next, std::size_t most,
          double amount, double seconds) {
  if (!(seconds > 0.0) || !(amount > 0.0)) return;
  if (samples.size() < most) {
    samples.push_back({{amount}, seconds});
  } else {
    samples[next++ % most] = {{amount}, seconds};
  }
}

}  // namespace

LoadChoice::LoadChoice(const hccm::PageTable& table, LoadOrder order)
    : table_(table),
      order_(order),
      blockPages_(std::max<std::uint32_t>(
          1, (static_cast<std::uint32_t>(table.pages.size()) + kBlocks - 1) / kBlocks)),
      blocks_((static_cast<std::uint32_t>(table.pages.size()) + blockPages_ - 1) / blockPages_),
      pages_(table.pages.size()),
      cameToBlock_(blocks_),
      queued_(blocks_ + 1),
      share_(blocks_),
      forecast_(blocks_ + 1) {
  graph_.memories = {{"disk"}, {"memory"}, {"unpacked"}};
  graph_.channels = {{"pages", kFirstBytes, 0.0, {{0, 1}}}, {"kept", kKeptBytes, 0.0, {{2, 1}}}};
  graph_.devices = {{"tracing", 1, 1}};
  timing_.set(0, 0, {0.0, {1.0 / kFirstRays, 1.0 / kFirstUnpacked}});
}

void LoadChoice::begin(const hccm::PageCache& cache, const PageQueues& queues,
                       TrafficRecord* record) {
  cache_ = &cache;
  queues_ = &queues;
  record_ = record;
  if (const hccm::FileSpeed file = cache.file().speed(); brought_.empty() && file.bandwidth > 0.0) {
    graph_.channels[0].latency = file.latency;
    graph_.channels[0].bandwidth = file.bandwidth;
    readSeconds_ = graph_.channels[0].seconds(static_cast<double>(table_.packedBytes()) /
                                              static_cast<double>(table_.pages.size()));
  }
  chosen_.clear();
  ahead_.clear();
  aheadIsOld_ = false;
  going_.clear();
  wanted_ = {};
  std::fill(queued_.begin(), queued_.end(), 0.0);
  ++changes_;
  for (Page& p : pages_) p.uses = 0, p.coming = false;
  look();
}

/// Finds the pages that are there, those too that a stage loaded by itself.
void LoadChoice::look() {
  loads_ = cache_->statistics().loads;  // first: what comes meanwhile is looked for again
  here_.clear();
  free_ = {};
  for (std::uint32_t p = 0; p < pages_.size(); ++p) {
    pages_[p].here = cache_->isHere(p);
    if (pages_[p].here) here_.push_back(p);
  }
}

/// Rays that will come to each block, if those that wait go on as those before them did.
void LoadChoice::expect() {
  if (order_ != LoadOrder::kPlan) return;
  const std::vector<double> coming = forecast_.coming(queued_, kSteps);
  for (std::uint32_t b = 0; b < blocks_; ++b)
    share_[b] = cameToBlock_[b] > 0.0 ? coming[b] / cameToBlock_[b] : 0.0;
}

/// Rays that are still to come are a reason to wait for them.
double LoadChoice::worth(std::uint32_t page) const {
  const double rays = queues_->waiting(page);
  if (order_ == LoadOrder::kInTurn) return std::min(rays, 1.0);
  return std::max(rays - kPatience * expected(page), 1e-3 * rays);
}

/// Rays wait for it, and it is neither there nor on its way.
bool LoadChoice::isWanted(std::uint32_t page) const {
  return queues_->waiting(page) > 0 && !pages_[page].coming && !cache_->isHere(page);
}

/// Looks at all pages that rays wait for.
void LoadChoice::listAwaited() {
  expect();
  First wanted(std::max(2 * kCandidates, pages_.size() / kListed));
  for (std::uint32_t page = 0; page < pages_.size(); ++page) {
    // Nothing is worth more than the rays that wait for it.
    const std::uint32_t rays = queues_->waiting(page);
    if (rays > 0 && wanted.takes(-double(rays)) && isWanted(page)) wanted.add(-worth(page), page);
  }
  wanted_ = {wanted.take(), loaded_};
  aheadIsOld_ = true;
}

/// The absent pages that are worth most.
std::vector<std::uint32_t> LoadChoice::candidates() {
  std::erase_if(wanted_.pages, [&](std::uint32_t page) { return !isWanted(page); });
  if (wanted_.pages.size() < kCandidates || wanted_.isOld(loaded_)) listAwaited();
  std::vector<Ranked> wanted;
  for (const std::uint32_t page : wanted_.pages) wanted.push_back({-worth(page), page});
  return firstOf(wanted, kCandidates);
}

/// Absent pages that no ray waits for yet, where most are expected.
std::vector<std::uint32_t> LoadChoice::expectedMost() const {
  const auto pages = static_cast<std::uint32_t>(pages_.size());
  First most(std::max(kCandidates, pages_.size() / kListed));
  for (std::uint32_t block = 0; block < blocks_; ++block) {
    const std::uint32_t first = block * blockPages_;
    for (std::uint32_t p = first; p < std::min(first + blockPages_, pages); ++p) {
      const double rays = share_[block] * static_cast<double>(pages_[p].came);
      if (rays < kLeastAhead || !most.takes(-rays)) continue;
      if (pages_[p].coming || queues_->waiting(p) > 0 || cache_->isHere(p)) continue;
      if (!cache_->isKept(p)) most.add(-rays, p);
    }
  }
  return most.take();
}

/// It is there, and no ray waits for it or is traced against it.
bool LoadChoice::mayGo(std::uint32_t page) const {
  return pages_[page].uses == 0 && queues_->waiting(page) == 0 && cache_->isHere(page);
}

/// Of a page to stay; of equals less for that which was used longest ago.
double LoadChoice::need(std::uint32_t page) const {
  return expected(page) + static_cast<double>(pages_[page].last) / static_cast<double>(clock_ + 1);
}

/// Looks at all pages that are there.
void LoadChoice::listFree() {
  std::erase_if(here_,
                [&](std::uint32_t page) { return !(pages_[page].here = cache_->isHere(page)); });
  std::vector<Ranked> free;
  for (const std::uint32_t page : here_)
    if (mayGo(page)) free.push_back({need(page), page});
  free_ = {firstOf(free, std::max(2 * kVictims, here_.size() / kListedFree)), loaded_};
}

/// Pages that may go, those that are needed least.
std::vector<std::uint32_t> LoadChoice::leastNeeded() {
  std::erase_if(free_.pages, [&](std::uint32_t page) { return !mayGo(page); });
  if (free_.pages.size() < kVictims / 2 || free_.isOld(loaded_)) listFree();
  std::vector<Ranked> free;
  for (const std::uint32_t page : free_.pages) free.push_back({need(page), page});
  return firstOf(free, kVictims);
}

/// Times as they were lately: a job unpacks its page, then traces its rays.
void LoadChoice::fit() {
  if (plans_++ % kPlansAFit != 0) return;
  if (traced_.size() >= 8 && unpacked_.size() >= 8) {
    const schedule::LinearTime rays = schedule::fitLinear(traced_),
                               bytes = schedule::fitLinear(unpacked_);
    timing_.set(0, 0, {rays.setup + bytes.setup, {rays.rates[0], bytes.rates[0]}});
  }
  if (brought_.size() < 8) return;
  const schedule::LinearTime t = schedule::fitLinear(brought_);
  graph_.channels[0].latency = t.setup;
  graph_.channels[0].bandwidth = 1.0 / std::max(t.rates[0], 1e-12);
}

/// What is read next: as planned, and ahead of that.
void LoadChoice::choose() {
  planned_ = changes_;
  if (cache_->statistics().loads != loads_) look();
  chosen_.clear();
  if (order_ == LoadOrder::kInTurn) return chooseInTurn();
  const std::vector<std::uint32_t> wanted = candidates();
  const bool plans =
      readsAhead() && std::any_of(wanted.begin(), wanted.end(),
                                  [&](std::uint32_t page) { return !cache_->isKept(page); });
  if (plans) return planLoads(std::span(wanted).first(std::min(wanted.size(), kPlanned)));
  // No channel is worth a plan: what is worth most comes first.
  if (record_ != nullptr) recordInOrder(wanted);
  chosen_.assign(wanted.rbegin(), wanted.rend());
}

/// As one thread takes them: a page comes, is unpacked unless it was kept, and its rays are traced;
/// then the next.
void LoadChoice::recordInOrder(std::span<const std::uint32_t> wanted) {
  fit();
  schedule::Schedule order;
  double now = secondsNow();
  for (std::uint32_t i = 0; i < wanted.size(); ++i) {
    const double rays = queues_->waiting(wanted[i]), size = static_cast<double>(bytesOf(wanted[i]));
    const bool kept = cache_->isKept(wanted[i]);
    const double there = now + (kept ? cache_->keptSeconds() : graph_.channels[0].seconds(size));
    order.fetches.push_back({i, kept ? 1u : 0u, kept ? 2u : 0u, 1, now, there, {}});
    now = there + timing_.at(0, 0).seconds(std::vector{rays, kept ? 0.0 : size});
    order.runs.push_back({i, 0, there, now, {}});
  }
  const auto pageOf = [&](std::uint32_t i) { return wanted[i]; };
  record_->planned(order, pageOf, pageOf);
}

/// All pages that rays wait for of the next block that has any, as schedule::planRoundRobin() takes
/// blocks.
void LoadChoice::chooseInTurn() {
  const auto pages = static_cast<std::uint32_t>(pages_.size());
  for (std::uint32_t tried = 0; tried < blocks_ && chosen_.empty(); ++tried) {
    const std::uint32_t first = turn_ * blockPages_;
    for (std::uint32_t p = std::min(first + blockPages_, pages); p-- > first;) {
      if (isWanted(p)) chosen_.push_back(p);
    }
    turn_ = (turn_ + 1) % blocks_;
  }
}

/// Plans their loads.
void LoadChoice::planLoads(std::span<const std::uint32_t> wanted) {
  fit();
  const std::vector<std::uint32_t> free = leastNeeded();
  schedule::State s;
  s.now = secondsNow();
  double bytes = 0.0, room = static_cast<double>(cache_->limit() - cache_->statistics().bytes);
  for (const std::uint32_t page : wanted) {
    const double rays = queues_->waiting(page), size = static_cast<double>(bytesOf(page));
    const bool kept = cache_->isKept(page);
    s.jobs.push_back({0,
                      {static_cast<std::uint32_t>(s.items.size())},
                      {rays, kept ? 0.0 : size},
                      worth(page),
                      0.0,
                      0.0});
    s.items.push_back({size, kept ? 5u : 1u, false, 0.0, 0.0});
    bytes += size;
  }
  for (const std::uint32_t page : free) {
    s.items.push_back({static_cast<double>(bytesOf(page)), 3, false, need(page), 0.0});
    room += s.items.back().bytes;
  }
  graph_.memories[1].capacity = std::max(room, 1.0);
  graph_.channels[1].latency = cache_->keptSeconds();
  const schedule::Routes routes(graph_, bytes / static_cast<double>(wanted.size()));
  s.graph = &graph_;
  s.routes = &routes;
  s.timing = &timing_;
  s.horizon = schedule::kNever;
  schedule::Schedule made = schedule::plan(s, {});
  std::sort(made.fetches.begin(), made.fetches.end(),
            [](const auto& a, const auto& b) { return a.start < b.start; });
  const auto pageOf = [&](std::uint32_t item) {
    return item < wanted.size() ? wanted[item] : free[item - wanted.size()];
  };
  going_.clear();
  for (const schedule::Fetch& f : made.fetches) {
    chosen_.push_back(pageOf(f.item));
    for (const std::uint32_t item : f.evicted) going_.push_back(pageOf(item));
  }
  // What the plan has no room for may have it by now.
  if (chosen_.empty()) chosen_.push_back(wanted.front());
  std::reverse(chosen_.begin(), chosen_.end());
  std::reverse(going_.begin(), going_.end());
  if (record_ != nullptr)
    record_->planned(made, pageOf, [&](std::uint32_t j) { return wanted[j]; });
}

std::optional<std::uint32_t> LoadChoice::next() {
  for (int turn = 0; turn < 2; ++turn) {
    while (!chosen_.empty()) {
      const std::uint32_t page = chosen_.back();
      chosen_.pop_back();
      if (cache_->isHere(page) || queues_->waiting(page) == 0 || pages_[page].coming) continue;
      pages_[page].coming = true;
      return page;
    }
    if (turn == 0 && changes_ != planned_) choose();
  }
  return {};
}

std::optional<std::uint32_t> LoadChoice::ahead() {
  if (std::exchange(aheadIsOld_, false)) {
    ahead_ = expectedMost();
    std::reverse(ahead_.begin(), ahead_.end());
  }
  while (!ahead_.empty()) {
    const std::uint32_t page = ahead_.back();
    ahead_.pop_back();
    if (cache_->isHere(page) || pages_[page].coming || cache_->isKept(page)) continue;
    pages_[page].coming = true;
    return page;
  }
  return {};
}

void LoadChoice::read(std::uint64_t bytes, double seconds) {
  // Not a mean: a thread that lost its processor has not met a slow disk.
  readSeconds_ = std::clamp(readSeconds_ * (seconds > readSeconds_ ? 1.1 : 1.0 / 1.1), 1e-6, 1.0);
  keep(brought_, broughtNext_, kSamples, static_cast<double>(bytes), seconds);
}

void LoadChoice::loaded(std::uint32_t page, double seconds, bool kept) {
  Page& p = pages_[page];
  ++changes_;
  p.coming = false;
  p.last = ++clock_;
  if (!p.here) here_.push_back(page);
  p.here = true;
  ++loads_, ++loaded_;
  if (!kept) keep(unpacked_, unpackedNext_, kSamples, static_cast<double>(bytesOf(page)), seconds);
}

std::optional<std::uint32_t> LoadChoice::victim() {
  // Counts of loads do not tell of all that stages loaded: ours may have found its page there.
  for (int turn = 0; turn < 3; ++turn) {
    while (!going_.empty()) {
      const std::uint32_t page = going_.back();
      going_.pop_back();
      if (mayGo(page)) return page;
    }
    if (turn == 2) break;
    if (turn == 1 || cache_->statistics().loads != loads_) look();
    going_ = leastNeeded();
    std::reverse(going_.begin(), going_.end());
  }
  return {};
}

void LoadChoice::used(std::uint32_t page, std::size_t rays, double seconds,
                      std::span<const std::uint32_t> waitsNow) {
  ++changes_;
  std::uint32_t from = blocks_;
  if (page != kBegin) {
    --pages_[page].uses;
    pages_[page].last = ++clock_;
    from = blockOf(page);
    queued_[from] -= static_cast<double>(rays);
    keep(traced_, tracedNext_, kSamples, static_cast<double>(rays), seconds);
  }
  forecast_.served(from, static_cast<double>(rays));
  for (const std::uint32_t to : waitsNow) {
    ++pages_[to].came;
    const std::uint32_t block = blockOf(to);
    cameToBlock_[block] += 1.0;
    queued_[block] += 1.0;
    forecast_.moved(from, block, 1.0);
  }
}

}  // namespace trex
