#include "src/machines/link.h"

#include <algorithm>
#include <chrono>

#include "src/core/clock.h"

namespace trex::machines {
namespace {

// A link that is idle looks now and then; the longer nothing comes, the more seldom.
// Messages on their way want a look more often than that, but each look costs a processor more than
// what it moves on: with pauses of 20 us a link that brought pages took an eighth of its machine.
constexpr double kShortestPause = 200e-6, kLongestPause = 1e-3;
constexpr double kTickSeconds = 0.25;

}  // namespace

Link::Link(const MakeWire& make) {
  thread_ = std::jthread([this, make] { work(make); });
  std::unique_lock lock(mutex_);
  made_.wait(lock, [&] { return isMade_ || problem_; });
  if (!problem_) return;
  lock.unlock();
  thread_.join();
  std::rethrow_exception(problem_);
}

Link::~Link() {
  if (!thread_.joinable()) return;
  {
    const std::lock_guard lock(mutex_);
    ends_ = abandons_ = true;
  }
  wake_.notify_one();
}

void Link::listen(Hears hears) {
  const std::lock_guard lock(mutex_);
  hears_ = std::make_shared<const Hears>(std::move(hears));
  wake_.notify_one();
}

void Link::send(std::uint32_t to, Bytes message) {
  {
    const std::lock_guard lock(mutex_);
    outgoing_.emplace_back(to, std::move(message));
  }
  wake_.notify_one();
}

void Link::sendLast(std::uint32_t to, Bytes message) {
  {
    const std::lock_guard lock(mutex_);
    last_.emplace(to, std::move(message));
  }
  wake_.notify_one();
}

void Link::finish() {
  {
    const std::lock_guard lock(mutex_);
    ends_ = true;
  }
  wake_.notify_one();
  if (thread_.joinable()) thread_.join();
}

void Link::abort(int code) {
  {
    const std::lock_guard lock(mutex_);
    aborts_ = code;
  }
  finish();
}

LinkTraffic Link::traffic() const {
  const std::lock_guard lock(mutex_);
  return traffic_;
}

/// Hands over what is to be sent. Whether there was anything.
bool Link::sendAll(Wire& wire) {
  std::deque<std::pair<std::uint32_t, Bytes>> out;
  {
    const std::lock_guard lock(mutex_);
    out.swap(outgoing_);
    for (const auto& [to, message] : out) traffic_.sentBytes += message.size();
  }
  for (auto& [to, message] : out) wire.send(to, std::move(message));
  return !out.empty();
}

void Link::sendTheLast(Wire& wire) {
  {
    const std::lock_guard lock(mutex_);
    if (!last_ || !outgoing_.empty()) return;
  }
  if (wire.unsent() > 0) return;
  const std::lock_guard lock(mutex_);
  outgoing_.push_back(std::move(*last_));
  last_.reset();
}

/// Hears what is there. Whether there was anything.
bool Link::hearAll(Wire& wire) {
  std::shared_ptr<const Hears> hears;
  {
    const std::lock_guard lock(mutex_);
    if (broken_) return false;
    hears = hears_;
  }
  if (!hears) return false;
  bool any = false;
  for (std::optional<Received> got; (got = wire.receive()); any = true) {
    {
      const std::lock_guard lock(mutex_);
      traffic_.receivedBytes += got->message.size();
    }
    try {
      ByteView body;
      const Kind kind = openMessage(got->message, body);
      hears->message(got->from, kind, body);
    } catch (const MessageError& e) {
      fail(ExitCode::kFailed, "machine {}: a message can't be read: {}", got->from, e.what());
    }
    sendAll(wire);
  }
  return any;
}

void Link::hearOfLost(Wire& wire) {
  std::shared_ptr<const Hears> hears;
  {
    const std::lock_guard lock(mutex_);
    hears = hears_;
  }
  if (!hears || !hears->lost) return;
  while (const auto machine = wire.lost()) hears->lost(*machine);
}

/// Waits for something to send. Whether the link goes on.
bool Link::pause(double seconds) {
  std::unique_lock lock(mutex_);
  wake_.wait_for(lock, std::chrono::duration<double>(seconds),
                 [&] { return !outgoing_.empty() || ends_; });
  return !ends_;
}

void Link::tick() {
  std::shared_ptr<const Hears> hears;
  {
    const std::lock_guard lock(mutex_);
    if (!broken_) hears = hears_;
  }
  if (hears && hears->tick) hears->tick();
}

/// Once: what comes afterwards follows from it.
void Link::tellBroken(const Error& error) {
  std::shared_ptr<const Hears> hears;
  {
    const std::lock_guard lock(mutex_);
    if (!broken_) hears = hears_;
    broken_ = true;
  }
  if (hears && hears->broken) hears->broken(error);
}

void Link::end(Wire& wire) {
  if (aborts_) wire.abort(*aborts_);
  if (abandons_) return;
  // Whoever waits for us to take something is on its way to the end, too.
  const auto drain = [&] {
    sendAll(wire);
    while (wire.unsent() > 0) {
      wire.receive();
      std::this_thread::sleep_for(std::chrono::microseconds(100));
    }
  };
  drain();
  sendTheLast(wire);
  drain();
  wire.finish();
}

void Link::work(const MakeWire& make) {
  std::unique_ptr<Wire> wire;
  {
    std::unique_lock lock(mutex_);
    try {
      lock.unlock();
      wire = make();
      lock.lock();
      rank_ = wire->rank();
      size_ = wire->size();
      isMade_ = true;
    } catch (...) {
      lock.lock();
      problem_ = std::current_exception();
    }
  }
  made_.notify_one();
  if (!wire) return;
  double wait = kShortestPause, ticked = 0.0;
  do {
    try {
      const bool sent = sendAll(*wire), heard = hearAll(*wire);
      hearOfLost(*wire);
      sendTheLast(*wire);
      const double most = wire->unsent() > 0 ? kShortestPause : kLongestPause;
      wait = sent || heard ? kShortestPause : std::min(2.0 * wait, most);
      if (secondsNow() - ticked > kTickSeconds) {
        ticked = secondsNow();
        tick();
      }
    } catch (const Error& e) {
      tellBroken(e);
    }
  } while (pause(wait));
  try {
    end(*wire);
  } catch (const Error&) {  // whoever should hear of it has gone
  }
}

}  // namespace trex::machines
