#include "src/schedule/bound.h"

#include <algorithm>
#include <cmath>

namespace trex::schedule {
namespace {

/// A unit somewhere on its way: what it still visits.
struct Rest {
  const std::uint32_t* begin = nullptr;
  const std::uint32_t* end = nullptr;
};

/// Ways from a beginning to an end; one of a child begins with that of its parent.
std::vector<std::vector<std::uint32_t>> chainsOf(const Workload& w) {
  std::vector<std::vector<std::uint32_t>> chains(w.walks.size());
  std::vector<bool> inner(w.walks.size(), false);
  for (std::size_t i = 0; i < w.walks.size(); ++i) {
    const Walk& walk = w.walks[i];
    if (walk.parent != kNoWalk) {
      const std::vector<std::uint32_t>& parent = chains[walk.parent];
      const std::size_t before = parent.size() - w.walks[walk.parent].length;
      chains[i].assign(parent.begin(),
                       parent.begin() + static_cast<long>(before + walk.parentPlace + 1));
    }
    chains[i].insert(chains[i].end(), w.way.begin() + walk.first,
                     w.way.begin() + walk.first + walk.length);
  }
  return chains;
}

class Loads {
 public:
  Loads(const Workload& w, double held) : w_(w), held_(held) {}

  /// Bytes that units with these rests need loaded when `held` of them may be there.
  double bytes(const std::vector<Rest>& rests, double held, int depth) const {
    std::vector<std::vector<Rest>> after(w_.stations());
    std::vector<bool> visited(w_.stations(), false);
    std::vector<std::uint32_t> seen(w_.stations(), 0);
    std::uint32_t mark = 0;
    for (const Rest& rest : rests) {
      ++mark;
      for (const std::uint32_t* at = rest.begin; at != rest.end; ++at) {
        visited[*at] = true;
        if (seen[*at] == mark) continue;
        seen[*at] = mark;
        if (depth > 1 && at + 1 != rest.end) after[*at].push_back({at + 1, rest.end});
      }
    }
    std::vector<std::pair<double, std::uint32_t>> later;
    for (std::uint32_t b = 0; b < w_.stations(); ++b) {
      if (!visited[b]) continue;
      later.emplace_back(after[b].empty() ? 0.0 : bytes(after[b], held_, depth - 1), b);
    }
    std::sort(later.begin(), later.end(), [](const auto& a, const auto& b) {
      return a.first != b.first ? a.first > b.first : a.second < b.second;
    });
    return best(later, held);
  }

 private:
  double best(const std::vector<std::pair<double, std::uint32_t>>& later, double held) const {
    std::vector<bool> counted(w_.itemBytes.size(), false);
    double most = 0.0, sum = -held;
    for (const auto& [rest, station] : later) {
      for (std::uint32_t item : w_.reads[station]) {
        if (!counted[item]) sum += w_.itemBytes[item];
        counted[item] = true;
      }
      most = std::max(most, std::max(sum, 0.0) + rest);
    }
    return most;
  }

  const Workload& w_;
  double held_;
};

double workSeconds(const Workload& w, const TimingModel& timing) {
  std::vector<double> units(timing.kinds(), 0.0);
  for (const Walk& walk : w.walks) units[walk.kind] += w.unitsPerWalk * walk.length;
  double seconds = 0.0;
  // Even if all devices did nothing but the one kind.
  for (std::uint32_t k = 0; k < timing.kinds(); ++k) {
    double rate = 0.0;
    for (std::uint32_t d = 0; d < timing.devices(); ++d) {
      if (!timing.at(d, k).rates.empty()) rate += 1.0 / timing.at(d, k).rates[0];
    }
    if (rate > 0.0) seconds = std::max(seconds, units[k] / rate);
  }
  return seconds;
}

}  // namespace

Bound lowerBound(const Workload& workload, const Graph& graph, const TimingModel& timing,
                 int depth) {
  double held = 0.0, bandwidth = 0.0;
  for (const Memory& m : graph.memories) held += std::isfinite(m.capacity) ? m.capacity : 0.0;
  for (const Channel& c : graph.channels) {
    const bool leaves = std::any_of(c.links.begin(), c.links.end(), [&](const Link& l) {
      return !std::isfinite(graph.memories[l.from].capacity);
    });
    if (leaves) bandwidth += c.bandwidth;
  }
  const std::vector<std::vector<std::uint32_t>> chains = chainsOf(workload);
  std::vector<Rest> rests;
  for (const std::vector<std::uint32_t>& chain : chains) {
    rests.push_back({chain.data(), chain.data() + chain.size()});
  }
  Bound bound;
  bound.bytes = Loads(workload, held).bytes(rests, 0.0, depth);
  bound.loads = bandwidth > 0.0 ? bound.bytes / bandwidth : 0.0;
  bound.work = workSeconds(workload, timing);
  return bound;
}

}  // namespace trex::schedule
