#include <cassert>
#include <chrono>
#include <vector>

#include "src/core/error.h"
#include "src/vulkan/device.h"

namespace trex::vulkan {

namespace {

VkDescriptorType bindingType(const Kernel::Impl& k, std::uint32_t binding) {
  return binding < k.texelWords.size() ? VK_DESCRIPTOR_TYPE_UNIFORM_TEXEL_BUFFER
                                       : VK_DESCRIPTOR_TYPE_STORAGE_BUFFER;
}

VkBufferView makeView(Device::Impl& d, VkBuffer buffer, std::uint32_t words) {
  VkBufferViewCreateInfo info{};
  info.sType = VK_STRUCTURE_TYPE_BUFFER_VIEW_CREATE_INFO;
  info.buffer = buffer;
  info.format = words == 1   ? VK_FORMAT_R32_UINT
                : words == 2 ? VK_FORMAT_R32G32_UINT
                             : VK_FORMAT_R32G32B32A32_UINT;
  info.range = VK_WHOLE_SIZE;
  VkBufferView view = VK_NULL_HANDLE;
  d.check(d.f.vkCreateBufferView(d.device, &info, nullptr, &view), "making a view of a buffer");
  return view;
}

void makeLayouts(Device::Impl& d, Kernel::Impl& k) {
  std::vector<VkDescriptorSetLayoutBinding> slots(k.bindings);
  for (std::uint32_t i = 0; i < k.bindings; ++i) {
    slots[i].binding = i;
    slots[i].descriptorType = bindingType(k, i);
    slots[i].descriptorCount = 1;
    slots[i].stageFlags = VK_SHADER_STAGE_COMPUTE_BIT;
  }
  VkDescriptorSetLayoutCreateInfo set{};
  set.sType = VK_STRUCTURE_TYPE_DESCRIPTOR_SET_LAYOUT_CREATE_INFO;
  set.bindingCount = k.bindings;
  set.pBindings = slots.data();
  d.check(d.f.vkCreateDescriptorSetLayout(d.device, &set, nullptr, &k.setLayout),
          "making the bindings of " + k.name);

  const VkPushConstantRange push{VK_SHADER_STAGE_COMPUTE_BIT, 0, k.pushBytes};
  VkPipelineLayoutCreateInfo layout{};
  layout.sType = VK_STRUCTURE_TYPE_PIPELINE_LAYOUT_CREATE_INFO;
  layout.setLayoutCount = 1;
  layout.pSetLayouts = &k.setLayout;
  layout.pushConstantRangeCount = k.pushBytes > 0 ? 1 : 0;
  layout.pPushConstantRanges = &push;
  d.check(d.f.vkCreatePipelineLayout(d.device, &layout, nullptr, &k.layout),
          "making the layout of " + k.name);
}

void makePipeline(Device::Impl& d, Kernel::Impl& k, const KernelOptions& options) {
  VkShaderModuleCreateInfo code{};
  code.sType = VK_STRUCTURE_TYPE_SHADER_MODULE_CREATE_INFO;
  code.codeSize = options.spirv.size_bytes();
  code.pCode = options.spirv.data();
  VkShaderModule module = VK_NULL_HANDLE;
  d.check(d.f.vkCreateShaderModule(d.device, &code, nullptr, &module),
          "loading the shader " + k.name);

  std::vector<VkSpecializationMapEntry> entries;
  for (std::uint32_t i = 0; i < options.constants.size(); ++i) {
    entries.push_back({i, i * 4u, 4u});
  }
  VkSpecializationInfo constants{};
  constants.mapEntryCount = static_cast<std::uint32_t>(entries.size());
  constants.pMapEntries = entries.data();
  constants.dataSize = options.constants.size() * 4;
  constants.pData = options.constants.data();

  VkComputePipelineCreateInfo info{};
  info.sType = VK_STRUCTURE_TYPE_COMPUTE_PIPELINE_CREATE_INFO;
  info.layout = k.layout;
  info.stage.sType = VK_STRUCTURE_TYPE_PIPELINE_SHADER_STAGE_CREATE_INFO;
  info.stage.stage = VK_SHADER_STAGE_COMPUTE_BIT;
  info.stage.module = module;
  info.stage.pName = "main";
  info.stage.pSpecializationInfo = &constants;
  const VkResult result =
      d.f.vkCreateComputePipelines(d.device, VK_NULL_HANDLE, 1, &info, nullptr, &k.pipeline);
  d.f.vkDestroyShaderModule(d.device, module, nullptr);
  d.check(result, "compiling the shader " + k.name);
}

void release(Kernel::Impl& k) {
  Device::Impl& d = k.owner->impl();
  d.f.vkDestroyPipeline(d.device, k.pipeline, nullptr);
  d.f.vkDestroyPipelineLayout(d.device, k.layout, nullptr);
  d.f.vkDestroyDescriptorSetLayout(d.device, k.setLayout, nullptr);
}

}  // namespace

Kernel::Kernel(Device& device, const KernelOptions& options) : impl_(std::make_unique<Impl>()) {
  assert(options.pushBytes <= 128);
  const auto start = std::chrono::steady_clock::now();
  impl_->owner = &device;
  impl_->name = options.name;
  impl_->bindings = options.bindings;
  impl_->pushBytes = options.pushBytes;
  impl_->texelWords = options.texelWords;
  try {
    makeLayouts(device.impl(), *impl_);
    makePipeline(device.impl(), *impl_, options);
  } catch (...) {
    release(*impl_);
    throw;
  }
  device.impl().times.kernels +=
      std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

Kernel::~Kernel() { release(*impl_); }

Bindings::Bindings(Device& device, const Kernel& kernel, std::span<const Buffer* const> buffers)
    : impl_(std::make_unique<Impl>()) {
  Device::Impl& d = device.impl();
  impl_->owner = &device;
  assert(buffers.size() == kernel.impl().bindings);
  const auto count = static_cast<std::uint32_t>(buffers.size());

  const auto texels = static_cast<std::uint32_t>(kernel.impl().texelWords.size());
  std::vector<VkDescriptorPoolSize> sizes;
  if (texels > 0) sizes.push_back({VK_DESCRIPTOR_TYPE_UNIFORM_TEXEL_BUFFER, texels});
  if (texels < count) sizes.push_back({VK_DESCRIPTOR_TYPE_STORAGE_BUFFER, count - texels});
  VkDescriptorPoolCreateInfo pool{};
  pool.sType = VK_STRUCTURE_TYPE_DESCRIPTOR_POOL_CREATE_INFO;
  pool.maxSets = 1;
  pool.poolSizeCount = static_cast<std::uint32_t>(sizes.size());
  pool.pPoolSizes = sizes.data();
  d.check(d.f.vkCreateDescriptorPool(d.device, &pool, nullptr, &impl_->pool),
          "making a descriptor pool");
  try {
    write(kernel, buffers);
  } catch (...) {
    release();
    throw;
  }
}

void Bindings::write(const Kernel& kernel, std::span<const Buffer* const> buffers) {
  Device::Impl& d = impl_->owner->impl();
  const auto count = static_cast<std::uint32_t>(buffers.size());
  const std::vector<std::uint32_t>& texelWords = kernel.impl().texelWords;
  VkDescriptorSetAllocateInfo allocate{};
  allocate.sType = VK_STRUCTURE_TYPE_DESCRIPTOR_SET_ALLOCATE_INFO;
  allocate.descriptorPool = impl_->pool;
  allocate.descriptorSetCount = 1;
  allocate.pSetLayouts = &kernel.impl().setLayout;
  d.check(d.f.vkAllocateDescriptorSets(d.device, &allocate, &impl_->set),
          "making a descriptor set");
  for (std::uint32_t i = 0; i < texelWords.size(); ++i) {
    impl_->views.push_back(makeView(d, buffers[i]->impl().buffer, texelWords[i]));
  }

  std::vector<VkDescriptorBufferInfo> infos(count);
  std::vector<VkWriteDescriptorSet> writes(count);
  for (std::uint32_t i = 0; i < count; ++i) {
    infos[i] = {buffers[i]->impl().buffer, 0, VK_WHOLE_SIZE};
    writes[i].sType = VK_STRUCTURE_TYPE_WRITE_DESCRIPTOR_SET;
    writes[i].dstSet = impl_->set;
    writes[i].dstBinding = i;
    writes[i].descriptorCount = 1;
    writes[i].descriptorType = bindingType(kernel.impl(), i);
    writes[i].pBufferInfo = &infos[i];
    if (i < impl_->views.size()) writes[i].pTexelBufferView = &impl_->views[i];
  }
  d.f.vkUpdateDescriptorSets(d.device, count, writes.data(), 0, nullptr);
}

Bindings::~Bindings() { release(); }

void Bindings::release() {
  Device::Impl& d = impl_->owner->impl();
  for (const VkBufferView view : impl_->views) d.f.vkDestroyBufferView(d.device, view, nullptr);
  d.f.vkDestroyDescriptorPool(d.device, impl_->pool, nullptr);
}

}  // namespace trex::vulkan
