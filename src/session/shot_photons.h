// Photons as what they bring: where they landed, as a device reads it, and what guides learn of
// them. Plain data, so that they can be shot on another machine.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <vector>

#include "src/grays/shaderio.h"
#include "src/paths/photons.h"

namespace trex {

/// Of some photons, in the order of their numbers. What they are depends on their numbers and on
/// what guides had learned before their batch, alone.
struct ShotPhotons {
  std::vector<shaderio::PhotonRecord> records;
  std::vector<std::uint8_t> turns;  ///< LandedPhoton::turns, of each record; or none
  std::vector<PhotonLesson> lessons;
};

/// Photons [first, end) that no guide learns between.
struct PhotonBatch {
  std::uint64_t first = 0, end = 0;
  bool waits = false;  ///< they wait for pages: the more together the fewer loads
};

/// Shoots photons together with other machines.
class PhotonSharer {
 public:
  virtual ~PhotonSharer() = default;
  /// Shoots photons [first, end) here; none if they were given up.
  using ShootHere =
      std::function<std::optional<ShotPhotons>(std::uint64_t first, std::uint64_t end)>;
  /// All of a batch; none if keepGoing, or `here`, gave it up. Called again it goes on.
  virtual std::optional<ShotPhotons> shoot(const PhotonBatch& batch, const ShootHere& here,
                                           const std::function<bool()>& keepGoing) = 0;
  /// Whether nothing is ever shot here, so that nothing here need know where photons had better go.
  virtual bool shootsAll() const { return false; }
};

}  // namespace trex
