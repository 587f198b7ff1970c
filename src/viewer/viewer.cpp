#include "src/viewer/viewer.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <exception>

#include "hccmesh/page_cache.h"
#include "src/core/error.h"
#include "src/core/log.h"
#include "src/session/preflight.h"
#include "src/viewer/viewer_parts.h"

namespace trex {
namespace {

PictureLayers viewerLayers(bool dial) {
  PictureLayers layers = layersFromNames({"all"});
  layers.direct = layers.indirect = false;  // no view shows them
  layers.rayClass = true;
  layers.exactShare = dial;  // else it says nothing
  return layers;
}

}  // namespace

const std::vector<std::string>& viewModeNames() {
  static const std::vector<std::string> names = {"beauty",   "albedo",   "normal",
                                                 "depth",    "variance", "sampleCount",
                                                 "rayClass", "voxels",   "photons"};
  return names;
}

Viewer::Viewer(const ViewerOptions& options) : impl_(std::make_unique<Impl>(options)) {
  if (!options.input.empty()) open(options.input);
}

Viewer::~Viewer() {
  impl_->background.wait();
  impl_->keepRecovery();
}

void Viewer::open(const std::filesystem::path& input) { impl_->open(input); }
OpenPhase Viewer::phase() const { return impl_->phase; }
std::string Viewer::message() const { return impl_->message; }
std::optional<ExitCode> Viewer::problem() const {
  return impl_->phase == OpenPhase::kFailed ? impl_->failureCode : impl_->lost;
}
const std::filesystem::path& Viewer::input() const { return impl_->input; }
const ScreenImage& Viewer::screen() const { return impl_->screen.image(); }
ViewState& Viewer::state() { return impl_->state; }
const Scene& Viewer::scene() const { return impl_->editor->model().scene; }
const Look& Viewer::look() const { return impl_->history->current(); }
const Look& Viewer::sourceLook() const { return impl_->startLook; }
LookHistory& Viewer::history() { return *impl_->history; }
bool Viewer::unsavedEdits() const { return impl_->history && impl_->history->unsaved(); }
StepReport Viewer::step(double seconds) { return impl_->step(seconds); }

void Viewer::edit(const Look& look, bool commit, const std::string& what) {
  impl_->exposureSet |= look.exposure != impl_->history->current().exposure;
  impl_->history->set(look, commit, what);
  impl_->lookChanged = true;
}

void Viewer::undo() {
  if (!impl_->history->canUndo()) return;
  impl_->history->undo();
  impl_->lookChanged = true;
}

void Viewer::redo() {
  if (!impl_->history->canRedo()) return;
  impl_->history->redo();
  impl_->lookChanged = true;
}

bool Viewer::idle() const { return impl_->idle(); }

void Viewer::resize(std::uint32_t width, std::uint32_t height) {
  RenderSettings& s = impl_->options.settings;
  width = std::max(width, 1u);
  height = std::max(height, 1u);
  if (s.width == width && s.height == height) return;
  s.width = width;
  s.height = height;
  if (!impl_->session) return;
  impl_->tellHelper();
  impl_->session->resize(width, height);
  if (impl_->exact) impl_->exact->resize(width, height);
  impl_->restartFrame(false);
}

// ---- opening ----

void Viewer::Impl::open(const std::filesystem::path& path) {
  keepRecovery();
  opening = path;
  phase = session ? phase : OpenPhase::kImporting;
  message = fmt::format("Opening {}", path.filename().string());
  ModelOpening o;
  o.input = path;
  if (!session && path == options.input) o.remote = options.remote;
  o.cacheBytes = options.cacheBytes;
  o.settings = options.settings;
  o.settings.interactive = true;
  o.options.useStale = options.useStale;
  o.options.model.voxels = options.settings.exact < 1.0;
  o.options.model.voxelsInTheDark = true;
  o.options.model.voxelDepth =
      voxelDepthFor(std::uint64_t{options.settings.width} * options.settings.height);
  o.takeMeshes = [this](std::shared_ptr<Model> model, const ModelOptions& made) {
    takeMeshes(std::move(model), made);
  };
  o.takeVoxels = [this](std::shared_ptr<asvo::Tree> tree,
                        std::shared_ptr<std::unique_ptr<GRayTracer>> device) {
    takeSourceVoxels(std::move(tree), std::move(*device));
  };
  try {
    o.options.import = options.import;
    for (const std::string& v : options.volumes) {
      o.options.import.volumes.push_back(parseVolume(v));
    }
    o.options.import.maxMemory = options.settings.maxMemory;
    o.options.import.textures =
        textureCacheFor(options.settings, std::filesystem::temp_directory_path());
    if (!options.environment.empty()) o.options.environment = parseEnvironment(options.environment);
  } catch (const Error& e) {
    failed(e.code(), e.what());
    return;
  }
  background.start(openingJob(std::move(o)), [this](std::exception_ptr e) { openingFailed(e); });
}

void Viewer::Impl::failed(ExitCode code, const std::string& why) {
  failureCode = code;
  message = why;
  logError("{}", why);
  if (!session) phase = OpenPhase::kFailed;
}

void Viewer::Impl::openingFailed(std::exception_ptr problem) {
  try {
    std::rethrow_exception(problem);
  } catch (const Error& e) {
    failed(e.code(), e.what());
  } catch (const std::bad_alloc&) {
    failed(ExitCode::kMemoryOrDevice, "out of memory while opening; see --max-memory");
  } catch (const std::exception& e) {
    failed(ExitCode::kFailed, e.what());
  }
}

void Viewer::Impl::takeMeshes(std::shared_ptr<Model> model, const ModelOptions& made) {
  exact.reset();
  if (session) leaveHelper();
  session.reset();
  editor.reset();
  state = ViewState{};
  lost.reset();
  input = opening;
  modelOptions = made;
  editor = std::make_unique<ModelEditor>(model, made);
  startLook = editor->source();
  if (!options.camera.empty()) startLook.camera = parseCamera(options.camera, model->scene);
  Look first = startLook;
  LookLight ignored;
  if (!options.edits.empty()) {
    first = readLook(options.edits, model->scene, startLook, &ignored);
    options.edits.clear();  // of this model alone
  }
  exposureSet = first.exposure != 0.0f;
  history = std::make_unique<LookHistory>(first);
  editor->apply(first);
  RenderSettings settings = options.settings;
  settings.interactive = true;
  settings.samples = std::max(settings.samples, 1u);
  session = std::make_unique<Session>(editor->shared(), first.camera, settings,
                                      viewerLayers(settings.dial));
  session->beforeLight([this] { editor->updateVoxelValues(); });
  session->helpBy(options.helper);
  const hccm::PagedMesh* pages = session->rays().parts().paged.get();
  if (pages != nullptr && pages->fetcher() != nullptr && !pages->cache().holdsAll()) {
    session->sharePhotons(options.remote->photons);
  }
  if (made.voxels) session->voxelsAreComing();
  phase = made.voxels ? OpenPhase::kVoxels : OpenPhase::kReady;
  message = made.voxels ? "Building voxels" : "";
  shownLook = first;
  tellHelper();
  restartFrame(false);
}

void Viewer::Impl::takeSourceVoxels(std::shared_ptr<asvo::Tree> tree,
                                    std::unique_ptr<GRayTracer> device) {
  editor->setSourceVoxels(tree);
  phase = OpenPhase::kReady;
  message.clear();
  if (editor->voxelsOutdated()) {
    session->voxelsAreComing();
    wantVoxels = true;
    return;
  }
  session->setVoxels(std::move(tree), std::move(device));
}

/// Voxels of what is visible now, and a device that reads them.
void Viewer::Impl::rebuildVoxels() {
  wantVoxels = false;
  message = "Building voxels of what is visible";
  const Scene& scene = editor->model().scene;
  background.start(
      [this, job = editor->voxelJob(), materials = scene.materials, &images = scene.images,
       settings = options.settings](const std::function<void(Background::Delivery)>& deliver) {
        auto tree = job.build();
        auto device = std::make_shared<std::unique_ptr<GRayTracer>>(
            makeLightDevice(materials, images, *tree, settings));
        deliver([this, tree, device, shape = job.shape] {
          message.clear();
          if (!editor->takeVoxels(tree, shape)) {
            wantVoxels = true;
            return;
          }
          session->setVoxels(tree, std::move(*device));
        });
      },
      [this](std::exception_ptr e) { openingFailed(e); });
}

// ---- steps ----

bool Viewer::Impl::idle() const {
  if (background.hasDelivery()) return false;
  if (lost) return true;
  if (lookChanged) return false;
  if (!session) return !background.busy();
  if (wantVoxels && !background.busy()) return false;
  if (restyled()) return false;
  if (state.paused) return screen.showsGeneration();
  return session->resting() && exactRests() && !wantsAim() &&
         screen.complete(*session, exact.get(), state);
}

bool Viewer::Impl::exactRests() const { return !state.split || !exact || exact->resting(); }

/// The state of the screen has changed since it was painted.
bool Viewer::Impl::restyled() const {
  const ViewState& a = state;
  const ViewState& b = seenState;
  return a.mode != b.mode || a.voxelLevel != b.voxelLevel || a.split != b.split ||
         a.splitAt != b.splitAt || a.selectedObject != b.selectedObject;
}

bool Viewer::Impl::wantsAim() const { return aimAt > 0.0; }

void Viewer::Impl::restartFrame(bool hold) {
  screen.restart(hold);
  bias = BiasEstimate{};
  noiseEstimate = NoiseEstimate{};
  splitError = -1.0;
}

/// The look that was asked for becomes the one that is rendered.
void Viewer::Impl::applyLook() {
  lookChanged = false;
  const Look& look = history->current();
  const bool moved = look.camera != shownLook.camera;
  const Invalidation what = editor->apply(look);
  Invalidation all = what;
  all.frame |= moved;
  if (what.voxelShape && editor->voxelsOutdated()) {
    session->voxelsAreComing();
    wantVoxels = true;
  }
  if (all.frame) {
    tellHelper();
    session->follow(all, look.camera);
    if (exact) exact->follow(all, look.camera);
    restartFrame(false);
  }
  if (moved) aimAt = secondsNow() + kAimDelay;
  shownLook = look;
  recoveryDue = true;
}

StepReport Viewer::Impl::step(double seconds) {
  StepReport report;
  const double start = secondsNow(), deadline = start + seconds;
  background.take();
  if (!session || lost) return report;
  try {
    work(deadline, report);
  } catch (const Error& e) {
    if (!(e.code() == ExitCode::kMemoryOrDevice && leaveDevice(e)) && !loseModel(e)) throw;
  }
  report.seconds = secondsNow() - start;
  if (recoveryDue && secondsNow() > nextRecovery) keepRecovery();
  return report;
}

void Viewer::Impl::work(double deadline, StepReport& report) {
  if (lookChanged) applyLook();
  if (wantVoxels && !background.busy() && editor->hasSourceVoxels()) rebuildVoxels();
  if (state.split && !exact) startExact();
  const bool wasPreview = session->previewing();
  if (wantsAim() && secondsNow() >= aimAt) {
    aimAt = 0.0;
    if (session->aimAgain()) restartFrame(true);
  }
  screen.prepare(*session, state);
  const bool pausedNow = state.paused && screen.showsGeneration();
  // What the screen needs is kept free; the first picture of a change is worth more than samples.
  const bool fresh = !screen.showsGeneration();
  const double left = deadline - secondsNow();
  // A first picture also ends a little early: the window must show it within the budget.
  const double reserve = fresh                ? std::min(screenSeconds * 1.3 + 0.006, 0.6 * left)
                         : screen.ready()     ? std::min(screen.finishSeconds(), 0.7 * left)
                         : screen.filtering() ? 0.4 * left
                                              : std::min(0.004, 0.2 * left);
  const double half = state.split && exact && !fresh ? 0.5 * (deadline - secondsNow()) : 0.0;
  if (!pausedNow) {
    const double until = deadline - reserve - half;
    const auto mark = secondsNow();
    const SessionReport before = session->report();
    const auto done = session->step([&] { return secondsNow() < until; }, state.pointer);
    report.kind = kindOf(done, fresh);
    rates.add(before, session->report(), secondsNow() - mark);
    if (wasPreview && !session->previewing()) restartFrame(true);
    if (half > 0.0) exact->step([&] { return secondsNow() < deadline - reserve; }, state.pointer);
    if (!fresh && done && done->kind == Work::Kind::kSamples) probe();
  }
  const double mark = secondsNow();
  report.newPicture = screen.update(*session, exact.get(), shownLook, state,
                                    [&] { return deadline - secondsNow(); });
  seenState = state;
  report.coarseComplete = fresh && screen.showsGeneration();
  if (report.newPicture) {
    const double taken = std::min(secondsNow() - mark, 0.02);
    screenSeconds += 0.25 * (taken - screenSeconds);
  }
  const bool whole = state.mode == ViewMode::kBeauty && screen.spacing() == 1;
  if (!exposureSet && whole && !session->previewing()) setExposure();
}

StepReport::Kind Viewer::Impl::kindOf(const std::optional<Work>& work, bool fresh) const {
  using Kind = StepReport::Kind;
  if (!work) return Kind::kIdle;
  switch (work->kind) {
    case Work::Kind::kPreview:
      return Kind::kPreview;
    case Work::Kind::kLight:
    case Work::Kind::kPhotons:
      return Kind::kLight;
    case Work::Kind::kSamples:
      break;
  }
  return fresh ? Kind::kCoarse : Kind::kRefine;
}

/// The first whole picture sets the exposure, unless someone has.
void Viewer::Impl::setExposure() {
  exposureSet = true;
  Look look = history->current();
  look.exposure = std::round(suitableExposure() * 10.0f) / 10.0f;
  history->set(look, false, "exposure");
  shownLook.exposure = look.exposure;
}

void Viewer::Impl::startExact() {
  RenderSettings settings = options.settings;
  settings.interactive = true;
  settings.exact = 1.0;
  settings.dial = false;
  settings.denoise = Denoise::kOff;
  exact = std::make_unique<Session>(editor->shared(), shownLook.camera, settings, PictureLayers{});
}

/// A lost device: the C++ tracer takes over, if the user left the choice to us.
bool Viewer::Impl::leaveDevice(const Error& e) {
  if (options.settings.device != RenderSettings::kBestDevice || deviceLeft) return false;
  deviceLeft = true;
  logError("{}; going on without the device", e.what());
  options.settings.device = RenderSettings::kNoDevice;
  session->voxelsAreComing();
  wantVoxels = true;
  return true;
}

/// Pages of the model can't be read any more: what is shown stays. False if it is not elsewhere.
bool Viewer::Impl::loseModel(const Error& e) {
  const hccm::PagedMesh* pages = editor->model().rays->parts().paged.get();
  if (pages == nullptr || pages->fetcher() == nullptr) return false;
  lost = e.code();
  message = fmt::format("{}; what is shown stays, and it and the edits can be saved", e.what());
  logError("{}", message);
  return true;
}

/// Two paired samples of a pixel far beyond those of the frame: the product of their differences
/// estimates the square of the guess's bias there.
void Viewer::Impl::probe() {
  if (options.settings.exact > 0.0 || session->coneShare() > 0.0 || !session->lights().anyPower()) {
    return;
  }
  const FrameBuffers& frame = session->shownFrame();
  if (frame.tiles.samplesDone() < 2) return;
  const std::uint32_t width = session->frame().width(), height = session->frame().height();
  for (int i = 0; i < 2; ++i) {
    const std::uint32_t number = bias.count++;
    const std::uint32_t pixel = hash32(number ^ 0x5bd1e995u) % (width * height);
    const std::uint32_t x = pixel % width, y = pixel / width;
    const auto a = session->probe(x, y, 0x40000000u + 2 * number),
               b = session->probe(x, y, 0x40000001u + 2 * number);
    if (!a || !b) continue;
    const dvec3 da(a->exact - a->guess), db(b->exact - b->guess), mean = frame.sums.mean(x, y);
    if (!isFinite(vec3(da)) || !isFinite(vec3(db))) continue;
    const dvec3 bound = mean * mean + 0.01 * bias.meanSquare + 1e-12;
    bias.meanSquare += (glm::dot(mean, mean) / 3.0 - bias.meanSquare) / (number + 1.0);
    const dvec3 product = da * db / bound;
    bias.sum += (product.x + product.y + product.z) / 3.0;
  }
}

}  // namespace trex
