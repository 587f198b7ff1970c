// Which tiles of a window's frame are at other machines: plain data, no messages, no threads, no
// clock of its own.
//
// A LOAN is some tiles whose next samples one machine takes. Loans are as large as what a machine
// brings back in the time between two visits of the window, by what it has brought so far, link
// included. What is late is taken back, and comes to nothing when it comes after all; a machine
// that owes such a loan gets no other until it has brought it, or has said that it comes to
// nothing.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <set>
#include <vector>

#include "src/session/scheduler.h"

namespace trex::machines {

struct Loan {
  std::uint32_t id = 0;  ///< never used again
  std::uint32_t machine = 0;
  std::vector<TileUnit> units;
  std::uint64_t samples = 0;  ///< of all of them
  double since = 0.0;
  double expected = 0.0;  ///< seconds until it is back; 0: not known
  bool back = false;      ///< it is, and waits for what the frame must have before
};

/// Times are seconds of any clock that does not go back. One thread at a time.
class Loans {
 public:
  static constexpr std::uint32_t kAtOnce = 2;  ///< of a machine, so that it does not wait

  /// Of machines 1 to `machines` - 1.
  explicit Loans(std::uint32_t machines) : machines_(machines) {}

  /// Samples that a machine's next loan should have, of which so many `seconds` may come back; 0
  /// if it has enough. At least 1 of one that is not known yet.
  std::uint64_t wanted(std::uint32_t machine, double seconds) const;
  /// Its id.
  std::uint32_t lend(std::uint32_t machine, std::vector<TileUnit> units, std::uint64_t samples,
                     double now);
  /// A loan, or null if there is none of this id any more.
  const Loan* find(std::uint32_t machine, std::uint32_t id) const;
  /// A machine has brought a loan, at `at`, which took it `seconds`: it may have another. One that
  /// has been taken back is no longer owed.
  void brought(std::uint32_t machine, std::uint32_t id, double seconds, double at);
  /// A machine has dropped a loan, and owes it no longer. Its units, unless it was taken back.
  std::vector<TileUnit> drop(std::uint32_t machine, std::uint32_t id);
  /// A loan is in the frame, or of no use.
  void end(std::uint32_t id);
  /// Takes back what a machine holds, or what is late, and not back yet. Where nothing else is left
  /// to do
  /// (`hurry`) that is sooner. Their units.
  std::vector<TileUnit> lose(std::uint32_t machine);
  std::vector<TileUnit> takeLate(double now, bool hurry);
  /// All loans are void, and nothing is owed.
  void clear();

  bool empty() const { return loans_.empty(); }
  /// Samples that a machine has brought.
  std::uint64_t samplesOf(std::uint32_t machine) const { return machines_[machine].samples; }
  std::uint64_t takenBack() const { return takenBack_; }

 private:
  struct Machine {
    std::uint32_t held = 0;
    std::set<std::uint32_t> owed;  ///< loans that were taken back
    double rate = 0.0;             ///< samples a second
    double last = 0.0;             ///< when it brought something
    std::uint64_t samples = 0;
  };
  template <typename Which>
  std::vector<TileUnit> take(const Which& which);

  std::vector<Machine> machines_;
  std::map<std::uint32_t, Loan> loans_;
  std::uint32_t nextId_ = 1;
  std::uint64_t takenBack_ = 0;
};

}  // namespace trex::machines
