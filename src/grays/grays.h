// G-rays: cones through the ASVO and photons, on a Vulkan device or, with the same text of the
// tracer, on the CPU. CONTRACT.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "asvo/asvo.h"
#include "src/grays/shaderio.h"

namespace trex {

struct GRayStatistics {
  std::uint64_t cones = 0, photonRecords = 0, photonDeposits = 0, lostDeposits = 0;
  double gatherSeconds = 0.0, photonSeconds = 0.0;
  std::uint64_t deviceBytes = 0;
};

/// One tracer of G-rays over one tree. Not thread safe: one caller at a time, but submit() returns
/// at once and the work goes on beside the caller.
class GRayTracer {
 public:
  virtual ~GRayTracer() = default;
  /// "llvmpipe (LLVM 15.0.6, 256 bits)" or "cpu".
  virtual std::string name() const = 0;
  /// True if the device computes on the host's own cores (lavapipe, cpu).
  virtual bool sharesHostCores() const = 0;

  /// Starts cones; at most two batches may be under way (double buffering). Returns a ticket.
  virtual int submitGather(std::span<const shaderio::GatherQuery> queries) = 0;
  /// Waits for a batch; results in the order of its queries. Valid until the batch after next.
  virtual std::span<const shaderio::GatherResult> finishGather(int ticket) = 0;

  /// Forgets all flux (a light edit).
  virtual void resetFlux() = 0;
  /// Deposits each record as direct flux at its voxel, then bounces it through the ASVO (Russian
  /// roulette by albedo, at most 64 bounces), depositing indirect flux. Sums are 64-bit fixed point
  /// with `unit` watts a count: free of order, equal bits on every run.
  virtual void tracePhotons(std::span<const shaderio::PhotonRecord> records, double unit) = 0;
  /// Filters flux up the tree (sums of flux over sums of area) and turns it into irradiance,
  /// divided by `emittedPhotons`. Afterwards light() and gathers see it. `keepGoing` is asked every
  /// millisecond or so; false if it said no: light() is then as it was, and the next call with the
  /// same sums goes on.
  virtual bool resolveLight(std::uint64_t emittedPhotons,
                            const std::function<bool()>& keepGoing) = 0;
  void resolveLight(std::uint64_t emittedPhotons) {
    resolveLight(emittedPhotons, [] { return true; });
  }
  /// Reads the tree's voxels and the materials anew: their values have changed, their number has
  /// not. Waits for the cones under way.
  virtual void refresh(std::span<const shaderio::PhotonMaterial> materials) = 0;
  /// Irradiance as in asvo_layout.h light[], on the host; nodeCount entries.
  virtual std::span<const asvo::uvec4> light() const = 0;
  virtual GRayStatistics statistics() const = 0;
};

/// The C++ build of the tracer (oneTBB).
std::unique_ptr<GRayTracer> makeCpuTracer(const asvo::Tree& tree,
                                          std::span<const shaderio::PhotonMaterial> materials);

/// Limits below the device's own; 0 keeps those.
struct VulkanLimits {
  std::uint64_t maxBytes = 0;               ///< `--max-gpu-memory`
  std::uint64_t maxStorageBufferRange = 0;  ///< for tests
  bool forceStaging = false;                ///< copy as if device memory were not mapped (tests)
  bool storageBuffers = false;              ///< read the tree as a GPU does, on any device (tests)
  /// Simulated failures, see vulkan::DeviceOptions (tests).
  std::uint64_t failAllocation = 0, failSubmit = 0, failWait = 0;
};

/// On Vulkan device number `device` (order of enumeration), or the best one with -1. Throws
/// Error(kMemoryOrDevice) that says what is missing and names `--device none`.
std::unique_ptr<GRayTracer> makeVulkanTracer(const asvo::Tree& tree,
                                             std::span<const shaderio::PhotonMaterial> materials,
                                             int device, const VulkanLimits& limits = {});

}  // namespace trex
