// Machine 0: it has the file, the ledger of jobs, the sums and the checkpoint. The others hold
// nothing that can't be lost.
//
//   Session::perform(kSamples) ─► take()   deals jobs of the pass to all, traces some itself, and
//   adds
//                                          what comes back in the order of units
//   the link's thread                      hears of results and deals the next jobs meanwhile
//   LightPass::run() ─► shoot()            the same with photons of a batch; whoever is at it gets
//                                          what all have shot (leader_photons.cpp)
//
// A machine that does not answer for kSilentSeconds loses its jobs to others, and takes part again
// once it answers. A machine that says it failed ends the render: its error is thrown by take().
#pragma once

#include <atomic>
#include <condition_variable>
#include <deque>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "src/machines/jobs.h"
#include "src/machines/link.h"
#include "src/machines/link_probe.h"
#include "src/machines/page_server.h"
#include "src/machines/photon_parts.h"
#include "src/machines/remote_files.h"
#include "src/machines/window_messages.h"
#include "src/session/taken_samples.h"

namespace trex::machines {

inline constexpr double kSilentSeconds = 4.0;
/// Of memory, for results that wait for those before them, about.
inline constexpr std::uint64_t kWindowBytes = std::uint64_t{64} << 20;
/// Likewise, for photons of batches that are past, which machines that come late ask for.
inline constexpr std::uint64_t kKeptPhotonBytes = std::uint64_t{32} << 20;

/// What --json says of a machine.
struct MachineRow {
  std::string host, device = "none";
  std::uint32_t threads = 0;
  std::uint64_t instructions = 0;
  MachineWork work;
  MachineTimes times;             ///< as of its last result; not machine 0's
  std::uint64_t photons = 0;      ///< that it shot, and that count
  std::uint64_t servedBytes = 0;  ///< of the model, sent to it
  std::uint64_t peakBytes = 0;    ///< resident; 0 before its first result
  LinkSpeed link;                 ///< between it and machine 0
  std::string model;              ///< that it serves, as Hello
  std::uint64_t modelBytes = 0, modelDigest = 0;
};

/// Who gives machines other work than that of a render (servers.h). Called with the leader's lock
/// held; may send.
class MachineListener {
 public:
  virtual ~MachineListener() = default;
  /// It has opened the model, or answers again.
  virtual void ready(std::uint32_t machine) = 0;
  /// It has ended, does not answer, or has failed.
  virtual void lost(std::uint32_t machine) = 0;
  virtual void result(std::uint32_t machine, Result result) = 0;
  virtual void lit(std::uint32_t machine, const Lit& lit) = 0;
  virtual void noLoan(std::uint32_t machine, std::uint32_t id) = 0;
  /// Photons, which have been checked.
  virtual void shot(std::uint32_t machine, Shot shot) = 0;
  /// It will not be ready again; after lost().
  virtual void failed(std::uint32_t machine, const std::string& why) = 0;
};

/// Used by one thread, but for what it hears.
class Leader : public SampleSharer {
 public:
  /// Starts to listen. Throws Error.
  Leader(const Link::MakeWire& make, const Hello& self);
  /// Tells all to stop, and waits for them for a while.
  ~Leader() override;

  std::uint32_t machines() const { return link_.size(); }
  /// From now on machines have a window's work, and one that fails is left out; before welcome().
  void workFor(MachineListener* listener, const Serve& serve);
  template <class M>
  void send(std::uint32_t to, const M& message) {
    tell(to, message);
  }
  /// What a machine has said makes no sense: as if it had failed.
  void drop(std::uint32_t machine, const std::string& why);

  /// What all others are to open: the model they have themselves, or the first of `files`, which is
  /// a bundle: `baked`, or made for this.
  void welcome(bool local, bool baked, std::vector<ServedFile> files);
  /// The same of a bundle that another machine serves, in the place of the first of `files`.
  void welcomeTo(std::uint32_t holder, std::vector<ServedFile> files);
  /// A file that another machine serves: RemoteFiles::file().
  std::unique_ptr<hccm::PageFile> file(std::uint32_t machine, std::uint32_t number);
  /// Nothing is read from others any more: RemoteFiles::stop().
  void leaveFiles() { remote_.stop(); }
  /// What they must have opened: another digest of theirs is an error.
  void expect(std::uint64_t digest);
  /// Waits until all have greeted, or opened what they are to open; but for those that don't
  /// answer, and only while keepGoing lets it. Throws Error.
  void waitForGreetings(const std::function<bool()>& keepGoing);
  void waitForModels(const std::function<bool()>& keepGoing);

  /// The next samples are of this view.
  void beginView(std::uint32_t view);
  void lightComes(const Session& session, std::uint64_t photons) override;
  /// Throws the Error of a machine that failed. If keepGoing says no the others go on with what
  /// they have, and the next call takes it, if it is about the same samples.
  void take(Session& session, const std::function<bool()>& keepGoing) override;
  /// Throws as take().
  std::optional<ShotPhotons> shoot(const PhotonBatch& batch, const ShootHere& here,
                                   const std::function<bool()>& keepGoing) override;
  /// No more samples are wanted for now.
  void rest();

  /// By machine.
  std::vector<MachineRow> rows() const;
  LinkTraffic traffic() const { return link_.traffic(); }
  std::uint64_t jobsAgain() const;
  /// All are told to stop and say goodbye.
  void stop();
  /// After it: waits for the end of those that did, or, if some did not, says `error` and ends all
  /// processes with this code.
  void finish(int code, const std::string& error = {});

 private:
  enum class State : std::uint8_t { kExpected, kGreeted, kReady, kSilent, kGone };
  struct Machine {
    MachineRow row;
    State state = State::kExpected;
    bool ready = false;  ///< its model is open and as expected
    bool passesOn = false;
    std::optional<std::uint64_t> digest;
    double heard = 0.0;
    std::uint32_t view = ~0u;       ///< that it has set up
    std::optional<PhotonBatch> at;  ///< that it waits for
  };
  /// Samples that came, and wait for those before them.
  struct Arrived {
    Job job;
    std::uint32_t machine = 0;
    RayCounts rays;
    Bytes samples;
  };

  void hear(std::uint32_t from, Kind kind, ByteView body);
  void tick();
  void end(const Error& error);
  void forget(std::uint32_t machine);
  void lose(std::uint32_t machine);
  /// But for the stop: after that a machine takes nothing more, and what is large would wait for
  /// it.
  template <class M>
  void tell(std::uint32_t to, M&& message) {
    if (!stopped_) link_.send(to, std::forward<M>(message));
  }
  void sendWelcome(std::uint32_t to);
  void welcomeAll(const Welcome& welcome, std::vector<ServedFile> files);
  bool hearOfFiles(std::uint32_t from, Kind kind, ByteView body);
  void awaitGoodbyes(std::unique_lock<std::mutex>& lock, bool ofHolder);
  void fail(std::uint32_t machine, int code, const std::string& text);
  void greet(std::uint32_t from, const Hello& hello);
  void checkReady(std::uint32_t from);
  void bringIn(std::uint32_t machine);
  void takeResult(std::uint32_t from, Result result);
  void serve(std::uint32_t to, Fetch fetch);
  void dealTo(std::uint32_t machine);
  void dealAll();
  void throwIfFailed() const;
  void waitWhile(bool (*isAwaited)(const Machine&), const std::function<bool()>& keepGoing);
  void waitForViews(const std::function<bool()>& keepGoing);
  bool goesOn(const Session& session) const;
  void startPass(const Session& session);
  void endPass();
  void mergeArrived(Session& session);
  bool traceOne(Session& session, const std::function<bool()>& keepGoing);
  std::string nameOf(std::uint32_t machine) const;
  bool startBatch(const PhotonBatch& batch);
  void waitForBatch(const std::function<bool()>& keepGoing);
  ShotPhotons endBatch();
  void forgetPhotons();
  bool shootOne(const ShootHere& here, const std::function<bool()>& keepGoing);
  void takePhotons(std::uint32_t from, Shot shot);
  void hearShot(std::uint32_t from, Shot shot);
  void answerAt(std::uint32_t machine);
  void answerAll();
  void sendParts(std::uint32_t to, const PhotonParts& parts);
  void dealPhotons(std::uint32_t machine);
  void probe(std::uint32_t machine);
  void askProbe();
  void dropProbeOf(std::uint32_t machine);
  void hearProbed(std::uint32_t from, const Probed& answer);
  void tellHomes(std::optional<std::uint32_t> newcomer = {});

  Hello self_;
  mutable std::mutex mutex_;
  std::condition_variable changed_;
  std::vector<Machine> machines_;
  JobLedger ledger_;
  MachineListener* listener_ = nullptr;
  std::optional<Welcome> welcome_;
  std::optional<Serve> serve_;
  std::optional<std::uint64_t> digest_;
  std::optional<Error> failure_;
  std::optional<std::uint32_t> view_;
  std::optional<LightComes> light_;
  std::optional<Pass> pass_;  ///< under way
  std::uint32_t passes_ = 0;
  std::uint64_t next_ = 0, end_ = 0;          ///< units that the picture gets next, in this pass
  std::map<std::uint64_t, Arrived> arrived_;  ///< by first unit
  JobLedger photonJobs_;
  std::optional<PhotonParts> batch_;           ///< under way
  std::map<std::uint64_t, PhotonParts> kept_;  ///< batches that are past, by first photon
  std::uint64_t keptBytes_ = 0, photonsDone_ = 0;
  std::deque<std::pair<std::uint32_t, LinkProbe>> probes_;  ///< machines to be measured, in turn
  std::uint32_t probed_ = 0;                                ///< questions
  double pinged_ = 0.0;
  std::vector<PageHome> homes_;  ///< that were told last
  std::atomic<bool> stopped_ = false;
  bool finished_ = false, broken_ = false;
  RemoteFiles remote_;
  PageServer server_;
  Link link_;  ///< the last: it calls the others
};

}  // namespace trex::machines
