// A window's machine and its servers: those that trace for it (server.h).
//
//   Viewer ─ edited() ─► all get the look as the small overlay that it is, and forget what they had
//   Session ─ lightComes() ─► they shoot the same photons, and say when they have them
//   Session ─ exchange() ─► adds what has come to the frame, and lends tiles to those that have the
//                           light that samples read now
//
// The window never waits: what does not come back in time is traced here, and a machine that ends,
// stops or fails is left out. A pixel's samples are added in their order, whoever takes them, so
// the settled picture has the bits of the window alone.
#pragma once

#include <condition_variable>
#include <deque>
#include <mutex>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "src/machines/leader.h"
#include "src/machines/loans.h"
#include "src/session/sample_helper.h"

namespace trex::machines {

/// Used by one thread, but for what it hears.
class Servers : public SampleHelper, public PhotonSharer, private MachineListener {
 public:
  /// Starts to listen. Throws Error.
  Servers(const Link::MakeWire& make, const Hello& self);
  ~Servers() override;
  Servers(const Servers&) = delete;
  Servers& operator=(const Servers&) = delete;

  /// What they are to open, as Leader::welcome(), for a window that was started so; `digest`:
  /// Leader::expect().
  void welcome(bool local, std::vector<ServedFile> files, const Serve& serve, std::uint64_t digest);

  /// The machine that has a model for the window: waits until all have greeted. Several may have
  /// the same. Throws Error(kUsage) if none has one, or two have different ones.
  std::uint32_t findHolder(const std::function<bool()>& keepGoing);
  /// As welcome(), of a bundle that another machine has, in the place of the first of `files`.
  void welcomeTo(std::uint32_t holder, std::vector<ServedFile> files, const Serve& serve);
  /// That bundle, read while this is there.
  std::unique_ptr<hccm::PageFile> model(std::uint32_t holder) { return leader_.file(holder, 0); }
  /// Nothing is read from others any more: reads throw Error(kInterrupted).
  void leaveFiles() { leader_.leaveFiles(); }

  std::uint32_t machines() const override { return leader_.machines() - 1; }
  std::uint32_t readyMachines() const override;
  bool takesAll() const override;
  void edited(const std::string& overlay, std::uint32_t width, std::uint32_t height) override;
  void lightComes(const Session& session, std::uint64_t photons) override;
  void exchange(Session& session, const std::function<bool()>& keepGoing) override;
  bool await(Session& session, const std::function<bool()>& keepGoing) override;

  /// Photons of the machine that has the model, for a window that has no room for all of its pages:
  /// to be shared by the window's session. Waits as keepGoing lets it. Throws Error(kFailed) if
  /// that machine shoots none.
  std::optional<ShotPhotons> shoot(const PhotonBatch& batch, const ShootHere& here,
                                   const std::function<bool()>& keepGoing) override;
  bool shootsAll() const override { return true; }

  /// By machine; work.units are samples, work.twice is not counted.
  std::vector<MachineRow> rows() const;
  /// Loans that were taken back so far.
  std::uint64_t takenBack() const;
  LinkTraffic traffic() const { return leader_.traffic(); }
  /// All are told to stop; waits for the end of those that do, ends the others, and with them all
  /// processes with this code.
  void finish(int code);

 private:
  struct Machine {
    bool ready = false;
    Lit lit;  ///< the light that it has
  };
  struct Arrived {
    std::uint32_t machine = 0;
    double at = 0.0;
    Result result;
  };

  void ready(std::uint32_t machine) override;
  void lost(std::uint32_t machine) override;
  void result(std::uint32_t machine, Result result) override;
  void lit(std::uint32_t machine, const Lit& lit) override;
  void noLoan(std::uint32_t machine, std::uint32_t id) override;
  void shot(std::uint32_t machine, Shot shot) override;
  void failed(std::uint32_t machine, const std::string& why) override;
  void sendAim(std::uint32_t machine);
  void visit(Session& session, const std::function<bool()>& keepGoing, bool hurry);
  void add(Session& session, const std::function<bool()>& keepGoing);
  bool addOne(Session& session, const Arrived& arrived);
  void takeBack(Session& session, bool hurry);
  void lendAll(Session& session);
  bool lendTo(Session& session, std::uint32_t machine, std::size_t mostTiles,
              const std::function<std::optional<TileUnit>()>& next);

  mutable std::mutex mutex_;
  std::condition_variable changed_;
  std::vector<Machine> machines_;
  std::deque<Arrived> arrived_;
  std::vector<std::uint32_t> lost_;  ///< machines, whose loans are not taken back yet
  std::vector<std::pair<std::uint32_t, std::uint32_t>> dropped_;  ///< machines and loans, likewise
  std::optional<Edit> edit_;
  std::optional<Aim> aim_;
  std::uint32_t holder_ = 0;  ///< the machine that has the model; 0: this one, or all
  std::string problem_;       ///< why that takes no part
  std::deque<Shot> shots_;    ///< that it has sent, of the light of now
  // Of the window's thread:
  Loans loans_;
  std::uint32_t edits_ = 0, frame_ = 0;
  double visited_ = 0.0, between_ = 0.03;  ///< seconds between two visits, on average
  Leader leader_;                          ///< the last: it calls the others
};

}  // namespace trex::machines
