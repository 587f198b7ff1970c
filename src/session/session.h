// The session: one picture that grows, sample by sample, for whoever drives it.
//
//   while (auto work = plan(state())) perform(*work);
//
//   state     plain numbers: how far the light and the frame are (plan.h)
//   plan      what comes next, of four kinds
//   perform   kSamples   rays of some pixels are traced, what they bring is added up (samples.h);
//                        with several machines by whoever has time (SampleSharer; of the
//                        viewer's SampleHelper)
//             kPhotons   more photons are shot for the light that samples read (voxel_light.h)
//             kLight     after an edit: voxels, device, photons are made ready, one of it at a time
//             kPreview   samples of the preview, read from the light of before
//
// A FRAME is two sums a pixel and how far each tile is (frame_buffers.h): of the samples' guesses,
// and of what exact paths add to those that are traced twice. Its picture is the mean of the one
// plus the mean of the other, each filtered if that is asked for (shown_picture.h). A sample's
// value depends on pixel, sample number and seed alone, and samples of a pixel are added in their
// order, so pictures are equal to the bit for any number of threads and order of tiles (on a
// device: for any two runs on it). Light changes between samples alone, at numbers that are always
// the same (photonTarget()).
//
// Two drivers: capture (src/app/capture.h) calls run() until the goal of its settings and writes
// files; the viewer (src/viewer/viewer.h) calls step() once a frame of its screen and shows what is
// there. RenderSettings::interactive brings what the viewer needs: tiles in perceptual order
// (scheduler.h), steps that end in time, and a second frame, the preview, for as long as the light
// of an edit is not there. Previews are shown, and never enter the picture.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "src/frame/image_file.h"
#include "src/frame/layers.h"
#include "src/grays/grays.h"
#include "src/paths/path_sample.h"
#include "src/scene/look.h"
#include "src/scene/texture_cache.h"
#include "src/session/denoiser.h"
#include "src/session/frame_buffers.h"
#include "src/session/goal.h"
#include "src/session/model.h"
#include "src/session/plan.h"
#include "src/session/sample_helper.h"
#include "src/session/samples.h"
#include "src/session/settings.h"
#include "src/session/shown_picture.h"
#include "src/session/taken_samples.h"
#include "src/session/voxel_light.h"

namespace trex {

class CheckpointReader;
class UnfilteredPixels;

/// Seconds by phase, counts and memory, for --json and the progress line.
struct SessionReport {
  double meshSeconds = 0, voxelSeconds = 0, deviceSeconds = 0;  ///< set-up
  double renderSeconds = 0;                                     ///< in run() and step()
  double firstPictureSeconds = 0;            ///< of these, until each pixel had a sample
  double aimSeconds = 0, photonSeconds = 0;  ///< of these
  double causticSeconds = 0;                 ///< of these, for maps of caustics
  std::uint64_t causticPhotons = 0;
  double filterSeconds = 0;    ///< of the last picture()
  std::string denoiser;        ///< of the last picture(): denoiserName()
  std::string denoiseProblem;  ///< why the filter had to take over at the last picture(), if so
  GRayStatistics gRays;
  std::uint32_t samplesDone = 0;  ///< complete passes
  double exactShare = 0.0;        ///< of the samples, traced exactly
  std::uint64_t photons = 0, photonsLanded = 0, nonFinite = 0;
  RayCounts rays;
  RayScene::Statistics mesh;
  hccm::PageCache::Statistics pages;  ///< of a mesh in pages
  PageTrafficReport traffic;          ///< where paths wait for them
  TextureCache::Statistics textures;
  std::uint64_t voxels = 0, leaves = 0, voxelBytes = 0;
  int voxelDepth = 0;
  double lightScale = 1.0;
  std::string device = "none";     ///< where G-rays run
  bool deviceSharesCores = false;  ///< that device runs on the CPU's own
  bool photonRays = false;         ///< photons bounce as C-rays
  double coneShare = 0.0;          ///< of the samples, whose far field is gathered by cones
};

class Session {
 public:
  /// Starts what the model and the settings require, and nothing else. Throws Error.
  /// `layers`: those that picture() will be asked for. Without the model's voxels every sample is
  /// exact, unless voxelsAreComing() is said.
  Session(std::shared_ptr<const Model> model, const Camera& camera, const RenderSettings& settings,
          const PictureLayers& layers = {});
  ~Session();

  /// Asked every few milliseconds, by captures between tiles; false ends what is under way.
  using KeepGoing = std::function<bool()>;

  /// Works until the goal is reached or keepGoing says no. Called again it goes on where it
  /// stopped, in the middle of a pass too; only the time inside counts.
  void run(const KeepGoing& keepGoing = [] { return true; });
  /// Asked by any thread while paths wait for pages, which may take a minute: true gives up the
  /// samples or photons under way. A session that goes on takes them again.
  void giveUpWhen(const std::function<bool()>& ask) {
    samples_.setGiveUp(ask);
    light_.setGiveUp(ask);
  }
  /// The next piece of work, if there is any, for as long as keepGoing lets it; but of the viewer
  /// at least the coarsest picture of all tiles after a change. `pointer`: see TileScheduler.
  std::optional<Work> step(const KeepGoing& keepGoing, vec2 pointer);
  /// There is nothing to do.
  bool resting() const { return !plan(state()); }
  /// Whether the samples, the seconds or the error of the settings are reached.
  bool goalReached() const { return goal_.reached(samplesDone(), report_.renderSeconds); }
  /// Share of the goal that is done, [0, 1].
  double progress() const;

  // What has changed: session_edit.cpp. Of interactive sessions.

  /// The model has changed as ModelEditor::apply() said; `camera` is the one to look through. Takes
  /// a millisecond or so: photons start anew after the first preview.
  void follow(const Invalidation& what, const Camera& camera);
  /// Called before photons start anew: ModelEditor::updateVoxelValues().
  void beforeLight(std::function<void()> action) { light_.setValues(std::move(action)); }
  /// Another size of the picture; samples start anew, photons stay.
  void resize(std::uint32_t width, std::uint32_t height);
  /// Voxels are being built: until setVoxels() there are previews alone.
  void voxelsAreComing();
  /// Voxels with a device that reads them, made by any thread (makeLightDevice). What was there
  /// before serves previews until photons have been shot.
  void setVoxels(std::shared_ptr<const asvo::Tree> tree, std::unique_ptr<GRayTracer> device);
  /// Aims photons at the present camera if they were aimed elsewhere; they start anew then. The
  /// frame so far goes on as the preview until they are there.
  bool aimAgain();

  // With other machines: session_shared.cpp.

  /// From now on the frame's samples are this one's to take, and photons to shoot; it outlives the
  /// session's work. To be called before the first work.
  void shareSamples(SampleSharer* sharer) {
    sharer_ = sharer;
    sharePhotons(sharer);
  }
  /// Photons alone.
  void sharePhotons(PhotonSharer* sharer) { light_.share(sharer); }
  /// From now on others take samples of the frame, too; of the viewer's. Null: no longer.
  void helpBy(SampleHelper* helper);
  /// A unit of the frame that someone else takes: see TileScheduler::lend().
  std::optional<TileUnit> lend() { return frame_->tiles.lend(); }
  std::optional<TileUnit> lendCoarse() { return frame_->tiles.lendCoarse(); }
  void release(const TileUnit& unit) { frame_->tiles.release(unit); }
  /// Grows when the frame begins anew: units of before are void.
  std::uint32_t frameNumber() const { return frameNumber_; }
  /// Samples read the light that there is now.
  bool readsLight() const;
  /// Photons start anew, aimed as another session's.
  void startLight(const std::optional<Camera>& aim);
  /// The light that samples read, of so many photons; nothing where none is read. False if
  /// keepGoing said no.
  bool makeLight(std::uint64_t photons, const KeepGoing& keepGoing);
  /// Takes whole samples of tiles as if they were the frame's next, and adds them to no frame.
  /// False, and nothing, if keepGoing says no.
  bool takeUnits(std::span<const TileUnit> units, const KeepGoing& keepGoing, TakenSamples& out);
  /// Adds such samples to the frame, whose tiles have them next, or have lent them.
  void addTaken(std::span<const TileUnit> units, const TakenSamples& taken);
  /// Shares of exact samples by tile that the dial has chosen; none without a dial.
  std::vector<double> tileShares() const;
  void setTileShares(std::span<const double> shares);
  void setTileShare(std::size_t tile, double share) { frame_->dial->setShare(tile, share); }
  /// Of the samples, whose far field is gathered by cones: as the settings say, or was chosen.
  double coneShare() const { return report_.coneShare; }
  /// From now on so many: what a checkpoint or machine 0 began with. Of no effect where samples are
  /// exact.
  void setConeShare(double share);
  /// What the frame keeps of a sample.
  const FrameBuffers& buffers() const { return *frame_; }
  /// Paths that wait for pages together, which is why they had better be taken together; 0 where
  /// all pages fit in memory.
  std::size_t pathsAtOnce() const { return loads_ ? samples_.pathsAtOnce(pixels()) : 0; }
  /// Whether each sample needs maps of its own, which machines had better make of few.
  bool makesMapsOfSamples() const { return caustics_ != nullptr; }

  // What there is.

  /// What is to be shown: the frame under way, or the preview. Read what its tiles have, no more.
  const FrameBuffers& shownFrame() const { return previewing() ? *preview_ : *frame_; }
  ShownOptions shownOptions() const;
  bool previewing() const { return preview_ && awaitsLight(state()); }
  const Accumulator& frame() const { return frame_->sums; }
  /// Samples that every pixel has.
  std::uint32_t samplesDone() const { return frame_->tiles.samplesDone(); }
  /// Accumulator::estimatedError(); negative before two samples. Reads every pixel and its
  /// neighbours, some 20 ms at 640x360; only each stride-th pixel of each stride-th row if told so.
  /// With a dial and stride 1 it is that of the picture shown, with its bias: by
  /// estimatePictureError(), or UnfilteredPixels without a denoiser; negative while they can't
  /// tell.
  double estimatedError(std::uint32_t stride = 1) const;
  /// A pair of a guess and an exact sample, beside the frame: for estimates of the bias. Nothing if
  /// a page that it needs is not there and comes behind.
  std::optional<PathSample> probe(std::uint32_t x, std::uint32_t y, std::uint32_t sample) const;
  const VoxelLight& light() const { return light_; }
  const LightSet& lights() const { return *lights_; }
  const CameraRays& cameraRays() const { return *camera_; }
  const RayScene& rays() const { return *model_->rays; }

  // What comes out: session_out.cpp.

  /// The frame so far: R, G, B (filtered, if the settings ask for it), and the layers. Every pixel
  /// must have a sample.
  Picture picture();
  /// Chooses the denoiser of the next picture() anew, as if the settings had this limit of seconds;
  /// those that it will take, about.
  double denoiseWithin(double seconds);
  SessionReport report() const;
  /// What was planned and done while paths waited for pages; null unless the settings ask for it,
  /// and where none waited.
  const TrafficRecord* traffic() const { return traffic_.get(); }
  /// Writes all that is needed to go on later with the same bits: see checkpoint.h. `key` names the
  /// job. Throws Error(kOutput).
  void saveCheckpoint(const std::filesystem::path& path, std::uint64_t key, std::uint32_t frame);
  /// Goes on from such a file. To be called before run(). Throws Error(kInput).
  void restoreCheckpoint(CheckpointReader& reader);

 private:
  static constexpr std::uint32_t kLooks = LookImage::kMost;  ///< of the viewer's frames

  SessionState state() const;
  void perform(const Work& work, const KeepGoing& keepGoing, vec2 pointer);
  void renewLight();
  void lookAtGoal();
  void takeSamples(const KeepGoing& keepGoing, vec2 pointer);
  void keepTimeFree();
  bool corrected() const;
  std::uint32_t nextLook() const;
  void shootPhotons(std::uint64_t photons, const KeepGoing& keepGoing);
  std::uint64_t photonsBefore(std::uint64_t photons) const;
  void makeFrames();
  void makeCamera();
  void makeCaustics();
  void makeWalks();
  void makeSources();
  SampleSource source(const LightCache* cache, CausticMaps* caustics);
  double wantedConeShare();
  std::uint32_t samplesAtOnce() const;
  void restartFrames();
  bool inPages() const { return model_->rays->parts().paged != nullptr; }
  const hccm::PagedMesh* behind() const;
  bool awaitPages(std::uint64_t count) const;
  void shootAsPagesCome(std::uint64_t photons, const KeepGoing& keepGoing);
  std::uint64_t pixels() const { return std::uint64_t{settings_.width} * settings_.height; }
  std::vector<std::span<std::byte>> sums();
  std::vector<vec3> shown();
  std::vector<vec3> shownBy(DenoiseMethod method) const;
  void addLayers(const UnfilteredPixels& pixels, std::uint32_t x, std::uint32_t y,
                 std::vector<float>& values) const;

  RenderSettings settings_;
  PictureLayers layers_;
  std::shared_ptr<const Model> model_;
  Camera view_;
  DenoiseMethod method_;
  Goal goal_;
  VoxelLight light_;
  SampleTaker samples_;
  SessionReport report_;
  std::uint32_t turn_ = 0;           ///< pieces of work so far
  std::optional<double> coneShare_;  ///< setConeShare()
  std::unique_ptr<LightSet> lights_;
  std::unique_ptr<CameraRays> camera_;
  std::unique_ptr<CausticMaps> caustics_;          ///< null where the scene has none
  std::unique_ptr<TrafficRecord> traffic_;         ///< if it was asked for
  std::unique_ptr<GatherPlan> gathers_;            ///< of the frame's cones, likewise
  std::unique_ptr<LoadChoice> loads_;              ///< where paths wait for pages; else null
  std::unique_ptr<const WalkTracer> walks_;        ///< traces photons, importons, probes
  std::unique_ptr<FrameBuffers> frame_, preview_;  ///< preview_: the viewer's alone
  SampleSource source_, previewSource_;
  SampleSharer* sharer_ = nullptr;  ///< not ours
  SampleHelper* helper_ = nullptr;  ///< likewise
  std::uint32_t frameNumber_ = 0;
  std::uint32_t lightTries_ = 0;  ///< that a page was missing in, since photons were shot
};

}  // namespace trex
