// Where units of work will go next: rates measured while jobs ran, times what is queued now.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

namespace trex::schedule {

/// Units that wait at stations (rays at blocks) and go from one to another. 8 bytes a pair of
/// stations, and 4 for each that units went between. One thread at a time.
class Forecast {
 public:
  /// `backward`: of what went from a to b this share is taken to go from b to a as well, which
  /// tells something of stations where nothing has been served yet. 0: what was measured alone.
  explicit Forecast(std::uint32_t stations, double backward = 0.0)
      : stations_(stations),
        backward_(backward),
        moved_(std::size_t{stations} * stations),
        served_(stations),
        next_(stations) {}
  /// A job at `from` has served this many units, ...
  void served(std::uint32_t from, double units) { served_[from] += units; }
  /// ... of which these went on to `to`.
  void moved(std::uint32_t from, std::uint32_t to, double units) {
    add(from, to, units);
    if (backward_ <= 0.0) return;
    add(to, from, backward_ * units);
    served_[to] += backward_ * units / kGoOn;
  }
  /// Share of the units served at `from` that go on to `to`; 0 if nothing is known. A unit may
  /// become several.
  double rate(std::uint32_t from, std::uint32_t to) const {
    return served_[from] > 0.0 ? moved_[std::size_t{from} * stations_ + to] / served_[from] : 0.0;
  }
  /// Units that come to each station when what is queued (a value a station) is served, and what
  /// came of that, `steps` times, or until hardly any is left; as far as stations are `open`. None
  /// given: all are.
  std::vector<double> coming(std::span<const double> queued, int steps,
                             std::span<const char> open = {}) const;

 private:
  static constexpr double kGoOn = 0.8;  ///< units of each that is served where nothing was yet
  void add(std::uint32_t from, std::uint32_t to, double units) {
    double& sum = moved_[std::size_t{from} * stations_ + to];
    if (sum == 0.0 && units > 0.0) next_[from].push_back(to);
    sum += units;
  }

  std::uint32_t stations_;
  double backward_;
  std::vector<double> moved_, served_;
  std::vector<std::vector<std::uint32_t>> next_;  ///< of each station: where units went
};

}  // namespace trex::schedule
