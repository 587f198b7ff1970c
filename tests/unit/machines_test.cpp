// One picture by several machines, in one process.
#include <gtest/gtest.h>

#include <map>

#include "tests/unit/machine_net.h"

namespace trex::machines {
namespace {

using namespace test_net;

TEST(Machines, MakeTheSamePictureInAnyOrder) {
  setLogLevel(LogLevel::kQuiet);
  std::map<int, std::unique_ptr<Session>> alone;
  std::uint64_t byOthers = 0;
  for (unsigned seed = 0; seed < 20; ++seed) {
    const int kind = static_cast<int>(seed) % 5;
    const double shares[] = {0.0, 0.5, 1.0, kFirstShare, 0.5};
    RenderSettings s = settings(shares[kind], 6);
    s.dial = kind == 3;
    if (kind == 4) s.guess = GuessKind::kCone;
    const auto model = roomModel(kind == 2);
    auto& whole = alone[kind];
    if (!whole) {
      whole = sessionOf(model, s);
      whole->run();
    }
    Net net(2 + seed % 3, seed);
    Group group(net, model, s);
    if (seed % 2) group.leader().waitForModels(kGoOn);  // else they come when it is under way
    group.leader().beginView(0);
    const auto shared = sessionOf(model, s);
    shared->shareSamples(&group.leader());
    shared->run();
    EXPECT_EQ(shared->samplesDone(), 6u);
    EXPECT_EQ(shared->picture().values, whole->picture().values) << "seed " << seed;
    EXPECT_EQ(shared->report().rays.cRays, whole->report().rays.cRays) << "seed " << seed;
    EXPECT_EQ(shared->report().rays.cacheReads, whole->report().rays.cacheReads);
    for (const MachineRow& row : group.leader().rows()) byOthers += row.work.units;
    byOthers -= group.leader().rows()[0].work.units;
  }
  EXPECT_GT(byOthers, 0u);
}

/// All gather the share by cones that machine 0 has chosen, or went on with.
TEST(Machines, TakeTheShareOfConesOfMachineZero) {
  setLogLevel(LogLevel::kQuiet);
  RenderSettings s = settings(0.5, 6);
  s.guess = GuessKind::kAuto;
  const auto whole = sessionOf(roomModel(), s);
  whole->setConeShare(0.3);
  whole->run();
  EXPECT_GT(whole->report().rays.cones, 0u);
  Net net(3, 8);
  Group group(net, roomModel(), s);
  group.leader().waitForModels(kGoOn);
  group.leader().beginView(0);
  const auto shared = sessionOf(roomModel(), s);
  shared->setConeShare(0.3);
  shared->shareSamples(&group.leader());
  shared->run();
  EXPECT_EQ(shared->picture().values, whole->picture().values);
  EXPECT_EQ(shared->report().rays.cones, whole->report().rays.cones);
  EXPECT_EQ(shared->report().rays.cacheReads, whole->report().rays.cacheReads);
}

TEST(Machines, StoppingAndGoingOnChangesNoBit) {
  Net net(3, 5);
  expectSameAfterStops(net, roomModel(), settings(0.5, 8), 3);
}

TEST(Machines, ASecondViewHasItsOwnPicture) {
  setLogLevel(LogLevel::kQuiet);
  const RenderSettings s = settings(0.5, 4);
  const auto whole = sessionOf(roomModel(), s);
  whole->run();
  Net net(3, 6);
  Group group(net, roomModel(), s);
  for (int i = 0; i < 3; ++i) {  // the workers have one view: the same again
    group.leader().beginView(0);
    const auto shared = sessionOf(roomModel(), s);
    shared->shareSamples(&group.leader());
    shared->run();
    EXPECT_EQ(shared->picture().values, whole->picture().values);
  }
}

TEST(Machines, OneThatDoesNotAnswerLosesItsJobs) {
  setLogLevel(LogLevel::kQuiet);
  const RenderSettings s = settings(1.0, 200);
  const auto whole = sessionOf(roomModel(), s);
  whole->run();
  Net net(3, 7);
  Group group(net, roomModel(), s);
  group.leader().waitForModels(kGoOn);
  net.muteAfter(1, Kind::kResult);
  group.leader().beginView(0);
  const auto shared = sessionOf(roomModel(), s);
  shared->shareSamples(&group.leader());
  shared->run();
  EXPECT_EQ(shared->picture().values, whole->picture().values);
  EXPECT_GT(group.leader().jobsAgain(), 0u);
  net.hearAgain();  // it can be told to stop
}

TEST(Machines, OneThatNeverAnswersIsEndedWithTheRest) {
  setLogLevel(LogLevel::kQuiet);
  Net net(2, 8);
  Leader leader(wireOf(net, 0), hello());
  leader.welcome(true, false, {});
  leader.stop();
  leader.finish(3);
  EXPECT_EQ(net.aborted, 3);
}

TEST(Machines, AnotherModelIsRefused) {
  setLogLevel(LogLevel::kQuiet);
  const RenderSettings s = settings(1.0, 4);
  Net net(2, 9);
  Group group(net, roomModel(), s, kDigest + 1);
  try {
    group.leader().waitForModels(kGoOn);
    FAIL();
  } catch (const Error& e) {
    EXPECT_EQ(e.code(), ExitCode::kInput);
    EXPECT_NE(std::string(e.what()).find("machine 1"), std::string::npos) << e.what();
  }
}

/// A machine of a test that says what it likes.
class Stranger {
 public:
  Stranger(Net& net, std::uint32_t rank) : link_(wireOf(net, rank)) {
    link_.listen({.message = [](std::uint32_t, Kind, ByteView) {}, .tick = {}, .broken = {}});
  }
  ~Stranger() {
    say(Bye{});
    link_.finish();
  }
  template <class M>
  void say(const M& message) {
    link_.send(0, message);
  }
  void sayBytes(Bytes bytes) { link_.send(0, std::move(bytes)); }

 private:
  Link link_;
};

std::string problemOf(const std::function<void(Stranger&)>& say) {
  setLogLevel(LogLevel::kQuiet);
  Net net(2, 10);
  std::string text;
  {
    Leader leader(wireOf(net, 0), hello());
    leader.welcome(true, false, {});
    leader.expect(kDigest);
    Stranger stranger(net, 1);
    say(stranger);
    try {
      leader.waitForModels(kGoOn);
    } catch (const Error& e) {
      text = e.what();
    }
  }
  return text;
}

TEST(Machines, WhatIsNoMessageEndsTheWork) {
  EXPECT_NE(problemOf([](Stranger& s) {
              Hello other = hello();
              ++other.build;
              s.say(other);
            }).find("another build"),
            std::string::npos);
  EXPECT_NE(problemOf([](Stranger& s) {
              Hello other = hello();
              other.version = "9.9";
              s.say(other);
            }).find("runs trex 9.9"),
            std::string::npos);
  EXPECT_NE(problemOf([](Stranger& s) { s.sayBytes(encode(Stop{})); }).find("can't be read"),
            std::string::npos);
  EXPECT_NE(problemOf([](Stranger& s) {
              s.say(Fetch{1, {{.offset = 0, .file = 3, .bytes = 5}}});
            }).find("a file that there is not"),
            std::string::npos);
  EXPECT_NE(problemOf([](Stranger& s) {
              s.say(Failed{4, "no memory"});
            }).find("machine 1: no memory"),
            std::string::npos);
}

TEST(Machines, OneThatFailsEndsTheRenderWithItsCode) {
  setLogLevel(LogLevel::kQuiet);
  Net net(2, 11);
  Leader leader(wireOf(net, 0), hello());
  leader.welcome(true, false, {});
  leader.expect(kDigest);
  leader.beginView(0);
  Stranger stranger(net, 1);
  stranger.say(Failed{4, "a device was lost"});
  const auto shared = sessionOf(roomModel(), settings(1.0, 1u << 20));
  shared->shareSamples(&leader);
  try {
    shared->run();
    FAIL();
  } catch (const Error& e) {
    EXPECT_EQ(e.code(), ExitCode::kMemoryOrDevice);
  }
}

TEST(Machines, FilesAreReadFromMachine0) {
  setLogLevel(LogLevel::kQuiet);
  class Numbers : public hccm::PageFile {
   public:
    void read(std::uint64_t offset, std::span<std::byte> out) const override {
      for (std::byte& b : out) b = static_cast<std::byte>(offset++ * 7);
    }
    void readAhead(std::uint64_t, std::uint64_t) const override {}
    std::string place(std::uint64_t) const override { return "numbers"; }
  };
  constexpr std::uint64_t kSize = 9u << 20;
  Net net(2, 12);
  Leader leader(wireOf(net, 0), hello());
  Worker worker(wireOf(net, 1), hello());
  leader.welcome(false, true, {{std::make_shared<Numbers>(), kSize}});
  const auto welcome = worker.awaitWelcome();
  ASSERT_TRUE(welcome);
  ASSERT_EQ(welcome->fileBytes, std::vector<std::uint64_t>{kSize});
  const auto file = worker.file(0, "a.trex");
  std::vector<std::jthread> readers;
  for (std::uint64_t at : {std::uint64_t{0}, std::uint64_t{5}, kSize - (5u << 20)}) {
    readers.emplace_back([&, at] {
      std::vector<std::byte> out(5u << 20);
      file->read(at, out);
      for (std::size_t i = 0; i < out.size(); i += 997) {
        ASSERT_EQ(out[i], static_cast<std::byte>((at + i) * 7));
      }
    });
  }
  readers.clear();
  leader.stop();
  std::byte one[1];
  EXPECT_THROW(file->read(0, one), Error);
}

}  // namespace
}  // namespace trex::machines
