#include "src/schedule/machines.h"

#include <fmt/format.h>

#include "src/core/error.h"
#include "src/schedule/workloads.h"

namespace trex::schedule {
namespace {

constexpr double kSystemMemory = 2.5e9;  ///< of main memory: system, rays, picture
constexpr double kDeviceReserve = 1e9;   ///< of a device's memory: rays, results
// A SATA disk of flash, PCIe 3.0 x16, and Ethernet, as they are in practice.
constexpr double kDisk = 500e6, kDiskLatency = 1e-4;
constexpr double kPcie = 10e9, kPcieLatency = 2e-5;
constexpr double kEthernet = 117e6, kEthernetLatency = 2e-4;
constexpr double kCpuSetup = 1e-3, kGpuSetup = 3e-3;  ///< seconds a job

/// Units a second of a kind: for each core and GHz, and for each GB/s of a device's memory.
struct UnitRates {
  double cpu = 0.0, gpu = 0.0;
};
constexpr UnitRates kRates[kKinds] = {
    {0.57e6, 0.21e6},  // rays: 8 M/s on four cores of 3.5 GHz, 60 M/s on a Titan
    {1.0e6, 0.05e6},   // traversal branches
    {1.5e6, 1.5e6},    // tests do not
    {0.3e6, 0.3e6},
};

}  // namespace

Machine machineNamed(char letter) {
  switch (letter) {
    case 'A':  // i7-4770K, GTX Titan
      return {"A", 4, 3.5, "GTX Titan", 288e9, 6e9};
    case 'B':  // i7-4790K, GTX Titan
      return {"B", 4, 4.0, "GTX Titan", 288e9, 6e9};
    case 'C':  // Xeon E5-2690, GTX Titan
      return {"C", 8, 2.9, "GTX Titan", 288e9, 6e9};
    case 'D':  // Xeon E5-2690 v3, Titan X
      return {"D", 12, 2.6, "Titan X", 336e9, 12e9};
    case 'R':  // i7-3770K, GTX 980
      return {"R", 4, 3.5, "GTX 980", 224e9, 4e9};
    default:
      fail(ExitCode::kUsage, "machine {}: there are A, B, C, D and R", letter);
  }
}

Cluster clusterOf(const std::string& letters) {
  if (letters.empty() || letters.size() > 16) {
    fail(ExitCode::kUsage, "machines '{}': give 1 to 16 letters of A, B, C, D and R", letters);
  }
  const auto count = static_cast<std::uint32_t>(letters.size());
  Cluster cluster{letters, {}, TimingModel(2 * count, kKinds)};
  Graph& g = cluster.graph;
  for (std::uint32_t i = 0; i < count; ++i) {
    const Machine m = machineNamed(letters[i]);
    const std::string name = count > 1 ? fmt::format("{}{} ", m.name, i + 1) : m.name + " ";
    const std::uint32_t disk = 3 * i, main = disk + 1, device = disk + 2;
    g.memories.push_back({name + "disk", kNever});
    g.memories.push_back({name + "main", m.memory - kSystemMemory});
    g.memories.push_back({name + "device", m.gpuMemory - kDeviceReserve});
    g.channels.push_back({name + "SATA", kDisk, kDiskLatency, {{disk, main}}});
    g.channels.push_back({name + "PCIe", kPcie, kPcieLatency, {{main, device}, {device, main}}});
    g.devices.push_back({name + "CPU", main, main});
    g.devices.push_back({name + m.gpu, device, main});
    for (std::uint32_t k = 0; k < kKinds; ++k) {
      const double cpu = kRates[k].cpu * m.cores * m.gigahertz;
      const double gpu = kRates[k].gpu * m.gpuBandwidth * 1e-9;
      cluster.timing.set(2 * i, k, {kCpuSetup, {1.0 / cpu}});
      cluster.timing.set(2 * i + 1, k, {kGpuSetup, {1.0 / gpu}});
    }
  }
  for (std::uint32_t i = 0; count > 1 && i < count; ++i) {
    Channel port{fmt::format("{}{} Ethernet", letters[i], i + 1), kEthernet, kEthernetLatency, {}};
    for (std::uint32_t j = 0; j < count; ++j) {
      if (j != i) port.links.push_back({3 * i + 1, 3 * j + 1});
    }
    g.channels.push_back(std::move(port));
  }
  return cluster;
}

}  // namespace trex::schedule
