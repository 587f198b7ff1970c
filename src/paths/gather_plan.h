// When the device will have gathered the cones of paths that wait for pages, planned as loads are.
#pragma once

#include <cstddef>
#include <vector>

#include "src/paths/traffic_record.h"
#include "src/schedule/graph.h"
#include "src/schedule/timing.h"

namespace trex {

/// A job of schedule::plan() for each set of cones, on a machine of one device, with the times of
/// those before. It decides nothing: the device has one job at a time, as soon as the cones are
/// there. One thread at a time.
class GatherPlan {
 public:
  /// The record must outlive it.
  explicit GatherPlan(TrafficRecord& record);
  /// So many cones, above 0, go to the device.
  void begin(std::size_t cones);
  /// It has answered all of them.
  void end();

 private:
  static constexpr std::size_t kSamples = 64;  ///< that times are fitted to, the newest

  TrafficRecord& record_;
  schedule::Graph graph_;
  schedule::TimingModel timing_{1, 1};
  std::vector<schedule::TimingSample> samples_;
  double cones_ = 0.0, begun_ = 0.0;
};

}  // namespace trex
