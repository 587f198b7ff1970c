// Links between machines are measured when these have greeted.
#include "src/machines/link_probe.h"

#include <gtest/gtest.h>

#include "tests/unit/machine_net.h"

namespace trex::machines {
namespace {

using namespace test_net;

/// What is measured of a link by the times that it takes, of which one in five is `late`; `sent`
/// gets the bytes that this took.
LinkSpeed measure(double bandwidth, double roundTrip, double late, double* sent = nullptr) {
  LinkProbe probe;
  double now = 100.0;
  int questions = 0;
  while (const auto bytes = probe.ask(now)) {
    now += roundTrip + *bytes / bandwidth + (questions++ % 5 == 1 ? late : 0.0);
    if (sent != nullptr) *sent += *bytes;
    probe.answered(now);
    if (questions > 100) break;
  }
  return probe.speed();
}

TEST(LinkProbe, FindsWhatALinkIs) {
  for (const double bandwidth : {1e5, 1.25e7, 1.25e8, 1.25e9}) {
    for (const double roundTrip : {1e-5, 1e-3, 0.1}) {
      double sent = 0.0;
      const LinkSpeed found = measure(bandwidth, roundTrip, 0.2, &sent);
      EXPECT_TRUE(found.known() && isPossible(found));
      EXPECT_NEAR(found.roundTrip, roundTrip, 1e-3 * roundTrip);
      if (roundTrip < 10.0 * LinkProbe::kMostBytes / bandwidth) {
        EXPECT_NEAR(found.bandwidth, bandwidth, 0.1 * bandwidth) << bandwidth << " " << roundTrip;
      }
      EXPECT_LE(sent, 10.0 * LinkProbe::kMostBytes);
      // Not a second for a link that is slow, but for one that hardly is one.
      EXPECT_LE(sent / bandwidth, std::max(0.7, 6.0 * LinkProbe::kFirstBytes / bandwidth));
    }
  }
}

TEST(LinkProbe, AClockThatStandsStillDoesNoHarm) {
  LinkProbe probe;
  while (probe.ask(5.0)) probe.answered(5.0);
  EXPECT_TRUE(isPossible(probe.speed()));
}

TEST(LinkProbe, PagesAreAskedForTogetherWhereTheWayIsLong) {
  EXPECT_EQ(pagesAtOnce({}), 8u);
  EXPECT_EQ(pagesAtOnce({1e-5, 1.25e7}), 8u);
  EXPECT_EQ(pagesAtOnce({1e-3, 1.25e8}), 23u);
  EXPECT_EQ(pagesAtOnce({1.0, 1e9}), 32u);
  EXPECT_FALSE(isPossible({-1.0, 1e9}));
  EXPECT_FALSE(isPossible({0.0, std::nan("")}));
  EXPECT_FALSE(isPossible({HUGE_VAL, 1e9}));
  EXPECT_FALSE(isPossible({}));
}

/// All links, though one machine never answers.
TEST(Machines, LinksAreMeasured) {
  setLogLevel(LogLevel::kQuiet);
  const auto model = roomModel();
  Net net(4, 3);
  net.muteAfter(2, Kind::kHello);
  Group group(net, model, settings(1.0, 4));
  double waited = 0.0;
  const auto known = [&](std::size_t machine) {
    const auto rows = group.leader().rows();
    return rows[machine].link.known();
  };
  while (!(known(1) && known(3)) && waited < 60.0) {
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
    waited += 0.01;
  }
  EXPECT_TRUE(known(1) && known(3));
  EXPECT_FALSE(known(0));
  EXPECT_FALSE(known(2));
  net.hearAgain();
}

/// An answer to what nobody asked is no measurement.
TEST(Machines, AnswersThatNobodyAskedForAreNotMeasured) {
  setLogLevel(LogLevel::kQuiet);
  Net net(2, 4);
  Leader leader(wireOf(net, 0), hello());
  Link other(wireOf(net, 1));
  other.listen({.message = [](std::uint32_t, Kind, ByteView) {}, .tick = {}, .broken = {}});
  other.send(0, hello());
  for (int i = 0; i < 100; ++i) other.send(0, Probed{static_cast<std::uint32_t>(1000 + i)});
  leader.waitForGreetings(kGoOn);
  other.send(0, Bye{});
  leader.stop();
  EXPECT_FALSE(leader.rows()[1].link.known());
  other.finish();
}

}  // namespace
}  // namespace trex::machines
