// Samples of a session that are taken together with other machines.
#include "src/session/session.h"

namespace trex {

void Session::helpBy(SampleHelper* helper) {
  helper_ = helper;
  frame_->tiles.releaseAll();
}

bool Session::readsLight() const {
  const SessionState s = state();
  return s.guesses && s.light == VoxelLight::State::kReady;
}

void Session::startLight(const std::optional<Camera>& aim) {
  if (aim) light_.aimAt(*aim);
  light_.invalidate(VoxelLight::State::kPhotons);
}

bool Session::makeLight(std::uint64_t photons, const KeepGoing& keepGoing) {
  while (awaitsLight(state()) && light_.state() != VoxelLight::State::kShooting) renewLight();
  if (light_.state() == VoxelLight::State::kAbsent || light_.photons() >= photons) return true;
  shootPhotons(photons, keepGoing);
  return light_.photons() >= photons;
}

bool Session::takeUnits(std::span<const TileUnit> units, const KeepGoing& keepGoing,
                        TakenSamples& out) {
  return samples_.takeUnits(*frame_, source_, light_, units, keepGoing, out);
}

void Session::addTaken(std::span<const TileUnit> units, const TakenSamples& taken) {
  samples_.add(*frame_, units, taken);
}

std::vector<double> Session::tileShares() const {
  std::vector<double> shares;
  if (!frame_->dial) return shares;
  for (std::size_t i = 0; i < frame_->tiles.tiles().size(); ++i) {
    shares.push_back(frame_->dial->tile(i).share);
  }
  return shares;
}

void Session::setTileShares(std::span<const double> shares) {
  for (std::size_t i = 0; i < shares.size(); ++i) frame_->dial->setShare(i, shares[i]);
}

}  // namespace trex
