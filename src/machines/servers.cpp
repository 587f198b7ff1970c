#include "src/machines/servers.h"

#include <algorithm>
#include <chrono>

#include "src/core/clock.h"
#include "src/frame/lattice.h"
#include "src/machines/sample_bytes.h"
#include "src/scene/look_file.h"
#include "src/session/session.h"

namespace trex::machines {
namespace {

constexpr double kLeastBetween = 0.01, kMostBetween = 0.5;  // seconds between visits
constexpr double kLoanVisits = 1.5;                         // that a loan is to last
constexpr auto kAwait = std::chrono::milliseconds(2);
constexpr std::uint64_t kMostLent = std::uint64_t{1} << 18;  // of a loan: its result is a message

std::uint32_t contentsFor(const Session& session) {
  return contentsOf(session.buffers(), session.shownOptions().pairs);
}

/// Samples of a unit.
std::uint64_t samplesOf(const Tile& tile, const TileUnit& unit) {
  std::uint64_t count = 0;
  if (unit.firstCell == 0 && unit.endCell == lattice::kCells) {
    return std::uint64_t{tile.width} * tile.height;
  }
  for (std::uint32_t cell = unit.firstCell; cell < unit.endCell; ++cell) {
    const lattice::Place at = lattice::kPlaces[cell];
    const auto along = [](std::uint32_t side, std::uint32_t first) {
      return side > first ? (side - first + lattice::kSide - 1) / lattice::kSide : 0;
    };
    count += std::uint64_t{along(tile.width, at.x)} * along(tile.height, at.y);
  }
  return count;
}

}  // namespace

Servers::Servers(const Link::MakeWire& make, const Hello& self) : loans_(0), leader_(make, self) {
  machines_.resize(leader_.machines());
  loans_ = Loans(leader_.machines());
}

Servers::~Servers() { finish(static_cast<int>(ExitCode::kFailed)); }

void Servers::finish(int code) {
  leader_.stop();
  leader_.finish(code);
}

void Servers::welcome(bool local, std::vector<ServedFile> files, const Serve& serve,
                      std::uint64_t digest) {
  leader_.workFor(this, serve);
  leader_.welcome(local, true, std::move(files));
  leader_.expect(digest);
}

std::uint32_t Servers::findHolder(const std::function<bool()>& keepGoing) {
  leader_.waitForGreetings(keepGoing);
  const std::vector<MachineRow> rows = leader_.rows();
  const auto nameOf = [&](std::uint32_t i) {
    return fmt::format("machine {} ({}): {}", i, rows[i].host, rows[i].model);
  };
  std::uint32_t holder = 0;
  for (std::uint32_t i = 1; i < rows.size(); ++i) {
    if (rows[i].model.empty()) continue;
    if (holder == 0) holder = i;
    if (rows[i].modelDigest == rows[holder].modelDigest) continue;
    fail(ExitCode::kUsage, "two machines have different models, {} and {}; name one",
         nameOf(holder), nameOf(i));
  }
  if (holder != 0) return holder;
  fail(ExitCode::kUsage,
       "trex view under mpirun: name the model, here or at the machine that has it: mpirun -n 1 "
       "trex view : -n 1 trex worker MODEL.trex");
}

void Servers::welcomeTo(std::uint32_t holder, std::vector<ServedFile> files, const Serve& serve) {
  {
    const std::lock_guard lock(mutex_);
    holder_ = holder;
  }
  leader_.workFor(this, serve);
  leader_.welcomeTo(holder, std::move(files));
  leader_.expect(0);
}

// ---- what is heard, by the link's thread ----

void Servers::ready(std::uint32_t machine) {
  const std::lock_guard lock(mutex_);
  machines_[machine].ready = true;
  if (edit_) leader_.send(machine, *edit_);
  if (aim_) sendAim(machine);
}

void Servers::lost(std::uint32_t machine) {
  const std::lock_guard lock(mutex_);
  machines_[machine] = {};
  lost_.push_back(machine);
  changed_.notify_all();
}

void Servers::result(std::uint32_t machine, Result result) {
  const std::lock_guard lock(mutex_);
  if (!machines_[machine].ready) return;
  arrived_.push_back({machine, secondsNow(), std::move(result)});
  changed_.notify_all();
}

void Servers::lit(std::uint32_t machine, const Lit& lit) {
  const std::lock_guard lock(mutex_);
  machines_[machine].lit = lit;
  changed_.notify_all();
}

void Servers::noLoan(std::uint32_t machine, std::uint32_t id) {
  const std::lock_guard lock(mutex_);
  dropped_.emplace_back(machine, id);
  changed_.notify_all();
}

// ---- the window's thread ----

std::uint32_t Servers::readyMachines() const {
  const std::lock_guard lock(mutex_);
  return static_cast<std::uint32_t>(
      std::count_if(machines_.begin(), machines_.end(), [](const Machine& m) { return m.ready; }));
}

bool Servers::takesAll() const {
  const std::lock_guard lock(mutex_);
  return holder_ != 0 && problem_.empty();
}

void Servers::edited(const std::string& overlay, std::uint32_t width, std::uint32_t height) {
  loans_.clear();
  const std::lock_guard lock(mutex_);
  arrived_.clear();
  edit_ = Edit{++edits_, width, height, overlay};
  for (std::uint32_t i = 1; i < machines_.size(); ++i) {
    if (machines_[i].ready) leader_.send(i, *edit_);
  }
}

void Servers::lightComes(const Session& session, std::uint64_t photons) {
  const VoxelLight& light = session.light();
  const std::lock_guard lock(mutex_);
  if (aim_ && aim_->light == light.number() && aim_->photons == photons) return;
  // Of the overlay only the light counts.
  const Look none;
  const std::string text = lookText(none, Scene{}, none, {photons, light.aim()});
  if (!aim_ || aim_->light != light.number()) shots_.clear();
  aim_ = Aim{light.number(), photons, light.presentVoxels()->info.leafCount, text, light.shared()};
  for (std::uint32_t i = 1; i < machines_.size(); ++i) {
    if (machines_[i].ready) sendAim(i);
  }
}

/// One machine sends its photons. The lock is held.
void Servers::sendAim(std::uint32_t machine) {
  Aim aim = *aim_;
  if (machine != holder_) aim.send = 0;
  leader_.send(machine, aim);
}

void Servers::exchange(Session& session, const std::function<bool()>& keepGoing) {
  const double now = secondsNow(), passed = now - visited_;
  visited_ = now;
  between_ += 0.25 * (std::clamp(passed, kLeastBetween, kMostBetween) - between_);
  visit(session, keepGoing, false);
}

bool Servers::await(Session& session, const std::function<bool()>& keepGoing) {
  const bool lacksPages = session.buffers().tiles.pagesAwaited() > 0;
  if (loans_.empty() && !lacksPages) return false;
  if (!loans_.empty()) {
    std::unique_lock lock(mutex_);
    changed_.wait_for(lock, kAwait,
                      [&] { return !arrived_.empty() || !lost_.empty() || !dropped_.empty(); });
  }
  // What lacks pages can't be traced here either.
  visit(session, keepGoing, !lacksPages);
  return !loans_.empty();
}

void Servers::visit(Session& session, const std::function<bool()>& keepGoing, bool hurry) {
  if (session.frameNumber() != frame_) {
    frame_ = session.frameNumber();
    loans_.clear();
    const std::lock_guard lock(mutex_);
    arrived_.clear();
  }
  add(session, keepGoing);
  takeBack(session, hurry);
  lendAll(session);
}

/// Adds what has come; what comes before what the window itself has yet to trace waits.
void Servers::add(Session& session, const std::function<bool()>& keepGoing) {
  std::deque<Arrived> arrived;
  {
    const std::lock_guard lock(mutex_);
    arrived.swap(arrived_);
  }
  std::deque<Arrived> waiting;
  bool may = true;  // one at least
  for (Arrived& one : arrived) {
    if (!may || !addOne(session, one)) waiting.push_back(std::move(one));
    may = may && keepGoing();
  }
  const std::lock_guard lock(mutex_);
  arrived_.insert(arrived_.begin(), std::make_move_iterator(waiting.begin()),
                  std::make_move_iterator(waiting.end()));
}

/// False if it must wait.
bool Servers::addOne(Session& session, const Arrived& arrived) {
  const Result& result = arrived.result;
  const double seconds = result.seconds >= 0.0 && result.seconds < 1e9 ? result.seconds : 0.0;
  loans_.brought(arrived.machine, result.id, seconds, arrived.at);
  const Loan* loan = loans_.find(arrived.machine, result.id);
  if (loan == nullptr) return true;
  const TileScheduler& tiles = session.buffers().tiles;
  const auto isReady = [&](const TileUnit& unit) { return tiles.isReadyFor(unit); };
  if (!std::all_of(loan->units.begin(), loan->units.end(), isReady)) return false;
  TakenSamples taken;
  taken.rays = {result.cRays,      result.shadowRays, result.cones,
                result.cacheReads, result.exactPaths, result.deviceCones};
  try {
    taken.samples = unpackSamples(result.samples, contentsFor(session), loan->samples);
  } catch (const MessageError& e) {
    for (const TileUnit& unit : loan->units) session.release(unit);
    loans_.end(result.id);
    leader_.drop(arrived.machine, fmt::format("a message can't be read: {}", e.what()));
    return true;
  }
  session.addTaken(loan->units, taken);
  loans_.end(result.id);
  return true;
}

void Servers::takeBack(Session& session, bool hurry) {
  std::vector<std::uint32_t> lost;
  std::vector<std::pair<std::uint32_t, std::uint32_t>> dropped;
  {
    const std::lock_guard lock(mutex_);
    lost.swap(lost_);
    dropped.swap(dropped_);
  }
  for (const auto& [machine, id] : dropped) {
    for (const TileUnit& unit : loans_.drop(machine, id)) session.release(unit);
  }
  for (const std::uint32_t machine : lost) {
    for (const TileUnit& unit : loans_.lose(machine)) session.release(unit);
  }
  for (const TileUnit& unit : loans_.takeLate(secondsNow(), hurry)) session.release(unit);
}

/// A loan to each machine that has the light of now and is not busy, in turn, as long as tiles are
/// left.
void Servers::lendAll(Session& session) {
  const bool reads = session.readsLight();
  std::vector<std::uint32_t> who;
  {
    const std::lock_guard lock(mutex_);
    if (!edit_) return;
    for (std::uint32_t i = 1; i < machines_.size(); ++i) {
      const Machine& m = machines_[i];
      const bool lit =
          m.lit.light == session.light().number() && m.lit.photons == session.light().photons();
      if (m.ready && (!reads || lit)) who.push_back(i);
    }
  }
  const TileScheduler& tiles = session.buffers().tiles;
  // What is not traced here for want of pages comes first, an equal part of it to each.
  const std::size_t lacking = tiles.coarseTilesToLend();
  for (std::size_t i = 0; lacking > 0 && i < who.size(); ++i) {
    lendTo(session, who[i], (lacking + who.size() - 1) / who.size(),
           [&] { return session.lendCoarse(); });
  }
  const auto best = [&] { return session.lend(); };
  // The last tile is left to who can trace it at once.
  const std::size_t left = tiles.pagesAwaited() > 0 ? 0 : 1;
  for (std::uint32_t turn = 0; turn < Loans::kAtOnce; ++turn) {
    for (const std::uint32_t machine : who) {
      // An equal part of half of what nobody has: the last ones of a pass come back together.
      const std::size_t free = tiles.freeTiles();
      if (free <= left || !lendTo(session, machine, free / (2 * (who.size() + 1)), best)) return;
    }
  }
}

/// False if there is nothing to lend.
bool Servers::lendTo(Session& session, std::uint32_t machine, std::size_t mostTiles,
                     const std::function<std::optional<TileUnit>()>& next) {
  const std::uint64_t wanted = loans_.wanted(machine, kLoanVisits * between_);
  if (wanted == 0) return true;
  const bool reads = session.readsLight();
  const auto& tiles = session.buffers().tiles.tiles();
  Lent lent{.edit = edits_,
            .light = reads ? session.light().number() : 0,
            .photons = reads ? session.light().photons() : 0,
            .coneShare = session.coneShare(),
            .contents = contentsFor(session)};
  std::vector<TileUnit> units;
  std::uint64_t samples = 0;
  while (samples < std::min(wanted, kMostLent) && (units.empty() || units.size() < mostTiles)) {
    const auto unit = next();
    if (!unit) break;
    units.push_back(*unit);
    samples += samplesOf(tiles[unit->tile], *unit);
    lent.units.push_back({unit->tile, unit->sample, unit->firstCell, unit->endCell});
    if (const Dial* dial = session.buffers().dial.get()) {
      lent.shares.push_back(dial->share(unit->tile, unit->sample));
    }
  }
  if (units.empty()) return false;
  lent.id = loans_.lend(machine, std::move(units), samples, secondsNow());
  leader_.send(machine, lent);
  return true;
}

std::vector<MachineRow> Servers::rows() const {
  std::vector<MachineRow> rows = leader_.rows();
  for (std::uint32_t i = 1; i < rows.size(); ++i) rows[i].work.units = loans_.samplesOf(i);
  return rows;
}

std::uint64_t Servers::takenBack() const { return loans_.takenBack(); }

}  // namespace trex::machines
