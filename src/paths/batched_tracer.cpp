#include "src/paths/batched_tracer.h"

#include <algorithm>
#include <atomic>
#include <memory>
#include <mutex>

#include "src/paths/page_rounds.h"

namespace trex {

/// The paths of one call.
struct BatchedTracer::Batch {
  std::span<const PathJob> jobs;
  std::uint32_t width;
  std::span<PathSample> samples;
  std::span<RayCounts> counts;
  std::span<const PathState> begun;  ///< paths that go on instead of jobs that begin
  // By job; made when they are needed. lights, media: where the scene asks for them, else null.
  WaitingPath* paths = nullptr;
  WaitingLight* lights = nullptr;
  MediumLight* media = nullptr;
  PageRounds* rounds = nullptr;
};

/// A thread: takes rays whose page is there, and takes their paths as far as they go.
struct BatchedTracer::Worker {
  const PathTracer& tracer;
  const RayScene& rays;
  Batch& batch;
  Cones cones{};
  Wave wave{cones};
  std::vector<std::uint32_t> ready{};  ///< paths that go on
  unsigned thread = 0;
  PageWorkDone done{};

  void run();
  void answer(std::uint32_t ray);
  void goOn();
  void begin(std::uint32_t job);
  WavePath& enter(std::uint32_t job, const PathState& state, const Sampler& sampler);
  bool settle(WavePath& path);
  bool arrives(WavePath& path);
  bool lightHere(std::uint32_t job);
  bool scatter(WavePath& path);
  bool trace(WavePath& path);
  void detach(WavePath& path);
  void keep(const WavePath& path, int open);
  void park(std::uint32_t job, bool shadow);
};

/// Rays are numbered by path: towards the next surface 2 * path, towards the light one more.
void BatchedTracer::Worker::run() {
  PageWork work;
  while (batch.rounds->next(work, done, thread)) {
    for (std::uint64_t job = work.first; job < work.end && work.page == PageWork::kBegin; ++job) {
      begin(static_cast<std::uint32_t>(job));
      if (wave.paths.size() == Wave::kPaths || job + 1 == work.end) goOn();
    }
    for (const std::uint32_t ray : work.rays) answer(ray);
    for (std::size_t i = 0; i < ready.size(); i += Wave::kPaths) {
      wave.paths.clear();
      for (std::size_t k = i; k < std::min(ready.size(), i + Wave::kPaths); ++k) {
        const WaitingPath& path = batch.paths[ready[k]];
        enter(ready[k], path.state, Sampler(path.state.random));
      }
      std::erase_if(wave.underWay, [&](WavePath* path) { return !settle(*path); });
      goOn();
    }
    ready.clear();
    batch.rounds->finish(work, done, thread);
  }
}

/// A ray whose page has come. A path goes on once both of its rays are answered.
void BatchedTracer::Worker::answer(std::uint32_t ray) {
  WaitingPath& path = batch.paths[ray / 2];
  const bool shadow = ray % 2 != 0;
  // What a path asks before it arrives is asked again there.
  const bool arriving = path.arrival != Arrival::kOpen;
  if (!arriving && !(shadow ? lightHere(ray / 2) : rays.meetHere(path.query(), path.ray))) {
    park(ray / 2, shadow);
  } else if (std::atomic_ref(path.open).fetch_sub(1) == 1) {
    ready.push_back(ray / 2);
  }
}

/// The ray waits for its page.
void BatchedTracer::Worker::park(std::uint32_t job, bool shadow) {
  WaitingPath& path = batch.paths[job];
  WaitingRay& ray = shadow ? path.shadow : path.ray;
  batch.rounds->wait(2 * job + (shadow ? 1 : 0), ray, rays.awaited(ray), done);
}

/// Whether it is known what arrives of the light that the path asks for; else its ray waits.
bool BatchedTracer::Worker::lightHere(std::uint32_t job) {
  WaitingPath& path = batch.paths[job];
  return batch.lights == nullptr ? rays.occludedHere(path.towards, path.shadow)
                                 : tracer.answerHere(batch.lights[job], path.shadow, path.light);
}

WavePath& BatchedTracer::Worker::enter(std::uint32_t job, const PathState& state,
                                       const Sampler& sampler) {
  WavePath& path = tracer.enter(wave, state, sampler, batch.samples[job], batch.counts[job]);
  wave.underWay.push_back(&path);
  return path;
}

void BatchedTracer::Worker::begin(std::uint32_t job) {
  const auto first = [&](const PathState& state, const Sampler& sampler) {
    std::construct_at(&batch.paths[job], WaitingPath{.state = state});
    WavePath& path = enter(job, state, sampler);
    if (path.paired) ++path.counts->exactPaths;
    if (!trace(path)) wave.underWay.pop_back();
  };
  if (!batch.begun.empty()) {
    PathState state = batch.begun[job].resumed();
    state.job = job;
    return first(state, Sampler(state.random));
  }
  const PathJob& j = batch.jobs[job];
  Sampler sampler(j.y * batch.width + j.x, j.sample, tracer.seed_);
  const PathState state = tracer.generate(j, job, sampler);
  first(state, sampler);
}

/// Paths of the wave whose next surface is known, through all stages, until the last one waits or
/// has ended.
void BatchedTracer::Worker::goOn() {
  while (!wave.underWay.empty()) {
    tracer.decode(wave);  // none of a streamed mesh is plain
    std::erase_if(wave.underWay, [&](WavePath* path) {
      path->fate = tracer.arrive(*path);
      path->asks = false;
      if (path->fate == Fate::kEnds) ++done.ended;
      return path->fate == Fate::kEnds;
    });
    for (WavePath* path : wave.underWay) {
      if (path->fate == Fate::kLit) tracer.ask(*path, wave);
    }
    std::erase_if(wave.underWay, [&](WavePath* path) { return !scatter(*path); });
    std::erase_if(wave.underWay, [&](WavePath* path) { return !trace(*path); });
  }
  wave.paths.clear();
}

/// The light of a vertex becomes a question of its own.
void BatchedTracer::Worker::detach(WavePath& path) {
  WaitingPath& w = batch.paths[path.job];
  if (!path.asks) return tracer.answer(path, wave);
  ++path.counts->shadowRays;
  const LightQuestion& q = path.question;
  const RayEnd end = q.light.end();
  w.shadow = WaitingRay();
  w.light.direct = path.scattered == 0;
  if (batch.lights != nullptr) {
    std::construct_at(&batch.lights[path.job], WaitingLight{tracer.asked(path)});
    w.asks = true;
  } else {
    const LightConnection way = tracer.throughMedia(
        ClearLayers::unblocked(q.light.direction, end, tracer.absorptionOf(path)), q.start,
        q.light.direction, end);
    w.asks = way.reaches();
    w.light = weigh(q, path.throughput, path.coupled, w.light.direct, way, q.surface);
    const vec3 towards =
        end.point ? vec3(glm::normalize(*end.point - q.start.position)) : q.light.direction;
    w.towards = {q.start, towards, 0.0f, end};
  }
  if (path.caustics == nullptr) return;
  w.caustics = tracer.causticLight(path, wave);
  w.collects = w.asks;
  if (!w.asks) path.add(w.caustics, path.scattered == 0);
}

/// False if the path has ended, and no light is under way to it.
bool BatchedTracer::Worker::scatter(WavePath& path) {
  WaitingPath& w = batch.paths[path.job];
  w.asks = w.collects = false;
  if (path.fate == Fate::kLit) detach(path);
  w.ended = path.fate != Fate::kPasses && !tracer.scatter(path);
  if (!w.ended || w.asks) return true;
  ++done.ended;
  return false;
}

/// Traces a path's rays as far as they go. False if it waits, or has ended.
bool BatchedTracer::Worker::trace(WavePath& path) {
  WaitingPath& w = batch.paths[path.job];
  w.ray = WaitingRay();
  w.arrival = Arrival::kOpen;
  if (!w.ended) w.next = tracer.nextRay(path);
  if (w.next.cone && path.paired) w.next.end = kInfinity;  // rather than twice
  const bool lit = !w.asks || lightHere(path.job);
  const bool met =
      w.ended || rays.meetHere({path.start, path.direction, path.tnear, RayEnd(w.next.end)}, w.ray);
  if (lit && met) return settle(path);
  keep(path, (lit ? 0 : 1) + (met ? 0 : 1));
  const std::uint32_t job = path.job;
  if (!lit) park(job, true);
  if (!met) park(job, false);  // from here on the path may be another thread's
  return false;
}

/// What the path is until its rays are answered.
void BatchedTracer::Worker::keep(const WavePath& path, int open) {
  WaitingPath& w = batch.paths[path.job];
  w.state = path;
  w.state.random = path.sampler.state();
  w.open = static_cast<std::uint8_t>(open);
}

/// Both rays are answered. False if the path has ended, or waits for the page of the surface or for
/// what it asks before it arrives there.
bool BatchedTracer::Worker::settle(WavePath& path) {
  WaitingPath& w = batch.paths[path.job];
  if (w.asks && !w.shadow.blocked) path.add(w.light);
  if (w.collects) path.add(w.caustics, w.light.direct);
  w.asks = w.collects = false;
  if (w.ended) {
    ++done.ended;
    return false;
  }
  if (!arrives(path)) return false;
  path.hit = w.ray.best;
  const bool goesOn = tracer.takeHit(path, wave, w.next, w.ray.hit());
  if (!goesOn) ++done.ended;
  return goesOn;
}

/// What a path asks at the end of its ray: light that media scatter on the way there, and how light
/// of what shines there could have been sampled through glass. False if it waits for a page. What
/// it waits for is met as soon as it is there, whatever else may be gone then.
bool BatchedTracer::Worker::arrives(WavePath& path) {
  WaitingPath& w = batch.paths[path.job];
  const auto wait = [&](bool shadow) {
    keep(path, 1);
    park(path.job, shadow);
    return false;
  };
  // A cone has asked the media already.
  MediumLight* const medium =
      batch.media == nullptr || w.next.cone ? nullptr : &batch.media[path.job];
  if (w.arrival == Arrival::kOpen) {
    w.arrival = Arrival::kMedium;
    w.shadow = WaitingRay();
    if (medium != nullptr) {
      std::construct_at(medium);
      tracer.drawMedium(path, w.ray.hit() ? w.ray.best.t : kInfinity, *medium);
    }
  }
  if (w.arrival == Arrival::kMedium) {
    if (medium != nullptr && !tracer.lightMedium(*medium, &w.shadow)) return wait(true);
    w.arrival = Arrival::kSurface;
  }
  const bool asksAgain = w.arrival == Arrival::kEmitter;
  if (!asksAgain && w.ray.hit() && !rays.surfaceIsHere(w.ray.best)) return wait(false);
  if (w.arrival == Arrival::kSurface) {
    w.arrival = Arrival::kReady;
    w.emitter =
        batch.lights != nullptr && w.ray.hit() && tracer.asksEmitter(path, w.ray.best, w.towards);
    if (w.emitter) {
      w.arrival = Arrival::kEmitter;
      w.shadow = WaitingRay();
      batch.lights[path.job].way = WaitingConnection();
    }
  }
  if (w.arrival == Arrival::kEmitter) {
    const RayQuery& q = w.towards;
    if (!tracer.layers_.connectHere(q.start, q.direction, q.end, vec3(0.0f), w.shadow,
                                    batch.lights[path.job].way))
      return wait(true);
    w.arrival = Arrival::kReady;
    if (!rays.surfaceIsHere(w.ray.best)) return wait(false);
  }
  path.medium = medium;
  path.emitter = w.emitter ? &batch.lights[path.job].way.found : nullptr;
  return true;
}

BatchedTracer::BatchedTracer(const PathTracer& tracer, const RayScene& rays, LoadChoice& choice,
                             TrafficRecord* record)
    : tracer_(tracer), rays_(rays), choice_(choice), record_(record) {}

std::uint64_t BatchedTracer::bytesAPath(const Scene& scene) {
  return sizeof(WaitingPath) + 2 * PageQueues::bytesARay() +
         (ClearLayers::blockOnly(scene) ? 0 : sizeof(WaitingLight)) +
         (scene.media.empty() ? 0 : sizeof(MediumLight));
}

namespace {

/// Memory of so many records, none of which is made.
template <typename Record>
class Records {
 public:
  explicit Records(std::size_t count)
      : count_(count), first_(count > 0 ? std::allocator<Record>().allocate(count) : nullptr) {}
  ~Records() {
    if (first_ != nullptr) std::allocator<Record>().deallocate(first_, count_);
  }
  Records(const Records&) = delete;
  Records& operator=(const Records&) = delete;
  Record* first() const { return first_; }

 private:
  static_assert(std::is_trivially_destructible_v<Record>);
  std::size_t count_;
  Record* first_;
};

}  // namespace

bool BatchedTracer::run(Batch& batch, std::size_t count, Cones& cones,
                        const std::function<bool()>& giveUp) {
  const Records<WaitingPath> paths(count);
  const Records<WaitingLight> lights(tracer_.layers_.blockOnly() ? 0 : count);
  const Records<MediumLight> media(tracer_.media_ == nullptr ? 0 : count);
  PageRounds rounds(rays_, choice_, record_, count, 2 * count, giveUp);
  batch.paths = paths.first();
  batch.lights = lights.first();
  batch.media = media.first();
  batch.rounds = &rounds;
  std::mutex merging;
  const bool whole = rounds.run([&](unsigned thread) {
    Worker worker{tracer_, rays_, batch};
    worker.thread = thread;
    worker.run();
    const std::lock_guard lock(merging);
    cones.append(worker.cones);
  });
  report_.add(rounds.report());
  return whole;
}

bool BatchedTracer::trace(std::span<const PathJob> jobs, std::uint32_t width,
                          std::span<PathSample> samples, std::span<RayCounts> counts, Cones& cones,
                          const std::function<bool()>& giveUp) {
  Batch batch{jobs, width, samples, counts, {}};
  if (!run(batch, jobs.size(), cones, giveUp)) return false;
  std::sort(cones.requests.begin(), cones.requests.end(),
            [](const ConeRequest& a, const ConeRequest& b) {
              return a.job != b.job ? a.job < b.job : a.bounce < b.bounce;
            });
  return true;
}

void BatchedTracer::resume(std::span<const PathState> paths, std::span<PathSample> samples,
                           std::span<RayCounts> counts) {
  if (paths.empty()) return;
  Cones none;
  Batch batch{{}, 0, samples, counts, paths};
  run(batch, paths.size(), none, {});
}

}  // namespace trex
