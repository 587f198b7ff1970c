// Links are measured one after the other, since all begin at machine 0. Nobody waits for it.
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
