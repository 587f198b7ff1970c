// A window with a picture behind panels: GLFW for the window and its input, Vulkan for its images,
// Dear ImGui for the panels.
#pragma once

#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "src/viewer/viewer.h"

struct GLFWwindow;

namespace trex {

/// Something a person did, in the order it was done; positions in pixels of the window's images.
struct InputEvent {
  enum class Kind { kKey, kButton, kMove, kScroll, kDrop };
  Kind kind = Kind::kMove;
  int code = 0;           ///< key or mouse button, as GLFW numbers them
  bool down = false;      ///< pressed, or released
  bool repeated = false;  ///< a key held down
  bool shift = false, control = false;
  vec2 position{0.0f};         ///< of the pointer
  vec2 scroll{0.0f};           ///< wheel steps
  std::filesystem::path path;  ///< of a file dropped on the window
};

struct WindowOptions {
  std::uint32_t width = 1280, height = 720;  ///< pixels
  bool visible = true;
  std::string title = "T-ReX";
};

class Window {
 public:
  /// Throws Error(kMemoryOrDevice) if there is no display or nothing can draw into it.
  explicit Window(const WindowOptions& options);
  ~Window();
  Window(const Window&) = delete;
  Window& operator=(const Window&) = delete;

  /// Takes what has happened since; waits for something for at most `seconds`.
  void poll(double seconds);
  std::vector<InputEvent> takeEvents();
  /// True if anything has happened that a redraw may show; then false until something else does.
  bool takeActivity();

  bool closing() const;
  void refuseClosing();  ///< closing() is false again
  bool minimised() const;
  std::uint32_t width() const;  ///< pixels of the images, at least 1
  std::uint32_t height() const;
  float scale() const { return scale_; }  ///< of texts and panels, from the display
  bool keyDown(int key) const;
  void setTitle(const std::string& title);
  void setSize(std::uint32_t width, std::uint32_t height);
  void minimise();
  void restore();
  std::string clipboard() const;
  void setClipboard(const std::string& text);

  /// Begins the panels of a frame; ImGui may be used until present().
  void beginPanels();
  /// Draws the picture and the panels over it and shows them. A software device has drawn when
  /// this returns.
  void present(const ScreenImage& picture);
  /// What the next present() shows is kept for shown().
  void keepNextFrame();
  const ScreenImage& shown() const;

  /// The device that draws.
  const std::string& deviceName() const;

 private:
  struct Drawing;
  void makePanels();
  void catchInput();

  GLFWwindow* window_ = nullptr;
  std::unique_ptr<Drawing> drawing_;
  float scale_ = 1.0f;
  std::vector<InputEvent> events_;
  std::vector<int> pressed_;  ///< keys, since the last frame
  bool activity_ = true;
};

}  // namespace trex
