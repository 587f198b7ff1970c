// The machines of HPG 2017 as data: cores, clocks and bandwidths as published of the parts; what a
// unit of work takes on them is ours, one number a kind for all machines.
#pragma once

#include <span>
#include <string>
#include <vector>

#include "src/schedule/graph.h"
#include "src/schedule/timing.h"

namespace trex::schedule {

struct Machine {
  std::string name;
  double cores = 0.0, gigahertz = 0.0;
  std::string gpu;
  double gpuBandwidth = 0.0;  ///< bytes a second of its memory
  double gpuMemory = 0.0;     ///< bytes
  double memory = 8e9;        ///< bytes
};

/// A to D and R. Throws Error(kUsage) for another letter.
Machine machineNamed(char letter);

/// Several machines: each with a disk that has everything, main memory, a device; joined by a
/// switched network if there are several.
struct Cluster {
  std::string name;
  Graph graph;
  TimingModel timing;  ///< of Kind in workloads.h
};
/// One letter a machine, "ABCD".
Cluster clusterOf(const std::string& letters);

}  // namespace trex::schedule
