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

constexpr double kPingSeconds = 1.0;
constexpr double kEndSeconds = 5.0;                           // that others have to say goodbye
constexpr std::uint64_t kJobBytes = std::uint64_t{4} << 20;   // of a job's result, at most
constexpr std::uint64_t kMostPart = std::uint64_t{16} << 20;  // of a file, at once

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
    : self_(self), ledger_(0), link_(make) {
  machines_.resize(link_.size());
  ledger_ = JobLedger(link_.size());
  ledger_.join(0);
  machines_[0].row = {self.host, "none", self.threads, self.instructions, {}, 0, 0};
  link_.listen(
      {.message = [this](std::uint32_t from, Kind kind, ByteView body) { hear(from, kind, body); },
       .tick = [this] { tick(); },
       .broken =
           [this](const Error& e) {
             const std::lock_guard lock(mutex_);
             broken_ = true;
             if (!failure_) failure_ = e;

             changed_.notify_all();
           }});
}

Leader::~Leader() {
  stop();
  finish(static_cast<int>(ExitCode::kFailed));
}

std::string Leader::nameOf(std::uint32_t machine) const {
  const std::string& host = machines_[machine].row.host;
  return host.empty() ? fmt::format("machine {}", machine)
                      : fmt::format("machine {} ({})", machine, host);
}

// ---- what others say: by the link's thread ----

void Leader::hear(std::uint32_t from, Kind kind, ByteView body) {
  const std::lock_guard lock(mutex_);
  Machine& m = machines_[from];
  m.heard = secondsNow();
  if (m.state == State::kSilent) {
    logInfo("{}: answers again", nameOf(from));
    m.state = m.ready ? State::kReady : State::kGreeted;
    if (m.ready) bringIn(from);
  }
  switch (kind) {
    case Kind::kHello:
      greet(from, decode<Hello>(body));
      break;
    case Kind::kReady:
      m.digest = decode<Ready>(body).digest;
      checkReady(from);
      break;
    case Kind::kSet: {
      const auto set = decode<ViewSet>(body);
      m.row.device = set.device;
      m.view = set.view;
      if (view_ == set.view && m.state == State::kReady) {
        ledger_.join(from);
        dealTo(from);
      }
      break;
    }
    case Kind::kResult:
      takeResult(from, decode<Result>(body));
      break;
    case Kind::kFetch:
      serve(from, decode<Fetch>(body));
      break;
    case Kind::kPong:
      break;
    case Kind::kFailed: {
      const auto failed = decode<Failed>(body);
      fail(from, failed.code, failed.text);
      break;
    }
    case Kind::kBye:
      m.state = State::kGone;
      break;
    default:
      throw MessageError("machine 0 should have sent it");
  }
  changed_.notify_all();
}

void Leader::fail(std::uint32_t machine, int code, const std::string& text) {
  const bool known = code >= 1 && code <= static_cast<int>(ExitCode::kDiffer);
  if (!failure_) {
    failure_.emplace(known ? static_cast<ExitCode>(code) : ExitCode::kFailed,
                     fmt::format("{}: {}", nameOf(machine), text));
  }
  ledger_.lose(machine);
  changed_.notify_all();
}

void Leader::greet(std::uint32_t from, const Hello& hello) {
  Machine& m = machines_[from];
  m.row.host = hello.host;
  m.row.threads = hello.threads;
  m.row.instructions = hello.instructions;
  m.state = State::kGreeted;
  if (const std::string why = whyUnfit(self_, hello); !why.empty()) {
    fail(from, static_cast<int>(ExitCode::kFailed), why);
    return;
  }
  if (hello.instructions != self_.instructions) {
    logWarning("{}: has {}, machine 0 has {}: pictures may differ in their last bits", nameOf(from),
               instructionText(hello.instructions), instructionText(self_.instructions));
  }
  if (welcome_) link_.send(from, *welcome_);
}

void Leader::checkReady(std::uint32_t from) {
  Machine& m = machines_[from];
  if (!m.digest || !digest_ || m.ready) return;
  if (*m.digest != *digest_) {
    fail(from, static_cast<int>(ExitCode::kInput),
         welcome_ && welcome_->local ? "its model, or what it makes of it, is not that of machine "
                                       "0: give all the same files "
                                       "and options, or leave --scene-db local out"
                                     : "was started with other options than machine 0");
    return;
  }
  m.ready = true;
  if (m.state == State::kGreeted) m.state = State::kReady;
  bringIn(from);
}

/// Tells a machine what is under way.
void Leader::bringIn(std::uint32_t machine) {
  if (!view_) return;
  if (machines_[machine].view != *view_) link_.send(machine, SetView{*view_});
  if (light_) link_.send(machine, *light_);
  if (pass_) link_.send(machine, *pass_);
  if (machines_[machine].view != *view_) return;  // it joins once it says that it has
  ledger_.join(machine);
  dealTo(machine);
}

void Leader::takeResult(std::uint32_t from, Result result) {
  machines_[from].row.peakBytes = result.peakBytes;
  if (!pass_ || result.pass != pass_->number) return;
  const double seconds = result.seconds >= 0.0 && result.seconds < 1e9 ? result.seconds : 0.0;
  if (const auto job = ledger_.bring(from, result.id, seconds)) {
    arrived_.emplace(job->first, Arrived{*job,
                                         from,
                                         {result.cRays, result.shadowRays, result.cones,
                                          result.cacheReads, result.exactPaths},
                                         std::move(result.samples)});
  }
  dealTo(from);
}

void Leader::serve(std::uint32_t to, const Fetch& fetch) {
  if (fetch.file >= files_.size()) throw MessageError("it asks for a file that there is not");
  const ServedFile& file = files_[fetch.file];
  if (fetch.bytes > kMostPart || fetch.offset > file.size ||
      fetch.bytes > file.size - fetch.offset) {
    throw MessageError("it asks for bytes beyond a file's end");
  }
  Part part;
  part.number = fetch.number;
  part.bytes.resize(fetch.bytes);
  file.bytes->read(fetch.offset, part.bytes);
  machines_[to].row.servedBytes += part.bytes.size();
  link_.send(to, part);
}

void Leader::dealTo(std::uint32_t machine) {
  if (machine == 0 || !pass_) return;
  while (const auto job = ledger_.deal(machine, secondsNow())) {
    link_.send(machine, GiveJob{pass_->number, job->id, job->first, job->end});
  }
}

void Leader::dealAll() {
  for (std::uint32_t m = 1; m < machines_.size(); ++m) dealTo(m);
}

void Leader::tick() {
  const std::lock_guard lock(mutex_);
  const double now = secondsNow();
  for (std::uint32_t i = 1; i < machines_.size(); ++i) {
    Machine& m = machines_[i];
    const bool answers = m.state == State::kGreeted || m.state == State::kReady;
    if (!answers || now - m.heard < kSilentSeconds) continue;
    logWarning("{}: has not answered for {:.0f} s; others take its jobs", nameOf(i), now - m.heard);
    m.state = State::kSilent;
    ledger_.lose(i);
    changed_.notify_all();
  }
  dealAll();  // what has been lost, and what is late
  if (now - pinged_ < kPingSeconds) return;
  pinged_ = now;
  for (std::uint32_t i = 1; i < machines_.size(); ++i) {
    if (machines_[i].state != State::kGone) link_.send(i, Ping{});
  }
}

// ---- what this machine does ----

void Leader::throwIfFailed() const {
  if (failure_) throw Error(*failure_);
}

void Leader::welcome(bool local, bool baked, std::vector<ServedFile> files) {
  const std::lock_guard lock(mutex_);
  files_ = std::move(files);
  Welcome w;
  w.local = local;
  w.baked = baked;
  for (const ServedFile& f : files_) w.fileBytes.push_back(f.size);
  welcome_ = w;
  for (std::uint32_t i = 1; i < machines_.size(); ++i) {
    if (machines_[i].state == State::kGreeted) link_.send(i, w);
  }
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
  view_ = view;
  light_.reset();
  for (std::uint32_t i = 1; i < machines_.size(); ++i) {
    ledger_.lose(i);  // until it has set the view up
    if (machines_[i].state == State::kReady) link_.send(i, SetView{view});
  }
}

void Leader::lightComes(const Session&, std::uint64_t photons) {
  const std::lock_guard lock(mutex_);
  if (!view_) return;
  light_ = LightComes{*view_, photons};
  for (std::uint32_t i = 1; i < machines_.size(); ++i) {
    if (machines_[i].state == State::kReady) link_.send(i, *light_);
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
  pass.shares = session.tileShares();
  pass_ = pass;
  arrived_.clear();
  next_ = nextUnit(tiles);
  end_ = tiles.barrier() * std::uint64_t{tiles.tiles().size()};
  ledger_.start(next_, end_, sizesFor(session, link_.size()));
  for (std::uint32_t i = 1; i < machines_.size(); ++i) {
    if (machines_[i].state == State::kReady) link_.send(i, pass);
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
    if (machines_[i].state == State::kReady) link_.send(i, Rest{});
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
  if (done) samples = packSamples(taken.samples, sessionContents(session));
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
  std::unique_lock lock(mutex_);
  if (stopped_) return;
  stopped_ = true;
  for (std::uint32_t i = 1; i < machines_.size(); ++i) link_.send(i, Stop{});
  changed_.wait_for(lock, std::chrono::duration<double>(kEndSeconds), [&] {
    return broken_ || std::all_of(machines_.begin() + 1, machines_.end(),
                                  [](const Machine& m) { return m.state == State::kGone; });
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
      logWarning("{}: does not answer; it is ended", nameOf(i));
    }
  }
  if (allGone) {
    link_.finish();
    return;
  }
  if (!error.empty()) logError("{}", error);
  link_.abort(code);
}

}  // namespace trex::machines
