#include "src/session/light_pass.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <bit>
#include <chrono>
#include <cmath>

#include "src/paths/importons.h"
#include "src/paths/walk_tracer.h"

namespace trex {
namespace {

constexpr std::uint64_t kBatch = 1u << 18;  // photons that guides learn from at a time
/// Guides learn after each batch, so the first ones are small.
constexpr std::uint64_t kPilotBatch = 1u << 14, kPilotPhotons = 1u << 17;
constexpr double kPhotonSeconds = 1.5e-6;  // of one, before it is known
constexpr std::uint64_t kMostPhotons = shaderio::kPhotonNumbers;
/// Counts of the largest photon: 2^30 photons x 2^8 deposits x 2^20 counts stay below 2^63.
constexpr double kLargestCounts = 1u << 20;
static_assert(kPhotonBounces == shaderio::kMostPhotonBounces && kPhotonBounces == 1u << 8);

}  // namespace

std::uint64_t photonTarget(std::uint32_t sample, std::uint64_t pixels) {
  const std::uint64_t base = std::clamp<std::uint64_t>(pixels / 2, 1u << 12, 1u << 20);
  // Powers of four: a step costs a resolve of all voxels.
  const int steps = sample == 0 ? 0 : (std::bit_width(sample) - 1) / 2;
  const std::uint64_t rounds = sample < 4 ? 0 : std::uint64_t{1} << (2 * steps - 1);
  return std::min(base + base * rounds, kMostPhotons);
}

LightPass::LightPass(const Scene& scene, const WalkTracer& walks, const LightSet& lights,
                     GRayTracer& device, LightCache& cache, std::uint32_t seed, bool rayBounces,
                     double slice)
    : scene_(scene),
      walks_(walks),
      lights_(lights),
      device_(device),
      cache_(cache),
      seed_(seed),
      rayBounces_(rayBounces || walks.rays().media() != nullptr ||
                  scene.maxBounces != Scene::kAnyBounces),
      slice_(slice),
      chunk_(std::bit_floor(static_cast<std::uint64_t>(slice / kPhotonSeconds))) {
  const Box3f bounds = walks.rays().bounds();
  const double radius = bounds.empty() ? 1.0 : 0.5 * glm::length(dvec3(bounds.size()));
  const double sphere = 4.0 * std::numbers::pi * radius * radius;
  if (scene.maxBounces != Scene::kAnyBounces && !bounds.empty()) {
    const std::uint32_t most = std::max(scene.maxBounces, 2u) - 2u;
    turns_ = TurnSums(bounds, std::min(most, kPhotonBounces - 1u));
  }
  if (lights.totalPower() > 0.0 && sphere > 0.0) scale_ = lights.totalPower() / sphere;
  unit_ = static_cast<double>(lights.largestPhotonPower()) / scale_ / kLargestCounts;
}

void LightPass::aim(const CameraRays& camera, std::uint32_t width, std::uint32_t height) {
  guides_ = lights_.guides();
  if (guides_.empty() || (sharer_ != nullptr && sharer_->shootsAll())) return;
  const auto start = std::chrono::steady_clock::now();
  importance_ = traceImportons(scene_, walks_, camera, width, height, seed_);
  if (importance_.empty()) guides_.clear();
  hintGuides(scene_, walks_, lights_, importance_, guides_);
  hints_ = guides_;
  const std::chrono::duration<double> taken = std::chrono::steady_clock::now() - start;
  seconds_ += taken.count();
}

void LightPass::tellLots() {
  const Box3f bounds = walks_.rays().bounds();
  if (!bounds.empty()) lots_ = LotSums(bounds);
}

/// Where the batch under way ends: guides learn there.
std::uint64_t LightPass::boundary() const {
  const bool pilot = !guides_.empty() && emitted_ < kPilotPhotons;
  const std::uint64_t batch = pilot ? kPilotBatch : kBatch;
  return (emitted_ / batch + 1) * batch;
}

/// Photons [first, first + count) of the batch under way; none if they were given up, or missed a
/// page.
std::optional<ShotPhotons> LightPass::land(std::uint64_t first, std::uint64_t count,
                                           const std::function<bool()>& giveUp) const {
  const auto inverse = static_cast<float>(1.0 / scale_);
  const std::uint64_t missed = walks_.rays().missed();
  const auto landed =
      landPhotons(scene_, walks_, lights_, seed_, first, count, rayBounces_, guides_, giveUp);
  if (!landed || walks_.rays().missed() != missed) return {};
  ShotPhotons shot;
  shot.records.resize(landed->size());
  tbb::parallel_for(std::size_t{0}, landed->size(), [&](std::size_t i) {
    const LandedPhoton& p = (*landed)[i];
    const std::uint32_t flags = (rayBounces_ || !p.held ? shaderio::kLastLanding : 0u) +
                                (p.bounce > 0 ? shaderio::kLaterLanding : 0u);
    shot.records[i] = {p.position, cache_.tracer().asvoOctEncode(p.normal), p.power * inverse,
                       p.index + flags};
  });
  if (turns_.counts()) {
    for (const LandedPhoton& p : *landed)
      shot.turns.push_back(static_cast<std::uint8_t>(std::min(p.turns, 255u)));
  }
  shot.lessons = lessonsOf(*landed, importance_, guides_);
  return shot;
}

/// The same by all machines together, if there are several.
std::optional<ShotPhotons> LightPass::landTogether(std::uint64_t count,
                                                   const std::function<bool()>& keepGoing,
                                                   const std::function<bool()>& giveUp) {
  if (sharer_ == nullptr) return land(emitted_, count, giveUp);
  const auto here = [&](std::uint64_t first, std::uint64_t end) {
    return land(first, end - first, giveUp);
  };
  return sharer_->shoot({emitted_, emitted_ + count, walks_.waits()}, here, keepGoing);
}

/// False if it was given up: nothing has changed then.
bool LightPass::shoot(std::uint64_t count, const std::function<bool()>& keepGoing,
                      const std::function<bool()>& giveUp) {
  const std::uint64_t end = boundary();
  auto shot = landTogether(count, keepGoing, giveUp);
  if (!shot) return false;
  for (const shaderio::PhotonRecord& r : shot->records) {
    landed_ += (r.index & shaderio::kLaterLanding) == 0 ? 1 : 0;
  }
  if (!shot->records.empty()) device_.tracePhotons(shot->records, unit_);
  if (noticeLoss()) return true;
  for (std::size_t i = 0; i < shot->turns.size(); ++i) {
    const vec3& power = shot->records[i].power;
    turns_.add(shot->records[i].position, shot->turns[i], power.x + power.y + power.z);
  }
  if (lots_.counts()) {
    for (const shaderio::PhotonRecord& r : shot->records) {
      lots_.add(r.position, r.index & (shaderio::kPhotonNumbers - 1u),
                r.power.x + r.power.y + r.power.z);
    }
  }
  emitted_ += count;
  if (guides_.empty()) return true;
  unlearned_.insert(unlearned_.end(), shot->lessons.begin(), shot->lessons.end());
  if (emitted_ < end) return true;
  wanted_ += unlearned_.size();
  learn(unlearned_, guides_);
  unlearned_.clear();
  return true;
}

/// Whether the device has lost the flux of all photons so far: the same ones start anew.
bool LightPass::noticeLoss() {
  if (device_.fluxLosses() == losses_) return false;
  losses_ = device_.fluxLosses();
  device_.resetFlux();  // what came after the loss is shot again, too
  emitted_ = landed_ = wanted_ = 0;
  turns_.restart();
  if (lots_.counts()) lots_.restart();
  unlearned_.clear();
  guides_ = hints_;
  return true;
}

bool LightPass::run(std::uint64_t target, const std::function<bool()>& keepGoing,
                    const std::function<bool()>& giveUp) {
  if (target <= resolved_ || !lights_.anyPower()) return true;
  const auto start = std::chrono::steady_clock::now();
  bool going = true;
  noticeLoss();  // while cones were traced
  do {
    while (emitted_ < target && (going = going && keepGoing())) {
      const auto mark = std::chrono::steady_clock::now();
      // Photons that wait share loads: the more the better. Machines wait for each other after
      // each.
      const std::uint64_t most = walks_.waits() || sharer_ != nullptr ? kBatch : chunk_;
      going = shoot(std::min({most, boundary() - emitted_, target - emitted_}), keepGoing, giveUp);
      const std::chrono::duration<double> taken = std::chrono::steady_clock::now() - mark;
      if (taken.count() > 1.5 * slice_) chunk_ = std::max<std::uint64_t>(chunk_ / 2, 256);
      if (taken.count() < 0.5 * slice_) chunk_ = std::min(chunk_ * 2, kBatch);
    }
    going = going && device_.resolveLight(emitted_, keepGoing);
  } while (noticeLoss());
  if (going) {
    cache_.setLight(device_.light(), scale_, static_cast<double>(emitted_), device_.lightBefore(),
                    static_cast<double>(resolved_));
    if (turns_.counts()) cache_.setTurns(turns_.shares());
    if (lots_.counts()) cache_.setLots(lots_.settle(emitted_));
    resolved_ = emitted_;
  }
  const std::chrono::duration<double> taken = std::chrono::steady_clock::now() - start;
  seconds_ += taken.count();
  return going;
}

}  // namespace trex
