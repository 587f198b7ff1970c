// How fast the link to another machine is: measured when it has greeted, by messages that are as
// large as it takes to tell. Plain data, no messages, no clock of its own.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <optional>

namespace trex::machines {

/// Of a link, as was measured; all zero before that.
struct LinkSpeed {
  double roundTrip = 0.0;  ///< seconds of a small message there and back, machines included
  double bandwidth = 0.0;  ///< bytes a second from machine 0
  bool known() const { return bandwidth > 0.0; }
};

/// Whether such a link can be, of what another machine says was measured.
inline bool isPossible(const LinkSpeed& link) {
  return link.roundTrip >= 0.0 && link.bandwidth > 0.0 && std::isfinite(link.roundTrip) &&
         std::isfinite(link.bandwidth);
}

/// Questions of some bytes, one at a time, that are answered by small messages: empty ones first,
/// of which the fastest counts, then larger ones, until one takes long enough to be measured. It is
/// asked a few times: machines that open a model are late now and then.
class LinkProbe {
 public:
  static constexpr std::uint32_t kFirstBytes = 1u << 16, kMostBytes = 1u << 21;

  /// Bytes of the next question, which is asked now; nothing once the speed is known.
  std::optional<std::uint32_t> ask(double now) {
    if (done_) return {};
    asked_ = now;
    return bytes_;
  }
  void answered(double now) {
    const double seconds = std::max(now - asked_, 1e-6);
    if (bytes_ == 0) {
      speed_.roundTrip = empty_ == 0 ? seconds : std::min(speed_.roundTrip, seconds);
      if (++empty_ == kEmpty) bytes_ = kFirstBytes;
      return;
    }
    // What the way takes by itself is in the round trip.
    travels_[large_++] = std::max(seconds - speed_.roundTrip, 1e-6);
    if (isShort(travels_[large_ - 1]) && large_ == 1) return tryMore();
    if (large_ < kLarge) return;
    // Machines that are busy make it longer than the link does; the fastest may have met an empty
    // buffer on its way.
    std::sort(travels_.begin(), travels_.end());
    if (isShort(2.0 * travels_[1])) return tryMore();
    speed_.bandwidth = bytes_ / travels_[1];
    done_ = true;
  }
  const LinkSpeed& speed() const { return speed_; }

 private:
  /// Too short to tell.
  bool isShort(double travelled) const {
    return bytes_ < kMostBytes && travelled < std::max(kLongEnough, 0.25 * speed_.roundTrip);
  }
  void tryMore() {
    bytes_ *= 2;
    large_ = 0;
  }
  static constexpr std::uint32_t kEmpty = 4, kLarge = 5;
  static constexpr double kLongEnough = 0.01;  // seconds
  LinkSpeed speed_;
  std::uint32_t bytes_ = 0, empty_ = 0, large_ = 0;
  std::array<double, kLarge> travels_{};  ///< seconds
  double asked_ = 0.0;
  bool done_ = false;
};

/// Pages to ask for in one question: so many that they take three times as long as the way there
/// and back. Between machines that are near that is one, but most of a question's time is that of
/// threads that do something else, so it is several anyway.
inline unsigned pagesAtOnce(const LinkSpeed& link) {
  constexpr unsigned kLeast = 8, kMost = 32;
  constexpr double kPageBytes = 16384.0;  // packed, about
  if (!link.known()) return kLeast;
  const double pages = std::ceil(3.0 * link.roundTrip * link.bandwidth / kPageBytes);
  return static_cast<unsigned>(std::clamp(pages, double{kLeast}, double{kMost}));
}

}  // namespace trex::machines
