#include "src/app/view/window.h"

#define GLFW_INCLUDE_NONE
#include <GLFW/glfw3.h>
#include <backends/imgui_impl_glfw.h>
#include <backends/imgui_impl_vulkan.h>
#include <imgui.h>

#include <algorithm>
#include <utility>

#include "src/app/view/style.h"
#include "src/app/view/window_drawing.h"
#include "src/core/error.h"
#include "src/core/log.h"

namespace trex {
namespace {

Window& windowOf(GLFWwindow* window) {
  return *static_cast<Window*>(glfwGetWindowUserPointer(window));
}

/// Pointer in pixels of the window's images.
vec2 pointerOf(GLFWwindow* window) {
  double x = 0.0, y = 0.0;
  int width = 1, height = 1, pixelsWide = 1, pixelsHigh = 1;
  glfwGetCursorPos(window, &x, &y);
  glfwGetWindowSize(window, &width, &height);
  glfwGetFramebufferSize(window, &pixelsWide, &pixelsHigh);
  return vec2(static_cast<float>(x * pixelsWide / std::max(width, 1)),
              static_cast<float>(y * pixelsHigh / std::max(height, 1)));
}

std::string lastGlfwError() {
  const char* text = nullptr;
  glfwGetError(&text);
  return text == nullptr ? "unknown reason" : text;
}

}  // namespace

Window::Window(const WindowOptions& options) {
  if (glfwInit() == GLFW_FALSE) {
    fail(ExitCode::kMemoryOrDevice,
         "no display to open a window on ({}): set DISPLAY, or use trex render; xvfb-run gives a "
         "virtual display",
         lastGlfwError());
  }
  glfwWindowHint(GLFW_CLIENT_API, GLFW_NO_API);
  glfwWindowHint(GLFW_VISIBLE, options.visible ? GLFW_TRUE : GLFW_FALSE);
  window_ = glfwCreateWindow(static_cast<int>(options.width), static_cast<int>(options.height),
                             options.title.c_str(), nullptr, nullptr);
  if (window_ == nullptr) {
    const std::string reason = lastGlfwError();
    glfwTerminate();
    fail(ExitCode::kMemoryOrDevice, "the window can't be opened: {}", reason);
  }
  float scaleX = 1.0f, scaleY = 1.0f;
  glfwGetWindowContentScale(window_, &scaleX, &scaleY);
  scale_ = std::clamp(std::max(scaleX, scaleY), 0.5f, 4.0f);
  catchInput();
  try {
    drawing_ = std::make_unique<Drawing>(window_);
    makePanels();
  } catch (...) {
    drawing_.reset();
    glfwDestroyWindow(window_);
    glfwTerminate();
    throw;
  }
}

Window::~Window() {
  drawing_->waitIdle();
  ImGui_ImplVulkan_Shutdown();
  ImGui_ImplGlfw_Shutdown();
  ImGui::DestroyContext();
  drawing_.reset();
  glfwDestroyWindow(window_);
  glfwTerminate();
}

void Window::catchInput() {
  glfwSetWindowUserPointer(window_, this);
  const auto add = [](GLFWwindow* window, InputEvent event) {
    Window& self = windowOf(window);
    event.position = pointerOf(window);
    self.events_.push_back(std::move(event));
    self.activity_ = true;
  };
  static const auto addEvent = add;
  glfwSetKeyCallback(window_, [](GLFWwindow* window, int key, int, int action, int mods) {
    InputEvent event;
    event.kind = InputEvent::Kind::kKey;
    event.code = key;
    event.down = action != GLFW_RELEASE;
    event.repeated = action == GLFW_REPEAT;
    event.shift = (mods & GLFW_MOD_SHIFT) != 0;
    event.control = (mods & GLFW_MOD_CONTROL) != 0;
    if (event.down) windowOf(window).pressed_.push_back(key);
    addEvent(window, event);
  });
  glfwSetMouseButtonCallback(window_, [](GLFWwindow* window, int button, int action, int mods) {
    InputEvent event;
    event.kind = InputEvent::Kind::kButton;
    event.code = button;
    event.down = action == GLFW_PRESS;
    event.shift = (mods & GLFW_MOD_SHIFT) != 0;
    event.control = (mods & GLFW_MOD_CONTROL) != 0;
    addEvent(window, event);
  });
  glfwSetCursorPosCallback(window_,
                           [](GLFWwindow* window, double, double) { addEvent(window, {}); });
  glfwSetScrollCallback(window_, [](GLFWwindow* window, double x, double y) {
    InputEvent event;
    event.kind = InputEvent::Kind::kScroll;
    event.scroll = vec2(static_cast<float>(x), static_cast<float>(y));
    addEvent(window, event);
  });
  glfwSetDropCallback(window_, [](GLFWwindow* window, int count, const char** paths) {
    if (count < 1) return;
    InputEvent event;
    event.kind = InputEvent::Kind::kDrop;
    event.path = paths[0];
    addEvent(window, event);
  });
  const auto changed = [](GLFWwindow* window) { windowOf(window).activity_ = true; };
  glfwSetWindowRefreshCallback(window_, changed);
  glfwSetWindowCloseCallback(window_, changed);
}

void Window::makePanels() {
  IMGUI_CHECKVERSION();
  ImGui::CreateContext();
  ImGui::GetIO().IniFilename = nullptr;
  applyStyle(scale_);
  ImGui_ImplGlfw_InitForVulkan(window_, true);
  drawing_->startPanels();
}

void Window::poll(double seconds) {
  if (seconds > 0.0) {
    glfwWaitEventsTimeout(seconds);
  } else {
    glfwPollEvents();
  }
}

std::vector<InputEvent> Window::takeEvents() { return std::exchange(events_, {}); }
bool Window::takeActivity() { return std::exchange(activity_, false); }
bool Window::closing() const { return glfwWindowShouldClose(window_) == GLFW_TRUE; }
void Window::refuseClosing() { glfwSetWindowShouldClose(window_, GLFW_FALSE); }

bool Window::minimised() const {
  int width = 0, height = 0;
  glfwGetFramebufferSize(window_, &width, &height);
  return glfwGetWindowAttrib(window_, GLFW_ICONIFIED) == GLFW_TRUE || width == 0 || height == 0;
}

std::uint32_t Window::width() const {
  int width = 0;
  glfwGetFramebufferSize(window_, &width, nullptr);
  return static_cast<std::uint32_t>(std::max(width, 1));
}

std::uint32_t Window::height() const {
  int height = 0;
  glfwGetFramebufferSize(window_, nullptr, &height);
  return static_cast<std::uint32_t>(std::max(height, 1));
}

bool Window::keyDown(int key) const { return glfwGetKey(window_, key) == GLFW_PRESS; }
void Window::setTitle(const std::string& title) { glfwSetWindowTitle(window_, title.c_str()); }

void Window::setSize(std::uint32_t width, std::uint32_t height) {
  glfwSetWindowSize(window_, static_cast<int>(width), static_cast<int>(height));
}

void Window::minimise() { glfwIconifyWindow(window_); }
void Window::restore() { glfwRestoreWindow(window_); }

std::string Window::clipboard() const {
  const char* text = glfwGetClipboardString(window_);
  return text == nullptr ? "" : text;
}

void Window::setClipboard(const std::string& text) {
  glfwSetClipboardString(window_, text.c_str());
}

void Window::beginPanels() {
  ImGui_ImplVulkan_NewFrame();
  ImGui_ImplGlfw_NewFrame();
  // A key that was pressed and let go since the last frame is down for this one.
  for (const int key : pressed_) {
    if (key >= 0) ImGui::GetIO().KeysDown[key] = true;
  }
  ImGui::NewFrame();
  for (const int key : pressed_) {
    if (key >= 0) ImGui::GetIO().KeysDown[key] = keyDown(key);
  }
  pressed_.clear();
}

void Window::present(const ScreenImage& picture) {
  ImGui::Render();
  drawing_->present(picture, width(), height());
}

void Window::keepNextFrame() { drawing_->keepNextFrame(); }
const ScreenImage& Window::shown() const { return drawing_->shown(); }
const std::string& Window::deviceName() const { return drawing_->device().name(); }

}  // namespace trex
