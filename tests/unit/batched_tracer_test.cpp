// Rays and paths that wait for pages: the bits of those that do not, whatever was there when.
#include "src/paths/batched_tracer.h"

#include <gtest/gtest.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <random>

#include "asvo/medium.h"
#include "src/core/error.h"
#include "tests/unit/glass_scenes.h"
#include "tests/unit/paged_scenes.h"

namespace trex {
namespace {

using test::paged, test::Paged;

constexpr std::uint32_t kSide = 24;

std::vector<Material> plain() { return {test::lambert(0.6f), test::lambert(0.3f)}; }

/// One that half of the rays pass, a thin pane, one that bends light, and one that shines.
std::vector<Material> clear() {
  std::vector<Material> materials = {test::lambert(0.6f), test::lambert(0.5f), test::glass(false),
                                     test::glass(true), test::lambert(0.2f, 3.0f)};
  materials[1].alphaMode = AlphaMode::kBlend;
  materials[1].baseColor.w = 0.5f;
  return materials;
}

/// Even fog around all of it.
void addFog(Scene& scene) {
  std::vector<asvo::MediumLeaf> leaves(8);
  for (int i = 0; i < 8; ++i) {
    leaves[i].origin = 8 * glm::ivec3(i >> 2, i >> 1 & 1, i & 1);
    leaves[i].density = 1.0f;
  }
  Medium& fog = scene.media.emplace_back();
  fog.grid = std::make_shared<const asvo::Medium>(asvo::Medium::build(leaves));
  fog.albedo = vec3(0.8f);
  fog.density = 0.7f;
  fog.anisotropy = 0.3f;
  for (int axis = 0; axis < 3; ++axis) fog.transform[axis][axis] = 0.125;
  fog.transform[3] = glm::dvec4(dvec3(-0.9375), 1.0);
}

bool same(const RayHit& a, const RayHit& b) {
  return a.t == b.t && a.u == b.u && a.v == b.v && a.instance == b.instance &&
         a.cluster == b.cluster && a.triangle == b.triangle;
}

TEST(WaitingRay, HasTheBitsOfARayThatDoesNotWait) {
  const Paged all = paged(plain(), 10'000), some = paged(plain(), 10'000);
  ASSERT_GT(all.mesh().table().pages.size(), 8u);
  std::mt19937 random(7);
  const auto pages = static_cast<std::uint32_t>(some.mesh().table().pages.size());
  int hits = 0, blocked = 0, waited = 0, longest = 0;
  for (int i = 0; i < 3000; ++i) {
    const glm::vec3 from = hccm::test::randomPoint(random, 0.6f);
    const glm::vec3 to = hccm::test::randomPoint(random, 0.5f) * vec3(1.0f, 1.0f, 0.3f);
    RayQuery query{RayStart(from), glm::normalize(to - from), 0.0f, RayEnd(kInfinity)};
    if (i % 3 == 0) query.end = RayEnd(0.5f);
    const auto untilAnswered = [&](const auto& ask) {
      WaitingRay ray;
      int turns = 0;
      while (!ask(ray)) {
        for (std::uint32_t p = 0; p < pages; ++p) {
          if (random() % 4 != 0) some.cache().evict(p);
          if (random() % 64 == 0) some.cache().pin(p);
        }
        some.cache().pin(ray.page());
        ++turns;
      }
      waited += turns > 0;
      longest = std::max(longest, turns);
      return ray;
    };
    const WaitingRay nearest =
        untilAnswered([&](WaitingRay& r) { return some.rays->intersectHere(query, r); });
    RayHit hit;
    const bool met = all.rays->intersect(query.start, query.direction, query.tnear, query.end, hit);
    ASSERT_EQ(nearest.hit(), met) << i;
    if (met) {
      ASSERT_TRUE(same(nearest.best, hit)) << i;
    }
    const WaitingRay any =
        untilAnswered([&](WaitingRay& r) { return some.rays->occludedHere(query, r); });
    ASSERT_EQ(any.blocked, all.rays->occluded(query.start, query.direction, query.tnear, query.end))
        << i;
    hits += met, blocked += any.blocked;
  }
  EXPECT_GT(hits, 500);
  EXPECT_GT(blocked, 300);
  EXPECT_GT(waited, 1000);
  EXPECT_GT(longest, 2);  // groups behind those that a ray can hold were looked for
}

struct Traced {
  std::vector<PathSample> samples;
  std::vector<RayCounts> counts;
  std::uint64_t loads = 0, onDemand = 0;  ///< of pages; of these, by stages
  std::uint64_t restored = 0,
                reads = 0;  ///< of the loads, those that unpacked nothing; of the file
  std::uint64_t inVain = 0, pages = 0;
};

std::vector<PathJob> jobs() {
  std::vector<PathJob> out;
  for (std::uint32_t s = 0; s < 2; ++s)
    for (std::uint32_t i = 0; i < kSide * kSide; ++i) out.push_back({i % kSide, i / kSide, s});
  return out;
}

/// `pages`: that may be there; 0: no path waits for any.
/// Likewise; see paged() for the rest.
Traced trace(const std::vector<Material>& materials, std::uint64_t pages, int threads = 3,
             bool fog = false, double readSeconds = 0.0, std::uint64_t keptBytes = 0) {
  const Paged model = paged(materials, pages == 0 ? 10'000 : pages, false, false,
                            fog ? addFog : nullptr, readSeconds, 1, keptBytes);
  const LightSet lights(model.scene, *model.rays);
  const CameraRays camera(model.scene.cameras.front(), dvec3(0.0), kSide, kSide);
  const PathTracer tracer(model.scene, *model.rays, lights, camera, GuessOptions{}, 5);
  const std::vector<PathJob> all = jobs();
  Traced out{std::vector<PathSample>(all.size()), std::vector<RayCounts>(all.size())};
  Cones cones;
  if (pages == 0) {
    tracer.trace(all, kSide, 0, out.samples, out.counts, cones);
    return out;
  }
  LoadChoice choice(model.mesh().table());
  BatchedTracer batched(tracer, *model.rays, choice);
  const std::uint64_t before = model.cache().statistics().loads;  // of lights that shine
  tbb::task_arena(threads).execute(
      [&] { batched.trace(all, kSide, out.samples, out.counts, cones); });
  const hccm::PageCache::Statistics pagesThen = model.cache().statistics();
  EXPECT_LE(pagesThen.peakBytes, model.cache().limit());
  out.loads = pagesThen.loads - before;
  out.onDemand = out.loads - std::min(out.loads, batched.report().loads);
  out.restored = pagesThen.restored;
  out.reads = dynamic_cast<const hccm::test::TestPages&>(model.cache().file()).reads;
  out.inVain = batched.report().readInVain;
  out.pages = model.mesh().table().pages.size();
  EXPECT_GE(batched.report().waits, batched.report().rays);
  EXPECT_GT(pagesThen.loads, 0u);
  return out;
}

void expectSame(const Traced& a, const Traced& b) {
  ASSERT_EQ(a.samples.size(), b.samples.size());
  for (std::size_t i = 0; i < a.samples.size(); ++i) {
    const PathSample &x = a.samples[i], &y = b.samples[i];
    ASSERT_EQ(x.common, y.common) << i;
    ASSERT_EQ(x.direct, y.direct) << i;
    ASSERT_EQ(x.own, y.own) << i;
    ASSERT_EQ(x.alpha, y.alpha) << i;
    ASSERT_EQ(x.feature.position, y.feature.position) << i;
    ASSERT_EQ(a.counts[i].cRays, b.counts[i].cRays) << i;
    ASSERT_EQ(a.counts[i].shadowRays, b.counts[i].shadowRays) << i;
  }
}

TEST(BatchedTracer, SamplesAreThoseOfPathsThatDoNotWait) {
  const Traced whole = trace(plain(), 0);
  double sum = 0.0;
  for (const PathSample& s : whole.samples) sum += s.common.x;
  EXPECT_GT(sum, 1.0);
  for (const std::uint64_t pages : {1, 2, 5, 10'000}) expectSame(trace(plain(), pages), whole);
  expectSame(trace(plain(), 2, 1), whole);
}

/// Where unpacked pages are kept none is read twice, or few if not all have room, whether others
/// read ahead or not.
TEST(BatchedTracer, KeptPagesAreNotReadAgain) {
  const Traced whole = trace(plain(), 0);
  for (const double readSeconds : {0.0, 0.001}) {
    for (const int threads : {1, 3}) {
      const Traced kept = trace(plain(), 3, threads, false, readSeconds, ~0ull);
      expectSame(kept, whole);
      EXPECT_GT(kept.loads, 2 * kept.pages);
      EXPECT_GT(kept.restored, kept.loads / 2);
      EXPECT_LE(kept.reads, kept.pages + kept.inVain + kept.onDemand);
      const Traced few = trace(plain(), 3, threads, false, readSeconds, 40'000);
      expectSame(few, whole);
      EXPECT_GT(few.restored, 0u);
      EXPECT_GT(few.reads, few.pages);
    }
  }
  expectSame(trace(clear(), 3, 3, true, 0.0, ~0ull), trace(clear(), 0, 1, true));
}

/// Rays towards lights wait behind glass and alpha and in fog, as all others do: hardly a page is
/// loaded by the stage that needs it.
TEST(BatchedTracer, LightWaitsBehindGlassAndInFog) {
  for (const bool fog : {false, true}) {
    const Traced whole = trace(clear(), 0, 1, fog);
    for (const std::uint64_t pages : {1, 3, 10'000}) {
      const Traced some = trace(clear(), pages, 3, fog);
      expectSame(some, whole);
      if (pages == 3) {
        EXPECT_GT(some.loads, 100u);
        EXPECT_LT(some.onDemand, some.loads / 20);
      }
    }
    expectSame(trace(clear(), 1, 1, fog), whole);
  }
}

/// Cached light that is the same everywhere.
class EvenLight final : public CachedLight {
 public:
  float leafSize() const override { return 0.01f; }
  float detail() const override { return 0.01f; }
  bool irradiance(const vec3&, const vec3&, float, vec2, vec3& out) const override {
    out = vec3(1.0f, 2.0f, 3.0f);
    return true;
  }
};

/// Paths in the place of cones that did not know go on the same, whatever pages are there.
TEST(BatchedTracer, PathsGoOnWhereConesDoNotKnow) {
  const EvenLight light;
  GuessOptions guess;
  guess.cache = &light;
  guess.coneShare = 1.0;
  const auto resumed = [&](std::uint64_t pages, const std::vector<PathState>* paths) {
    const Paged model = paged(plain(), pages);
    const LightSet lights(model.scene, *model.rays);
    const CameraRays camera(model.scene.cameras.front(), dvec3(0.0), kSide, kSide);
    const PathTracer tracer(model.scene, *model.rays, lights, camera, guess, 5);
    std::pair<std::vector<PathState>, Traced> out;
    if (paths == nullptr) {
      const std::vector<PathJob> all = jobs();
      Traced begun{std::vector<PathSample>(all.size()), std::vector<RayCounts>(all.size())};
      Cones cones;
      tracer.trace(all, kSide, 0, begun.samples, begun.counts, cones);
      for (const ConeRequest& r : cones.requests)
        EXPECT_TRUE(r.shadow || r.path < cones.paths.size());
      out.first = cones.paths;
      paths = &out.first;
    }
    out.second = {std::vector<PathSample>(paths->size()), std::vector<RayCounts>(paths->size())};
    if (pages == 10'000) {
      tracer.resume(*paths, out.second.samples, out.second.counts);
    } else {
      LoadChoice choice(model.mesh().table());
      BatchedTracer batched(tracer, *model.rays, choice);
      batched.resume(*paths, out.second.samples, out.second.counts);
    }
    return out;
  };
  const auto [paths, whole] = resumed(10'000, nullptr);
  ASSERT_GT(paths.size(), 100u);
  double sum = 0.0;
  for (const PathSample& s : whole.samples) sum += static_cast<double>(s.common.x + s.guess.x);
  EXPECT_GT(sum, 1.0);
  for (const std::uint64_t pages : {1, 3}) {
    const Traced some = resumed(pages, &paths).second;
    expectSame(some, whole);
    for (std::size_t i = 0; i < paths.size(); ++i)
      ASSERT_EQ(some.samples[i].guess, whole.samples[i].guess) << i;
  }
}

/// A page that can't be read ends all threads with its error.
TEST(BatchedTracer, APageThatCannotBeReadIsAnError) {
  const Paged model = paged(plain(), 3, false, true);
  const LightSet lights(model.scene, *model.rays);
  const CameraRays camera(model.scene.cameras.front(), dvec3(0.0), kSide, kSide);
  const PathTracer tracer(model.scene, *model.rays, lights, camera, GuessOptions{}, 5);
  LoadChoice choice(model.mesh().table());
  BatchedTracer batched(tracer, *model.rays, choice);
  const std::vector<PathJob> all = jobs();
  std::vector<PathSample> samples(all.size());
  std::vector<RayCounts> counts(all.size());
  Cones cones;
  try {
    batched.trace(all, kSide, samples, counts, cones);
    FAIL() << "no error";
  } catch (const Error& e) {
    EXPECT_EQ(e.code(), ExitCode::kInput);
    EXPECT_NE(std::string(e.what()).find("can't be read"), std::string::npos) << e.what();
  }
}

/// A disk that takes its time is read ahead of the threads that trace: by others, in part before a
/// ray waits, and without prediction by nobody. What was read serves, but for a few pages.
TEST(BatchedTracer, ASlowDiskIsReadAhead) {
  for (const bool predict : {false, true}) {
    const Paged model = paged(plain(), 5, false, false, nullptr, 0.001);
    const LightSet lights(model.scene, *model.rays);
    const CameraRays camera(model.scene.cameras.front(), dvec3(0.0), kSide, kSide);
    const PathTracer tracer(model.scene, *model.rays, lights, camera, GuessOptions{}, 5);
    LoadChoice choice(model.mesh().table(), predict ? LoadOrder::kPlan : LoadOrder::kWaiting);
    BatchedTracer batched(tracer, *model.rays, choice);
    const std::vector<PathJob> all = jobs();
    std::vector<PathSample> samples(all.size());
    std::vector<RayCounts> counts(all.size());
    Cones cones;
    tbb::task_arena(2).execute([&] { batched.trace(all, kSide, samples, counts, cones); });
    const PageTrafficReport r = batched.report();
    EXPECT_LE(r.waiting + r.unpacking, r.tracing * 1.001);
    EXPECT_GE(r.reading, 0.001 * static_cast<double>(r.loads));
    if (predict) {
      EXPECT_GT(choice.readSeconds(), 1e-4);
      EXPECT_LE(r.readInVain, r.loads);
    } else {
      EXPECT_EQ(r.readAhead + r.readInVain, 0u);
      EXPECT_GE(r.waiting, 0.9 * r.reading);  // by the threads that trace
    }
  }
}

/// Where each question takes long, of the other end of a link, several pages are asked for at once,
/// and no more than that.
TEST(BatchedTracer, SeveralPagesAQuestion) {
  const Paged all = paged(plain(), 10'000);
  const Paged some = paged(plain(), 5, false, false, nullptr, 0.001, 4);
  const auto& pages = dynamic_cast<const hccm::test::TestPages&>(some.cache().file());
  std::vector<PathSample> samples[2];
  for (const Paged* model : {&all, &some}) {
    const LightSet lights(model->scene, *model->rays);
    const CameraRays camera(model->scene.cameras.front(), dvec3(0.0), kSide, kSide);
    const PathTracer tracer(model->scene, *model->rays, lights, camera, GuessOptions{}, 5);
    LoadChoice choice(model->mesh().table());
    BatchedTracer batched(tracer, *model->rays, choice);
    const std::vector<PathJob> asked = jobs();
    auto& out = samples[model == &some];
    out.resize(asked.size());
    std::vector<RayCounts> counts(asked.size());
    Cones cones;
    tbb::task_arena(2).execute([&] { batched.trace(asked, kSide, out, counts, cones); });
  }
  EXPECT_GT(pages.most, 1u);
  EXPECT_LE(pages.most, 4u);
  for (std::size_t i = 0; i < samples[0].size(); ++i) {
    ASSERT_EQ(samples[0][i].common + samples[0][i].guess,
              samples[1][i].common + samples[1][i].guess);
  }
}

/// Both what was planned and what was done are told.
TEST(BatchedTracer, RecordsWhatHappened) {
  const Paged model = paged(plain(), 3);
  const LightSet lights(model.scene, *model.rays);
  const CameraRays camera(model.scene.cameras.front(), dvec3(0.0), kSide, kSide);
  const PathTracer tracer(model.scene, *model.rays, lights, camera, GuessOptions{}, 5);
  LoadChoice choice(model.mesh().table());
  TrafficRecord record(2, PageRounds::kReaders);
  BatchedTracer batched(tracer, *model.rays, choice, &record);
  const std::vector<PathJob> all = jobs();
  std::vector<PathSample> samples(all.size());
  std::vector<RayCounts> counts(all.size());
  Cones cones;
  tbb::task_arena(2).execute([&] { batched.trace(all, kSide, samples, counts, cones); });
  const std::string json = record.chromeTrace();
  for (const char* part : {"new paths", "page 0", "thread 0", "planned reads"})
    EXPECT_NE(json.find(part), std::string::npos) << part;
  EXPECT_NE(record.svg("title").find("<svg"), std::string::npos);
  EXPECT_GE(batched.report().loads, model.mesh().table().pages.size() / 2);
}

}  // namespace
}  // namespace trex
