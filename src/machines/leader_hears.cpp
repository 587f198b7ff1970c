// What machine 0 hears of the others, by the link's thread.
#include "src/core/clock.h"
#include "src/core/log.h"
#include "src/machines/identity.h"
#include "src/machines/leader.h"

namespace trex::machines {
namespace {

constexpr double kPingSeconds = 1.0;

}  // namespace

void Leader::hear(std::uint32_t from, Kind kind, ByteView body) {
  if (hearOfFiles(from, kind, body)) return;
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
    case Kind::kReady: {
      const auto ready = decode<Ready>(body);
      m.digest = ready.digest;
      m.passesOn = ready.passesOn != 0;
      checkReady(from);
      break;
    }
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
    case Kind::kAtPhotons: {
      const auto at = decode<AtPhotons>(body);
      if (at.end <= at.first) throw MessageError("a batch has no photons");
      if (at.view != view_) break;
      m.at = {at.first, at.end};
      if (m.state == State::kReady) answerAt(from);
      break;
    }
    case Kind::kShot:
      hearShot(from, decode<Shot>(body));
      break;
    case Kind::kLit:
      if (listener_ != nullptr) listener_->lit(from, decode<Lit>(body));
      break;
    case Kind::kNoLoan:
      if (listener_ != nullptr) listener_->noLoan(from, decode<NoLoan>(body).id);
      break;
    case Kind::kProbed:
      hearProbed(from, decode<Probed>(body));
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
  if (listener_ != nullptr) {  // a window goes on
    machines_[machine].ready = false;
    machines_[machine].digest.reset();
    logWarning("{}: {}; going on without it", nameOf(machine), text);
  } else if (!failure_) {
    failure_.emplace(known ? static_cast<ExitCode>(code) : ExitCode::kFailed,
                     fmt::format("{}: {}", nameOf(machine), text));
  }
  lose(machine);
  if (listener_ != nullptr)
    listener_->failed(machine, fmt::format("{}: {}", nameOf(machine), text));
  changed_.notify_all();
}

void Leader::greet(std::uint32_t from, const Hello& hello) {
  Machine& m = machines_[from];
  m.row.host = hello.host;
  m.row.threads = hello.threads;
  m.row.instructions = hello.instructions;
  m.row.model = hello.model;
  m.row.modelBytes = hello.modelBytes;
  m.row.modelDigest = hello.modelDigest;
  m.state = State::kGreeted;
  if (const std::string why = whyUnfit(self_, hello); !why.empty()) {
    fail(from, static_cast<int>(ExitCode::kFailed), why);
    return;
  }
  if (hello.instructions != self_.instructions) {
    logWarning("{}: has {}, machine 0 has {}: pictures may differ in their last bits", nameOf(from),
               instructionText(hello.instructions), instructionText(self_.instructions));
  }
  if (welcome_) sendWelcome(from);
  // While it waits for what there is to open; one that opens its own copy has no processor to
  // spare.
  if (!welcome_ || !welcome_->local) probe(from);
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
  if (welcome_ && welcome_->local) probe(from);
  bringIn(from);
}

/// Tells a machine what is under way.
void Leader::bringIn(std::uint32_t machine) {
  tellHomes(machine);
  if (listener_ != nullptr) return listener_->ready(machine);
  if (!view_) return;
  if (machines_[machine].view != *view_) tell(machine, SetView{*view_});
  if (light_) tell(machine, *light_);
  if (pass_) tell(machine, *pass_);
  if (machines_[machine].view != *view_) return;  // it joins once it says that it has
  ledger_.join(machine);
  dealTo(machine);
  answerAt(machine);
}

void Leader::takeResult(std::uint32_t from, Result result) {
  machines_[from].row.peakBytes = result.peakBytes;
  machines_[from].row.times = result.times;
  if (welcome_ && welcome_->local) machines_[from].row.times.plannedBytes = 0;  // from its own disk
  machines_[from].row.device = result.device;
  if (listener_ != nullptr) return listener_->result(from, std::move(result));
  if (!pass_ || result.pass != pass_->number) return;
  const double seconds = result.seconds >= 0.0 && result.seconds < 1e9 ? result.seconds : 0.0;
  if (const auto job = ledger_.bring(from, result.id, seconds)) {
    arrived_.emplace(job->first, Arrived{*job,
                                         from,
                                         {result.cRays, result.shadowRays, result.cones,
                                          result.cacheReads, result.exactPaths, result.deviceCones},
                                         std::move(result.samples)});
  }
  dealTo(from);
}

void Leader::dealTo(std::uint32_t machine) {
  if (machine == 0 || !pass_) return;
  while (const auto job = ledger_.deal(machine, secondsNow())) {
    tell(machine, GiveJob{pass_->number, job->id, job->first, job->end});
  }
}

void Leader::dealAll() {
  for (std::uint32_t m = 1; m < machines_.size(); ++m) {
    dealTo(m);
    dealPhotons(m);
  }
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
    dropProbeOf(i);
    lose(i);
    changed_.notify_all();
  }
  dealAll();  // what has been lost, and what is late
  if (now - pinged_ < kPingSeconds) return;
  pinged_ = now;
  for (std::uint32_t i = 1; i < machines_.size(); ++i) {
    if (machines_[i].state != State::kGone) tell(i, Ping{});
  }
}

}  // namespace trex::machines
