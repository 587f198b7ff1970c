// Where units of work will go next: rates measured while jobs ran, times what is queued now.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

namespace trex::schedule {

/// Units that wait at stations (rays at blocks) and go from one to another. 8 bytes a pair of
/// stations. One thread at a time.
class Forecast {
 public:
  explicit Forecast(std::uint32_t stations)
      : stations_(stations), moved_(std::size_t{stations} * stations), served_(stations) {}
  /// A job at `from` has served this many units, ...
  void served(std::uint32_t from, double units) { served_[from] += units; }
  /// ... of which these went on to `to`.
  void moved(std::uint32_t from, std::uint32_t to, double units) {
    moved_[std::size_t{from} * stations_ + to] += units;
  }
  /// Share of the units served at `from` that went on to `to`; 0 if none was served. A unit may
  /// become several.
  double rate(std::uint32_t from, std::uint32_t to) const {
    return served_[from] > 0.0 ? moved_[std::size_t{from} * stations_ + to] / served_[from] : 0.0;
  }
  /// Units that come to each station when what is queued (a value a station) is served, and what
  /// came of that, `steps` times; as far as stations are `open`. None given: all are.
  std::vector<double> coming(std::span<const double> queued, int steps,
                             std::span<const char> open = {}) const;

 private:
  std::uint32_t stations_;
  std::vector<double> moved_, served_;
};

}  // namespace trex::schedule
