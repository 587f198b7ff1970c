// Images that are light, by the standards of their files: .hdr in every order and coding, windows,
// primaries and odd channels of .exr, whole numbers; and images that are colours and numbers both.
#include <OpenImageIO/imageio.h>

#include <array>
#include <cmath>

#include "src/scene/chromaticities.h"
#include "src/scene/image_io.h"
#include "src/scene/input_file.h"
#include "src/scene/texels.h"
#include "src/scene/texture.h"
#include "tests/unit/scene_helpers.h"

namespace trex::test {
namespace {

using Bytes = std::vector<std::uint8_t>;

class SceneLightImages : public SceneTest {
 protected:
  std::vector<float> light(const std::string& name, const std::string& bytes) const {
    return parseEnvironment(write(name, bytes).string()).map->floats;
  }
  std::string refusal(const std::string& name, const std::string& bytes) const {
    try {
      light(name, bytes);
    } catch (const Error& e) {
      EXPECT_EQ(e.code(), ExitCode::kInput);
      return e.what();
    }
    return "none";
  }
  /// Writes floats with OpenImageIO, and reads them as light.
  Image written(const std::string& name, const OIIO::ImageSpec& spec, const void* values,
                OIIO::TypeDesc type = OIIO::TypeDesc::FLOAT) const {
    const std::string path = (folder_ / name).string();
    auto out = OIIO::ImageOutput::create(path);
    EXPECT_TRUE(out && out->open(path, spec));
    EXPECT_TRUE(out->write_image(type, values));
    out->close();
    return *parseEnvironment(path).map;
  }
};

/// Width times height texels in rows from the top: number k has the colours k + 1, 2, 4 of 2^-4.
Bytes texels(int count) {
  Bytes out;
  for (int k = 0; k < count; ++k) {
    out.insert(out.end(), {std::uint8_t(16 * (k + 1)), 32, 64, 128});
  }
  return out;
}
std::string text(const Bytes& bytes) { return {bytes.begin(), bytes.end()}; }
constexpr const char* kHead = "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n";

/// The red of texels in sixteenths less one: their numbers.
std::vector<int> numbers(const std::vector<float>& floats) {
  std::vector<int> out;
  for (std::size_t i = 0; i < floats.size(); i += 3) {
    out.push_back(int(std::lround(floats[i] * 16.0f)) - 1);
    EXPECT_EQ(floats[i + 1], 0.125f);
    EXPECT_EQ(floats[i + 2], 0.25f);
  }
  return out;
}

TEST_F(SceneLightImages, HdrOfAllEightOrders) {
  const std::string six = text(texels(6));  // 3 wide, 2 high where rows are written
  using Numbers = std::vector<int>;
  const auto read = [&](const std::string& order) {
    return numbers(light("a.hdr", kHead + order + "\n" + six));
  };
  EXPECT_EQ(read("-Y 2 +X 3"), (Numbers{0, 1, 2, 3, 4, 5}));
  EXPECT_EQ(read("-Y 2 -X 3"), (Numbers{2, 1, 0, 5, 4, 3}));
  EXPECT_EQ(read("+Y 2 +X 3"), (Numbers{3, 4, 5, 0, 1, 2}));
  EXPECT_EQ(read("+Y 2 -X 3"), (Numbers{5, 4, 3, 2, 1, 0}));
  // Columns of two, from the left: 0 1, 2 3, 4 5.
  EXPECT_EQ(read("+X 3 -Y 2"), (Numbers{0, 2, 4, 1, 3, 5}));
  EXPECT_EQ(read("+X 3 +Y 2"), (Numbers{1, 3, 5, 0, 2, 4}));
  EXPECT_EQ(read("-X 3 -Y 2"), (Numbers{4, 2, 0, 5, 3, 1}));
  EXPECT_EQ(read("-X 3 +Y 2"), (Numbers{5, 3, 1, 4, 2, 0}));
}

TEST_F(SceneLightImages, HdrOfAllThreeCodings) {
  const std::string head = std::string(kHead) + "-Y 1 +X 9\n";
  const std::vector<int> wanted = {0, 0, 0, 0, 0, 0, 0, 1, 2};
  const Bytes one = {16, 32, 64, 128}, two = {32, 32, 64, 128}, three = {48, 32, 64, 128};
  std::string plain;
  for (int i = 0; i < 7; ++i) plain += text(one);
  EXPECT_EQ(numbers(light("plain.hdr", head + plain + text(two) + text(three))), wanted);
  EXPECT_EQ(
      numbers(light("old.hdr", head + text(one) + text({1, 1, 1, 6}) + text(two) + text(three))),
      wanted);
  const Bytes runs = {2, 2, 0, 9, 128 + 7, 16, 2, 32, 48, 128 + 9, 32, 128 + 9, 64, 128 + 9, 128};
  EXPECT_EQ(numbers(light("new.hdr", head + text(runs))), wanted);
  // A run of the old way whose length has sixteen bits.
  const std::string wide =
      std::string(kHead) + "-Y 1 +X 259\n" + text(one) + text({1, 1, 1, 2}) + text({1, 1, 1, 1});
  EXPECT_EQ(numbers(light("wide.hdr", wide)), std::vector<int>(259, 0));
}

TEST_F(SceneLightImages, HdrExposuresAndXyz) {
  setLogLevel(LogLevel::kQuiet);
  const std::string one = "-Y 1 +X 1\n" + text({16, 32, 64, 128});
  const auto floats =
      light("a.hdr",
            "#?RGBE\nEXPOSURE=2\nEXPOSURE= 4\nCOLORCORR=1 2 0.5\nFORMAT=32-bit_rle_rgbe\n\n" + one);
  EXPECT_EQ(floats, (std::vector<float>{0.0625f / 8, 0.125f / 16, 0.25f / 4}));
  EXPECT_EQ(light("b.hdr", "#?RADIANCE\nEXPOSURE=nan\nEXPOSURE=0\nEXPOSURE=x\n\n" + one),
            (std::vector<float>{0.0625f, 0.125f, 0.25f}));
  // D65's white in XYZ, rounded to bytes.
  const auto white = light("c.hdr", "#?RADIANCE\r\nFORMAT=32-bit_rle_xyze\r\n\r\n-Y 1 +X 1\r\n" +
                                        text({122, 128, 139, 128}));
  for (const float c : white) EXPECT_NEAR(c, 0.5f, 0.01f);
}

TEST_F(SceneLightImages, HdrThatIsBroken) {
  for (const char* bad :
       {"#?RADIANCE", "#?RADIANCE\n\n", "#?RADIANCE\n\n-Y 0 +X 1\n", "#?RADIANCE\n\n-Y 1 +Y 1\n",
        "#?RADIANCE\n\n-Y 100000000 +X 100000000\n", "#?RADIANCE\n\n-Y 1 +X 2\nabcd",
        "#?RADIANCE\nFORMAT=16-bit\n\n-Y 1 +X 1\nabcd", "#?RADIANCE\n\n-Y 1 +X 2\n\1\1\1\1abcd",
        "#?RADIANCE\n\n-Y 1 +X 2\nabcd\1\1\1\7", "#?RADIANCE\n\n-Y 30000 +X 30000\nabcd"}) {
    EXPECT_NE(refusal("a.hdr", bad), "none") << bad;
  }
  const std::string head = std::string(kHead) + "-Y 1 +X 9\n";
  for (const Bytes& bad : {Bytes{2, 2, 0, 8}, Bytes{2, 2, 0, 9, 128 + 10, 1}, Bytes{2, 2, 0, 9, 0},
                           Bytes{2, 2, 0, 9, 9, 1, 2}}) {
    EXPECT_NE(refusal("b.hdr", head + text(bad)), "none");
  }
  // What it says of a file is text.
  const std::string said = refusal("t.hdr", "#?RADIANCE\nFORMAT=\xff\xfe\n\n");
  EXPECT_NE(said.find("format"), said.npos);
  EXPECT_EQ(detail::utf8Of(said), said);
  // Every place where a good file may be cut off.
  const std::string good = std::string(kHead) + "-Y 2 +X 3\n" + text(texels(6));
  for (std::size_t n = 2; n < good.size(); ++n) {
    EXPECT_NE(refusal("c.hdr", good.substr(0, n)), "none") << n;
  }
}

TEST_F(SceneLightImages, TexturesOfHdrAreTheSame) {
  const std::string file = std::string(kHead) + "+Y 2 +X 3\n" + text(texels(6));
  const Image image = detail::decodeImage(Bytes(file.begin(), file.end()), "a", true, nullptr);
  EXPECT_EQ(image.channels, 3);
  EXPECT_EQ(numbers(image.floats), (std::vector<int>{3, 4, 5, 0, 1, 2}));
}

TEST_F(SceneLightImages, WindowsOfExr) {
  OIIO::ImageSpec spec(2, 1, 3, OIIO::TypeDesc::FLOAT);
  const float values[6] = {1, 2, 3, 4, 5, 6};
  spec.full_width = 3, spec.full_height = 2;
  spec.x = 1, spec.y = 1;
  Image cropped = written("crop.exr", spec, values);
  EXPECT_EQ(cropped.width, 3);
  EXPECT_EQ(cropped.height, 2);
  EXPECT_EQ(cropped.floats, (std::vector<float>{0, 0, 0, 0, 0, 0, 0, 0, 0,  //
                                                0, 0, 0, 1, 2, 3, 4, 5, 6}));
  spec.x = -1, spec.y = 0, spec.full_width = 1, spec.full_height = 1;
  EXPECT_EQ(written("over.exr", spec, values).floats, (std::vector<float>{4, 5, 6}));
  spec.x = spec.full_x = 100, spec.y = spec.full_y = -7, spec.full_width = 2;
  EXPECT_EQ(written("off.exr", spec, values).floats, (std::vector<float>{1, 2, 3, 4, 5, 6}));
  spec.x = 500;
  EXPECT_EQ(written("apart.exr", spec, values).floats, std::vector<float>(6, 0.0f));
}

TEST_F(SceneLightImages, ChannelsOfExr) {
  setLogLevel(LogLevel::kQuiet);
  const float values[8] = {1, 2, 3, 4, 5, 6, 7, 8};
  const auto read = [&](const std::vector<std::string>& names) {
    OIIO::ImageSpec spec(1, 1, int(names.size()), OIIO::TypeDesc::FLOAT);
    spec.channelnames = names;
    return written("a.exr", spec, values).floats;
  };
  EXPECT_EQ(read({"Y", "A"}), (std::vector<float>{1, 1, 1}));
  EXPECT_EQ(read({"red", "green", "blue"}), (std::vector<float>{1, 2, 3}));
  EXPECT_EQ(read({"r", "g", "b"}), (std::vector<float>{1, 2, 3}));
  OIIO::ImageSpec counts(1, 1, 3, OIIO::TypeDesc::UINT);
  const std::uint32_t whole[3] = {1, 20, 300};
  const auto floats = written("u.exr", counts, whole, OIIO::TypeDesc::UINT).floats;
  for (int c = 0; c < 3; ++c) EXPECT_NEAR(floats[c], float(whole[c]), 1e-3f * float(whole[c]));
  // A texture takes its colours by their names too.
  OIIO::ImageSpec spec(1, 1, 5, OIIO::TypeDesc::FLOAT);
  spec.channelnames = {"Z", "beauty.R", "beauty.G", "beauty.B", "beauty.A"};
  written("t.exr", spec, values);
  const Bytes file = detail::readWholeFile(folder_ / "t.exr", "t");
  EXPECT_EQ(detail::decodeImage(file, "t", true, nullptr).floats, (std::vector<float>{2, 3, 4, 5}));
}

/// White stays white, and ACEScg becomes Rec. 709 by the matrix that is published for Bradford's
/// adaptation (three digits of it).
TEST_F(SceneLightImages, PrimariesOfExr) {
  setLogLevel(LogLevel::kQuiet);
  const float acescg[8] = {0.713f, 0.293f, 0.165f, 0.830f, 0.128f, 0.044f, 0.32168f, 0.33767f};
  const glm::dmat3 wanted = glm::transpose(glm::dmat3(1.70505, -0.62179, -0.08326,  //
                                                      -0.13026, 1.14080, -0.01055,  //
                                                      -0.02400, -0.12897, 1.15297));
  OIIO::ImageSpec spec(2, 1, 3, OIIO::TypeDesc::FLOAT);
  spec.attribute("chromaticities", OIIO::TypeDesc(OIIO::TypeDesc::FLOAT, 8), acescg);
  const float values[6] = {1, 1, 1, 0.8f, 0.5f, 0.3f};
  const auto floats = written("a.exr", spec, values).floats;
  const dvec3 color = wanted * dvec3(0.8, 0.5, 0.3);
  for (int c = 0; c < 3; ++c) {
    EXPECT_NEAR(floats[c], 1.0f, 1e-4f);
    EXPECT_NEAR(floats[3 + c], color[c], 1e-3);
  }
  for (const float bad : {0.0f, std::nanf(""), 1e30f}) {
    const float line[8] = {bad, bad, bad, bad, bad, bad, bad, bad};
    spec.attribute("chromaticities", OIIO::TypeDesc(OIIO::TypeDesc::FLOAT, 8), line);
    EXPECT_EQ(written("b.exr", spec, values).floats, std::vector<float>(values, values + 6));
  }
  const detail::Chromaticities same = detail::kRec709;
  for (int c = 0; c < 3; ++c) {
    for (int r = 0; r < 3; ++r) EXPECT_NEAR(detail::toRec709(same)[c][r], c == r, 1e-12);
  }
}

TEST_F(SceneLightImages, WhatIsInfiniteIsTheLargestHalf) {
  setLogLevel(LogLevel::kQuiet);
  const OIIO::ImageSpec spec(1, 1, 3, OIIO::TypeDesc::HALF);
  const float values[3] = {INFINITY, -INFINITY, std::nanf("")};
  EXPECT_EQ(written("a.exr", spec, values).floats, (std::vector<float>{65504, 0, 0}));
}

TEST_F(SceneLightImages, WholeNumbersAreDecoded) {
  const OIIO::ImageSpec spec(1, 1, 3, OIIO::TypeDesc::UINT8);
  const std::uint8_t values[3] = {0, 188, 255};
  const auto bytes = written("a.png", spec, values, OIIO::TypeDesc::UINT8).floats;
  for (int c = 0; c < 3; ++c) EXPECT_NEAR(bytes[c], decodeSrgb8(values[c]), 1e-6f);
  const OIIO::ImageSpec wide(1, 1, 3, OIIO::TypeDesc::UINT16);
  const std::uint16_t words[3] = {0, 188 * 257, 65535};
  const auto read = written("b.png", wide, words, OIIO::TypeDesc::UINT16).floats;
  for (int c = 0; c < 3; ++c) EXPECT_NEAR(read[c], decodeSrgb8(values[c]), 1e-6f);
  // Of Mitsuba and pbrt too.
  const Scene mitsuba =
      import("a.xml",
             "<scene version=\"3.0.0\"><shape type=\"rectangle\"/>"
             "<emitter type=\"envmap\"><string name=\"filename\" value=\"a.png\"/>"
             "</emitter></scene>");
  EXPECT_EQ(mitsuba.environment.map->floats, bytes);
  written("a.jpg", OIIO::ImageSpec(8, 8, 3, OIIO::TypeDesc::UINT8), Bytes(192, 188).data(),
          OIIO::TypeDesc::UINT8);
  const Scene pbrt = import("a.pbrt",
                            "WorldBegin\nLightSource \"infinite\" \"string filename\" \"a.jpg\"\n"
                            "Shape \"sphere\"\n");
  EXPECT_NEAR(pbrt.environment.map->floats[0], decodeSrgb8(188), 0.01f);
}

/// 2 times 2 texels of 16 bits a channel, all alike.
std::string wordsPng(const std::filesystem::path& folder, std::uint16_t value) {
  const std::string path = (folder / "words.png").string();
  auto out = OIIO::ImageOutput::create(path);
  const std::vector<std::uint16_t> values(12, value);
  EXPECT_TRUE(out && out->open(path, OIIO::ImageSpec(2, 2, 3, OIIO::TypeDesc::UINT16)));
  EXPECT_TRUE(out->write_image(OIIO::TypeDesc::UINT16, values.data()));
  out->close();
  const Bytes bytes = detail::readWholeFile(path, "test");
  return {bytes.begin(), bytes.end()};
}

class SceneWords : public SceneTest {
 protected:
  void expectBoth(const Scene& s) const {
    const Material& m = s.materials[s.meshes[0].material];
    const auto at = [&](const Texture& t, bool srgb) {
      return sampleTexture(s.images[t.image], t, {0.5f, 0.5f}, srgb).y;
    };
    ASSERT_TRUE(m.baseColorTexture.present() && m.metallicRoughnessTexture.present());
    EXPECT_NEAR(at(m.baseColorTexture, true), decodeSrgb(kValue / 65535.0f), 1e-4f);
    EXPECT_NEAR(at(m.metallicRoughnessTexture, false), kValue / 65535.0f, 2e-3f);
  }
  static constexpr std::uint16_t kValue = 20000;
};

TEST_F(SceneWords, OneImageOfColoursAndOfNumbers) {
  const std::string png = wordsPng(folder_, kValue);
  for (const char* maps :
       {"map_Kd words.png\nmap_Pr words.png\n", "map_Pr words.png\nmap_Kd words.png\n"}) {
    write("m.mtl", std::string("newmtl m\nKd 1 1 1\n") + maps);
    expectBoth(import("m.obj",
                      "mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0\nvt 0 0\nusemtl m\n"
                      "f 1/1 2/1 3/1\n"));
  }
  GlbBuilder b = triangleGlb();
  b.doc["meshes"][0]["primitives"][0]["material"] = 0;
  b.doc["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_0"] =
      b.floats({0, 0, 1, 0, 0, 1}, "VEC2");
  b.doc["images"] = {{{"bufferView", b.view(png)}, {"mimeType", "image/png"}}};
  b.doc["textures"] = {{{"source", 0}}};
  const json info = {{"index", 0}};
  b.doc["materials"] = {
      {{"pbrMetallicRoughness", {{"baseColorTexture", info}, {"metallicRoughnessTexture", info}}}}};
  const Scene s = import("a.glb", b.glb());
  EXPECT_EQ(s.images.size(), 2u);
  expectBoth(s);
  // Of 8 bits one image serves both.
  b.doc["images"] = {{{"bufferView", b.view(tinyPng())}, {"mimeType", "image/png"}}};
  b.doc["buffers"] = json::array({{{"byteLength", b.bin.size()}}});
  EXPECT_EQ(import("b.glb", b.glb()).images.size(), 1u);
}

TEST_F(SceneWords, PowersOfPbrt) {
  wordsPng(folder_, kValue);
  const auto colorOf = [&](const std::string& encoding) {
    const Scene s =
        import("a.pbrt",
               "WorldBegin\nTexture \"n\" \"spectrum\" \"imagemap\" \"string filename\" "
               "\"words.png\" \"string encoding\" \"linear\"\n"
               "Texture \"t\" \"spectrum\" \"imagemap\" \"string filename\" \"words.png\" "
               "\"string encoding\" \"" +
                   encoding +
                   "\"\n"
                   "Material \"diffuse\" \"texture reflectance\" \"t\"\nShape \"sphere\"\n");
    const Texture& t = s.materials[s.meshes[0].material].baseColorTexture;
    return sampleTexture(s.images[t.image], t, {0.5f, 0.5f}, true).x;
  };
  constexpr float kShare = kValue / 65535.0f;
  EXPECT_NEAR(colorOf("linear"), kShare, 1e-4f);
  EXPECT_NEAR(colorOf("sRGB"), decodeSrgb(kShare), 1e-4f);
  EXPECT_NEAR(colorOf("gamma 2.2"), std::pow(kShare, 2.2f), 1e-4f);
}

}  // namespace
}  // namespace trex::test
