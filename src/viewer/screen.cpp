#include "src/viewer/screen.h"

#include <algorithm>
#include <cmath>

#include "src/frame/lattice.h"
#include "src/viewer/inspect.h"
#include "src/viewer/screen_picture.h"

namespace trex {
namespace {

constexpr double kMixedFrom = 0.6;         // samples a pixel
constexpr std::uint32_t kSpreadBelow = 4;  // samples, from which on a pixel's own tell enough
constexpr double kRefreshGrowth = 1.25;    // of samples, before the whole frame is filtered again

/// Value of every pixel of the frame's lattice, stretched over the picture.
template <typename Value>
std::vector<vec3> latticeValues(const FrameBuffers& frame, std::uint32_t width,
                                std::uint32_t height, std::uint32_t spacing, const Value& value) {
  const std::uint32_t columns = (width + spacing - 1) / spacing,
                      rows = (height + spacing - 1) / spacing;
  std::vector<vec3> out;
  out.reserve(std::size_t{columns} * rows);
  for (std::uint32_t y = 0; y < rows; ++y) {
    for (std::uint32_t x = 0; x < columns; ++x)
      out.push_back(value(frame, x * spacing, y * spacing));
  }
  return stretch(out, width, height, spacing, true);
}

double progressOf(const FrameBuffers& frame) { return frame.tiles.meanProgress(); }

}  // namespace

void Screen::restart(bool hold) {
  dropJob();
  hold_ = hold;
  if (!hold) shown_ = false;
  spacing_ = 0;
  spread_ = false;
  progress_ = exactProgress_ = 0.0;
  inspectedCells_ = 0;
}

bool Screen::update(const Session& session, const Session* exact, const Look& look,
                    const ViewState& state, const std::function<double()>& left) {
  if (state.mode != painted_.mode || state.voxelLevel != painted_.voxelLevel) {
    dropJob();
    spacing_ = 0;
    progress_ = 0.0;
    inspectedCells_ = 0;
    hold_ = shown_ = false;
    linear_.clear();  // of another view
  }
  bool changed = false;
  if (state.mode == ViewMode::kBeauty) {
    changed = beauty(session, left);
  } else if (state.mode == ViewMode::kVoxels || state.mode == ViewMode::kPhotons) {
    changed = inspect(session, state, [&] { return left() > 0.0; });
  } else {
    changed = values(session, state);
  }
  const bool exactNews =
      exact != nullptr && state.split && progressOf(exact->shownFrame()) != exactProgress_;
  const bool restyled =
      !isPainted_ || exposure_ != look.exposure || painted_.mode != state.mode ||
      painted_.split != state.split || painted_.toneOperator != state.toneOperator ||
      painted_.splitAt != state.splitAt || painted_.selectedObject != state.selectedObject;
  if (linear_.size() != std::size_t{session.frame().width()} * session.frame().height()) {
    return false;
  }
  if (!changed && !exactNews && !restyled) return false;
  const double before = left();
  paint(session, exact, look, state);
  if (changed) finishSeconds_ += 0.25 * (finishing_ + before - left() - finishSeconds_);
  return true;
}

void Screen::prepare(const Session& session, const ViewState& state) {
  if (state.mode == ViewMode::kBeauty && painted_.mode == state.mode) start(session);
}

void Screen::dropJob() {
  job_.reset();
  ready_ = false;
}

/// Begins the next picture if none is under way and the frame has more to show.
void Screen::start(const Session& session) {
  if (job_) return;
  const FrameBuffers& frame = session.shownFrame();
  const double progress = progressOf(frame);
  ShownOptions options = session.shownOptions();
  std::uint32_t spacing = lattice::spacing(frame.tiles.coarseCells());
  options.shown = frame.tiles.lookSpacing();
  options.spread = options.method == DenoiseMethod::kFilter && frame.looks && options.shown > 0 &&
                   frame.tiles.samplesDone() < kSpreadBelow && !session.resting();
  // Where most tiles have more than every second pixel, all that there is is shown.
  if (!options.spread && spacing == 2 && progress >= kMixedFrom) spacing = 1;
  if (spacing == 0 || (hold_ && spacing > (options.spread ? 4u : 2u))) return;
  const std::uint32_t shown = options.spread ? options.shown : spacing;
  const bool finer = spacing_ == 0 || shown < spacing_ || spacing < lattice_;
  const bool more = shown == 1 && progress > progress_ * kRefreshGrowth;
  // What stays on the screen is what a capture would show.
  const bool all = shown == 1 && (progress != progress_ || (spread_ && !options.spread)) &&
                   (session.resting() || options.method == DenoiseMethod::kOff);
  if (!finer && !more && !all) return;
  options.spacing = spacing;
  options.pairs &= !session.previewing();
  job_.emplace(frame, session.frame().width(), session.frame().height(), options);
  jobSpacing_ = shown;
  jobLattice_ = spacing;
  jobSpread_ = options.spread;
  jobProgress_ = progress;
}

/// Filtered lattices while the first sample is on its way, then the whole frame again and again.
bool Screen::beauty(const Session& session, const std::function<double()>& left) {
  start(session);
  if (!job_) return false;
  if (!ready_) {
    // The first picture of a change is finished in any case: it is small.
    const bool first = !shown_;
    if (!job_->advance([&] { return first || left() > 0.0; })) return false;
    ready_ = true;
    if (!first && left() < finishSeconds_) return false;
  }
  const double before = left();
  linear_ =
      stretch(job_->take(), session.frame().width(), session.frame().height(), jobSpacing_, false);
  dropJob();
  spacing_ = jobSpacing_;
  lattice_ = jobLattice_;
  spread_ = jobSpread_;
  progress_ = jobProgress_;
  shown_ = true;
  hold_ = false;
  finishing_ = before - left();
  return true;
}

bool Screen::values(const Session& session, const ViewState& state) {
  const FrameBuffers& frame = session.shownFrame();
  const std::uint32_t spacing = lattice::spacing(frame.tiles.coarseCells());
  const double progress = progressOf(frame);
  if (spacing == 0 || progress == progress_) return false;
  linear_ = latticeValues(
      frame, session.frame().width(), session.frame().height(), spacing,
      viewOf(state.mode, frame, session.frame().width(), session.frame().height(), spacing));
  spacing_ = spacing;
  progress_ = progress;
  shown_ = true;
  return true;
}

bool Screen::inspect(const Session& session, const ViewState& state,
                     const std::function<bool()>& keepGoing) {
  const std::uint32_t width = session.frame().width(), height = session.frame().height();
  if (inspectedCells_ == 0) linear_.assign(std::size_t{width} * height, vec3(0.0f));
  bool changed = false;
  while (inspectedCells_ < lattice::kCells && (keepGoing() || inspectedCells_ == 0)) {
    inspectCell(session, state, inspectedCells_, linear_);
    ++inspectedCells_;
    changed = true;
  }
  shown_ |= changed;
  return changed;
}

void Screen::paint(const Session& session, const Session* exact, const Look& look,
                   const ViewState& state) {
  image_.width = session.frame().width();
  image_.height = session.frame().height();
  if (state.mode == ViewMode::kBeauty || state.mode == ViewMode::kPhotons) {
    const std::vector<vec3>* shown = &linear_;
    std::vector<vec3> both;
    if (exact != nullptr && state.split && state.mode == ViewMode::kBeauty) {
      both = linear_;
      splitWith(*exact, state.splitAt, both);
      exactProgress_ = progressOf(exact->shownFrame());
      shown = &both;
    }
    toneMapTo(*shown, {look.exposure, state.toneOperator}, image_.rgba);
  } else {
    writeValues(linear_, image_.rgba);
  }
  const FrameBuffers& frame = session.shownFrame();
  const std::uint32_t spacing = lattice::spacing(frame.tiles.coarseCells());
  if (state.selectedObject != kNone && frame.firstHits && spacing > 0) {
    std::vector<std::uint8_t> inside(linear_.size());
    for (std::uint32_t y = 0; y < image_.height; ++y) {
      for (std::uint32_t x = 0; x < image_.width; ++x) {
        const FirstHit& hit = frame.firstHits->at(x / spacing * spacing, y / spacing * spacing);
        inside[std::size_t{y} * image_.width + x] =
            hit.object == static_cast<float>(state.selectedObject);
      }
    }
    highlight(inside, image_.width, image_.height, image_.rgba);
  }
  painted_ = state;
  exposure_ = look.exposure;
  isPainted_ = true;
  ++image_.version;
}

bool Screen::complete(const Session& session, const Session* exact, const ViewState& state) const {
  if (job_ || !shown_) return false;
  if (state.mode == ViewMode::kVoxels || state.mode == ViewMode::kPhotons) {
    return inspectedCells_ == lattice::kCells;
  }
  const bool halves =
      exact == nullptr || !state.split || progressOf(exact->shownFrame()) == exactProgress_;
  return halves && progress_ == progressOf(session.shownFrame()) && !(spread_ && session.resting());
}

}  // namespace trex
