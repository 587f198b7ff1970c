// A batch of photons that comes in parts, from whoever has shot them.
#pragma once

#include <cstdint>
#include <map>

#include "src/machines/jobs.h"
#include "src/machines/messages.h"

namespace trex::machines {

/// Photons of a unit of their jobs (jobs.h).
inline constexpr std::uint64_t kPhotonsAUnit = 256;

/// The units of a batch's jobs.
inline std::uint64_t unitsOf(const PhotonBatch& batch) {
  return (batch.end - batch.first + kPhotonsAUnit - 1) / kPhotonsAUnit;
}
/// Photons of a job of it.
inline PhotonBatch photonsOf(const Job& job, const PhotonBatch& batch) {
  return {batch.first + job.first * kPhotonsAUnit,
          std::min(batch.first + job.end * kPhotonsAUnit, batch.end), batch.waits};
}
/// How they are dealt. A result is one message, also where every photon lands as often as it may.
JobSizes photonJobSizes(const PhotonBatch& batch, std::uint32_t machines);

/// Throws MessageError if they can't be photons [first, end).
void checkPhotons(const ShotPhotons& photons, std::uint64_t first, std::uint64_t end);

class PhotonParts {
 public:
  struct Part {
    std::uint64_t end = 0;
    ShotPhotons photons;
  };
  explicit PhotonParts(const PhotonBatch& batch = {}) : batch_(batch) {}

  const PhotonBatch& batch() const { return batch_; }
  /// False if they are there, or are none of the batch's.
  bool add(std::uint64_t first, std::uint64_t end, ShotPhotons photons);
  bool whole() const { return photons_ == batch_.end - batch_.first; }
  /// By their first photon.
  const std::map<std::uint64_t, Part>& parts() const { return parts_; }
  /// All that is there, in order.
  ShotPhotons joined() const;
  std::uint64_t bytes() const { return bytes_; }

 private:
  PhotonBatch batch_;
  std::map<std::uint64_t, Part> parts_;
  std::uint64_t photons_ = 0, bytes_ = 0;
};

}  // namespace trex::machines
