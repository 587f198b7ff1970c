#include <cassert>
#include <chrono>

#include "src/core/error.h"
#include "src/core/log.h"
#include "src/grays/grays.h"
#include "src/grays/resolve.h"
#include "src/grays/tables.h"
#include "src/grays/vulkan_passes.h"

namespace trex {

namespace {

/// Queries and results of two batches of a million cones, and records of photons.
constexpr std::uint64_t kWorkBytes = 160u << 20;

/// Says what the tree needs, and what the device has, before the first byte is allocated.
void requireRoom(const vulkan::Device& device, const asvo::Tree& tree) {
  const std::uint64_t nodes = tree.nodes.size(), leaves = tree.leaves.size();
  const std::uint64_t sums = leaves * kWordsPerLeaf * 4;
  const std::uint64_t range = device.info().maxStorageBufferRange;
  const std::uint64_t largest = std::max(sums, nodes * sizeof(asvo::uvec4));
  if (largest > range) {
    fail(ExitCode::kMemoryOrDevice,
         "a voxel tree of {} leaves needs a storage buffer of {} bytes but {} offers at most {}: "
         "lower the voxel depth, choose another `--device N`, or use `--device none`",
         leaves, largest, device.info().name, range);
  }
  const std::uint64_t grid = leaves > 0 ? std::uint64_t{8} << (3 * photonGridLevel(tree.info)) : 0;
  const std::uint64_t bricks = leaves > 0 ? brickCount(tree) : 0;
  const std::uint64_t need = (2 * nodes + bricks) * 16 + leaves * 8 + 2 * sums + grid;
  if (need > device.maxBytes()) {
    fail(ExitCode::kMemoryOrDevice,
         "a voxel tree of {} leaves needs {} bytes but {} are allowed on {}: raise "
         "`--max-gpu-memory`, lower the voxel depth, or use `--device none`",
         leaves, need, device.maxBytes(), device.info().name);
  }
  if (need + kWorkBytes > device.maxBytes()) {
    logVerbose("{}: little memory is left for batches of cones ({} of {} bytes taken)",
               device.info().name, need, device.maxBytes());
  }
}

class VulkanTracer final : public GRayTracer {
 public:
  VulkanTracer(const asvo::Tree& tree, std::span<const shaderio::PhotonMaterial> materials,
               const vulkan::DeviceOptions& options, bool storageBuffers)
      : tree_(tree),
        materials_(materials.begin(), materials.end()),
        light_(tree.nodes.size()),
        coneTable_(tree),
        device_(options) {
    requireRoom(device_, tree);
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

  void resetFlux() override {
    light_.restart();
    if (photons_) photons_->reset();
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

  GRayStatistics statistics() const override {
    GRayStatistics s = statistics_;
    s.cones = cones_;
    s.gatherSeconds = gather_ ? gather_->seconds() : 0.0;
    s.deviceBytes = device_.allocatedBytes();
    return s;
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
  vulkan::Device device_;
  std::optional<TreeBuffers> buffers_;  // none for an empty tree: every cone is clear
  std::optional<GatherPass> gather_;
  std::optional<PhotonPass> photons_;
  std::array<std::vector<shaderio::GatherResult>, 2> clear_;
  unsigned nextClear_ = 0;
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
  return std::make_unique<VulkanTracer>(tree, materials, options, limits.storageBuffers);
}

}  // namespace trex
