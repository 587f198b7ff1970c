// Photons of a window that has no room for the pages which they would need: those of the machine
// that has the model. It shoots them for its own light in any case.
#include <chrono>

#include "src/machines/photon_parts.h"
#include "src/machines/servers.h"

namespace trex::machines {
namespace {

constexpr auto kAwaitShot = std::chrono::milliseconds(2);

}  // namespace

void Servers::shot(std::uint32_t machine, Shot shot) {
  const std::lock_guard lock(mutex_);
  if (machine != holder_ || !aim_ || shot.view != aim_->light) return;
  shots_.push_back(std::move(shot));
  changed_.notify_all();
}

void Servers::failed(std::uint32_t machine, const std::string& why) {
  const std::lock_guard lock(mutex_);
  if (machine != holder_) return;
  problem_ = why;
  changed_.notify_all();
}

std::optional<ShotPhotons> Servers::shoot(const PhotonBatch& batch, const ShootHere&,
                                          const std::function<bool()>& keepGoing) {
  for (;;) {
    {
      std::unique_lock lock(mutex_);
      PhotonParts parts(batch);
      for (const Shot& shot : shots_) parts.add(shot.first, shot.end, shot.photons);
      if (parts.whole()) {
        std::erase_if(shots_, [&](const Shot& shot) { return shot.first < batch.end; });
        return parts.joined();
      }
      if (!problem_.empty()) {
        fail(ExitCode::kFailed, "{}, and it has the model; a --cache for all pages needs it less",
             problem_);
      }
      changed_.wait_for(lock, kAwaitShot);
    }
    if (!keepGoing()) return {};
  }
}

}  // namespace trex::machines
