// A window and its servers, in one process: whoever takes the samples, the settled picture has the
// bits of the window alone.
#include <gtest/gtest.h>

#include "src/core/clock.h"
#include "src/machines/server.h"
#include "src/machines/servers.h"
#include "src/scene/look_file.h"
#include "src/session/model_editor.h"
#include "tests/unit/machine_net.h"

namespace trex::machines {
namespace {

using namespace test_net;

const ModelOptions kOptions{.voxels = true, .voxelsInTheDark = true, .voxelDepth = 5};

RenderSettings windowSettings(double exact, std::uint32_t samples) {
  RenderSettings s = settings(exact, samples);
  s.width = 136;  // six tiles, some of them cut
  s.height = 72;
  s.interactive = true;
  s.denoise = Denoise::kFilter;
  return s;
}

/// What the viewer does with a session, without its screen.
class Window {
 public:
  explicit Window(const RenderSettings& s, SampleHelper* helper = nullptr, bool glass = false)
      : settings_(s),
        helper_(helper),
        model_(std::make_shared<Model>(makeModel(room(glass), kOptions))),
        editor_(model_, kOptions) {
    PictureLayers layers = layersFromNames({"all"});
    layers.direct = layers.indirect = false;
    layers.rayClass = true;
    session_ = std::make_unique<Session>(editor_.shared(), editor_.look().camera, s, layers);
    session_->beforeLight([this] { editor_.updateVoxelValues(); });
    session_->helpBy(helper);
    const auto tree = std::exchange(model_->voxels, nullptr);
    editor_.setSourceVoxels(tree);
    if (s.exact < 1.0) takeVoxels(tree);
    tell(editor_.look());
  }

  void edit(const std::function<void(Look&)>& change) {
    Look look = editor_.look();
    change(look);
    tell(look);
    Invalidation what = editor_.apply(look);
    what.frame = true;
    if (what.voxelShape && editor_.voxelsOutdated()) {
      const auto job = editor_.voxelJob();
      const auto tree = job.build();
      editor_.takeVoxels(tree, job.shape);
      takeVoxels(tree);
    }
    session_->follow(what, look.camera);
  }
  void resize(std::uint32_t width, std::uint32_t height) {
    settings_.width = width;
    settings_.height = height;
    tell(editor_.look());
    session_->resize(width, height);
  }
  void step() {
    const double until = secondsNow() + 0.01;
    session_->step([&] { return secondsNow() < until; }, vec2(0.3f, 0.6f));
  }
  void settle() {
    while (!session_->resting()) step();
  }
  Session& session() { return *session_; }
  std::vector<float> picture() { return session_->picture().values; }

 private:
  void tell(const Look& look) {
    if (helper_ == nullptr) return;
    helper_->edited(lookText(look, model_->scene, editor_.source()), settings_.width,
                    settings_.height);
  }
  void takeVoxels(const std::shared_ptr<asvo::Tree>& tree) {
    session_->setVoxels(
        tree, makeLightDevice(model_->scene.materials, model_->scene.images, *tree, settings_));
  }

  RenderSettings settings_;
  SampleHelper* helper_;
  std::shared_ptr<Model> model_;
  ModelEditor editor_;
  std::unique_ptr<Session> session_;
};

/// Machine 0 in this thread, servers in theirs.
class ServedNet {
 public:
  ServedNet(std::uint32_t machines, unsigned seed, const RenderSettings& s, bool glass = false)
      : net(machines, seed), servers(wireOf(net, 0), hello()) {
    setLogLevel(LogLevel::kQuiet);
    for (std::uint32_t rank = 1; rank < machines; ++rank) {
      threads_.emplace_back([this, rank, s, glass] {
        Server server(wireOf(net, rank), hello());
        try {
          const auto welcome = server.awaitWelcome();
          if (welcome && server.awaitServe(*welcome)) {
            auto model = std::make_shared<Model>(makeModel(room(glass), kOptions));
            auto voxels = std::exchange(model->voxels, nullptr);
            if (s.exact >= 1.0) voxels.reset();
            server.run(std::move(model), std::move(voxels), kOptions, s, kDigest);
          }
        } catch (const Error& e) {
          server.failed(e);
        }
        server.finish();
      });
    }
    servers.welcome(true, {}, {s.width, s.height, ""}, kDigest);
  }
  ~ServedNet() {
    net.hearAgain();
    servers.finish(0);
  }
  void waitForAll() const {
    while (servers.readyMachines() < servers.machines()) {
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
  }
  std::uint64_t samplesOfOthers() const {
    std::uint64_t sum = 0;
    const auto rows = servers.rows();
    for (std::size_t i = 1; i < rows.size(); ++i) sum += rows[i].work.units;
    return sum;
  }

  Net net;

 private:
  std::vector<std::jthread> threads_;

 public:
  Servers servers;  // ends before the threads
};

using Change = std::function<void(Look&)>;
const std::vector<Change> kChanges = {
    [](Look& l) { l.camera.eye.x += 0.3; },
    [](Look& l) { l.materials[0].baseColor = vec4(0.2f, 0.5f, 0.8f, 1.0f); },
    [](Look& l) {
      Light lamp;
      lamp.type = Light::Type::kPoint;
      lamp.position = dvec3(0.5, 0.5, 0.5);
      lamp.intensity = vec3(2.0f, 1.0f, 0.5f);
      l.lights.push_back(lamp);
    },
    [](Look& l) {  // light passes it: other voxels
      l.materials[2].metallic = 0.0f;
      l.materials[2].transmission = 1.0f;
      l.materials[2].specular = 1.0f;
    },
    [](Look& l) {
      l.section = SectionPlane{dvec3(0.0, 0.0, 1.0), vec3(0.0f, 0.0f, 1.0f)};
    },
    [](Look& l) { l.camera.verticalFov *= 0.8f; },
};

void expectSameForEveryEdit(const RenderSettings& s, std::uint32_t machines, unsigned seed,
                            bool glass = false) {
  ServedNet served(machines, seed, s, glass);
  Window alone(s, nullptr, glass), together(s, &served.servers, glass);
  if (seed % 2 == 0) served.waitForAll();  // else they come when it is under way
  alone.settle();
  together.settle();
  EXPECT_EQ(together.picture(), alone.picture()) << "as opened";
  served.waitForAll();
  std::vector<float> before = alone.picture();
  for (std::size_t i = 0; i < kChanges.size(); ++i) {
    for (Window* window : {&alone, &together}) {
      window->edit(kChanges[i]);
      window->settle();
    }
    EXPECT_EQ(together.picture(), alone.picture()) << "edit " << i;
    EXPECT_NE(alone.picture(), before) << "edit " << i << " changes nothing";
    EXPECT_EQ(together.session().report().rays.cRays > 0, true);
    before = alone.picture();
  }
  EXPECT_GT(served.samplesOfOthers(), 0u);
}

TEST(WindowAndServers, MakeTheSamePictureAfterEveryEdit) {
  expectSameForEveryEdit(windowSettings(0.0, 6), 3, 1);
}

TEST(WindowAndServers, MakeTheSameExactPicture) {
  expectSameForEveryEdit(windowSettings(1.0, 3), 2, 2);
}

TEST(WindowAndServers, MakeTheSamePictureWithADial) {
  RenderSettings s = windowSettings(kFirstShare, 7);
  s.dial = true;
  expectSameForEveryEdit(s, 3, 3);
}

TEST(WindowAndServers, MakeTheSamePictureOfCausticsByCones) {
  RenderSettings s = windowSettings(0.25, 3);
  s.guess = GuessKind::kCone;
  expectSameForEveryEdit(s, 2, 4, true);
}

TEST(WindowAndServers, EditsThatOvertakeEachOtherEndAsTheLastOne) {
  const RenderSettings s = windowSettings(0.0, 6);
  ServedNet served(3, 5, s);
  Window alone(s), together(s, &served.servers);
  served.waitForAll();
  together.settle();
  const auto change = [](int i) -> Change {
    if (i % 2 == 0) return [](Look& l) { l.camera.eye.x += 0.02; };
    return [i](Look& l) { l.materials[0].baseColor.x = 0.02f * static_cast<float>(i); };
  };
  for (int i = 0; i < 40; ++i) {
    together.edit(change(i));
    for (int steps = 0; steps < i % 4; ++steps) together.step();
  }
  for (int i = 0; i < 40; ++i) alone.edit(change(i));
  alone.settle();
  together.settle();
  // The same look, whatever was shot on the way, where no photons are kept from before.
  const auto settleAnew = [](Window& window) {
    window.edit(kChanges[1]);
    window.edit([](Look& l) { l.materials[0].roughness = 0.9f; });
    window.settle();
    return window.picture();
  };
  EXPECT_EQ(settleAnew(together), settleAnew(alone));
}

TEST(WindowAndServers, AnotherSizeAndPhotonsThatFollowTheCamera) {
  const RenderSettings s = windowSettings(0.0, 6);
  ServedNet served(2, 6, s);
  Window alone(s), together(s, &served.servers);
  served.waitForAll();
  for (Window* window : {&alone, &together}) {
    window->settle();
    window->edit([](Look& l) {  // light from outside is aimed
      Light sun;
      sun.type = Light::Type::kDirectional;
      sun.direction = glm::normalize(vec3(0.1f, -1.0f, 0.2f));
      sun.intensity = vec3(3.0f);
      l.lights.push_back(sun);
      l.section = SectionPlane{dvec3(0.0, 1.0, 0.0), vec3(0.0f, 1.0f, 0.0f)};
    });
    window->settle();
    window->edit(kChanges[0]);
    window->settle();
    EXPECT_TRUE(window->session().aimAgain());
    window->step();
    window->settle();
    window->resize(130, 70);
    window->settle();
  }
  EXPECT_EQ(together.picture(), alone.picture());
  EXPECT_GT(served.samplesOfOthers(), 0u);
}

TEST(WindowAndServers, OneThatDoesNotAnswerIsNotWaitedFor) {
  const RenderSettings s = windowSettings(1.0, 20);
  ServedNet served(3, 7, s);
  Window alone(s), together(s, &served.servers);
  served.waitForAll();
  served.net.muteAfter(1, Kind::kResult);
  together.settle();
  alone.settle();
  EXPECT_EQ(together.picture(), alone.picture());
  EXPECT_GT(served.servers.takenBack(), 0u);
}

/// As one whose light is always another by then.
TEST(WindowAndServers, OneThatDropsWhatItIsLentIsAskedAgain) {
  const RenderSettings s = windowSettings(1.0, 20);
  setLogLevel(LogLevel::kQuiet);
  Net net(2, 9);
  Servers servers(wireOf(net, 0), hello());
  std::atomic<std::uint32_t> dropped{0};
  Link other(wireOf(net, 1));
  other.listen({.message =
                    [&](std::uint32_t, Kind kind, ByteView body) {
                      if (kind == Kind::kPing) other.send(0, Pong{});
                      if (kind == Kind::kServe) other.send(0, Ready{kDigest});
                      if (kind == Kind::kStop) other.send(0, Bye{});
                      if (kind != Kind::kLent) return;
                      ++dropped;
                      other.send(0, NoLoan{decode<Lent>(body).id});
                    },
                .tick = {},
                .lost = {},
                .broken = [](const Error&) {}});
  other.send(0, hello());
  servers.welcome(true, {}, {s.width, s.height, ""}, kDigest);
  while (servers.readyMachines() == 0) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  Window alone(s), together(s, &servers);
  alone.settle();
  together.settle();
  EXPECT_EQ(together.picture(), alone.picture());
  EXPECT_GT(dropped, 2 * Loans::kAtOnce);
  std::jthread ends([&] { other.finish(); });  // which waits for the other's
  servers.finish(0);
}

TEST(WindowAndServers, OneWithAnotherModelIsLeftOut) {
  const RenderSettings s = windowSettings(1.0, 3);
  setLogLevel(LogLevel::kQuiet);
  Net net(2, 8);
  Servers servers(wireOf(net, 0), hello());
  std::jthread other([&] {
    Server server(wireOf(net, 1), hello());
    try {
      const auto welcome = server.awaitWelcome();
      if (welcome && server.awaitServe(*welcome)) {
        server.run(std::make_shared<Model>(makeModel(room(false), kOptions)), nullptr, kOptions, s,
                   kDigest + 1);
      }
    } catch (const Error& e) {
      server.failed(e);
    }
    server.finish();
  });
  servers.welcome(true, {}, {s.width, s.height, ""}, kDigest);
  Window alone(s), together(s, &servers);
  alone.settle();
  together.settle();
  EXPECT_EQ(together.picture(), alone.picture());
  EXPECT_EQ(servers.readyMachines(), 0u);
  servers.finish(0);
}

TEST(Server, ReadsArgumentsAsTheyWereWritten) {
  const std::vector<std::string> arguments = {"a b.trex", "", "--env", "x\ny"};
  EXPECT_EQ(splitArguments(joinArguments(arguments)), arguments);
  EXPECT_THROW(splitArguments("cut"), MessageError);
}

}  // namespace
}  // namespace trex::machines
