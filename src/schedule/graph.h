// The device connectivity graph: where data may lie, over what it moves, and who works on it
// [Son and Yoon, HPG 2017].
//
//   disk --(SATA)--> main memory --(PCIe)--> device memory
//                        |                       |
//                     CPU threads              device
//
// Plain data. Seconds, bytes, and bytes a second throughout. Thread safe, as long as nobody changes
// it.
#pragma once

#include <cstdint>
#include <limits>
#include <string>
#include <vector>

namespace trex::schedule {

constexpr double kNever = std::numeric_limits<double>::infinity();

/// A place for data. One of infinite capacity is a store (a disk): nothing is evicted from it.
struct Memory {
  std::string name;
  double capacity = kNever;  ///< bytes
};

/// One way from a memory to another, by number.
struct Link {
  std::uint32_t from = 0, to = 0;
};

/// What carries one transfer at a time, over any of its links: a bus, a disk, a network port.
struct Channel {
  std::string name;
  double bandwidth = 0.0;  ///< bytes a second
  double latency = 0.0;    ///< seconds of each transfer
  std::vector<Link> links;
  double seconds(double bytes) const { return latency + bytes / bandwidth; }
};

/// What runs one job at a time.
struct Device {
  std::string name;
  std::uint32_t memory = 0;  ///< where a job finds the items that it reads
  std::uint32_t host = 0;    ///< where it finds what moves (Item::moves), and leaves its results
};

struct Graph {
  std::vector<Memory> memories;  ///< at most 64
  std::vector<Channel> channels;
  std::vector<Device> devices;
};

/// Throws Error(kInput) that names the part: no device, numbers out of range, names that are empty,
/// a rate or capacity that is not positive or not a number, a memory of a device that no store
/// reaches.
void checkGraph(const Graph& graph);

/// Cheapest paths between all memories, for transfers of about a typical size.
class Routes {
 public:
  struct Hop {
    std::uint32_t channel = 0, from = 0, to = 0;
  };
  /// `typicalBytes` weighs latency against bandwidth where there are several paths.
  Routes(const Graph& graph, double typicalBytes);
  /// Hops in order; empty from a memory to itself, and where there is no path.
  const std::vector<Hop>& hops(std::uint32_t from, std::uint32_t to) const {
    return hops_[from * memories_ + to];
  }
  static constexpr std::uint32_t kNoChannel = 0xffffffffu;
  /// That of the first hop; kNoChannel where there is none.
  std::uint32_t firstChannel(std::uint32_t from, std::uint32_t to) const {
    return costs_[from * memories_ + to].first;
  }
  /// Of a transfer that waits for nobody, each hop after the one before; infinite without a path.
  double seconds(std::uint32_t from, std::uint32_t to, double bytes) const {
    const Cost& c = costs_[from * memories_ + to];
    return c.latency + bytes * c.perByte;
  }

 private:
  struct Cost {
    double latency = 0.0, perByte = 0.0;
    std::uint32_t first = kNoChannel;
  };
  std::uint32_t memories_;
  std::vector<std::vector<Hop>> hops_;
  std::vector<Cost> costs_;
};

}  // namespace trex::schedule
