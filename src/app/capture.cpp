#include "src/app/capture.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <exception>

#include "src/app/render_report.h"
#include "src/bundle/bundle.h"
#include "src/command/interrupt.h"
#include "src/core/clock.h"
#include "src/core/error.h"
#include "src/core/file.h"
#include "src/core/hash.h"
#include "src/core/log.h"
#include "src/core/version.h"
#include "src/scene/import.h"

namespace trex {
namespace fs = std::filesystem;
namespace {

/// The operator that was asked for.
ToneMap toneMapOf(const RenderArguments& a, float exposure) {
  const auto& names = toneOperatorNames();
  const auto at = std::find(names.begin(), names.end(), a.tonemap) - names.begin();
  return {exposure, static_cast<ToneOperator>(at)};
}

/// What of a job decides the bits of its pictures, but for the files.
std::string jobText(const RenderArguments& a, const Model& model, const std::vector<View>& views) {
  const RenderSettings& s = a.settings;
  std::string text = fmt::format("{} {}x{} {} {} {} {} {} {} {}", kVersion, s.width, s.height,
                                 exactText(s), s.seed, guessText(s), static_cast<int>(s.photonKind),
                                 s.device, static_cast<int>(s.denoise), a.environment);
  // A memory limit may have made the voxels coarser.
  if (model.voxels) text += fmt::format(" {}", model.voxels->info.leafCount);
  // Of pages, cones read those that are there.
  if (s.maxGpuMemory > 0) text += fmt::format(" gpu {}", s.maxGpuMemory);
  if (s.transparent) text += " transparent";
  text += a.import.key();
  if (!a.edits.empty()) text += fmt::format(" {:016x}", hashFile(a.edits));
  for (const std::string& volume : a.volumes) text += ' ' + volume;
  for (const std::string& layer : a.layers) text += ' ' + layer;
  for (const View& view : views) text += ' ' + cameraText(view.camera);
  return text;
}

std::string filesText(const Model& model) {
  std::string text;
  for (const SourceFile& file : model.scene.files) {
    text += fmt::format(" {:016x}",
                        isBundlePath(file.path) ? bundleDigest(file.path) : hashFile(file.path));
  }
  return text;
}

}  // namespace

std::uint64_t jobKey(const RenderArguments& a, const Model& model, const std::vector<View>& views) {
  std::string text = jobText(a, model, views) + filesText(model);
  if (mayUseOidn(a.settings)) text += " oidn";  // which keeps more sums
  return hashText(text);
}

std::uint64_t machinesDigest(const RenderArguments& a, const Model& model,
                             const std::vector<View>& views) {
  std::string text = jobText(a, model, views);
  if (a.sceneDb == "local") text += filesText(model);
  return hashText(text);
}

Capture::Capture(const RenderArguments& arguments, std::shared_ptr<const Model> model,
                 std::vector<View> views, double importSeconds, machines::Leader* leader)
    : a_(arguments),
      model_(std::move(model)),
      views_(std::move(views)),
      layers_(layersOf(arguments)),
      importSeconds_(importSeconds),
      leader_(leader),
      key_(arguments.checkpoint.empty() ? 0 : jobKey(arguments, *model_, views_)) {}

int Capture::run() {
  if (!a_.checkpoint.empty()) openCheckpoint();
  nextCheckpoint_ = secondsNow() + a_.checkpointSeconds;
  const std::uint32_t first = resumed_ ? resumed_->header().frame : 0;
  for (std::uint32_t i = first; i < views_.size() && interruptedBy() == 0; ++i) runView(i);
  if (a_.json) {
    fmt::print("{}\n", (summaries_.size() == 1 ? summaries_[0] : summaries_).dump(2));
    std::fflush(stdout);
  }
  const int signal = interruptedBy();
  return signal == 0 ? 0 : 128 + signal;
}

/// Goes on from the checkpoint where that was asked for and there is one.
void Capture::openCheckpoint() {
  if (!fs::exists(a_.checkpoint)) {
    if (a_.resume) logInfo("{}: no checkpoint yet, starting anew", a_.checkpoint);
    return;
  }
  if (!a_.resume) {
    fail(ExitCode::kUsage, "{}: a checkpoint is there already; go on with --resume, or remove it",
         a_.checkpoint);
  }
  resumed_.emplace(a_.checkpoint);
  if (resumed_->header().key != key_) {
    resumed_->refuse("it is of another model, camera, seed or other settings");
  }
  if (resumed_->header().frame >= views_.size()) resumed_->refuse("it counts more pictures");
}

void Capture::runView(std::uint32_t frame) {
  const View& view = views_[frame];
  if (leader_ != nullptr) leader_->beginView(frame);
  Session session(model_, view.camera, a_.settings, layers_);
  session.giveUpWhen([] { return interruptedBy() != 0; });
  session.shareSamples(leader_);
  if (resumed_ && resumed_->header().frame == frame) {
    session.restoreCheckpoint(*resumed_);
    logInfo("{}: going on after {} samples a pixel", a_.checkpoint, session.samplesDone());
  }
  try {
    advance(session, frame);
  } catch (const Error& e) {
    if (leader_ != nullptr && !a_.checkpoint.empty()) saveCheckpoint(session, frame);
    if (e.code() == ExitCode::kMemoryOrDevice && session.samplesDone() > 0) {
      save(session, view, false);
      logInfo("{}: saved after {} samples a pixel", view.output, session.samplesDone());
    }
    throw;
  }
  if (leader_ != nullptr) leader_->rest();
  std::exception_ptr lost;  // a checkpoint that can't be written takes no picture with it
  try {
    if (!a_.checkpoint.empty()) saveCheckpoint(session, frame);
  } catch (const Error&) {
    lost = std::current_exception();
  }
  save(session, view, true);
  if (lost) std::rethrow_exception(lost);
  if (!a_.trace.empty()) saveTrace(session, view);
}

/// Of several pictures the last one's is what stays.
void Capture::saveTrace(const Session& session, const View& view) const {
  if (session.traffic() == nullptr) {
    logWarning("--trace {}: not written, no path waited for pages: they fit in memory", a_.trace);
    return;
  }
  const fs::path path(a_.trace);
  const std::string extension = path.extension().string();
  if (extension != ".svg" && extension != ".html") {
    writeTextAtomically(a_.trace, session.traffic()->chromeTrace());
    return;
  }
  const std::string svg = session.traffic()->svg(
      fmt::format("{}: {} loads of pages", view.output, session.report().traffic.loads));
  writeTextAtomically(a_.trace, extension == ".svg" ? svg
                                                    : "<!doctype html>\n<meta charset=\"utf-8\">\n"
                                                      "<title>trex render</title>\n" +
                                                          svg);
}

/// Runs a session to its goal, or until a signal asks to stop.
void Capture::advance(Session& session, std::uint32_t frame) {
  Progress progress;
  while (!session.goalReached() && interruptedBy() == 0) {
    session.run([&] {
      progress.show(session.progress(), session.samplesDone());
      const bool due = !a_.checkpoint.empty() && secondsNow() >= nextCheckpoint_;
      return interruptedBy() == 0 && !hangupSeen() && !due;
    });
    if (hangupSeen()) {
      clearHangup();
      save(session, views_[frame], false);
      logInfo("{}: saved after {} samples a pixel, going on", views_[frame].output,
              session.samplesDone());
    }
    if (!a_.checkpoint.empty() && secondsNow() >= nextCheckpoint_) tryCheckpoint(session, frame);
  }
}

/// On the timer: a disk that is full now may have room later, and the one before is kept.
void Capture::tryCheckpoint(Session& session, std::uint32_t frame) {
  try {
    saveCheckpoint(session, frame);
  } catch (const Error& e) {
    if (e.code() != ExitCode::kOutput) throw;
    logWarning("{}; going on", e.what());
  }
}

void Capture::saveCheckpoint(Session& session, std::uint32_t frame) {
  nextCheckpoint_ = secondsNow() + a_.checkpointSeconds;
  session.saveCheckpoint(a_.checkpoint, key_, frame);
}

float exposureOf(const RenderArguments& a, const Picture& picture) {
  if (a.exposure == "auto") return autoExposure(picture);
  char* end = nullptr;
  const float stops = std::strtof(a.exposure.c_str(), &end);
  if (end == a.exposure.c_str() || *end != '\0' || !(std::abs(stops) < 100.0f)) {
    fail(ExitCode::kUsage, "--exposure {}: want stops or auto", a.exposure);
  }
  return stops;
}

void Capture::save(Session& session, const View& view, bool report) {
  Picture picture = session.picture();
  addMetadata(picture, a_, view, session, leader_);
  const float exposure = exposureOf(a_, picture);
  writePicture(view.output, picture, toneMapOf(a_, exposure), a_.file);
  if (!report) return;
  const SessionReport r = session.report();
  if (r.nonFinite > 0) {
    const NonFiniteSample first = session.frame().nonFiniteSamples().front();
    logWarning(
        "{} samples were not finite and were dropped; the first: pixel {},{} sample {} seed {}",
        r.nonFinite, first.x, first.y, first.sample, a_.settings.seed);
  }
  if (a_.json) {
    summaries_.push_back(summary(a_, view, session, model_->scene.replaced.count, importSeconds_,
                                 exposure, leader_));
  } else {
    fmt::print("{}\n", view.output);
    std::fflush(stdout);
  }
  if (!r.denoiseProblem.empty()) {
    if (a_.settings.denoise == Denoise::kOidn) {
      fail(ExitCode::kMemoryOrDevice, "{}: saved, but by the filter instead: {}", view.output,
           r.denoiseProblem);
    }
    logWarning("{}: by the filter instead: {}", view.output, r.denoiseProblem);
  }
  logInfo("{} samples a pixel in {:.2f} s on {}", r.samplesDone, r.renderSeconds + r.filterSeconds,
          r.device == "none" ? "the CPU alone" : r.device);
}

}  // namespace trex
