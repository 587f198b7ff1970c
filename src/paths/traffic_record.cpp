#include "src/paths/traffic_record.h"

#include <fmt/format.h>

#include <algorithm>

#include "src/paths/load_choice.h"
#include "src/schedule/chrome_trace.h"
#include "src/schedule/picture.h"

namespace trex {
namespace {

constexpr std::uint32_t kCones = LoadChoice::kBegin - 1;  // no page

}  // namespace

TrafficRecord::TrafficRecord(unsigned tracing, unsigned reading, bool gathers)
    : tracing_(tracing), planned_(tracing), gathers_(tracing + 1) {
  graph_.memories = {{"disk"}, {"memory"}};
  const auto addChannel = [&](const std::string& name) {
    graph_.channels.push_back({name, 1.0, 0.0, {{0, 1}}});
  };
  for (unsigned i = 0; i < tracing; ++i) {
    graph_.devices.push_back({fmt::format("thread {}", i), 1, 1});
    addChannel(fmt::format("loads, thread {}", i));
  }
  for (unsigned i = 0; i < reading; ++i) addChannel(fmt::format("reads {}", i));
  graph_.devices.push_back({"planned", 1, 1});
  if (gathers) {
    graph_.devices.push_back({"cones", 1, 1});
    graph_.devices.push_back({"planned cones", 1, 1});
  }
  addChannel("planned reads");
}

void TrafficRecord::traced(unsigned thread, std::uint32_t page, double start, double end) {
  const std::lock_guard lock(mutex_);
  if (happened_.runs.size() >= kMostEvents) return;
  happened_.runs.push_back({page, thread, start, end, {}});
}

void TrafficRecord::gathered(double start, double end) { traced(gathers_, kCones, start, end); }

void TrafficRecord::plannedGather(double start, double end) {
  traced(gathers_ + 1, kCones, start, end);
}

void TrafficRecord::loaded(unsigned thread, std::uint32_t page, double start, double end) {
  fetched(thread, page, start, end);
}

void TrafficRecord::read(unsigned reader, std::uint32_t page, double start, double end) {
  fetched(tracing_ + reader, page, start, end);
}

void TrafficRecord::fetched(std::uint32_t channel, std::uint32_t page, double start, double end) {
  const std::lock_guard lock(mutex_);
  if (happened_.fetches.size() >= kMostEvents) return;
  happened_.fetches.push_back({page, channel, 0, 1, start, end, {}});
}

void TrafficRecord::planned(const schedule::Schedule& plan,
                            const std::function<std::uint32_t(std::uint32_t)>& pageOfItem,
                            const std::function<std::uint32_t(std::uint32_t)>& pageOfJob) {
  const std::lock_guard lock(mutex_);
  if (happened_.fetches.size() >= kMostEvents || happened_.runs.size() >= kMostEvents) return;
  const auto channel = static_cast<std::uint32_t>(graph_.channels.size() - 1);
  for (const schedule::Run& r : plan.runs)
    happened_.runs.push_back({pageOfJob(r.job), planned_, r.start, r.end, {}});
  for (const schedule::Fetch& f : plan.fetches)
    happened_.fetches.push_back({pageOfItem(f.item), channel, 0, 1, f.start, f.end, {}});
}

/// What happened, with times from the first event.
schedule::Schedule TrafficRecord::fromStart() const {
  const std::lock_guard lock(mutex_);
  schedule::Schedule out = happened_;
  double first = schedule::kNever;
  for (const auto& r : out.runs) first = std::min(first, r.start);
  for (const auto& f : out.fetches) first = std::min(first, f.start);
  for (auto& r : out.runs) r.start -= first, r.end -= first;
  for (auto& f : out.fetches) f.start -= first, f.end -= first;
  return out;
}

std::string TrafficRecord::chromeTrace() const {
  schedule::Names names;
  names.job = [](std::uint32_t page) {
    if (page == kCones) return std::string("cones");
    return page == LoadChoice::kBegin ? std::string("new paths") : fmt::format("page {}", page);
  };
  names.item = [](std::uint32_t page) { return fmt::format("page {}", page); };
  return schedule::chromeTrace(graph_, fromStart(), names);
}

std::string TrafficRecord::svg(const std::string& title) const {
  return schedule::timelineSvg(graph_, fromStart(), title);
}

}  // namespace trex
