// What is committed so far while a plan is made: times of devices and channels, copies and room.
#pragma once

#include <cstdint>
#include <vector>

#include "src/schedule/state.h"
#include "src/schedule/timeline.h"

namespace trex::schedule {

/// When a job would run on a device: never if it can't.
struct Offer {
  double start = kNever, end = kNever;
  double again = 0.0;  ///< seconds of stores' channels for what is in another memory already
  bool possible() const { return start < kNever; }
};

/// Begins with what runs and moves in a state. `state` outlives it.
class Board {
 public:
  Board(const State& state, Evict evict);

  /// No later than place() would say, at a fraction of the cost: nothing else waits for a channel
  /// but the first hop, and room is there.
  Offer atBest(std::uint32_t job, std::uint32_t device) const;
  /// With the earliest free slots: each item that is missing comes over the path that brings it
  /// first, then the job runs. Commits nothing.
  Offer place(std::uint32_t job, std::uint32_t device) { return settle(job, device, false); }
  /// The same, and commits fetches, evictions and the job, if it is possible.
  Offer commit(std::uint32_t job, std::uint32_t device) {
    return place(job, device).possible() ? settle(job, device, true) : Offer();
  }
  /// Likewise, what place() has just said is possible.
  Offer commitPlaced(std::uint32_t job, std::uint32_t device) { return settle(job, device, true); }
  /// Brings the item that is needed most of those that are in stores alone over a channel that has
  /// nothing to do, into room that is free. False if there is no such item, room or channel.
  bool bringAhead(std::uint32_t channel);
  /// Of what is needed of items (Item::need), the share that is in stores alone.
  double neededFromStores() const;
  /// The first moment at which a device has nothing committed any more.
  double deviceEnd(std::uint32_t device) const { return devices_[device].end(s_.now); }
  /// What was committed.
  Schedule& schedule() { return made_; }

 private:
  /// One item in one memory.
  struct Copy {
    double arrival = kNever;     ///< when it is there
    double until = 0.0;          ///< when the last that uses it has ended, or it is given up
    mutable double loss = -1.0;  ///< of giving it up, once it was asked for
  };
  /// Room that is given back when a job has ended.
  struct Release {
    double time = 0.0, bytes = 0.0;
  };
  struct Room {
    double free = 0.0;
    std::vector<std::uint32_t> held;  ///< items that may be evicted at some time
    std::vector<Release> releases;
  };
  /// Room for some bytes: when, and what goes for it.
  struct Clearing {
    double time = kNever;
    std::vector<std::uint32_t> victims;  ///< places in Room::held
    std::size_t releases = 0;            ///< of the earliest ones
    double bytes = 0.0;                  ///< in all
  };
  struct Taken {
    std::uint32_t channel = 0;
    std::size_t place = 0;
  };

  Copy& copy(std::uint32_t item, std::uint32_t memory) { return copies_[rows_[item] + memory]; }
  const Copy& copy(std::uint32_t item, std::uint32_t memory) const {
    return copies_[rows_[item] + memory];
  }
  void readCopies();
  void readWork();
  Offer settle(std::uint32_t job, std::uint32_t device, bool keep);
  double bring(const Job& job, std::uint32_t item, std::uint32_t target, bool keep);
  double along(const Job& job, std::uint32_t item, double from,
               const std::vector<Routes::Hop>& hops, bool keep);
  double takeRoom(const Job& job, std::uint32_t memory, double bytes, bool keep,
                  std::vector<std::uint32_t>& evicted);
  double loss(std::uint32_t item, std::uint32_t memory) const;
  double lossOf(std::uint32_t item, std::uint32_t memory) const;
  void move(std::uint32_t item, std::uint32_t memory, bool there);
  void leave(std::uint32_t memory, double time, const std::vector<std::uint32_t>& evicted);
  void addRelease(std::uint32_t memory, const Release& release);
  Clearing clear(const Job& job, std::uint32_t memory, double bytes) const;
  bool mayBeFreed(const Job& job, std::uint32_t memory, double bytes) const;
  void undoChannels(std::size_t left);
  double arrivalAtBest(const Item& item, std::uint32_t number, std::uint32_t target,
                       double& again) const;
  double loadedAgain(std::uint32_t item, std::uint32_t source, std::uint32_t target) const;

  const State& s_;
  const Evict evict_;
  const std::uint32_t memories_;
  std::vector<Timeline> devices_, channels_;
  std::vector<double> channelFree_;
  std::vector<std::uint32_t> rows_;  ///< of each item that has bytes: its first place in copies_
  std::vector<Copy> copies_;
  std::uint64_t finite_ = 0;           ///< memories that are no stores
  double again_ = 0.0;                 ///< Offer::again of the job that is looked at
  std::vector<std::uint64_t> places_;  ///< of each item: memories with a copy, now or later
  std::vector<Room> rooms_;
  std::vector<double> promised_;  ///< bytes of each memory, to the job that is looked at
  double surplus_ = 0.0;          ///< of the room that was cleared last
  std::vector<Taken> taken_;
  Schedule made_;
};

}  // namespace trex::schedule
