// Bundles as they should be: the same bits back, equal bytes, sources compared.
#include <gtest/gtest.h>
#include <sys/wait.h>
#include <tbb/global_control.h>
#include <unistd.h>
#include <zstd.h>

#include <algorithm>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <random>

#include "src/core/error.h"
#include "src/core/file.h"
#include "src/scene/texture.h"
#include "src/scene/texture_cache.h"
#include "tests/unit/bundle_scene.h"
#include "tests/unit/scenes.h"

namespace trex {
namespace {

namespace fs = std::filesystem;
using test::littleFacts;
using test::littleModel;

class BundleTest : public testing::Test {
 protected:
  void SetUp() override {
    folder_ = fs::temp_directory_path() / fmt::format("trex-bundle-{}", ::getpid());
    fs::create_directories(folder_);
  }
  void TearDown() override { fs::remove_all(folder_); }
  fs::path write(const char* name, const std::string& text) const {
    std::ofstream(folder_ / name, std::ios::binary) << text;
    return folder_ / name;
  }
  fs::path folder_;
};

Model modelOf(BundleContents contents) {
  Model model;
  model.scene = std::move(contents.description.scene);
  model.rays = std::make_unique<RayScene>(model.scene, std::move(contents.parts));
  if (contents.voxels) {
    model.voxels = std::make_shared<asvo::Tree>(std::move(*contents.voxels));
  }
  return model;
}

TEST_F(BundleTest, SavingWhatWasReadGivesTheSameBytes) {
  const auto bytes = bundleBytes(littleModel(), littleFacts());
  const Model again = modelOf(test::readBuffer(bytes));
  EXPECT_EQ(again.rays->parts().shared.size(), 1u);
  EXPECT_EQ(again.rays->parts().placed.size(), 3u);
  EXPECT_TRUE(bundleBytes(again, littleFacts()) == bytes);
}

/// Of a scene of 200 km what is small has grids of its own, which a bundle keeps as well.
TEST_F(BundleTest, GridsOfTheirOwnComeBack) {
  Scene scene;
  scene.materials = {test::lambert(0.5f)};
  scene.objects = {"slab", "plate"};
  dmat4 far(1.0);
  far[3] = glm::dvec4(1e5, 0.0, 0.0, 1.0);
  test::place(scene, test::box(vec3(-1e5f, -1.0f, -10.0f), vec3(1e5f, 0.0f, 10.0f), 0, false));
  test::place(scene, test::box(vec3(-0.1f, 0.001f, -0.2f), vec3(0.1f, 0.007f, 0.2f), 0, false),
              far);
  scene.cameras = {test::lookAt(dvec3(1e5, 2.0, 0.0), dvec3(1e5, 0.0, 0.0), 0.5f)};
  ModelOptions options;
  options.voxelDepth = 3;
  options.voxels = true;
  const Model model = makeModel(std::move(scene), options);
  ASSERT_EQ(model.rays->parts().placed.size(), 2u);
  EXPECT_EQ(model.rays->statistics().instances, 0u);
  const auto bytes = bundleBytes(model, littleFacts());
  const Model again = modelOf(test::readBuffer(bytes));
  EXPECT_TRUE(bundleBytes(again, littleFacts()) == bytes);
  for (const Model* m : {&model, &again}) {
    const dvec3 above = dvec3(1e5, 1.0, 0.0) - m->rays->renderOrigin();
    RayHit hit;
    ASSERT_TRUE(m->rays->intersect(above, vec3(0, -1, 0), 0.0f, kInfinity, hit));
    const Surface s = m->rays->surface(hit);
    EXPECT_EQ(s.object, 1u);
    EXPECT_NEAR(s.position.y + m->rays->renderOrigin().y, 0.007, 1e-6);
    // From below it, the slab is a millimetre away.
    ASSERT_TRUE(
        m->rays->intersect(above - dvec3(0.0, 0.9995, 0.0), vec3(0, -1, 0), 0.0f, kInfinity, hit));
    EXPECT_NEAR(hit.t, 0.0005f, 1e-6f);
  }
}

TEST_F(BundleTest, TextsDoNotHoldTheModelsFolder) {
  const auto bytes = bundleBytes(littleModel(), littleFacts());
  const BundleContents contents = test::readBuffer(bytes);
  EXPECT_EQ(contents.description.input, "little.glb");
  ASSERT_EQ(contents.description.scene.warnings.size(), 1u);
  EXPECT_EQ(contents.description.scene.warnings[0], "little.glb: something \"odd\"");
}

TEST_F(BundleTest, KeepsEveryNumber) {
  const Scene scene = test::littleOfEverything();
  const auto bytes = bundleBytes(littleModel(), littleFacts());
  const Scene got = test::readBuffer(bytes).description.scene;
  ASSERT_EQ(got.materials.size(), scene.materials.size());
  const Material &a = got.materials[3], &b = scene.materials[3];
  EXPECT_EQ(a.name, b.name);
  EXPECT_EQ(a.attenuationDistance, b.attenuationDistance);
  EXPECT_TRUE(std::signbit(a.normalScale));
  EXPECT_EQ(a.baseColor, b.baseColor);
  EXPECT_EQ(a.alphaMode, AlphaMode::kMask);
  EXPECT_EQ(got.materials[2].baseColorTexture.wrapT, Texture::Wrap::kMirror);
  EXPECT_EQ(got.lights[0].position, scene.lights[0].position);
  EXPECT_EQ(got.lights[0].range, kInfinity);
  EXPECT_EQ(got.lights[1].range, 12.7f);
  EXPECT_EQ(got.images[0].bytes, scene.images[0].bytes);
  EXPECT_EQ(got.images[1].floats, scene.images[1].floats);
  EXPECT_EQ(got.environment.map->floats, scene.environment.map->floats);
  EXPECT_EQ(got.meshes[1].positions, scene.meshes[1].positions);
  EXPECT_EQ(got.meshes[1].triangles, scene.meshes[1].triangles);
  EXPECT_TRUE(got.meshes[2].positions.empty());
  EXPECT_EQ(got.instances[4].transform, scene.instances[4].transform);
}

/// Reads the tiles of an image of bytes by the text of FORMAT.md alone.
std::vector<std::uint8_t> bytesOfTiles(std::span<const std::byte> section, int width, int height,
                                       int channels) {
  std::vector<std::uint8_t> out(static_cast<std::size_t>(width * height * channels));
  const int rows = 4096 / (32 * channels);
  const int across = (width + 31) / 32, down = (height + rows - 1) / rows;
  std::size_t at = 40 + 16 * static_cast<std::size_t>(across * down);
  for (int tile = 0; tile < across * down; ++tile) {
    std::uint32_t length = 0;
    std::memcpy(&length, &section[40 + 16 * static_cast<std::size_t>(tile) + 8], 4);
    std::vector<std::uint8_t> texels(static_cast<std::size_t>(32 * rows * channels));
    if (length == texels.size()) {
      std::memcpy(texels.data(), &section[at], length);
    } else {
      ZSTD_decompress(texels.data(), texels.size(), &section[at], length);
    }
    at += length;
    for (int y = 0; y < rows; ++y) {
      for (int x = 0; x < 32 * channels; ++x) {
        const int i = y * 32 * channels + x;
        if (y > 0) {
          texels[static_cast<std::size_t>(i)] =
              static_cast<std::uint8_t>(texels[static_cast<std::size_t>(i)] +
                                        texels[static_cast<std::size_t>(i - 32 * channels)]);
        }
        const int row = tile / across * rows + y, byte = tile % across * 32 * channels + x;
        if (row >= height || byte >= width * channels) continue;
        out[static_cast<std::size_t>(row * width * channels + byte)] =
            texels[static_cast<std::size_t>(i)];
      }
    }
  }
  EXPECT_EQ(at, section.size());
  return out;
}

TEST_F(BundleTest, TilesOfImagesAreAsTheFormatSays) {
  Scene scene = test::littleOfEverything();
  scene.images[0] = test::noiseImage(150, 201, 3, false, 1);
  for (std::size_t i = 0; i < 20'000; ++i) scene.images[0].bytes[i] = 90;  // some that shrink
  const Image image = scene.images[0];
  const auto bytes = bundleBytes(makeModel(std::move(scene), {.voxels = false}), littleFacts(0));
  const bundle::Container container(bytes, "x.trex");
  EXPECT_EQ(bytesOfTiles(container.section("image-0.tiles"), 150, 201, 3), image.bytes);
}

TEST_F(BundleTest, ImagesBeyondTheirLimitComeInTilesAndAreBakedAgainAsTheyWere) {
  Scene scene = test::littleOfEverything();
  scene.images[0] = test::noiseImage(1000, 1001, 3, false, 1);
  const Image image = scene.images[0];
  const auto bytes = bundleBytes(makeModel(std::move(scene), {.voxels = false}), littleFacts(0));
  BundleReadOptions options;
  options.textures = std::make_shared<TextureCache>(2u << 20, 0, "/not/there");
  const Model model = modelOf(readBundle(bytes, nullptr, "x.trex", options));
  const std::vector<Image>& images = model.scene.images;
  ASSERT_TRUE(images[0].paged);
  EXPECT_FALSE(images[1].paged);  // no larger than a tile
  Texture t;
  for (int i = 0; i < 1000; ++i) {
    const vec2 uv(0.001f * static_cast<float>(i), 0.0137f * static_cast<float>(i));
    ASSERT_EQ(sampleTexture(images[0], t, uv, true), sampleTexture(image, t, uv, true));
  }
  EXPECT_LE(options.textures->statistics().peakBytes, 2u << 20);
  EXPECT_TRUE(bundleBytes(model, littleFacts(0)) == bytes);
}

/// A file that lies elsewhere: how often each of its bytes was asked for.
class Elsewhere : public hccm::PageFile {
 public:
  explicit Elsewhere(std::vector<std::byte> bytes)
      : bytes_(std::move(bytes)), asked_(bytes_.size()) {}
  void read(std::uint64_t offset, std::span<std::byte> out) const override {
    if (broken_) throw Error(ExitCode::kFailed, "nobody answers");
    ASSERT_LE(offset, bytes_.size());
    ASSERT_LE(out.size(), bytes_.size() - offset);
    for (std::byte& b : out) {
      ++asked_[offset];
      b = bytes_[offset++];
    }
  }
  void readAhead(std::uint64_t, std::uint64_t) const override {}
  std::string place(std::uint64_t offset) const override { return fmt::format("byte {}", offset); }
  int most() const { return *std::max_element(asked_.begin(), asked_.end()); }
  std::ptrdiff_t bytesAsked() const {
    return std::count_if(asked_.begin(), asked_.end(), [](int n) { return n > 0; });
  }
  void flip(std::size_t at) { bytes_[at] ^= std::byte{4}; }
  void breakOff() { broken_ = true; }

 private:
  std::vector<std::byte> bytes_;
  mutable std::vector<int> asked_;
  bool broken_ = false;
};

TEST_F(BundleTest, ComesFromElsewhereInPartsThatAreAskedForOnce) {
  // Voxels that fill hash pages of their own.
  Model room = makeModel(test::littleOfEverything(), {.voxels = true, .voxelDepth = 7});
  BakeFacts facts = littleFacts();
  facts.voxelDepth = 7;
  const auto bytes = bundleBytes(room, facts);
  OpenOptions options;
  const auto whole = std::make_shared<Elsewhere>(bytes);
  const Model again = openRemoteBundle(whole, bytes.size(), "far.trex", options);
  EXPECT_EQ(whole->most(), 1);
  EXPECT_TRUE(bundleBytes(again, facts) == bytes);
  options.model.voxels = false;
  const auto part = std::make_shared<Elsewhere>(bytes);
  EXPECT_FALSE(openRemoteBundle(part, bytes.size(), "far.trex", options).voxels);
  EXPECT_EQ(part->most(), 1);
  EXPECT_LT(part->bytesAsked(), whole->bytesAsked());
}

TEST_F(BundleTest, WhatComesFromElsewhereIsChecked) {
  const auto bytes = bundleBytes(littleModel(), littleFacts());
  const auto problem = [&](const std::shared_ptr<Elsewhere>& file, std::uint64_t size) {
    try {
      openRemoteBundle(file, size, "far.trex", {});
      return std::string();
    } catch (const Error& e) {
      return std::string(e.what());
    }
  };
  for (std::size_t at = 0; at < bytes.size(); at += bytes.size() / 97 + 1) {
    const auto file = std::make_shared<Elsewhere>(bytes);
    file->flip(at);
    EXPECT_NE(problem(file, bytes.size()).find("far.trex"), std::string::npos) << at;
  }
  EXPECT_NE(problem(std::make_shared<Elsewhere>(bytes), bytes.size() - 1), "");
  EXPECT_NE(problem(std::make_shared<Elsewhere>(bytes), 0), "");
  const auto broken = std::make_shared<Elsewhere>(bytes);
  broken->breakOff();
  EXPECT_EQ(problem(broken, bytes.size()), "nobody answers");
}

TEST_F(BundleTest, RaysMeetTheSameBits) {
  const Model source = littleModel();
  const auto bytes = bundleBytes(source, littleFacts());
  const Model baked = modelOf(test::readBuffer(bytes));
  std::mt19937 random(5);
  std::uniform_real_distribution<float> place(-3.5f, 3.5f);
  int hits = 0, instanced = 0;
  for (int i = 0; i < 20'000; ++i) {
    const vec3 origin(place(random), place(random), place(random));
    const vec3 target(place(random), place(random), place(random));
    const vec3 direction = glm::normalize(target - origin);
    RayHit a, b;
    const bool hit = source.rays->intersect(origin, direction, 0.0f, kInfinity, a);
    ASSERT_EQ(baked.rays->intersect(origin, direction, 0.0f, kInfinity, b), hit);
    if (!hit) continue;
    ASSERT_EQ(std::memcmp(&a, &b, sizeof(a)), 0) << "ray " << i;
    const Surface s = source.rays->surface(a), t = baked.rays->surface(b);
    ASSERT_EQ(std::memcmp(&s, &t, sizeof(s)), 0) << "ray " << i;
    ++hits;
    instanced += a.instance != RayScene::kWorldMesh;
  }
  EXPECT_GT(hits, 19'000);
  EXPECT_GT(instanced, 500);
}

TEST_F(BundleTest, EqualInputGivesEqualBytesForAnyThreads) {
  const auto all = bundleBytes(littleModel(), littleFacts());
  const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
  EXPECT_TRUE(bundleBytes(littleModel(), littleFacts()) == all);
}

TEST_F(BundleTest, MeshesAreUsedInTheMappedFile) {
  const fs::path path = folder_ / "x.trex";
  saveBundle(path, littleModel(), littleFacts(), [](auto, auto) { return true; });
  const auto bytes = mapFile(path);
  const BundleContents contents = readBundle(*bytes, bytes, "x.trex");
  const std::byte* at = contents.parts.shared[0].bytes().data();
  EXPECT_GE(at, bytes->data());
  EXPECT_LT(at, bytes->data() + bytes->size());
  EXPECT_EQ(reinterpret_cast<std::uintptr_t>(at) % bundle::kAlignment, 0u);
}

TEST_F(BundleTest, ViewsOfMeshesMustBeAligned) {
  const Model model = littleModel(0);
  const auto mesh = model.rays->parts().world.bytes();
  std::vector<std::byte> shifted(4);
  shifted.insert(shifted.end(), mesh.begin(), mesh.end());
  const auto view = std::span<const std::byte>(shifted).subspan(4);
  EXPECT_THROW(hccm::Mesh::fromView(view, nullptr), hccm::FormatError);
  EXPECT_NO_THROW(hccm::Mesh::fromView(mesh, nullptr));
}

TEST_F(BundleTest, InterruptedSaveLeavesNothingAndKeepsTheOldFile) {
  const fs::path path = write("x.trex", "old");
  try {
    saveBundle(path, littleModel(), littleFacts(), [](auto, auto) { return false; });
    FAIL();
  } catch (const Error& e) {
    EXPECT_EQ(e.code(), ExitCode::kInterrupted);
  }
  EXPECT_EQ(fs::file_size(path), 3u);
  EXPECT_EQ(std::distance(fs::directory_iterator(folder_), fs::directory_iterator()), 1);
}

TEST_F(BundleTest, SourcesAreComparedByContentWhereTimeDiffers) {
  const fs::path model = write("model.ply", "content");
  const fs::path target = folder_ / "x.trex";
  const auto files = hashSources({examineSource(model)}, target);
  ASSERT_EQ(files.size(), 1u);
  EXPECT_EQ(files[0].file.path, "model.ply");
  EXPECT_EQ(compareSource(target, files[0]), SourceState::kUnchanged);
  const auto time = fs::last_write_time(model);
  fs::last_write_time(model, time + std::chrono::seconds(5));
  EXPECT_EQ(compareSource(target, files[0]), SourceState::kUnchanged);
  write("model.ply", "c0ntent");
  fs::last_write_time(model, time + std::chrono::seconds(9));
  EXPECT_EQ(compareSource(target, files[0]), SourceState::kChanged);
  write("model.ply", "longer content");
  EXPECT_EQ(compareSource(target, files[0]), SourceState::kChanged);
  fs::remove(model);
  EXPECT_EQ(compareSource(target, files[0]), SourceState::kAbsent);
}

TEST_F(BundleTest, ASourceThatChangesWhileItIsBakedIsAnError) {
  const fs::path model = write("model.ply", "content");
  const SourceFile before = examineSource(model);
  write("model.ply", "other content");
  EXPECT_THROW(hashSources({before}, folder_ / "x.trex"), Error);
}

TEST_F(BundleTest, TemporariesOfDeadProcessesAreRemoved) {
  const pid_t child = ::fork();
  if (child == 0) ::_exit(0);
  ASSERT_EQ(::waitpid(child, nullptr, 0), child);
  const std::string dead = fmt::format(".x.{}.tmp.trex", child);
  const std::string alive = fmt::format(".x.{}.tmp.trex", ::getpid());
  const std::string other = fmt::format(".y.{}.tmp.trex", child);
  for (const std::string& name : {dead, alive, other}) write(name.c_str(), "rest");
  const auto removed = removeDeadTemporaries(folder_ / "x.trex");
  ASSERT_EQ(removed.size(), 1u);
  EXPECT_EQ(removed[0].filename(), dead);
  EXPECT_FALSE(fs::exists(folder_ / dead));
  EXPECT_TRUE(fs::exists(folder_ / alive));
  EXPECT_TRUE(fs::exists(folder_ / other));
}

TEST_F(BundleTest, RequirementsSayWhatIsLeftOut) {
  const auto find = [](const std::vector<bundle::Requirement>& list, const char* name) {
    const auto at =
        std::find_if(list.begin(), list.end(), [&](const auto& r) { return r.name == name; });
    EXPECT_NE(at, list.end()) << name;
    return *at;
  };
  Scene scene = test::littleOfEverything();
  const auto full = bundle::requirementsOf(scene, true);
  for (const char* name : {"normals", "texture coordinates", "textures", "transparency",
                           "environment", "voxels", "photons"}) {
    EXPECT_EQ(find(full, name).required, std::string(name) != "transparency") << name;
  }
  EXPECT_FALSE(find(full, "vertex colours").required);
  scene.materials[2] = test::lambert(0.9f);
  const auto plain = bundle::requirementsOf(scene, false);
  EXPECT_FALSE(find(plain, "texture coordinates").required);
  EXPECT_GE(find(plain, "texture coordinates").savedBytes, 4 * scene.meshes[2].positions.size());
  EXPECT_FALSE(find(plain, "voxels").required);
}

}  // namespace
}  // namespace trex
