#include "src/machines/leader.h"

#include <algorithm>
#include <cmath>

#include "src/core/clock.h"
#include "src/core/log.h"
#include "src/core/memory.h"
#include "src/machines/identity.h"
#include "src/machines/sample_bytes.h"
#include "src/machines/units.h"
#include "src/session/session.h"

namespace trex::machines {
namespace {

constexpr double kEndSeconds = 5.0;                          // that others have to say goodbye
constexpr std::uint64_t kJobBytes = std::uint64_t{4} << 20;  // of a job's result, at most

std::uint32_t sessionContents(const Session& session) {
  return contentsOf(session.buffers(), session.shownOptions().pairs);
}

JobSizes sizesFor(const Session& session, std::uint32_t machines) {
  const auto& tiles = session.buffers().tiles.tiles();
  std::uint64_t largest = 1;
  for (const Tile& t : tiles) {
    largest = std::max(largest, std::uint64_t{t.width} * t.height);
  }
  const std::uint64_t unit = mostBytesOf(sessionContents(session), largest);
  JobSizes sizes;
  sizes.most = std::max<std::uint64_t>(kJobBytes / unit, 1);
  if (const std::uint64_t paths = session.pathsAtOnce(); paths > 0) {
    const std::uint64_t longest = kMostBytes / 2 / unit;
    sizes.large =
        std::clamp<std::uint64_t>(paths / largest, 2, std::max<std::uint64_t>(longest, 2));
    sizes.most = std::max(sizes.most, sizes.large);
    sizes.atOnce = 1;
  }
  sizes.window = std::max(kWindowBytes / unit, 2 * std::uint64_t{machines} * sizes.most);
  if (session.makesMapsOfSamples()) sizes.together = tiles.size();
  return sizes;
}

std::uint64_t nextUnit(const TileScheduler& tiles) {
  return tiles.samplesDone() * std::uint64_t{tiles.tiles().size()} + tiles.tilesDone();
}

}  // namespace

Leader::Leader(const Link::MakeWire& make, const Hello& self)
    : self_(self),
      ledger_(0),
      photonJobs_(0),
      remote_([this](std::uint32_t to, Bytes question) { link_.send(to, std::move(question)); },
              [this](std::uint32_t machine) {
                const std::lock_guard lock(mutex_);
                return machines_[machine].row.link;
              }),
      server_([this](std::uint32_t to, Bytes answer) { link_.send(to, std::move(answer)); },
              [this](const Error& e) { end(e); }),
      link_(make) {
  machines_.resize(link_.size());
  ledger_ = JobLedger(link_.size());
  ledger_.join(0);
  photonJobs_ = ledger_;
  machines_[0].row.host = self.host;
  machines_[0].row.threads = self.threads;
  machines_[0].row.instructions = self.instructions;
  link_.listen(
      {.message = [this](std::uint32_t from, Kind kind, ByteView body) { hear(from, kind, body); },
       .tick = [this] { tick(); },
       .lost = [this](std::uint32_t machine) { forget(machine); },
       .broken =
           [this](const Error& e) {
             remote_.broken(e);
             {
               const std::lock_guard lock(mutex_);
               broken_ = true;
             }
             end(e);
           }});
}

/// The work ends with this error, if there was none before.
void Leader::end(const Error& error) {
  const std::lock_guard lock(mutex_);
  if (!failure_ && listener_ != nullptr) logWarning("{}; going on alone", error.what());
  if (!failure_) failure_ = error;
  changed_.notify_all();
}

void Leader::workFor(MachineListener* listener, const Serve& serve) {
  const std::lock_guard lock(mutex_);
  listener_ = listener;
  serve_ = serve;
}

void Leader::drop(std::uint32_t machine, const std::string& why) {
  const std::lock_guard lock(mutex_);
  fail(machine, static_cast<int>(ExitCode::kFailed), why);
}

/// Others get what a machine holds. The lock is held.
void Leader::lose(std::uint32_t machine) {
  ledger_.lose(machine);
  photonJobs_.lose(machine);
  tellHomes();
  if (listener_ != nullptr) listener_->lost(machine);
}

Leader::~Leader() {
  stop();
  finish(static_cast<int>(ExitCode::kFailed));
}

/// A machine has died: what it held goes to others.
void Leader::forget(std::uint32_t machine) {
  const std::lock_guard lock(mutex_);
  Machine& m = machines_[machine];
  if (m.state == State::kGone) return;
  m.state = State::kGone;
  m.at.reset();
  dropProbeOf(machine);
  lose(machine);
  const bool holds = welcome_ && welcome_->holder == machine;
  remote_.lose(machine,
               Error(ExitCode::kFailed, fmt::format("{}{} has ended", nameOf(machine),
                                                    holds ? ", which has the model," : "")));
  if (listener_ != nullptr)
    listener_->failed(machine, fmt::format("{} has ended", nameOf(machine)));
  if (!stopped_) logWarning("{}: has ended; others take its jobs", nameOf(machine));
  dealAll();
  changed_.notify_all();
}

std::string Leader::nameOf(std::uint32_t machine) const {
  const std::string& host = machines_[machine].row.host;
  return host.empty() ? fmt::format("machine {}", machine)
                      : fmt::format("machine {} ({})", machine, host);
}

void Leader::throwIfFailed() const {
  if (failure_) throw Error(*failure_);
}

void Leader::expect(std::uint64_t digest) {
  const std::lock_guard lock(mutex_);
  digest_ = digest;
  for (std::uint32_t i = 1; i < machines_.size(); ++i) checkReady(i);
}

void Leader::waitForGreetings(const std::function<bool()>& keepGoing) {
  waitWhile([](const Machine& m) { return m.state == State::kExpected; }, keepGoing);
}

void Leader::waitForModels(const std::function<bool()>& keepGoing) {
  waitWhile(
      [](const Machine& m) {
        return m.state == State::kExpected || (m.state == State::kGreeted && !m.ready);
      },
      keepGoing);
}

void Leader::waitWhile(bool (*isAwaited)(const Machine&), const std::function<bool()>& keepGoing) {
  std::unique_lock lock(mutex_);
  while (std::any_of(machines_.begin() + 1, machines_.end(), isAwaited)) {
    throwIfFailed();
    lock.unlock();
    const bool going = keepGoing();
    lock.lock();
    if (!going) return;
    changed_.wait_for(lock, std::chrono::milliseconds(50));
  }
  throwIfFailed();
}

void Leader::beginView(std::uint32_t view) {
  const std::lock_guard lock(mutex_);
  throwIfFailed();
  endPass();
  forgetPhotons();
  view_ = view;
  light_.reset();
  for (std::uint32_t i = 1; i < machines_.size(); ++i) {
    ledger_.lose(i);  // until it has set the view up
    photonJobs_.lose(i);
    if (machines_[i].state == State::kReady) tell(i, SetView{view});
  }
}

void Leader::lightComes(const Session&, std::uint64_t photons) {
  const std::lock_guard lock(mutex_);
  if (!view_) return;
  light_ = LightComes{*view_, photons};
  for (std::uint32_t i = 1; i < machines_.size(); ++i) {
    if (machines_[i].state == State::kReady) tell(i, *light_);
  }
}

/// Whether the pass that is under way is what the session wants next.
bool Leader::goesOn(const Session& session) const {
  const TileScheduler& tiles = session.buffers().tiles;
  return pass_ && pass_->photons == session.light().photons() && next_ == nextUnit(tiles) &&
         end_ == tiles.barrier() * std::uint64_t{tiles.tiles().size()} &&
         pass_->shares == session.tileShares();
}

/// Where jobs are large those who come late find none.
void Leader::waitForViews(const std::function<bool()>& keepGoing) {
  std::unique_lock lock(mutex_);
  const auto sets = [&](const Machine& m) { return m.state == State::kReady && m.view != view_; };
  while (!failure_ && std::any_of(machines_.begin() + 1, machines_.end(), sets)) {
    lock.unlock();
    const bool going = keepGoing();
    lock.lock();
    if (!going) return;
    changed_.wait_for(lock, std::chrono::milliseconds(20));
  }
}

void Leader::startPass(const Session& session) {
  const TileScheduler& tiles = session.buffers().tiles;
  const std::lock_guard lock(mutex_);
  throwIfFailed();
  if (goesOn(session)) return;
  Pass pass;
  pass.view = view_.value_or(0);
  pass.number = ++passes_;
  pass.photons = session.light().photons();
  pass.contents = sessionContents(session);
  pass.coneShare = session.coneShare();
  pass.shares = session.tileShares();
  pass_ = pass;
  arrived_.clear();
  next_ = nextUnit(tiles);
  end_ = tiles.barrier() * std::uint64_t{tiles.tiles().size()};
  ledger_.start(next_, end_, sizesFor(session, link_.size()));
  for (std::uint32_t i = 1; i < machines_.size(); ++i) {
    if (machines_[i].state == State::kReady) tell(i, pass);
  }
  dealAll();
}

void Leader::rest() {
  const std::lock_guard lock(mutex_);
  endPass();
}

/// What has been given out is void.
void Leader::endPass() {
  if (!pass_) return;
  pass_.reset();
  arrived_.clear();
  ledger_.start(0, 0, {});
  for (std::uint32_t i = 1; i < machines_.size(); ++i) {
    if (machines_[i].state == State::kReady) tell(i, Rest{});
  }
}

/// Adds what has arrived and comes next.
void Leader::mergeArrived(Session& session) {
  const std::vector<Tile>& tiles = session.buffers().tiles.tiles();
  while (true) {
    Arrived one;
    std::uint32_t contents = 0;
    {
      const std::lock_guard lock(mutex_);
      throwIfFailed();
      const auto at = arrived_.find(next_);
      if (at == arrived_.end()) return;
      one = std::move(at->second);
      arrived_.erase(at);
      contents = pass_->contents;
    }
    const std::vector<TileUnit> units = unitsOf(one.job, tiles.size());
    TakenSamples taken;
    taken.rays = one.rays;
    try {
      taken.samples = unpackSamples(one.samples, contents, samplesOf(units, tiles));
    } catch (const MessageError& e) {
      const std::lock_guard lock(mutex_);
      fail(one.machine, static_cast<int>(ExitCode::kFailed),
           fmt::format("a message can't be read: {}", e.what()));
      throwIfFailed();
    }
    session.addTaken(units, taken);
    const std::lock_guard lock(mutex_);
    next_ = one.job.end;
    ledger_.merged(next_);
  }
}

/// One job of this machine's own. False if keepGoing said no; without a job it waits a little.
bool Leader::traceOne(Session& session, const std::function<bool()>& keepGoing) {
  std::optional<Job> job;
  {
    std::unique_lock lock(mutex_);
    job = ledger_.deal(0, secondsNow());
    if (!job) {
      if (!arrived_.contains(next_)) changed_.wait_for(lock, std::chrono::milliseconds(20));
      lock.unlock();
      return keepGoing();
    }
  }
  const double start = secondsNow();
  TakenSamples taken;
  const auto units = unitsOf(*job, session.buffers().tiles.tiles().size());
  const bool done = session.takeUnits(units, keepGoing, taken);
  Bytes samples;
  if (done) samples = packSamples(taken.samples, sessionContents(session), false);
  const std::lock_guard lock(mutex_);
  if (!done) {
    ledger_.giveBack(0, job->id);
  } else if (const auto first = ledger_.bring(0, job->id, secondsNow() - start)) {
    arrived_.emplace(first->first, Arrived{*first, 0, taken.rays, std::move(samples)});
  }
  return done;
}

void Leader::take(Session& session, const std::function<bool()>& keepGoing) {
  if (session.pathsAtOnce() > 0) waitForViews(keepGoing);
  startPass(session);
  for (bool going = true; going && next_ < end_;) {
    going = traceOne(session, keepGoing);
    mergeArrived(session);
  }
  if (next_ == end_) rest();
}

std::vector<MachineRow> Leader::rows() const {
  const std::lock_guard lock(mutex_);
  std::vector<MachineRow> rows;
  for (std::uint32_t i = 0; i < machines_.size(); ++i) {
    rows.push_back(machines_[i].row);
    rows.back().work = ledger_.work(i);
  }
  rows[0].peakBytes = peakResidentBytes();
  return rows;
}

std::uint64_t Leader::jobsAgain() const {
  const std::lock_guard lock(mutex_);
  return ledger_.again();
}

void Leader::stop() {
  server_.stop();  // after Stop nobody takes what it would send
  remote_.stop();
  std::unique_lock lock(mutex_);
  if (stopped_) return;
  stopped_ = true;
  // Who has the model is the last: it answers what the others have asked it for.
  const std::uint32_t holder = welcome_ ? welcome_->holder : 0;
  for (std::uint32_t i = 1; i < machines_.size(); ++i) {
    if (i != holder) link_.send(i, Stop{});
  }
  awaitGoodbyes(lock, false);
  if (holder == 0) return;
  link_.send(holder, Stop{});
  awaitGoodbyes(lock, true);
}

void Leader::awaitGoodbyes(std::unique_lock<std::mutex>& lock, bool ofHolder) {
  const std::uint32_t holder = welcome_ ? welcome_->holder : 0;
  changed_.wait_for(lock, std::chrono::duration<double>(kEndSeconds), [&] {
    if (broken_) return true;
    for (std::uint32_t i = 1; i < machines_.size(); ++i) {
      if (machines_[i].state != State::kGone && (i != holder || ofHolder)) return false;
    }
    return remote_.outstanding() == 0;
  });
}

void Leader::finish(int code, const std::string& error) {
  bool allGone = true;
  {
    const std::lock_guard lock(mutex_);
    if (finished_) return;
    finished_ = true;
    for (std::uint32_t i = 1; i < machines_.size(); ++i) {
      if (machines_[i].state == State::kGone) continue;
      allGone = false;
      logWarning("{}: {}; it is ended", nameOf(i),
                 machines_[i].state == State::kReady && !broken_ ? "has not said goodbye"
                                                                 : "does not answer");
    }
  }
  for (std::uint32_t i = 1; i < link_.size(); ++i) link_.send(i, End{});
  if (allGone) {
    link_.finish();
    return;
  }
  if (!error.empty()) logError("{}", error);
  link_.abort(code);
}

}  // namespace trex::machines
