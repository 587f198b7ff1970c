// The session as capture drives it: stopping and going on, checkpoints, layers, the error goal.
#include "src/session/session.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <fstream>

#include "src/core/error.h"
#include "src/frame/lattice.h"
#include "src/session/checkpoint.h"
#include "src/session/model_editor.h"
#include "tests/unit/glass_scenes.h"

namespace trex {
namespace {
namespace fs = std::filesystem;

constexpr std::uint32_t kWidth = 80, kHeight = 72;  // four tiles, two of them cut

std::shared_ptr<const Model> roomModel() {
  static const auto model = std::make_shared<const Model>(
      makeModel(test::mirrorRoom(), {.voxels = true, .voxelDepth = 5}));
  return model;
}

RenderSettings settings(double exact, std::uint32_t samples, GuessKind guess = GuessKind::kRay) {
  RenderSettings s;
  s.width = kWidth;
  s.height = kHeight;
  s.samples = samples;
  s.exact = exact;
  s.device = RenderSettings::kNoDevice;
  s.guess = guess;
  s.coneShare = 0.4;  // of kMixed
  s.denoise = exact <= 0.0 ? Denoise::kFilter : Denoise::kOff;
  return s;
}

const PictureLayers kAll = layersFromNames({"all"});

std::unique_ptr<Session> session(const RenderSettings& s, const PictureLayers& layers = kAll) {
  auto model = roomModel();
  const Camera camera = model->scene.cameras.front();
  return std::make_unique<Session>(std::move(model), camera, s, layers);
}

/// Stops every `tiles` tiles and goes on.
void runInPieces(Session& session, int tiles) {
  while (!session.goalReached()) {
    int left = tiles;
    session.run([&] { return left-- > 0; });
  }
}

std::size_t channel(const Picture& picture, const std::string& name) {
  const auto at = std::find(picture.channels.begin(), picture.channels.end(), name);
  EXPECT_NE(at, picture.channels.end()) << name;
  return static_cast<std::size_t>(at - picture.channels.begin());
}

float value(const Picture& picture, const std::string& name, std::uint32_t x, std::uint32_t y) {
  return picture.values[(std::size_t{y} * picture.width + x) * picture.channels.size() +
                        channel(picture, name)];
}

class CheckpointTest : public testing::Test {
 protected:
  CheckpointTest()
      : path_(fs::temp_directory_path() / ("trex-checkpoint-" + std::to_string(getpid()))) {}
  ~CheckpointTest() override { fs::remove(path_); }

  std::vector<char> bytes() const {
    std::ifstream file(path_, std::ios::binary);
    return {std::istreambuf_iterator<char>(file), {}};
  }
  void put(const std::vector<char>& bytes) const {
    std::ofstream(path_, std::ios::binary)
        .write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
  }

  fs::path path_;
};

TEST(Session, StoppingAndGoingOnChangesNoBit) {
  for (const double exact : {0.0, 0.5, 1.0}) {
    for (const GuessKind guess : {GuessKind::kRay, GuessKind::kCone, GuessKind::kMixed}) {
      const auto whole = session(settings(exact, 6, guess));
      whole->run();
      const auto pieces = session(settings(exact, 6, guess));
      runInPieces(*pieces, 3);
      EXPECT_EQ(whole->picture().values, pieces->picture().values) << exact;
      EXPECT_EQ(whole->report().rays.cRays, pieces->report().rays.cRays);
    }
  }
}

TEST_F(CheckpointTest, GoesOnWithTheSameBitsFromAnyTile) {
  for (const double exact : {0.0, 0.5, 1.0}) {
    const auto whole = session(settings(exact, 7));
    whole->run();
    for (const int tiles : {1, 4, 11, 22}) {
      const auto first = session(settings(exact, 7));
      int left = tiles;
      first->run([&] { return left-- > 0; });
      first->saveCheckpoint(path_, 5, 3);
      const auto second = session(settings(exact, 7));
      CheckpointReader reader(path_);
      EXPECT_EQ(reader.header().key, 5u);
      EXPECT_EQ(reader.header().frame, 3u);
      second->restoreCheckpoint(reader);
      second->run();
      EXPECT_EQ(whole->picture().values, second->picture().values) << exact << ' ' << tiles;
      EXPECT_EQ(whole->report().rays.cRays, second->report().rays.cRays);
      EXPECT_EQ(whole->report().samplesDone, second->report().samplesDone);
    }
  }
}

/// The share that a render began with is kept, whatever this machine would choose.
TEST_F(CheckpointTest, KeepsTheShareOfCones) {
  const auto whole = session(settings(0.5, 7, GuessKind::kMixed));
  whole->run();
  const auto first = session(settings(0.5, 7, GuessKind::kMixed));
  int left = 11;
  first->run([&] { return left-- > 0; });
  first->saveCheckpoint(path_, 5, 0);
  const auto second = session(settings(0.5, 7, GuessKind::kAuto));
  CheckpointReader reader(path_);
  EXPECT_EQ(reader.header().coneShare, 0.4);
  second->restoreCheckpoint(reader);
  EXPECT_EQ(second->coneShare(), 0.4);
  second->run();
  EXPECT_EQ(whole->picture().values, second->picture().values);
}

TEST_F(CheckpointTest, NoticesEveryChangedByteAndLength) {
  const auto s = session(settings(1.0, 1), {});
  s->run();
  s->saveCheckpoint(path_, 1, 0);
  const std::vector<char> good = bytes();
  for (std::size_t i = 0; i < good.size(); i += i < 700 ? 1 : 997) {
    std::vector<char> bad = good;
    bad[i] ^= static_cast<char>(1 << (i % 8));
    put(bad);
    EXPECT_THROW(CheckpointReader{path_}, Error) << "byte " << i;
  }
  for (const std::size_t size : {std::size_t{0}, std::size_t{5}, std::size_t{100}, good.size() / 2,
                                 good.size() - 1, good.size() + 1}) {
    std::vector<char> bad = good;
    bad.resize(size);
    put(bad);
    EXPECT_THROW(CheckpointReader{path_}, Error) << "size " << size;
  }
  put(good);
  CheckpointReader reader(path_);
  const auto other = session(settings(0.5, 1), {});  // has more sums
  EXPECT_THROW(other->restoreCheckpoint(reader), Error);
}

/// Means of channels of the whole picture.
double meanOf(const Picture& picture, const std::string& name) {
  double sum = 0.0;
  for (std::size_t i = channel(picture, name); i < picture.values.size();
       i += picture.channels.size()) {
    sum += static_cast<double>(picture.values[i]);
  }
  return sum / (picture.width * picture.height);
}

TEST(Filter, KeepsTheMean) {
  for (const std::uint32_t samples : {1u, 2u, 4u, 16u}) {
    RenderSettings s = settings(0.0, samples);
    double mean[2];
    for (const bool filtered : {false, true}) {
      s.denoise = filtered ? Denoise::kFilter : Denoise::kOff;
      const auto r = session(s);
      r->run();
      mean[filtered ? 1 : 0] = meanOf(r->picture(), "G");
    }
    EXPECT_NEAR(mean[1] / mean[0], 1.0, 0.01) << samples << " samples";
  }
}

/// The correction too, whether pairs are too few to be filtered or not.
TEST(Filter, KeepsTheMeanOfTheCorrection) {
  for (const std::uint32_t samples : {2u, 16u}) {
    RenderSettings s = settings(0.25, samples);
    double mean[2];
    for (const bool filtered : {false, true}) {
      s.denoise = filtered ? Denoise::kFilter : Denoise::kOff;
      const auto r = session(s);
      r->run();
      const Picture p = r->picture();
      mean[filtered ? 1 : 0] = meanOf(p, "R") + meanOf(p, "G") + meanOf(p, "B");
    }
    EXPECT_NEAR(mean[1] / mean[0], 1.0, 1e-3) << samples << " samples";
  }
}

/// Unlit strips of 3 pixels and an emitter, above a mirror: nothing of them is noise.
TEST(Filter, LeavesAloneWhatIsNotLit) {
  Scene scene;
  scene.materials = {test::lambert(0.6f), test::lambert(0.0f, 3.0f), test::lambert(0.9f)};
  scene.materials[2].metallic = 1.0f;
  scene.materials[2].roughness = 0.05f;
  for (int i = 0; i < 2; ++i) {
    scene.materials.push_back(test::lambert(i == 0 ? 0.9f : 0.1f));
    scene.materials.back().unlit = true;
  }
  test::place(scene, test::box(vec3(-2.0f), vec3(2.0f), 0, true));
  for (int i = 0; i < 16; ++i) {
    const float x = -0.8f + 0.1f * static_cast<float>(i);
    test::place(scene,
                test::box(vec3(x, -0.5f, -1.9f), vec3(x + 0.1f, 0.5f, -1.8f), 3 + i % 2, false));
  }
  test::place(scene, test::box(vec3(-0.5f, 0.7f, -1.9f), vec3(0.5f, 1.0f, -1.8f), 1, false));
  test::place(scene, test::box(vec3(-1.5f, -1.2f, -1.9f), vec3(1.5f, -1.1f, 0.0f), 2, false));
  scene.cameras = {test::lookAt(dvec3(0.0, 0.0, 1.9), dvec3(0.0, 0.0, -2.0), 0.9f)};
  const Camera camera = scene.cameras.front();
  const auto model =
      std::make_shared<const Model>(makeModel(scene, {.voxels = true, .voxelDepth = 5}));
  std::vector<Picture> pictures;
  for (const bool filtered : {false, true}) {
    RenderSettings s = settings(0.0, 16);
    s.denoise = filtered ? Denoise::kFilter : Denoise::kOff;
    Session r(model, camera, s, kAll);
    r.run();
    pictures.push_back(r.picture());
  }
  std::size_t alone = 0;
  for (std::uint32_t y = 0; y < kHeight; ++y) {
    for (std::uint32_t x = 0; x < kWidth; ++x) {
      const float material = value(pictures[0], "materialId", x, y);
      if (material != 1.0f && material < 3.0f) continue;
      // Unlit and emissive throughout: rims of a wall have its light in them.
      if (value(pictures[0], "albedo.R", x, y) > 1e-3f) continue;
      ++alone;
      const float plain = value(pictures[0], "R", x, y);
      EXPECT_NEAR(value(pictures[1], "R", x, y), plain, 1e-4f * (plain + 1.0f)) << x << ' ' << y;
    }
  }
  EXPECT_GT(alone, 500u);
}

/// The inside of a house whose walls are thinner than a voxel is as bright as it should be.
TEST(Guess, IndirectLightIsRightWhateverTheLeaves) {
  Scene scene;
  scene.materials = {test::lambert(0.6f), test::lambert(0.0f, 20.0f)};
  test::place(scene, test::box(vec3(-2.0f), vec3(2.0f), 0, true));
  test::place(scene, test::box(vec3(-2.15f), vec3(2.15f), 0, false));
  test::place(scene, test::box(vec3(-1.5f, -2.0f, -1.5f), vec3(-0.5f, 0.0f, -0.5f), 0, false));
  test::place(scene, test::box(vec3(-0.2f, 0.6f, -0.2f), vec3(0.2f, 1.0f, 0.2f), 1, false));
  scene.cameras = {test::lookAt(dvec3(0.0, 0.0, 1.9), dvec3(0.0, -0.5, -1.0), 1.2f)};
  const Camera camera = scene.cameras.front();
  const auto indirect = [&](double exact, std::uint32_t samples, int depth) {
    RenderSettings s = settings(exact, samples);
    s.width = s.height = 32;
    s.denoise = Denoise::kOff;
    Session r(std::make_shared<const Model>(
                  makeModel(scene, {.voxels = depth > 0, .voxelDepth = std::max(depth, 1)})),
              camera, s, kAll);
    r.run();
    return meanOf(r.picture(), "indirect.G");
  };
  const double truth = indirect(1.0, 256, 0);
  for (const int depth : {4, 5, 6}) {
    // Leaves of a sixteenth of the room, as scenes much wider than it have them, are 2.2 % dark: a
    // bias, the same with eight times the photons.
    const double bound = depth == 4 ? 0.03 : 0.02;
    EXPECT_NEAR(indirect(0.0, 128, depth) / truth, 1.0, bound) << "depth " << depth;
  }
}

TEST(Layers, DirectAndIndirectMakeTheMean) {
  for (const double exact : {0.0, 0.5, 1.0}) {
    for (const GuessKind guess : {GuessKind::kRay, GuessKind::kCone, GuessKind::kMixed}) {
      RenderSettings s = settings(exact, 8, guess);
      s.denoise = Denoise::kOff;
      const auto r = session(s);
      r->run();
      const Picture p = r->picture();
      for (std::uint32_t y = 0; y < kHeight; y += 5) {
        for (std::uint32_t x = 0; x < kWidth; x += 5) {
          const float sum = value(p, "direct.G", x, y) + value(p, "indirect.G", x, y);
          EXPECT_NEAR(sum, value(p, "G", x, y), 1e-5f * (1.0f + std::abs(sum)));
          EXPECT_GE(value(p, "direct.G", x, y), exact > 0.0 ? -10.0f : 0.0f);
        }
      }
    }
  }
}

/// Without a second bounce there is no indirect light: black walls, a lamp, and a mirror.
TEST(Layers, LightSeenInAMirrorIsDirect) {
  Scene scene = test::mirrorRoom();
  scene.materials[0] = test::lambert(0.0f);
  const Camera camera = scene.cameras.front();
  RenderSettings s = settings(1.0, 32);
  Session r(std::make_shared<const Model>(makeModel(scene, {.voxels = false})), camera, s, kAll);
  r.run();
  const Picture p = r.picture();
  float light = 0.0f;
  for (std::uint32_t y = 0; y < kHeight; ++y) {
    for (std::uint32_t x = 0; x < kWidth; ++x) {
      light += value(p, "direct.R", x, y);
      EXPECT_NEAR(value(p, "indirect.R", x, y), 0.0f, 1e-6f);
    }
  }
  EXPECT_GT(light, 1.0f);
}

TEST(Layers, SayWhatThePixelsShow) {
  const auto r = session(settings(1.0, 16));
  r->run();
  const Picture p = r->picture();
  const std::uint32_t y = kHeight / 2;
  std::uint32_t mirror = 0, grey = 0;
  while (value(p, "materialId", mirror, y) != 2.0f) ASSERT_LT(++mirror, kWidth);
  mirror += 4;  // well inside
  grey = kWidth - 1 - mirror;
  EXPECT_EQ(value(p, "objectId", mirror, y), 2.0f);
  EXPECT_EQ(value(p, "objectId", grey, y), 3.0f);
  EXPECT_EQ(value(p, "materialId", grey, y), 0.0f);
  EXPECT_NEAR(value(p, "albedo.R", grey, y), 0.6f, 1e-3f);
  EXPECT_EQ(value(p, "sampleCount", grey, y), 16.0f);
  EXPECT_GT(value(p, "variance.R", grey, y), 0.0f);
  // The sphere's front is 2.3 m away; depth runs along the view, position is where the ray ends.
  EXPECT_NEAR(value(p, "depth", grey, y), 2.5f, 0.25f);
  EXPECT_NEAR(value(p, "position.Z", grey, y) + value(p, "depth", grey, y), 1.9f, 0.05f);
  // What the mirror shows, a wall of the room or the other sphere, as much of it as it reflects.
  EXPECT_NEAR(value(p, "albedo.R", mirror, y), 0.9f * 0.6f, 0.01f);
}

TEST(Layers, NothingIsMinusOne) {
  Scene scene;
  scene.materials = {test::lambert(0.5f)};
  test::place(scene, test::box(vec3(-1.0f), vec3(1.0f), 0, false));
  scene.environment.color = vec3(1.0f);
  scene.cameras = {test::lookAt(dvec3(0.0, 0.0, 5.0), dvec3(0.0, 0.0, 9.0), 0.5f)};
  const Camera camera = scene.cameras.front();
  Session r(std::make_shared<const Model>(makeModel(scene, {.voxels = false})), camera,
            settings(1.0, 2), kAll);
  r.run();
  const Picture p = r.picture();
  for (const char* name : {"depth", "objectId", "materialId"}) {
    EXPECT_EQ(value(p, name, 3, 3), -1.0f) << name;
  }
  EXPECT_EQ(value(p, "direct.R", 3, 3), 1.0f);
}

TEST(Layers, NamesAreChecked) {
  EXPECT_THROW(layersFromNames({"depht"}), Error);
  EXPECT_EQ(layersFromNames({"depth", "variance"}).channels(), 4u);
  EXPECT_EQ(kAll.channels(), 24u);
}

TEST(Session, StopsAtTheErrorAskedFor) {
  RenderSettings s = settings(1.0, 0);
  s.error = 0.02;
  const auto r = session(s, {});
  r->run();
  EXPECT_LE(r->frame().estimatedError(), 0.02);
  EXPECT_GE(r->samplesDone(), 16u);
  EXPECT_LT(r->samplesDone(), 100'000u);
}

/// The estimate agrees with the distance to a picture of many more samples. Without the mirror: the
/// rare bright paths of caustics are missing from pictures and estimates alike.
TEST(Session, EstimatedErrorIsTheError) {
  Scene scene = test::mirrorRoom();
  scene.materials[2] = test::lambert(0.5f);
  const Camera camera = scene.cameras.front();
  const auto model = std::make_shared<const Model>(makeModel(scene, {.voxels = false}));
  RenderSettings other = settings(1.0, 512);
  other.seed = 1;
  const auto rough = std::make_unique<Session>(model, camera, settings(1.0, 32));
  const auto fine = std::make_unique<Session>(model, camera, other);
  rough->run();
  fine->run();
  double mean = 0.0, error = 0.0;
  constexpr double kValues = 3.0 * kWidth * kHeight;
  for (std::uint32_t i = 0; i < kWidth * kHeight; ++i) {
    const dvec3 m = fine->frame().mean(i % kWidth, i / kWidth);
    mean += (m.x + m.y + m.z) / kValues;
  }
  for (std::uint32_t i = 0; i < kWidth * kHeight; ++i) {
    const dvec3 m = fine->frame().mean(i % kWidth, i / kWidth);
    const dvec3 d = rough->frame().mean(i % kWidth, i / kWidth) - m;
    for (int c = 0; c < 3; ++c) error += d[c] * d[c] / (m[c] * m[c] + 0.01 * mean * mean) / kValues;
  }
  EXPECT_NEAR(rough->frame().estimatedError() / error, 1.0, 0.3);
}

TEST(Session, TheFirstPassIsFinishedHoweverShortTheTime) {
  RenderSettings s = settings(0.0, 0);
  s.seconds = 1e-6;
  const auto r = session(s);
  r->run();
  EXPECT_EQ(r->samplesDone(), 1u);
  const Picture p = r->picture();
  for (std::uint32_t y = 0; y < kHeight; ++y) {
    for (std::uint32_t x = 0; x < kWidth; ++x) EXPECT_EQ(value(p, "sampleCount", x, y), 1.0f);
  }
}

/// A box without a lid under the sun, with a lid of glass or none.
std::shared_ptr<const Model> windowModel(int kind) {
  Scene scene;
  scene.materials = {test::lambert(0.5f), test::glass(kind == 2)};
  Mesh box = test::box(vec3(-1.0f), vec3(1.0f), 0, true);
  box.triangles.erase(box.triangles.begin() + 6, box.triangles.begin() + 8);
  test::place(scene, box);
  if (kind == 1) test::place(scene, test::sheet(1.0f, 1.0f, 1));
  if (kind == 2) test::place(scene, test::pane(1.0f, 1.0f, 0.006f, 1));
  scene.lights = {test::sun(vec3(0.4f, -1.0f, 0.2f), 3.0f)};
  scene.cameras = {test::lookAt(dvec3(0.7, 0.5, 0.8), dvec3(-0.6, -0.8, -0.6), 1.2f)};
  return std::make_shared<const Model>(
      makeModel(std::move(scene), {.voxels = true, .voxelDepth = 6}));
}

double meanOf(std::shared_ptr<const Model> model, const RenderSettings& s) {
  const Camera camera = model->scene.cameras.front();
  Session session(std::move(model), camera, s, PictureLayers{});
  session.run();
  const Picture picture = session.picture();
  double sum = 0.0;
  for (std::size_t i = 0; i < picture.values.size(); i += picture.channels.size())
    sum += picture.values[i];
  return sum / (picture.width * picture.height);
}

/// With a tenth of a sample a pixel the viewer's picture has the edges of the whole one.
TEST(Session, CoarseFramesAreSharp) {
  RenderSettings s = settings(0.0, 32);
  s.width = 192;
  s.height = 144;
  const auto whole = session(s);
  whole->run();
  const Picture right = whole->picture();
  s.interactive = true;
  const auto coarse = session(s, {});
  while (coarse->previewing() || coarse->shownFrame().tiles.lookSpacing() != 1) {
    int turns = 0;  // photons want a few
    ASSERT_TRUE(coarse->step([&] { return coarse->previewing() && ++turns < 50; }, vec2(0.5f)));
  }
  const FrameBuffers& frame = coarse->shownFrame();
  ASSERT_LT(frame.tiles.meanProgress(), 0.25);
  const std::uint32_t spacing = lattice::spacing(frame.tiles.coarseCells());
  ASSERT_GT(spacing, 1u);
  const auto error = [&](bool spread) {
    ShownOptions options = coarse->shownOptions();
    options.spacing = spacing;
    options.spread = spread;
    ShownPicture picture(frame, s.width, s.height, options);
    while (!picture.advance([] { return false; })) continue;
    const std::vector<vec3> shown = picture.take();
    const std::uint32_t step = spread ? 1 : spacing, columns = (s.width + step - 1) / step;
    double sum = 0.0;
    for (std::uint32_t y = 0; y < s.height; ++y) {
      for (std::uint32_t x = 0; x < s.width; ++x) {
        const double is = shown[std::size_t{y / step} * columns + x / step].y;
        const double wanted = value(right, "G", x, y);
        sum += std::abs(is - wanted) / (wanted + 0.1);
      }
    }
    return sum / (s.width * s.height);
  };
  const double sharp = error(true), blocks = error(false);
  EXPECT_LT(sharp, 0.85 * blocks) << sharp << ' ' << blocks;
  EXPECT_LT(sharp, 0.1);
}

/// Voxels that are built anew since something is hidden are as fine as those before.
TEST(Session, VoxelsOfWhatIsVisibleAreAsFine) {
  Scene scene;
  scene.materials = {test::lambert(0.5f), test::lambert(0.0f, 5.0f)};
  for (const float x : {-25.0f, -1.0f, 1.0f, 25.0f}) {  // far apart: more levels than asked for
    const vec3 middle(x, 0.0f, 0.0f);
    test::place(scene, test::box(middle - 0.5f, middle + 0.5f, x > 0.0f ? 1 : 0, false));
  }
  scene.cameras = {test::lookAt(dvec3(0.0, 0.0, 9.0), dvec3(0.0, 0.0, -1.0), 1.0f)};
  scene.objects = {"first", "second", "third", "fourth"};
  const ModelOptions options{.voxels = true, .voxelDepth = 6};
  const auto model = std::make_shared<Model>(makeModel(std::move(scene), options));
  const std::uint32_t depth = model->voxels->info.depth;
  ASSERT_GT(depth, 6u);
  const auto before = model->voxels;
  Look look = ModelEditor(model, options).source();
  look.hidden = {1};
  applyLook(model, look, options);
  EXPECT_NE(model->voxels, before);
  EXPECT_GE(model->voxels->info.depth, depth);
}

/// A picture that is made a slice at a time, as the window does, is that made in one go; and what
/// is between two questions is small, so that no turn of the window waits for it.
TEST(Session, PicturesAreMadeInSlices) {
  RenderSettings s = settings(0.5, 4);
  s.denoise = Denoise::kFilter;
  s.width = 320;
  s.height = 240;
  s.interactive = true;
  const auto viewed = session(s, {});
  const auto check = [&](const ShownOptions& options, int least) {
    const auto make = [&] {
      return ShownPicture(viewed->shownFrame(), s.width, s.height, options);
    };
    ShownPicture whole = make(), sliced = make();
    ASSERT_TRUE(whole.advance([] { return true; }));
    int slices = 1;
    while (!sliced.advance([] { return false; })) ++slices;
    EXPECT_GE(slices, least);
    EXPECT_EQ(whole.take(), sliced.take());
  };
  while (viewed->previewing() || viewed->shownFrame().tiles.lookSpacing() != 1) {
    int turns = 0;
    ASSERT_TRUE(viewed->step([&] { return viewed->previewing() && ++turns < 50; }, vec2(0.5f)));
  }
  ShownOptions spread = viewed->shownOptions();
  spread.spacing = lattice::spacing(viewed->shownFrame().tiles.coarseCells());
  ASSERT_GT(spread.spacing, 0u);
  spread.spread = true;
  const int gathered = 240 / 2 / (4096 / 160);  // slices of a lattice of every second pixel
  check(spread, 2 * gathered);
  while (!viewed->resting()) ASSERT_TRUE(viewed->step([] { return true; }, vec2(0.5f)));
  const ShownOptions corrected = viewed->shownOptions();
  ASSERT_TRUE(corrected.pairs);
  const int filters = 3;
  check(corrected, 4 * filters);
}

/// A turn of the camera keeps what was seen of light, an edit of light does not.
TEST(Session, RemembersLightUntilItIsEdited) {
  RenderSettings s = settings(0.0, 64);
  s.interactive = true;
  const auto viewed = session(s, {});
  const auto untilReady = [&] {
    do {
      int turns = 0;
      ASSERT_TRUE(viewed->step([&] { return ++turns < 50; }, vec2(0.5f)));
    } while (viewed->previewing());
  };
  while (viewed->previewing() || viewed->samplesDone() < 8) untilReady();
  std::vector<FeaturePart> parts;
  for (std::uint32_t y = 0; y < kHeight; y += 4) {
    for (std::uint32_t x = 0; x < kWidth; x += 4)
      parts.push_back(viewed->shownFrame().features->most(x, y));
  }
  const auto known = [&] {
    const LightMemory& memory = *viewed->shownFrame().memory;
    return std::count_if(parts.begin(), parts.end(),
                         [&](FeaturePart part) { return memory.join(part, vec2(0.5f)); });
  };
  const auto before = known();
  EXPECT_GT(before, static_cast<std::ptrdiff_t>(parts.size() / 2));
  const Camera camera = roomModel()->scene.cameras.front();
  viewed->follow({.frame = true}, camera);
  ASSERT_FALSE(viewed->previewing());
  EXPECT_EQ(known(), before);
  viewed->follow({.frame = true, .lights = true, .flux = true}, camera);
  ASSERT_TRUE(viewed->previewing());
  while (viewed->previewing()) {
    int turns = 0;
    ASSERT_TRUE(viewed->step([&] { return ++turns < 50; }, vec2(0.5f)));
  }
  EXPECT_EQ(known(), 0);
}

/// While photons are aimed at a new view what there is of it is shown, and goes on; what its pixels
/// show is known to the frame that begins anew.
TEST(Session, AimingAnewKeepsWhatIsShown) {
  RenderSettings s = settings(0.0, 5);  // past the first change of light
  s.interactive = true;
  const auto model = windowModel(0);
  Camera camera = model->scene.cameras.front();
  Session viewed(model, camera, s, {});
  const auto stepUntil = [&](const auto& done) {
    for (int steps = 0; !done(); ++steps) {
      int turns = 0;
      ASSERT_LT(steps, 10'000);
      ASSERT_TRUE(viewed.step([&] { return ++turns < 50; }, vec2(0.5f)));
    }
  };
  stepUntil([&] { return !viewed.previewing() && viewed.samplesDone() > 0; });
  camera.eye += dvec3(0.1, 0.0, -0.1);
  viewed.follow({.frame = true}, camera);
  EXPECT_EQ(viewed.shownFrame().tiles.lookSpacing(), 0u);
  stepUntil([&] { return viewed.shownFrame().tiles.lookSpacing() == 1; });
  const FrameBuffers& shown = viewed.shownFrame();
  const double progress = shown.tiles.meanProgress();
  ASSERT_GT(progress, 0.0);
  ASSERT_TRUE(viewed.aimAgain());
  EXPECT_TRUE(viewed.previewing());
  EXPECT_EQ(&viewed.shownFrame(), &shown);
  EXPECT_EQ(shown.tiles.meanProgress(), progress);
  EXPECT_EQ(viewed.samplesDone(), 0u);
  stepUntil([&] { return !viewed.previewing(); });
  EXPECT_NE(&viewed.shownFrame(), &shown);
  EXPECT_EQ(viewed.shownFrame().tiles.lookSpacing(), 1u);
  EXPECT_EQ(viewed.shownFrame().looks, shown.looks);
  EXPECT_FALSE(viewed.aimAgain()) << "they are aimed";
  // In the end it is the picture of a capture, aimed there from the start.
  stepUntil([&] { return viewed.resting(); });
  RenderSettings captured = s;
  captured.interactive = false;
  captured.aim = camera;
  Session capture(model, camera, captured, {});
  capture.run();
  std::size_t different = 0;
  for (std::uint32_t i = 0; i < s.width * s.height; ++i) {
    const std::uint32_t x = i % s.width, y = i / s.width;
    different += viewed.frame().mean(x, y) != capture.frame().mean(x, y);
  }
  EXPECT_EQ(different, 0u);
  viewed.follow({.frame = true}, camera);
  EXPECT_EQ(viewed.shownFrame().tiles.lookSpacing(), 0u);
  EXPECT_EQ(shown.looks, nullptr);
}

TEST(Session, SunShinesThroughWindowsInEveryMode) {
  const double open = meanOf(windowModel(0), settings(1.0, 16));
  for (const int kind : {1, 2}) {
    const auto model = windowModel(kind);
    const double exact = meanOf(model, settings(1.0, 16));
    // Light that would leave is reflected back in part.
    EXPECT_NEAR(exact / open, 0.94, 0.02) << kind;
    EXPECT_NEAR(meanOf(model, settings(0.25, 16)) / exact, 1.0, 0.03) << kind;
    EXPECT_NEAR(meanOf(model, settings(0.0, 16)) / exact, 1.0, 0.03) << kind;
  }
}

/// Caustics are photons of maps, which a session that was cut short makes again.
TEST(Session, CausticsHaveTheSameBitsAfterAStop) {
  Scene scene;
  scene.materials = {test::lambert(0.5f), test::glass(true)};
  test::place(scene, test::sheet(2.0f, 0.0f, 0));
  test::place(scene, test::sphere(vec3(0.0f, 0.8f, 0.0f), 0.4f, 1, 16));
  scene.lights = {test::pointLight(dvec3(0.3, 3.0, 0.2), 20.0f)};
  scene.cameras = {test::lookAt(dvec3(0.0, 2.0, 3.0), dvec3(0.0), 0.8f)};
  const auto model = std::make_shared<const Model>(makeModel(std::move(scene), {.voxels = false}));
  const Camera camera = model->scene.cameras.front();
  Session whole(model, camera, settings(1.0, 5), PictureLayers{}),
      pieces(model, camera, settings(1.0, 5), PictureLayers{});
  whole.run();
  runInPieces(pieces, 1);
  EXPECT_GT(whole.report().causticPhotons, 0u);
  EXPECT_EQ(whole.picture().values, pieces.picture().values);
}

}  // namespace
}  // namespace trex
