#include "src/machines/worker.h"

#include <algorithm>
#include <cmath>

#include "src/core/clock.h"
#include "src/core/memory.h"
#include "src/machines/sample_bytes.h"
#include "src/machines/units.h"

namespace trex::machines {
namespace {

constexpr std::uint64_t kMostUnits = 1u << 20;  // of a job that is no mistake

/// The settings of a session that makes no picture of its own.
RenderSettings withoutPicture(RenderSettings s) {
  s.samples = 0;
  s.seconds = s.error = 0.0;
  s.denoise = Denoise::kOff;
  s.recordTraffic = false;
  return s;
}

}  // namespace

struct Worker::Work {
  std::shared_ptr<const Model> model;
  const std::vector<Camera>& cameras;
  RenderSettings settings;
  std::unique_ptr<Session> session;
  std::uint32_t view = ~0u, begun = 0;  ///< begun: of views_, when it was set
  std::optional<Pass> pass;
};

Worker::Worker(const Link::MakeWire& make, const Hello& self, std::vector<ServedFile> files)
    : serves_(!files.empty()),
      pages_([this](std::uint32_t to, Bytes message) { link_.send(to, std::move(message)); },
             [this](const Error& e) { broken(e); }),
      remote_([this](std::uint32_t to, Bytes question) { link_.send(to, std::move(question)); },
              [this](std::uint32_t) { return pages_.link(); }),
      server_([this](std::uint32_t to, Bytes message) { answer(to, std::move(message)); }),
      link_(make) {
  pages_.setPlace(link_.rank(), link_.size());
  server_.setFiles(std::move(files));
  link_.listen(
      {.message = [this](std::uint32_t from, Kind kind, ByteView body) { hear(from, kind, body); },
       .tick = {},
       .lost = [this](std::uint32_t machine) { lose(machine); },
       .broken = [this](const Error& e) { broken(e); }});
  link_.send(0, self);
}

Worker::~Worker() {  // threads of these send by the link, which goes first
  pages_.stop();
  server_.stop();
}

/// A machine has died. The others are machine 0's to miss, but for their files.
void Worker::lose(std::uint32_t machine) {
  if (machine == 0) return broken(Error(ExitCode::kFailed, "machine 0 has ended"));
  pages_.lost(machine);
  remote_.lose(machine, Error(ExitCode::kFailed, fmt::format("machine {} has ended", machine)));
}

/// Of our own files. After the goodbye nobody takes it.
void Worker::answer(std::uint32_t to, Bytes message) {
  const std::lock_guard lock(mutex_);
  if (!stopped_) link_.send(to, std::move(message));
}

void Worker::broken(const Error& error) {
  pages_.broken(error);
  remote_.broken(error);
  const std::lock_guard lock(mutex_);
  if (!problem_) problem_ = error;
  changed_.notify_all();
}

/// By the link's thread.
void Worker::hear(std::uint32_t from, Kind kind, ByteView body) {
  switch (kind) {
    case Kind::kFetch:
      return hearFetch(from, decode<Fetch>(body));
    case Kind::kPart:
      if (from == holder_) return remote_.hear(from, decode<Part>(body));
      return pages_.hearPart(from, decode<Part>(body));
    case Kind::kNoPart:
      if (from == holder_) return remote_.hear(from, decode<NoPart>(body));
      return pages_.hearNoPart(from, decode<NoPart>(body));
    default:
      if (from != 0) throw MessageError("machine 0 alone should have sent it");
      hearLeader(kind, body);
  }
}

void Worker::hearFetch(std::uint32_t from, Fetch fetch) {
  if (serves_) {
    server_.ask(from, std::move(fetch));
  } else {
    pages_.hearFetch(from, std::move(fetch));
  }
}

void Worker::hearLeader(Kind kind, ByteView body) {
  switch (kind) {
    case Kind::kPing:
      link_.send(0, Pong{});
      return;
    case Kind::kProbe:
      link_.send(0, Probed{decode<Probe>(body).number});
      return;
    case Kind::kLink:
      return pages_.hearLink(decode<LinkFound>(body));
    case Kind::kHomes:
      return pages_.hearHomes(decode<Homes>(body));
    case Kind::kEnd: {
      const std::lock_guard lock(mutex_);
      ended_ = true;
      changed_.notify_all();
      return;
    }
    case Kind::kShoot:
    case Kind::kPhotons:
    case Kind::kAlone:
      return hearOfPhotons(kind, body);
    case Kind::kView:
    case Kind::kEdit:
    case Kind::kStop:
      ++views_;
      ++passes_;
      break;
    case Kind::kPass:
    case Kind::kRest:
    case Kind::kAim:
      ++passes_;
      break;
    case Kind::kWelcome:
    case Kind::kServe:
    case Kind::kLent:
    case Kind::kLight:
    case Kind::kJob:
      break;
    default:
      throw MessageError("machine 0 should not have sent it");
  }
  if (kind == Kind::kStop) {
    pages_.stop();
    remote_.stop();
  }
  const std::lock_guard lock(mutex_);
  if (kind == Kind::kStop) {
    stopped_ = true;
    // What others have asked for is to be there before: they take nothing after the end.
    link_.sendLast(0, encode(Bye{}));
  }
  heard_.push_back({kind, views_, passes_, {body.begin(), body.end()}});
  changed_.notify_all();
}

std::optional<Worker::Heard> Worker::next() {
  std::unique_lock lock(mutex_);
  changed_.wait(lock, [&] { return !heard_.empty() || problem_ || stopped_; });
  if (stopped_) return {};
  if (problem_) throw Error(*problem_);
  Heard heard = std::move(heard_.front());
  heard_.pop_front();
  return heard;
}

std::optional<Welcome> Worker::awaitWelcome() {
  const auto heard = next();
  if (!heard) return {};
  if (heard->kind != Kind::kWelcome) {
    fail(ExitCode::kFailed, "machine 0: did not say first what there is to open");
  }
  try {
    return decode<Welcome>(heard->body);
  } catch (const MessageError& e) {
    fail(ExitCode::kFailed, "machine 0: a message can't be read: {}", e.what());
  }
}

void Worker::setView(Work& work, const SetView& message, std::uint32_t begun) {
  if (message.view >= work.cameras.size()) throw MessageError("it names a view that there is not");
  work.begun = begun;
  work.pass.reset();
  if (work.view != message.view || !work.session) {
    work.session.reset();
    {
      const std::lock_guard lock(mutex_);
      view_ = message.view;
      batch_.reset();
    }
    work.session = std::make_unique<Session>(work.model, work.cameras[message.view], work.settings);
    work.session->sharePhotons(this);
    work.session->giveUpWhen([this] { return passes_ != passBegun_; });
    work.view = message.view;
  }
  link_.send(0, ViewSet{work.view, work.session->report().device});
}

void Worker::startPass(Work& work, Pass pass) {
  work.pass.reset();
  if (!work.session || pass.view != work.view) return;
  const std::size_t tiles = work.session->buffers().tiles.tiles().size();
  const bool dialled = work.session->buffers().dial != nullptr;
  if (pass.shares.size() != (dialled ? tiles : 0)) throw MessageError("it has not a share a tile");
  for (const double share : pass.shares) {
    if (!(share >= 0.0 && share <= 1.0)) throw MessageError("a share is not 0 to 1");
  }
  if (!(pass.coneShare >= 0.0 && pass.coneShare <= 1.0)) {
    throw MessageError("a share is not 0 to 1");
  }
  const auto going = [this, begun = work.begun] { return views_ == begun; };
  if (!work.session->makeLight(pass.photons, going)) return;
  work.session->setConeShare(pass.coneShare);
  work.session->setTileShares(pass.shares);
  work.pass = std::move(pass);
}

void Worker::takeJob(Work& work, const GiveJob& message, std::uint32_t begun) {
  if (!work.pass || message.pass != work.pass->number) return;
  if (message.end <= message.first || message.end - message.first > kMostUnits) {
    throw MessageError("a job has no units, or too many");
  }
  const auto& tiles = work.session->buffers().tiles.tiles();
  const auto units = unitsOf({message.id, message.first, message.end}, tiles.size());
  const double start = secondsNow();
  TakenSamples taken;
  passBegun_ = begun;
  const auto going = [this] { return passes_ == passBegun_; };
  if (!work.session->takeUnits(units, going, taken)) return;
  Result result{.pass = message.pass, .id = message.id, .seconds = secondsNow() - start};
  result.samples = packSamples(taken.samples, work.pass->contents, sendsShort());
  sendResult(std::move(result), taken.rays, *work.session);
}

/// With what this machine has done so far.
void Worker::sendResult(Result result, const RayCounts& rays, const Session& session) {
  result.peakBytes = peakResidentBytes();
  const SessionReport done = session.report();
  result.device = done.device;
  result.times = {processorSeconds(),     done.photonSeconds,   done.traffic.waiting,
                  done.traffic.unpacking, done.traffic.reading, done.pages.loads,
                  done.pages.restored,    done.traffic.planned, pages_.bytes().received,
                  pages_.bytes().passed};
  result.cRays = rays.cRays;
  result.shadowRays = rays.shadowRays;
  result.cones = rays.cones;
  result.cacheReads = rays.cacheReads;
  result.exactPaths = rays.exactPaths;
  result.deviceCones = rays.deviceCones;
  tell(result);
}

void Worker::sayReady(std::uint64_t digest) {
  pages_.opened();
  tell(Ready{digest, pages_.passesOn()});
}

void Worker::run(std::shared_ptr<const Model> model, const std::vector<Camera>& views,
                 const RenderSettings& settings, std::uint64_t digest) {
  Work work{std::move(model), views, withoutPicture(settings), nullptr, ~0u, 0, {}};
  sayReady(digest);
  try {
    while (const auto heard = next()) {
      const ByteView body(heard->body);
      switch (heard->kind) {
        case Kind::kView:
          setView(work, decode<SetView>(body), heard->views);
          break;
        case Kind::kLight:
          passBegun_ = heard->passes;  // photons that wait for pages ask, too
          if (const auto light = decode<LightComes>(body);
              work.session && light.view == work.view) {
            work.session->makeLight(light.photons,
                                    [this, begun = work.begun] { return views_ == begun; });
          }
          break;
        case Kind::kPass:
          passBegun_ = heard->passes;
          startPass(work, decode<Pass>(body));
          break;
        case Kind::kRest:
          work.pass.reset();
          break;
        case Kind::kJob:
          takeJob(work, decode<GiveJob>(body), heard->passes);
          break;
        default:
          break;
      }
    }
  } catch (const MessageError& e) {
    fail(ExitCode::kFailed, "machine 0: a message can't be read: {}", e.what());
  }
}

void Worker::failed(const Error& error) {
  link_.send(0, Failed{static_cast<std::int32_t>(error.code()), error.what()});
  try {
    while (next()) continue;
  } catch (const Error&) {  // nobody is left to hear of it
  }
}

void Worker::finish() {
  server_.stop();
  {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [&] { return ended_ || problem_; });
  }
  link_.finish();
}

}  // namespace trex::machines
