// Threads that take work from PageTraffic until all of a set of paths or walks have ended.
#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "src/crays/ray_scene.h"
#include "src/crays/waiting_ray.h"
#include "src/paths/page_traffic.h"

namespace trex {

/// For one set. The scene has a mesh in pages.
class PageRounds {
 public:
  /// Threads that read, and hardly need a processor for it, beside those that trace. A disk has so
  /// many requests at once.
  static constexpr unsigned kReaders = 4;
  /// Asked all the time by all threads: whether to leave it. May be empty.
  using GiveUp = std::function<bool()>;

  /// `paths` are to begin, and have `rays` rays, numbered from 0. All threads of the calling oneTBB
  /// arena will trace. `record` may be null.
  PageRounds(const RayScene& scene, LoadChoice& choice, TrafficRecord* record, std::uint64_t paths,
             std::uint64_t rays, const GiveUp& giveUp);

  int threads() const { return threads_; }
  /// Calls work(thread) on each of them, which calls next() until that says no. False if it was
  /// given up. Throws what a thread threw; pages that can't be read are Error(kInput).
  bool run(const std::function<void(unsigned thread)>& work);
  /// A piece of work, and a clean record of it; false: there will be none.
  bool next(PageWork& work, PageWorkDone& done, unsigned thread);
  void finish(const PageWork& work, PageWorkDone& done, unsigned thread);
  /// A ray waits for a page. From here on its path may be another thread's.
  void wait(std::uint32_t number, WaitingRay& ray, std::uint32_t page, PageWorkDone& done) {
    done.waits.push_back(page);
    if (!ray.waited) ++done.rays;
    ray.waited = true;
    traffic_.wait(number, page);
  }
  /// After run().
  const PageTrafficReport& report() const { return report_; }

 private:
  int threads_;
  PageQueues queues_;
  PageTraffic traffic_;
  const GiveUp& giveUp_;
  std::vector<double> waited_;  ///< by thread: hccm::PageCache::secondsWaited() at next()
  PageTrafficReport report_;
};

}  // namespace trex
