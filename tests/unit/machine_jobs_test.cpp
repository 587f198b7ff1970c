// Who takes which samples, asked with invented machines; and what they say to each other, as bytes.
#include <gtest/gtest.h>

#include <algorithm>
#include <numeric>
#include <random>

#include "src/machines/jobs.h"
#include "src/machines/messages.h"
#include "src/machines/sample_bytes.h"
#include "src/machines/units.h"

namespace trex::machines {
namespace {

JobLedger ledgerOf(std::uint32_t machines) {
  JobLedger ledger(machines);
  for (std::uint32_t m = 0; m < machines; ++m) ledger.join(m);
  return ledger;
}

TEST(Jobs, SizesFollowTimeWhatIsLeftAndWholeSamples) {
  const JobSizes sizes{.most = 64};
  EXPECT_EQ(unitsOfJob(sizes, 0.0, 1000, 4), 1u);  // nothing is known of it
  EXPECT_EQ(unitsOfJob(sizes, 20.0, 1000, 4), 20u);
  EXPECT_EQ(unitsOfJob(sizes, 1e9, 1000000, 4), 64u);
  EXPECT_EQ(unitsOfJob(sizes, 20.0, 80, 4), 10u);  // half of an equal share
  EXPECT_EQ(unitsOfJob(sizes, 20.0, 1, 4), 1u);
  JobSizes whole = sizes;
  whole.together = 12;
  EXPECT_EQ(unitsOfJob(whole, 0.0, 1000, 4), 12u);
  EXPECT_EQ(unitsOfJob(whole, 20.0, 1000, 4), 24u);
  EXPECT_EQ(unitsOfJob(whole, 1e9, 1000000, 4), 60u);  // no more than 64
  whole.together = 100;
  EXPECT_EQ(unitsOfJob(whole, 1e9, 1000000, 4), 64u);
}

TEST(Jobs, LargeOnesAreAlikeAndFew) {
  EXPECT_EQ(unitsOfLargeJob(100, 120, 2, 0.5), 60u);
  EXPECT_EQ(unitsOfLargeJob(50, 120, 2, 0.5), 30u);  // two rounds
  EXPECT_EQ(unitsOfLargeJob(100, 120, 2, 0.75), 90u);
  EXPECT_EQ(unitsOfLargeJob(70, 120, 2, 0.75), 70u);  // no larger than that
  EXPECT_EQ(unitsOfLargeJob(100, 1, 4, 0.25), 1u);
  JobLedger ledger = ledgerOf(3);
  ledger.start(0, 300, {.large = 200, .atOnce = 1});
  for (std::uint32_t m = 0; m < 3; ++m) EXPECT_EQ(ledger.deal(m, 0.0)->units(), 100u);
  EXPECT_FALSE(ledger.deal(0, 0.0));
  for (std::uint32_t id = 1; id <= 3; ++id) ledger.bring(id - 1, id, id == 3 ? 1.0 : 2.0);
  ledger.start(0, 400, {.large = 1000, .atOnce = 1});  // the third is twice as fast
  EXPECT_EQ(ledger.deal(0, 0.0)->units(), 100u);
  EXPECT_EQ(ledger.deal(2, 0.0)->units(), 200u);
}

TEST(Jobs, ALargeOneThatIsLostIsPartedAmongWhoIsLeft) {
  JobLedger ledger = ledgerOf(4);
  ledger.start(0, 400, {.large = 200, .atOnce = 1});
  std::vector<Job> first;
  for (std::uint32_t m = 0; m < 4; ++m) first.push_back(*ledger.deal(m, 0.0));
  ledger.lose(2);
  std::uint64_t next = first[2].first;
  for (const std::uint32_t m : {3u, 1u, 0u}) {
    ASSERT_TRUE(ledger.bring(m, first[m].id, 1.0));
    const auto part = ledger.deal(m, 1.0);
    ASSERT_TRUE(part);
    EXPECT_EQ(part->first, next);
    EXPECT_NEAR(static_cast<double>(part->units()), 100.0 / 3.0, 1.0);
    next = part->end;
    EXPECT_TRUE(ledger.bring(m, part->id, 1.0));
  }
  EXPECT_EQ(next, first[2].end);
  EXPECT_FALSE(ledger.bring(2, first[2].id, 9.0));  // too late: others have traced its parts
  EXPECT_TRUE(ledger.done());
}

TEST(Jobs, WholeSamplesEndWhereSamplesEnd) {
  JobLedger ledger = ledgerOf(2);
  ledger.start(5, 100, {.most = 64, .together = 12});
  EXPECT_EQ(ledger.deal(0, 0.0)->end, 12u);
  EXPECT_EQ(ledger.deal(1, 0.0)->end, 24u);
}

TEST(Jobs, AMachineHasNoMoreThanItsShareAtOnce) {
  JobLedger ledger = ledgerOf(2);
  ledger.start(0, 100, {.atOnce = 2});
  EXPECT_TRUE(ledger.deal(1, 0.0) && ledger.deal(1, 0.0));
  EXPECT_FALSE(ledger.deal(1, 0.0));
  EXPECT_EQ(ledger.held(1), 2u);
  EXPECT_TRUE(ledger.deal(0, 0.0));
}

TEST(Jobs, ResultsThatComeTwiceCountOnce) {
  JobLedger ledger = ledgerOf(2);
  ledger.start(0, 2, {});
  const Job job = *ledger.deal(1, 0.0);
  EXPECT_EQ(ledger.bring(1, job.id, 0.1), job);
  EXPECT_FALSE(ledger.bring(1, job.id, 0.1));
  EXPECT_FALSE(ledger.bring(1, 12345, 0.1));  // never was
  EXPECT_EQ(ledger.work(1).jobs, 1u);
  EXPECT_EQ(ledger.work(1).twice, 2u);
  EXPECT_EQ(ledger.held(1), 0u);
}

TEST(Jobs, WhatALostMachineHoldsIsGivenOutFirst) {
  JobLedger ledger = ledgerOf(3);
  ledger.start(0, 100, {});
  const Job first = *ledger.deal(1, 0.0), second = *ledger.deal(1, 0.0);
  ledger.deal(2, 0.0);
  ledger.lose(1);
  EXPECT_FALSE(ledger.deal(1, 0.0));
  EXPECT_EQ(ledger.deal(0, 0.0), first);
  EXPECT_EQ(ledger.deal(0, 0.0), second);
  EXPECT_EQ(ledger.again(), 2u);
  // It was alive after all: its result counts if it is the first.
  ledger.join(1);
  EXPECT_EQ(ledger.bring(1, first.id, 0.1), first);
  EXPECT_FALSE(ledger.bring(0, first.id, 0.1));
  EXPECT_EQ(ledger.held(0), 1u);
}

TEST(Jobs, LateJobsAreGivenToWhoeverHasNothingElse) {
  JobLedger ledger = ledgerOf(2);
  ledger.start(0, 2, {});
  const Job slow = *ledger.deal(1, 0.0);
  const Job mine = *ledger.deal(0, 0.0);
  ledger.bring(0, mine.id, 0.1);
  EXPECT_FALSE(ledger.deal(0, 0.5));
  EXPECT_EQ(ledger.deal(0, 5.0), slow);
  EXPECT_FALSE(ledger.deal(0, 50.0));  // it has it
  EXPECT_EQ(ledger.bring(0, slow.id, 0.1), slow);
  EXPECT_TRUE(ledger.done());
}

TEST(Jobs, NoResultWaitsBeyondTheWindow) {
  JobLedger ledger = ledgerOf(2);
  ledger.start(10, 1000, {.window = 4, .atOnce = 100});
  std::vector<Job> jobs;
  while (const auto job = ledger.deal(1, 0.0)) jobs.push_back(*job);
  EXPECT_EQ(jobs.back().end, 14u);
  ledger.bring(1, jobs[1].id, 0.1);
  EXPECT_FALSE(ledger.deal(1, 0.1));  // what came is not what comes next
  ledger.bring(1, jobs[0].id, 0.1);
  ledger.merged(12);
  EXPECT_EQ(ledger.deal(1, 0.2)->first, 14u);
}

/// Machines of random speed that get lost, come back, and bring results twice.
TEST(Jobs, EveryUnitIsBroughtOnceWhateverHappens) {
  for (unsigned seed = 0; seed < 20; ++seed) {
    std::mt19937 random(seed);
    const std::uint32_t machines = 2 + seed % 4;
    JobLedger ledger = ledgerOf(machines);
    const std::uint64_t first = random() % 50, end = first + 1 + random() % 700;
    ledger.start(first, end,
                 {.most = 16,
                  .large = seed % 5 == 0 ? 40u : 1u,
                  .window = 64,
                  .together = seed % 3 == 0 ? 8u : 1u,
                  .atOnce = 2});
    std::vector<std::vector<Job>> held(machines);
    std::vector<int> brought(end, 0);
    std::uint64_t merged = first;
    double now = 0.0;
    for (int step = 0; !ledger.done() && step < 200000; ++step, now += 0.05) {
      const auto m = static_cast<std::uint32_t>(random() % machines);
      if (random() % 40 == 0 && m > 0) {
        ledger.takesPart(m) ? ledger.lose(m) : ledger.join(m);
        if (random() % 2) held[m].clear();
      }
      while (const auto job = ledger.deal(m, now)) held[m].push_back(*job);
      if (held[m].empty() || random() % (m + 1) != 0) continue;
      const std::size_t which = random() % held[m].size();
      const Job job = held[m][which];
      for (int times = 1 + (random() % 3 == 0); times > 0; --times) {
        if (!ledger.bring(m, job.id, 0.05)) continue;
        for (std::uint64_t u = job.first; u < job.end; ++u) ++brought[u];
      }
      held[m].erase(held[m].begin() + static_cast<std::ptrdiff_t>(which));
      while (merged < end && brought[merged]) ++merged;
      ledger.merged(merged);
    }
    ASSERT_TRUE(ledger.done()) << seed;
    for (std::uint64_t u = 0; u < end; ++u) EXPECT_EQ(brought[u], u >= first) << seed << ' ' << u;
  }
}

TEST(Jobs, UnitsGoThroughTheTilesOfASample) {
  const auto units = unitsOf({1, 5, 8}, 3);
  ASSERT_EQ(units.size(), 3u);
  EXPECT_EQ(units[0].tile, 2u);
  EXPECT_EQ(units[0].sample, 1u);
  EXPECT_EQ(units[1].tile, 0u);
  EXPECT_EQ(units[1].sample, 2u);
}

// ---- messages ----

Result someResult() {
  Result r;
  r.pass = 7;
  r.id = 9;
  r.seconds = 0.5;
  r.cRays = 1000;
  r.samples = Bytes(37, std::byte{5});
  return r;
}

TEST(Messages, ComeBackAsTheyWere) {
  Hello hello{"0.1.0", "a host", 1, 2, 3};
  Bytes message = encode(hello);
  ByteView body;
  EXPECT_EQ(openMessage(message, body), Kind::kHello);
  const auto back = decode<Hello>(body);
  EXPECT_EQ(back.version, hello.version);
  EXPECT_EQ(back.host, hello.host);
  EXPECT_EQ(back.threads, hello.threads);
  message = encode(someResult());
  EXPECT_EQ(openMessage(message, body), Kind::kResult);
  const auto result = decode<Result>(body);
  EXPECT_EQ(result.samples, someResult().samples);
  EXPECT_EQ(result.cRays, 1000u);
  Pass pass;
  pass.shares = {0.25, 1.0};
  message = encode(pass);
  EXPECT_EQ(openMessage(message, body), Kind::kPass);
  EXPECT_EQ(decode<Pass>(body).shares, pass.shares);
  message = encode(Stop{});
  EXPECT_EQ(openMessage(message, body), Kind::kStop);
  EXPECT_TRUE(body.empty());
}

TEST(Messages, EveryChangedByteAndLengthIsNoticed) {
  const Bytes good = encode(someResult());
  ByteView body;
  for (std::size_t i = 0; i < good.size(); ++i) {
    Bytes bad = good;
    bad[i] ^= std::byte{1} << (i % 8);
    // A kind that is known, of a body that is not its own, is noticed by its reader.
    const auto read = [&] {
      if (openMessage(bad, body) != Kind::kResult) throw MessageError("another kind");
    };
    EXPECT_THROW(read(), MessageError) << i;
  }
  for (std::size_t length = 0; length < good.size(); ++length) {
    EXPECT_THROW(openMessage(ByteView(good).first(length), body), MessageError) << length;
  }
  Bytes longer = good;
  longer.push_back({});
  EXPECT_THROW(openMessage(longer, body), MessageError);
}

TEST(Messages, LengthsAreCheckedBeforeMemoryIsTaken) {
  Bytes body(4, std::byte{0xff});  // a text of 4 GiB
  EXPECT_THROW(decode<Failed>(ByteView(body)), MessageError);
  body = Bytes(200, std::byte{0xff});
  EXPECT_THROW(decode<Hello>(ByteView(body)), MessageError);
  EXPECT_THROW(decode<Result>(ByteView(body)), MessageError);
  EXPECT_THROW(decode<Pass>(ByteView(body)), MessageError);
  EXPECT_THROW(decode<Stop>(ByteView(body)), MessageError);  // longer than what it holds
}

// ---- samples ----

std::vector<TakenSample> someSamples(std::size_t count) {
  std::mt19937 random(3);
  std::uniform_real_distribution<float> unit(0.0f, 1.0f);
  const auto next = [&] { return vec3(unit(random), unit(random), unit(random)); };
  std::vector<TakenSample> samples(count);
  for (TakenSample& s : samples) {
    s = {.guess = next(),
         .exact = next(),
         .light = next(),
         .feature = {next(), next(), next(), unit(random), unit(random)},
         .first = {unit(random), unit(random), unit(random)},
         .alpha = unit(random),
         .direct = next(),
         .directExact = next(),
         .photonNoise = next(),
         .rays = static_cast<std::uint32_t>(random()),
         .cRays = static_cast<std::uint32_t>(random()),
         .gRays = static_cast<std::uint32_t>(random()),
         .paired = random() % 3 == 0};
  }
  return samples;
}

TEST(SampleBytes, KeepWhatTheFrameKeeps) {
  const auto samples = someSamples(29);
  for (std::uint32_t contents = 0; contents < 256; ++contents) {
    const Bytes bytes = packSamples(samples, contents, contents % 3 != 0);
    EXPECT_LE(bytes.size(), mostBytesOf(contents, samples.size()));
    const auto back = unpackSamples(bytes, contents, samples.size());
    for (std::size_t i = 0; i < samples.size(); ++i) {
      const TakenSample &a = samples[i], &b = back[i];
      EXPECT_EQ(a.guess, b.guess);
      EXPECT_EQ(b.paired, a.paired && (contents & kPairs));
      EXPECT_TRUE(!b.paired || a.exact == b.exact);
      if (contents & kFeatures) {
        EXPECT_EQ(a.light, b.light);
        EXPECT_EQ(a.feature.position, b.feature.position);
        EXPECT_EQ(a.feature.black, b.feature.black);
      }
      EXPECT_TRUE(!(contents & kCoverage) || a.alpha == b.alpha);
      EXPECT_TRUE(!(contents & kFirstHits) || a.first.material == b.first.material);
      EXPECT_TRUE(!(contents & kDirect) || a.direct == b.direct);
      EXPECT_TRUE(!(contents & kDirect) || !b.paired || a.directExact == b.directExact);
      EXPECT_TRUE(!(contents & kRays) || a.rays == b.rays);
      EXPECT_TRUE(!(contents & kRayClasses) || (a.cRays == b.cRays && a.gRays == b.gRays));
      EXPECT_TRUE(!(contents & kPhotonNoise) || a.photonNoise == b.photonNoise);
    }
    for (std::size_t length = 0; length < bytes.size(); ++length) {
      EXPECT_THROW(unpackSamples(ByteView(bytes).first(length), contents, samples.size()),
                   MessageError);
    }
    EXPECT_THROW(unpackSamples(bytes, contents, samples.size() + 1), MessageError);
    EXPECT_THROW(unpackSamples(bytes, contents, samples.size() - 1), MessageError);
  }
}

TEST(SampleBytes, SamplesThatAreNotThereCanNotBePaired) {
  const auto samples = someSamples(5);
  Bytes bytes = packSamples(samples, kPairs, false);
  bytes[1] |= std::byte{0x80};
  bytes.resize(bytes.size() + sizeof(vec3));
  EXPECT_THROW(unpackSamples(bytes, kPairs, samples.size()), MessageError);
}

/// Neighbours that show the same surface, as a link carries them.
TEST(SampleBytes, ThatAreMuchAlikeTravelInFewerBytes) {
  for (const bool pairs : {false, true}) {
    std::vector<TakenSample> samples = someSamples(500);
    for (TakenSample& s : samples) {
      s.feature = samples[0].feature;
      s.first = samples[0].first;
      s.direct = s.light;
      s.alpha = 1.0f;
    }
    const std::uint32_t contents =
        kFeatures | kCoverage | kFirstHits | kDirect | (pairs ? kPairs : 0u);
    const Bytes plain = packSamples(samples, contents, false),
                sent = packSamples(samples, contents, true);
    EXPECT_LT(sent.size(), 2 * plain.size() / 3) << pairs;
    EXPECT_EQ(packSamples(unpackSamples(sent, contents, samples.size()), contents, false), plain);
    // Damage is an error or other samples, never more than asked for.
    for (std::size_t i = 0; i < sent.size(); i += 7) {
      Bytes bad = sent;
      bad[i] ^= std::byte{0x10};
      try {
        EXPECT_EQ(unpackSamples(bad, contents, samples.size()).size(), samples.size());
      } catch (const MessageError&) {
      }
    }
  }
}

}  // namespace
}  // namespace trex::machines
