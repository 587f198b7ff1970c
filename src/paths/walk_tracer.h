// Follows walks (walk.h) to their ends: in memory in waves that go through the same steps together
// (rays, surfaces, what these make of walks); where pages do not fit, each as far as the pages that
// are there go, and then it waits in the queue of a page (page_traffic.h), as paths of the camera
// do.
#pragma once

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cstddef>
#include <functional>
#include <memory>
#include <vector>

#include "src/core/threads.h"
#include "src/crays/waiting_ray.h"
#include "src/paths/page_rounds.h"
#include "src/paths/plain_wave.h"
#include "src/paths/walk.h"

namespace trex {

/// follow() by one thread at a time; it uses all of the calling oneTBB arena.
class WalkTracer {
 public:
  static constexpr std::size_t kWave = PlainWave::kMost;

  /// In memory, or on demand: a thread loads the page that a ray needs. `wave` walks, [1, kWave],
  /// go together. The rays must outlive it.
  explicit WalkTracer(const RayScene& rays, std::size_t wave = kWave) : rays_(rays), wave_(wave) {}
  /// Walks wait for pages. `bytes`: for walks under way. All must outlive it; `record` may be null.
  WalkTracer(const RayScene& rays, LoadChoice& choice, std::uint64_t bytes,
             TrafficRecord* record = nullptr)
      : rays_(rays), wave_(kWave), choice_(&choice), bytes_(bytes), record_(record) {}

  const RayScene& rays() const { return rays_; }
  /// Whether walks wait, so that many should be asked for at once.
  bool waits() const { return choice_ != nullptr; }
  /// Of walks that waited.
  const PageTrafficReport& report() const { return report_; }

  /// Follows walks 0 ... count - 1 and appends what they find: the same for any number of threads,
  /// wave, and pages that are there. `giveUp`, asked by all threads while walks wait, says whether
  /// to leave it; false if it did: what was found, here or where walks left it, is of no use then.
  /// Throws as RayScene::intersect().
  template <WalkKind Kind>
  bool follow(const Kind& kind, std::uint32_t count, std::vector<typename Kind::Found>& found,
              const PageRounds::GiveUp& giveUp = {}) const;
  /// The same of walks that find nothing on their way.
  template <WalkKind Kind>
  void follow(const Kind& kind, std::uint32_t count) const {
    std::vector<FindsNothing> nothing;
    follow(kind, count, nothing);
  }

 private:
  static constexpr std::uint32_t kLeastChunk = 64, kMostChunk = 1024;  ///< that a thread takes

  static std::uint32_t chunkOf(std::uint32_t count) {
    const int threads = threadsAllowed();
    return std::clamp(count / (2 * static_cast<std::uint32_t>(threads)), kLeastChunk, kMostChunk);
  }

  template <WalkKind Kind>
  class Waves;
  template <WalkKind Kind>
  class Waiting;

  const RayScene& rays_;
  std::size_t wave_;
  LoadChoice* choice_ = nullptr;  ///< null: nobody waits
  std::uint64_t bytes_ = 0;
  TrafficRecord* record_ = nullptr;
  mutable PageTrafficReport report_;
};

/// Waves of one thread.
template <WalkKind Kind>
class WalkTracer::Waves {
 public:
  Waves(const WalkTracer& tracer, const Kind& kind, WalkFindings<typename Kind::Found>& found)
      : tracer_(tracer), kind_(kind), found_(found) {
    lanes_.reserve(tracer.wave_);
    underWay_.reserve(tracer.wave_);
  }

  /// Walks first ... end - 1. Where one ends the next begins, so that waves stay full.
  void run(std::uint32_t first, std::uint32_t end) {
    next_ = first;
    end_ = end;
    const std::uint32_t count = std::min(static_cast<std::uint32_t>(tracer_.wave_), end_ - next_);
    for (std::uint32_t i = 0; i < count; ++i) {
      Lane& lane = lanes_.emplace_back(kind_, 0u);
      if (begin(lane)) underWay_.push_back(&lane);
    }
    while (!underWay_.empty()) {
      trace();
      goOn();
    }
  }

 private:
  struct Lane {
    typename Kind::State walk{};
    Sampler sampler;
    RayHit hit{};
    WalkEnd end{};
    std::uint8_t place = PlainWave::kNotPlain;  ///< of a plain surface
    bool goesOn = true;                         ///< from a plain surface
    Lane(const Kind& kind, std::uint32_t number) : sampler(kind.sampler(number)) {
      walk.number = number;
    }
  };

  /// The next walk that has a ray. False if none is left.
  bool begin(Lane& lane) {
    while (next_ < end_) {
      std::construct_at(&lane, kind_, next_++);
      if (kind_.begin(lane.walk, lane.sampler)) return true;
    }
    return false;
  }

  /// Whether its ray has a start. False if the triangle that it leaves is in the way.
  bool leave(Walk& walk) const {
    const RayExit exit = walk.exit;
    if (!exit.asks()) return exit.open;
    walk.exit = {};
    const RayQuery q = exit.query(walk.start);
    return exit.settle(tracer_.rays_.occluded(q.start, q.direction, q.tnear, q.end), walk.start);
  }

  /// The next rays.
  void trace() {
    for (Lane* lane : underWay_) {
      const Walk& walk = lane->walk;
      if (!leave(lane->walk)) {
        lane->walk.exit = {};
        lane->end.kind = WalkEnd::Kind::kClosed;
        continue;
      }
      const RayScene& rays = tracer_.rays_;
      const bool met = Kind::kAnyHit
                           ? rays.occluded(walk.start, walk.direction, 0.0f, walk.end)
                           : rays.intersect(walk.start, walk.direction, 0.0f, walk.end, lane->hit);
      lane->end.kind = met ? WalkEnd::Kind::kHit : WalkEnd::Kind::kNothing;
    }
  }

  /// What is at the ends of the rays, and what it makes of the walks.
  void goOn() {
    if constexpr (!Kind::kAnyHit) decode();
    if constexpr (kPlain) passPlain();
    std::erase_if(underWay_, [&](Lane* lane) {
      const bool goesOn = lane->place != PlainWave::kNotPlain
                              ? lane->goesOn
                              : kind_.advance(lane->walk, lane->sampler, lane->end, found_);
      return !goesOn && !begin(*lane);
    });
  }

  /// Surfaces that were met.
  void decode() {
    plain_.plainCount = 0;
    for (Lane* lane : underWay_) {
      lane->place = PlainWave::kNotPlain;
      if (!lane->end.met()) continue;
      if constexpr (kPlain) {
        lane->place =
            kind_.plain.decode(lane->hit, lane->walk.direction, plain_, lane->end.surface);
        lane->end.distance = lane->hit.t;
      }
      if (lane->place == PlainWave::kNotPlain) lane->end.take(tracer_.rays_, lane->hit);
      kind_.await(lane->end.surface);
    }
  }

  /// What plain surfaces make of walks, in lanes.
  void passPlain() {
    if (plain_.plainCount == 0) return;
    const PlainSurfaces& plain = kind_.plain;
    PlainWave::Samples samples{};
    const auto forPlain = [&](const auto& what) {
      for (Lane* lane : underWay_) {
        if (lane->place != PlainWave::kNotPlain) what(*lane);
      }
    };
    forPlain([&](Lane& lane) { plain.colour(lane.place, lane.end.surface, plain_); });
    plain.shade(plain_);
    forPlain([&](Lane& lane) {
      if (!plain.finish(lane.place, plain_, lane.end.surface)) {
        lane.place = PlainWave::kNotPlain;
        lane.end.take(tracer_.rays_, lane.hit);
        return;
      }
      lane.goesOn = kind_.arrivePlain(lane.walk, lane.end, plain_.at(lane.place), found_);
      if (lane.goesOn) PlainWave::draw(lane.place, lane.sampler, samples);
    });
    for (std::size_t i = 0; i < plain_.plainBlocks(); ++i) {
      plain.kernels().sample(plain_.plain[i], samples[i]);
    }
    forPlain([&](Lane& lane) {
      BsdfSample next;
      lane.goesOn = lane.goesOn && PlainWave::sampled(lane.place, samples, next) &&
                    kind_.scatterPlain(lane.walk, lane.sampler, lane.end.surface,
                                       plain_.at(lane.place), next);
    });
  }

  static constexpr bool kPlain = requires(const Kind& kind) { kind.plain; };

  const WalkTracer& tracer_;
  const Kind& kind_;
  PlainWave plain_;
  std::vector<Lane> lanes_;
  std::vector<Lane*> underWay_;
  std::uint32_t next_ = 0, end_ = 0;  ///< walks that have not begun
  WalkFindings<typename Kind::Found>& found_;
};

/// Walks that wait for pages: first ... first + count - 1.
template <WalkKind Kind>
class WalkTracer::Waiting {
 public:
  Waiting(const WalkTracer& tracer, const Kind& kind, std::uint32_t first, std::uint32_t count)
      : tracer_(tracer), kind_(kind), first_(first), walks_(count) {}

  /// With two findings.
  static std::uint64_t bytesAWalk() {
    return sizeof(Record) + PageQueues::bytesARay() +
           2 * WalkFindings<typename Kind::Found>::bytesOfOne();
  }

  bool run(std::vector<typename Kind::Found>& found, const PageRounds::GiveUp& giveUp) {
    const auto count = static_cast<std::uint32_t>(walks_.size());
    PageRounds rounds(tracer_.rays_, *tracer_.choice_, tracer_.record_, count, count, giveUp);
    std::vector<WalkFindings<typename Kind::Found>> findings(
        static_cast<std::size_t>(rounds.threads()));
    const bool whole = rounds.run([&](unsigned thread) {
      PageWork work;
      PageWorkDone done;
      Turn turn{rounds, done, findings[thread]};
      while (rounds.next(work, done, thread)) {
        for (std::uint64_t i = work.first; i < work.end && work.page == PageWork::kBegin; ++i) {
          begin(static_cast<std::uint32_t>(i), turn);
        }
        for (const std::uint32_t i : work.rays) {
          Sampler sampler(walks_[i].random);
          goOn(i, sampler, turn);
        }
        rounds.finish(work, done, thread);
      }
    });
    tracer_.report_.add(rounds.report());
    if (whole) WalkFindings<typename Kind::Found>::inOrder(findings, first_, count, found);
    return whole;
  }

 private:
  struct Record {
    typename Kind::State walk{};
    WaitingRay ray{};
    Sampler::State random{};
  };
  /// A piece of work.
  struct Turn {
    PageRounds& rounds;
    PageWorkDone& done;
    WalkFindings<typename Kind::Found>& found;
  };

  void begin(std::uint32_t i, Turn& turn) {
    Record& record = walks_[i];
    record.walk.number = first_ + i;
    Sampler sampler = kind_.sampler(first_ + i);
    if (!kind_.begin(record.walk, sampler)) {
      ++turn.done.ended;
      return;
    }
    goOn(i, sampler, turn);
  }

  /// As far as the pages that are there go.
  void goOn(std::uint32_t i, Sampler& sampler, Turn& turn) {
    Record& record = walks_[i];
    WalkEnd end;
    std::uint32_t page = 0;
    do {
      if (!trace(record, end, page)) {
        record.random = sampler.state();
        return turn.rounds.wait(i, record.ray, page, turn.done);
      }
      record.ray = WaitingRay();
    } while (kind_.advance(record.walk, sampler, end, turn.found));
    ++turn.done.ended;
  }

  /// The end of its ray. False if it waits for a page.
  bool trace(Record& record, WalkEnd& end, std::uint32_t& page) const {
    const RayScene& rays = tracer_.rays_;
    Walk& walk = record.walk;
    WaitingRay& ray = record.ray;
    if (walk.exit.asks()) {
      if (!rays.occludedHere(walk.exit.query(walk.start), ray)) {
        page = ray.page();
        return false;
      }
      walk.exit.open = walk.exit.settle(ray.blocked, walk.start);
      walk.exit.lift = vec3(0.0f);
      ray = WaitingRay();
    }
    end.kind = WalkEnd::Kind::kClosed;
    if (walk.exit.open) {
      const bool answered =
          Kind::kAnyHit ? rays.occludedHere(walk.query(), ray) : rays.meetHere(walk.query(), ray);
      if (!answered) {
        page = rays.awaited(ray);
        return false;
      }
      const bool met = Kind::kAnyHit ? ray.blocked : ray.hit();
      end.kind = met ? WalkEnd::Kind::kHit : WalkEnd::Kind::kNothing;
      if (ray.hit()) end.take(rays, ray.best);
    }
    walk.exit = {};
    return true;
  }

  const WalkTracer& tracer_;
  const Kind& kind_;
  std::uint32_t first_;
  std::vector<Record> walks_;
};

template <WalkKind Kind>
bool WalkTracer::follow(const Kind& kind, std::uint32_t count,
                        std::vector<typename Kind::Found>& found,
                        const PageRounds::GiveUp& giveUp) const {
  if (waits()) {
    const std::uint64_t most =
        std::clamp<std::uint64_t>(bytes_ / Waiting<Kind>::bytesAWalk(), kMostChunk, 1u << 30);
    for (std::uint32_t first = 0; first < count;) {
      const auto size = static_cast<std::uint32_t>(std::min<std::uint64_t>(count - first, most));
      if (!Waiting<Kind>(*this, kind, first, size).run(found, giveUp)) return false;
      first += size;
    }
    return true;
  }
  const std::uint32_t size = chunkOf(count), chunks = (count + size - 1) / size;
  std::vector<WalkFindings<typename Kind::Found>> parts(chunks);
  tbb::parallel_for(std::uint32_t{0}, chunks, [&](std::uint32_t chunk) {
    Waves<Kind>(*this, kind, parts[chunk]).run(chunk * size, std::min(count, (chunk + 1) * size));
  });
  WalkFindings<typename Kind::Found>::inOrder(parts, 0, count, found);
  return true;
}

}  // namespace trex
