// The sums of one picture under way, and how far each tile is.
#pragma once

#include <memory>

#include "src/frame/accumulator.h"
#include "src/frame/features.h"
#include "src/frame/layers.h"
#include "src/frame/light_memory.h"
#include "src/frame/look_image.h"
#include "src/session/dial.h"
#include "src/session/light_noise.h"
#include "src/session/photon_noise.h"
#include "src/session/scheduler.h"

namespace trex {

/// Beginning anew costs nothing: a pixel's sums are cleared by its first sample, so what a tile
/// state does not count as sampled must not be read.
struct FrameBuffers {
  Accumulator sums;
  // Null where nobody asks for them.
  std::unique_ptr<FeatureImage> features;
  std::unique_ptr<DirectImage> direct;
  std::unique_ptr<CoverageImage> coverage;
  std::unique_ptr<FirstHitImage> firstHits;
  std::unique_ptr<RayClassImage> rayClasses;
  // Of the viewer, of frames of one view together:
  std::shared_ptr<LookImage> looks;
  std::shared_ptr<LightMemory> memory;  ///< outlives restart()
  std::unique_ptr<Dial> dial;           ///< null where the share of pairs is given
  // Of captures with a dial, for estimates of their error:
  std::unique_ptr<PhotonNoise> photonNoise;
  std::unique_ptr<LightNoise> lightNoise;  ///< null without a filter
  TileScheduler tiles;

  FrameBuffers(std::uint32_t width, std::uint32_t height, bool pairs, bool filtered,
               const PictureLayers& layers, TileScheduler scheduler)
      : sums(width, height, pairs), tiles(std::move(scheduler)) {
    if (filtered || layers.needsFeatures()) {
      features = std::make_unique<FeatureImage>(width, height);
    }
    if (layers.needsSplit()) direct = std::make_unique<DirectImage>(width, height);
    if (layers.alpha) coverage = std::make_unique<CoverageImage>(width, height);
    if (layers.needsFirstHit()) firstHits = std::make_unique<FirstHitImage>(width, height);
    if (layers.rayClass) rayClasses = std::make_unique<RayClassImage>(width, height);
  }

  /// A pixel's mean before any filter, for a glance, and its variance. With a dial it is that of
  /// its guesses: few pairs add noise, and do not tell how much.
  dvec3 rawMean(std::uint32_t x, std::uint32_t y) const {
    return dial ? sums.guess(x, y).mean() : sums.mean(x, y);
  }
  dvec3 rawVariance(std::uint32_t x, std::uint32_t y) const {
    return dial ? sums.guess(x, y).varianceOfMean() : sums.varianceOfMean(x, y);
  }

  /// `other`: a frame of the same view, whose looks go on being this one's.
  void restart(const FrameBuffers* other = nullptr) {
    tiles.restart(other != nullptr ? &other->tiles : nullptr);
    if (looks && other == nullptr) looks->restart();
    sums.restart();
    if (dial) dial->restart();
  }
  /// Shares what another frame of the same view knows of it; null: knows nothing.
  void showAs(const FrameBuffers* other, std::uint32_t rounds) {
    looks = other != nullptr ? other->looks : nullptr;
    memory = other != nullptr ? other->memory : nullptr;
    tiles.setLooks(looks ? rounds : 0);
  }
  void restart(std::uint32_t x, std::uint32_t y) {
    sums.restart(x, y);
    if (features) features->restart(x, y);
    if (photonNoise) photonNoise->restart(x, y);
    if (lightNoise) lightNoise->restart(x, y);
    if (direct) direct->restart(x, y);
    if (coverage) coverage->restart(x, y);
    if (firstHits) firstHits->restart(x, y);
    if (rayClasses) rayClasses->restart(x, y);
  }
};

}  // namespace trex
