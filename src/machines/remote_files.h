// Files of other machines, whose parts are asked for as they are read.
#pragma once

#include <condition_variable>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <string>

#include "hccmesh/pages.h"
#include "src/core/error.h"
#include "src/machines/link_probe.h"
#include "src/machines/messages.h"

namespace trex::machines {

/// Thread safe.
class RemoteFiles {
 public:
  /// `send` gets questions, by any thread; `speed` says what is known of the link to a machine.
  RemoteFiles(std::function<void(std::uint32_t to, Bytes question)> send,
              std::function<LinkSpeed(std::uint32_t machine)> speed);

  /// A file that a machine serves by this number. Reading throws Error: of what the machine could
  /// not read, once it is lost, and once there is nothing to read any more. Used while this is
  /// there; thread safe. `name`: for messages.
  std::unique_ptr<hccm::PageFile> file(std::uint32_t machine, std::uint32_t number,
                                       const std::string& name);

  // What is heard. The first two throw MessageError for what nobody asked for.
  void hear(std::uint32_t from, const Part& part);
  void hear(std::uint32_t from, const NoPart& why);
  /// A machine answers no more.
  void lose(std::uint32_t machine, const Error& error);
  /// Nobody does.
  void broken(const Error& error);
  /// Nothing is read any more: reads throw Error(kInterrupted).
  void stop();
  /// Questions that machines still answer, those that nobody waits for any more among them.
  std::size_t outstanding() const;

 private:
  struct Question {
    std::uint32_t machine = 0;
    bool awaited = true;
    std::span<const hccm::FilePart> parts{};  ///< where the answer goes, while it is awaited
    std::uint64_t answer = 0;                 ///< its bytes
    std::optional<Error> problem{};
    bool answered() const { return problem || answer > 0; }
  };

  Question* questionOf(std::uint32_t from, std::uint64_t number);
  void settle(std::uint64_t number);
  void read(std::uint32_t machine, std::uint32_t file, std::span<const hccm::FilePart> parts);

  std::function<void(std::uint32_t, Bytes)> send_;
  std::function<LinkSpeed(std::uint32_t)> speed_;
  mutable std::mutex mutex_;
  std::condition_variable changed_;
  std::map<std::uint64_t, Question> questions_;
  std::map<std::uint32_t, Error> lost_;  ///< by machine
  std::optional<Error> broken_;
  std::uint64_t asked_ = 0;
  bool stopped_ = false;
};

}  // namespace trex::machines
