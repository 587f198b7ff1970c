#include "src/app/view/window_drawing.h"

#include <backends/imgui_impl_vulkan.h>
#include <imgui.h>

namespace trex {
namespace {

void checkImGui(VkResult result) { checkVulkan(result, "drawing panels"); }

void moveImage(VkCommandBuffer commands, VkImage image, VkImageLayout from, VkAccessFlags written,
               VkPipelineStageFlags before, VkImageLayout to, VkAccessFlags access,
               VkPipelineStageFlags after) {
  VkImageMemoryBarrier barrier{};
  barrier.sType = VK_STRUCTURE_TYPE_IMAGE_MEMORY_BARRIER;
  barrier.srcAccessMask = written;
  barrier.dstAccessMask = access;
  barrier.oldLayout = from;
  barrier.newLayout = to;
  barrier.srcQueueFamilyIndex = VK_QUEUE_FAMILY_IGNORED;
  barrier.dstQueueFamilyIndex = VK_QUEUE_FAMILY_IGNORED;
  barrier.image = image;
  barrier.subresourceRange = {VK_IMAGE_ASPECT_COLOR_BIT, 0, 1, 0, 1};
  vkCmdPipelineBarrier(commands, before, after, 0, 0, nullptr, 0, nullptr, 1, &barrier);
}

}  // namespace

Window::Drawing::Drawing(GLFWwindow* window)
    : device_(window),
      swapchain_(device_),
      picture_(device_),
      readBack_(device_, VK_BUFFER_USAGE_TRANSFER_DST_BIT) {
  VkCommandPoolCreateInfo pool{};
  pool.sType = VK_STRUCTURE_TYPE_COMMAND_POOL_CREATE_INFO;
  pool.queueFamilyIndex = device_.queueFamily();
  checkVulkan(vkCreateCommandPool(device_.device(), &pool, nullptr, &pool_), "vkCreateCommandPool");
  VkCommandBufferAllocateInfo buffer{};
  buffer.sType = VK_STRUCTURE_TYPE_COMMAND_BUFFER_ALLOCATE_INFO;
  buffer.commandPool = pool_;
  buffer.commandBufferCount = 1;
  checkVulkan(vkAllocateCommandBuffers(device_.device(), &buffer, &commands_),
              "vkAllocateCommandBuffers");
  VkFenceCreateInfo fence{};
  fence.sType = VK_STRUCTURE_TYPE_FENCE_CREATE_INFO;
  checkVulkan(vkCreateFence(device_.device(), &fence, nullptr, &fence_), "vkCreateFence");
  VkSemaphoreCreateInfo semaphore{};
  semaphore.sType = VK_STRUCTURE_TYPE_SEMAPHORE_CREATE_INFO;
  checkVulkan(vkCreateSemaphore(device_.device(), &semaphore, nullptr, &available_),
              "vkCreateSemaphore");
  const VkDescriptorPoolSize size{VK_DESCRIPTOR_TYPE_COMBINED_IMAGE_SAMPLER, 8};
  VkDescriptorPoolCreateInfo descriptors{};
  descriptors.sType = VK_STRUCTURE_TYPE_DESCRIPTOR_POOL_CREATE_INFO;
  descriptors.flags = VK_DESCRIPTOR_POOL_CREATE_FREE_DESCRIPTOR_SET_BIT;
  descriptors.maxSets = 8;
  descriptors.poolSizeCount = 1;
  descriptors.pPoolSizes = &size;
  checkVulkan(vkCreateDescriptorPool(device_.device(), &descriptors, nullptr, &descriptors_),
              "vkCreateDescriptorPool");
}

Window::Drawing::~Drawing() {
  waitIdle();
  vkDestroyDescriptorPool(device_.device(), descriptors_, nullptr);
  vkDestroySemaphore(device_.device(), available_, nullptr);
  vkDestroyFence(device_.device(), fence_, nullptr);
  vkDestroyCommandPool(device_.device(), pool_, nullptr);
}

void Window::Drawing::waitIdle() { vkDeviceWaitIdle(device_.device()); }

void Window::Drawing::startPanels() {
  ImGui_ImplVulkan_InitInfo info{};
  info.Instance = device_.instance();
  info.PhysicalDevice = device_.physical();
  info.Device = device_.device();
  info.QueueFamily = device_.queueFamily();
  info.Queue = device_.queue();
  info.DescriptorPool = descriptors_;
  info.MinImageCount = 2;
  info.ImageCount = 2;
  info.MSAASamples = VK_SAMPLE_COUNT_1_BIT;
  info.CheckVkResultFn = checkImGui;
  ImGui_ImplVulkan_Init(&info, swapchain_.pass());
  begin();
  ImGui_ImplVulkan_CreateFontsTexture(commands_);
  submit(VK_NULL_HANDLE, VK_NULL_HANDLE);
  waitForFrame();
  ImGui_ImplVulkan_DestroyFontUploadObjects();
}

void Window::Drawing::begin() {
  waitForFrame();
  checkVulkan(vkResetCommandPool(device_.device(), pool_, 0), "vkResetCommandPool");
  VkCommandBufferBeginInfo info{};
  info.sType = VK_STRUCTURE_TYPE_COMMAND_BUFFER_BEGIN_INFO;
  info.flags = VK_COMMAND_BUFFER_USAGE_ONE_TIME_SUBMIT_BIT;
  checkVulkan(vkBeginCommandBuffer(commands_, &info), "vkBeginCommandBuffer");
}

void Window::Drawing::submit(VkSemaphore wait, VkSemaphore signal) {
  checkVulkan(vkEndCommandBuffer(commands_), "vkEndCommandBuffer");
  const VkPipelineStageFlags stage = VK_PIPELINE_STAGE_TRANSFER_BIT;
  VkSubmitInfo info{};
  info.sType = VK_STRUCTURE_TYPE_SUBMIT_INFO;
  info.waitSemaphoreCount = wait != VK_NULL_HANDLE ? 1 : 0;
  info.pWaitSemaphores = &wait;
  info.pWaitDstStageMask = &stage;
  info.commandBufferCount = 1;
  info.pCommandBuffers = &commands_;
  info.signalSemaphoreCount = signal != VK_NULL_HANDLE ? 1 : 0;
  info.pSignalSemaphores = &signal;
  checkVulkan(vkQueueSubmit(device_.queue(), 1, &info, fence_), "vkQueueSubmit");
  pending_ = true;
}

void Window::Drawing::waitForFrame() {
  if (!pending_) return;
  checkVulkan(vkWaitForFences(device_.device(), 1, &fence_, VK_TRUE, ~std::uint64_t{0}),
              "vkWaitForFences");
  checkVulkan(vkResetFences(device_.device(), 1, &fence_), "vkResetFences");
  pending_ = false;
}

void Window::Drawing::present(const ScreenImage& picture, std::uint32_t width,
                              std::uint32_t height) {
  waitForFrame();
  const VkExtent2D extent = swapchain_.extent();
  if (stale_ || extent.width != width || extent.height != height) {
    waitIdle();
    if (!swapchain_.recreate(width, height)) return;
    stale_ = false;
  }
  const int image = swapchain_.acquire(available_);
  if (image < 0) {
    stale_ = true;
    return;
  }
  const auto index = static_cast<std::uint32_t>(image);
  picture_.update(picture, swapchain_.extent(), swapchain_.blueFirst());
  begin();
  record(index);
  submit(available_, swapchain_.drawn(index));
  stale_ = !swapchain_.present(index);
  // What a software device draws later would only take the cores from the next step.
  if (device_.software() || keep_) waitForFrame();
  if (keep_) takeReadBack();
}

void Window::Drawing::record(std::uint32_t index) {
  const VkImage image = swapchain_.image(index);
  moveImage(commands_, image, VK_IMAGE_LAYOUT_UNDEFINED, 0, VK_PIPELINE_STAGE_TRANSFER_BIT,
            VK_IMAGE_LAYOUT_TRANSFER_DST_OPTIMAL, VK_ACCESS_TRANSFER_WRITE_BIT,
            VK_PIPELINE_STAGE_TRANSFER_BIT);
  picture_.record(commands_, image, swapchain_.extent());
  VkRenderPassBeginInfo pass{};
  pass.sType = VK_STRUCTURE_TYPE_RENDER_PASS_BEGIN_INFO;
  pass.renderPass = swapchain_.pass();
  pass.framebuffer = swapchain_.framebuffer(index);
  pass.renderArea.extent = swapchain_.extent();
  vkCmdBeginRenderPass(commands_, &pass, VK_SUBPASS_CONTENTS_INLINE);
  ImGui_ImplVulkan_RenderDrawData(ImGui::GetDrawData(), commands_);
  vkCmdEndRenderPass(commands_);
  if (keep_) recordReadBack(image);
}

void Window::Drawing::recordReadBack(VkImage image) {
  const VkExtent2D size = swapchain_.extent();
  readBack_.reserve(std::uint64_t{4} * size.width * size.height);
  moveImage(commands_, image, VK_IMAGE_LAYOUT_PRESENT_SRC_KHR, VK_ACCESS_COLOR_ATTACHMENT_WRITE_BIT,
            VK_PIPELINE_STAGE_COLOR_ATTACHMENT_OUTPUT_BIT | VK_PIPELINE_STAGE_TRANSFER_BIT,
            VK_IMAGE_LAYOUT_TRANSFER_SRC_OPTIMAL, VK_ACCESS_TRANSFER_READ_BIT,
            VK_PIPELINE_STAGE_TRANSFER_BIT);
  VkBufferImageCopy region{};
  region.imageSubresource = {VK_IMAGE_ASPECT_COLOR_BIT, 0, 0, 1};
  region.imageExtent = {size.width, size.height, 1};
  vkCmdCopyImageToBuffer(commands_, image, VK_IMAGE_LAYOUT_TRANSFER_SRC_OPTIMAL, readBack_.buffer(),
                         1, &region);
  moveImage(commands_, image, VK_IMAGE_LAYOUT_TRANSFER_SRC_OPTIMAL, VK_ACCESS_TRANSFER_READ_BIT,
            VK_PIPELINE_STAGE_TRANSFER_BIT, VK_IMAGE_LAYOUT_PRESENT_SRC_KHR, 0,
            VK_PIPELINE_STAGE_BOTTOM_OF_PIPE_BIT);
}

void Window::Drawing::takeReadBack() {
  keep_ = false;
  shown_.width = swapchain_.extent().width;
  shown_.height = swapchain_.extent().height;
  const std::size_t pixels = std::size_t{shown_.width} * shown_.height;
  shown_.rgba.resize(4 * pixels);
  const std::uint8_t* from = readBack_.data();
  const int red = swapchain_.blueFirst() ? 2 : 0;
  for (std::size_t i = 0; i < pixels; ++i) {
    shown_.rgba[4 * i] = from[4 * i + red];
    shown_.rgba[4 * i + 1] = from[4 * i + 1];
    shown_.rgba[4 * i + 2] = from[4 * i + 2 - red];
    shown_.rgba[4 * i + 3] = 255;
  }
  ++shown_.version;
}

}  // namespace trex
