#include "src/machines/mpi_wire.h"

#include <algorithm>
#include <atomic>
#include <cstdlib>
#include <deque>
#include <filesystem>

#include "src/core/child.h"
#include "src/core/error.h"
#include "src/core/module.h"
#include "src/machines/mpi/trex_mpi.h"

namespace trex::machines {
namespace {

std::atomic<bool> endsUncleanly_{false};

constexpr const char* kFile = "libtrex_mpi.so";

const MpiFunctions& mpi() {
  static const MpiFunctions* const found = [] {
    try {
      return moduleFunction<decltype(trexMpiFunctions)>(kFile, kTrexMpiFunctions, "MPI")();
    } catch (const Error& e) {
      fail(ExitCode::kMemoryOrDevice,
           "{}; mpirun started several of this program, which needs a build with libopenmpi-dev",
           e.what());
    }
  }();
  return *found;
}

void check(const char* problem) {
  if (problem != nullptr) fail(ExitCode::kFailed, "MPI: {}", oneLine(problem));
}

class MpiWire : public Wire {
 public:
  MpiWire() {
    int rank = 0, size = 1;
    check(mpi().start(rank, size));
    rank_ = static_cast<std::uint32_t>(rank);
    size_ = static_cast<std::uint32_t>(size);
    const Started started = startedAs();
    if (size_ == started.size && rank_ == started.rank) return;
    // Else each process would be a machine 0 of its own.
    fail(ExitCode::kFailed,
         "started as process {} of {}, but MPI says {} of {}: use the mpirun (or srun --mpi=pmix) "
         "of {}",
         started.rank, started.size, rank_, size_, mpiLibrary());
  }
  std::uint32_t rank() const override { return rank_; }
  std::uint32_t size() const override { return size_; }

  void send(std::uint32_t to, Bytes message) override {
    Sending& one = sending_.emplace_back(Sending{to, std::move(message), nullptr});
    check(mpi().send(static_cast<int>(to), one.bytes.data(), one.bytes.size(), one.request));
  }

  std::optional<Received> receive() override {
    while (coming_.size() < kMostComing && begin()) continue;
    // Of each machine the first is waited for; others overtake one that has stopped.
    std::vector<std::uint32_t> waited;
    for (auto at = coming_.begin(); at != coming_.end();) {
      if (std::find(waited.begin(), waited.end(), at->from) != waited.end()) {
        ++at;
        continue;
      }
      bool done = false, whole = false;
      check(mpi().received(at->request, done, whole));
      if (!done) {
        waited.push_back(at->from);
        ++at;
        continue;
      }
      Received got{at->from, std::move(at->bytes)};
      at = coming_.erase(at);
      if (whole) return got;
    }
    return {};
  }

  std::size_t unsent() override {
    // Each look at one that has not gone moves all of them on: the first to each machine will do.
    std::vector<std::uint32_t> waited;
    std::erase_if(sending_, [&](const Sending& one) {
      if (std::find(waited.begin(), waited.end(), one.to) != waited.end()) return false;
      bool done = false;
      check(mpi().sent(one.request, done));
      if (!done) waited.push_back(one.to);
      return done;
    });
    return sending_.size() + coming_.size();
  }

  std::optional<std::uint32_t> lost() override {
    const int rank = mpi().lost();
    if (rank < 0) return {};
    return static_cast<std::uint32_t>(rank);
  }
  void finish() override {
    {
      bool unclean = false;
      check(mpi().finish(unclean));
      endsUncleanly_ = unclean;
    }
  }
  void abort(int code) override { mpi().abort(code); }

 private:
  static constexpr std::size_t kMostComing = 8;
  struct Sending {
    std::uint32_t to;
    Bytes bytes;
    void* request;
  };
  struct Coming {
    std::uint32_t from;
    Bytes bytes;
    void* request;
  };
  /// Whether a message is there, which is on its way from now on.
  bool begin() {
    bool found = false;
    int from = 0;
    std::uint64_t size = 0;
    check(mpi().look(found, from, size));
    if (!found) return false;
    if (size > kMostBytes) {
      fail(ExitCode::kFailed, "machine {}: sent {} bytes at once, more than a message may have",
           from, size);
    }
    Coming& one =
        coming_.emplace_back(Coming{static_cast<std::uint32_t>(from), Bytes(size), nullptr});
    check(mpi().receive(one.bytes.data(), one.request));
    return true;
  }
  std::uint32_t rank_ = 0, size_ = 1;
  std::deque<Sending> sending_;
  std::deque<Coming> coming_;  ///< in the order they were found in
};

std::uint32_t numberOf(const char* variable, std::uint32_t otherwise) {
  const char* text = std::getenv(variable);
  if (text == nullptr) return otherwise;
  const long value = std::strtol(text, nullptr, 10);
  return static_cast<std::uint32_t>(std::clamp(value, 0l, 1l << 20));
}

}  // namespace

Started startedAs() {
  // Open MPI's own; of srun, whose number alone says nothing of MPI, those that come with PMIx.
  if (std::getenv("OMPI_COMM_WORLD_SIZE") != nullptr) {
    return {numberOf("OMPI_COMM_WORLD_RANK", 0), std::max(numberOf("OMPI_COMM_WORLD_SIZE", 1), 1u)};
  }
  if (std::getenv("PMIX_RANK") != nullptr) {
    return {numberOf("PMIX_RANK", 0), std::max(numberOf("SLURM_NTASKS", 1), 1u)};
  }
  // Of another MPI, which ours does not understand; openMpiWire() says so.
  if (std::getenv("PMI_SIZE") != nullptr) {
    return {numberOf("PMI_RANK", 0), std::max(numberOf("PMI_SIZE", 1), 1u)};
  }
  return {};
}

bool mpiEndsUncleanly() { return endsUncleanly_; }

bool survivesDeaths() { return mpi().survives(); }

bool hasMpi() { return std::filesystem::exists(besideProgram(kFile)); }

std::string mpiLibrary() {
  const std::string text = mpi().library;
  return text.substr(0, text.find(','));
}

std::unique_ptr<Wire> openMpiWire() { return std::make_unique<MpiWire>(); }

}  // namespace trex::machines
