// A thread that sends and receives for a machine, so that others can trace meanwhile: a machine
// whose cores are busy still answers, and one that does not answer has stopped.
#pragma once

#include <condition_variable>
#include <deque>
#include <exception>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <thread>
#include <vector>

#include "src/core/error.h"
#include "src/machines/wire.h"

namespace trex::machines {

struct LinkTraffic {
  std::uint64_t sentBytes = 0, receivedBytes = 0;
};

class Link {
 public:
  using MakeWire = std::function<std::unique_ptr<Wire>()>;
  /// Called by the link's thread, for each message and a few times a second.
  struct Hears {
    std::function<void(std::uint32_t from, Kind kind, ByteView body)> message;
    std::function<void()> tick;
    /// A machine has died, and the others go on. May be empty.
    std::function<void(std::uint32_t machine)> lost{};
    /// Bytes that are no message, or a wire that broke. After it nothing is received any more.
    std::function<void(const Error& error)> broken;
  };

  /// Makes the wire, in the link's thread. Throws what that throws.
  explicit Link(const MakeWire& make);
  /// Ends without waiting for anybody, if finish() was not called.
  ~Link();
  Link(const Link&) = delete;
  Link& operator=(const Link&) = delete;

  std::uint32_t rank() const { return rank_; }
  std::uint32_t size() const { return size_; }

  /// From now on messages are heard; those that came before wait for it. To be called once.
  void listen(Hears hears);
  /// Any thread. Returns at once.
  void send(std::uint32_t to, Bytes message);
  template <class M>
  void send(std::uint32_t to, const M& message) {
    send(to, encode(message));
  }
  /// Sends a message once all others that were given to send() have gone. Once; any thread.
  void sendLast(std::uint32_t to, Bytes message);
  /// Sends what is left, waits for all other machines' finish(), and ends the thread.
  void finish();
  /// Ends all machines at once: Wire::abort().
  void abort(int code);
  LinkTraffic traffic() const;

 private:
  void work(const MakeWire& make);
  void tick();
  void tellBroken(const Error& error);
  void end(Wire& wire);
  bool sendAll(Wire& wire);
  void sendTheLast(Wire& wire);
  bool hearAll(Wire& wire);
  void hearOfLost(Wire& wire);
  bool pause(double seconds);

  std::uint32_t rank_ = 0, size_ = 1;
  mutable std::mutex mutex_;
  std::condition_variable wake_, made_;
  std::deque<std::pair<std::uint32_t, Bytes>> outgoing_;
  std::optional<std::pair<std::uint32_t, Bytes>> last_;  ///< of sendLast()
  std::shared_ptr<const Hears> hears_;
  std::exception_ptr problem_;
  bool isMade_ = false, ends_ = false, abandons_ = false, broken_ = false;
  std::optional<int> aborts_;
  LinkTraffic traffic_;
  std::jthread thread_;
};

}  // namespace trex::machines
