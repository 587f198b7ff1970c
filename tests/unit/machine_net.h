// Several machines in one process: each is a thread with a session of its own, and a wire of ours
// carries what they say, in any order and some of it twice.
#pragma once

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

namespace trex::machines::test_net {

namespace test = trex::test;

inline constexpr std::uint32_t kWidth = 80, kHeight = 72;  // four tiles, two of them cut
inline constexpr std::uint64_t kDigest = 77;

/// Messages of each to each keep their order; those of different machines overtake each other.
class Net {
 public:
  Net(std::uint32_t machines, unsigned seed) : boxes_(machines), mute_(machines), random_(seed) {}
  std::uint32_t size() const { return static_cast<std::uint32_t>(boxes_.size()); }
  void send(std::uint32_t from, std::uint32_t to, const Bytes& message) {
    const std::lock_guard lock(mutex_);
    if (mute_[to]) ++unheard_;
    if (mute_[from] || mute_[to]) return;
    ByteView body;
    const Kind kind = openMessage(message, body);
    const bool may = kind == Kind::kResult || kind == Kind::kShot || kind == Kind::kPhotons ||
                     kind == Kind::kFetch || kind == Kind::kPart;
    const bool twice = may && random_() % 3 == 0;
    for (int i = 0; i < 1 + twice; ++i) boxes_[to][from].push_back(message);
    if (from == muteAfter_ && kind == muteKind_) mute_[from] = true;
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
  /// From its first message of a kind on this machine is neither heard nor hears.
  void muteAfter(std::uint32_t machine, Kind kind) {
    const std::lock_guard lock(mutex_);
    muteAfter_ = machine;
    muteKind_ = kind;
  }
  void hearAgain() {
    const std::lock_guard lock(mutex_);
    std::fill(mute_.begin(), mute_.end(), false);
    muteAfter_ = ~0u;
  }
  /// Messages to machines that did not hear.
  std::uint64_t unheard() const { return unheard_; }
  std::atomic<int> aborted{-1};

 private:
  std::mutex mutex_;
  std::vector<std::map<std::uint32_t, std::deque<Bytes>>> boxes_;
  std::vector<bool> mute_;
  std::uint32_t muteAfter_ = ~0u;
  Kind muteKind_ = Kind::kResult;
  std::mt19937 random_;
  std::atomic<std::uint64_t> unheard_{0};
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

inline Link::MakeWire wireOf(Net& net, std::uint32_t rank) {
  return [&net, rank] { return std::make_unique<NetWire>(net, rank); };
}

inline const Hello& hello() {
  static const Hello made = helloOfThis(1);
  return made;
}

/// test::mirrorRoom(), with a glass sphere and a point light if that is asked for.
inline Scene room(bool glass) {
  Scene scene = test::mirrorRoom();
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
  return scene;
}

inline std::shared_ptr<const Model> roomModel(bool glass = false) {
  const auto make = [](bool with) {
    return std::make_shared<const Model>(makeModel(room(with), {.voxels = true, .voxelDepth = 5}));
  };
  static const auto plain = make(false), clear = make(true);
  return glass ? clear : plain;
}

inline RenderSettings settings(double exact, std::uint32_t samples) {
  RenderSettings s;
  s.width = kWidth;
  s.height = kHeight;
  s.samples = samples;
  s.exact = exact;
  s.device = RenderSettings::kNoDevice;
  s.denoise = exact <= 0.0 ? Denoise::kFilter : Denoise::kOff;
  return s;
}

inline const PictureLayers kAll = layersFromNames({"all"});

inline std::unique_ptr<Session> sessionOf(const std::shared_ptr<const Model>& model,
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

inline const std::function<bool()> kGoOn = [] { return true; };

/// A picture that is stopped after every `steps` questions has the bits of one machine's.
inline void expectSameAfterStops(Net& net, const std::shared_ptr<const Model>& model,
                                 const RenderSettings& s, int steps) {
  setLogLevel(LogLevel::kQuiet);
  const auto whole = sessionOf(model, s);
  whole->run();
  Group group(net, model, s);
  group.leader().waitForModels(kGoOn);
  group.leader().beginView(0);
  const auto shared = sessionOf(model, s);
  shared->shareSamples(&group.leader());
  while (!shared->goalReached()) {
    int left = steps;
    shared->run([&] { return left-- > 0; });
  }
  EXPECT_EQ(shared->picture().values, whole->picture().values);
}

}  // namespace trex::machines::test_net
