#include "src/schedule/graph.h"

#include <cmath>

#include "src/core/error.h"

namespace trex::schedule {
namespace {

constexpr std::size_t kMostMemories = 64;  ///< Item::copies has a bit for each

bool positive(double v) { return std::isfinite(v) && v > 0.0; }

void checkMemory(const Memory& m) {
  if (m.name.empty()) fail(ExitCode::kInput, "device graph: a memory has no name");
  if (!(m.capacity > 0.0)) {
    fail(ExitCode::kInput, "device graph, memory {}: capacity {} is not positive", m.name,
         m.capacity);
  }
}

void checkChannel(const Channel& c, std::size_t memories) {
  if (c.name.empty()) fail(ExitCode::kInput, "device graph: a channel has no name");
  if (!positive(c.bandwidth)) {
    fail(ExitCode::kInput, "device graph, channel {}: bandwidth {} is not positive and finite",
         c.name, c.bandwidth);
  }
  if (!std::isfinite(c.latency) || c.latency < 0.0) {
    fail(ExitCode::kInput, "device graph, channel {}: latency {} is not finite and at least 0",
         c.name, c.latency);
  }
  for (const Link& link : c.links) {
    if (link.from < memories && link.to < memories && link.from != link.to) continue;
    fail(ExitCode::kInput, "device graph, channel {}: a link from memory {} to {} of {}", c.name,
         link.from, link.to, memories);
  }
}

/// Both the device's memories can be reached from a store, if there is one.
void checkReach(const Graph& graph, const Device& device) {
  const Routes routes(graph, 1.0);
  bool stores = false, reached = false;
  for (std::uint32_t m = 0; m < graph.memories.size(); ++m) {
    if (std::isfinite(graph.memories[m].capacity)) continue;
    stores = true;
    reached |= std::isfinite(routes.seconds(m, device.memory, 1.0));
  }
  if (stores && !reached) {
    fail(ExitCode::kInput, "device graph: no channel leads from a store to memory {} of device {}",
         graph.memories[device.memory].name, device.name);
  }
}

}  // namespace

void checkGraph(const Graph& graph) {
  const std::size_t memories = graph.memories.size();
  if (graph.devices.empty()) fail(ExitCode::kInput, "device graph: there is no device");
  if (memories > kMostMemories) {
    fail(ExitCode::kInput, "device graph: {} memories, at most {} are possible", memories,
         kMostMemories);
  }
  for (const Memory& m : graph.memories) checkMemory(m);
  for (const Channel& c : graph.channels) checkChannel(c, memories);
  for (const Device& d : graph.devices) {
    if (d.name.empty()) fail(ExitCode::kInput, "device graph: a device has no name");
    if (d.memory >= memories || d.host >= memories) {
      fail(ExitCode::kInput, "device graph, device {}: memory {} or {} of {}", d.name, d.memory,
           d.host, memories);
    }
    checkReach(graph, d);
  }
}

Routes::Routes(const Graph& graph, double typicalBytes)
    : memories_(static_cast<std::uint32_t>(graph.memories.size())),
      hops_(memories_ * memories_),
      costs_(memories_ * memories_, {kNever, 0.0, kNoChannel}) {
  for (std::uint32_t m = 0; m < memories_; ++m) costs_[m * memories_ + m] = {};
  for (std::uint32_t c = 0; c < graph.channels.size(); ++c) {
    const Channel& channel = graph.channels[c];
    for (const Link& link : channel.links) {
      if (channel.seconds(typicalBytes) >= seconds(link.from, link.to, typicalBytes)) continue;
      costs_[link.from * memories_ + link.to] = {channel.latency, 1.0 / channel.bandwidth, c};
      hops_[link.from * memories_ + link.to] = {{c, link.from, link.to}};
    }
  }
  for (std::uint32_t k = 0; k < memories_; ++k) {  // [Floyd 1962]
    for (std::uint32_t i = 0; i < memories_; ++i) {
      for (std::uint32_t j = 0; j < memories_; ++j) {
        const Cost a = costs_[i * memories_ + k], b = costs_[k * memories_ + j];
        const Cost sum{a.latency + b.latency, a.perByte + b.perByte, a.first};
        if (!(sum.latency + typicalBytes * sum.perByte < seconds(i, j, typicalBytes))) continue;
        costs_[i * memories_ + j] = sum;
        std::vector<Hop> path = hops_[i * memories_ + k];
        const std::vector<Hop>& rest = hops_[k * memories_ + j];
        path.insert(path.end(), rest.begin(), rest.end());
        hops_[i * memories_ + j] = std::move(path);
      }
    }
  }
}

}  // namespace trex::schedule
