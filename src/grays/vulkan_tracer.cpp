#include <cassert>
#include <chrono>

#include "src/core/log.h"
#include "src/grays/grays.h"
#include "src/grays/page_plan.h"
#include "src/grays/paged_tracer.h"
#include "src/grays/resolve.h"
#include "src/grays/tables.h"
#include "src/grays/vulkan_passes.h"

namespace trex {

namespace {

/// Queries and results of two batches of 2^17 cones, and records of photons.
constexpr std::uint64_t kWorkBytes = 24u << 20;

/// Whether all of a tree fits on the device, with its light and flux and what tracing needs.
bool fits(const vulkan::Device& device, const asvo::Tree& tree) {
  const std::uint64_t nodes = tree.nodes.size(), leaves = tree.leaves.size();
  if (leaves == 0) return true;
  const std::uint64_t sums = leaves * kWordsPerLeaf * 4;
  const std::uint64_t grids = (std::uint64_t{8} << (3 * photonGridLevel(tree.info))) +
                              (std::uint64_t{8} << (3 * coneGridLevel(tree.info)));
  const std::uint64_t need =
      (2 * nodes + brickCount(tree)) * 16 + leaves * 8 + 2 * sums + grids + kWorkBytes;
  return std::max(sums, nodes * 16) <= device.info().maxStorageBufferRange &&
         need <= device.maxBytes();
}

class VulkanTracer final : public GRayTracer {
 public:
  VulkanTracer(const asvo::Tree& tree, std::span<const shaderio::PhotonMaterial> materials,
               std::unique_ptr<vulkan::Device> device, bool storageBuffers)
      : tree_(tree),
        materials_(materials.begin(), materials.end()),
        light_(tree.nodes.size()),
        coneTable_(tree),
        owned_(std::move(device)),
        device_(*owned_) {
    if (tree.info.leafCount > 0) {
      buffers_.emplace(device_, tree, storageBuffers);
      gather_.emplace(device_, *buffers_, tree);
    }
    const vulkan::StartTimes times = device_.startTimes();
    logVerbose("{}: instance {:.3f} s, device {:.3f} s, {} MiB for the voxel tree", name(),
               times.instance, times.device, device_.allocatedBytes() >> 20);
  }

  ~VulkanTracer() override {
    logVerbose("{}: compiling shaders took {:.3f} s", name(), device_.startTimes().kernels);
  }

  std::string name() const override { return device_.info().name; }
  bool sharesHostCores() const override { return device_.info().sharesHostCores; }

  int submitGather(std::span<const shaderio::GatherQuery> queries) override {
    if (gather_) {
      refreshCones();
      return gather_->submit(queries);
    }
    clear_[nextClear_ & 1u].assign(queries.size(), {glm::vec3(0.0f), 1.0f});
    return static_cast<int>(nextClear_++);
  }

  std::span<const shaderio::GatherResult> finishGather(int ticket) override {
    std::span<const shaderio::GatherResult> results = clear_[static_cast<unsigned>(ticket) & 1u];
    if (gather_) results = gather_->finish(ticket);
    cones_ += results.size();
    return results;
  }

  void prepare() override {
    if (!buffers_) return;
    light_.prepare(tree_);
    if (!photons_) photons_.emplace(device_, *buffers_, materials_);
    photons_->prepare();
  }
  void resetFlux() override {
    light_.restart();
    if (photons_) photons_->reset();
    hasFlux_ = false;
  }

  void refresh(std::span<const shaderio::PhotonMaterial> materials) override {
    materials_.assign(materials.begin(), materials.end());
    if (!buffers_) return;
    gather_->waitAll();
    buffers_->voxels.upload(std::as_bytes(std::span(tree_.voxels)));
    if (photons_) photons_->setMaterials(materials_);
    coneTable_.lightChanged();
  }

  void tracePhotons(std::span<const shaderio::PhotonRecord> records, double unit) override {
    const auto start = std::chrono::steady_clock::now();
    unit_ = unit;
    light_.restart();
    statistics_.photonRecords += records.size();
    if (!buffers_) {
      statistics_.lostDeposits += records.size();
      return;
    }
    if (!photons_) photons_.emplace(device_, *buffers_, materials_);
    const PhotonPass::Counts counts = photons_->trace(records, static_cast<float>(1.0 / unit));
    hasFlux_ = true;
    statistics_.photonDeposits += counts.deposits;
    statistics_.lostDeposits += counts.lost;
    statistics_.photonSeconds +=
        std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  }

  using GRayTracer::resolveLight;
  bool resolveLight(std::uint64_t emittedPhotons, const std::function<bool()>& keepGoing) override {
    if (!buffers_ || emittedPhotons == 0) return true;
    if (!photons_) photons_.emplace(device_, *buffers_, materials_);
    if (!light_.resolve(tree_, photons_->directWords(), photons_->indirectWords(),
                        unit_ / static_cast<double>(emittedPhotons), emittedPhotons, keepGoing)) {
      return false;
    }
    coneTable_.lightChanged();
    return true;
  }

  std::span<const asvo::uvec4> light() const override { return light_.front(); }
  std::span<const asvo::uvec4> lightBefore() const override { return light_.before(); }

  GRayStatistics statistics() const override {
    GRayStatistics s = statistics_;
    s.cones = s.deviceCones = cones_;
    s.gatherSeconds = gather_ ? gather_->seconds() : 0.0;
    s.deviceBytes = device_.allocatedBytes();
    return s;
  }

  Successor handOver() override {
    light_.restart();
    return {makeCpuTracer(tree_, materials_, light_.take(), light_.takeBefore()), hasFlux_};
  }

 private:
  void refreshCones() {
    if (!coneTable_.stale()) return;
    gather_->waitAll();
    coneTable_.refresh(light_.front(), materials_);
    buffers_->cones.upload(std::as_bytes(coneTable_.words()));
  }

  const asvo::Tree& tree_;
  std::vector<shaderio::PhotonMaterial> materials_;
  LightBuffers light_;
  ConeTable coneTable_;
  std::unique_ptr<vulkan::Device> owned_;
  vulkan::Device& device_;
  std::optional<TreeBuffers> buffers_;  // none for an empty tree: every cone is clear
  std::optional<GatherPass> gather_;
  std::optional<PhotonPass> photons_;
  std::array<std::vector<shaderio::GatherResult>, 2> clear_;
  unsigned nextClear_ = 0;
  bool hasFlux_ = false;
  std::uint64_t cones_ = 0;
  double unit_ = 0.0;
  GRayStatistics statistics_;
};

}  // namespace

std::unique_ptr<GRayTracer> makeVulkanTracer(const asvo::Tree& tree,
                                             std::span<const shaderio::PhotonMaterial> materials,
                                             int device, const VulkanLimits& limits) {
  vulkan::DeviceOptions options;
  options.index = device;
  options.maxBytes = limits.maxBytes;
  options.maxStorageBufferRange = limits.maxStorageBufferRange;
  options.forceStaging = limits.forceStaging;
  options.failAllocation = limits.failAllocation;
  options.failSubmit = limits.failSubmit;
  options.failWait = limits.failWait;
  auto made = std::make_unique<vulkan::Device>(options);
  if (!fits(*made, tree)) {
    return makePagedTracer(tree, materials, std::move(made), limits.storageBuffers,
                           limits.pageBits > 0 ? limits.pageBits : kPageBits);
  }
  return std::make_unique<VulkanTracer>(tree, materials, std::move(made), limits.storageBuffers);
}

}  // namespace trex
