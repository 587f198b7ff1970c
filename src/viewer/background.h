// Work beside the screen: one job at a time on a thread of its own, its result taken by the
// screen's thread when it is there. A job that was replaced ends unheard.
#pragma once

#include <atomic>
#include <exception>
#include <functional>
#include <memory>
#include <mutex>
#include <thread>
#include <vector>

namespace trex {

class Background {
 public:
  /// What a job hands over is run by take() on the thread that calls it.
  using Delivery = std::function<void()>;
  using Job = std::function<void(const std::function<void(Delivery)>& deliver)>;

  ~Background() { wait(); }

  /// Starts a job; waits for the one before, whose deliveries are dropped.
  void start(Job job, std::function<void(std::exception_ptr)> onError) {
    wait();
    deliveries_.clear();
    running_ = true;
    thread_ = std::thread([this, job = std::move(job), onError = std::move(onError)] {
      try {
        job([this](Delivery d) { add(std::move(d)); });
      } catch (...) {
        add([onError, error = std::current_exception()] { onError(error); });
      }
      running_ = false;
    });
  }
  bool busy() const { return running_; }
  bool hasDelivery() const {
    const std::lock_guard lock(mutex_);
    return !deliveries_.empty();
  }
  /// Runs what has been delivered, in its order.
  void take() {
    std::vector<Delivery> ready;
    {
      const std::lock_guard lock(mutex_);
      ready.swap(deliveries_);
    }
    for (const Delivery& d : ready) d();
  }
  void wait() {
    if (thread_.joinable()) thread_.join();
  }

 private:
  void add(Delivery d) {
    const std::lock_guard lock(mutex_);
    deliveries_.push_back(std::move(d));
  }
  mutable std::mutex mutex_;
  std::vector<Delivery> deliveries_;
  std::atomic<bool> running_{false};
  std::thread thread_;
};

}  // namespace trex
