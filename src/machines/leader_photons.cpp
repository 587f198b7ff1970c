// Photons of a batch, shot by all machines that are at it. One that comes late gets what the others
// have shot, or, where that is gone, shoots the batch alone: photons are the same whoever shoots
// them.
#include <algorithm>

#include "src/core/clock.h"
#include "src/machines/leader.h"

namespace trex::machines {
namespace {

constexpr double kPatience =
    1.0;  // seconds that large jobs wait for machines that are on their way

}  // namespace

void Leader::forgetPhotons() {
  batch_.reset();
  kept_.clear();
  keptBytes_ = photonsDone_ = 0;
  photonJobs_.start(0, 0, {});
  for (Machine& m : machines_) m.at.reset();
}

/// False if it is under way.
bool Leader::startBatch(const PhotonBatch& batch) {
  const std::lock_guard lock(mutex_);
  throwIfFailed();
  const bool same =
      batch_ && batch_->batch().first == batch.first && batch_->batch().end == batch.end;
  if (same) return false;
  batch_.emplace(batch);
  photonsDone_ = batch.first;
  photonJobs_.start(0, unitsOf(batch), photonJobSizes(batch, link_.size()));
  for (std::uint32_t i = 1; i < machines_.size(); ++i) photonJobs_.lose(i);  // until it is at it
  answerAll();
  return true;
}

/// The lock is held.
ShotPhotons Leader::endBatch() {
  const PhotonBatch batch = batch_->batch();
  ShotPhotons all = batch_->joined();
  for (Machine& m : machines_) {  // whoever is silent may have missed some
    if (m.at && m.at->first == batch.first && m.state == State::kReady) m.at.reset();
  }
  if (keptBytes_ + batch_->bytes() <= kKeptPhotonBytes) {
    keptBytes_ += batch_->bytes();
    kept_.insert_or_assign(batch.first, std::move(*batch_));
  }
  batch_.reset();
  photonsDone_ = batch.end;
  photonJobs_.start(0, 0, {});
  answerAll();
  return all;
}

void Leader::answerAll() {
  for (std::uint32_t i = 1; i < machines_.size(); ++i) {
    if (machines_[i].state == State::kReady) answerAt(i);
  }
}

/// What a machine that waits for a batch gets; nothing yet if that is still to come.
void Leader::answerAt(std::uint32_t machine) {
  Machine& m = machines_[machine];
  if (!m.at) return;
  const auto is = [&](const PhotonBatch& b) {
    return b.first == m.at->first && b.end == m.at->end;
  };
  if (batch_ && is(batch_->batch())) {
    sendParts(machine, *batch_);
    photonJobs_.join(machine);
    return dealPhotons(machine);
  }
  if (m.at->first >= photonsDone_ && !(batch_ && m.at->first == batch_->batch().first)) return;
  const auto kept = kept_.find(m.at->first);
  if (kept != kept_.end() && is(kept->second.batch())) {
    sendParts(machine, kept->second);
  } else {
    tell(machine, ShootAlone{*view_, m.at->first});
  }
  m.at.reset();
}

void Leader::sendParts(std::uint32_t to, const PhotonParts& parts) {
  for (const auto& [first, part] : parts.parts()) {
    tell(to, Photons{*view_, 0, parts.batch().first, first, part.end, 0.0, part.photons});
  }
}

void Leader::dealPhotons(std::uint32_t machine) {
  if (machine == 0 || !batch_) return;
  while (const auto job = photonJobs_.deal(machine, secondsNow())) {
    const PhotonBatch part = photonsOf(*job, batch_->batch());
    tell(machine, ShootPhotons{*view_, job->id, batch_->batch().first, part.first, part.end});
  }
}

/// Photons of a job, shot by a machine. The lock is held. What comes twice, or too late, is left
/// out.
void Leader::takePhotons(std::uint32_t from, Shot shot) {
  const auto job = photonJobs_.bring(from, shot.id, shot.seconds);
  if (!job) return;
  const PhotonBatch batch = batch_->batch(), part = photonsOf(*job, batch);
  if (part.first != shot.first || part.end != shot.end) {
    throw MessageError("it has shot other photons than it was asked for");
  }
  machines_[from].row.photons += part.end - part.first;
  const Photons message{*view_, 0, batch.first, part.first, part.end, 0.0, std::move(shot.photons)};
  const Bytes bytes = link_.size() > 1 ? encode(message) : Bytes();
  for (std::uint32_t i = 1; i < machines_.size(); ++i) {
    const auto& at = machines_[i].at;
    if (i != from && at && at->first == batch.first && at->end == batch.end) tell(i, bytes);
  }
  batch_->add(part.first, part.end, message.photons);
  changed_.notify_all();
}

/// By the link's thread; the lock is held.
void Leader::hearShot(std::uint32_t from, Shot shot) {
  checkPhotons(shot.photons, shot.first, shot.end);
  if (listener_ != nullptr) return listener_->shot(from, std::move(shot));
  if (!batch_ || shot.view != view_ || shot.batch != batch_->batch().first) return;
  if (!(shot.seconds >= 0.0 && shot.seconds < 1e9)) shot.seconds = 0.0;
  takePhotons(from, std::move(shot));
  dealPhotons(from);
}

/// One job of this machine's own. False if it was given up; without a job it waits a little.
bool Leader::shootOne(const ShootHere& here, const std::function<bool()>& keepGoing) {
  std::optional<Job> job;
  PhotonBatch part;
  {
    std::unique_lock lock(mutex_);
    job = photonJobs_.deal(0, secondsNow());
    if (!job) {
      if (!batch_->whole()) changed_.wait_for(lock, std::chrono::milliseconds(20));
      lock.unlock();
      return keepGoing();
    }
    part = photonsOf(*job, batch_->batch());
  }
  const double start = secondsNow();
  auto shot = here(part.first, part.end);
  {
    const std::lock_guard lock(mutex_);
    if (!shot) {
      photonJobs_.giveBack(0, job->id);
      return false;
    }
    takePhotons(0, {*view_, job->id, batch_->batch().first, part.first, part.end,
                    secondsNow() - start, std::move(*shot)});
  }
  return keepGoing();
}

/// Where jobs are large those who come late find none.
void Leader::waitForBatch(const std::function<bool()>& keepGoing) {
  const double end = secondsNow() + kPatience;
  std::unique_lock lock(mutex_);
  const auto isComing = [&](const Machine& m) {
    return m.state == State::kReady && !(m.at && m.at->first == batch_->batch().first);
  };
  while (!failure_ && secondsNow() < end &&
         std::any_of(machines_.begin() + 1, machines_.end(), isComing)) {
    lock.unlock();
    const bool going = keepGoing();
    lock.lock();
    if (!going) return;
    changed_.wait_for(lock, std::chrono::milliseconds(20));
  }
}

std::optional<ShotPhotons> Leader::shoot(const PhotonBatch& batch, const ShootHere& here,
                                         const std::function<bool()>& keepGoing) {
  if (!view_) return here(batch.first, batch.end);
  if (startBatch(batch) && batch.waits) waitForBatch(keepGoing);
  for (bool going = true;;) {
    {
      const std::lock_guard lock(mutex_);
      throwIfFailed();
      if (batch_->whole()) return endBatch();
    }
    if (!going) return {};  // the next call goes on
    going = shootOne(here, keepGoing);
  }
}

}  // namespace trex::machines
