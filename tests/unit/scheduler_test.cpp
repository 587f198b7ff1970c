// The order of samples: nothing twice, nothing left out, nobody waits too long.
#include "src/session/scheduler.h"

#include <gtest/gtest.h>

#include <map>
#include <set>

#include "src/frame/lattice.h"

namespace trex {
namespace {

constexpr std::uint32_t kWidth = 640, kHeight = 360;

TileScheduler make(TileScheduler::Order order, std::uint32_t width = kWidth,
                   std::uint32_t height = kHeight) {
  return {makeTiles(width, height, 64), order, width, height};
}

TEST(Lattice, EveryPlaceOnceAndLevelsAreEven) {
  std::set<std::pair<std::uint32_t, std::uint32_t>> seen;
  for (std::uint32_t cell = 0; cell < lattice::kCells; ++cell) {
    const lattice::Place p = lattice::kPlaces[cell];
    seen.emplace(p.x, p.y);
    const std::uint32_t spacing = lattice::spacing(cell + 1);
    if (cell + 1 != 4 && cell + 1 != 16 && cell + 1 != 64) continue;
    EXPECT_EQ(seen.size(), cell + 1);
    for (const auto& [x, y] : seen) EXPECT_EQ((x % spacing) + (y % spacing), 0u);
  }
  EXPECT_EQ(seen.size(), 64u);
}

TEST(TileScheduler, SweepsGiveEveryTileOneSampleInOrder) {
  TileScheduler s = make(TileScheduler::Order::kSweep);
  const auto tiles = static_cast<std::uint32_t>(s.tiles().size());
  for (std::uint32_t sample = 0; sample < 3; ++sample) {
    for (std::uint32_t tile = 0; tile < tiles; ++tile) {
      EXPECT_EQ(s.samplesDone(), sample);
      EXPECT_EQ(s.tilesDone(), tile);
      const auto unit = s.next();
      ASSERT_TRUE(unit.has_value());
      EXPECT_EQ(unit->tile, tile);
      EXPECT_EQ(unit->sample, sample);
      EXPECT_EQ(unit->firstCell, 0u);
      EXPECT_EQ(unit->endCell, 64u);
    }
  }
  TileScheduler again = make(TileScheduler::Order::kSweep);
  again.restore(3, 5);
  EXPECT_EQ(again.next()->tile, 5u);
}

TEST(TileScheduler, PerceptionGivesEachCellOnceAndStopsAtTheBarrier) {
  TileScheduler s = make(TileScheduler::Order::kPerception, 200, 136);
  s.setBarrier(5);
  std::map<std::tuple<std::uint32_t, std::uint32_t, std::uint32_t>, int> given;
  for (int frame = 0; frame < 10'000 && !s.atBarrier(); ++frame) {
    s.beginFrame(vec2(0.2f, 0.7f), 512);
    for (int i = 0; i < 4; ++i) {
      const auto unit = s.next();
      if (!unit) break;
      ASSERT_LT(unit->firstCell, unit->endCell);
      for (std::uint32_t c = unit->firstCell; c < unit->endCell; ++c) {
        ++given[{unit->tile, unit->sample, c}];
      }
    }
  }
  EXPECT_TRUE(s.atBarrier());
  EXPECT_FALSE(s.next().has_value());
  EXPECT_EQ(given.size(), s.tiles().size() * 5 * 64);
  for (const auto& [cell, times] : given) EXPECT_EQ(times, 1);
}

/// Longest time, in frames, that a tile waits if a frame has so many units.
std::uint32_t longestWait(std::uint32_t width, std::uint32_t height, int unitsAFrame) {
  TileScheduler s = make(TileScheduler::Order::kPerception, width, height);
  for (std::uint32_t tile = 0; tile < s.tiles().size(); ++tile) {
    s.setError(tile, tile == 3 ? 1e6f : 1e-3f);  // one tile wants everything
  }
  std::uint32_t longest = 0;
  for (int frame = 0; frame < 400; ++frame) {
    s.beginFrame(vec2(0.5f), 1024);
    for (int i = 0; i < unitsAFrame; ++i) s.next();
    longest = std::max(longest, s.longestWait());
  }
  return longest;
}

TEST(TileScheduler, WhatIsLentIsTakenNowhereElse) {
  TileScheduler s = make(TileScheduler::Order::kPerception, 200, 136);
  s.setBarrier(2);
  s.beginFrame(vec2(0.2f, 0.7f), 512);
  const auto first = s.lend(), second = s.lend();
  ASSERT_TRUE(first && second);
  EXPECT_NE(first->tile, second->tile);
  EXPECT_EQ(first->firstCell, 16u);  // the coarse frame is the window's
  EXPECT_EQ(first->endCell, 64u);
  EXPECT_FALSE(s.isReadyFor(*first));
  EXPECT_EQ(s.freeTiles(), s.tiles().size() - 2);
  const auto takeAll = [&] {
    for (int frame = 0; frame < 1000; ++frame) {
      s.beginFrame(vec2(0.2f, 0.7f), 512);
      while (s.next()) continue;
    }
  };
  takeAll();
  EXPECT_FALSE(s.atBarrier());
  EXPECT_EQ(s.freeTiles(), 0u);
  EXPECT_FALSE(s.lend());
  EXPECT_EQ(s.coarseCells(), 16u);
  EXPECT_EQ(s.longestWait(), 0u);  // it is not ours to serve
  ASSERT_TRUE(s.isReadyFor(*first));
  s.cameBack(*first);
  EXPECT_EQ(s.state(first->tile).sample, 1u);
  EXPECT_FALSE(s.isReadyFor(*first));
  const auto third = s.lend();  // of the same tile: the only one
  ASSERT_TRUE(third);
  EXPECT_EQ(third->tile, first->tile);
  EXPECT_EQ(third->sample, 1u);
  EXPECT_EQ(third->firstCell, 0u);
  s.cameBack(*third);
  EXPECT_EQ(s.state(first->tile).sample, 2u);
  s.release(*second);  // taken here after all
  takeAll();
  EXPECT_TRUE(s.atBarrier());
  s.setBarrier(3);
  ASSERT_TRUE(s.lend());
  s.releaseAll();
  EXPECT_EQ(s.freeTiles(), s.tiles().size());
  ASSERT_TRUE(s.lend());
  s.restart();
  EXPECT_EQ(s.freeTiles(), s.tiles().size());
}

TEST(TileScheduler, WhatLacksPagesIsNextOnceTheyAreThere) {
  TileScheduler s = make(TileScheduler::Order::kPerception, 200, 136);
  s.setLooks(8);
  s.setBarrier(2);
  std::map<std::tuple<std::uint32_t, std::uint32_t, std::uint32_t>, int> given;
  std::map<std::uint32_t, std::set<std::uint32_t>> looks;
  std::uint64_t asked = 0, come = 0;
  bool missed = false;
  for (int frame = 0; frame < 10'000 && !s.atBarrier(); ++frame) {
    if (frame % 2 == 1) come = asked;
    s.setPages(come);
    s.beginFrame(vec2(0.2f, 0.7f), 512);
    for (int i = 0; i < 4; ++i) {
      const auto unit = s.next();
      if (!unit) break;
      EXPECT_LE(s.state(unit->tile).pages, come) << "its pages are not there";
      // Every third unit, and what follows it in its tile.
      if ((frame + i) % 3 == 0) {
        s.putBack(*unit, ++asked);
        missed = true;
        EXPECT_GT(s.pagesAwaited(), come);
        continue;
      }
      if (unit->look) {
        EXPECT_TRUE(looks[unit->tile].insert(s.state(unit->tile).looks).second);
        continue;
      }
      s.wasWhole(unit->tile);
      EXPECT_EQ(s.state(unit->tile).tries, 0u);
      for (std::uint32_t cell = unit->firstCell; cell < unit->endCell; ++cell) {
        EXPECT_EQ((++given[{unit->tile, unit->sample, cell}]), 1);
      }
    }
  }
  EXPECT_TRUE(missed);
  EXPECT_TRUE(s.atBarrier());
  EXPECT_EQ(given.size(), s.tiles().size() * 2 * lattice::kCells);
  EXPECT_EQ(looks.size(), s.tiles().size());
  for (const auto& [tile, rounds] : looks) EXPECT_EQ(rounds.size(), 9u) << tile;
}

TEST(TileScheduler, TheCoarseFrameOfWhatLacksPagesIsLent) {
  TileScheduler s = make(TileScheduler::Order::kPerception, 200, 136);
  s.setBarrier(2);
  s.setPages(3);
  s.beginFrame(vec2(0.2f, 0.7f), 512);
  EXPECT_FALSE(s.lendCoarse());
  const auto whole = s.lend();  // as it happens before it is known what lacks pages
  ASSERT_TRUE(whole);
  const auto tiles = static_cast<std::uint32_t>(s.tiles().size());
  std::vector<TileUnit> units;
  for (std::uint32_t i = 0; i < tiles; ++i) units.push_back(*s.next());
  for (const TileUnit& unit : units) s.putBack(unit, 4);
  EXPECT_FALSE(s.next());
  EXPECT_EQ(s.coarseTilesToLend(), tiles);
  s.release(*s.lendCoarse());  // it will not come: another time
  for (std::uint32_t i = 0; i < tiles; ++i) {
    const auto unit = s.lendCoarse();
    ASSERT_TRUE(unit);
    EXPECT_EQ(unit->sample, 0u);
    EXPECT_EQ(unit->firstCell, 0u);
    EXPECT_EQ(unit->endCell, 1u);
    EXPECT_TRUE(s.isReadyFor(*unit));
    s.cameBack(*unit);
    EXPECT_FALSE(s.isReadyFor(*unit));
  }
  EXPECT_EQ(s.coarseCells(), 1u);
  const auto next = s.lendCoarse();
  ASSERT_TRUE(next);
  EXPECT_EQ(next->firstCell, 1u);
  EXPECT_EQ(next->endCell, 4u);
  // Pages come: all but what is still lent goes on here, and nothing twice.
  s.setPages(4);
  EXPECT_EQ(s.coarseTilesToLend(), 0u);
  for (int frame = 0; frame < 100; ++frame) {
    s.beginFrame(vec2(0.2f, 0.7f), 512);
    while (const auto unit = s.next()) EXPECT_NE(unit->tile, next->tile);
  }
  s.cameBack(*next);
  for (int frame = 0; frame < 100; ++frame) {
    s.beginFrame(vec2(0.2f, 0.7f), 512);
    while (s.next()) continue;
  }
  ASSERT_TRUE(s.isReadyFor(*whole));
  s.cameBack(*whole);
  for (int frame = 0; frame < 100; ++frame) {
    s.beginFrame(vec2(0.2f, 0.7f), 512);
    while (s.next()) continue;
  }
  EXPECT_TRUE(s.atBarrier());
}

TEST(TileScheduler, NoTileWaitsLongerThanPromised) {
  // As many units a frame as the share of those that wait needs: tiles / 16, and the best ones.
  EXPECT_LE(longestWait(640, 360, 10), TileScheduler::kMostFrames);
  EXPECT_LE(longestWait(1280, 720, 32), TileScheduler::kMostFrames);
}

TEST(TileScheduler, NearThePointerAndNoisyTilesComeFirst) {
  TileScheduler s = make(TileScheduler::Order::kPerception);
  s.beginFrame(vec2(0.1f, 0.1f), 4096);
  const auto first = s.next();
  ASSERT_TRUE(first.has_value());
  const Tile& t = s.tiles()[first->tile];
  EXPECT_LT(t.x, 64u * 2);
  EXPECT_LT(t.y, 64u * 2);
  while (s.coarseCells() < 16) s.next();
  for (std::uint32_t tile = 0; tile < s.tiles().size(); ++tile) s.setError(tile, 0.001f);
  s.setError(7, 1.0f);
  int served = 0;
  for (int frame = 0; frame < 20; ++frame) {
    s.beginFrame(vec2(0.5f), 1024);
    for (int i = 0; i < 20; ++i) {
      const auto unit = s.next();
      served += unit && unit->tile == 7;
    }
  }
  EXPECT_GT(served, 80) << "of 400 units, 60 tiles";
}

TEST(TileScheduler, ACoarseFrameOfAllTilesComesBeforeAnythingElse) {
  TileScheduler s = make(TileScheduler::Order::kPerception);
  s.beginFrame(vec2(0.5f), 4096);
  const std::size_t tiles = s.tiles().size();
  for (std::size_t i = 0; i < tiles; ++i) EXPECT_EQ(s.next()->endCell, 1u);
  EXPECT_EQ(s.coarseCells(), 1u);
  EXPECT_EQ(s.spacingAt(639, 359), 8u);
  s.restart();
  EXPECT_EQ(s.coarseCells(), 0u);
  EXPECT_EQ(s.spacingAt(0, 0), 0u);
}

/// Of a frame that asks for it every second pixel is looked at after one cell, the others after
/// four, and then each tile once more where it is varied, before the other rounds.
TEST(TileScheduler, LooksAtWhatPixelsShow) {
  constexpr std::uint32_t kWide = 200, kHigh = 136, kMost = 3;
  TileScheduler s = make(TileScheduler::Order::kPerception, kWide, kHigh);
  s.setLooks(kMost);
  const auto tiles = static_cast<std::uint32_t>(s.tiles().size());
  for (int again = 0; again < 2; ++again) {
    s.restart();
    EXPECT_EQ(s.lookSpacing(), 0u);
    std::vector<int> known(std::size_t{kWide} * kHigh);
    std::uint32_t furtherLooks = 0;
    while (s.samplesDone() < 2) {
      s.beginFrame(vec2(0.5f), 512);
      for (std::uint32_t units = 0; units < tiles; ++units) {
        const auto unit = s.next();
        ASSERT_TRUE(unit.has_value());
        if (!unit->look) {
          EXPECT_TRUE(unit->endCell <= 1 || s.lookSpacing() > 0);
          EXPECT_TRUE(unit->endCell <= 4 || s.lookSpacing() == 1);
          continue;
        }
        if (unit->sample > 0) {
          ++furtherLooks;
          EXPECT_EQ(s.lookSpacing(), 1u);
          EXPECT_TRUE(unit->sample == 1 || s.coarseCells() >= 16);
          EXPECT_EQ(unit->firstCell, 0u);
          EXPECT_EQ(unit->endCell, lattice::kCells);
          continue;
        }
        const Tile& t = s.tiles()[unit->tile];
        for (std::uint32_t y = t.y; y < t.y + t.height; ++y) {
          for (std::uint32_t x = t.x; x < t.x + t.width; ++x) {
            const std::uint32_t cell = lattice::cellAt(x, y);
            known[std::size_t{y} * kWide + x] += cell >= unit->firstCell && cell < unit->endCell;
          }
        }
        if (s.lookSpacing() == 2) {
          for (std::uint32_t y = 0; y < kHigh; y += 2) {
            for (std::uint32_t x = 0; x < kWide; x += 2)
              ASSERT_EQ(known[std::size_t{y} * kWide + x], 1);
          }
        }
      }
    }
    for (const int times : known) ASSERT_EQ(times, 1);
    EXPECT_EQ(furtherLooks, (kMost - 1) * tiles);
  }
  TileScheduler other = make(TileScheduler::Order::kPerception, kWide, kHigh);
  other.setLooks(kMost);
  other.restart(&s);
  EXPECT_EQ(other.lookSpacing(), 1u);
  EXPECT_EQ(other.coarseCells(), 0u);
  other.beginFrame(vec2(0.5f), 512);
  for (std::uint32_t i = 0; i < 8 * tiles; ++i) EXPECT_FALSE(other.next()->look);
}

}  // namespace
}  // namespace trex
