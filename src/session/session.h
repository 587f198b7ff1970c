// The session: what to do next, do it, merge it. Headless capture and the viewer drive this class.
//
// A frame is made of passes; a pass gives every pixel one more sample:
//
//   light   before some passes: photons are shot, the voxels' light is brought up to date
//   tiles   for each tile, from the centre outwards:
//             trace    C-rays of all its pixels on the CPU; cones they ask for go to the device
//             merge    while the device answers, the next tile is traced; then the answers are
//             added
//                      and the tile's samples enter the accumulator
//
// The value of a sample depends on pixel, sample number and seed alone, so pictures are equal to
// the bit for any number of threads (on a device: for any two runs on it).
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "src/crays/integrator.h"
#include "src/frame/accumulator.h"
#include "src/frame/features.h"
#include "src/frame/image_file.h"
#include "src/frame/layers.h"
#include "src/frame/tiles.h"
#include "src/grays/grays.h"
#include "src/session/model.h"
#include "src/session/settings.h"

namespace trex {

class LightPass;
class CheckpointReader;

/// Seconds by phase, counts and memory, for --json and the progress line.
struct SessionReport {
  double meshSeconds = 0, voxelSeconds = 0, deviceSeconds = 0, aimSeconds = 0;  ///< set-up
  double renderSeconds = 0;    ///< in run(), and aiming photons before
  double photonSeconds = 0;    ///< of these
  double filterSeconds = 0;    ///< of the last picture()
  double estimatedError = -1;  ///< Accumulator::estimatedError(); negative: not known yet
  std::uint64_t deviceBytes = 0;
  std::uint32_t samplesDone = 0;  ///< complete passes
  std::uint64_t photons = 0, photonsLanded = 0, nonFinite = 0;
  RayCounts rays;
  RayScene::Statistics mesh;
  hccm::PageCache::Statistics pages;  ///< of a mesh in pages
  std::uint64_t voxels = 0, leaves = 0, voxelBytes = 0;
  int voxelDepth = 0;
  double lightScale = 1.0;
  std::string device = "none";  ///< where G-rays run
  bool cones = false;
};

class Session {
 public:
  /// Starts what the model and the settings require, and nothing else. Throws Error.
  /// `layers`: those that picture() will be asked for. Without the model's voxels every sample is
  /// exact.
  Session(std::shared_ptr<const Model> model, const Camera& camera, const RenderSettings& settings,
          const PictureLayers& layers = {});
  ~Session();

  /// Asked between tiles; false ends the run. Gets the share of the goal that is done, [0, 1].
  using KeepGoing = std::function<bool(double)>;

  /// Renders until the goal is reached or keepGoing says no. Called again it goes on where it
  /// stopped, in the middle of a pass too; only the time inside counts.
  void run(const KeepGoing& keepGoing);
  /// Whether the samples, the seconds or the error of the settings are reached.
  bool goalReached() const;

  /// Writes all that is needed to go on later with the same bits: see checkpoint.h. `key` names the
  /// job. Throws Error(kOutput).
  void saveCheckpoint(const std::filesystem::path& path, std::uint64_t key, std::uint32_t frame);
  /// Goes on from such a file. To be called before run(). Throws Error(kInput).
  void restoreCheckpoint(CheckpointReader& reader);

  /// The frame so far: R, G, B (filtered, if the settings ask for it), and the layers.
  Picture picture();
  SessionReport report() const;
  const Accumulator& frame() const { return frame_; }
  /// World position of the origin of render space, metres.
  dvec3 renderOrigin() const { return model_->rays->renderOrigin(); }
  /// Complete passes so far.
  std::uint32_t samplesDone() const { return report_.samplesDone; }

 private:
  struct TileWork;
  struct VoxelPart;

  void prepareVoxels();
  bool pass(const KeepGoing& keepGoing);
  void add(const TileWork& work, std::uint32_t column, std::uint32_t row);
  std::vector<std::span<std::byte>> state();
  void trace(const Tile& tile, std::uint32_t sample, TileWork& work);
  void merge(TileWork& work);
  double progress() const;
  std::vector<vec3> shown();
  double timeLimit() const;
  void addLayers(std::uint32_t x, std::uint32_t y, std::vector<float>& values) const;
  double elapsed() const;

  RenderSettings settings_;
  PictureLayers layers_;
  std::shared_ptr<const Model> model_;
  SessionReport report_;
  std::unique_ptr<LightSet> lights_;
  std::unique_ptr<VoxelPart> voxels_;  ///< null where every sample is exact
  std::unique_ptr<CameraRays> camera_;
  std::unique_ptr<Integrator> integrator_;
  Accumulator frame_;
  // Null where nobody asks for them.
  std::unique_ptr<FeatureImage> features_;
  std::unique_ptr<DirectImage> direct_;
  std::unique_ptr<FirstHitImage> firstHits_;
  std::vector<Tile> tiles_;
  std::size_t tilesDone_ = 0;      ///< of the pass under way
  std::uint32_t errorCheck_ = 16;  ///< samples at which the error is estimated next
  double error_ = kInfinity;       ///< as estimated last
  double filterEstimate_ = 0.0;    ///< seconds that the filter will take
  double start_ = 0.0;             ///< of this run(), less what earlier ones took
};

}  // namespace trex
