// Files as exporters write them: the picture that is meant comes out of every way to write it.
#include "src/scene/polygon.h"
#include "src/scene/texture.h"
#include "src/scene/triangle_stream.h"
#include "tests/unit/scene_helpers.h"

namespace trex::test {
namespace {

class SceneExporters : public SceneTest {
 protected:
  /// The only material that the model's first mesh uses.
  Material material(const std::string& mtl) {
    write("m.mtl", "newmtl m\n" + mtl);
    scene_ = import("m.obj",
                    "mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0\nvt 0 0\nusemtl m\n"
                    "f 1/1 2/1 3/1\n");
    return scene_.materials[scene_.meshes[0].material];
  }
  /// Colour of a texture in the middle of a texel of tinyPng(), counted from the upper left.
  vec4 texel(const Texture& t, int x, int y) const {
    return sampleTexture(scene_.images[t.image], Texture(),
                         vec2(0.25f + 0.5f * float(x), 0.25f + 0.5f * float(y)), false);
  }
  Scene scene_;
};

double area(const Mesh& mesh) {
  double sum = 0.0;
  for (const glm::uvec3& t : mesh.triangles) {
    const dvec3 a(mesh.positions[t.x]), b(mesh.positions[t.y]), c(mesh.positions[t.z]);
    sum += 0.5 * glm::length(glm::cross(b - a, c - a));
  }
  return sum;
}

double signedArea(std::span<const dvec3> p, std::span<const glm::uvec3> triangles) {
  double sum = 0.0;
  for (const glm::uvec3& t : triangles) sum += 0.5 * glm::cross(p[t.y] - p[t.x], p[t.z] - p[t.x]).z;
  return sum;
}

const std::vector<dvec3> kC = {{3, 1, 0}, {1, 1, 0}, {1, 2, 0}, {3, 2, 0},
                               {3, 3, 0}, {0, 3, 0}, {0, 0, 0}, {3, 0, 0}};

/// A C of area 7 from every first corner, either way around, in any plane: its triangles do not
/// overlap, as the sums of their areas with and without sign are equal.
TEST(Polygon, ConcaveOnesAreCutIntoTheirArea) {
  detail::PolygonCutter cutter;
  for (std::size_t first = 0; first < kC.size(); ++first) {
    for (const bool reversed : {false, true}) {
      std::vector<dvec3> p(kC.begin(), kC.end());
      std::rotate(p.begin(), p.begin() + static_cast<std::ptrdiff_t>(first), p.end());
      if (reversed) std::reverse(p.begin(), p.end());
      const auto triangles = cutter.cut(p);
      EXPECT_EQ(triangles.size(), 6u);
      EXPECT_FALSE(cutter.failed());
      EXPECT_NEAR(signedArea(p, triangles), reversed ? -7.0 : 7.0, 1e-12);
      double sum = 0.0;
      for (const glm::uvec3& t : triangles) {
        sum += 0.5 * glm::length(glm::cross(p[t.y] - p[t.x], p[t.z] - p[t.x]));
      }
      EXPECT_NEAR(sum, 7.0, 1e-12);
      for (dvec3& q : p) q = dvec3(q.y, 0.3 * q.x, q.x);  // upright
      sum = 0.0;
      for (const glm::uvec3& t : cutter.cut(p)) {
        sum += 0.5 * glm::length(glm::cross(p[t.y] - p[t.x], p[t.z] - p[t.x]));
      }
      EXPECT_NEAR(sum, 7.0 * std::sqrt(1.09), 1e-12);
    }
  }
}

/// An outline with a hole, joined to it by a bridge that is walked both ways.
TEST(Polygon, ABridgeToAHole) {
  const std::vector<dvec3> p = {{0, 0, 0}, {4, 0, 0}, {4, 4, 0}, {0, 4, 0}, {0, 0, 0},
                                {1, 1, 0}, {1, 3, 0}, {3, 3, 0}, {3, 1, 0}, {1, 1, 0}};
  detail::PolygonCutter cutter;
  const auto triangles = cutter.cut(p);
  EXPECT_FALSE(cutter.failed());
  EXPECT_NEAR(signedArea(p, triangles), 12.0, 1e-12);
  for (const glm::uvec3& t : triangles) {
    EXPECT_GE(glm::cross(p[t.y] - p[t.x], p[t.z] - p[t.x]).z, 0.0);
  }
}

/// A comb of many teeth: its area is closed form. A star of random radii: that of the shoelace.
TEST(Polygon, ManyCorners) {
  std::vector<dvec3> comb;
  constexpr int kTeeth = 500;
  for (int i = 0; i < kTeeth; ++i) {
    comb.insert(comb.end(), {{i, 0, 0}, {i + 0.5, -1, 0}});
  }
  comb.insert(comb.end(), {{kTeeth, 0, 0}, {kTeeth, 1, 0}, {0, 1, 0}});
  detail::PolygonCutter cutter;
  EXPECT_NEAR(signedArea(comb, cutter.cut(comb)), 1.5 * kTeeth, 1e-9);
  EXPECT_FALSE(cutter.failed());
  std::uint32_t state = 1;
  for (int round = 0; round < 50; ++round) {
    std::vector<dvec3> star;
    double shoelace = 0.0;
    const int n = 4 + round;
    for (int i = 0; i < n; ++i) {
      state = state * 1664525u + 1013904223u;
      const double r = 0.1 + state * 0x1p-32, angle = 2.0 * std::numbers::pi * i / n;
      star.push_back({r * std::cos(angle), r * std::sin(angle), 0.0});
    }
    for (int i = 0; i < n; ++i) {
      const dvec3 &a = star[i], &b = star[(i + 1) % n];
      shoelace += 0.5 * (a.x * b.y - b.x * a.y);
    }
    const auto triangles = cutter.cut(star);
    EXPECT_EQ(triangles.size(), std::size_t(n - 2));
    EXPECT_FALSE(cutter.failed());
    EXPECT_NEAR(signedArea(star, triangles), shoelace, 1e-9);
    for (const glm::uvec3& t : triangles) {
      EXPECT_GE(glm::cross(star[t.y] - star[t.x], star[t.z] - star[t.x]).z, 0.0);
    }
  }
}

TEST(Polygon, ConvexOnesAreFansAndCrossedOnesAreSaid) {
  detail::PolygonCutter cutter;
  const std::vector<dvec3> square = {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}};
  EXPECT_EQ(cutter.cut(square)[1], glm::uvec3(0, 2, 3));
  std::vector<dvec3> bow = {{0, 0, 0}, {2, 2, 0}, {2, 0, 0}, {0, 1, 0}};
  EXPECT_EQ(cutter.cut(bow).size(), 2u);
  std::vector<dvec3> odd = {{0, 0, 0}, {1, 0, 0}, {std::nan(""), 1, 0}, {0, 1, 0}};
  EXPECT_EQ(cutter.cut(odd).size(), 2u);
  EXPECT_TRUE(cutter.cut({}).empty());
}

TEST_F(SceneExporters, ConcaveFacesOfObjAndPly) {
  std::string obj, ply =
                       "ply\nformat ascii 1.0\nelement vertex 8\nproperty float x\n"
                       "property float y\nproperty float z\nelement face 1\n"
                       "property list uchar int vertex_indices\nend_header\n";
  for (const dvec3& p : kC) {
    obj += fmt::format("v {} {} {}\n", p.x, p.y, p.z);
    ply += fmt::format("{} {} {}\n", p.x, p.y, p.z);
  }
  const Scene a = import("c.obj", obj + "f 1 2 3 4 5 6 7 8\n");
  const Scene b = import("c.ply", ply + "8 0 1 2 3 4 5 6 7\n");
  const Scene late = import("late.obj", "f 1 2 3 4 5 6 7 8\n" + obj);
  for (const Scene* s : {&a, &b, &late}) EXPECT_NEAR(area(s->meshes[0]), 7.0, 1e-6);
}

/// The same square however its lines end, with comments, in capitals, in any order.
TEST_F(SceneExporters, ObjTextInEveryManner) {
  const std::string v = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n";
  const auto with = [](std::string text, const std::string& end) {
    std::string out;
    for (const char c : text) c == '\n' ? out += end : out += c;
    return out;
  };
  std::string upper = v + "f 1 2 3 4\n";
  for (char& c : upper) c = static_cast<char>(std::toupper(static_cast<unsigned char>(c)));
  const std::vector<std::string> texts = {
      "# from C:\\models\\\n" + v + "f 1 2 3 4\n",
      "\xef\xbb\xbf" + v + "f 1 2 3 4\n",
      "\xef\xbb\xbf" + with(v + "f 1 2 3 4\n", "\r\n"),
      with(v + "f 1 2 3 4\n", "\r"),
      with(v + "f 1 2 3 4\n", "\r\r\n"),
      "f 1 2 3 4\n" + v,
      v + "f 1 2 \\ \n3 4\n",
      v + "f 1 2 \\\n3 \\\n4",
      v + "f 1 2 3 4 # done\\\n",
      "v 0 0 0 # first\nv 1 0 0\t#\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n",
      upper,
      v + "f -4 -3 -2 -1\n",
      v + "o W\xe4nde\nf 1 2 3 4\n",
      v + "vn 0 0 1\nvt 0 0\nf 1/1/1 2//1 3/1 4\n",
      v + "fo 1 2 3 4\n",
      "\tv\t0 0\t0\n v +1. -0 .0e0\nv 1 1 0 1\nv 0 1 0\nf 1/ 2// 3/ 4\n\x1a"};
  for (const std::string& text : texts) {
    const Scene s = import("a.obj", text);
    EXPECT_EQ(s.replaced.count, 0u) << text;
    ASSERT_EQ(s.meshes.size(), 1u) << text;
    EXPECT_EQ(s.meshes[0].positions.size(), 4u) << text;
    EXPECT_NEAR(area(s.meshes[0]), 1.0, 1e-6) << text;
  }
  EXPECT_EQ(import("a.obj", texts[12]).objects[0], "W\xc3\xa4nde");
}

TEST_F(SceneExporters, ObjStatementsThatAreNotShownAreSaid) {
  const std::string square = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n";
  const Scene s = import("a.obj", "call other.obj\nusemap wood\nlod 3\nmg 1 2\n" + square);
  EXPECT_TRUE(anyWarning(s, "not shown: call usemap"));
  EXPECT_FALSE(anyWarning(s, "lod"));
  EXPECT_EQ(s.triangleCount(), 2u);
  // Glass by its illumination model is opaque here.
  EXPECT_TRUE(
      (material("Kd 1 1 1\nTf 0.5 1 0.5\nillum 7\n"), anyWarning(scene_, "illum of glass")));
  EXPECT_TRUE(anyWarning(scene_, "Tf"));
  EXPECT_FALSE((material("Kd 1 1 1\nTf 0.5 1 0.5\nillum 2\n"), anyWarning(scene_, "not shown")));
  const auto refused = [&](const std::string& text) {
    try {
      import("b.obj", text);
      return std::string("accepted");
    } catch (const Error& e) {
      EXPECT_EQ(e.code(), ExitCode::kInput);
      return std::string(e.what());
    }
  };
  EXPECT_NE(refused("v 0 0 0\nv 1 0 0\n").find("cloud of 2 points"), std::string::npos);
  EXPECT_NE(refused(std::string("\xff\xfev\0 \0", 6)).find("UTF-16"), std::string::npos);
  // A library that can't be read takes no geometry along.
  write("wide.mtl", "\xfe\xff");
  const Scene wide = import("c.obj", "mtllib wide.mtl\n" + square);
  EXPECT_TRUE(anyReplaced(wide, "UTF-16"));
  EXPECT_EQ(wide.triangleCount(), 2u);
}

TEST_F(SceneExporters, MaterialsBehindAByteOrderMarkAndNamesWithHashes) {
  write("a.mtl",
        "\xef\xbb\xbfnewmtl Material #25\r\nKd 1 0 0\r\nnewmtl green # the lawn\nKd 0 1 0\n");
  const std::string head = "\xef\xbb\xbfmtllib a.mtl\r\nv 0 0 0\r\nv 1 0 0\r\nv 1 1 0\r\n";
  for (const auto& [use, color] : {std::pair("Material #25", vec4(1, 0, 0, 1)),
                                   {"green", vec4(0, 1, 0, 1)},
                                   {"green # again", vec4(0, 1, 0, 1)}}) {
    const Scene s = import("a.obj", head + "usemtl " + use + "\r\nf 1 2 3\r\n");
    EXPECT_EQ(s.materials[s.meshes[0].material].baseColor, color) << use;
    EXPECT_EQ(s.replaced.count, 0u) << use;
  }
}

TEST_F(SceneExporters, OpacityOfMtl) {
  struct Case {
    const char* text;
    float opacity;
    bool said;
  };
  for (const Case& c : {Case{"d 1\nTr 0\n", 1.0f, false},
                        {"Tr 0\nd 1\n", 1.0f, false},
                        {"d 0.3\nTr 0.7\n", 0.3f, false},
                        {"d 1\nTr 1\n", 1.0f, true},
                        {"Tr 1\nd 1\n", 1.0f, true},
                        {"d 0.25\nTr 0.25\n", 0.25f, true},
                        {"d 0\nTr 0\n", 1.0f, true},
                        {"d 0\nTr 1\n", 0.0f, true},
                        {"d 0\n", 0.0f, true},
                        {"Tr 1.000000\n", 1.0f, true},
                        {"Tr 0.25\n", 0.75f, false},
                        {"d -halo 0.5\n", 0.5f, true},
                        {"d 0.5 # glass\n", 0.5f, false}}) {
    const Material m = material(c.text);
    EXPECT_FLOAT_EQ(m.baseColor.a, c.opacity) << c.text;
    EXPECT_EQ(m.alphaMode, c.opacity < 1.0f ? AlphaMode::kBlend : AlphaMode::kOpaque) << c.text;
    EXPECT_EQ(anyWarning(scene_, "m.mtl"), c.said) << c.text;
  }
}

TEST_F(SceneExporters, TexturesByNamesOfOtherMachines) {
  write("Wood Tex.png", tinyPng());
  std::filesystem::create_directories(folder_ / "maps");
  std::filesystem::copy_file(folder_ / "Wood Tex.png", folder_ / "maps/In Folder.PNG");
  for (const char* name :
       {"Wood Tex.png", "wood tex.png", "\"Wood Tex.png\"", ".\\Wood Tex.png",
        "C:\\Users\\me\\Wood Tex.png", "/home/someone/Wood Tex.png", "maps\\in folder.png",
        "-s 2 2 1 -o 0.5 0 0 -blendu off -texres 512 Wood Tex.png", "Wood Tex.png # oak",
        "Wood Tex.png -bm 0.5 -clamp on", "MAPS/In Folder.png"}) {
    const Material m = material(std::string("map_Kd ") + name + "\n");
    EXPECT_EQ(scene_.replaced.count, 0u) << name;
    ASSERT_TRUE(m.baseColorTexture.present()) << name;
    EXPECT_EQ(texel(m.baseColorTexture, 1, 1), vec4(1)) << name;
    EXPECT_EQ(m.baseColor, vec4(1)) << name;
  }
  EXPECT_EQ(material("map_Kd\n").baseColorTexture.image, kNone);
  EXPECT_TRUE(anyReplaced(scene_, "names no file"));
  EXPECT_EQ(material("map_Kd http://example.com/a.png\n").baseColorTexture.image, kNone);
  EXPECT_TRUE(anyReplaced(scene_, "network"));
}

TEST_F(SceneExporters, MapsOfMtlThatShareAnImageHere) {
  write("a.png", tinyPng());  // red, green; blue, white
  Material m = material("Kd 1 1 1\nmap_Kd a.png\nmap_d a.png\n");
  EXPECT_EQ(m.alphaMode, AlphaMode::kBlend);
  EXPECT_EQ(vec3(texel(m.baseColorTexture, 0, 0)), vec3(1, 0, 0));
  EXPECT_NEAR(texel(m.baseColorTexture, 0, 0).w, 0.2126f, 0.003f);
  EXPECT_NEAR(texel(m.baseColorTexture, 1, 1).w, 1.0f, 1e-6f);
  m = material("Kd 0.5 0.5 0.5\nmap_d a.png\n");
  EXPECT_EQ(m.baseColor, vec4(0.5f, 0.5f, 0.5f, 1.0f));
  EXPECT_EQ(vec3(texel(m.baseColorTexture, 0, 0)), vec3(1));
  EXPECT_NEAR(texel(m.baseColorTexture, 1, 0).w, 0.7152f, 0.003f);
  m = material("map_Pr a.png\nPm 1\n");
  EXPECT_EQ(m.roughness, 1.0f);
  EXPECT_EQ(m.metallic, 1.0f);
  EXPECT_EQ(texel(m.metallicRoughnessTexture, 0, 0).y, 1.0f);  // the red of red
  EXPECT_EQ(texel(m.metallicRoughnessTexture, 1, 0).y, 0.0f);
  EXPECT_EQ(texel(m.metallicRoughnessTexture, 1, 0).z, 1.0f);
  m = material("norm a.png\n");
  EXPECT_EQ(scene_.images[m.normalTexture.image].name, (folder_ / "a.png").string());
  m = material("map_Bump -bm 0.5 a.png\n");
  EXPECT_TRUE(anyWarning(scene_, "heights"));
  // Heights 0.2126, 0.7152; 0.0722, 1, repeated: their slopes cancel, as each row has period 2.
  EXPECT_NEAR(texel(m.normalTexture, 0, 0).x, 0.5f, 0.003f);
  EXPECT_NEAR(texel(m.normalTexture, 0, 0).z, 1.0f, 0.003f);
  m = material("Ke 0 0 0\nmap_Ke a.png\nmap_Ks a.png\nrefl sky.png\n");
  EXPECT_FALSE(m.emits());
  EXPECT_EQ(m.specular, 1.0f);
  EXPECT_TRUE(anyWarning(scene_, "not shown: refl"));
  m = material("Pc 1\nPcr 0.2\nPs 0.1 0.2 0.3\naniso 0.4\nanisor 0.25\n");
  EXPECT_EQ(m.finish.clearcoat, 1.0f);
  EXPECT_EQ(m.finish.clearcoatRoughness, 0.2f);
  EXPECT_EQ(m.finish.sheenColor, vec3(0.1f, 0.2f, 0.3f));
  EXPECT_EQ(m.finish.anisotropy, 0.4f);
  EXPECT_FLOAT_EQ(m.finish.anisotropyRotation, 0.5f * kPi);
}

/// A roof of two faces: smoothed they share the ridge's normal, flat they have none.
TEST_F(SceneExporters, SmoothingGroups) {
  const std::string v = "v 0 0 0\nv 0 2 0\nv 1 0 1\nv 1 2 1\nv 2 0 0\nv 2 2 0\n";
  const std::string faces = "f 1 3 4 2\nf 3 5 6 4\n";
  EXPECT_TRUE(import("flat.obj", v + faces).meshes[0].normals.empty());
  EXPECT_TRUE(import("off.obj", v + "s 1\ns off\n" + faces).meshes[0].normals.empty());
  const Scene smooth = import("smooth.obj", v + "s 1\n" + faces);
  const Mesh& m = smooth.meshes[0];
  ASSERT_EQ(m.normals.size(), 6u);
  EXPECT_NEAR(std::abs(m.normals[1].z), 1.0f, 1e-6f);  // vertex 3, on the ridge
  EXPECT_NEAR(std::abs(m.normals[0].z), std::sqrt(0.5f), 1e-6f);
  const Scene apart = import("apart.obj", v + "s 1\nf 1 3 4 2\ns 2\nf 3 5 6 4\n");
  ASSERT_EQ(apart.meshes[0].normals.size(), 8u);
  for (const vec3& n : apart.meshes[0].normals) {
    EXPECT_NEAR(std::abs(n.z), std::sqrt(0.5f), 1e-6f);
  }
}

const std::string kSquare =
    "element vertex 4\nproperty float x\nproperty float y\nproperty float z\n";
const std::string kCorners = "0 0 0\n1 0 0\n1 1 0\n0 1 0\n";

std::string plyOf(const std::string& header, const std::string& rows) {
  return "ply\nformat ascii 1.0\n" + header + "end_header\n" + rows;
}

TEST_F(SceneExporters, PlyStrips) {
  const Scene s = import("a.ply", plyOf(kSquare + "element tristrips 1\n"
                                                  "property list int int vertex_indices\n",
                                        kCorners + "8 0 1 3 2 -1 0 1 2\n"));
  const Mesh& m = s.meshes[0];
  ASSERT_EQ(m.triangles.size(), 3u);
  for (const glm::uvec3& t : m.triangles) {
    EXPECT_GT(
        glm::cross(m.positions[t.y] - m.positions[t.x], m.positions[t.z] - m.positions[t.x]).z,
        0.0f);
  }
  EXPECT_TRUE(anyWarning(s, "camera"));
  EXPECT_EQ(s.replaced.count, 0u);
}

TEST_F(SceneExporters, PlyPointsAreNamed) {
  for (const std::string& faces :
       {std::string(), std::string("element face 0\nproperty list uchar int vertex_indices\n")}) {
    try {
      import("a.ply", plyOf(kSquare + faces, kCorners));
      ADD_FAILURE();
    } catch (const Error& e) {
      EXPECT_EQ(e.code(), ExitCode::kInput);
      EXPECT_NE(std::string(e.what()).find("cloud of 4 points"), std::string::npos) << e.what();
      EXPECT_NE(std::string(e.what()).find("--point-size METRES"), std::string::npos) << e.what();
    }
  }
}

/// Six times the volume that the triangles enclose if they face outwards.
double volumeOf(const Mesh& m) {
  double sum = 0.0;
  for (const glm::uvec3& t : m.triangles) {
    sum += glm::dot(dvec3(m.positions[t.x]),
                    glm::cross(dvec3(m.positions[t.y]), dvec3(m.positions[t.z])));
  }
  return sum;
}

TEST_F(SceneExporters, PlyPointsAsOctahedra) {
  for (const std::string& faces :
       {std::string(), std::string("element face 0\nproperty list uchar int vertex_indices\n")}) {
    const Scene s = import("a.ply", plyOf(kSquare + faces, kCorners), {.pointSize = 0.25});
    const Mesh& m = s.meshes[0];
    EXPECT_EQ(m.triangles.size(), 4u * 8u);
    EXPECT_EQ(m.positions.size(), 4u * 6u);
    EXPECT_EQ(s.bounds().lower, dvec3(-0.125));
    EXPECT_EQ(s.bounds().upper, dvec3(1.125, 1.125, 0.125));
    EXPECT_NEAR(volumeOf(m), 6.0 * 4.0 * 0.25 * 0.25 * 0.25 / 6.0, 1e-6);
    EXPECT_TRUE(
        anyWarning(s, "4 points are shown as octahedra of 8 triangles each, 0.25 m across"));
    EXPECT_EQ(s.replaced.count, 0u);
  }
}

TEST_F(SceneExporters, PlyPointsWithNormalsAsSquares) {
  const std::string head =
      "element vertex 3\nproperty float x\nproperty float y\nproperty float z\nproperty float nx\n"
      "property float ny\nproperty float nz\nproperty uchar red\nproperty uchar green\n"
      "property uchar blue\n";
  const std::string rows = "0 0 0 0 0 2 255 0 0\n5 0 0 1 0 0 0 255 0\n0 0 9 0 0 0 0 0 255\n";
  const Scene s = import("a.ply", plyOf(head, rows), {.unit = 0.5, .pointSize = 0.25});
  const Mesh& m = s.meshes[0];
  ASSERT_EQ(m.triangles.size(), 3u * 2u);
  EXPECT_EQ(m.colors[4], glm::u8vec4(0, 255, 0, 255));
  const vec3 wanted[] = {{0, 0, 1}, {1, 0, 0}, {0, 1, 0}};  // nothing is said: up
  for (std::size_t t = 0; t < 6; ++t) {
    const glm::uvec3 c = m.triangles[t];
    const vec3 across =
        glm::cross(m.positions[c.y] - m.positions[c.x], m.positions[c.z] - m.positions[c.x]);
    // Half a metre is one of the file's units.
    EXPECT_LT(glm::length(across - wanted[t / 2] * 0.25f), 1e-6f) << t;
  }
}

TEST_F(SceneExporters, PointSizesAreOfCloudsAlone) {
  const std::string face = "element face 1\nproperty list uchar int vertex_indices\n";
  const Scene s =
      import("a.ply", plyOf(kSquare + face, kCorners + "3 0 1 2\n"), {.pointSize = 0.25});
  EXPECT_EQ(s.triangleCount(), 1u);
  EXPECT_TRUE(anyWarning(s, "points are not shown"));
  try {
    import("a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", {.pointSize = 0.25});
    ADD_FAILURE();
  } catch (const Error& e) {
    EXPECT_EQ(e.code(), ExitCode::kUsage);
  }
}

TEST_F(SceneExporters, PlyTexturesOfVerticesAndWedges) {
  write("tex.png", tinyPng());
  const std::string name = "comment TextureFile tex.png\n";
  const std::string face = "element face 1\nproperty list uchar int vertex_indices\n";
  const Scene a =
      import("a.ply", plyOf(name +
                                "element vertex 3\nproperty float x\nproperty float y\n"
                                "property float z\nproperty float s\nproperty float t\n" +
                                face,
                            "0 0 0 0 0\n1 0 0 1 0\n0 1 0 0 1\n3 0 1 2\n"));
  const Scene b =
      import("b.ply", plyOf(name + kSquare +
                                "element face 2\nproperty list uchar int vertex_indices\n"
                                "property list uchar float texcoord\nproperty int texnumber\n",
                            kCorners + "3 0 1 2 6 0 0 1 0 1 1 0\n3 0 2 3 6 0.5 0 1 1 0 1 0\n"));
  for (const Scene* s : {&a, &b}) {
    const Material& m = s->materials[s->meshes[0].material];
    ASSERT_TRUE(m.baseColorTexture.present());
    EXPECT_EQ(m.baseColor, vec4(1));
    EXPECT_EQ(s->meshes[0].texCoords[0], vec2(0, 1));
    EXPECT_EQ(s->replaced.count, 0u);
  }
  // Vertex 0 has other coordinates in the second face.
  EXPECT_EQ(b.meshes[0].positions.size(), 5u);
}

TEST_F(SceneExporters, PlyColoursOfFacesAndOfAllTypes) {
  const Scene faces = import(
      "a.ply", plyOf(kSquare + "element face 2\nproperty list uchar int vertex_indices\n"
                               "property uchar red\nproperty uchar green\nproperty uchar blue\n",
                     kCorners + "3 0 1 2 255 0 0\n3 0 2 3 0 0 255\n"));
  ASSERT_EQ(faces.meshes[0].colors.size(), 6u);
  EXPECT_EQ(faces.meshes[0].colors[0], glm::u8vec4(255, 0, 0, 255));
  EXPECT_EQ(faces.meshes[0].colors[5], glm::u8vec4(0, 0, 255, 255));
  EXPECT_EQ(faces.materials[faces.meshes[0].material].baseColor, vec4(1));
  for (const auto& [type, row, color] :
       {std::tuple("uchar", "255 128 0", glm::u8vec4(255, 128, 0, 255)),
        {"int", "255 128 0", glm::u8vec4(255, 128, 0, 255)},
        {"ushort", "65535 32896 0", glm::u8vec4(255, 128, 0, 255)},
        {"float", "1 0.2158605 0", glm::u8vec4(255, 128, 0, 255)}}) {
    std::string header = "element vertex 3\nproperty float x\nproperty float y\nproperty float z\n";
    for (const char* c : {"red", "green", "blue"}) {
      header += std::string("property ") + type + " " + c + "\n";
    }
    const Scene s =
        import("b.ply", plyOf(header + "element face 1\n"
                                       "property list uchar int vertex_indices\n",
                              fmt::format("0 0 0 {0}\n1 0 0 {0}\n1 1 0 {0}\n3 0 1 2\n", row)));
    EXPECT_EQ(s.meshes[0].colors[0], color) << type;
  }
}

/// 64 dark greys of bytes keep apart through the importers of PLY and OBJ.
TEST_F(SceneExporters, DarkColoursOfFilesDoNotBand) {
  std::string ply =
      "element vertex 192\nproperty float x\nproperty float y\nproperty float z\n"
      "property uchar red\nproperty uchar green\nproperty uchar blue\n"
      "element face 64\nproperty list uchar int vertex_indices\n";
  std::string rows, faces, obj;
  for (int i = 0; i < 64; ++i) {
    for (const char* corner : {"0 0", "1 0", "0 1"}) {
      rows += fmt::format("{0} {1} {1} {1} {1}\n", corner, i);
      obj +=
          fmt::format("v {} {} {:.6f} {:.6f} {:.6f}\n", corner, i, i / 255.0, i / 255.0, i / 255.0);
    }
    faces += fmt::format("3 {} {} {}\n", 3 * i, 3 * i + 1, 3 * i + 2);
    obj += "f -3 -2 -1\n";
  }
  const Scene a = import("a.ply", plyOf(ply, rows + faces)), b = import("b.obj", obj);
  for (const Scene* s : {&a, &b}) {
    const Mesh& m = s->meshes[0];
    ASSERT_EQ(m.colors.size(), 192u);
    for (std::size_t v = 0; v < 192; ++v) {
      const int grey = static_cast<int>(std::lround(m.positions[v].z));
      const float right = decodeSrgb8(static_cast<std::uint8_t>(grey));
      EXPECT_EQ(unpackVertexColor(m.colors[v]), vec4(right, right, right, 1.0f));
    }
  }
}

TEST_F(SceneExporters, PlyFacesBeforeTheirVertices) {
  const std::string face = "element face 1\nproperty list uchar int vertex_indices\n";
  const Scene a = import("a.ply", plyOf(face + kSquare, "4 0 1 2 3\n" + kCorners));
  EXPECT_EQ(a.triangleCount(), 2u);
  EXPECT_EQ(a.replaced.count, 0u);
  EXPECT_NEAR(area(a.meshes[0]), 1.0, 1e-6);
  const Scene b =
      import("b.ply", plyOf("element tristrips 1\nproperty list int int vertex_indices\n" + kSquare,
                            "4 0 1 3 2\n" + kCorners));
  EXPECT_NEAR(area(b.meshes[0]), 1.0, 1e-6);
}

TEST_F(SceneExporters, PlyColoursOfFloatsAboveOneAreSaid) {
  std::string header = kSquare;
  for (const char* c : {"red", "green", "blue"}) {
    header += std::string("property float ") + c + "\n";
  }
  const std::string rows = "0 0 0 255 128 0\n1 0 0 1 1 1\n1 1 0 0.5 0 0\n0 1 0 0 0 0\n4 0 1 2 3\n";
  const Scene s = import(
      "a.ply", plyOf(header + "element face 1\nproperty list uchar int vertex_indices\n", rows));
  EXPECT_TRUE(anyReplaced(s, "1 colours of floats are above 1"));
  EXPECT_EQ(s.meshes[0].colors[0], glm::u8vec4(255, 255, 0, 255));
}

TEST_F(SceneExporters, PlyTextKeepsItsDigits) {
  const Scene s = import(
      "a.ply", plyOf("element vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
                     "element face 1\nproperty list uchar int vertex_indices\n",
                     "5000000.001 0 0\n5000000.002 0 0\n5000000.001 1 0\n3 0 1 2\n"));
  EXPECT_NEAR(s.bounds().size().x, 0.001, 1e-8);
}

TEST_F(SceneExporters, PlyBehindAByteOrderMark) {
  const Scene s =
      import("a.ply", "\xef\xbb\xbf" + plyOf(kSquare + "element face 1\n"
                                                       "property list uchar int vertex_indices\n",
                                             kCorners + "4 0 1 2 3\n"));
  EXPECT_EQ(s.triangleCount(), 2u);
}

/// Each of 64 dark greys of sRGB bytes and of 16 bits is kept apart, and keeps its value.
TEST(VertexColours, DarkOnesDoNotBand) {
  for (int i = 0; i < 256; ++i) {
    const float linear = decodeSrgb8(static_cast<std::uint8_t>(i));
    const glm::u8vec4 packed = packVertexColor(vec4(linear, linear, linear, 1.0f));
    EXPECT_EQ(packed, glm::u8vec4(i, i, i, 255));
    EXPECT_EQ(unpackVertexColor(packed), vec4(linear, linear, linear, 1.0f));
    const float sixteen = std::round(linear * 65535.0f) / 65535.0f;
    EXPECT_EQ(packVertexColor(vec4(sixteen)).x, i);
  }
  EXPECT_EQ(packVertexColor(vec4(-1.0f, 2.0f, std::nanf(""), 0.5f)), glm::u8vec4(0, 255, 0, 128));
}

/// Half of the world writes a comma, Fortran a D.
TEST_F(SceneExporters, OptionsOfMapsThatAreNotShownAreSaid) {
  write("a.png", tinyPng());
  for (const char* line : {"map_Kd -mm 0.1 0.5 a.png", "map_d -imfchan r a.png", "map_Ns a.png"}) {
    material(line);
    EXPECT_TRUE(anyWarning(scene_, "not shown")) << line;
  }
  material("map_Kd -mm 0 1 a.png");
  EXPECT_FALSE(anyWarning(scene_, "not shown"));
}

TEST_F(SceneExporters, TexturesBesideTheModelOfALibraryElsewhere) {
  std::filesystem::create_directories(folder_ / "sub");
  write("a.png", tinyPng());
  write("sub/m.mtl", "newmtl m\nmap_Kd a.png\n");
  const Scene s = import("m.obj",
                         "mtllib sub/m.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0\nvt 0 0\nusemtl m\n"
                         "f 1/1 2/1 3/1\n");
  EXPECT_EQ(s.replaced.count, 0u);
  EXPECT_TRUE(s.materials[s.meshes[0].material].baseColorTexture.present());
}

TEST_F(SceneExporters, FilesThatWereJoinedHaveMarksInside) {
  const Scene s = import("a.obj",
                         "v 0 0 0\n\xef\xbb\xbfv 1 0 0\n\xef\xbb\xbf\n"
                         "\xef\xbb\xbf v 1 1 0\nf 1 2 3\n");
  EXPECT_EQ(s.meshes[0].positions.size(), 3u);
}

TEST_F(SceneExporters, CapitalsOfPlyAndOfNames) {
  const std::string text =
      "ply\nformat ascii 1.0\nelement vertex 3\nproperty float X\nproperty float Y\n"
      "property float Z\nproperty uchar Red\nproperty uchar Green\nproperty uchar Blue\n"
      "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
      "0 0 0 1 2 3\n1 0 0 1 2 3\n0 1 0 1 2 3\n3 0 1 2\n";
  const Scene s = import("A.PLY", text);
  EXPECT_EQ(s.meshes[0].colors.at(0), glm::u8vec4(1, 2, 3, 255));
  for (const char* name : {"B.PLY", "C.OBJ", "D.STL"}) {
    std::string bytes = name[0] == 'B' ? text : "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
    if (name[0] == 'D')
      bytes = std::string(80, '\0') + std::string("\1\0\0\0", 4) + std::string(50, '\1');
    const auto stream = openTriangleStream(write(name, bytes), {});
    ASSERT_TRUE(stream) << name;
    EXPECT_EQ(stream->triangleCount(), 1u) << name;
  }
}

TEST_F(SceneExporters, NumbersOfOtherTongues) {
  const std::vector<vec3> right = {{0.5f, 0, 0}, {100, 0, 0}, {0, -1.25f, 0}};
  const Scene obj = import("a.obj", "v 0,5 0,0 0\nv 1.0D+2 0 0\nv 0 -1,25 0\nf 1 2 3\n");
  const auto expectRight = [&](const Mesh& m) {
    for (std::size_t i = 0; i < 3; ++i) EXPECT_EQ(vec3(m.origin) + m.positions[i], right[i]);
  };
  expectRight(obj.meshes[0]);
  EXPECT_EQ(obj.replaced.count, 0u);
  const Scene stl =
      import("a.stl",
             "solid a\nfacet normal 0 0 1\nouter loop\nvertex 0,5 0 0\nvertex 1d2 0 0\n"
             "vertex 0 -1,25 0\nendloop\nendfacet\nendsolid a\n");
  expectRight(stl.meshes[0]);
  EXPECT_TRUE(
      anyReplaced(import("b.obj", "v 0,5,5 0 0\nv 1 0 0\nv 0 1 0\nv 2 2 2\nf 4 2 3\n"), "0,5,5"));
  EXPECT_TRUE(anyReplaced(import("c.obj", "v 1,000.5 0 0\nv 1 0 0\nv 0 1 0\nv 2 2 2\nf 4 2 3\n"),
                          "1,000.5"));
}

TEST_F(SceneExporters, MaterialsOfARenamedModel) {
  write("new.mtl", "newmtl x\nKd 1 0 0\n");
  const std::string model = "mtllib old.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl x\nf 1 2 3\n";
  const Scene s = import("new.obj", model);
  EXPECT_EQ(s.materials[s.meshes[0].material].baseColor, vec4(1, 0, 0, 1));
  EXPECT_EQ(s.replaced.count, 1u);
  EXPECT_TRUE(anyReplaced(s, "old.mtl; new.mtl is used"));
  EXPECT_TRUE(anyReplaced(import("other.obj", model), "old.mtl; grey is used"));
}

}  // namespace
}  // namespace trex::test
