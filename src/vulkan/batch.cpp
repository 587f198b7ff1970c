#include <algorithm>
#include <cassert>
#include <vector>

#include "src/core/error.h"
#include "src/vulkan/one_shot.h"

namespace trex::vulkan {

void fullBarrier(const DeviceFunctions& f, VkCommandBuffer commands) {
  VkMemoryBarrier barrier{};
  barrier.sType = VK_STRUCTURE_TYPE_MEMORY_BARRIER;
  barrier.srcAccessMask = VK_ACCESS_MEMORY_WRITE_BIT;
  barrier.dstAccessMask = VK_ACCESS_MEMORY_READ_BIT | VK_ACCESS_MEMORY_WRITE_BIT;
  constexpr VkPipelineStageFlags kWork =
      VK_PIPELINE_STAGE_COMPUTE_SHADER_BIT | VK_PIPELINE_STAGE_TRANSFER_BIT;
  f.vkCmdPipelineBarrier(commands, kWork, kWork | VK_PIPELINE_STAGE_HOST_BIT, 0, 1, &barrier, 0,
                         nullptr, 0, nullptr);
}

VkCommandPool makeCommandPool(Device::Impl& d) {
  VkCommandPoolCreateInfo info{};
  info.sType = VK_STRUCTURE_TYPE_COMMAND_POOL_CREATE_INFO;
  info.queueFamilyIndex = d.family;
  VkCommandPool pool = VK_NULL_HANDLE;
  d.check(d.f.vkCreateCommandPool(d.device, &info, nullptr, &pool), "making a command pool");
  return pool;
}

VkCommandBuffer makeCommandBuffer(Device::Impl& d, VkCommandPool pool) {
  VkCommandBufferAllocateInfo info{};
  info.sType = VK_STRUCTURE_TYPE_COMMAND_BUFFER_ALLOCATE_INFO;
  info.commandPool = pool;
  info.level = VK_COMMAND_BUFFER_LEVEL_PRIMARY;
  info.commandBufferCount = 1;
  VkCommandBuffer commands = VK_NULL_HANDLE;
  d.check(d.f.vkAllocateCommandBuffers(d.device, &info, &commands), "making a command buffer");
  return commands;
}

VkFence makeFence(Device::Impl& d) {
  VkFenceCreateInfo info{};
  info.sType = VK_STRUCTURE_TYPE_FENCE_CREATE_INFO;
  VkFence fence = VK_NULL_HANDLE;
  d.check(d.f.vkCreateFence(d.device, &info, nullptr, &fence), "making a fence");
  return fence;
}

namespace {

void beginCommands(Device::Impl& d, VkCommandBuffer commands) {
  VkCommandBufferBeginInfo info{};
  info.sType = VK_STRUCTURE_TYPE_COMMAND_BUFFER_BEGIN_INFO;
  info.flags = VK_COMMAND_BUFFER_USAGE_ONE_TIME_SUBMIT_BIT;
  d.check(d.f.vkBeginCommandBuffer(commands, &info), "recording commands");
}

void submitCommands(Device::Impl& d, VkCommandBuffer commands, VkFence fence) {
  VkSubmitInfo info{};
  info.sType = VK_STRUCTURE_TYPE_SUBMIT_INFO;
  info.commandBufferCount = 1;
  info.pCommandBuffers = &commands;
  const bool fails = Device::Impl::failsNow(d.submits, d.options.failSubmit);
  d.check(fails ? VK_ERROR_DEVICE_LOST : d.f.vkQueueSubmit(d.queue, 1, &info, fence),
          "submitting work");
}

void waitForFence(Device::Impl& d, VkFence fence, const char* what) {
  const VkResult result = d.f.vkWaitForFences(d.device, 1, &fence, VK_TRUE, UINT64_MAX);
  const bool fails = Device::Impl::failsNow(d.waits, d.options.failWait);
  d.check(fails ? VK_ERROR_DEVICE_LOST : result, what);
}

}  // namespace

OneShot::OneShot(Device& device) : d_(device.impl()) {
  try {
    pool_ = makeCommandPool(d_);
    commands_ = makeCommandBuffer(d_, pool_);
    fence_ = makeFence(d_);
  } catch (...) {
    release();
    throw;
  }
}

OneShot::~OneShot() { release(); }

void OneShot::release() {
  d_.f.vkDestroyFence(d_.device, fence_, nullptr);
  d_.f.vkDestroyCommandPool(d_.device, pool_, nullptr);
}

void OneShot::begin() {
  d_.requireAlive("recording a copy");
  d_.check(d_.f.vkResetCommandPool(d_.device, pool_, 0), "resetting commands");
  beginCommands(d_, commands_);
}

void OneShot::run() {
  fullBarrier(d_.f, commands_);
  d_.check(d_.f.vkEndCommandBuffer(commands_), "recording a copy");
  submitCommands(d_, commands_, fence_);
  waitForFence(d_, fence_, "waiting for a copy");
  d_.check(d_.f.vkResetFences(d_.device, 1, &fence_), "resetting a fence");
}

void OneShot::copy(VkBuffer from, std::uint64_t fromOffset, VkBuffer to, std::uint64_t toOffset,
                   std::uint64_t bytes) {
  begin();
  const VkBufferCopy region{fromOffset, toOffset, bytes};
  d_.f.vkCmdCopyBuffer(commands_, from, to, 1, &region);
  run();
}

void OneShot::fillZero(VkBuffer buffer) {
  begin();
  d_.f.vkCmdFillBuffer(commands_, buffer, 0, VK_WHOLE_SIZE, 0);
  run();
}

struct Batch::Impl {
  Device::Impl* d = nullptr;
  VkCommandPool pool = VK_NULL_HANDLE;
  VkFence fence = VK_NULL_HANDLE;
  std::vector<VkCommandBuffer> slices;  // kept for reuse
  std::size_t recorded = 0;
  bool submitted = false;

  void release() {
    d->f.vkDestroyFence(d->device, fence, nullptr);
    d->f.vkDestroyCommandPool(d->device, pool, nullptr);
  }
};

Batch::Batch(Device& device) : impl_(std::make_unique<Impl>()) {
  impl_->d = &device.impl();
  try {
    impl_->pool = makeCommandPool(*impl_->d);
    impl_->fence = makeFence(*impl_->d);
  } catch (...) {
    impl_->release();
    throw;
  }
}

Batch::~Batch() {
  if (impl_->submitted) {
    impl_->d->f.vkWaitForFences(impl_->d->device, 1, &impl_->fence, VK_TRUE, UINT64_MAX);
  }
  impl_->release();
}

/// Records what `function` does into a command buffer of its own, with a barrier behind it.
template <typename Function>
void Batch::record(const std::string& what, const Function& function) {
  Device::Impl& d = *impl_->d;
  d.requireAlive("recording " + what);
  assert(!impl_->submitted);
  if (impl_->recorded == impl_->slices.size()) {
    impl_->slices.push_back(makeCommandBuffer(d, impl_->pool));
  }
  const VkCommandBuffer commands = impl_->slices[impl_->recorded];
  beginCommands(d, commands);
  function(commands);
  fullBarrier(d.f, commands);
  d.check(d.f.vkEndCommandBuffer(commands), "recording " + what);
  ++impl_->recorded;
}

void Batch::dispatch(const Kernel& kernel, const Bindings& bindings,
                     std::span<const std::byte> pushConstants, std::uint32_t groups) {
  const Device::Impl& d = *impl_->d;
  const Kernel::Impl& k = kernel.impl();
  assert(pushConstants.size() == k.pushBytes && groups <= d.info.maxWorkgroupCount);
  record(k.name, [&](VkCommandBuffer commands) {
    d.f.vkCmdBindPipeline(commands, VK_PIPELINE_BIND_POINT_COMPUTE, k.pipeline);
    const VkDescriptorSet set = bindings.impl().set;
    d.f.vkCmdBindDescriptorSets(commands, VK_PIPELINE_BIND_POINT_COMPUTE, k.layout, 0, 1, &set, 0,
                                nullptr);
    if (k.pushBytes > 0) {
      d.f.vkCmdPushConstants(commands, k.layout, VK_SHADER_STAGE_COMPUTE_BIT, 0, k.pushBytes,
                             pushConstants.data());
    }
    d.f.vkCmdDispatch(commands, groups, 1, 1);
  });
}

void Batch::copy(const Buffer& from, std::uint64_t fromOffset, const Buffer& to,
                 std::uint64_t toOffset, std::uint64_t bytes) {
  assert(fromOffset + bytes <= from.size() && toOffset + bytes <= to.size());
  record("a copy to " + to.impl().name, [&](VkCommandBuffer commands) {
    const VkBufferCopy region{fromOffset, toOffset, bytes};
    impl_->d->f.vkCmdCopyBuffer(commands, from.impl().buffer, to.impl().buffer, 1, &region);
  });
}

void Batch::submit() {
  impl_->d->requireAlive("submitting work");
  assert(!impl_->submitted);
  if (impl_->recorded == 0) return;
  try {
    for (std::size_t i = 0; i < impl_->recorded; ++i) {
      const bool last = i + 1 == impl_->recorded;
      submitCommands(*impl_->d, impl_->slices[i], last ? impl_->fence : VK_NULL_HANDLE);
    }
  } catch (...) {
    // Slices before the one that failed may still run, and no fence tells of their end.
    impl_->d->f.vkDeviceWaitIdle(impl_->d->device);
    impl_->d->f.vkResetCommandPool(impl_->d->device, impl_->pool, 0);
    impl_->recorded = 0;
    throw;
  }
  impl_->submitted = true;
}

void Batch::wait() {
  Device::Impl& d = *impl_->d;
  if (!impl_->submitted) return;
  d.requireAlive("waiting for the work submitted");
  waitForFence(d, impl_->fence, "waiting for the work submitted");
  impl_->submitted = false;
  impl_->recorded = 0;
  d.check(d.f.vkResetFences(d.device, 1, &impl_->fence), "resetting a fence");
  d.check(d.f.vkResetCommandPool(d.device, impl_->pool, 0), "resetting commands");
}

bool Batch::busy() const {
  return impl_->submitted &&
         impl_->d->f.vkGetFenceStatus(impl_->d->device, impl_->fence) == VK_NOT_READY;
}

void Slicer::measured(std::uint64_t items, double seconds) {
  // Short runs measure the overhead, not the rate.
  if (seconds < 1e-4 || items == 0) return;
  const double wanted = static_cast<double>(items) / seconds * kTargetSeconds;
  const double most = static_cast<double>(items_) * 4.0;
  items_ = static_cast<std::uint64_t>(std::clamp(wanted, 64.0, std::max(64.0, most)));
}

}  // namespace trex::vulkan
