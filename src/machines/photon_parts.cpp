#include "src/machines/photon_parts.h"

#include <algorithm>
#include <cmath>

namespace trex::machines {
namespace {

constexpr std::uint64_t kMostPhotonUnits = 64;   // of a job
constexpr std::uint64_t kLargePhotonUnits = 64;  // where photons wait for pages

bool finite(const vec3& v) {
  return std::isfinite(v.x) && std::isfinite(v.y) && std::isfinite(v.z);
}

bool isLesson(const PhotonLesson& l) {
  bool good =
      std::isfinite(l.density) && l.density > 0.0f && std::isfinite(l.visits) && l.visits > 0.0f;
  for (int k = 0; k < 4; ++k) good &= l.primary[k] >= 0.0f && l.primary[k] <= 1.0f;
  return good;
}

}  // namespace

JobSizes photonJobSizes(const PhotonBatch& batch, std::uint32_t machines) {
  JobSizes sizes;
  sizes.most = kMostPhotonUnits;
  sizes.ownSeconds = 0.03;  // keepGoing is asked after each
  sizes.window = unitsOf(batch);
  if (!batch.waits) return sizes;
  sizes.large = std::min(kLargePhotonUnits, std::max<std::uint64_t>(unitsOf(batch) / machines, 2));
  sizes.most = std::max(sizes.most, sizes.large);
  sizes.atOnce = 1;
  return sizes;
}

void checkPhotons(const ShotPhotons& photons, std::uint64_t first, std::uint64_t end) {
  std::uint64_t last = first;
  for (const shaderio::PhotonRecord& r : photons.records) {
    const std::uint64_t number = r.index & (shaderio::kPhotonNumbers - 1);
    if (number < last || number >= end) throw MessageError("photons are not those of their job");
    if (!finite(r.position) || !finite(r.power) || glm::any(glm::lessThan(r.power, vec3(0.0f)))) {
      throw MessageError("a photon has no place, or no power");
    }
    last = number;
  }
  if (!photons.turns.empty() && photons.turns.size() != photons.records.size()) {
    throw MessageError("turns are not those of the photons");
  }
  if (!std::all_of(photons.lessons.begin(), photons.lessons.end(), isLesson)) {
    throw MessageError("photons teach what can't be");
  }
}

bool PhotonParts::add(std::uint64_t first, std::uint64_t end, ShotPhotons photons) {
  if (first < batch_.first || end > batch_.end || first >= end) return false;
  const auto next = parts_.lower_bound(first);
  if (next != parts_.end() && next->first < end) return false;
  if (next != parts_.begin() && std::prev(next)->second.end > first) return false;
  photons_ += end - first;
  bytes_ += photons.records.size() * sizeof(shaderio::PhotonRecord) + photons.turns.size() +
            photons.lessons.size() * sizeof(PhotonLesson);
  parts_[first] = {end, std::move(photons)};
  return true;
}

ShotPhotons PhotonParts::joined() const {
  ShotPhotons all;
  for (const auto& [first, part] : parts_) {
    all.records.insert(all.records.end(), part.photons.records.begin(), part.photons.records.end());
    all.turns.insert(all.turns.end(), part.photons.turns.begin(), part.photons.turns.end());
    all.lessons.insert(all.lessons.end(), part.photons.lessons.begin(), part.photons.lessons.end());
  }
  return all;
}

}  // namespace trex::machines
