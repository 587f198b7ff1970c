// Rays that wait for pages, page by page.
#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <vector>

namespace trex {

/// Numbers of rays, each in at most one queue at a time. Thread safe, without locks.
class PageQueues {
 public:
  PageQueues(std::size_t pages, std::size_t rays)
      : queues_(pages), next_(std::make_unique_for_overwrite<std::uint32_t[]>(rays)) {}

  static std::uint64_t bytesARay() { return sizeof(std::uint32_t); }

  void push(std::uint32_t page, std::uint32_t ray) {
    Queue& q = queues_[page];
    std::uint32_t head = q.head.load(std::memory_order_relaxed);
    do {
      next_[ray] = head;
    } while (!q.head.compare_exchange_weak(head, ray));
    q.waiting.fetch_add(1);
  }
  /// Empties a queue into `rays`, those that came last first.
  void take(std::uint32_t page, std::vector<std::uint32_t>& rays) {
    Queue& q = queues_[page];
    const std::size_t before = rays.size();
    for (std::uint32_t r = q.head.exchange(kNone); r != kNone; r = next_[r]) rays.push_back(r);
    q.waiting.fetch_sub(static_cast<std::uint32_t>(rays.size() - before));
  }
  /// Rays in a queue; while others push or take it may be off by those on the way.
  std::uint32_t waiting(std::uint32_t page) const {
    const auto count = static_cast<std::int32_t>(queues_[page].waiting.load());
    return count > 0 ? static_cast<std::uint32_t>(count) : 0;
  }
  std::uint32_t pages() const { return static_cast<std::uint32_t>(queues_.size()); }

 private:
  static constexpr std::uint32_t kNone = 0xffffffffu;
  struct Queue {
    std::atomic<std::uint32_t> head{kNone}, waiting{0};
  };
  std::vector<Queue> queues_;
  std::unique_ptr<std::uint32_t[]> next_;
};

}  // namespace trex
