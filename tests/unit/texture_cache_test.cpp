// Textures beyond their limit of memory: the same texels, within the limit, and errors that say so.
#include <OpenImageIO/imageio.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <cstring>
#include <filesystem>
#include <fstream>
#include <random>
#include <thread>

#include "src/core/error.h"
#include "src/scene/image_io.h"
#include "src/scene/texels.h"
#include "src/scene/texture.h"
#include "src/scene/texture_cache.h"

namespace trex {
namespace {

namespace fs = std::filesystem;

constexpr std::uint64_t kSlot = kTileBytes + 16;

/// Any values that its kind may have.
Image noise(int width, int height, int channels, TexelKind kind, unsigned seed) {
  std::mt19937 random(seed);
  Image image;
  image.name = "noise";
  image.width = width, image.height = height, image.channels = channels;
  const std::span<std::byte> all = makeTexels(image, kind);
  for (std::byte& b : all) b = static_cast<std::byte>(random());
  for (float& f : image.floats) f = static_cast<float>(random() % 1000) / 7.0f;
  for (std::uint16_t& half : image.words) half &= 0x3bffu;  // finite, for halves
  return image;
}

/// An image as it lies packed in memory.
class PackedInMemory : public TexelFile {
 public:
  explicit PackedInMemory(std::vector<std::byte> bytes) : bytes_(std::move(bytes)) {}
  void read(std::uint64_t offset, std::span<std::byte> out) const override {
    if (offset > bytes_.size() || out.size() > bytes_.size() - offset) bad(offset, "ends early");
    std::memcpy(out.data(), &bytes_[offset], out.size());
  }
  void readAhead(std::uint64_t, std::uint64_t) const override {}
  void bad(std::uint64_t offset, const std::string& what) const override {
    fail(ExitCode::kInput, "byte {}: {}", offset, what);
  }
  std::vector<std::byte>& bytes() { return bytes_; }

 private:
  std::vector<std::byte> bytes_;
};

vec2 somewhere(std::mt19937& random) {
  std::uniform_real_distribution<float> place(-2.0f, 3.0f);
  const float u = place(random);
  return {u, place(random)};
}

/// Looks both images up at the same places; how often they differ.
int differences(const Image& a, const Image& b, int count, unsigned seed) {
  std::mt19937 random(seed);
  int wrong = 0;
  for (int i = 0; i < count; ++i) {
    Texture t;
    t.wrapS = static_cast<Texture::Wrap>(random() % 3);
    t.wrapT = static_cast<Texture::Wrap>(random() % 3);
    t.nearest = random() % 4 == 0;
    t.rotation = random() % 2 == 0 ? 0.3f : 0.0f;
    const vec2 uv = somewhere(random);
    const bool srgb = random() % 2 == 0;
    if (i % 3 == 0) prefetchTexture(b, t, uv);
    if (sampleTexture(a, t, uv, srgb) != sampleTexture(b, t, uv, srgb)) ++wrong;
  }
  return wrong;
}

class Textures : public testing::Test {
 protected:
  Textures() { fs::create_directories(folder_); }
  ~Textures() override { fs::remove_all(folder_); }
  std::shared_ptr<TextureCache> cache(std::uint64_t limit) const {
    return std::make_shared<TextureCache>(limit, 0, folder_);
  }
  const fs::path folder_ = fs::temp_directory_path() / fmt::format("trex-textures-{}", ::getpid());
};

TEST_F(Textures, ReadTheSameThroughTilesWhateverTheirKindAndSize) {
  unsigned seed = 0;
  for (const TexelKind kind : {TexelKind::kByte, TexelKind::kWord, TexelKind::kSrgbWord,
                               TexelKind::kHalf, TexelKind::kFloat}) {
    for (int channels = 1; channels <= 4; ++channels) {
      for (const ivec2& size :
           {ivec2(300, 211), ivec2(64, 512), ivec2(1, 20'000), ivec2(9999, 3)}) {
        const Image whole = noise(size.x, size.y, channels, kind, ++seed);
        Scene scene;
        // Room for a part of the largest alone; a second image so that there is something to evict.
        scene.textures = cache(TextureCache::kLeastPool + 700'000);
        addImage(scene, whole);
        addImage(scene, noise(1024, 1024, 4, TexelKind::kByte, 77));
        ASSERT_TRUE(scene.images[0].paged || wholeTexels(whole).size() <= kTileBytes);
        EXPECT_EQ(texelKind(scene.images[0]), kind);
        EXPECT_EQ(differences(whole, scene.images[0], 2000, seed), 0)
            << int(kind) << " " << channels << " " << size.x << "x" << size.y;
        for (const bool srgb : {false, true}) {
          EXPECT_EQ(textureMean(scene.images[0], srgb), textureMean(whole, srgb));
        }
        const Image again = inMemory(scene.images[0]);
        const auto a = wholeTexels(whole), b = wholeTexels(again);
        EXPECT_TRUE(std::equal(a.begin(), a.end(), b.begin(), b.end()));
      }
    }
  }
}

TEST_F(Textures, StayInMemoryWhileTheyFit) {
  Scene scene;
  scene.textures = cache(3u << 20);
  for (unsigned i = 0; i < 3; ++i) addImage(scene, noise(512, 512, 4, TexelKind::kByte, i));
  for (const Image& image : scene.images) EXPECT_FALSE(image.paged);
  EXPECT_EQ(scene.textures->statistics().peakBytes, 3u << 20);
  // One more, and all but the smallest go.
  addImage(scene, noise(16, 16, 4, TexelKind::kByte, 9));
  ASSERT_EQ(scene.images.size(), 4u);
  for (int i = 0; i < 3; ++i) EXPECT_TRUE(scene.images[static_cast<std::size_t>(i)].paged);
  EXPECT_FALSE(scene.images[3].paged);
  EXPECT_EQ(scene.textures->statistics().pagedImages, 3u);
  EXPECT_EQ(scene.textures->statistics().texelBytes, (3u << 20) + 1024u);
}

TEST_F(Textures, KeepToTheirLimitAndReadNoTileTwiceThatFits) {
  const Image whole = noise(1024, 1024, 4, TexelKind::kByte, 5);  // 1024 tiles
  for (const std::uint64_t limit : {std::uint64_t{3} << 19, std::uint64_t{8} << 20}) {
    Scene scene;
    scene.textures = cache(limit);
    addImage(scene, whole);
    addImage(scene, noise(2048, 1024, 4, TexelKind::kByte, 6));
    ASSERT_TRUE(scene.images[0].paged);
    EXPECT_EQ(differences(whole, scene.images[0], 20'000, 3), 0);
    const TextureCache::Statistics s = scene.textures->statistics();
    EXPECT_LE(s.peakBytes, limit);
    EXPECT_GT(s.peakBytes, limit < (5u << 20) ? limit - 2 * kSlot : 1024 * kSlot);
    EXPECT_EQ(s.evictions > 0, limit < (5u << 20));
    EXPECT_EQ(s.loads, s.evictions > 0 ? s.loads : 1024u);
    EXPECT_GT(s.bytesRead, 0u);
  }
}

TEST_F(Textures, AreRightForManyThreadsThatEvictEachOthersTiles) {
  Scene scene;
  scene.textures = cache(TextureCache::kLeastPool + 200'000);
  std::vector<Image> whole;
  for (unsigned i = 0; i < 3; ++i) {
    whole.push_back(noise(700, 500, 3 + int(i % 2), TexelKind::kByte, i));
    addImage(scene, whole.back());
  }
  std::atomic<int> wrong{0};
  std::vector<std::jthread> threads;
  for (unsigned t = 0; t < 8; ++t) {
    threads.emplace_back([&, t] {
      for (unsigned i = 0; i < 6; ++i) {
        const unsigned which = (t + i) % 3;
        wrong += differences(whole[which], scene.images[which], 1500, 100 * t + i);
      }
    });
  }
  threads.clear();
  EXPECT_EQ(wrong, 0);
  EXPECT_GT(scene.textures->statistics().evictions, 1000u);
}

TEST_F(Textures, ThatGoOutLeaveTheirPlaces) {
  Scene scene;
  scene.textures = cache(2u << 20);
  for (unsigned i = 0; i < 3; ++i) addImage(scene, noise(512, 512, 4, TexelKind::kByte, i));
  for (const Image& image : scene.images) differences(image, image, 500, 1);
  const std::uint64_t before = scene.textures->statistics().evictions;
  scene.images.resize(1);
  scene.textures->admit(scene.images);
  EXPECT_EQ(differences(noise(512, 512, 4, TexelKind::kByte, 0), scene.images[0], 3000, 2), 0);
  EXPECT_EQ(scene.textures->statistics().evictions, before);
}

TEST_F(Textures, ThatCannotKeepToTheLimitSaySo) {
  Scene scene;
  scene.textures = cache(TextureCache::kLeastPool - 1);
  try {
    addImage(scene, noise(1024, 1024, 4, TexelKind::kByte, 1));
    FAIL();
  } catch (const Error& e) {
    EXPECT_EQ(e.code(), ExitCode::kMemoryOrDevice);
    EXPECT_NE(std::string(e.what()).find("--texture-memory"), std::string::npos) << e.what();
  }
  scene = {};
  scene.textures = std::make_shared<TextureCache>(2u << 20, 0, folder_ / "not there");
  try {
    addImage(scene, noise(1024, 1024, 4, TexelKind::kByte, 1));
    FAIL();
  } catch (const Error& e) {
    EXPECT_EQ(e.code(), ExitCode::kOutput);
    EXPECT_NE(std::string(e.what()).find("not there"), std::string::npos) << e.what();
  }
}

TEST_F(Textures, ThatAreDamagedAreNeverShown) {
  const Image whole = noise(200, 300, 3, TexelKind::kByte, 8);
  const std::vector<std::byte> good = packTiles(whole);
  std::mt19937 random(4);
  for (int i = 0; i < 300; ++i) {
    const auto file = std::make_shared<PackedInMemory>(good);
    const std::size_t at = random() % good.size();
    file->bytes()[at] ^= static_cast<std::byte>(1u << random() % 8);
    const auto readAll = [&] {
      const PagedTexels paged(whole, TexelKind::kByte, file, 0, good.size(), nullptr);
      Image out = whole;
      paged.whole(out);
    };
    EXPECT_THROW(readAll(), Error) << at;
  }
  for (const std::size_t size :
       {std::size_t{0}, std::size_t{39}, std::size_t{100}, good.size() - 1}) {
    const auto file = std::make_shared<PackedInMemory>(
        std::vector<std::byte>(good.begin(), good.begin() + std::ptrdiff_t(size)));
    EXPECT_THROW(PagedTexels(whole, TexelKind::kByte, file, 0, size, nullptr), Error) << size;
  }
  // Damage after the table was read, as of a file that is cut off meanwhile.
  const auto file = std::make_shared<PackedInMemory>(good);
  const auto pool = cache(4u << 20);
  Image image = whole;
  image.bytes.clear();
  image.paged =
      std::make_shared<const PagedTexels>(whole, TexelKind::kByte, file, 0, good.size(), pool);
  std::vector<Image> images = {image};
  pool->admit(images);
  file->bytes().resize(good.size() / 2);
  EXPECT_EQ(sampleTexture(image, {}, {0.1f, 0.01f}, true),
            sampleTexture(whole, {}, {0.1f, 0.01f}, true));
  for (int i = 0; i < 2; ++i) EXPECT_THROW(sampleTexture(image, {}, {0.9f, 0.99f}, true), Error);
}

TEST_F(Textures, OfSixteenBitsStaySoAndMeanWhatTheyMeantAsFloats) {
  const std::vector<std::uint16_t> all = [] {
    std::vector<std::uint16_t> out(65536);
    for (std::size_t i = 0; i < out.size(); ++i) out[i] = static_cast<std::uint16_t>(i);
    return out;
  }();
  for (const bool half : {false, true}) {
    const std::string path = (folder_ / (half ? "deep.exr" : "deep.png")).string();
    const OIIO::TypeDesc type = half ? OIIO::TypeDesc::HALF : OIIO::TypeDesc::UINT16;
    const auto out = OIIO::ImageOutput::create(path);
    ASSERT_TRUE(out && out->open(path, OIIO::ImageSpec(256, 256, 1, type)));
    ASSERT_TRUE(out->write_image(type, all.data()) && out->close());
    std::vector<float> floats(65536);
    const auto in = OIIO::ImageInput::open(path);
    ASSERT_TRUE(in && in->read_image(0, 0, 0, 1, OIIO::TypeDesc::FLOAT, floats.data()));
    for (const bool srgb : {false, true}) {
      const Image image =
          detail::decodeImage(detail::readWholeFile(path, "test"), "test", srgb, nullptr);
      EXPECT_EQ(image.words.size(), 65536u);
      EXPECT_TRUE(image.floats.empty());
      const Texture exact{.image = 0, .nearest = true};
      for (int i = 0; i < 65536; ++i) {
        const vec2 uv((float(i % 256) + 0.5f) / 256.0f, (float(i / 256) + 0.5f) / 256.0f);
        float wanted = std::isfinite(floats[std::size_t(i)]) ? floats[std::size_t(i)] : 0.0f;
        if (srgb && !half) wanted = decodeSrgb(wanted);
        ASSERT_EQ(sampleTexture(image, exact, uv, false).x, wanted) << i << half << srgb;
      }
    }
  }
}

TEST_F(Textures, LargerThanTheMemoryLeftAreRefusedBeforeTheyAreDecoded) {
  const std::string path = (folder_ / "large.png").string();
  const auto out = OIIO::ImageOutput::create(path);
  ASSERT_TRUE(out && out->open(path, OIIO::ImageSpec(2048, 2048, 3, OIIO::TypeDesc::UINT8)));
  const std::vector<std::uint8_t> black(2048 * 2048 * 3);
  ASSERT_TRUE(out->write_image(OIIO::TypeDesc::UINT8, black.data()) && out->close());
  const TextureCache small(1u << 20, 1u << 20, folder_);
  try {
    detail::decodeImage(detail::readWholeFile(path, "test"), "large.png", true, &small);
    FAIL();
  } catch (const Error& e) {
    EXPECT_EQ(e.code(), ExitCode::kMemoryOrDevice);
    EXPECT_TRUE(std::string(e.what()).starts_with("large.png")) << e.what();
  }
}

}  // namespace
}  // namespace trex
