#include <algorithm>
#include <cassert>

#include "src/grays/shaders.h"
#include "src/grays/tables.h"
#include "src/grays/vulkan_passes.h"

namespace trex {

namespace {

/// Queries that one batch may have where they are read as texels, three each.
constexpr std::uint64_t kMostQueries = 1u << 22;

// A software device gathers texels with vector instructions but fetches from storage buffers lane
// by lane. GPUs read both alike and keep the format the tree is stored in.
bool useTexels(const vulkan::Device& device, const asvo::Tree& tree) {
  return device.info().sharesHostCores &&
         3 * kMostQueries <= device.info().maxTexelBufferElements &&
         tree.voxels.size() <= device.info().maxTexelBufferElements &&
         std::uint64_t{2} << (3 * coneGridLevel(tree.info)) <= device.info().maxTexelBufferElements;
}

}  // namespace

TreeBuffers::TreeBuffers(vulkan::Device& device, const asvo::Tree& tree, bool storageBuffers)
    : info(tree.info),
      gridLevel(photonGridLevel(tree.info)),
      firstBrick(trex::firstBrick(tree)),
      texels(!storageBuffers && useTexels(device, tree)),
      bricks(device, "the bricks of the voxel tree",
             std::max(1u, brickCount(tree)) * sizeof(asvo::uvec4), vulkan::Place::kDevice),
      voxels(device, "the voxels", std::as_bytes(std::span(tree.voxels)).size(),
             vulkan::Place::kDevice),
      leaves(device, "the leaves of the voxel tree", std::as_bytes(std::span(tree.leaves)).size(),
             vulkan::Place::kDevice),
      cones(device, "what cones read of the voxels", tree.nodes.size() * sizeof(asvo::uvec4),
            vulkan::Place::kDevice),
      grid(device, "the grid of the voxel tree", std::uint64_t{8} << (3 * gridLevel),
           vulkan::Place::kDevice) {
  const std::vector<asvo::uvec4> entriesOfBricks = makeBricks(tree);
  bricks.upload(std::as_bytes(std::span(entriesOfBricks)));
  voxels.upload(std::as_bytes(std::span(tree.voxels)));
  leaves.upload(std::as_bytes(std::span(tree.leaves)));
  const std::vector<std::uint32_t> entries = makeGrid(tree, gridLevel);
  grid.upload(std::as_bytes(std::span(entries)));
  cones.clear();
}

std::vector<std::uint32_t> TreeBuffers::texelWords() const {
  if (!texels) return {};
  return {4, 4, 2, 4, 1};
}

std::uint32_t workgroupSize(const vulkan::Device& device) {
  return std::min(shaderio::kWorkgroupSize, device.info().maxWorkgroupInvocations);
}

/// The tree's, and four for the queries (three texels each).
std::vector<std::uint32_t> GatherPass::texelWords() const {
  std::vector<std::uint32_t> words = tree_.texelWords();
  if (!words.empty()) words.push_back(4);
  return words;
}

std::uint32_t gatherGroupSize(const vulkan::Device& device) {
  return std::min(shaderio::kGatherGroupSize, device.info().maxWorkgroupInvocations);
}

void dispatchCones(const vulkan::Device& device, vulkan::Batch& batch, const vulkan::Kernel& kernel,
                   const vulkan::Bindings& bindings, GatherPush push,
                   const vulkan::Slicer& slicer) {
  const std::uint32_t size = gatherGroupSize(device), end = push.end;
  const std::uint64_t slice = std::clamp<std::uint64_t>(
      slicer.items(), size, std::uint64_t{device.info().maxWorkgroupCount} * size);
  for (std::uint64_t first = push.first; first < end; first += slice) {
    push.first = static_cast<std::uint32_t>(first);
    push.end = static_cast<std::uint32_t>(std::min<std::uint64_t>(end, first + slice));
    batch.dispatch(kernel, bindings, std::as_bytes(std::span(&push, 1)),
                   (push.end - push.first + size - 1) / size);
  }
}

void GatherPass::makeKernels() {
  const std::vector<std::uint32_t> entries = makeGrid(source_, coneGridLevel(tree_.info));
  const auto bytes = std::as_bytes(std::span(entries));
  grid_.emplace(device_, "the grid of cones", bytes.size(), vulkan::Place::kDevice);
  grid_->upload(bytes);
  for (std::uint32_t fine = 0; fine < 2; ++fine) {
    kernels_[fine].emplace(device_,
                           vulkan::KernelOptions{.name = "gather",
                                                 .spirv = gatherShader(tree_.texels),
                                                 .bindings = 7,
                                                 .texelWords = texelWords(),
                                                 .pushBytes = sizeof(GatherPush),
                                                 .constants = {gatherGroupSize(device_), fine}});
  }
}

void GatherPass::grow(Slot& slot, std::size_t count) {
  if (!kernels_[0]) makeKernels();
  if (count <= slot.capacity) return;
  slot.bindings.reset();
  slot.queries.reset();
  slot.results.reset();
  slot.capacity = 0;
  slot.queries.emplace(device_, "queries of gathering", count * sizeof(shaderio::GatherQuery),
                       vulkan::Place::kHost);
  slot.results.emplace(device_, "results of gathering", count * sizeof(shaderio::GatherResult),
                       vulkan::Place::kHost);
  const std::array<const vulkan::Buffer*, 7> buffers = {
      &tree_.bricks, &tree_.voxels,  &tree_.leaves, &tree_.cones,
      &*grid_,       &*slot.queries, &*slot.results};
  slot.bindings.emplace(device_, *kernels_[0], buffers);
  slot.capacity = count;
}

int GatherPass::submit(std::span<const shaderio::GatherQuery> queries) {
  Slot& slot = slots_[next_ & 1u];
  assert(!slot.open && "at most two batches may be under way");
  assert(!tree_.texels || queries.size() <= kMostQueries);
  grow(slot, std::max<std::size_t>(queries.size(), 1));
  if (!slot.batch) slot.batch.emplace(device_);
  const auto count = static_cast<std::uint32_t>(queries.size());
  auto* out = reinterpret_cast<shaderio::GatherQuery*>(slot.queries->mapped());
  const std::uint32_t wide = order_.write(queries, out);
  const GatherPush push{tree_.info, coneGridLevel(tree_.info), tree_.firstBrick, 0, wide};
  dispatchCones(device_, *slot.batch, *kernels_[0], *slot.bindings, push, slicer_);
  const GatherPush fine{push.info, push.gridLevel, push.firstBrick, wide, count};
  dispatchCones(device_, *slot.batch, *kernels_[1], *slot.bindings, fine, slicer_);
  slot.start = Clock::now();
  slot.batch->submit();
  slot.count = queries.size();
  slot.open = true;
  slot.running = true;
  return static_cast<int>(next_++);
}

void GatherPass::wait(Slot& slot) {
  if (!slot.running) return;
  const bool late = !slot.batch->busy();  // it ended some time ago: its time is not known
  slot.batch->wait();
  slot.running = false;
  const auto end = Clock::now();
  // A batch starts when it is submitted or when the one before it ends.
  const double seconds =
      std::chrono::duration<double>(end - std::max(slot.start, lastEnd_)).count();
  lastEnd_ = end;
  seconds_ += seconds;
  if (!late) slicer_.measured(slot.count, seconds);
}

std::span<const shaderio::GatherResult> GatherPass::finish(int ticket) {
  Slot& slot = slots_[static_cast<unsigned>(ticket) & 1u];
  assert(slot.open && "a ticket is finished once");
  wait(slot);
  slot.open = false;
  const auto* results = reinterpret_cast<const shaderio::GatherResult*>(slot.results->mapped());
  return {results, slot.count};
}

void GatherPass::waitAll() {
  for (unsigned i = 0; i < 2; ++i) wait(slots_[(next_ + i) & 1u]);
}

}  // namespace trex
