// The session: what to do next, do it, merge it. Headless capture and the viewer drive this class.
//
//   work = what comes next                            (lightDue(), scheduler.h)
//     light   photons are shot, the voxels' light is brought up to date
//     tiles   trace   C-rays of some pixels on the CPU; cones they ask for go to the device
//             merge   while the device answers, the next pixels are traced; then the answers are
//                     added and the samples enter the frame
//
// Captures run() sweeps of all tiles until the goal is reached. The viewer calls step() once a
// frame of its screen: a coarse picture first, then tiles in perceptual order, each step within its
// time. While the light of an edit is not there yet, samples are previews: they read the light of
// before and are shown, but never enter the picture.
//
// The value of a sample depends on pixel, sample number and seed alone, so pictures are equal to
// the bit for any number of threads and order of tiles (on a device: for any two runs on it).
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "src/crays/integrator.h"
#include "src/frame/image_file.h"
#include "src/frame/layers.h"
#include "src/grays/grays.h"
#include "src/scene/look.h"
#include "src/session/frame_buffers.h"
#include "src/session/model.h"
#include "src/session/settings.h"
#include "src/session/shown_picture.h"

namespace trex {

class LightPass;
class CheckpointReader;

/// Seconds by phase, counts and memory, for --json and the progress line.
struct SessionReport {
  double meshSeconds = 0, voxelSeconds = 0, deviceSeconds = 0, aimSeconds = 0;  ///< set-up
  double renderSeconds = 0;   ///< in run(), and aiming photons before
  double photonSeconds = 0;   ///< of these
  double causticSeconds = 0;  ///< of these, for maps of caustics
  std::uint64_t causticPhotons = 0;
  double filterSeconds = 0;  ///< of the last picture()
  GRayStatistics gRays;
  std::uint32_t samplesDone = 0;  ///< complete passes
  std::uint64_t photons = 0, photonsLanded = 0, nonFinite = 0;
  RayCounts rays;
  RayScene::Statistics mesh;
  hccm::PageCache::Statistics pages;  ///< of a mesh in pages
  std::uint64_t voxels = 0, leaves = 0, voxelBytes = 0;
  int voxelDepth = 0;
  double lightScale = 1.0;
  std::string device = "none";  ///< where G-rays run
  bool photonRays = false;      ///< photons bounce as C-rays
  bool cones = false;
};

class Session {
 public:
  /// Starts what the model and the settings require, and nothing else. Throws Error.
  /// `layers`: those that picture() will be asked for. Without the model's voxels every sample is
  /// exact, unless voxelsAreComing() is said.
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

  // What the viewer drives: session_edit.cpp, with RenderSettings::interactive.

  enum class Step : std::uint8_t { kIdle, kPreview, kLight, kSamples };
  /// Does what comes next until `keepGoing` says no, asked every few milliseconds, but at least the
  /// coarsest picture of all tiles after a change. `pointer`: see TileScheduler.
  Step step(const std::function<bool()>& keepGoing, vec2 pointer);
  /// The model has changed as ModelEditor::apply() said; `camera` is the one to look through. Takes
  /// a millisecond or so: photons start anew after the first preview.
  void follow(const Invalidation& what, const Camera& camera);
  /// Called before photons start anew: ModelEditor::updateVoxelValues().
  void beforeLight(std::function<void()> action) { beforeLight_ = std::move(action); }
  /// Another size of the picture; samples start anew, photons stay.
  void resize(std::uint32_t width, std::uint32_t height);
  /// Voxels are being built: until setVoxels() there are previews alone.
  void voxelsAreComing();
  /// Voxels with a device that reads them, made by any thread (makeDevice). What was there before
  /// serves previews until photons have been shot.
  void setVoxels(std::shared_ptr<const asvo::Tree> tree, std::unique_ptr<GRayTracer> device);
  static std::unique_ptr<GRayTracer> makeDevice(const std::vector<Material>& materials,
                                                const std::vector<Image>& images,
                                                const asvo::Tree& tree,
                                                const RenderSettings& settings);
  /// Aims photons at the present camera if they were aimed elsewhere; they start anew then.
  bool aimAgain();
  /// What is to be shown: the frame under way, or the preview. Read what its tiles have, no more.
  const FrameBuffers& shownFrame() const;
  ShownOptions shownOptions() const;
  bool previewing() const;
  /// How captures repeat the light of this frame: RenderSettings::photons and aim.
  std::uint64_t leastPhotons() const { return settings_.photons; }
  const std::optional<Camera>& aim() const { return settings_.aim; }
  /// Cached light on the side of `normal`, W/m^2; false if there is none.
  bool cachedLight(const vec3& position, const vec3& normal, vec3& irradiance) const;
  /// A pair of a guess and an exact sample, beside the frame: for estimates of the bias.
  PathSample probe(std::uint32_t x, std::uint32_t y, std::uint32_t sample) const;
  const CameraRays& cameraRays() const { return *camera_; }
  const RayScene& rays() const { return *model_->rays; }
  /// The voxels that cached light is read from; null if there are none yet.
  const asvo::Tree* voxels() const;
  std::uint32_t width() const { return settings_.width; }
  std::uint32_t height() const { return settings_.height; }
  const LightSet& lights() const { return *lights_; }
  /// The last step() found nothing to do.
  bool resting() const { return resting_; }

  /// Writes all that is needed to go on later with the same bits: see checkpoint.h. `key` names the
  /// job. Throws Error(kOutput).
  void saveCheckpoint(const std::filesystem::path& path, std::uint64_t key, std::uint32_t frame);
  /// Goes on from such a file. To be called before run(). Throws Error(kInput).
  void restoreCheckpoint(CheckpointReader& reader);

  /// The frame so far: R, G, B (filtered, if the settings ask for it), and the layers. Every pixel
  /// must have a sample.
  Picture picture();
  SessionReport report() const;
  /// Accumulator::estimatedError(); negative before two samples. Reads every pixel and its
  /// neighbours, some 20 ms at 640x360; only each stride-th pixel of each stride-th row if told so.
  double estimatedError(std::uint32_t stride = 1) const;
  const Accumulator& frame() const { return frame_->sums; }
  /// World position of the origin of render space, metres.
  dvec3 renderOrigin() const { return model_->rays->renderOrigin(); }
  /// Samples that every pixel has.
  std::uint32_t samplesDone() const { return frame_->tiles.samplesDone(); }

 private:
  struct Batch;
  struct LightSide;

  // session.cpp: the loop
  bool lightDue() const;
  bool bringLight(const std::function<bool()>& keepGoing);
  bool advance(const KeepGoing& keepGoing);
  void checkError();
  double progress() const;
  double timeLimit() const;
  double elapsed() const;
  // session_tiles.cpp: samples
  void addJobs(const FrameBuffers& frame, const TileUnit& unit, Batch& batch) const;
  void trace(const Integrator& integrator, Batch& batch);
  void merge(FrameBuffers& frame, Batch& batch);
  void add(FrameBuffers& frame, const Batch& batch, std::size_t job);
  void rateTile(FrameBuffers& frame, std::uint32_t tile) const;
  // session_edit.cpp: the viewer
  bool takeSamples(FrameBuffers& frame, const Integrator& integrator,
                   const std::function<bool()>& keepGoing, vec2 pointer);
  void prepareLight();
  void startLight();
  void renewLight();
  void makeFrames();
  void makeIntegrators();
  void makeCaustics();
  void prepareCaustics(const Batch& batch);
  bool wantsGuess() const;
  Step nextStep(const std::function<bool()>& keepGoing, vec2 pointer);
  LightSide* nextLight() const;
  // session_picture.cpp: what comes out
  std::vector<std::span<std::byte>> state();
  std::vector<vec3> shown();
  void addLayers(std::uint32_t x, std::uint32_t y, std::vector<float>& values) const;

  RenderSettings settings_;
  PictureLayers layers_;
  std::shared_ptr<const Model> model_;
  SessionReport report_;
  Camera view_;
  std::unique_ptr<LightSet> lights_;
  std::unique_ptr<LightSide> light_;   ///< null where every sample is exact
  std::unique_ptr<LightSide> coming_;  ///< of new voxels, until its photons are shot
  bool voxelsComing_ = false;
  bool resting_ = false;
  int previewTurn_ = 0;
  /// What must be done before photons start anew, a step each, from the last to the first.
  enum class Stale : std::uint8_t { kNothing, kPhotons, kDevice, kValues };
  Stale stale_ = Stale::kNothing;
  std::function<void()> beforeLight_;
  std::unique_ptr<CausticMaps> caustics_;  ///< null where the scene has none
  std::unique_ptr<CameraRays> camera_;
  std::unique_ptr<Integrator> integrator_, previewIntegrator_;
  std::unique_ptr<FrameBuffers> frame_, preview_;  ///< preview_: the viewer's alone
  std::uint32_t errorCheck_ = 16;                  ///< samples at which the error is estimated next
  double error_ = kInfinity;                       ///< as estimated last
  double filterEstimate_ = 0.0;                    ///< seconds that the filter will take
  double start_ = 0.0;                             ///< of this run(), less what earlier ones took
  std::uint32_t batchPixels_ = 2048;               ///< of the viewer: some milliseconds' worth
};

}  // namespace trex
