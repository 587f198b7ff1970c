// PLY, OBJ, textures, cameras, environments.
#include <OpenImageIO/imageio.h>
#include <zlib.h>

#include <bit>

#include "src/scene/texture.h"
#include "tests/unit/scene_helpers.h"

namespace trex::test {
namespace {

class ScenePly : public SceneTest {};
class SceneObj : public SceneTest {};
class SceneEnvironment : public SceneTest {};
class ScenePacked : public SceneTest {
 protected:
  std::filesystem::path pack(const std::string& name, const std::string& bytes) const {
    gzFile file = gzopen((folder_ / name).c_str(), "wb");
    EXPECT_EQ(gzwrite(file, bytes.data(), unsigned(bytes.size())), int(bytes.size()));
    EXPECT_EQ(gzclose(file), Z_OK);
    return folder_ / name;
  }
  std::string refusal(const std::filesystem::path& path) const {
    try {
      importScene(path);
    } catch (const Error& e) {
      EXPECT_EQ(e.code(), ExitCode::kInput);
      return e.what();
    }
    return "none";
  }
};

/// Appends a value in the byte order asked for.
template <typename T>
void put(std::string& out, T value, bool big) {
  std::string bytes(reinterpret_cast<const char*>(&value), sizeof value);
  if (big == (std::endian::native == std::endian::little)) {
    bytes = std::string(bytes.rbegin(), bytes.rend());
  }
  out += bytes;
}

TEST_F(ScenePly, AsciiWithEverything) {
  const Scene s = import("a.ply",
                         "ply\nformat ascii 1.0\ncomment hello\nelement vertex 4\n"
                         "property float x\nproperty float y\nproperty float z\n"
                         "property float nx\nproperty float ny\nproperty float nz\n"
                         "property float s\nproperty float t\n"
                         "property uchar red\nproperty uchar green\nproperty uchar blue\n"
                         "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
                         "0 0 0 0 0 1 0 0 255 0 188\n1 0 0 0 0 1 1 0 0 0 0\n"
                         "1 1 0 0 0 1 1 1 0 0 0\n0 1 0 0 0 2 0 1 0 0 0\n4 0 1 2 3");
  const Mesh& m = s.meshes[0];
  ASSERT_EQ(m.triangles.size(), 2u);
  EXPECT_EQ(m.triangles[1], glm::uvec3(0, 2, 3));
  EXPECT_EQ(m.texCoords[0], vec2(0, 1));  // rows are counted from the top here
  EXPECT_EQ(m.normals[3], vec3(0, 0, 1));
  EXPECT_EQ(m.colors[0], glm::u8vec4(255, 0, 188, 255));  // as they are: sRGB
  EXPECT_EQ(s.materials[0].baseColor, vec4(1));
  EXPECT_EQ(s.materials[0].specular, 0.0f);
}

TEST_F(ScenePly, BinaryOfBothByteOrdersAndAllListTypes) {
  for (const bool big : {false, true}) {
    for (const std::string type : {"uchar", "short", "ushort", "int", "uint"}) {
      std::string file = std::string("ply\nformat binary_") + (big ? "big" : "little") +
                         "_endian 1.0\nelement extra 1\nproperty list uchar float k\n"
                         "element vertex 3\nproperty float x\nproperty short skipped\n"
                         "property double y\nproperty float z\nelement face 1\n"
                         "property uchar flags\nproperty list uint " +
                         type + " vertex_index\nend_header\n";
      put<std::uint8_t>(file, 2, big);
      put<float>(file, 1, big);
      put<float>(file, 2, big);
      for (int v = 0; v < 3; ++v) {
        put<float>(file, v == 1 ? 2.0f : 0.0f, big);
        put<std::int16_t>(file, 99, big);
        put<double>(file, v == 2 ? 3.0 : 0.0, big);
        put<float>(file, 0, big);
      }
      put<std::uint8_t>(file, 1, big);
      put<std::uint32_t>(file, 3, big);
      for (int v = 0; v < 3; ++v) {
        if (type == "uchar") put<std::uint8_t>(file, std::uint8_t(v), big);
        if (type == "short" || type == "ushort") put<std::int16_t>(file, std::int16_t(v), big);
        if (type == "int" || type == "uint") put<std::int32_t>(file, v, big);
      }
      const Scene s = import("a.ply", file);
      EXPECT_EQ(s.meshes[0].triangles[0], glm::uvec3(0, 1, 2)) << type << big;
      EXPECT_EQ(s.meshes[0].positions[2], vec3(0, 3, 0)) << type << big;
      EXPECT_TRUE(anyWarning(s, "extra"));
    }
  }
}

TEST_F(ScenePly, DoublesFarAwayKeepTheirDetail) {
  const Scene s = import("a.ply",
                         "ply\nformat ascii 1.0\nelement vertex 3\nproperty double x\n"
                         "property double y\nproperty double z\nelement face 1\n"
                         "property list uchar int vertex_indices\nend_header\n"
                         "5000000.001 0 0\n5000000.002 0 0\n5000000.001 1 0\n3 0 1 2\n");
  const Box3d b = s.bounds();
  EXPECT_NEAR(b.upper.x - b.lower.x, 0.001, 1e-7);
  EXPECT_NEAR(b.lower.x, 5000000.001, 1e-6);
}

TEST_F(ScenePly, NonFiniteVerticesDropTheirTriangles) {
  const Scene s = import("a.ply",
                         "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\n"
                         "property float y\nproperty float z\nelement face 2\n"
                         "property list uchar int vertex_indices\nend_header\n"
                         "0 0 0\n1 0 0\n0 1 0\nnan 0 inf\n3 0 1 2\n3 0 1 3\n");
  EXPECT_EQ(s.triangleCount(), 1u);
  EXPECT_EQ(s.droppedTriangles, 1u);
}

TEST_F(SceneObj, PolygonsNegativeIndicesGroupsAndMaterials) {
  write("a.mtl",
        "newmtl red\nKd 0.5 0 0\nKs 0.25 0.25 0.25\nNs 30\nNi 1.4\nd 0.5\n"
        "newmtl lamp\nKd 0 0 0\nKe 1 2 3\nPr 0.3\nPm 1\n");
  const Scene s = import("a.obj",
                         "mtllib a.mtl\no first\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"
                         "vt 0 0\nvt 1 0\nvt 1 1\nvn 0 0 1\nusemtl red\n"
                         "f 1/1/1 2/2/1 3/3/1 4//1\nusemtl lamp\nf -4 -3 \\\n -2\n"
                         "o second\nusemtl red\nf 1 2 3\nl 1 2\n");
  ASSERT_EQ(s.meshes.size(), 3u);
  EXPECT_EQ(s.triangleCount(), 4u);
  EXPECT_EQ(s.objects, (std::vector<std::string>{"first", "second"}));
  EXPECT_EQ(s.instances[2].object, 1);
  const Material& red = s.materials[s.meshes[0].material];
  EXPECT_EQ(red.name, "red");
  EXPECT_EQ(red.baseColor, vec4(0.5f, 0, 0, 0.5f));
  EXPECT_EQ(red.alphaMode, AlphaMode::kBlend);
  EXPECT_FLOAT_EQ(red.specular, 0.5f);
  EXPECT_FLOAT_EQ(red.ior, 1.4f);
  EXPECT_NEAR(red.roughness, 0.5f, 1e-6f);
  const Material& lamp = s.materials[s.meshes[1].material];
  EXPECT_EQ(lamp.emission, vec3(1, 2, 3));
  EXPECT_FLOAT_EQ(lamp.roughness, 0.3f);
  EXPECT_FLOAT_EQ(lamp.metallic, 1.0f);
  EXPECT_EQ(s.meshes[0].normals.size(), 4u);
  EXPECT_TRUE(s.meshes[1].normals.empty());
  EXPECT_TRUE(anyWarning(s, "lines and points"));
  EXPECT_FALSE(s.environment.present());
}

TEST_F(SceneObj, PolypaintOfZBrush) {
  const std::string text =
      "v 0 0 0\nv 1 0 0\n# as ZBrush writes it\n#MRGB ffff0000ff00ff00\nv 0 1 0\nv 1 1 0\n"
      "#MRGB 000000ff\nf 1 2 3\nf 2 4 3\n";
  const Scene s = import("a.obj", text);
  const auto& colors = s.meshes[0].colors;
  ASSERT_EQ(colors.size(), 4u);
  EXPECT_EQ(colors[0], glm::u8vec4(255, 0, 0, 255));
  EXPECT_EQ(colors[1], glm::u8vec4(0, 255, 0, 255));
  EXPECT_EQ(colors[2], glm::u8vec4(0, 0, 255, 255));
  EXPECT_EQ(colors[3], glm::u8vec4(255));
  EXPECT_EQ(s.replaced.count, 0u);
  EXPECT_EQ(import("b.obj", text + "#MRGB ffff0000ffff0000\n#MRGB 12x\n").replaced.count, 2u);
}

TEST_F(SceneObj, ColoursOfScannersGoTo255) {
  const auto colors = [&](const std::string& name, const char* first, const char* second) {
    return import(name, fmt::format("v 0 0 0\nv 1 0 0 {}\nv 0 1 0 {}\nf 1 2 3\n", first, second))
        .meshes[0]
        .colors;
  };
  EXPECT_EQ(colors("a.obj", "1 0 0", "128 255 51"),
            colors("b.obj", "0.0039215687 0 0", "0.5019608 1 0.2"));
  EXPECT_EQ(colors("c.obj", "1 0 0", "1.2 0 0")[1], glm::u8vec4(255, 0, 0, 255));
}

TEST_F(SceneObj, LibrariesNamedForEachObjectAreReadOnce) {
  write("a.mtl", "newmtl red\nKd 0.5 0 0\n");
  std::string text = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";
  for (int i = 0; i < 3; ++i) {
    text += fmt::format("mtllib a.mtl none.mtl\no part {}\nusemtl red\nf 1 2 3\n", i);
  }
  const Scene s = import("a.obj", text);
  EXPECT_EQ(s.meshes.size(), 3u);
  EXPECT_EQ(std::count_if(s.materials.begin(), s.materials.end(),
                          [](const Material& m) { return m.name == "red"; }),
            1);
  EXPECT_EQ(s.materials[s.meshes[2].material].baseColor, vec4(0.5f, 0, 0, 1));
  EXPECT_EQ(s.replaced.count, 1u);
}

TEST_F(SceneObj, VertexColoursAndMissingLibrary) {
  const Scene s =
      import("a.obj", "mtllib none.mtl\nv 0 0 0 1 0 0\nv 1 0 0 0 1 0\nv 0 1 0 0 0 1\nf 1 2 3\n");
  EXPECT_EQ(s.meshes[0].colors[1], glm::u8vec4(0, 255, 0, 255));
  EXPECT_TRUE(anyWarning(s, "none.mtl"));
}

TEST_F(SceneObj, TextureFromTheLibrary) {
  write("wood.png", tinyPng());
  write("a.mtl", "newmtl m\nmap_Kd -s 2 2 2 -colorspace sRGB wood.png\n");
  const Scene s = import("a.obj",
                         "mtllib a.mtl\nusemtl m\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\n"
                         "vt 0 1\nf 1/1 2/2 3/3\n");
  const Material& m = s.materials[s.meshes[0].material];
  ASSERT_TRUE(m.baseColorTexture.present());
  EXPECT_EQ(m.baseColor, vec4(1));
  EXPECT_EQ(m.baseColorTexture.scale, vec2(2));
  EXPECT_EQ(s.meshes[0].texCoords[0], vec2(0, 1));
  // OBJ's lower left corner is texel (0, 1), blue, at the centre of that texel.
  const vec4 c = sampleTexture(s.images[0], m.baseColorTexture, vec2(0.125f, 0.875f), true);
  EXPECT_NEAR(c.z, 1.0f, 1e-6f);
  EXPECT_NEAR(c.x, 0.0f, 1e-6f);
}

Image gradient() {
  Image image;
  image.width = 2;
  image.height = 2;
  image.channels = 3;
  image.bytes = {255, 0, 0, 0, 255, 0, 0, 0, 255, 188, 188, 188};
  return image;
}

TEST(SceneTexture, CentresAndBilinearMix) {
  const Image image = gradient();
  Texture t;
  t.wrapS = t.wrapT = Texture::Wrap::kClamp;
  EXPECT_EQ(sampleTexture(image, t, {0.25f, 0.25f}, false), vec4(1, 0, 0, 1));
  EXPECT_EQ(sampleTexture(image, t, {0.5f, 0.25f}, false), vec4(0.5f, 0.5f, 0, 1));
  EXPECT_EQ(sampleTexture(image, t, {-3.0f, 0.0f}, false), vec4(1, 0, 0, 1));
  // Decoded before it is filtered: sRGB 188 is 0.503 linear.
  EXPECT_NEAR(sampleTexture(image, t, {0.75f, 0.75f}, true).x, 0.5029f, 1e-3f);
  EXPECT_NEAR(sampleTexture(image, t, {0.75f, 0.75f}, false).x, 188.0f / 255.0f, 1e-6f);
}

TEST(SceneTexture, Wraps) {
  const Image image = gradient();
  Texture t;
  EXPECT_EQ(sampleTexture(image, t, {1.25f, -0.75f}, false), vec4(1, 0, 0, 1));
  EXPECT_EQ(sampleTexture(image, t, {0.0f, 0.25f}, false), vec4(0.5f, 0.5f, 0, 1));
  t.wrapS = t.wrapT = Texture::Wrap::kMirror;
  EXPECT_EQ(sampleTexture(image, t, {1.25f, 0.25f}, false), vec4(0, 1, 0, 1));
  EXPECT_EQ(sampleTexture(image, t, {-0.25f, 2.25f}, false), vec4(1, 0, 0, 1));
  for (const float bad : {kInfinity, std::nanf(""), 1e38f, -1e38f}) {
    for (const auto wrap :
         {Texture::Wrap::kRepeat, Texture::Wrap::kMirror, Texture::Wrap::kClamp}) {
      t.wrapS = t.wrapT = wrap;
      EXPECT_TRUE(std::isfinite(sampleTexture(image, t, {bad, bad}, true).x));
    }
  }
}

TEST(SceneTexture, ChannelsTransformAndMean) {
  Image grey;
  grey.width = grey.height = 1;
  grey.channels = 2;
  grey.bytes = {255, 51};
  EXPECT_EQ(sampleTexture(grey, Texture(), {0.3f, 0.3f}, true), vec4(1, 1, 1, 0.2f));
  Image floats;
  floats.width = 2;
  floats.height = 1;
  floats.channels = 1;
  floats.floats = {100.0f, 300.0f};
  EXPECT_EQ(textureMean(floats, true), vec4(200, 200, 200, 1));
  Texture t;
  t.scale = {2, 1};
  t.offset = {0.5f, 0};
  t.rotation = kPi / 2;
  const vec2 uv = transformUv(t, {0.25f, 0});  // scaled (0.5, 0), turned to (0, -0.5), shifted
  EXPECT_NEAR(uv.x, 0.5f, 1e-6f);
  EXPECT_NEAR(uv.y, -0.5f, 1e-6f);
}

TEST(SceneCamera, ParseByNameAndByNumbers) {
  Scene scene;
  scene.cameras.emplace_back().name = "door";
  scene.cameras.back().verticalFov = 0.4f;
  EXPECT_FLOAT_EQ(parseCamera("door", scene).verticalFov, 0.4f);
  const Camera c = parseCamera("0,0,5/0,0,0/0,2,0/60", scene);
  EXPECT_EQ(c.forward, vec3(0, 0, -1));
  EXPECT_EQ(c.up, vec3(0, 1, 0));
  EXPECT_NEAR(c.verticalFov, kPi / 3, 1e-6f);
  for (const char* bad :
       {"", "window", "1,2,3", "0,0,0/0,0,0/0,1,0/40", "0,0,5/0,0,0/0,0,1/40",
        "0,0,5/0,0,0/0,1,0/0", "0,0,5/0,0,0/0,1,0/180", "0,0/0,0,0/0,1,0/40",
        "0,0,x/0,0,0/0,1,0/40", "nan,0,5/0,0,0/0,1,0/40", "0,0,5/0,0,0/0,1,0/4z"}) {
    try {
      parseCamera(bad, scene);
      FAIL() << bad;
    } catch (const Error& e) {
      EXPECT_EQ(e.code(), ExitCode::kUsage) << bad;
    }
  }
}

TEST(SceneCamera, ALensByFstopAndFocus) {
  Scene scene;
  scene.cameras.emplace_back().name = "what?";
  scene.cameras.emplace_back().name = "flat";
  scene.cameras.back().orthographic = true;
  EXPECT_EQ(parseCamera("what?", scene).fstop, 0.0f);
  EXPECT_EQ(parseCamera("what?", scene).lensRadius(), 0.0f);
  EXPECT_EQ(parseCamera("what??fstop=4&focus=2", scene).fstop, 4.0f);
  const Camera c = parseCamera("0,0,5/0,0,0/0,1,0/40?focus=3.5&fstop=2.8", scene);
  EXPECT_EQ(c.focus, 3.5f);
  // A focal length of 32.97 mm shows 40 degrees on 24 mm.
  EXPECT_NEAR(c.lensRadius(), 0.03297f / 2.8f / 2.0f, 1e-6f);
  EXPECT_EQ(parseCamera(cameraText(c), scene).fstop, c.fstop);
  EXPECT_EQ(parseCamera(cameraText(c), scene).focus, c.focus);
  for (const char* bad :
       {"flat?fstop=2&focus=1", "what??fstop=2", "what??focus=2", "what??",
        "what??fstop=2&focus=-1", "what??fstop=0&focus=1", "what??fstop=inf&focus=1",
        "what??fstop=1,2&focus=1", "what??fstop=2&focus=1&zoom=2", "door?fstop=2&focus=1"}) {
    try {
      parseCamera(bad, scene);
      FAIL() << bad;
    } catch (const Error& e) {
      EXPECT_EQ(e.code(), ExitCode::kUsage) << bad;
    }
  }
}

TEST(SceneCamera, FramingSeesTheWholeBoxAtEveryScale) {
  for (const double scale : {1e-6, 1.0, 1e7}) {
    Box3d box;
    box.extend(dvec3(-1, 0, 3) * scale);
    box.extend(dvec3(2, 5, 4) * scale);
    const Camera c = framingCamera(box);
    const vec3 right = glm::cross(c.forward, c.up);
    for (int corner = 0; corner < 8; ++corner) {
      const dvec3 p(corner & 1 ? box.upper.x : box.lower.x, corner & 2 ? box.upper.y : box.lower.y,
                    corner & 4 ? box.upper.z : box.lower.z);
      const dvec3 d = p - c.eye;
      const double depth = glm::dot(d, dvec3(c.forward));
      const double edge = depth * std::tan(0.5 * c.verticalFov);
      EXPECT_GT(depth, 0.0);
      EXPECT_LT(std::abs(glm::dot(d, dvec3(c.up))), edge);
      EXPECT_LT(std::abs(glm::dot(d, dvec3(right))), edge);
    }
  }
}

TEST_F(SceneEnvironment, ColoursAndMaps) {
  EXPECT_EQ(parseEnvironment("1,0.5,2e1").color, vec3(1, 0.5f, 20));
  EXPECT_FALSE(parseEnvironment("0,0,0").present());
  for (const char* bad : {"1,2", "1,2,3,4", "-1,0,0", "1,,2", "nan,0,0", "1e99,0,0", "5"}) {
    try {
      parseEnvironment(bad);
      FAIL() << bad;
    } catch (const Error& e) {
      EXPECT_EQ(e.code(), ExitCode::kUsage) << bad;
    }
  }
  const std::string path = (folder_ / "sky.exr").string();
  {
    auto out = OIIO::ImageOutput::create(path);
    ASSERT_TRUE(out && out->open(path, OIIO::ImageSpec(2, 1, 3, OIIO::TypeDesc::FLOAT)));
    const float pixels[6] = {1, 2, 3, -1, std::nanf(""), 5};
    ASSERT_TRUE(out->write_image(OIIO::TypeDesc::FLOAT, pixels));
    out->close();
  }
  setLogLevel(LogLevel::kQuiet);
  const Environment e = parseEnvironment(path);
  ASSERT_TRUE(e.map);
  EXPECT_EQ(e.map->channels, 3);
  EXPECT_EQ(e.map->floats, (std::vector<float>{1, 2, 3, 0, 0, 5}));
  for (const std::string& bad : {std::string("none.hdr"), folder_.string(),
                                 write("broken.exr", "\x76\x2f\x31\x01 nothing").string()}) {
    try {
      parseEnvironment(bad);
      FAIL() << bad;
    } catch (const Error& error) {
      EXPECT_EQ(error.code(), ExitCode::kInput) << bad;
    }
  }
}

TEST_F(SceneEnvironment, RotationAndStrengthOfAFile) {
  const std::string path = (folder_ / "sky.exr").string();
  {
    auto out = OIIO::ImageOutput::create(path);
    ASSERT_TRUE(out && out->open(path, OIIO::ImageSpec(1, 1, 3, OIIO::TypeDesc::FLOAT)));
    const float pixel[3] = {1, 2, 3};
    ASSERT_TRUE(out->write_image(OIIO::TypeDesc::FLOAT, pixel));
    out->close();
  }
  EXPECT_EQ(parseEnvironment(path).rotation, 0.0f);
  EXPECT_EQ(environmentFile(path), path);
  const Environment e = parseEnvironment(path + "?strength=0.5&rotate=-90");
  EXPECT_NEAR(e.rotation, -kPi / 2, 1e-6f);
  EXPECT_EQ(e.color, vec3(0.5f));
  EXPECT_TRUE(e.map);
  EXPECT_EQ(environmentFile(path + "?rotate=1"), path);
  for (const std::string bad : {"?rotate=1,2", "?rotate=inf", "?rotate=1e9", "?strength=nan",
                                "?strength=-1", "?turn=1", "?rotate", "?rotate=x"}) {
    try {
      parseEnvironment(path + bad);
      FAIL() << bad;
    } catch (const Error& error) {
      EXPECT_EQ(error.code(), ExitCode::kUsage) << bad;
    }
  }
}

/// The colours of an .exr are found wherever they are, and nothing else counts as colours.
TEST_F(SceneEnvironment, ColoursAmongPartsAndLayers) {
  const std::string path = (folder_ / "sky.exr").string();
  using Parts = std::vector<std::vector<std::string>>;
  // Every channel's value is its number, counted over the parts.
  const auto write = [&](const Parts& parts) {
    std::vector<OIIO::ImageSpec> specs;
    for (const auto& names : parts) {
      OIIO::ImageSpec& spec = specs.emplace_back(1, 1, int(names.size()), OIIO::TypeDesc::FLOAT);
      spec.channelnames = names;
      spec.attribute("oiio:subimagename", fmt::format("part {}", specs.size()));
    }
    auto out = OIIO::ImageOutput::create(path);
    ASSERT_TRUE(out && out->open(path, int(specs.size()), specs.data()));
    float next = 0.0f;
    for (std::size_t i = 0; i < specs.size(); ++i) {
      if (i > 0) {
        ASSERT_TRUE(out->open(path, specs[i], OIIO::ImageOutput::AppendSubimage));
      }
      std::vector<float> values;
      for (int c = 0; c < specs[i].nchannels; ++c) values.push_back(next++);
      ASSERT_TRUE(out->write_image(OIIO::TypeDesc::FLOAT, values.data()));
    }
    out->close();
  };
  const auto found = [&] { return parseEnvironment(path).map->floats; };
  write({{"Z"}, {"R", "G", "B"}});
  EXPECT_EQ(found(), (std::vector<float>{1, 2, 3}));
  write({{"R", "G", "B", "A"}, {"Z"}});
  EXPECT_EQ(found(), (std::vector<float>{0, 1, 2}));
  write({{"Depth.Z", "ViewLayer.Combined.R", "ViewLayer.Combined.G", "ViewLayer.Combined.B"}});
  EXPECT_EQ(found(), (std::vector<float>{1, 2, 3}));
  write({{"albedo.R", "albedo.G", "albedo.B", "beauty.R", "beauty.G", "beauty.B"}});
  EXPECT_EQ(found(), (std::vector<float>{3, 4, 5}));
  write({{"albedo.R", "albedo.G", "albedo.B"}, {"R", "G", "B"}});
  EXPECT_EQ(found(), (std::vector<float>{3, 4, 5}));
  write({{"Y"}});
  EXPECT_EQ(found(), (std::vector<float>{0, 0, 0}));
  for (const Parts& bad : {Parts{{"Z"}}, Parts{{"X", "Y", "Z"}}, Parts{{"Y", "RY", "BY"}}}) {
    write(bad);
    EXPECT_THROW(parseEnvironment(path), Error) << bad[0][0];
  }
}

/// The folder of the shared scenes, or empty.
std::filesystem::path sharedScenes() {
  const char* given = std::getenv("TREX_SHARED");
  const std::filesystem::path folder =
      given != nullptr ? given : std::filesystem::path(TREX_SOURCE_DIR) / ".." / "shared";
  return std::filesystem::is_directory(folder / "scenes") ? folder / "scenes" : "";
}

TEST(SceneShared, TriangleCountsAreThoseOfTheirReadme) {
  const auto folder = sharedScenes();
  if (folder.empty()) GTEST_SKIP() << "no shared scenes; set TREX_SHARED to their folder";
  setLogLevel(LogLevel::kError);
  struct Expected {
    const char* file;
    std::uint64_t triangles, unique;
  };
  for (const Expected& e : {Expected{"interiors/cornell.glb", 32, 32},
                            {"interiors/veach-bidir.glb", 11544, 11544},
                            {"interiors/veach-ajar.glb", 382690, 382690},
                            {"interiors/staircase2.glb", 31247, 31247},
                            {"interiors/classroom.glb", 103832, 103832},
                            {"interiors/living-room.glb", 143163, 143163},
                            {"interiors/sponza.glb", 75469, 75469},
                            {"cad/saturn-v.glb", 1010389, 111450},
                            {"cad/cafe-corner.glb", 912344, 148358},
                            {"FlightHelmet/FlightHelmet.gltf", 94722, 94722},
                            {"meshes/turbineblade.ply", 199034, 199034},
                            {"meshes/stanford-bunny.obj", 69451, 69451}}) {
    const Scene s = importScene(folder / e.file);
    EXPECT_EQ(s.triangleCount(), e.triangles) << e.file;
    EXPECT_EQ(s.uniqueTriangleCount(), e.unique) << e.file;
    EXPECT_EQ(s.droppedTriangles, 0u) << e.file;
  }
}

TEST(SceneAssets, OurOwnScenesAreComplete) {
  setLogLevel(LogLevel::kError);
  for (const char* file : {"cornell.glb", "gallery.glb"}) {
    const Scene s = importScene(std::filesystem::path(TREX_SOURCE_DIR) / "assets" / file);
    EXPECT_TRUE(s.warnings.empty()) << file;
    EXPECT_TRUE(hasLight(s)) << file;
    EXPECT_EQ(s.cameras.size(), 1u) << file;
  }
}

const std::string kPackedPly =
    "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float "
    "z\n"
    "element face 1\nproperty list uchar int vertex_index\nend_header\n0 0 0\n2 0 0\n0 2 0\n3 0 1 "
    "2\n";

TEST_F(ScenePacked, GzippedFilesAreThoseThatAreIn) {
  pack("m.ply.gz", kPackedPly);
  const std::string world = "Shape \"plymesh\" \"string filename\" \"m.ply.gz\"\n";
  pack("part.pbrt.gz", world);
  pack("scene.pbrt.gz", "WorldBegin\nInclude \"part.pbrt.gz\"\nTranslate 0 0 3\n" + world);
  pack("m.obj.gz", "v 0 0 0\nv 2 0 0\nv 0 2 0\nf 1 2 3\n");
  pack("M.PLY.GZ", kPackedPly);
  pack("packed.ply", kPackedPly);  // by another name
  const std::vector<vec3> right = {{0, 0, 0}, {2, 0, 0}, {0, 2, 0}};
  for (const char* name : {"m.ply.gz", "m.obj.gz", "M.PLY.GZ", "packed.ply", "scene.pbrt.gz"}) {
    const Scene s = importScene(folder_ / name);
    EXPECT_EQ(s.meshes.at(0).positions, right) << name;
    EXPECT_EQ(s.replaced.count, 0u) << name;
  }
  EXPECT_EQ(importScene(folder_ / "scene.pbrt.gz").instances.size(), 2u);
  // Larger than any buffer, and of two packed files one behind the other.
  std::string long_;
  for (int i = 0; i < 200'000; ++i) long_ += "v " + std::to_string(i * 7919 % 100'003) + " 0 1\n";
  pack("a.gz", long_);
  pack("b.gz", "v 0 0 0\nv 2 0 0\nv 0 2 0\nf -3 -2 -1\n");
  std::ofstream both(folder_ / "both.obj.gz", std::ios::binary);
  for (const char* part : {"a.gz", "b.gz"}) {
    both << std::ifstream(folder_ / part, std::ios::binary).rdbuf();
  }
  both.close();
  EXPECT_EQ(importScene(folder_ / "both.obj.gz").triangleCount(), 1u);
}

TEST_F(ScenePacked, BrokenAndSwellingFilesAreRefused) {
  const auto path = pack("m.ply.gz", kPackedPly);
  std::ifstream in(path, std::ios::binary);
  const std::string whole((std::istreambuf_iterator<char>(in)), {});
  for (std::size_t size = 2; size < whole.size(); ++size) {
    EXPECT_NE(refusal(write("cut.ply.gz", whole.substr(0, size))), "none") << size;
  }
  std::string flipped = whole;
  flipped[whole.size() - 6] = char(flipped[whole.size() - 6] ^ 1);  // of its checksum
  EXPECT_NE(refusal(write("flipped.ply.gz", flipped)).find("gzip"), std::string::npos);
  // 16 MiB in 16 KiB.
  const std::string swelling = "ply\n" + std::string(std::size_t(1) << 24, '\n');
  EXPECT_NE(refusal(pack("bomb.ply.gz", swelling)).find("more than 100 times"), std::string::npos);
  // A count that only such a file could hold takes no memory.
  std::string lie = kPackedPly;
  lie.replace(lie.find("vertex 3"), 8, "vertex 99999999");
  EXPECT_NE(refusal(pack("lie.ply.gz", lie)), "none");
  EXPECT_NE(refusal(pack("m.stl.gz", "solid\n")).find("unknown extension '.gz'"),
            std::string::npos);
}

}  // namespace
}  // namespace trex::test
