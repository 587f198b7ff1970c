#include "src/app/view/replay_runner.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "src/command/interrupt.h"
#include "src/core/clock.h"
#include "src/core/error.h"
#include "src/frame/flip.h"
#include "src/frame/image_file.h"

namespace trex {
namespace {

/// Seconds after which a wait has failed.
constexpr double kPatience = 600.0;
/// A picture is kept for comparison if it came this much later than the last one.
constexpr double kKeepEvery = 1.1;
constexpr double kTolerance = 1.2;  ///< of the budget

ColorImage linear(const ScreenImage& screen, const std::vector<std::uint8_t>& rgba) {
  ColorImage image{screen.width, screen.height, {}};
  image.pixels.reserve(rgba.size() / 4);
  for (std::size_t i = 0; i + 3 < rgba.size(); i += 4) {
    image.pixels.emplace_back(decodeSrgb8(rgba[i]), decodeSrgb8(rgba[i + 1]),
                              decodeSrgb8(rgba[i + 2]));
  }
  return image;
}

double shareWithin(const std::vector<double>& seconds, double limit) {
  if (seconds.empty()) return 1.0;
  const auto within =
      std::count_if(seconds.begin(), seconds.end(), [&](double s) { return s <= limit; });
  return static_cast<double>(within) / static_cast<double>(seconds.size());
}

double most(const std::vector<double>& seconds) {
  return seconds.empty() ? 0.0 : *std::max_element(seconds.begin(), seconds.end());
}

void writeShown(const ScreenImage& shown, const std::filesystem::path& path) {
  Picture picture;
  picture.width = shown.width;
  picture.height = shown.height;
  picture.channels = {"R", "G", "B"};
  for (std::size_t i = 0; i + 3 < shown.rgba.size(); i += 4) {
    for (std::size_t c = 0; c < 3; ++c) picture.values.push_back(decodeSrgb8(shown.rgba[i + c]));
  }
  writePicture(path, picture, ToneMap{});
}

Panel panelNamed(const std::string& name) {
  constexpr const char* kNames[] = {"camera", "materials", "lights", "objects",
                                    "view",   "section",   "edits",  "status"};
  for (std::size_t i = 0; i < std::size(kNames); ++i) {
    if (name == kNames[i]) return static_cast<Panel>(i);
  }
  fail(ExitCode::kInput, "replay: there is no panel '{}'", name);
}

}  // namespace

ReplayRunner::ReplayRunner(const ReplayScript& script, ViewLoop& loop, Viewer& viewer,
                           Window& window, Ui& ui, double budgetSeconds, Clock::time_point started)
    : script_(script),
      loop_(loop),
      viewer_(viewer),
      window_(window),
      ui_(ui),
      budget_(budgetSeconds),
      started_(started) {}

/// Packed bytes of pages that were read so far, of a streamed bundle.
std::uint64_t ReplayRunner::pageBytes() const { return viewer_.figures().session.pages.bytesRead; }

double ReplayRunner::now() const {
  return std::chrono::duration<double>(Clock::now() - started_).count();
}

int ReplayRunner::run() {
  catchInterrupts();
  opened_ = 0.0;
  try {
    for (const ReplayStep& each : script_.steps) {
      for (std::uint32_t i = 0; i < each.repeat; ++i) step(each);
      if (each.close) break;
    }
  } catch (const Stop& stop) {
    return stop.code;
  }
  return 0;
}

void ReplayRunner::step(const ReplayStep& s) {
  turns_ = {};
  entry_ = {{"label", s.label}};
  const double begun = now(), used = processorSeconds();
  const std::uint64_t bytes = pageBytes();
  await(s.wait);
  prepare(s);
  const double start = now();
  const std::uint64_t before = pageBytes();
  if (edit(s)) {
    awaitCoarse(start);
    entry_["first_coarse_page_bytes"] = pageBytes() - before;
  }
  if (s.settle > 0.0) settle(s, start);
  goOn(s);
  if (s.idle > 0.0) measureIdle(s.idle);
  save(s);
  entry_["seconds"] = now() - begun;
  entry_["processor_seconds"] = processorSeconds() - used;
  const ViewerFigures f = viewer_.figures();
  entry_["page_bytes"] = f.session.pages.bytesRead - std::min(bytes, f.session.pages.bytesRead);
  entry_["samples_per_pixel"] = f.samplesPerPixel;
  entry_["estimated_distance"] = f.truthDistance;
  entry_["resident_bytes"] = f.residentBytes;
  entry_["turns"] = figures(turns_);
  entries_.push_back(entry_);
}

/// What changes no sample, or starts all over.
void ReplayRunner::prepare(const ReplayStep& s) {
  if (s.width) window_.setSize(*s.width, *s.height);
  if (s.minimise) window_.minimise();
  if (s.restore) window_.restore();
  if (s.ui) ui_.hidden = !*s.ui;
  if (!s.panel.empty()) ui_.panel = panelNamed(s.panel);
  ViewState& state = viewer_.state();
  if (s.mode) state.mode = *s.mode;
  if (s.voxelLevel) state.voxelLevel = *s.voxelLevel;
  if (s.split) state.split = *s.split;
  if (s.splitAt) state.splitAt = *s.splitAt;
  if (s.paused) state.paused = *s.paused;
  if (!s.open.empty()) {
    ui_.open(s.open);
    opened_ = now();
    shownAt_.reset();
    readyAt_.reset();
  }
  loop_.drawNext();
  if (!s.pick) return;
  ui_.pickAt(*s.pick);
  if (!ui_.picked) return;
  entry_["picked_object"] = viewer_.scene().objects[ui_.picked->object];
  entry_["picked_material"] = viewer_.look().materials[ui_.picked->material].name;
}

/// True if a new picture must follow.
bool ReplayRunner::edit(const ReplayStep& s) {
  if (!ui_.shows()) {
    if (!s.edits()) return false;
    await(ReplayWait::kShown);
  }
  ui_.follow();
  const Look before = viewer_.look();
  if (!s.loadEdits.empty()) viewer_.loadEdits(s.loadEdits);
  for (int i = 0; i < s.undo; ++i) viewer_.undo();
  for (int i = 0; i < s.redo; ++i) viewer_.redo();
  ui_.follow();
  if (s.edits()) {
    Look look = viewer_.look();
    applyReplay(s, {viewer_.scene(), viewer_.sourceLook(), viewer_.bounds(), double(ui_.aspect())},
                *ui_.camera, look);
    const Look& now = viewer_.look();
    const bool view = look.materials == now.materials && look.lights == now.lights &&
                      look.environment == now.environment && look.hidden == now.hidden &&
                      look.section == now.section;
    viewer_.edit(look, !view, s.label);
  }
  return invalidatedBy(before, viewer_.look()).frame;
}

Turn ReplayRunner::turn(bool maySleep) {
  const Turn turn = loop_.turn(maySleep);
  if (interruptedBy() != 0) throw Stop{128 + interruptedBy()};
  // The viewer has said why.
  if (viewer_.problem()) throw Stop{static_cast<int>(*viewer_.problem())};
  const double at = now() - opened_.value_or(0.0);
  if (!shownAt_ && turn.presented && turn.step.coarseComplete) shownAt_ = at;
  if (!readyAt_ && viewer_.phase() == OpenPhase::kReady) readyAt_ = at;
  if (turn.step.kind == StepReport::Kind::kIdle) return turn;
  const std::uint32_t longestWait = viewer_.figures().longestWait;
  for (Turns* turns : {&turns_, &allTurns_}) {
    turns->longestWait = std::max(turns->longestWait, longestWait);
    turns->frames.push_back(turn.seconds);
    turns->steps.push_back(turn.step.seconds);
  }
  return turn;
}

template <typename Condition>
void ReplayRunner::turnUntil(const char* what, const Condition& condition) {
  const double start = now();
  while (!condition(turn(true))) {
    if (now() - start > kPatience) {
      fail(ExitCode::kFailed, "replay: waited {} s for {} in vain", kPatience, what);
    }
  }
}

void ReplayRunner::awaitCoarse(double start) {
  turnUntil("the first coarse frame",
            [](const Turn& t) { return t.presented && t.step.coarseComplete; });
  entry_["first_coarse_ms"] = 1e3 * (now() - start);
  shown_.clear();
  keep(start);
}

void ReplayRunner::keep(double start) {
  const double at = now() - start;
  if (!shown_.empty() && at < kKeepEvery * shown_.back().seconds) return;
  shown_.push_back({at, viewer_.screen().rgba});
}

/// Compares what was shown on the way with what is shown in the end.
void ReplayRunner::settle(const ReplayStep& s, double start) {
  turnUntil("the picture to settle", [&](const Turn& t) {
    if (t.presented && t.step.newPicture) keep(start);
    return now() - start >= s.settle || viewer_.idle();
  });
  const ColorImage settled = linear(viewer_.screen(), viewer_.screen().rgba);
  double below10 = -1.0, below5 = -1.0;
  for (auto shown = shown_.rbegin(); shown != shown_.rend(); ++shown) {
    if (shown->rgba.size() != viewer_.screen().rgba.size()) break;
    const double flip =
        meanError(flipMap(settled, linear(viewer_.screen(), shown->rgba), kFlipPixelsPerDegree));
    if (flip > 0.1) break;
    below10 = shown->seconds;
    if (flip <= 0.05 && (below5 < 0.0 || below5 > shown->seconds)) below5 = shown->seconds;
  }
  if (below10 >= 0.0) entry_["flip_0_10_ms"] = 1e3 * below10;
  if (below5 >= 0.0) entry_["flip_0_05_ms"] = 1e3 * below5;
  shown_.clear();
}

void ReplayRunner::goOn(const ReplayStep& s) {
  for (std::uint32_t i = 0; i < s.frames; ++i) {
    loop_.drawNext();
    turn(false);
  }
  const double start = now();
  if (s.seconds > 0.0) {
    turnUntil("the seconds", [&](const Turn&) { return now() - start >= s.seconds; });
  }
  if (s.samples > 0.0) {
    turnUntil("the samples",
              [&](const Turn&) { return viewer_.figures().samplesPerPixel >= s.samples; });
  }
}

void ReplayRunner::await(ReplayWait wait) {
  if (wait == ReplayWait::kShown) {
    turnUntil("the first picture", [&](const Turn&) { return shownAt_.has_value(); });
  } else if (wait == ReplayWait::kReady) {
    turnUntil("the model to be ready", [&](const Turn&) {
      return shownAt_.has_value() && viewer_.phase() == OpenPhase::kReady;
    });
  } else if (wait == ReplayWait::kMachines) {
    turnUntil("the other machines", [&](const Turn&) {
      const ViewerFigures f = viewer_.figures();
      return shownAt_.has_value() && f.readyMachines == f.machines;
    });
  } else if (wait == ReplayWait::kIdle) {
    turnUntil("the picture to be done", [&](const Turn&) { return viewer_.idle(); });
  }
}

void ReplayRunner::measureIdle(double seconds) {
  await(ReplayWait::kIdle);
  const double start = now(), used = processorSeconds();
  turnUntil("the idle seconds", [&](const Turn&) { return now() - start >= seconds; });
  entry_["idle_core_share"] = (processorSeconds() - used) / (now() - start);
}

void ReplayRunner::save(const ReplayStep& s) {
  if (!s.screenshot.empty()) {
    // Twice: panels take a frame to settle. The viewer does not go on meanwhile.
    loop_.drawOnly();
    window_.keepNextFrame();
    loop_.drawOnly();
    writeShown(window_.shown(), s.screenshot);
  }
  if (!s.save.empty()) viewer_.savePicture(s.save);
  if (!s.saveEdits.empty()) viewer_.saveEdits(s.saveEdits);
}

nlohmann::ordered_json ReplayRunner::figures(const Turns& turns) const {
  const double limit = kTolerance * budget_;
  return {{"count", turns.frames.size()},
          {"frames_within_budget", shareWithin(turns.frames, limit)},
          {"steps_within_budget", shareWithin(turns.steps, limit)},
          {"longest_frame_ms", 1e3 * most(turns.frames)},
          {"longest_step_ms", 1e3 * most(turns.steps)},
          {"longest_tile_wait_frames", turns.longestWait}};
}

nlohmann::ordered_json ReplayRunner::report() const {
  nlohmann::ordered_json open;
  if (shownAt_) open["first_coarse_ms"] = 1e3 * *shownAt_;
  if (readyAt_) open["ready_ms"] = 1e3 * *readyAt_;
  const ViewerFigures f = viewer_.figures();
  return {{"trex", 1},
          {"input", viewer_.input().string()},
          {"size", fmt::format("{}x{}", viewer_.screen().width, viewer_.screen().height)},
          {"budget_ms", 1e3 * budget_},
          {"device", f.device},
          {"window_device", window_.deviceName()},
          {"open", open},
          {"turns", figures(allTurns_)},
          {"steps", entries_}};
}

}  // namespace trex
