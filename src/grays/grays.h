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
  std::uint64_t deviceCones = 0;  ///< of the cones, answered by a Vulkan device
  double gatherSeconds = 0.0, photonSeconds = 0.0;
  std::uint64_t deviceBytes = 0;
  /// Of a tree that does not fit on the device; all 0 if it does. Reads of voxels that were not
  /// there got the next coarser one.
  std::uint64_t pages = 0, pageSlots = 0, pageLoads = 0, pageEvictions = 0, missedReads = 0;
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

  /// Makes what the first photons need, memory, shaders and tables, so that they need not wait for
  /// it. Of no effect on what comes out.
  virtual void prepare() {}
  /// Forgets all flux (a light edit).
  virtual void resetFlux() = 0;
  /// Deposits each record as direct flux at its voxel, then bounces it through the ASVO (Russian
  /// roulette by albedo, at most kMostPhotonBounces), depositing indirect flux. Sums are 64-bit
  /// fixed point with `unit` watts a count: free of order, equal bits on every run.
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
  /// What light() was before the last resolveLight() that was done; until the next one is called.
  virtual std::span<const asvo::uvec4> lightBefore() const = 0;
  virtual GRayStatistics statistics() const = 0;

  /// A tracer that goes on in the place of another, and whether flux was lost on the way.
  struct Successor {
    std::unique_ptr<GRayTracer> tracer;
    bool fluxLost = false;
  };
  /// After an error of the device: the C++ tracer with the last resolved light() and lightBefore()
  /// (at the same addresses) and what is left of the flux. Results of cones stay valid; nothing
  /// else may be asked of this tracer any more. Null for tracers without a device.
  virtual Successor handOver() { return {}; }
  /// How often flux was lost with a device so far (makeFallbackTracer()): photons traced before do
  /// not count any more, and the next resolveLight() must not count them.
  virtual int fluxLosses() const { return 0; }
};

/// The C++ build of the tracer (oneTBB). `light`, `before`: what light() and lightBefore() are at
/// first; empty for none.
std::unique_ptr<GRayTracer> makeCpuTracer(const asvo::Tree& tree,
                                          std::span<const shaderio::PhotonMaterial> materials,
                                          std::vector<asvo::uvec4> light = {},
                                          std::vector<asvo::uvec4> before = {});

/// Limits below the device's own; 0 keeps those.
struct VulkanLimits {
  std::uint64_t maxBytes = 0;               ///< `--max-gpu-memory`
  std::uint64_t maxStorageBufferRange = 0;  ///< for tests
  bool forceStaging = false;                ///< copy as if device memory were not mapped (tests)
  bool storageBuffers = false;              ///< read the tree as a GPU does, on any device (tests)
  std::uint32_t pageBits = 0;               ///< a page is 2^pageBits voxels; 0: kPageBits (tests)
  /// Simulated failures, see vulkan::DeviceOptions (tests).
  std::uint64_t failAllocation = 0, failSubmit = 0, failWait = 0;
};

/// On Vulkan device number `device` (order of enumeration), or the best one with -1. A tree that
/// does not fit is paged: photons are then the C++ tracer's, cones read the pages that are there
/// (src/grays/page_table.h). Throws Error(kMemoryOrDevice) that says what is missing and names
/// `--device none`.
std::unique_ptr<GRayTracer> makeVulkanTracer(const asvo::Tree& tree,
                                             std::span<const shaderio::PhotonMaterial> materials,
                                             int device, const VulkanLimits& limits = {});

/// What `--device auto` asks for: the best device, with makeFallbackTracer() around it. Where none
/// can be started it is the C++ tracer, and one warning a process says why. Throws
/// Error(kMemoryOrDevice) if there is a device but not what the tree needs of it.
std::unique_ptr<GRayTracer> makeAutoTracer(const asvo::Tree& tree,
                                           std::span<const shaderio::PhotonMaterial> materials,
                                           const VulkanLimits& limits = {});

/// Takes a device's tracer and, should the device fail later, goes on with the C++ tracer: one
/// warning, open batches are traced anew, nothing is thrown. Light is the last one resolved until
/// the next resolveLight(); where that call itself lost the flux it returns false, and fluxLosses()
/// has grown.
std::unique_ptr<GRayTracer> makeFallbackTracer(std::unique_ptr<GRayTracer> device);

}  // namespace trex
