// The viewer without its window: a model that opens in the background, a look with undo, a frame
// that is refined step by step, and the picture of it that a screen shows. trex view draws it and
// feeds it input; tests and the replay drive it without a window.
//
//   open ──► import, meshes ─► first coarse frame ─► voxels ─► photons ─► refined for as long as
//            (background)                            (background)         there is something to
//            gain
//
// THREADS. Every call is made by one thread; work in the background is taken over in step().
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "hccmesh/pages.h"
#include "src/core/error.h"
#include "src/core/maths.h"
#include "src/frame/image_file.h"
#include "src/scene/import.h"
#include "src/scene/look.h"
#include "src/session/session.h"
#include "src/session/settings.h"
#include "src/viewer/look_history.h"

namespace trex {

/// A bundle that another machine has.
struct RemoteModel {
  std::shared_ptr<const hccm::PageFile> file;
  std::uint64_t bytes = 0;
  std::function<void()> leave;  ///< nothing is read from it any more: reads throw
  /// Shoots photons where not all pages have room here; outlives the viewer.
  PhotonSharer* photons = nullptr;
};

struct ViewerOptions {
  std::filesystem::path input;        ///< may be empty: nothing is open
  std::optional<RemoteModel> remote;  ///< `input` is this one's name there
  std::uint64_t cacheBytes = 0;       ///< of pages of a streamed bundle; 0: what memory allows
  std::filesystem::path edits;        ///< overlay to start from; may be empty
  std::string environment;            ///< as --env; empty: the file's
  std::vector<std::string> volumes;   ///< as --volume
  std::string camera;                 ///< as --camera; empty: the first one
  ImportOptions import;               ///< without volumes and the memory limit
  RenderSettings settings;            ///< samples: where refining ends
  double budgetSeconds = 0.033;       ///< of a step
  bool useStale = false;
  bool recovery = true;  ///< keep unsaved edits in a recovery file
  /// Other machines that have `input`, too; it outlives the viewer. Null: none.
  SampleHelper* helper = nullptr;
};

/// What the screen shows.
enum class ViewMode : std::uint8_t {
  kBeauty,
  kAlbedo,
  kNormal,
  kDepth,
  kVariance,
  kSampleCount,
  kRayClass,  ///< share of C-rays (orange) and G-rays (blue)
  kVoxels,    ///< at ViewState::voxelLevel
  kPhotons,   ///< irradiance of the voxels at the first surface
};
/// "beauty", "albedo", ... by the number of the mode.
const std::vector<std::string>& viewModeNames();

/// Things of the screen alone: they change no sample and are not part of a look.
struct ViewState {
  ViewMode mode = ViewMode::kBeauty;
  int voxelLevel = 6;          ///< [0, depth of the tree]
  bool split = false;          ///< right of splitAt: the exact mode
  float splitAt = 0.5f;        ///< share of the width
  int selectedObject = kNone;  ///< highlighted
  bool paused = false;
  ToneOperator toneOperator = kDefaultToneOperator;
  vec2 pointer{0.5f, 0.5f};  ///< share of width and height: tiles near it come first
};

/// What lies under a pixel.
struct Pick {
  std::uint32_t object = 0, material = 0;
  dvec3 position{0.0};  ///< world, metres
  vec3 normal{0.0f};
  float distance = 0.0f;  ///< from the eye, metres
};

enum class OpenPhase : std::uint8_t {
  kEmpty,      ///< nothing is open
  kImporting,  ///< nothing to show yet
  kVoxels,     ///< shown by exact paths while voxels are made
  kReady,
  kFailed,  ///< message() says why
};

/// What one step did.
struct StepReport {
  enum class Kind : std::uint8_t { kIdle, kPreview, kCoarse, kLight, kRefine, kView };
  Kind kind = Kind::kIdle;
  double seconds = 0.0;
  bool newPicture = false;      ///< screen() has changed
  bool coarseComplete = false;  ///< the first complete frame after a change is in screen()
};

/// The picture for the screen: 8-bit sRGB RGBA, rows from the top.
struct ScreenImage {
  std::uint32_t width = 0, height = 0;
  std::vector<std::uint8_t> rgba;
  std::uint64_t version = 0;  ///< grows with every change
};

/// Figures for the status panel.
struct ViewerFigures {
  SessionReport session;
  double cRaysPerSecond = 0.0, gRaysPerSecond = 0.0, samplesPerSecond = 0.0;
  double exactShare = 0.0;       ///< of the samples so far, traced exactly
  double samplesPerPixel = 0.0;  ///< mean
  double noise = -1.0;           ///< estimated relMSE of the noise; negative: not known yet
  double bias = -1.0;            ///< estimated relMSE of the guess's bias
  double truthDistance = -1.0;   ///< noise + bias: how far from the truth
  double splitError = -1.0;      ///< relMSE between both halves' modes, noise removed
  std::uint64_t meshBytes = 0, voxelBytes = 0, residentBytes = 0, deviceBytes = 0;
  std::string device;
  int voxelDepth = 0;
  bool converged = false;
  std::uint32_t machines = 0, readyMachines = 0;  ///< besides this one: SampleHelper
  std::uint32_t tiles = 0, longestWait = 0;       ///< frames since the tile served longest ago was
};

class Viewer {
 public:
  explicit Viewer(const ViewerOptions& options);
  ~Viewer();

  /// Opens another model in the background; the one shown stays until the new one is imported.
  /// Unsaved edits go to the recovery file first. Errors end in phase kFailed and message().
  void open(const std::filesystem::path& input);
  OpenPhase phase() const;
  /// What is going on, or what went wrong; empty if there is nothing to say.
  std::string message() const;
  /// The exit code of what keeps the model from being shown, or traced any more: opening it has
  /// failed (kFailed), or its pages, at another machine, can't be read (what is shown stays).
  /// message() says why.
  std::optional<ExitCode> problem() const;
  const std::filesystem::path& input() const;

  /// Does what comes next for at most about `seconds`; rays do not wait for pages of a model that
  /// is elsewhere. Throws Error for a lost device (code 4).
  StepReport step(double seconds);
  /// True if step() has nothing to do: converged, paused, or empty, and nothing in the background.
  bool idle() const;
  /// Size of the picture, at least 1x1; a new size starts the frame anew.
  void resize(std::uint32_t width, std::uint32_t height);
  const ScreenImage& screen() const;
  /// Exposure in stops that suits what is shown now.
  float suitableExposure() const;
  ViewState& state();  ///< change it freely; the next step() sees it

  // Only once something is imported (phase kVoxels or kReady).
  const Scene& scene() const;  ///< names, cameras, counts; materials and lights are the look's
  const Look& look() const;
  const Look& sourceLook() const;  ///< as the file has it
  /// Shows another look. `commit` ends one step of undo; without it (while a slider moves) the
  /// change belongs to the step that the next commit ends.
  void edit(const Look& look, bool commit, const std::string& what);
  LookHistory& history();
  void undo();
  void redo();
  Box3d bounds() const;                              ///< world
  std::optional<Pick> pick(float x, float y) const;  ///< pixels from the upper left
  /// World to pixels; false behind the camera.
  bool project(const dvec3& world, vec2& pixel) const;
  int voxelDepth() const;

  ViewerFigures figures() const;

  /// Saves what is shown: .png or .jpg tone-mapped, .exr linear with layers. Throws Error(kOutput).
  void savePicture(const std::filesystem::path& path);
  /// Saves the edits as an overlay. Throws Error(kOutput).
  void saveEdits(const std::filesystem::path& path);
  void loadEdits(const std::filesystem::path& path);  ///< throws Error(kInput)
  bool unsavedEdits() const;
  /// A recovery file of an earlier run that ended badly, if there is one for this model.
  std::optional<std::filesystem::path> recoveryFile() const;
  void restoreRecovery();
  void discardRecovery();
  /// The command that renders this view headless to the same pixels.
  std::string headlessCommand(const std::string& editsPath, const std::string& output) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace trex
