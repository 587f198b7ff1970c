// Scripts that drive the viewer without hands: a list of edits and camera moves, and what to
// measure and save after each. docs/viewer.md lists every key.
//
//   {"trex": 1, "size": "640x360", "steps": [
//     {"wait": "ready"},
//     {"camera": {"orbit": [0.1, 0]}, "settle": 2.0},
//     {"material": {"name": "wall", "roughness": 0.2}, "screenshot": "wall.png"}]}
#pragma once

#include <cstdint>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "src/scene/look.h"
#include "src/viewer/camera_control.h"
#include "src/viewer/viewer.h"

namespace trex {

/// What a step waits for.
enum class ReplayWait { kNothing, kShown, kReady, kMachines, kIdle };

struct ReplayStep {
  std::string label;  ///< of the report; else what the step changes: "camera", "material", ...
  // Edits, in this order; JSON values are checked when they are applied.
  std::string camera;         ///< a name or EYE/TARGET/UP/VFOV; empty: none
  nlohmann::json cameraMove;  ///< {"orbit": [x, y]}, ...; null: none
  std::optional<float> exposure;
  nlohmann::json material, light, environment, section;  ///< null: none
  bool noSection = false;
  nlohmann::json hide, show;  ///< arrays of names and numbers; null: none
  nlohmann::json isolate;     ///< a name or number; null: none
  bool showAll = false, revert = false;
  int undo = 0, redo = 0;
  // The window and the viewer.
  std::string open, loadEdits;
  std::optional<std::uint32_t> width, height;
  bool minimise = false, restore = false;
  std::optional<ViewMode> mode;
  std::optional<int> voxelLevel;
  std::optional<bool> split, paused, ui;
  std::optional<float> splitAt;
  std::optional<vec2> pick;  ///< pixels of the picture
  std::string panel;         ///< of the column, by the name of its tab
  // What to do then.
  ReplayWait wait = ReplayWait::kNothing;
  std::uint32_t frames = 0;  ///< turns of the loop
  double seconds = 0.0;
  double samples = 0.0;  ///< a pixel, to wait for
  double settle = 0.0;   ///< seconds until the picture counts as settled
  double idle = 0.0;     ///< seconds to measure the use of cores when idle
  std::string screenshot, save, saveEdits;
  bool close = false;  ///< ends the script here
  std::uint32_t repeat = 1;

  /// Whether anything changes that a new picture must follow.
  bool edits() const;
};

struct ReplayScript {
  std::uint32_t width = 640, height = 360;
  bool ui = false, visible = false;
  std::vector<ReplayStep> steps;
};

/// Reads a script. Throws Error(kInput) with the file and the JSON pointer of what is wrong.
ReplayScript readReplay(const std::filesystem::path& path);
ReplayScript parseReplay(const std::string& text, const std::string& name);

/// What of a scene a step refers to.
struct ReplayScene {
  const Scene& scene;
  const Look& source;
  Box3d bounds;
  double aspect = 1.0;
};

/// Applies the step's changes of camera and look; undo, redo and files are the caller's. Throws
/// Error(kInput) for a name that does not exist or a value out of range.
void applyReplay(const ReplayStep& step, const ReplayScene& scene, CameraControl& camera,
                 Look& look);

}  // namespace trex
