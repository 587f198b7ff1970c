#include <array>
#include <atomic>
#include <type_traits>

#include "src/core/error.h"
#include "src/core/log.h"
#include "src/grays/grays.h"
#include "src/vulkan/vulkan.h"

namespace trex {

namespace {

class FallbackTracer final : public GRayTracer {
 public:
  explicit FallbackTracer(std::unique_ptr<GRayTracer> device) : tracer_(std::move(device)) {}

  std::string name() const override {
    return replaced_ ? firstName_ + ", then " + tracer_->name() : tracer_->name();
  }
  bool sharesHostCores() const override { return tracer_->sharesHostCores(); }

  int submitGather(std::span<const shaderio::GatherQuery> queries) override {
    Batch& batch = batches_[next_ & 1u];
    if (!replaced_) batch.queries.assign(queries.begin(), queries.end());
    batch.ticket = guarded([&] { return tracer_->submitGather(queries); });
    batch.open = true;
    // The results of the last two batches of the device have been read by now.
    if (replaced_ && failed_ && ++since_ > 2) failed_.reset();
    return static_cast<int>(next_++);
  }

  std::span<const shaderio::GatherResult> finishGather(int ticket) override {
    Batch& batch = batches_[static_cast<unsigned>(ticket) & 1u];
    const auto results = guarded([&] { return tracer_->finishGather(batch.ticket); });
    batch.open = false;
    return results;
  }

  void prepare() override {
    guarded([&] { tracer_->prepare(); });
  }
  void resetFlux() override {
    guarded([&] { tracer_->resetFlux(); });
  }
  void tracePhotons(std::span<const shaderio::PhotonRecord> records, double unit) override {
    guarded([&] { tracer_->tracePhotons(records, unit); });
  }

  using GRayTracer::resolveLight;
  bool resolveLight(std::uint64_t emittedPhotons, const std::function<bool()>& keepGoing) override {
    const int before = losses_;
    return guarded(
        [&] { return losses_ == before && tracer_->resolveLight(emittedPhotons, keepGoing); });
  }

  void refresh(std::span<const shaderio::PhotonMaterial> materials) override {
    guarded([&] { tracer_->refresh(materials); });
  }
  std::span<const asvo::uvec4> light() const override { return tracer_->light(); }
  std::span<const asvo::uvec4> lightBefore() const override { return tracer_->lightBefore(); }

  GRayStatistics statistics() const override {
    GRayStatistics s = tracer_->statistics();
    if (!replaced_) return s;
    s.cones += before_.cones;
    s.deviceCones += before_.deviceCones;
    s.photonRecords += before_.photonRecords;
    s.photonDeposits += before_.photonDeposits;
    s.lostDeposits += before_.lostDeposits;
    s.gatherSeconds += before_.gatherSeconds;
    s.photonSeconds += before_.photonSeconds;
    s.deviceBytes = before_.deviceBytes;
    s.pages = before_.pages;
    s.pageSlots = before_.pageSlots;
    s.pageLoads = before_.pageLoads;
    s.pageEvictions = before_.pageEvictions;
    s.missedReads = before_.missedReads;
    return s;
  }
  int fluxLosses() const override { return losses_; }

 private:
  struct Batch {
    std::vector<shaderio::GatherQuery> queries;  ///< while there is a device that may fail
    int ticket = 0;                              ///< of tracer_
    bool open = false;
  };

  /// Does something with the tracer; once more, with the C++ tracer, if the device fails.
  template <typename Function>
  std::invoke_result_t<const Function&> guarded(const Function& function) {
    try {
      return function();
    } catch (const Error& error) {
      if (replaced_ || error.code() != ExitCode::kMemoryOrDevice) throw;
      takeOver(error);
      return function();
    }
  }

  void takeOver(const Error& error) {
    logWarning("{}; going on with the C++ tracer, as `--device auto` allows", error.what());
    firstName_ = tracer_->name();
    before_ = tracer_->statistics();
    Successor next = tracer_->handOver();
    failed_ = std::move(tracer_);
    tracer_ = std::move(next.tracer);
    replaced_ = true;
    losses_ += next.fluxLost ? 1 : 0;
    for (unsigned i = 0; i < 2; ++i) {  // the older one first
      Batch& batch = batches_[(next_ + i) & 1u];
      if (batch.open) batch.ticket = tracer_->submitGather(batch.queries);
      batch.queries = {};
    }
    if (next_ == 0) failed_.reset();
  }

  std::unique_ptr<GRayTracer> tracer_;
  std::unique_ptr<GRayTracer> failed_;  ///< while results of its cones may be read
  std::string firstName_;
  GRayStatistics before_;
  std::array<Batch, 2> batches_;
  unsigned next_ = 0;
  int since_ = 0;  ///< batches submitted since
  int losses_ = 0;
  bool replaced_ = false;
};

bool startsADevice() {
  try {
    const vulkan::Device device({});
    return true;
  } catch (const Error&) {
    return false;
  }
}

}  // namespace

std::unique_ptr<GRayTracer> makeAutoTracer(const asvo::Tree& tree,
                                           std::span<const shaderio::PhotonMaterial> materials,
                                           const VulkanLimits& limits) {
  try {
    return makeFallbackTracer(makeVulkanTracer(tree, materials, -1, limits));
  } catch (const Error& error) {
    if (error.code() != ExitCode::kMemoryOrDevice || startsADevice()) throw;
    static std::atomic<bool> said = false;
    if (!said.exchange(true)) {
      logWarning("{}; G-rays are the C++ tracer's, as `--device auto` allows", error.what());
    }
    return makeCpuTracer(tree, materials);
  }
}

std::unique_ptr<GRayTracer> makeFallbackTracer(std::unique_ptr<GRayTracer> device) {
  return std::make_unique<FallbackTracer>(std::move(device));
}

}  // namespace trex
