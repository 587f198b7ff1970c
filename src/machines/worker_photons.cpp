// Photons of a batch, shot together with machine 0 and the others.
#include "src/core/clock.h"
#include "src/machines/worker.h"

namespace trex::machines {

/// By the link's thread. What is not of the batch that is waited for is of no use any more.
void Worker::hearOfPhotons(Kind kind, ByteView body) {
  const auto awaited = [&](std::uint32_t view, std::uint64_t batch) {
    return batch_ && view == view_ && batch == batch_->batch().first;
  };
  if (kind == Kind::kPhotons) {
    Photons some = decode<Photons>(body);
    checkPhotons(some.photons, some.first, some.end);
    const std::lock_guard lock(mutex_);
    if (awaited(some.view, some.batch)) {
      batch_->add(some.first, some.end, std::move(some.photons));
    }
  } else if (kind == Kind::kShoot) {
    const auto job = decode<ShootPhotons>(body);
    const std::lock_guard lock(mutex_);
    if (awaited(job.view, job.batch)) {
      const PhotonBatch& all = batch_->batch();
      if (job.first < all.first || job.end > all.end || job.first >= job.end) {
        throw MessageError("it asks for photons of another batch");
      }
      photonJobs_.push_back(job);
    }
  } else {
    const auto past = decode<ShootAlone>(body);
    const std::lock_guard lock(mutex_);
    alone_ = alone_ || awaited(past.view, past.batch);
  }
  changed_.notify_all();
}

std::optional<ShotPhotons> Worker::shoot(const PhotonBatch& batch, const ShootHere& here,
                                         const std::function<bool()>& keepGoing) {
  std::unique_lock lock(mutex_);
  batch_.emplace(batch);
  photonJobs_.clear();
  alone_ = false;
  link_.send(0, AtPhotons{view_, batch.first, batch.end});
  while (!problem_ && !stopped_) {
    if (batch_->whole()) {
      ShotPhotons all = batch_->joined();
      batch_.reset();
      return all;
    }
    std::optional<ShootPhotons> job;
    if (!photonJobs_.empty()) {
      job = photonJobs_.front();
      photonJobs_.pop_front();
    } else if (!alone_) {
      changed_.wait_for(lock, std::chrono::milliseconds(20));
    }
    const bool alone = alone_;
    lock.unlock();
    if (!keepGoing()) return {};
    if (alone) return here(batch.first, batch.end);
    if (job) {
      const double start = secondsNow();
      auto shot = here(job->first, job->end);
      if (!shot) return {};
      Shot message{view_,           job->id,  batch.first,
                   job->first,      job->end, secondsNow() - start,
                   std::move(*shot)};
      tell(message);
      lock.lock();
      batch_->add(job->first, job->end, std::move(message.photons));
      continue;
    }
    lock.lock();
  }
  return {};
}

}  // namespace trex::machines
