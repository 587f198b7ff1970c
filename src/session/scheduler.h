// Which pixels get their next sample: plain data from plain data, no rays and no clocks.
//
//   kSweep       captures: every tile one more sample, from the centre outwards
//   kPerception  the viewer: first a coarse frame of every tile (1, 4, ... 16 cells of the lattice
//                of frame/lattice.h). If looks are asked for: after 1 cell at every second pixel,
//                after 4 at the others, then once more at edges and textures; after 16 the rest of
//                these. Then the tile where one more sample gains most: near the pointer, noisy or
//                rich in contrast, with few samples. A share of each frame goes to the tiles served
//                longest ago, so that none waits longer than kMostFrames.
//
// No tile passes the barrier before all have reached it: the light may change there.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "src/core/maths.h"
#include "src/frame/tiles.h"

namespace trex {

/// Cells [firstCell, endCell) of a tile get sample number `sample`, or are looked at; from the
/// second look on, those of them where that tells more.
struct TileUnit {
  std::uint32_t tile = 0, sample = 0, firstCell = 0, endCell = 0;
  bool look = false;
};

/// What a tile has so far: `sample` whole samples and `cells` cells of the next one.
struct TileState {
  std::uint32_t sample = 0, cells = 0;
  std::uint32_t served = 0;     ///< frame in which it last got anything
  float error = 1.0f;           ///< of noise and contrast as it is now, relative
  std::uint8_t looks = 0;       ///< rounds of them: see TileScheduler::setLooks()
  std::uint32_t lookFrame = 0;  ///< frame of the last one
  bool lent = false;            ///< its next sample is taken elsewhere: TileScheduler::lend()
  bool lentCoarse = false;      ///< likewise a level of its coarse frame: lendCoarse()
  std::uint64_t pages = 0;      ///< it gets nothing before so many have come: putBack()
  std::uint32_t tries = 0;      ///< that a page was missing in since a unit was whole
  double progress() const { return sample + cells / 64.0; }
};

class TileScheduler {
 public:
  enum class Order : std::uint8_t { kSweep, kPerception };
  static constexpr std::uint32_t kMostFrames = 16;

  /// `tiles` in the order of a sweep.
  TileScheduler(std::vector<Tile> tiles, Order order, std::uint32_t width, std::uint32_t height);

  /// Every tile starts anew, but for looks that those of `other` have, if it isn't null.
  void restart(const TileScheduler* other = nullptr);
  /// Goes on with a sweep: `samples` whole samples of all tiles and one more of the first `tiles`.
  void restore(std::uint32_t samples, std::uint32_t tiles);
  /// No tile gets this sample or a later one.
  void setBarrier(std::uint32_t sample) { barrier_ = sample; }
  std::uint32_t barrier() const { return barrier_; }

  /// A frame of the screen begins: tiles near `pointer` (share of width and height) come first, and
  /// a unit has about `unitPixels` pixels.
  void beginFrame(vec2 pointer, std::uint32_t unitPixels);
  /// What to do next; it counts as done. Nothing if every tile stands at the barrier.
  std::optional<TileUnit> next();
  void setError(std::uint32_t tile, float error) { states_[tile].error = error; }

  // Units that need pages of a mesh which are not there yet, of the viewer's tiles.

  /// The last unit that next() gave of a tile and that was not put back did not come to anything:
  /// it is next again once so many `pages` have come.
  void putBack(const TileUnit& unit, std::uint64_t pages);
  /// It did.
  void wasWhole(std::uint32_t tile) { states_[tile].tries = 0; }
  /// Pages that have come so far.
  void setPages(std::uint64_t pages);
  /// Pages that some tile waits for; 0: none does.
  std::uint64_t pagesAwaited() const;

  // Samples that are taken elsewhere, of the viewer's tiles.

  /// What is left of the next sample of a tile, where that gains most; of the first one what comes
  /// after the coarse frame. Until it comes back or is released the tile gets nothing else but the
  /// coarse frame and looks. Nothing if no tile is left.
  std::optional<TileUnit> lend();
  /// The next level of the coarse frame of a tile that lacks pages, lent or not; until it is back
  /// the tile gets looks alone. Nothing if there is no such tile.
  std::optional<TileUnit> lendCoarse();
  /// Tiles of which it could be.
  std::uint32_t coarseTilesToLend() const;
  /// Whether a tile has all that comes before such a unit.
  bool isReadyFor(const TileUnit& unit) const;
  /// A unit that was lent is in the sums; or, of a sweep, the next one.
  void cameBack(const TileUnit& unit);
  /// A unit will not come back.
  void release(const TileUnit& unit);
  void releaseAll();
  /// Tiles that may get samples here.
  std::uint32_t freeTiles() const;

  /// So many looks at a pixel; 0: none. The first round of a tile is at every second pixel of every
  /// second row, the next at the others, those after that a further look each where it tells more.
  void setLooks(std::uint32_t most) { looks_ = most == 0 ? 0 : most + 1; }

  const std::vector<Tile>& tiles() const { return tiles_; }
  const TileState& state(std::uint32_t tile) const { return states_[tile]; }
  /// Number of the tile that holds pixel (x, y).
  std::uint32_t tileAt(std::uint32_t x, std::uint32_t y) const {
    return grid_[std::size_t{y / side_} * columns_ + x / side_];
  }
  /// Spacing of the pixels that have a sample around (x, y); 0: none has.
  std::uint32_t spacingAt(std::uint32_t x, std::uint32_t y) const;
  /// Whether a pixel has a sample.
  bool sampled(std::uint32_t x, std::uint32_t y) const;
  /// Spacing of the pixels that have been looked at in every tile: 2, 1; 0: none has.
  std::uint32_t lookSpacing() const;
  /// Samples that every tile has whole.
  std::uint32_t samplesDone() const;
  /// Tiles of a sweep that have one more.
  std::uint32_t tilesDone() const { return sweepTile_; }
  /// Cells of the first sample that every tile has; 64 once all have it whole.
  std::uint32_t coarseCells() const;
  bool atBarrier() const { return samplesDone() >= barrier_; }
  /// Frames since the tile that has waited longest was served, of those neither at the barrier nor
  /// without pages that they need.
  std::uint32_t longestWait() const;
  /// Mean number of samples a tile has.
  double meanProgress() const;

 private:
  TileUnit take(std::uint32_t tile, std::uint32_t endCell);
  std::optional<TileUnit> nextOfSweep();
  std::optional<TileUnit> nextCoarse();
  std::optional<TileUnit> nextLook(std::uint8_t round);
  std::optional<TileUnit> nextLookAgain(std::uint32_t rounds);
  std::optional<TileUnit> nextStarved();
  std::optional<TileUnit> nextBest();
  double gain(std::uint32_t tile) const;
  std::uint32_t unitEnd(std::uint32_t tile) const;
  bool waits(std::uint32_t tile) const {
    return states_[tile].sample >= barrier_ || states_[tile].lent;
  }
  bool lacksPages(std::uint32_t tile) const { return states_[tile].pages > pages_; }
  bool lacksCoarse(std::uint32_t tile) const;
  bool canGoOn(std::uint32_t tile) const {
    return !waits(tile) && !lacksPages(tile) && !states_[tile].lentCoarse;
  }

  std::vector<Tile> tiles_;
  Order order_;
  float width_, height_;
  std::vector<TileState> states_;
  std::vector<float> closeness_;          ///< to the pointer, by tile, (0, 1]
  std::uint32_t side_ = 1, columns_ = 1;  ///< of a tile in pixels; tiles in a row
  std::vector<std::uint32_t> grid_;       ///< tiles by place, row by row
  std::vector<std::uint32_t> nearest_;    ///< tiles, those near the pointer first
  std::uint32_t barrier_ = 0xffffffffu;
  std::uint32_t sweepSample_ = 0, sweepTile_ = 0;  ///< of a sweep: what comes next
  std::uint32_t coarse_ = 1, coarseNext_ = 0;      ///< level under way, place in nearest_
  std::uint32_t looks_ = 0;
  std::uint32_t frame_ = 0, starvedLeft_ = 0, unitPixels_ = 4096;
  std::uint64_t pages_ = 0;  ///< that have come
};

}  // namespace trex
