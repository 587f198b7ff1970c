// What was planned and what happened while paths waited for pages: for `--trace`.
#pragma once

#include <functional>
#include <mutex>
#include <string>

#include "src/schedule/graph.h"
#include "src/schedule/schedule.h"

namespace trex {

/// Rows: each thread that traces, what it loads and what the reading threads read, and likewise
/// what the plans said. Thread safe.
class TrafficRecord {
 public:
  /// Later events are left out.
  static constexpr std::size_t kMostEvents = 1u << 20;

  /// `gathers`: there is a row for cones, too.
  TrafficRecord(unsigned tracing, unsigned reading, bool gathers = false);

  /// A thread has traced rays of a page (LoadChoice::kBegin: has begun paths). Seconds as
  /// secondsNow().
  void traced(unsigned thread, std::uint32_t page, double start, double end);
  /// It has read or unpacked a page.
  void loaded(unsigned thread, std::uint32_t page, double start, double end);
  /// A reading thread has read one.
  void read(unsigned reader, std::uint32_t page, double start, double end);
  /// A device has gathered cones, and was expected to. Only with a row for them.
  void gathered(double start, double end);
  void plannedGather(double start, double end);
  /// `pageOf`: of items and of jobs.
  void planned(const schedule::Schedule& plan,
               const std::function<std::uint32_t(std::uint32_t)>& pageOfItem,
               const std::function<std::uint32_t(std::uint32_t)>& pageOfJob);

  /// For trace viewers; times from the first event.
  std::string chromeTrace() const;
  /// One row a device and channel.
  std::string svg(const std::string& title) const;

 private:
  void fetched(std::uint32_t channel, std::uint32_t page, double start, double end);
  schedule::Schedule fromStart() const;

  mutable std::mutex mutex_;
  schedule::Graph graph_;
  schedule::Schedule happened_;
  unsigned tracing_;
  std::uint32_t planned_, gathers_;  ///< devices: loads as planned; cones, and as planned
};

}  // namespace trex
