// The viewer without its window: whatever way a look was reached, the screen shows what a capture
// of it shows.
#include "src/viewer/viewer.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <chrono>
#include <fstream>
#include <thread>

#include "src/bundle/bundle.h"
#include "src/core/error.h"
#include "src/frame/picture_reader.h"
#include "src/scene/look_file.h"
#include "src/session/model_editor.h"
#include "src/viewer/recovery.h"

namespace trex {
namespace {
namespace fs = std::filesystem;

constexpr std::uint32_t kWidth = 72, kHeight = 56;  // tiles that are cut, and not a multiple of 8
const fs::path kCornell = fs::path(TREX_ASSETS) / "cornell.glb";

class ViewerTest : public testing::Test {
 protected:
  ViewerTest() : folder_(fs::temp_directory_path() / ("trex-viewer-" + std::to_string(getpid()))) {
    fs::create_directories(folder_);
    setenv("XDG_STATE_HOME", folder_.c_str(), 1);
  }
  ~ViewerTest() override { fs::remove_all(folder_); }

  static ViewerOptions options(double exact = 0.0) {
    ViewerOptions o;
    o.input = kCornell;
    o.settings.width = kWidth;
    o.settings.height = kHeight;
    o.settings.samples = 6;  // past the first change of light
    o.settings.exact = exact;
    o.settings.denoise = Denoise::kFilter;
    o.settings.device = RenderSettings::kNoDevice;
    return o;
  }

  /// Steps until nothing is left to do. Fails after a minute.
  static void settle(Viewer& viewer) {
    const auto end = std::chrono::steady_clock::now() + std::chrono::minutes(1);
    while (!viewer.idle()) {
      viewer.step(0.02);
      ASSERT_LT(std::chrono::steady_clock::now(), end) << "still at work: " << viewer.message();
    }
  }
  static void waitForMeshes(Viewer& viewer) {
    while (viewer.phase() == OpenPhase::kImporting) viewer.step(0.005);
    ASSERT_NE(viewer.phase(), OpenPhase::kFailed) << viewer.message();
  }

  /// The pixels of a capture under an overlay.
  Picture capture(const fs::path& edits, const ViewerOptions& o) const {
    RenderSettings settings = o.settings;
    OpenOptions open;
    open.model.voxelDepth = voxelDepthFor(std::uint64_t{settings.width} * settings.height);
    open.model.voxelsInTheDark = true;
    auto model = std::make_shared<Model>(openModel(o.input, open));
    LookLight light;
    const Look look = readLook(edits, model->scene, lookOf(model->scene), &light);
    settings.photons = light.photons;
    settings.aim = light.aim;
    applyLook(model, look, open.model);
    Session session(model, look.camera, settings);
    session.run();
    return session.picture();
  }

  /// What the viewer shows has the bits of a capture of the same look.
  void expectCaptureEqual(Viewer& viewer, const ViewerOptions& o, const std::string& what) {
    settle(viewer);
    const fs::path edits = folder_ / "look.json", exr = folder_ / "shown.exr";
    viewer.saveEdits(edits);
    viewer.savePicture(exr);
    const Picture shown = readPicture(exr), captured = capture(edits, o);
    const std::size_t pixels = std::size_t{kWidth} * kHeight;
    ASSERT_EQ(shown.values.size() / shown.channels.size(), pixels);
    std::size_t different = 0;
    double brightness = 0.0;
    for (std::size_t i = 0; i < pixels; ++i) {
      for (std::size_t c = 0; c < 3; ++c) {
        const float a = shown.values[i * shown.channels.size() + c];
        const float b = captured.values[i * captured.channels.size() + c];
        different += a != b;
        brightness += static_cast<double>(b);
      }
    }
    EXPECT_EQ(different, 0u) << what;
    EXPECT_GT(brightness, 0.0) << what;
    EXPECT_NE(captured.values, before_) << what << " changes nothing";
    before_ = captured.values;
  }

  fs::path folder_;
  std::vector<float> before_;
};

TEST_F(ViewerTest, WithADialItShowsACapturesPixels) {
  ViewerOptions o = options(kFirstShare);
  o.settings.dial = true;
  o.settings.samples = 10;  // past four looks
  Viewer viewer(o);
  expectCaptureEqual(viewer, o, "with a dial");
  EXPECT_GT(viewer.figures().exactShare, 0.0);
  EXPECT_GT(viewer.figures().truthDistance, 0.0);
}

TEST_F(ViewerTest, ScreenEqualsCaptureForEveryClassOfEdit) {
  const ViewerOptions o = options();
  Viewer viewer(o);
  waitForMeshes(viewer);
  expectCaptureEqual(viewer, o, "as opened");

  Look look = viewer.look();
  look.camera.eye += dvec3(0.1, 0.05, -0.2);
  viewer.edit(look, true, "camera");
  expectCaptureEqual(viewer, o, "camera");

  look.materials[0].baseColor = vec4(0.1f, 0.7f, 0.2f, 1.0f);
  viewer.edit(look, true, "colour");
  expectCaptureEqual(viewer, o, "material");

  // A wall that shines needs triangles that were freed.
  look.materials[1].emission = vec3(0.5f, 0.4f, 0.1f);
  viewer.edit(look, true, "emission");
  expectCaptureEqual(viewer, o, "emission");

  Light lamp;
  lamp.position = viewer.bounds().centre();
  lamp.intensity = vec3(0.3f);
  lamp.radius = 0.05f;
  look.lights.push_back(lamp);
  viewer.edit(look, true, "lamp");
  expectCaptureEqual(viewer, o, "lamp");

  look.environment.color = vec3(0.2f, 0.3f, 0.4f);
  viewer.edit(look, true, "sky");
  expectCaptureEqual(viewer, o, "sky");

  look.hidden = {static_cast<std::uint32_t>(viewer.scene().instances.back().object)};
  viewer.edit(look, true, "hide");
  expectCaptureEqual(viewer, o, "hide");

  look.section = SectionPlane{viewer.bounds().centre(), vec3(0.0f, 1.0f, 0.0f)};
  viewer.edit(look, true, "section");
  expectCaptureEqual(viewer, o, "section");

  viewer.undo();
  viewer.undo();
  EXPECT_FALSE(viewer.look().section.has_value());
  EXPECT_TRUE(viewer.look().hidden.empty());
  expectCaptureEqual(viewer, o, "undone");
}

TEST_F(ViewerTest, ScreenEqualsCaptureWithACorrection) {
  const ViewerOptions o = options(0.5);
  Viewer viewer(o);
  waitForMeshes(viewer);
  Look look = viewer.look();
  look.materials[2].roughness = 0.4f;
  viewer.edit(look, true, "roughness");
  expectCaptureEqual(viewer, o, "correction");
}

TEST_F(ViewerTest, EditsShowAtOnce) {
  Viewer viewer(options());
  waitForMeshes(viewer);
  settle(viewer);
  const auto before = viewer.screen().rgba;
  Look look = viewer.look();
  for (Material& m : look.materials) m.emission *= 0.25f;
  viewer.edit(look, true, "dim");
  // One step, whatever its budget, brings a whole picture of the new look.
  const StepReport report = viewer.step(0.0);
  EXPECT_TRUE(report.coarseComplete);
  EXPECT_TRUE(report.newPicture);
  EXPECT_NE(viewer.screen().rgba, before);
}

TEST_F(ViewerTest, EveryViewShowsSomething) {
  Viewer viewer(options());
  waitForMeshes(viewer);
  settle(viewer);
  std::vector<std::vector<std::uint8_t>> seen;
  for (std::size_t mode = 0; mode < viewModeNames().size(); ++mode) {
    viewer.state().mode = static_cast<ViewMode>(mode);
    EXPECT_EQ(viewer.idle(), mode == 0) << viewModeNames()[mode];
    settle(viewer);
    const auto& rgba = viewer.screen().rgba;
    EXPECT_EQ(rgba.size(), std::size_t{kWidth} * kHeight * 4);
    EXPECT_EQ(std::count(seen.begin(), seen.end(), rgba), 0) << viewModeNames()[mode];
    seen.push_back(rgba);
  }
}

TEST_F(ViewerTest, PicksWhatProjects) {
  Viewer viewer(options());
  waitForMeshes(viewer);
  const auto pick = viewer.pick(0.5f * kWidth, 0.6f * kHeight);
  ASSERT_TRUE(pick.has_value());
  vec2 pixel;
  ASSERT_TRUE(viewer.project(pick->position, pixel));
  EXPECT_NEAR(pixel.x, 0.5f * kWidth, 0.01f);
  EXPECT_NEAR(pixel.y, 0.6f * kHeight, 0.01f);
  EXPECT_LT(pick->object, viewer.scene().objects.size());
  // What is hidden is not picked.
  Look look = viewer.look();
  look.hidden = {pick->object};
  viewer.edit(look, true, "hide");
  viewer.step(0.01);
  const auto behind = viewer.pick(0.5f * kWidth, 0.6f * kHeight);
  EXPECT_TRUE(!behind || behind->object != pick->object);
}

TEST_F(ViewerTest, UnsavedEditsSurvive) {
  {
    Viewer viewer(options());
    waitForMeshes(viewer);
    EXPECT_FALSE(viewer.unsavedEdits());
    Look look = viewer.look();
    look.materials[0].roughness = 0.123f;
    viewer.edit(look, true, "roughness");
    viewer.step(0.01);
    EXPECT_TRUE(viewer.unsavedEdits());
  }
  EXPECT_TRUE(fs::exists(recoveryPath(kCornell)));
  Viewer viewer(options());
  waitForMeshes(viewer);
  ASSERT_TRUE(viewer.recoveryFile().has_value());
  viewer.restoreRecovery();
  EXPECT_FLOAT_EQ(viewer.look().materials[0].roughness, 0.123f);
  viewer.saveEdits(folder_ / "saved.json");
  EXPECT_FALSE(viewer.unsavedEdits());
  EXPECT_FALSE(viewer.recoveryFile().has_value());
}

TEST_F(ViewerTest, SizesAndHaste) {
  for (int i = 0; i < 3; ++i) {
    Viewer viewer(options());  // closed while it opens
    for (int step = 0; step < i; ++step) viewer.step(0.001);
  }
  Viewer viewer(options());
  waitForMeshes(viewer);
  for (const auto& [width, height] : {std::pair{1u, 1u}, {3u, 200u}, {257u, 5u}, {80u, 60u}}) {
    viewer.resize(width, height);
    viewer.step(0.01);
    settle(viewer);
    EXPECT_EQ(viewer.screen().width, width);
    EXPECT_EQ(viewer.screen().rgba.size(), std::size_t{width} * height * 4);
  }
}

TEST_F(ViewerTest, CameraMovesInTheDark) {
  ViewerOptions o = options();
  o.edits = folder_ / "dark.json";
  std::ofstream file(o.edits);
  file << R"({"trex": 1, "materials": [{"index": 0, "emission": [0, 0, 0]})";
  const Model model = openModel(kCornell, {});
  for (std::size_t i = 1; i < model.scene.materials.size(); ++i) {
    file << R"(, {"index": )" << i << R"(, "emission": [0, 0, 0]})";
  }
  file << "]}";
  file.close();
  Viewer viewer(o);
  waitForMeshes(viewer);
  settle(viewer);
  Look look = viewer.look();
  look.camera.eye.x += 0.1;
  viewer.edit(look, true, "camera");
  settle(viewer);  // past the time after which photons follow a camera
  EXPECT_EQ(viewer.screen().rgba[0], 0);
}

TEST_F(ViewerTest, PausedStaysIdle) {
  Viewer viewer(options());
  waitForMeshes(viewer);
  settle(viewer);
  viewer.state().paused = true;
  Look look = viewer.look();
  look.camera.eye += dvec3(0.05, 0.0, 0.0);
  viewer.edit(look, true, "camera");
  for (int i = 0; i < 50 && !viewer.idle(); ++i) viewer.step(0.05);
  EXPECT_TRUE(viewer.idle());
  EXPECT_LT(viewer.figures().samplesPerPixel, 6.0);
}

TEST_F(ViewerTest, BadFilesAreSaid) {
  ViewerOptions o = options();
  o.input = folder_ / "missing.glb";
  Viewer viewer(o);
  for (int i = 0; i < 1000 && viewer.phase() == OpenPhase::kImporting; ++i) {
    viewer.step(0.001);
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  EXPECT_EQ(viewer.phase(), OpenPhase::kFailed);
  EXPECT_NE(viewer.message().find("missing.glb"), std::string::npos);
  EXPECT_EQ(viewer.problem(), ExitCode::kInput);
  // A good one can follow.
  viewer.open(kCornell);
  while (!viewer.idle()) viewer.step(0.01);
  EXPECT_EQ(viewer.phase(), OpenPhase::kReady);
  std::ofstream(folder_ / "bad.json") << R"({"trex": 1, "materials": [{"index": 99}]})";
  EXPECT_THROW(viewer.loadEdits(folder_ / "bad.json"), Error);
}

/// What the viewer says that makes the same picture without it reads the model as it did.
TEST_F(ViewerTest, TheCommandHasTheOptionsOfTheImport) {
  ViewerOptions o = options();
  o.input = "";
  o.import.unit = 0.001;
  o.import.zUp = true;
  o.import.pointSize = 0.25;
  o.import.scene = "my scene";
  o.import.variant = "red";
  o.import.animation = "walk";
  o.import.atSeconds = 1.5;
  o.import.defines = {"spp=4"};
  o.import.maxBounces = 3;
  const Viewer viewer(o);
  EXPECT_NE(viewer.headlessCommand("e.json", "a.exr")
                .find(" --unit 0.001 --up z --point-size 0.25 --scene 'my scene' --variant red "
                      "--animation walk --at 1.5 -D spp=4 --max-bounces 3 "),
            std::string::npos)
      << viewer.headlessCommand("e.json", "a.exr");
}

}  // namespace
}  // namespace trex
