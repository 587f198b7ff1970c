#include <algorithm>
#include <cassert>
#include <chrono>
#include <cstring>

#include "src/grays/resolve.h"
#include "src/grays/shaders.h"
#include "src/grays/vulkan_passes.h"

namespace trex {

namespace {

/// Push constants of photons.comp.
struct PhotonPush {
  asvo::AsvoInfo info;
  std::uint32_t gridLevel, firstBrick, first, end, stride, materialCount;
  float countsPerWatt;
};
static_assert(sizeof(PhotonPush) == 60);

/// Photons that share an invocation: enough to even out the lengths of their paths, but not so many
/// that a wide device is left without work.
constexpr std::uint32_t kPhotonsPerInvocation = 8;
constexpr std::uint32_t kLeastInvocations = 2048;

constexpr shaderio::PhotonMaterial kNoMaterial{};

}  // namespace

PhotonPass::PhotonPass(vulkan::Device& device, const TreeBuffers& tree,
                       std::span<const shaderio::PhotonMaterial> materials)
    : device_(device),
      tree_(tree),
      materialCount_(std::max(1u, static_cast<std::uint32_t>(materials.size()))),
      materials_(device, "materials of photons", materialCount_ * sizeof(shaderio::PhotonMaterial),
                 vulkan::Place::kDevice),
      records_(device, "records of photons", kMaxRecords * sizeof(shaderio::PhotonRecord),
               vulkan::Place::kHost),
      direct_(device, "sums of direct flux", tree.info.leafCount * kWordsPerLeaf * 4,
              vulkan::Place::kDevice),
      indirect_(device, "sums of indirect flux", tree.info.leafCount * kWordsPerLeaf * 4,
                vulkan::Place::kDevice),
      counters_(device, "counters of photons", 2 * sizeof(std::uint32_t), vulkan::Place::kHost),
      batch_(device) {
  materials_.upload(std::as_bytes(materials.empty() ? std::span(&kNoMaterial, 1) : materials));
  reset();
}

void PhotonPass::reset() {
  direct_.clear();
  indirect_.clear();
}

void PhotonPass::prepare() {
  if (kernel_) return;
  makeKernel();
  dispatch(0, 1, 1.0f);
}

void PhotonPass::setMaterials(std::span<const shaderio::PhotonMaterial> materials) {
  if (!materials.empty()) materials_.upload(std::as_bytes(materials));
}

void PhotonPass::makeKernel() {
  kernel_.emplace(device_, vulkan::KernelOptions{.name = "photons",
                                                 .spirv = photonShader(tree_.texels),
                                                 .bindings = 10,
                                                 .texelWords = tree_.texelWords(),
                                                 .pushBytes = sizeof(PhotonPush),
                                                 .constants = {workgroupSize(device_)}});
  const std::array<const vulkan::Buffer*, 10> buffers = {
      &tree_.bricks, &tree_.voxels, &tree_.leaves, &tree_.cones, &tree_.grid,
      &records_,     &materials_,   &direct_,      &indirect_,   &counters_};
  bindings_.emplace(device_, *kernel_, buffers);
}

PhotonPass::Counts PhotonPass::trace(std::span<const shaderio::PhotonRecord> records,
                                     float countsPerWatt) {
  if (!kernel_) makeKernel();
  Counts counts;
  while (!records.empty()) {
    const std::size_t slice = std::min<std::uint64_t>(
        {records.size(), kMaxRecords, std::max<std::uint64_t>(slicer_.items(), 256)});
    const auto start = std::chrono::steady_clock::now();
    traceSlice(records.first(slice), countsPerWatt, counts);
    const std::chrono::duration<double> seconds = std::chrono::steady_clock::now() - start;
    slicer_.measured(slice, seconds.count());
    records = records.subspan(slice);
  }
  return counts;
}

void PhotonPass::traceSlice(std::span<const shaderio::PhotonRecord> records, float countsPerWatt,
                            Counts& counts) {
  const auto count = static_cast<std::uint32_t>(records.size());
  std::memcpy(records_.mapped(), records.data(), records.size_bytes());
  counters_.clear();
  const std::uint32_t size = workgroupSize(device_);
  const std::uint32_t wanted =
      std::min(count, std::max(kLeastInvocations, count / kPhotonsPerInvocation));
  const std::uint32_t groups =
      std::min((wanted + size - 1) / size, device_.info().maxWorkgroupCount);
  dispatch(count, groups, countsPerWatt);
  std::array<std::uint32_t, 2> words;
  std::memcpy(words.data(), counters_.mapped(), sizeof(words));
  counts.deposits += words[0];
  counts.lost += words[1];
}

void PhotonPass::dispatch(std::uint32_t count, std::uint32_t groups, float countsPerWatt) {
  const std::uint32_t stride = groups * workgroupSize(device_);
  const PhotonPush push{tree_.info, tree_.gridLevel, tree_.firstBrick, 0,
                        count,      stride,          materialCount_,   countsPerWatt};
  batch_.dispatch(*kernel_, *bindings_, std::as_bytes(std::span(&push, 1)), groups);
  batch_.submit();
  batch_.wait();
}

std::span<const std::uint32_t> PhotonPass::words(const vulkan::Buffer& buffer,
                                                 std::vector<std::uint32_t>& copy) const {
  const std::size_t count = tree_.info.leafCount * kWordsPerLeaf;
  if (buffer.mapped() != nullptr) {
    return {reinterpret_cast<const std::uint32_t*>(buffer.mapped()), count};
  }
  copy.resize(count);
  buffer.download(std::as_writable_bytes(std::span(copy)));
  return copy;
}

std::span<const std::uint32_t> PhotonPass::directWords() { return words(direct_, directCopy_); }
std::span<const std::uint32_t> PhotonPass::indirectWords() {
  return words(indirect_, indirectCopy_);
}

}  // namespace trex
