// The dial that sets itself (`--exact auto`): of every tile, which share of its samples is traced
// exactly as well. It looks at a picture's sums when every pixel has 2, 3, 4, 6, 9, ... samples,
// each time half as many more, and chooses by share_rule.h what the samples until the next look do.
//
// A choice depends on the samples before it and on nothing else: not on time, threads or the order
// of tiles, as none passes a look before all have reached it. Costs are counted rays. So pictures
// keep their bits, and sums that have been restored from a checkpoint go on alike.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "src/frame/accumulator.h"
#include "src/frame/tiles.h"
#include "src/session/share_rule.h"

namespace trex {

/// What the dial knows of a tile. Plain data, without padding.
struct DialTile {
  double share = kFirstShare;
  double noise = 0.0, bias = 0.0;            ///< the parts of expectedError() at the last look
  std::uint64_t guesses = 0, guessRays = 0;  ///< samples that were not traced exactly, their rays
  std::uint64_t pairs = 0, pairRays = 0;     ///< those that were
};
static_assert(sizeof(DialTile) == 7 * 8);

/// What a dial is for.
struct DialUse {
  Pooling pooling{};  ///< by the picture's filter
  /// It looks at 16, 64, 256, ... samples alone, where light changes anyway: those of a model in
  /// pages share what they load of it until they wait for each other.
  bool seldom = false;
};

/// Not thread safe.
class Dial {
 public:
  /// Of a picture of so many tiles and pixels.
  Dial(std::size_t tiles, std::uint64_t pixels, const DialUse& use = {})
      : tiles_(tiles), pixels_(pixels), use_(use), nextLook_(firstLook()) {}

  const DialTile& tile(std::size_t tile) const { return tiles_[tile]; }
  /// Of the samples of this number in a tile, those that are traced exactly as well. None of the
  /// first: no correction can be made of so few, and a first picture must not wait for them.
  double share(std::size_t tile, std::uint32_t sample) const {
    return sample == 0 ? 0.0 : tiles_[tile].share;
  }
  /// Pairs of all samples so far.
  double share() const;
  /// The parts of the picture's expected relMSE, as of the last look; negative before the first.
  double noise() const { return mean(&DialTile::noise); }
  double bias() const { return mean(&DialTile::bias); }
  /// Pairs that a pixel has, on average; 0 before the first sample.
  double meanPairs() const;
  /// Samples of every pixel at which it looks next; none may have more before.
  std::uint32_t nextLook() const { return nextLook_; }
  /// A sample of a tile is done, by so many rays.
  void add(std::size_t tile, bool paired, std::uint64_t rays);
  /// The share of a tile, as another dial chose it.
  void setShare(std::size_t tile, double share) { tiles_[tile].share = share; }
  /// Every pixel has `samples` samples in `sums`: chooses anew if a look is due.
  void look(std::span<const Tile> tiles, std::uint32_t samples, const Accumulator& sums);
  /// The picture begins anew.
  void restart();
  /// All that it knows, to be saved and put back; after that, restore() with the samples that every
  /// pixel had.
  std::span<std::byte> bytes() { return std::as_writable_bytes(std::span(tiles_)); }
  void restore(std::uint32_t samples);

 private:
  double mean(double DialTile::*value) const;
  std::uint32_t firstLook() const { return use_.seldom ? 16 : 2; }

  std::vector<DialTile> tiles_;
  std::uint64_t pixels_;
  DialUse use_;
  std::uint32_t nextLook_;
};

/// What an area's sums say of guesses and differences; costs are 1 and 0. Within a block of each
/// scale the bias counts as even: the products of pairs of different pixels, whose noise has
/// nothing in common (of one pixel it has: samples are stratified), have its square as their
/// expectation.
ShareFigures measureShares(const Tile& area, const Accumulator& sums);

}  // namespace trex
