#include "src/machines/server.h"

#include <algorithm>

#include "src/core/clock.h"
#include "src/core/hash.h"
#include "src/frame/lattice.h"
#include "src/machines/sample_bytes.h"
#include "src/scene/look_file.h"

namespace trex::machines {
namespace {

constexpr std::size_t kMostLentUnits = 1u << 16;    // of a loan that is no mistake
constexpr std::uint32_t kMostSide = 1u << 15;       // of a window
constexpr std::uint64_t kMostPixels = 1u << 27;     // likewise
constexpr std::uint32_t kMostNumber = 0x7fffffffu;  // likewise, of a pixel
constexpr std::uint64_t kSentPhotons = 1u << 11;    // divides all batches of guides

/// A session that makes no picture of its own; what samples are is the window's.
RenderSettings withoutWindow(RenderSettings s) {
  s.samples = 0;
  s.seconds = s.error = 0.0;
  s.denoise = Denoise::kOff;
  s.interactive = false;
  s.rayMemory = 0;
  return s;
}

}  // namespace

/// What the window shows, as far as this machine has followed it.
struct Server::Window {
  ModelEditor editor;
  RenderSettings settings;
  std::unique_ptr<Session> session;
  std::uint32_t edit = 0, edits = 0;  ///< edits: of views_, when it was followed
  std::optional<Aim> aim;             ///< whose light is to be there; none before the first
  std::uint32_t light = 0;            ///< that it has begun
};

std::optional<Serve> Server::awaitServe(const Welcome& welcome) {
  if (!welcome.window) {
    fail(ExitCode::kFailed,
         "machine 0 has no window: trex worker serves trex view, all processes of trex render are "
         "trex render");
  }
  const auto heard = next();
  if (!heard) return {};
  if (heard->kind != Kind::kServe) fail(ExitCode::kFailed, "machine 0: did not say what it shows");
  return decode<Serve>(heard->body);
}

void Server::run(std::shared_ptr<Model> model, std::shared_ptr<asvo::Tree> voxels,
                 const ModelOptions& options, RenderSettings settings, std::uint64_t digest) {
  settings = withoutWindow(settings);
  Window window{ModelEditor(model, options), settings, nullptr, 0, 0, {}, 0};
  window.session = std::make_unique<Session>(window.editor.shared(), window.editor.look().camera,
                                             window.settings);
  window.session->beforeLight([&] { window.editor.updateVoxelValues(); });
  if (voxels) {
    window.editor.setSourceVoxels(voxels);
    window.session->setVoxels(
        voxels, makeLightDevice(model->scene.materials, model->scene.images, *voxels, settings));
  }
  sayReady(digest);
  try {
    while (const auto heard = next()) {
      const ByteView body(heard->body);
      // Of what a later edit makes void nothing is done.
      const bool isVoid = heard->views != views_;
      switch (heard->kind) {
        case Kind::kEdit:
          window.edits = heard->views;
          if (!isVoid) follow(window, decode<Edit>(body));
          break;
        case Kind::kAim:
          window.aim = decode<Aim>(body);
          if (!isVoid) goOnWithLight(window);
          break;
        case Kind::kLent: {
          const auto lent = decode<Lent>(body);
          if (isVoid || !take(window, lent, heard->passes)) tell(NoLoan{lent.id});
          break;
        }
        default:
          throw MessageError("it is not of a window");
      }
    }
  } catch (const MessageError& e) {
    fail(ExitCode::kFailed, "machine 0: a message can't be read: {}", e.what());
  }
}

void Server::follow(Window& window, const Edit& edit) {
  if (edit.width < 1 || edit.height < 1 || edit.width > kMostSide || edit.height > kMostSide ||
      std::uint64_t{edit.width} * edit.height > kMostPixels) {
    throw MessageError("a window has no such size");
  }
  if (edit.width != window.settings.width || edit.height != window.settings.height) {
    window.settings.width = edit.width;
    window.settings.height = edit.height;
    window.session->resize(edit.width, edit.height);
  }
  const Look look = parseLook(edit.look, "the look of machine 0", window.editor.model().scene,
                              window.editor.source());
  Invalidation what = window.editor.apply(look);
  what.frame = true;
  window.session->follow(what, look.camera);
  window.edit = edit.number;
  // A light that this edit makes invalid will be another.
  if (what.flux) window.aim.reset();
  goOnWithLight(window);
}

/// Makes the light that was asked for, as far as no edit comes.
void Server::goOnWithLight(Window& window) {
  if (!window.aim) return;
  Session& session = *window.session;
  const auto going = [this, begun = window.edits] { return views_ == begun; };
  if (window.aim->light != window.light) startLight(window);
  if (!session.makeLight(window.aim->photons, going)) return;
  if (session.light().photons() != window.aim->photons) return;
  tell(Lit{window.aim->light, window.aim->photons});
}

/// Photons start anew, in voxels of what is visible.
void Server::startLight(Window& window) {
  Session& session = *window.session;
  ModelEditor& editor = window.editor;
  if (editor.voxelsOutdated()) {
    const ModelEditor::VoxelJob job = editor.voxelJob();
    const auto tree = job.build();
    editor.takeVoxels(tree, job.shape);
    const Scene& scene = editor.model().scene;
    session.setVoxels(tree, makeLightDevice(scene.materials, scene.images, *tree, window.settings));
  }
  const asvo::Tree* voxels = session.light().presentVoxels();
  if (voxels == nullptr || voxels->info.leafCount != window.aim->leaves) {
    fail(ExitCode::kFailed, "its voxels are not those of machine 0: give it the memory they need");
  }
  LookLight light;
  parseLook(window.aim->aim, "the light of machine 0", editor.model().scene, editor.source(),
            &light);
  session.sharePhotons(window.aim->send != 0 ? this : nullptr);
  session.startLight(light.aim);
  window.light = shotLight_ = window.aim->light;
}

/// In parts that no batch of the window's cuts, so that they travel while the next ones are shot.
std::optional<ShotPhotons> Server::shoot(const PhotonBatch& batch, const ShootHere& here,
                                         const std::function<bool()>& keepGoing) {
  PhotonParts all(batch);
  for (std::uint64_t first = batch.first; first < batch.end;) {
    const std::uint64_t end = std::min(batch.end, (first / kSentPhotons + 1) * kSentPhotons);
    if (!keepGoing()) return {};
    auto shot = here(first, end);
    if (!shot) return {};
    tell(Shot{shotLight_, 0, batch.first, first, end, 0.0, *shot});
    all.add(first, end, std::move(*shot));
    first = end;
  }
  return all.joined();
}

/// False if it comes to nothing.
bool Server::take(Window& window, const Lent& lent, std::uint32_t begun) {
  Session& session = *window.session;
  const bool sameLight = lent.photons == 0 || (lent.light == window.light && session.readsLight() &&
                                               session.light().photons() == lent.photons);
  if (lent.edit != window.edit || !sameLight) return false;
  const bool dialled = session.buffers().dial != nullptr;
  const std::size_t tiles = session.buffers().tiles.tiles().size();
  if (lent.units.empty() || lent.units.size() > kMostLentUnits)
    throw MessageError("a loan has no units");
  if (lent.shares.size() != (dialled ? lent.units.size() : 0)) {
    throw MessageError("a loan has not a share a unit");
  }
  if (!(lent.coneShare >= 0.0 && lent.coneShare <= 1.0)) {
    throw MessageError("a share of cones is not 0 to 1");
  }
  std::vector<TileUnit> units;
  for (const LentUnit& unit : lent.units) {
    if (unit.tile >= tiles || unit.sample > kMostNumber || unit.firstCell >= unit.endCell ||
        unit.endCell > lattice::kCells) {
      throw MessageError("a loan has a unit that there is not");
    }
    units.push_back({.tile = unit.tile,
                     .sample = unit.sample,
                     .firstCell = unit.firstCell,
                     .endCell = unit.endCell});
  }
  for (std::size_t i = 0; i < lent.shares.size(); ++i) {
    if (!(lent.shares[i] >= 0.0 && lent.shares[i] <= 1.0))
      throw MessageError("a share is not 0 to 1");
    session.setTileShare(units[i].tile, lent.shares[i]);
  }
  session.setConeShare(lent.coneShare);
  const double start = secondsNow();
  TakenSamples taken;
  passBegun_ = begun;
  if (!session.takeUnits(
          units, [this] { return passes_ == passBegun_; }, taken)) {
    return false;
  }
  Result result{.pass = lent.edit, .id = lent.id, .seconds = secondsNow() - start};
  result.samples = packSamples(taken.samples, lent.contents, sendsShort());
  sendResult(std::move(result), taken.rays, session);
  return true;
}

std::uint64_t windowDigest(const std::filesystem::path& model) {
  return model.empty() ? 0 : hashFile(model);
}

std::string joinArguments(const std::vector<std::string>& arguments) {
  std::string joined;
  for (const std::string& one : arguments) joined += one + '\0';
  return joined;
}

std::vector<std::string> splitArguments(const std::string& joined) {
  std::vector<std::string> arguments;
  for (std::size_t at = 0; at < joined.size();) {
    const std::size_t end = joined.find('\0', at);
    if (end == std::string::npos) throw MessageError("an argument does not end");
    arguments.push_back(joined.substr(at, end - at));
    at = end + 1;
  }
  return arguments;
}

}  // namespace trex::machines
