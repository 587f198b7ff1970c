// Files of machine 0 as another machine reads them: from machine 0, or, of pages, from the machine
// that passes them on (page_homes.h).
//
//   read() ─► pages of another's home ─► that machine ─► its shelf, or machine 0 ─┐
//         ├─► pages of our own home   ─► our shelf, or machine 0 ─► our shelf     ├─► checked,
//               └─► all else                ─► machine 0                                ┘
//   whoever does not answer in time, says no, has ended, or sends what the page's checksum does not
//   fit: machine 0 is asked
//
// A machine that passes pages on never waits for another but machine 0, so nobody waits in a
// circle.
#pragma once

#include <condition_variable>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "hccmesh/pages.h"
#include "src/core/error.h"
#include "src/machines/link_probe.h"
#include "src/machines/messages.h"
#include "src/machines/page_homes.h"
#include "src/machines/page_server.h"
#include "src/machines/page_shelf.h"

namespace trex::machines {

/// Bytes of pages, packed, that other machines sent or got.
struct PageBytes {
  std::uint64_t received = 0;  ///< from anybody, to be passed on too
  std::uint64_t passed = 0;    ///< sent to others
};

/// Thread safe.
class RemotePages {
 public:
  using Send = std::function<void(std::uint32_t to, Bytes message)>;
  /// `send` gets questions and answers, by any thread; `failed` what keeps us from answering.
  RemotePages(Send send, std::function<void(const Error& error)> failed);
  ~RemotePages();
  RemotePages(const RemotePages&) = delete;
  RemotePages& operator=(const RemotePages&) = delete;

  /// This machine, of so many. Before all else.
  void setPlace(std::uint32_t rank, std::uint32_t machines);
  /// A file by its number in Welcome. Reading throws Error, for one thing after stop(). `name`: for
  /// messages.
  std::unique_ptr<hccm::PageFile> file(std::uint32_t number, const std::string& name);
  /// From now on others get pages from here; files as Welcome counts them.
  void passOn(std::unique_ptr<PageShelf> shelf, const std::vector<std::uint64_t>& fileBytes);
  bool passesOn() const;
  /// The model is open: what comes from now on are pages.
  void opened();
  PageBytes bytes() const;
  /// To machine 0.
  LinkSpeed link() const;

  // By the link's thread; those with a message throw MessageError.
  void hearPart(std::uint32_t from, const Part& part);
  void hearNoPart(std::uint32_t from, const NoPart& why);
  void hearFetch(std::uint32_t from, Fetch fetch);
  void hearHomes(const Homes& homes);
  void hearLink(const LinkFound& found);
  void lost(std::uint32_t machine);
  /// Nothing is sent any more, and who waits is told.
  void stop();
  /// Likewise: there is nobody to wait for.
  void broken(const Error& error);

 private:
  using Parts = std::span<const hccm::FilePart>;
  struct Question {
    std::uint32_t to = 0;
    Parts parts{};                          ///< where the answer goes; who asked waits for it
    std::optional<std::uint64_t> answer{};  ///< its bytes; 0: it does not have them
    std::optional<Error> problem{};         ///< of machine 0
    bool answered() const { return answer || problem; }
  };
  struct Asked {
    std::uint64_t number = 0;
    std::uint32_t to = 0;
    double since = 0.0;
    std::vector<hccm::FilePart> parts{};
  };
  void read(std::uint32_t file, Parts parts);
  void readAtHome(std::uint32_t file, Parts parts);
  void readFrom0(std::uint32_t file, Parts parts);
  std::uint32_t whoHas(std::uint32_t file, const hccm::FilePart& part) const;
  Asked ask(std::uint32_t to, std::uint32_t file, std::vector<hccm::FilePart> parts);
  bool await(Asked& asked);
  void forget(const std::vector<Asked>& asked);
  bool isAwaited(const Asked& asked) const;
  void throwIfEnded() const;
  void answer(std::uint32_t to, Bytes message);
  Question* questionOf(std::uint32_t from, std::uint64_t number);

  const Send send_;
  const std::function<void(const Error&)> failed_;
  mutable std::mutex mutex_;  ///< of all below
  std::condition_variable changed_;
  std::uint32_t rank_ = 0;
  std::vector<bool> late_,
      refuses_;  ///< by machine: it had not answered in time; it does not pass on
  std::vector<PageHome> homes_;
  std::unique_ptr<PageShelf> shelf_;
  std::set<std::uint64_t> coming_;  ///< offsets of pages of our home that machine 0 was asked for
  std::map<std::uint64_t, Question> questions_;
  std::uint64_t asked_ = 0;
  double usual_ = 0.0;  ///< seconds of an answer
  LinkSpeed speed_;     ///< of the link to machine 0
  PageBytes bytes_;
  bool stopped_ = false;
  std::optional<Error> problem_;
  PageServer server_;  ///< the last: its threads call the others
};

}  // namespace trex::machines
