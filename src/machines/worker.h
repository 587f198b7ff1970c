// A machine that takes samples for machine 0. It holds nothing that can't be lost.
#pragma once

#include <atomic>
#include <condition_variable>
#include <deque>
#include <memory>
#include <mutex>
#include <optional>
#include <vector>

#include "hccmesh/pages.h"
#include "src/machines/link.h"
#include "src/machines/page_server.h"
#include "src/machines/photon_parts.h"
#include "src/machines/remote_files.h"
#include "src/machines/remote_pages.h"
#include "src/scene/scene.h"
#include "src/session/model.h"
#include "src/session/session.h"
#include "src/session/settings.h"

namespace trex::machines {

class Worker : public PhotonSharer {
 public:
  /// Greets machine 0. `files`: that others may read here, by number. Throws Error.
  Worker(const Link::MakeWire& make, const Hello& self, std::vector<ServedFile> files = {});
  ~Worker() override;

  std::uint32_t rank() const { return link_.rank(); }

  /// What there is to open; nothing if the work has ended before. Throws Error.
  std::optional<Welcome> awaitWelcome();
  /// A file of machine 0, which Welcome counts. Reading throws Error, for one thing once machine 0
  /// said stop. Used while this is there; thread safe. `name`: for messages.
  std::unique_ptr<hccm::PageFile> file(std::uint32_t number, const std::string& name) {
    return pages_.file(number, name);
  }
  /// The same of another machine, one for good, which passes no pages on.
  std::unique_ptr<hccm::PageFile> file(std::uint32_t machine, std::uint32_t number,
                                       const std::string& name) {
    if (machine == 0) return file(number, name);
    holder_ = machine;
    return remote_.file(machine, number, name);
  }
  /// Packed pages are kept here for other machines that ask. Before run().
  void passOn(std::unique_ptr<PageShelf> shelf, const Welcome& welcome) {
    pages_.passOn(std::move(shelf), welcome.fileBytes);
  }
  std::uint32_t machines() const { return link_.size(); }
  /// Takes samples of the views' pictures until machine 0 says stop. `digest`: of model, views and
  /// settings.
  void run(std::shared_ptr<const Model> model, const std::vector<Camera>& views,
           const RenderSettings& settings, std::uint64_t digest);
  /// By the sessions of run().
  std::optional<ShotPhotons> shoot(const PhotonBatch& batch, const ShootHere& here,
                                   const std::function<bool()>& keepGoing) override;
  /// Says that this machine can't go on, and waits until machine 0 has said stop.
  void failed(const Error& error);
  /// Waits for the end of all: until nobody sends anything any more.
  void finish();

 protected:
  struct Heard {
    Kind kind;
    std::uint32_t views,
        passes;  ///< that had begun when it came: what it asks for is void after them
    Bytes body;
  };
  /// The next message; nothing once machine 0 has said stop.
  std::optional<Heard> next();
  void sendResult(Result result, const RayCounts& rays, const Session& session);
  /// The model is open.
  void sayReady(std::uint64_t digest);
  /// But for the goodbye: after that machine 0 receives nothing, and what is large would wait for
  /// it.
  template <class M>
  void tell(const M& message) {
    Bytes bytes = encode(message);
    const std::lock_guard lock(mutex_);
    if (!stopped_) link_.send(0, std::move(bytes));
  }
  /// Whether samples had better be made short before they go to machine 0: that takes half a
  /// microsecond of a processor at either end for some 50 bytes.
  bool sendsShort() const {
    constexpr double kSlow = 50e6;  // bytes a second
    const double bandwidth = pages_.link().bandwidth;
    return bandwidth > 0.0 && bandwidth < kSlow;
  }
  std::atomic<std::uint32_t> views_{0}, passes_{0};  ///< that have begun, as far as was heard
  std::atomic<std::uint32_t> passBegun_{0};          ///< of passes_, of the job under way

 private:
  struct Work;

  void hear(std::uint32_t from, Kind kind, ByteView body);
  void hearFetch(std::uint32_t from, Fetch fetch);
  void answer(std::uint32_t to, Bytes message);
  void hearLeader(Kind kind, ByteView body);
  void hearOfPhotons(Kind kind, ByteView body);
  void lose(std::uint32_t machine);
  void broken(const Error& error);
  void setView(Work& work, const SetView& message, std::uint32_t begun);
  void startPass(Work& work, Pass pass);
  void takeJob(Work& work, const GiveJob& message, std::uint32_t begun);

  std::mutex mutex_;
  std::condition_variable changed_;
  std::deque<Heard> heard_;
  std::optional<Error> problem_;
  bool stopped_ = false, ended_ = false;
  std::uint32_t view_ = ~0u;                 ///< whose photons are shot
  std::optional<PhotonParts> batch_;         ///< that it waits for
  std::deque<ShootPhotons> photonJobs_;      ///< of it
  bool alone_ = false;                       ///< nobody else shoots it
  const bool serves_;                        ///< files of its own
  std::atomic<std::uint32_t> holder_ = ~0u;  ///< whose files it reads, beside machine 0
  RemotePages pages_;                        ///< machine 0's files
  RemoteFiles remote_;                       ///< the holder's
  PageServer server_;                        ///< its own
  Link link_;                                ///< the last: it calls the others
};

}  // namespace trex::machines
