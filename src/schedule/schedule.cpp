#include "src/schedule/schedule.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace trex::schedule {
namespace {

/// Sums of many bytes may be off by rounding.
constexpr double kSlack = 1.0 + 1e-9;

/// What happens at one time, in this order.
enum class Step { kArrive, kEnd, kEvictForFetch, kEvictForRun, kSend, kBegin };

struct Event {
  double time = 0.0;
  Step step = Step::kArrive;
  std::size_t which = 0;
};

class Validator {
 public:
  Validator(const Schedule& schedule, const Graph& graph, std::span<const Item> items,
            std::span<const Job> jobs)
      : s_(schedule), graph_(graph), items_(items), jobs_(jobs) {
    const std::size_t memories = graph.memories.size();
    copies_.resize(items.size() * memories);
    used_.resize(memories, 0.0);
    for (std::size_t i = 0; i < items.size(); ++i) {
      for (std::size_t m = 0; m < memories; ++m) {
        if (items[i].copies >> m & 1u) add(i, m);
      }
    }
  }

  std::string problem() {
    std::vector<Event> events;
    for (std::size_t i = 0; i < s_.fetches.size(); ++i) {
      const Fetch& f = s_.fetches[i];
      if (!ordered(f.start, f.end)) return fmt::format("fetch {}: bad times", i);
      if (!linked(f)) return fmt::format("fetch {}: its channel has no such link", i);
      events.push_back({f.start, Step::kEvictForFetch, i});
      events.push_back({f.start, Step::kSend, i});
      events.push_back({f.end, Step::kArrive, i});
    }
    for (std::size_t i = 0; i < s_.runs.size(); ++i) {
      const Run& r = s_.runs[i];
      if (!ordered(r.start, r.end)) return fmt::format("run {}: bad times", i);
      events.push_back({r.start, Step::kEvictForRun, i});
      events.push_back({r.start, Step::kBegin, i});
      events.push_back({r.end, Step::kEnd, i});
    }
    std::stable_sort(events.begin(), events.end(), [](const Event& a, const Event& b) {
      return a.time != b.time ? a.time < b.time : a.step < b.step;
    });
    if (std::string p = overlaps(); !p.empty()) return p;
    for (const Event& e : events) {
      if (std::string p = step(e); !p.empty()) return fmt::format("at {:.9g} s, {}", e.time, p);
    }
    return "";
  }

 private:
  struct Copy {
    bool present = false;
    int users = 0;
  };
  static bool ordered(double start, double end) {
    return std::isfinite(start) && std::isfinite(end) && start >= 0.0 && end >= start;
  }
  bool linked(const Fetch& f) const {
    const auto& links = graph_.channels.at(f.channel).links;
    return std::any_of(links.begin(), links.end(),
                       [&](const Link& l) { return l.from == f.from && l.to == f.to; });
  }
  Copy& copy(std::size_t item, std::size_t memory) {
    return copies_[item * graph_.memories.size() + memory];
  }
  void add(std::size_t item, std::size_t memory) {
    copy(item, memory).present = true;
    if (!items_[item].moves) used_[memory] += items_[item].bytes;
  }

  std::string overlaps() const {
    const auto check = [](auto parts, auto place, const char* what) -> std::string {
      std::sort(parts.begin(), parts.end(), [&](const auto& a, const auto& b) {
        return std::tuple(place(a), a.start, a.end) < std::tuple(place(b), b.start, b.end);
      });
      for (std::size_t i = 1; i < parts.size(); ++i) {
        if (place(parts[i]) != place(parts[i - 1]) || parts[i].start >= parts[i - 1].end) continue;
        return fmt::format("{} {} does two things at {:.9g} s", what, place(parts[i]),
                           parts[i].start);
      }
      return "";
    };
    std::string p = check(
        s_.runs, [](const Run& r) { return r.device; }, "device");
    if (p.empty())
      p = check(
          s_.fetches, [](const Fetch& f) { return f.channel; }, "channel");
    return p;
  }

  std::string evict(const std::vector<std::uint32_t>& evicted, std::uint32_t memory) {
    for (std::uint32_t item : evicted) {
      Copy& c = copy(item, memory);
      if (!c.present) return fmt::format("item {} is evicted that is not there", item);
      if (c.users > 0) return fmt::format("item {} is evicted while in use", item);
      c.present = false;
      used_[memory] -= items_[item].bytes;
    }
    return "";
  }

  std::string full(std::uint32_t memory) const {
    if (used_[memory] <= graph_.memories[memory].capacity * kSlack) return "";
    return fmt::format("memory {} holds {} bytes", graph_.memories[memory].name, used_[memory]);
  }

  std::string step(const Event& e) {
    if (e.step == Step::kSend || e.step == Step::kArrive) return transfer(e);
    if (e.step == Step::kEvictForFetch) {
      return evict(s_.fetches[e.which].evicted, s_.fetches[e.which].to);
    }
    const Run& r = s_.runs[e.which];
    const std::uint32_t memory = graph_.devices.at(r.device).memory;
    if (e.step == Step::kEvictForRun) return evict(r.evicted, memory);
    const bool begins = e.step == Step::kBegin;
    for (std::uint32_t item : jobs_[r.job].reads) {
      if (items_[item].moves || items_[item].bytes <= 0.0) continue;
      if (!copy(item, memory).present) return fmt::format("job {} lacks item {}", r.job, item);
      copy(item, memory).users += begins ? 1 : -1;
    }
    used_[memory] += begins ? jobs_[r.job].scratch : -jobs_[r.job].scratch;
    return begins ? full(memory) : "";
  }

  std::string transfer(const Event& e) {
    const Fetch& f = s_.fetches[e.which];
    if (items_[f.item].moves) return "";
    Copy& source = copy(f.item, f.from);
    if (e.step == Step::kArrive) {
      --source.users;
      copy(f.item, f.to).present = true;
      return "";
    }
    if (!source.present) return fmt::format("item {} is fetched from where it is not", f.item);
    ++source.users;
    if (copy(f.item, f.to).present) return fmt::format("item {} is there already", f.item);
    used_[f.to] += items_[f.item].bytes;  // its place is taken from now on
    return full(f.to);
  }

  const Schedule& s_;
  const Graph& graph_;
  std::span<const Item> items_;
  std::span<const Job> jobs_;
  std::vector<Copy> copies_;
  std::vector<double> used_;
};

}  // namespace

double Schedule::makespan() const {
  double end = 0.0;
  for (const Fetch& f : fetches) end = std::max(end, f.end);
  for (const Run& r : runs) end = std::max(end, r.end);
  return end;
}

std::string problemOf(const Schedule& schedule, const Graph& graph, std::span<const Item> items,
                      std::span<const Job> jobs) {
  return Validator(schedule, graph, items, jobs).problem();
}

}  // namespace trex::schedule
