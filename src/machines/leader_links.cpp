// Links are measured one after the other, since all begin at machine 0; nobody waits for it. They
// say who passes pages on.
#include "src/core/clock.h"
#include "src/core/log.h"
#include "src/machines/leader.h"

namespace trex::machines {

/// The lock is held, as below.
void Leader::probe(std::uint32_t machine) {
  probes_.push_back({machine, {}});
  if (probes_.size() == 1) askProbe();
}

/// The next question to the first machine that is to be measured.
void Leader::askProbe() {
  while (!probes_.empty()) {
    auto& [machine, probe] = probes_.front();
    const Machine& m = machines_[machine];
    if (m.state == State::kGreeted || m.state == State::kReady) {
      if (const auto bytes = probe.ask(secondsNow())) {
        tell(machine, Probe{++probed_, Bytes(*bytes)});
        return;
      }
      machines_[machine].row.link = probe.speed();
      logVerbose("{}: {:.0f} Mbit/s, {:.2f} ms there and back", nameOf(machine),
                 8e-6 * probe.speed().bandwidth, 1e3 * probe.speed().roundTrip);
      tell(machine, LinkFound{probe.speed().roundTrip, probe.speed().bandwidth});
    }
    probes_.pop_front();
  }
}

/// Who passes pages on, if that has changed; to who has come in any case. The lock is held.
void Leader::tellHomes(std::optional<std::uint32_t> newcomer) {
  std::vector<HomeCandidate> candidates;
  for (std::uint32_t i = 1; i < machines_.size(); ++i) {
    const Machine& m = machines_[i];
    if (m.state == State::kReady && m.ready && m.passesOn) candidates.push_back({i, m.row.link});
  }
  std::vector<PageHome> homes = chooseHomes(candidates);
  const bool same = homes == homes_;
  homes_ = std::move(homes);
  for (std::uint32_t i = 1; i < machines_.size(); ++i) {
    if (machines_[i].state != State::kReady || (same && newcomer != i)) continue;
    if (same && homes_.empty()) continue;
    tell(i, Homes{homes_});
  }
}

/// Others are measured if one does not answer.
void Leader::dropProbeOf(std::uint32_t machine) {
  if (probes_.empty() || probes_.front().first != machine) return;
  askProbe();
}

void Leader::hearProbed(std::uint32_t from, const Probed& answer) {
  if (probes_.empty() || probes_.front().first != from || answer.number != probed_) return;
  probes_.front().second.answered(secondsNow());
  askProbe();
}

}  // namespace trex::machines
