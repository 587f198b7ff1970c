#include "src/session/scheduler.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "src/frame/lattice.h"

namespace trex {

using lattice::kCells;

namespace {

/// The coarse frame fills 1, 4, 8, 12, 16 cells: small passes, so that no tile waits long.
constexpr std::uint32_t kCoarse = 16;
std::uint32_t nextLevel(std::uint32_t level) { return level + (level < 4 ? 3 : 4); }
/// Of those that are lent: others end with their sample.
bool isCoarse(const TileUnit& unit) { return unit.sample == 0 && unit.endCell <= kCoarse; }
/// Cells after which every second pixel is looked at, and the others: what there is then of light
/// is worth showing with sharper edges than its own.
constexpr std::uint8_t kFirstRounds = 2;
constexpr std::uint32_t kLookedAfter[kFirstRounds] = {1, 4};
constexpr std::uint32_t kLookCells[kFirstRounds + 1] = {0, 16, kCells};

}  // namespace

TileScheduler::TileScheduler(std::vector<Tile> tiles, Order order, std::uint32_t width,
                             std::uint32_t height)
    : tiles_(std::move(tiles)),
      order_(order),
      width_(static_cast<float>(width)),
      height_(static_cast<float>(height)),
      states_(tiles_.size()),
      closeness_(tiles_.size(), 1.0f),
      nearest_(tiles_.size()) {
  std::iota(nearest_.begin(), nearest_.end(), 0u);
  for (const Tile& t : tiles_) side_ = std::max({side_, t.width, t.height});
  columns_ = (width + side_ - 1) / side_;
  grid_.resize(std::size_t{columns_} * ((height + side_ - 1) / side_));
  for (std::uint32_t i = 0; i < tiles_.size(); ++i) {
    grid_[std::size_t{tiles_[i].y / side_} * columns_ + tiles_[i].x / side_] = i;
  }
}

std::uint32_t TileScheduler::spacingAt(std::uint32_t x, std::uint32_t y) const {
  const TileState& s = states_[tileAt(x, y)];
  return s.sample > 0 ? 1 : lattice::spacing(s.cells);
}

bool TileScheduler::sampled(std::uint32_t x, std::uint32_t y) const {
  const TileState& s = states_[tileAt(x, y)];
  return s.sample > 0 || lattice::cellAt(x, y) < s.cells;
}

std::uint32_t TileScheduler::lookSpacing() const {
  std::uint8_t least = kFirstRounds;
  for (const TileState& s : states_) least = std::min(least, s.looks);
  return least == 0 ? 0 : least < kFirstRounds ? 2 : 1;
}

void TileScheduler::restart(const TileScheduler* other) {
  for (std::size_t i = 0; i < states_.size(); ++i) {
    const std::uint8_t looks = other != nullptr ? other->states_[i].looks : std::uint8_t{0};
    states_[i] = {.served = frame_, .looks = looks};
  }
  sweepSample_ = sweepTile_ = coarseNext_ = 0;
  coarse_ = 1;
}

void TileScheduler::restore(std::uint32_t samples, std::uint32_t tiles) {
  for (std::uint32_t i = 0; i < states_.size(); ++i) {
    states_[i].sample = samples + (i < tiles ? 1 : 0);
    states_[i].cells = 0;
  }
  sweepSample_ = samples;
  sweepTile_ = tiles;
}

std::uint32_t TileScheduler::samplesDone() const {
  if (order_ == Order::kSweep) return sweepSample_;
  std::uint32_t least = barrier_;
  for (const TileState& s : states_) least = std::min(least, s.sample);
  return least;
}

std::uint32_t TileScheduler::coarseCells() const {
  std::uint32_t least = kCells;
  for (const TileState& s : states_) least = std::min(least, s.sample > 0 ? kCells : s.cells);
  return least;
}

std::uint32_t TileScheduler::longestWait() const {
  std::uint32_t longest = 0;
  for (std::uint32_t i = 0; i < states_.size(); ++i) {
    if (canGoOn(i)) longest = std::max(longest, frame_ - states_[i].served);
  }
  return longest;
}

double TileScheduler::meanProgress() const {
  double sum = 0.0;
  for (const TileState& s : states_) sum += s.progress();
  return sum / static_cast<double>(states_.size());
}

void TileScheduler::beginFrame(vec2 pointer, std::uint32_t unitPixels) {
  ++frame_;
  unitPixels_ = unitPixels;
  const vec2 at(pointer.x * width_, pointer.y * height_);
  const float diagonal = std::hypot(width_, height_);
  for (std::size_t i = 0; i < tiles_.size(); ++i) {
    const Tile& t = tiles_[i];
    const vec2 centre(static_cast<float>(t.x) + 0.5f * static_cast<float>(t.width),
                      static_cast<float>(t.y) + 0.5f * static_cast<float>(t.height));
    closeness_[i] = 0.1f + 0.9f * std::exp(-5.0f * glm::length(centre - at) / diagonal);
  }
  std::stable_sort(nearest_.begin(), nearest_.end(),
                   [&](std::uint32_t a, std::uint32_t b) { return closeness_[a] > closeness_[b]; });
  // Twice what keeps the promise: a frame may end before its share is done.
  coarseNext_ = 0;
  const auto count = static_cast<std::uint32_t>(tiles_.size());
  starvedLeft_ = 2 * ((count + kMostFrames - 1) / kMostFrames);
}

std::optional<TileUnit> TileScheduler::next() {
  if (order_ == Order::kSweep) return nextOfSweep();
  if (auto unit = nextCoarse()) return unit;
  if (auto unit = nextLookAgain(looks_)) return unit;
  if (auto unit = nextStarved()) return unit;
  return nextBest();
}

std::optional<TileUnit> TileScheduler::nextOfSweep() {
  if (sweepSample_ >= barrier_) return {};
  const TileUnit unit = take(sweepTile_, kCells);
  if (++sweepTile_ == tiles_.size()) {
    sweepTile_ = 0;
    ++sweepSample_;
  }
  return unit;
}

TileUnit TileScheduler::take(std::uint32_t tile, std::uint32_t endCell) {
  TileState& s = states_[tile];
  const TileUnit unit{tile, s.sample, s.cells, endCell};
  s.cells = endCell;
  s.served = frame_;
  if (s.cells == kCells) {
    s.cells = 0;
    ++s.sample;
  }
  return unit;
}

/// Levels of the coarse frame, each of every tile before the next.
std::optional<TileUnit> TileScheduler::nextCoarse() {
  if (barrier_ == 0) return {};
  for (; coarse_ <= kCoarse; coarse_ = nextLevel(coarse_), coarseNext_ = 0) {
    for (; coarseNext_ < nearest_.size(); ++coarseNext_) {
      const std::uint32_t i = nearest_[coarseNext_];
      if (lacksPages(i) || states_[i].lentCoarse) continue;
      if (states_[i].sample == 0 && states_[i].cells < coarse_) return take(i, coarse_);
    }
    for (std::uint8_t round = 0; round < kFirstRounds; ++round) {
      if (coarse_ != kLookedAfter[round]) continue;
      if (auto look = nextLook(round)) return look;
    }
    // One round of further looks is worth more than the rest of the coarse frame, all are not.
    if (auto look = nextLookAgain(kFirstRounds + 1)) return look;
  }
  return {};
}

/// Tiles that have had so many rounds of looks, of the first two.
std::optional<TileUnit> TileScheduler::nextLook(std::uint8_t round) {
  if (looks_ == 0) return {};
  for (const std::uint32_t i : nearest_) {
    TileState& s = states_[i];
    if (s.looks != round || lacksPages(i)) continue;
    ++s.looks;
    s.lookFrame = frame_;
    return TileUnit{
        .tile = i, .firstCell = kLookCells[round], .endCell = kLookCells[round + 1], .look = true};
  }
  return {};
}

/// Round after round. What a tile showed is known in the frame after its last one.
std::optional<TileUnit> TileScheduler::nextLookAgain(std::uint32_t rounds) {
  rounds = std::min(rounds, looks_);
  std::optional<std::uint32_t> next;
  for (const std::uint32_t i : nearest_) {
    const TileState& s = states_[i];
    if (s.looks < kFirstRounds || s.looks >= rounds || s.lookFrame == frame_ || lacksPages(i)) {
      continue;
    }
    if (!next || s.looks < states_[*next].looks) next = i;
  }
  if (!next) return {};
  TileState& s = states_[*next];
  s.lookFrame = frame_;
  const std::uint32_t number = s.looks++ - kFirstRounds + 1u;
  return TileUnit{.tile = *next, .sample = number, .endCell = kCells, .look = true};
}

std::optional<TileUnit> TileScheduler::nextStarved() {
  if (starvedLeft_ == 0) return {};
  --starvedLeft_;
  std::optional<std::uint32_t> oldest;
  for (std::uint32_t i = 0; i < states_.size(); ++i) {
    if (!canGoOn(i) || states_[i].served == frame_) continue;
    if (!oldest || states_[i].served < states_[*oldest].served) oldest = i;
  }
  if (!oldest) return {};
  return take(*oldest, unitEnd(*oldest));
}

std::optional<TileUnit> TileScheduler::nextBest() {
  std::optional<std::uint32_t> best;
  double most = -1.0;
  for (std::uint32_t i = 0; i < states_.size(); ++i) {
    if (!canGoOn(i)) continue;
    const double g = gain(i);
    if (g <= most) continue;
    most = g;
    best = i;
  }
  if (!best) return {};
  return take(*best, unitEnd(*best));
}

void TileScheduler::putBack(const TileUnit& unit, std::uint64_t pages) {
  TileState& s = states_[unit.tile];
  s.pages = std::max(s.pages, pages);
  ++s.tries;
  if (unit.look) {
    --s.looks;
    return;
  }
  s.sample = unit.sample;
  s.cells = unit.firstCell;
}

/// Whoever gets pages may lack levels of the coarse frame, or looks, that others have.
void TileScheduler::setPages(std::uint64_t pages) {
  const auto comes = [&](const TileState& s) { return s.pages > pages_ && s.pages <= pages; };
  if (std::any_of(states_.begin(), states_.end(), comes)) {
    coarse_ = 1;
    coarseNext_ = 0;
  }
  pages_ = pages;
}

std::uint64_t TileScheduler::pagesAwaited() const {
  std::uint64_t least = 0;
  for (const TileState& s : states_) {
    if (s.pages > pages_ && (least == 0 || s.pages < least)) least = s.pages;
  }
  return least;
}

std::optional<TileUnit> TileScheduler::lend() {
  std::optional<std::uint32_t> best;
  double most = -1.0;
  for (const std::uint32_t i : nearest_) {
    if (waits(i)) continue;
    // Holes first, in the order of the coarse frame.
    const double g = states_[i].sample == 0 ? kInfinity : gain(i);
    if (g <= most) continue;
    most = g;
    best = i;
  }
  if (!best) return {};
  TileState& s = states_[*best];
  s.lent = true;
  const std::uint32_t first = s.sample == 0 ? std::max(s.cells, kCoarse) : s.cells;
  return TileUnit{.tile = *best, .sample = s.sample, .firstCell = first, .endCell = kCells};
}

/// Of the coarse frame, for want of pages.
bool TileScheduler::lacksCoarse(std::uint32_t tile) const {
  const TileState& s = states_[tile];
  return lacksPages(tile) && !s.lentCoarse && barrier_ > 0 && s.sample == 0 && s.cells < kCoarse;
}

std::uint32_t TileScheduler::coarseTilesToLend() const {
  std::uint32_t count = 0;
  for (std::uint32_t i = 0; i < states_.size(); ++i) count += lacksCoarse(i) ? 1 : 0;
  return count;
}

std::optional<TileUnit> TileScheduler::lendCoarse() {
  std::optional<std::uint32_t> next;
  for (const std::uint32_t i : nearest_) {
    if (lacksCoarse(i) && (!next || states_[i].cells < states_[*next].cells)) next = i;
  }
  if (!next) return {};
  TileState& s = states_[*next];
  s.lentCoarse = true;
  std::uint32_t level = 1;
  while (level <= s.cells) level = nextLevel(level);
  return TileUnit{.tile = *next, .sample = 0, .firstCell = s.cells, .endCell = level};
}

/// Levels of the coarse frame that such a tile has missed are looked for anew.
void TileScheduler::release(const TileUnit& unit) {
  TileState& s = states_[unit.tile];
  if (!isCoarse(unit)) {
    s.lent = false;
    return;
  }
  s.lentCoarse = false;
  coarse_ = 1;
  coarseNext_ = 0;
}

bool TileScheduler::isReadyFor(const TileUnit& unit) const {
  const TileState& s = states_[unit.tile];
  const bool lent = isCoarse(unit) ? s.lentCoarse : s.lent;
  return lent && s.sample == unit.sample && s.cells == unit.firstCell;
}

void TileScheduler::cameBack(const TileUnit& unit) {
  if (order_ == Order::kSweep) {
    next();
    return;
  }
  take(unit.tile, unit.endCell);
  release(unit);
}

void TileScheduler::releaseAll() {
  for (TileState& s : states_) s.lent = s.lentCoarse = false;
  coarse_ = 1;
  coarseNext_ = 0;
}

std::uint32_t TileScheduler::freeTiles() const {
  std::uint32_t count = 0;
  for (std::uint32_t i = 0; i < states_.size(); ++i) count += waits(i) ? 0 : 1;
  return count;
}

/// What one more sample takes off the tile's error, weighed by how near the viewer looks.
double TileScheduler::gain(std::uint32_t tile) const {
  const TileState& s = states_[tile];
  const double n = s.progress() + 0.5;
  return (s.error + 1e-6) * closeness_[tile] / n;
}

std::uint32_t TileScheduler::unitEnd(std::uint32_t tile) const {
  const Tile& t = tiles_[tile];
  const std::uint32_t pixels = t.width * t.height;
  const std::uint32_t cells = std::max(1u, unitPixels_ * kCells / std::max(pixels, 1u));
  return std::min(kCells, states_[tile].cells + cells);
}

}  // namespace trex
