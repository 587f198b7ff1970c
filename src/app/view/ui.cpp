// What can be asked for, whether by key, menu or panel.
#include "src/app/view/ui.h"

#define GLFW_INCLUDE_NONE
#include <GLFW/glfw3.h>
#include <fmt/format.h>

#include <cmath>

#include "src/app/view/handles.h"
#include "src/frame/image_file.h"
#include "src/scene/import.h"

namespace trex {
namespace {

constexpr double kNoticeSeconds = 5.0;
/// Pixels across the picture that are asked when an object is framed.
constexpr int kProbes = 48;

Box3d seenBounds(const Viewer& viewer, int object) {
  Box3d box;
  const ScreenImage& screen = viewer.screen();
  for (int y = 0; y < kProbes; ++y) {
    for (int x = 0; x < kProbes; ++x) {
      const auto hit =
          viewer.pick((static_cast<float>(x) + 0.5f) / kProbes * static_cast<float>(screen.width),
                      (static_cast<float>(y) + 0.5f) / kProbes * static_cast<float>(screen.height));
      if (hit && static_cast<int>(hit->object) == object) box.extend(hit->position);
    }
  }
  return box;
}

std::filesystem::path freeName(const std::filesystem::path& folder, const std::string& stem,
                               const char* extension) {
  for (int number = 1;; ++number) {
    const auto path = folder / fmt::format("{}-{:04}{}", stem, number, extension);
    std::error_code ignored;
    if (!std::filesystem::exists(path, ignored)) return path;
  }
}

}  // namespace

Ui::Ui(Viewer& shownViewer, Window& shownWindow, const UiOptions& options)
    : viewer(shownViewer),
      window(shownWindow),
      editor(shownViewer),
      hidden(options.hidden),
      editsFile(options.edits),
      options_(options) {}

bool Ui::shows() const {
  const OpenPhase phase = viewer.phase();
  return phase == OpenPhase::kVoxels || phase == OpenPhase::kReady;
}

float Ui::aspect() const {
  return static_cast<float>(window.width()) / static_cast<float>(window.height());
}

vec2 Ui::pictureScale() const {
  const ScreenImage& screen = viewer.screen();
  if (screen.width == 0 || screen.height == 0) return vec2(1.0f);
  return vec2(static_cast<float>(window.width()) / static_cast<float>(screen.width),
              static_cast<float>(window.height()) / static_cast<float>(screen.height));
}

void Ui::follow() {
  const Scene* scene = shows() ? &viewer.scene() : nullptr;
  if (scene == nullptr) camera.reset();
  if (scene != nullptr && scene != scene_) takeOver();
  scene_ = scene;
  if (camera && camera->camera() != viewer.look().camera) camera->setCamera(viewer.look().camera);
}

void Ui::takeOver() {
  camera.emplace(viewer.look().camera, viewer.bounds());
  bookmarks = readBookmarks(bookmarksFile(viewer.input()));
  picked.reset();
  material = 0;
  light = kNone;
  viewer.state().selectedObject = kNone;
  window.setTitle(viewer.input().filename().string() + " - T-ReX");
  if (options_.asks && viewer.recoveryFile()) question = Question::kRecovery;
}

void Ui::open(const std::filesystem::path& path) {
  editor.letGo();
  editsFile.clear();
  viewer.open(path);
}

void Ui::askForModel() {
  const auto start = viewer.input().empty() ? std::filesystem::path(".") : viewer.input();
  files.ask("Open a model", start.parent_path(), {".glb", ".gltf", ".ply", ".obj", ".trex"}, false,
            [this](const std::filesystem::path& path) { open(path); });
}

void Ui::moveCamera() {
  if (!camera) return;
  Look look = viewer.look();
  look.camera = camera->camera();
  editor.changeView(look);
}

void Ui::setCamera(const Camera& view) {
  if (!camera) return;
  camera->setCamera(view);
  moveCamera();
}

void Ui::frameAll() {
  if (!camera) return;
  const int object = viewer.state().selectedObject;
  const Box3d seen = object == kNone ? Box3d{} : seenBounds(viewer, object);
  camera->frame(seen.empty() ? viewer.bounds() : seen, double(aspect()));
  moveCamera();
}

void Ui::setPivotAt(const vec2& pixel) {
  const auto hit = shows() ? viewer.pick(pixel.x, pixel.y) : std::nullopt;
  if (!hit) return;
  camera->setPivot(hit->position);
  say("The view turns about this point now");
}

void Ui::goToCamera(std::size_t index) {
  if (shows() && index < viewer.scene().cameras.size()) setCamera(viewer.scene().cameras[index]);
}

void Ui::addBookmark() {
  if (!shows()) return;
  bookmarks.push_back(
      {fmt::format("View {}", bookmarks.size() + 1), cameraText(viewer.look().camera)});
  attempt([&] { writeBookmarks(bookmarksFile(viewer.input()), bookmarks); });
}

void Ui::copyCamera() {
  if (!shows()) return;
  window.setClipboard(cameraText(viewer.look().camera));
  say("The camera is in the clipboard");
}

void Ui::pasteCamera() {
  if (!shows()) return;
  attempt([&] { setCamera(parseCamera(window.clipboard(), viewer.scene())); });
}

void Ui::autoExposure() {
  if (!shows()) return;
  Look look = viewer.look();
  look.exposure = viewer.suitableExposure();
  editor.changeView(look);
}

void Ui::pickAt(const vec2& pixel) {
  if (!shows()) return;
  if (const int lamp = lightAt(*this, pixel); lamp != kNone) {
    selectLight(lamp);
    return;
  }
  picked = viewer.pick(pixel.x, pixel.y);
  selectObject(picked ? static_cast<int>(picked->object) : kNone);
  if (!picked) return;
  material = static_cast<int>(picked->material);
  scrollToSelection = true;
  if (panel != Panel::kObjects && panel != Panel::kMaterials) panel = Panel::kMaterials;
}

void Ui::selectObject(int object) {
  viewer.state().selectedObject = object;
  scrollToSelection = true;
}

void Ui::selectMaterial(int index) {
  material = index;
  panel = Panel::kMaterials;
  scrollToSelection = true;
}

void Ui::selectLight(int index) {
  light = index;
  panel = Panel::kLights;
}

void Ui::undo() {
  if (!shows()) return;
  editor.letGo();
  if (!viewer.history().canUndo()) return;
  say("Undone: " + viewer.history().undoName());
  viewer.undo();
}

void Ui::redo() {
  if (!shows() || !viewer.history().canRedo()) return;
  say("Done again: " + viewer.history().redoName());
  viewer.redo();
}

void Ui::restart() {
  // A new size starts the frame anew, the old one again.
  const ScreenImage& screen = viewer.screen();
  const std::uint32_t width = std::max(screen.width, 1u), height = std::max(screen.height, 1u);
  viewer.resize(width, height + 1);
  viewer.resize(width, height);
}

void Ui::saveEdits() {
  if (!shows()) return;
  if (!editsFile.empty()) {
    saveEditsTo(editsFile);
    return;
  }
  const auto proposed = viewer.input().stem().string() + ".look.json";
  files.ask("Save edits", proposed, {".json"}, true,
            [this](const std::filesystem::path& path) { saveEditsTo(path); });
}

void Ui::saveEditsTo(const std::filesystem::path& path) {
  attempt([&] {
    editor.letGo();
    viewer.saveEdits(path);
    editsFile = path;
    say("Saved " + path.string());
  });
}

void Ui::loadEditsFrom(const std::filesystem::path& path) {
  attempt([&] {
    viewer.loadEdits(path);
    editsFile = path;
    say("Loaded " + path.string());
  });
}

void Ui::savePicture(const char* extension) {
  if (!shows()) return;
  savePictureTo(freeName(options_.screenshotFolder, viewer.input().stem().string(), extension));
}

void Ui::savePictureTo(const std::filesystem::path& path) {
  attempt([&] {
    viewer.savePicture(path);
    say("Saved " + path.string());
  });
}

void Ui::askToClose() {
  if (shows() && viewer.unsavedEdits()) {
    question = Question::kClose;
    return;
  }
  closed = true;
}

void Ui::say(const std::string& text) {
  notice_ = text;
  noticeUntil_ = glfwGetTime() + kNoticeSeconds;
}

bool Ui::noticeEnded() {
  if (notice_.empty() || glfwGetTime() < noticeUntil_) return false;
  notice_.clear();
  return true;
}

}  // namespace trex
