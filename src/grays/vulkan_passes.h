// The two passes of the Vulkan tracer. Private to src/grays. Each makes its pipeline and buffers
// when first used: starting stays quick, and what a frame does not need is never made.
#pragma once

#include <array>
#include <chrono>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "asvo/asvo.h"
#include "src/grays/query_order.h"
#include "src/grays/shaderio.h"
#include "src/vulkan/vulkan.h"

namespace trex {

/// The tree in device memory, set 0 bindings 0 to 4 of every shader.
struct TreeBuffers {
  TreeBuffers(vulkan::Device& device, const asvo::Tree& tree, bool storageBuffers);
  asvo::AsvoInfo info;
  std::uint32_t gridLevel, firstBrick;
  bool texels;  ///< read through texel buffers (shaders/tree.h)
  vulkan::Buffer bricks, voxels, leaves, cones, grid;
  /// KernelOptions::texelWords of the kernels that read this tree.
  std::vector<std::uint32_t> texelWords() const;
};

/// Invocations in a workgroup on this device: kWorkgroupSize or what it allows.
std::uint32_t workgroupSize(const vulkan::Device& device);
/// The same for cones, of kGatherGroupSize.
std::uint32_t gatherGroupSize(const vulkan::Device& device);

/// Push constants of gather.comp.
struct GatherPush {
  asvo::AsvoInfo info;
  std::uint32_t gridLevel, firstBrick, first, end;
};
static_assert(sizeof(GatherPush) == 48);

/// Records the cones from push.first to push.end, in slices.
void dispatchCones(const vulkan::Device& device, vulkan::Batch& batch, const vulkan::Kernel& kernel,
                   const vulkan::Bindings& bindings, GatherPush push, const vulkan::Slicer& slicer);

class GatherPass {
 public:
  GatherPass(vulkan::Device& device, const TreeBuffers& buffers, const asvo::Tree& tree)
      : device_(device),
        tree_(buffers),
        source_(tree),
        tracer_(tree, coneGridLevel(tree.info), {}, {}, {}, {}) {}

  int submit(std::span<const shaderio::GatherQuery> queries);
  std::span<const shaderio::GatherResult> finish(int ticket);
  /// Waits for all that is under way; tickets stay valid.
  void waitAll();
  double seconds() const { return seconds_; }

 private:
  using Clock = std::chrono::steady_clock;
  struct Slot {
    std::size_t capacity = 0, count = 0;
    std::optional<vulkan::Buffer> queries, results;
    std::optional<vulkan::Bindings> bindings;
    std::optional<vulkan::Batch> batch;
    Clock::time_point start;
    bool open = false, running = false;
  };
  std::vector<std::uint32_t> texelWords() const;
  void makeKernels();
  void grow(Slot& slot, std::size_t count);
  void wait(Slot& slot);

  vulkan::Device& device_;
  const TreeBuffers& tree_;
  const asvo::Tree& source_;
  std::optional<vulkan::Buffer> grid_;  ///< finer than the photons'; made with the kernels
  GridTracer tracer_;                   ///< for what it says of a cone's start; without arrays
  QueryOrder order_{tracer_};
  std::array<std::optional<vulkan::Kernel>, 2> kernels_;  ///< for cones that start wide; for all
  std::array<Slot, 2> slots_;
  vulkan::Slicer slicer_{1u << 14};
  Clock::time_point lastEnd_{};
  unsigned next_ = 0;
  double seconds_ = 0.0;
};

class PhotonPass {
 public:
  struct Counts {
    std::uint64_t deposits = 0, lost = 0;
  };

  PhotonPass(vulkan::Device& device, const TreeBuffers& tree,
             std::span<const shaderio::PhotonMaterial> materials);

  void reset();
  /// Makes the kernel: drivers compile it when it first runs.
  void prepare();
  /// As many as before.
  void setMaterials(std::span<const shaderio::PhotonMaterial> materials);
  Counts trace(std::span<const shaderio::PhotonRecord> records, float countsPerWatt);
  /// The sums as 32-bit words; downloaded first where memory is not mapped. Valid until the next
  /// call.
  std::span<const std::uint32_t> directWords();
  std::span<const std::uint32_t> indirectWords();

 private:
  static constexpr std::uint64_t kMaxRecords = 1u << 18;  ///< a dispatch: 8 MiB
  void makeKernel();
  void traceSlice(std::span<const shaderio::PhotonRecord> records, float countsPerWatt,
                  Counts& counts);
  void dispatch(std::uint32_t count, std::uint32_t groups, float countsPerWatt);
  std::span<const std::uint32_t> words(const vulkan::Buffer& buffer,
                                       std::vector<std::uint32_t>& copy) const;

  vulkan::Device& device_;
  const TreeBuffers& tree_;
  std::uint32_t materialCount_;
  vulkan::Buffer materials_, records_, direct_, indirect_, counters_;
  std::optional<vulkan::Kernel> kernel_;
  std::optional<vulkan::Bindings> bindings_;
  vulkan::Batch batch_;
  vulkan::Slicer slicer_{1u << 12};
  std::vector<std::uint32_t> directCopy_, indirectCopy_;
};

}  // namespace trex
