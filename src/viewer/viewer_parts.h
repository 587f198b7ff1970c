// The inside of Viewer. Private to src/viewer.
#pragma once

#include <algorithm>
#include <chrono>
#include <functional>
#include <memory>
#include <optional>

#include "src/core/clock.h"
#include "src/core/error.h"
#include "src/scene/look_file.h"
#include "src/session/model_editor.h"
#include "src/viewer/background.h"
#include "src/viewer/model_opener.h"
#include "src/viewer/recovery.h"
#include "src/viewer/screen.h"
#include "src/viewer/viewer.h"

namespace trex {

/// Rays and samples a second, over about the last second of work.
struct Rates {
  double seconds = 0.0, cRays = 0.0, gRays = 0.0;
  void add(const SessionReport& before, const SessionReport& after, double taken) {
    const double keep = std::exp(-taken);
    seconds = seconds * keep + taken;
    cRays = cRays * keep + static_cast<double>(after.rays.cRays - before.rays.cRays +
                                               after.rays.shadowRays - before.rays.shadowRays);
    gRays = gRays * keep + static_cast<double>(after.rays.cones - before.rays.cones +
                                               after.rays.cacheReads - before.rays.cacheReads);
  }
};

struct BiasEstimate {
  std::uint32_t count = 0;
  double sum = 0.0, meanSquare = 0.0;
};

/// Session::estimatedError(), asked again when an eighth more samples are there, and of one pixel
/// in 16: of all of them it takes longer than a step.
struct NoiseEstimate {
  double value = -1.0;
  std::uint32_t samples = 0;
  double of(const Session& session) {
    const std::uint32_t done = session.samplesDone();
    if (done >= samples + std::max(samples / 8, 1u)) {
      value = session.estimatedError(4);
      samples = done;
    }
    return value;
  }
};

struct Viewer::Impl {
  static constexpr double kAimDelay = 0.5;  ///< seconds a camera rests before photons follow it

  explicit Impl(const ViewerOptions& o) : options(o) {}

  ViewerOptions options;
  ViewState state, seenState;
  OpenPhase phase = OpenPhase::kEmpty;
  std::string message;
  ExitCode failureCode = ExitCode::kDone;  ///< of phase kFailed
  std::optional<ExitCode> lost;            ///< the model can't be read any more
  std::filesystem::path input, opening;
  ModelOptions modelOptions;
  // Sessions read the editor's model, and background work too: it ends first.
  std::unique_ptr<ModelEditor> editor;
  std::unique_ptr<Session> session, exact;
  std::unique_ptr<LookHistory> history;
  Look startLook, shownLook;
  bool lookChanged = false, wantVoxels = false, exposureSet = false, deviceLeft = false;
  double aimAt = 0.0;  ///< when photons are aimed at the new camera; 0: no need
  Screen screen;
  double screenSeconds = 0.004;  ///< that an update takes
  Rates rates;
  BiasEstimate bias;
  mutable NoiseEstimate noiseEstimate;
  double splitError = -1.0;
  bool recoveryDue = false;
  double nextRecovery = 0.0;
  Background background;

  void open(const std::filesystem::path& path);
  void failed(ExitCode code, const std::string& why);
  void openingFailed(std::exception_ptr problem);
  void takeMeshes(std::shared_ptr<Model> model, const ModelOptions& made);
  void takeSourceVoxels(std::shared_ptr<asvo::Tree> tree, std::unique_ptr<GRayTracer> device);
  void rebuildVoxels();
  void tellHelper();
  void leaveHelper();
  bool idle() const;
  bool exactRests() const;
  bool restyled() const;
  bool wantsAim() const;
  void restartFrame(bool hold);
  void applyLook();
  StepReport step(double seconds);
  void work(double deadline, StepReport& report);
  StepReport::Kind kindOf(const std::optional<Work>& work, bool fresh) const;
  void setExposure();
  float suitableExposure() const;
  void startExact();
  bool leaveDevice(const Error& e);
  bool loseModel(const Error& e);
  void probe();
  void keepRecovery();
  double measureSplit() const;
  LookLight light() const;
};

}  // namespace trex
