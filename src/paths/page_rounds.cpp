#include "src/paths/page_rounds.h"

#include <tbb/parallel_for.h>

#include "src/core/clock.h"
#include "src/core/threads.h"
#include "src/crays/reading_pages.h"

namespace trex {

PageRounds::PageRounds(const RayScene& scene, LoadChoice& choice, TrafficRecord* record,
                       std::uint64_t paths, std::uint64_t rays, const GiveUp& giveUp)
    : threads_(threadsAllowed()),
      queues_(scene.parts().paged->table().pages.size(), rays),
      traffic_(*scene.parts().paged, choice, queues_, paths, kReaders, record),
      giveUp_(giveUp),
      waited_(static_cast<std::size_t>(threads_)) {}

bool PageRounds::run(const std::function<void(unsigned thread)>& work) {
  const double start = secondsNow();
  tbb::parallel_for(
      0, threads_, 1,
      [&](int thread) {
        try {
          work(static_cast<unsigned>(thread));
        } catch (...) {
          traffic_.fail(std::current_exception());
        }
      },
      tbb::simple_partitioner());
  report_ = traffic_.report();
  report_.tracing = (secondsNow() - start) * threads_;
  readingPages([&] { traffic_.rethrow(); });
  return !traffic_.gaveUp();
}

bool PageRounds::next(PageWork& work, PageWorkDone& done, unsigned thread) {
  if (!traffic_.next(work, thread)) return false;
  if (giveUp_ && giveUp_()) {
    traffic_.giveUp();
    return false;
  }
  done.start = secondsNow();
  waited_[thread] = hccm::PageCache::secondsWaited();
  done.ended = done.rays = 0;
  done.waits.clear();
  return true;
}

void PageRounds::finish(const PageWork& work, PageWorkDone& done, unsigned thread) {
  done.end = secondsNow();
  done.waited = hccm::PageCache::secondsWaited() - waited_[thread];
  traffic_.done(work, done, thread);
}

}  // namespace trex
