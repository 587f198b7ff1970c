#include "src/grays/paged_tracer.h"

#include <optional>

#include "src/core/error.h"
#include "src/core/log.h"
#include "src/grays/paged_gather.h"
#include "src/grays/tables.h"

namespace trex {

namespace {

class PagedTracer final : public GRayTracer {
 public:
  PagedTracer(const asvo::Tree& tree, std::span<const shaderio::PhotonMaterial> materials,
              std::unique_ptr<vulkan::Device> device, const PagePlan& plan)
      : tree_(tree),
        materials_(materials.begin(), materials.end()),
        host_(makeCpuTracer(tree, materials)),
        coneTable_(tree),
        device_(std::move(device)),
        plan_(plan) {
    logVerbose(
        "{}: {} voxels in pages of {}: {} of {} pages at a time, {} always, grid of level {}",
        name(), tree.nodes.size(), plan.pageNodes(), plan.slots, plan.pages, plan.resident,
        plan.gridLevel);
  }

  ~PagedTracer() override {
    if (!gather_) return;
    const PageTable& pages = gather_->pages();
    logVerbose("{}: {} pages loaded, {} evicted, {} reads missed", name(), pages.loaded(),
               pages.evicted(), pages.missedReads());
  }

  std::string name() const override { return device_->info().name; }
  bool sharesHostCores() const override { return device_->info().sharesHostCores; }

  int submitGather(std::span<const shaderio::GatherQuery> queries) override {
    if (!gather_) {
      gather_.emplace(*device_, tree_, plan_);
      coneTable_.lightChanged();
    }
    if (coneTable_.stale()) {
      gather_->drain();  // with the light of before
      coneTable_.refresh(host_->light(), materials_);
      gather_->setCones(coneTable_.words());
    }
    return gather_->submit(queries);
  }

  std::span<const shaderio::GatherResult> finishGather(int ticket) override {
    const auto results = gather_->finish(ticket);
    cones_ += results.size();
    return results;
  }

  void prepare() override { host_->prepare(); }
  void resetFlux() override { host_->resetFlux(); }

  void tracePhotons(std::span<const shaderio::PhotonRecord> records, double unit) override {
    host_->tracePhotons(records, unit);
  }

  using GRayTracer::resolveLight;
  bool resolveLight(std::uint64_t emittedPhotons, const std::function<bool()>& keepGoing) override {
    if (!host_->resolveLight(emittedPhotons, keepGoing)) return false;
    coneTable_.lightChanged();
    return true;
  }

  void refresh(std::span<const shaderio::PhotonMaterial> materials) override {
    materials_.assign(materials.begin(), materials.end());
    host_->refresh(materials);
    coneTable_.lightChanged();
  }

  std::span<const asvo::uvec4> light() const override { return host_->light(); }
  std::span<const asvo::uvec4> lightBefore() const override { return host_->lightBefore(); }

  GRayStatistics statistics() const override {
    GRayStatistics s = host_->statistics();
    s.cones = s.deviceCones = cones_;
    s.deviceBytes = device_->allocatedBytes();
    s.pages = plan_.pages;
    s.pageSlots = plan_.slots;
    if (!gather_) return s;
    s.gatherSeconds = gather_->seconds();
    s.pageLoads = gather_->pages().loaded();
    s.pageEvictions = gather_->pages().evicted();
    s.missedReads = gather_->pages().missedReads();
    return s;
  }

  Successor handOver() override { return {std::move(host_), false}; }

 private:
  const asvo::Tree& tree_;
  std::vector<shaderio::PhotonMaterial> materials_;
  std::unique_ptr<GRayTracer> host_;  ///< photons and light
  ConeTable coneTable_;
  std::unique_ptr<vulkan::Device> device_;
  PagePlan plan_;
  std::optional<PagedGather> gather_;  ///< made when a cone first asks
  std::uint64_t cones_ = 0;
};

}  // namespace

std::unique_ptr<GRayTracer> makePagedTracer(const asvo::Tree& tree,
                                            std::span<const shaderio::PhotonMaterial> materials,
                                            std::unique_ptr<vulkan::Device> device,
                                            bool storageBuffers, std::uint32_t pageBits) {
  const PagePlan plan = planPages(tree, pageLimits(*device, storageBuffers), pageBits);
  const std::uint64_t range = device->info().maxStorageBufferRange;
  if (plan.largest > range) {
    fail(
        ExitCode::kMemoryOrDevice,
        "cones through a voxel tree of {} leaves need a storage buffer of {} bytes at least but {} "
        "offers at most {}: choose another `--device N`, or use `--device none`",
        tree.info.leafCount, plan.largest, device->info().name, range);
  }
  if (plan.bytes > device->maxBytes()) {
    fail(ExitCode::kMemoryOrDevice,
         "cones through a voxel tree of {} leaves need {} bytes on {} at least, allowed are {}: "
         "raise `--max-gpu-memory`, or use `--device none`",
         tree.info.leafCount, plan.bytes, device->info().name, device->maxBytes());
  }
  return std::make_unique<PagedTracer>(tree, materials, std::move(device), plan);
}

}  // namespace trex
