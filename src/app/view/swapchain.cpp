#include "src/app/view/swapchain.h"

#include <algorithm>

#include "src/core/error.h"

namespace trex {

Swapchain::Swapchain(const DisplayDevice& device) : device_(device) {
  chooseFormat();
  choosePresentMode();
  createPass();
}

Swapchain::~Swapchain() {
  destroyImages();
  vkDestroySwapchainKHR(device_.device(), swapchain_, nullptr);
  vkDestroyRenderPass(device_.device(), pass_, nullptr);
}

void Swapchain::chooseFormat() {
  std::uint32_t count = 0;
  vkGetPhysicalDeviceSurfaceFormatsKHR(device_.physical(), device_.surface(), &count, nullptr);
  std::vector<VkSurfaceFormatKHR> formats(count);
  vkGetPhysicalDeviceSurfaceFormatsKHR(device_.physical(), device_.surface(), &count,
                                       formats.data());
  // Picture and panels are encoded already: a format that encodes would do it twice.
  for (const VkFormat wanted : {VK_FORMAT_B8G8R8A8_UNORM, VK_FORMAT_R8G8B8A8_UNORM}) {
    for (const VkSurfaceFormatKHR& format : formats) {
      if (format.format != wanted) continue;
      format_ = format;
      return;
    }
  }
  fail(ExitCode::kMemoryOrDevice, "drawing the window: {} offers no 8-bit RGBA surface",
       device_.name());
}

void Swapchain::choosePresentMode() {
  std::uint32_t count = 0;
  vkGetPhysicalDeviceSurfacePresentModesKHR(device_.physical(), device_.surface(), &count, nullptr);
  std::vector<VkPresentModeKHR> modes(count);
  vkGetPhysicalDeviceSurfacePresentModesKHR(device_.physical(), device_.surface(), &count,
                                            modes.data());
  // Waiting for the display would be time that no ray is traced in.
  for (const VkPresentModeKHR wanted :
       {VK_PRESENT_MODE_MAILBOX_KHR, VK_PRESENT_MODE_IMMEDIATE_KHR}) {
    if (std::find(modes.begin(), modes.end(), wanted) == modes.end()) continue;
    mode_ = wanted;
    return;
  }
}

void Swapchain::createPass() {
  VkAttachmentDescription color{};
  color.format = format_.format;
  color.samples = VK_SAMPLE_COUNT_1_BIT;
  color.loadOp = VK_ATTACHMENT_LOAD_OP_LOAD;
  color.storeOp = VK_ATTACHMENT_STORE_OP_STORE;
  color.stencilLoadOp = VK_ATTACHMENT_LOAD_OP_DONT_CARE;
  color.stencilStoreOp = VK_ATTACHMENT_STORE_OP_DONT_CARE;
  color.initialLayout = VK_IMAGE_LAYOUT_TRANSFER_DST_OPTIMAL;
  color.finalLayout = VK_IMAGE_LAYOUT_PRESENT_SRC_KHR;
  const VkAttachmentReference reference{0, VK_IMAGE_LAYOUT_COLOR_ATTACHMENT_OPTIMAL};
  VkSubpassDescription subpass{};
  subpass.pipelineBindPoint = VK_PIPELINE_BIND_POINT_GRAPHICS;
  subpass.colorAttachmentCount = 1;
  subpass.pColorAttachments = &reference;
  VkSubpassDependency in{};
  in.srcSubpass = VK_SUBPASS_EXTERNAL;
  in.srcStageMask = VK_PIPELINE_STAGE_TRANSFER_BIT;
  in.srcAccessMask = VK_ACCESS_TRANSFER_WRITE_BIT;
  in.dstStageMask = VK_PIPELINE_STAGE_COLOR_ATTACHMENT_OUTPUT_BIT;
  in.dstAccessMask = VK_ACCESS_COLOR_ATTACHMENT_READ_BIT | VK_ACCESS_COLOR_ATTACHMENT_WRITE_BIT;
  VkSubpassDependency out{};  // for reading the image back
  out.dstSubpass = VK_SUBPASS_EXTERNAL;
  out.srcStageMask = VK_PIPELINE_STAGE_COLOR_ATTACHMENT_OUTPUT_BIT;
  out.srcAccessMask = VK_ACCESS_COLOR_ATTACHMENT_WRITE_BIT;
  out.dstStageMask = VK_PIPELINE_STAGE_TRANSFER_BIT;
  out.dstAccessMask = VK_ACCESS_TRANSFER_READ_BIT | VK_ACCESS_TRANSFER_WRITE_BIT;
  const VkSubpassDependency dependencies[] = {in, out};
  VkRenderPassCreateInfo info{};
  info.sType = VK_STRUCTURE_TYPE_RENDER_PASS_CREATE_INFO;
  info.attachmentCount = 1;
  info.pAttachments = &color;
  info.subpassCount = 1;
  info.pSubpasses = &subpass;
  info.dependencyCount = 2;
  info.pDependencies = dependencies;
  checkVulkan(vkCreateRenderPass(device_.device(), &info, nullptr, &pass_), "vkCreateRenderPass");
}

bool Swapchain::recreate(std::uint32_t width, std::uint32_t height) {
  VkSurfaceCapabilitiesKHR surface;
  checkVulkan(
      vkGetPhysicalDeviceSurfaceCapabilitiesKHR(device_.physical(), device_.surface(), &surface),
      "asking for the window's size");
  VkExtent2D extent = surface.currentExtent;
  if (extent.width == 0xffffffffu) {
    extent.width = std::clamp(width, surface.minImageExtent.width, surface.maxImageExtent.width);
    extent.height =
        std::clamp(height, surface.minImageExtent.height, surface.maxImageExtent.height);
  }
  if (extent.width == 0 || extent.height == 0) return false;
  const std::uint32_t most = surface.maxImageCount == 0 ? 8 : surface.maxImageCount;
  VkSwapchainCreateInfoKHR info{};
  info.sType = VK_STRUCTURE_TYPE_SWAPCHAIN_CREATE_INFO_KHR;
  info.surface = device_.surface();
  info.minImageCount = std::min(std::max(surface.minImageCount, 3u), most);
  info.imageFormat = format_.format;
  info.imageColorSpace = format_.colorSpace;
  info.imageExtent = extent;
  info.imageArrayLayers = 1;
  info.imageUsage = VK_IMAGE_USAGE_COLOR_ATTACHMENT_BIT | VK_IMAGE_USAGE_TRANSFER_DST_BIT |
                    VK_IMAGE_USAGE_TRANSFER_SRC_BIT;
  info.imageSharingMode = VK_SHARING_MODE_EXCLUSIVE;
  info.preTransform = surface.currentTransform;
  info.compositeAlpha = VK_COMPOSITE_ALPHA_OPAQUE_BIT_KHR;
  info.presentMode = mode_;
  info.clipped = VK_TRUE;
  info.oldSwapchain = swapchain_;
  VkSwapchainKHR made = VK_NULL_HANDLE;
  checkVulkan(vkCreateSwapchainKHR(device_.device(), &info, nullptr, &made),
              "making the window's images");
  destroyImages();
  vkDestroySwapchainKHR(device_.device(), swapchain_, nullptr);
  swapchain_ = made;
  extent_ = extent;
  createImages();
  return true;
}

void Swapchain::createImages() {
  std::uint32_t count = 0;
  vkGetSwapchainImagesKHR(device_.device(), swapchain_, &count, nullptr);
  images_.resize(count);
  vkGetSwapchainImagesKHR(device_.device(), swapchain_, &count, images_.data());
  for (VkImage image : images_) {
    VkImageViewCreateInfo view{};
    view.sType = VK_STRUCTURE_TYPE_IMAGE_VIEW_CREATE_INFO;
    view.image = image;
    view.viewType = VK_IMAGE_VIEW_TYPE_2D;
    view.format = format_.format;
    view.subresourceRange = {VK_IMAGE_ASPECT_COLOR_BIT, 0, 1, 0, 1};
    checkVulkan(vkCreateImageView(device_.device(), &view, nullptr, &views_.emplace_back()),
                "vkCreateImageView");
    VkFramebufferCreateInfo framebuffer{};
    framebuffer.sType = VK_STRUCTURE_TYPE_FRAMEBUFFER_CREATE_INFO;
    framebuffer.renderPass = pass_;
    framebuffer.attachmentCount = 1;
    framebuffer.pAttachments = &views_.back();
    framebuffer.width = extent_.width;
    framebuffer.height = extent_.height;
    framebuffer.layers = 1;
    checkVulkan(
        vkCreateFramebuffer(device_.device(), &framebuffer, nullptr, &framebuffers_.emplace_back()),
        "vkCreateFramebuffer");
    VkSemaphoreCreateInfo semaphore{};
    semaphore.sType = VK_STRUCTURE_TYPE_SEMAPHORE_CREATE_INFO;
    checkVulkan(vkCreateSemaphore(device_.device(), &semaphore, nullptr, &drawn_.emplace_back()),
                "vkCreateSemaphore");
  }
}

void Swapchain::destroyImages() {
  for (VkFramebuffer framebuffer : framebuffers_) {
    vkDestroyFramebuffer(device_.device(), framebuffer, nullptr);
  }
  for (VkImageView view : views_) vkDestroyImageView(device_.device(), view, nullptr);
  for (VkSemaphore semaphore : drawn_) vkDestroySemaphore(device_.device(), semaphore, nullptr);
  framebuffers_.clear();
  views_.clear();
  drawn_.clear();
  images_.clear();
}

int Swapchain::acquire(VkSemaphore available) {
  std::uint32_t index = 0;
  const VkResult result = vkAcquireNextImageKHR(device_.device(), swapchain_, ~std::uint64_t{0},
                                                available, VK_NULL_HANDLE, &index);
  if (result == VK_ERROR_OUT_OF_DATE_KHR) return -1;
  if (result != VK_SUBOPTIMAL_KHR) checkVulkan(result, "vkAcquireNextImageKHR");
  return static_cast<int>(index);
}

bool Swapchain::present(std::uint32_t index) {
  VkPresentInfoKHR info{};
  info.sType = VK_STRUCTURE_TYPE_PRESENT_INFO_KHR;
  info.waitSemaphoreCount = 1;
  info.pWaitSemaphores = &drawn_[index];
  info.swapchainCount = 1;
  info.pSwapchains = &swapchain_;
  info.pImageIndices = &index;
  const VkResult result = vkQueuePresentKHR(device_.queue(), &info);
  if (result == VK_ERROR_OUT_OF_DATE_KHR || result == VK_SUBOPTIMAL_KHR) return false;
  checkVulkan(result, "vkQueuePresentKHR");
  return true;
}

}  // namespace trex
