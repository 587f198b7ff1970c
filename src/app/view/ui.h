// What all panels share: the viewer, what is selected, and what has been asked for.
//
//   menu bar        File  Edit  Camera  View  Help
//   the picture     behind everything; handles of the selected light; the split's divider
//   right column    eight tabs: Camera Materials Lights Objects / View Section Edits Status
//   bottom line     what is going on, samples, error
#pragma once

#include <imgui.h>

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "src/app/view/file_dialog.h"
#include "src/app/view/look_editor.h"
#include "src/app/view/window.h"
#include "src/core/error.h"
#include "src/viewer/bookmarks.h"
#include "src/viewer/camera_control.h"
#include "src/viewer/viewer.h"

namespace trex {

enum class Panel { kCamera, kMaterials, kLights, kObjects, kView, kSection, kEdits, kStatus };

struct UiOptions {
  std::filesystem::path screenshotFolder = ".";
  std::filesystem::path edits;  ///< where Ctrl+S saves; empty: asks
  bool hidden = false;          ///< no panels at first
  bool asks = true;             ///< offers to restore edits of an earlier run
};

/// A question that needs an answer before anything else.
enum class Question { kNothing, kClose, kRecovery };

class Ui {
 public:
  Ui(Viewer& viewer, Window& window, const UiOptions& options);

  /// Follows what the viewer has done by itself: a model that has been opened, an undo.
  void follow();
  /// Draws all of it into the current ImGui frame.
  void draw();

  // Things that keys, menus and panels ask for.
  void open(const std::filesystem::path& path);
  void askForModel();
  void moveCamera();  ///< shows where `camera` is now
  void setCamera(const Camera& view);
  void frameAll();  ///< or the selected object
  void setPivotAt(const vec2& pixel);
  void goToCamera(std::size_t index);
  void addBookmark();
  void copyCamera();
  void pasteCamera();
  void autoExposure();
  void pickAt(const vec2& pixel);
  void selectObject(int object);
  void selectMaterial(int material);
  void selectLight(int light);
  void undo();
  void redo();
  void restart();
  void saveEdits();  ///< to the file known, or asks for one
  void saveEditsTo(const std::filesystem::path& path);
  void loadEditsFrom(const std::filesystem::path& path);
  void savePicture(const char* extension);
  void savePictureTo(const std::filesystem::path& path);
  void askToClose();
  void say(const std::string& notice);  ///< shown for some seconds
  /// True once, when a notice's seconds are over.
  bool noticeEnded();
  /// Runs what may throw an Error; its text becomes a notice.
  template <typename Action>
  void attempt(Action&& action);

  bool shows() const;  ///< a model is imported
  float aspect() const;
  /// Window pixels a pixel of the picture.
  vec2 pictureScale() const;
  vec2 toPicture(const vec2& windowPixel) const { return windowPixel / pictureScale(); }
  bool pointOnPanel(const vec2& windowPixel) const;

  Viewer& viewer;
  Window& window;
  LookEditor editor;
  std::optional<CameraControl> camera;  ///< while shows()
  Panel panel = Panel::kMaterials;
  bool hidden = false, help = false, closed = false;
  Question question = Question::kNothing;
  std::optional<Pick> picked;
  std::optional<vec2> pointer;  ///< in the picture's pixels, if it is over it
  int material = 0, light = kNone;
  bool scrollToSelection = false;
  std::string materialSearch, objectSearch;
  std::vector<Bookmark> bookmarks;
  FileDialog files;
  std::filesystem::path editsFile;
  bool failed = false;  ///< something that was asked for could not be done

 private:
  void menuBar();
  void cameraMenu();
  void column();
  void tabs();
  void bottomLine();
  void notice();
  void questions();
  void closeQuestion();
  void recoveryQuestion();
  void helpWindow();
  void welcome();
  void takeOver();

  UiOptions options_;
  const Scene* scene_ = nullptr;  ///< that was taken over last
  std::string notice_;
  double noticeUntil_ = 0.0;
  float menuHeight_ = 0.0f, columnWidth_ = 0.0f, bottomHeight_ = 0.0f;
};

template <typename Action>
void Ui::attempt(Action&& action) {
  try {
    action();
  } catch (const Error& e) {
    failed = true;
    say(e.what());
  }
}

}  // namespace trex
