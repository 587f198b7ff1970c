// When one device or one channel is busy.
#pragma once

#include <algorithm>
#include <vector>

namespace trex::schedule {

/// Busy spans that never overlap, in order of time. Seconds.
class Timeline {
 public:
  struct Span {
    double start = 0.0, end = 0.0;
  };
  /// Start of the first free slot of `length` that begins at `after` or later.
  double earliest(double after, double length) const {
    auto next = std::upper_bound(spans_.begin(), spans_.end(), after,
                                 [](double t, const Span& s) { return t < s.end; });
    for (; next != spans_.end() && next->start < after + length; ++next) after = next->end;
    return after;
  }
  /// The span must be free. Returns its place for undo().
  std::size_t take(double start, double length) {
    const auto at = std::upper_bound(spans_.begin(), spans_.end(), start,
                                     [](double t, const Span& s) { return t < s.start; });
    const auto place = at - spans_.begin();
    spans_.insert(at, {start, start + length});
    return static_cast<std::size_t>(place);
  }
  /// Takes back what take() did last.
  void undo(std::size_t place) { spans_.erase(spans_.begin() + static_cast<long>(place)); }
  /// Nothing is busy from here on; `now` if nothing is at all.
  double end(double now) const { return spans_.empty() ? now : std::max(now, spans_.back().end); }
  /// The first moment from `now` on that is not in a span: nothing can begin before.
  double free(double now) const {
    for (const Span& s : spans_) {
      if (s.start > now) break;
      now = std::max(now, s.end);
    }
    return now;
  }

 private:
  std::vector<Span> spans_;
};

}  // namespace trex::schedule
