// Who takes which samples: plain data, no messages, no threads, no clock of its own.
//
// A UNIT is one sample of one tile. Units have one order, in which they enter the picture: unit u
// is tile u % tiles of sample u / tiles. A JOB is a range of units that follow each other. Jobs are
// given out in the order of units, each as large as its machine traces in about JobSizes::seconds
// and smaller towards the end; their results are merged in the order of units, whoever brings them,
// so the picture does not depend on who had which.
//
// A job may have several holders: one that was given out again because its machine does not answer,
// or takes long while others have nothing to do. The first result counts, later ones are of no use.
// A large job that is lost is parted among the machines that are left, else all would wait for the
// one that takes it.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <vector>

namespace trex::machines {

/// Units [first, end).
struct Job {
  std::uint32_t id = 0;  ///< never used again
  std::uint64_t first = 0, end = 0;
  std::uint64_t units() const { return end - first; }
  bool operator==(const Job&) const = default;
};

struct JobSizes {
  double seconds = 0.1;      ///< that a job is to take
  double ownSeconds = 0.05;  ///< likewise of machine 0, which waits for nobody's message
  std::uint64_t most = 64;   ///< units of a job: its result is one message
  /// Above 1: jobs are not measured by time, but are as large as they can be up to so many units,
  /// all alike. Where paths wait for pages each page is loaded once for all of a job.
  std::uint64_t large = 1;
  std::uint64_t window = 1024;  ///< units beyond what is merged that results may wait in
  std::uint64_t together = 1;   ///< units that one job should have: a whole sample's
  std::uint32_t atOnce = 2;     ///< jobs of a machine, so that it does not wait for the next
};

/// Units of the next job of a machine that traces `wanted` in the time of a job (0: not known
/// yet), where `left` are to be given out to `machines` machines: at least 1, a multiple of
/// `together` where `most` lets it be.
std::uint64_t unitsOfJob(const JobSizes& sizes, double wanted, std::uint64_t left,
                         std::uint32_t machines);

/// Units of each job where jobs are large and a machine traces `share` of what all do together:
/// those of `all` units in as few rounds as `large` lets them be.
std::uint64_t unitsOfLargeJob(std::uint64_t large, std::uint64_t all, std::uint32_t machines,
                              double share);

/// What a machine did.
struct MachineWork {
  std::uint64_t jobs = 0, units = 0;  ///< whose results count
  std::uint64_t twice = 0;            ///< jobs whose results came after another's
  double seconds = 0.0;               ///< of tracing, of all of these
};

/// The jobs of one picture after another. Machine 0 is the one that keeps the ledger. Times are
/// seconds of any clock that does not go back. One thread at a time.
class JobLedger {
 public:
  explicit JobLedger(std::uint32_t machines);

  /// Units [first, end) are to be taken; all jobs of before are void.
  void start(std::uint64_t first, std::uint64_t end, const JobSizes& sizes);
  /// A machine takes part, or does no longer: what it holds is given out again.
  void join(std::uint32_t machine);
  void lose(std::uint32_t machine);
  bool takesPart(std::uint32_t machine) const { return machines_[machine].here; }

  /// The next job of a machine that takes part: one that has been lost, a new one, or, if there is
  /// none, one that another has had for long; machine 0 takes such a one before new ones, for what
  /// comes after it waits. Nothing if it has enough, or there is none.
  std::optional<Job> deal(std::uint32_t machine, double now);
  /// A machine brings the result of a job, which took it `seconds`: the job if this is the first,
  /// else nothing. Jobs that never were, or are void, are nothing too.
  std::optional<Job> bring(std::uint32_t machine, std::uint32_t id, double seconds);
  /// A machine gives a job back.
  void giveBack(std::uint32_t machine, std::uint32_t id);
  /// All units before this one are in the picture.
  void merged(std::uint64_t unit) { merged_ = unit; }

  /// All units are brought.
  bool done() const { return next_ == end_ && open_.empty(); }
  std::uint32_t held(std::uint32_t machine) const { return machines_[machine].held; }
  const MachineWork& work(std::uint32_t machine) const { return machines_[machine].work; }
  /// Jobs that were given out more than once so far.
  std::uint64_t again() const { return again_; }

 private:
  struct Holder {
    std::uint32_t machine = 0;
    double since = 0.0;
  };
  struct Open {
    Job job;
    std::vector<Holder> holders;
  };
  struct Machine {
    bool here = false;
    std::uint32_t held = 0;
    double unitsASecond = 0.0;
    MachineWork work;
  };
  std::uint32_t present() const;
  double shareOf(std::uint32_t machine) const;
  std::uint64_t unitsFor(std::uint32_t machine) const;
  void part(std::uint32_t id);
  Job hand(Open& open, std::uint32_t machine, double now);
  Open* lost();
  Open* late(std::uint32_t machine, double now);

  std::vector<Machine> machines_;
  std::map<std::uint32_t, Open> open_;  ///< not brought yet, by id
  JobSizes sizes_;
  std::uint32_t nextId_ = 1;
  std::uint64_t first_ = 0, next_ = 0, end_ = 0, merged_ = 0, again_ = 0;
};

}  // namespace trex::machines
