// One picture by several machines, in one process: each is a thread with a session of its own, and
// a wire of ours carries what they say, in any order and some of it twice.
#include <gtest/gtest.h>

#include <atomic>
#include <deque>
#include <map>
#include <random>
#include <thread>

#include "src/core/log.h"
#include "src/machines/identity.h"
#include "src/machines/leader.h"
#include "src/machines/worker.h"
#include "src/session/session.h"
#include "tests/unit/scenes.h"

namespace trex::machines {
namespace {

constexpr std::uint32_t kWidth = 80, kHeight = 72;  // four tiles, two of them cut
constexpr std::uint64_t kDigest = 77;

/// Messages of each to each keep their order; those of different machines overtake each other.
class Net {
 public:
  Net(std::uint32_t machines, unsigned seed) : boxes_(machines), mute_(machines), random_(seed) {}
  std::uint32_t size() const { return static_cast<std::uint32_t>(boxes_.size()); }
  void send(std::uint32_t from, std::uint32_t to, const Bytes& message) {
    const std::lock_guard lock(mutex_);
    if (mute_[from] || mute_[to]) return;
    ByteView body;
    const bool twice = openMessage(message, body) == Kind::kResult && random_() % 3 == 0;
    for (int i = 0; i < 1 + twice; ++i) boxes_[to][from].push_back(message);
    if (from == muteAfter_ && openMessage(message, body) == Kind::kResult) mute_[from] = true;
  }
  std::optional<Received> receive(std::uint32_t at) {
    const std::lock_guard lock(mutex_);
    auto& box = boxes_[at];
    std::erase_if(box, [](const auto& entry) { return entry.second.empty(); });
    if (box.empty() || random_() % 4 == 0) return {};
    auto from = box.begin();
    std::advance(from, random_() % box.size());
    Received got{from->first, std::move(from->second.front())};
    from->second.pop_front();
    return got;
  }
  /// From its first result on this machine is neither heard nor hears.
  void muteAfterResult(std::uint32_t machine) { muteAfter_ = machine; }
  void hearAgain() {
    const std::lock_guard lock(mutex_);
    std::fill(mute_.begin(), mute_.end(), false);
    muteAfter_ = ~0u;
  }
  std::atomic<int> aborted{-1};

 private:
  std::mutex mutex_;
  std::vector<std::map<std::uint32_t, std::deque<Bytes>>> boxes_;
  std::vector<bool> mute_;
  std::uint32_t muteAfter_ = ~0u;
  std::mt19937 random_;
};

class NetWire : public Wire {
 public:
  NetWire(Net& net, std::uint32_t rank) : net_(net), rank_(rank) {}
  std::uint32_t rank() const override { return rank_; }
  std::uint32_t size() const override { return net_.size(); }
  void send(std::uint32_t to, Bytes message) override { net_.send(rank_, to, message); }
  std::optional<Received> receive() override { return net_.receive(rank_); }
  std::size_t unsent() override { return 0; }
  void finish() override {}
  void abort(int code) override { net_.aborted = code; }

 private:
  Net& net_;
  std::uint32_t rank_;
};

Link::MakeWire wireOf(Net& net, std::uint32_t rank) {
  return [&net, rank] { return std::make_unique<NetWire>(net, rank); };
}

const Hello& hello() {
  static const Hello made = helloOfThis(1);
  return made;
}

/// A lit room with a mirror sphere and a grey one, and a glass one if that is asked for.
Scene room(bool glass) {
  Scene scene;
  scene.materials = {test::lambert(0.6f), test::lambert(0.0f, 8.0f), test::lambert(0.9f)};
  scene.materials[2].metallic = 1.0f;
  scene.materials[2].roughness = 0.0f;
  test::place(scene, test::box(vec3(-2.0f), vec3(2.0f), 0, true));
  test::place(scene, test::box(vec3(-0.5f, 1.8f, -0.5f), vec3(0.5f, 1.9f, 0.5f), 1, false));
  test::place(scene, test::sphere(vec3(-0.8f, 0.0f, -1.0f), 0.6f, 2, 12));
  test::place(scene, test::sphere(vec3(0.8f, 0.0f, -1.0f), 0.6f, 0, 12));
  if (glass) {
    scene.materials[0].transmission = 0.0f;
    Material clear = test::lambert(1.0f);
    clear.roughness = 0.0f;
    clear.specular = 1.0f;
    clear.transmission = 1.0f;
    scene.materials.push_back(clear);
    test::place(scene, test::sphere(vec3(0.0f, -0.6f, 0.0f), 0.4f, 3, 12));
    Light point;
    point.type = Light::Type::kPoint;
    point.position = dvec3(0.0, 1.0, 0.5);
    point.intensity = vec3(3.0f);
    scene.lights.push_back(point);
  }
  scene.cameras = {test::lookAt(dvec3(0.0, 0.0, 1.9), dvec3(0.0, 0.0, -1.0), 1.0f)};
  return scene;
}

std::shared_ptr<const Model> roomModel(bool glass = false) {
  const auto make = [](bool with) {
    return std::make_shared<const Model>(makeModel(room(with), {.voxels = true, .voxelDepth = 5}));
  };
  static const auto plain = make(false), clear = make(true);
  return glass ? clear : plain;
}

RenderSettings settings(double exact, std::uint32_t samples) {
  RenderSettings s;
  s.width = kWidth;
  s.height = kHeight;
  s.samples = samples;
  s.exact = exact;
  s.device = RenderSettings::kNoDevice;
  s.denoise = exact <= 0.0 ? Denoise::kFilter : Denoise::kOff;
  return s;
}

const PictureLayers kAll = layersFromNames({"all"});

std::unique_ptr<Session> sessionOf(const std::shared_ptr<const Model>& model,
                                   const RenderSettings& s) {
  return std::make_unique<Session>(model, model->scene.cameras.front(), s, kAll);
}

/// Machine 0 in this thread, the others in theirs.
class Group {
 public:
  Group(Net& net, std::shared_ptr<const Model> model, const RenderSettings& s,
        std::uint64_t digestOfOthers = kDigest)
      : leader_(wireOf(net, 0), hello()) {
    for (std::uint32_t rank = 1; rank < net.size(); ++rank) {
      threads_.emplace_back([&net, rank, model, s, digestOfOthers] {
        Worker worker(wireOf(net, rank), hello());
        try {
          if (worker.awaitWelcome()) {
            worker.run(model, {model->scene.cameras.front()}, s, digestOfOthers);
          }
        } catch (const Error& e) {
          worker.failed(e);
        }
        worker.finish();
      });
    }
    leader_.welcome(true, false, {});
    leader_.expect(kDigest);
  }
  ~Group() { leader_.stop(); }
  Leader& leader() { return leader_; }

 private:
  std::vector<std::jthread> threads_;
  Leader leader_;  // ends before them
};

const std::function<bool()> kGoOn = [] { return true; };

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

TEST(Machines, StoppingAndGoingOnChangesNoBit) {
  setLogLevel(LogLevel::kQuiet);
  const RenderSettings s = settings(0.5, 8);
  const auto whole = sessionOf(roomModel(), s);
  whole->run();
  Net net(3, 5);
  Group group(net, roomModel(), s);
  group.leader().waitForModels(kGoOn);
  group.leader().beginView(0);
  const auto shared = sessionOf(roomModel(), s);
  shared->shareSamples(&group.leader());
  while (!shared->goalReached()) {
    int left = 3;
    shared->run([&] { return left-- > 0; });
  }
  EXPECT_EQ(shared->picture().values, whole->picture().values);
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
  net.muteAfterResult(1);
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
              s.say(Fetch{.file = 3, .bytes = 5, .number = 1, .offset = 0});
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
