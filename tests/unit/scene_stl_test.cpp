// STL, and the unit and the upward axis of files that tell neither.
#include "src/scene/triangle_stream.h"
#include "tests/unit/scene_helpers.h"

namespace trex::test {
namespace {

class SceneStl : public SceneTest {
 protected:
  /// Binary: the facets of a tetrahedron of edges 1, with `said` as the count of the header.
  static std::string binary(std::uint32_t said = 4, const std::string& head = "made by a test") {
    std::string out = head;
    out.resize(80);
    out.append(reinterpret_cast<const char*>(&said), 4);
    for (const auto& facet : kFacets) {
      const float values[12] = {0,          0,          0,          facet[0].x,
                                facet[0].y, facet[0].z, facet[1].x, facet[1].y,
                                facet[1].z, facet[2].x, facet[2].y, facet[2].z};
      out.append(reinterpret_cast<const char*>(values), 48).append(2, '\0');
    }
    return out;
  }
  static std::string text(const char* end = "\n") {
    std::string out = std::string("solid thing") + end;
    for (const auto& facet : kFacets) {
      out += std::string("facet normal 0 0 0") + end + " outer loop" + end;
      for (const vec3& p : facet) out += fmt::format("  vertex {} {} {}{}", p.x, p.y, p.z, end);
      out += std::string(" endloop") + end + "endfacet" + end;
    }
    return out + "endsolid thing" + end;
  }
  static constexpr std::array<std::array<vec3, 3>, 4> kFacets = {
      {{vec3(0, 0, 0), vec3(0, 1, 0), vec3(1, 0, 0)},
       {vec3(0, 0, 0), vec3(1, 0, 0), vec3(0, 0, 2)},
       {vec3(0, 0, 0), vec3(0, 0, 2), vec3(0, 1, 0)},
       {vec3(1, 0, 0), vec3(0, 1, 0), vec3(0, 0, 2)}}};
};

TEST_F(SceneStl, TextAndBinaryAreOneMesh) {
  std::string upper = text();
  for (char& c : upper) c = static_cast<char>(std::toupper(static_cast<unsigned char>(c)));
  for (const std::string& file :
       {text(), text("\r\n"), upper, binary(), binary(4, "solid binary"), binary() + "rest"}) {
    const Scene s = import("a.stl", file);
    EXPECT_EQ(s.replaced.count, 0u);
    ASSERT_EQ(s.meshes.size(), 1u);
    EXPECT_EQ(s.meshes[0].triangles.size(), 4u);
    EXPECT_EQ(s.meshes[0].positions.size(), 4u);  // shared again
    EXPECT_EQ(s.bounds().upper, dvec3(1, 1, 2));
    EXPECT_TRUE(anyWarning(s, "--unit"));
  }
}

TEST_F(SceneStl, ColoursInAttributesAreTold) {
  std::string file = binary();
  file[84 + 50 - 1] = '\x7c';
  const Scene s = import("a.stl", file);
  EXPECT_TRUE(anyWarning(s, "attributes of 1 facets"));
  EXPECT_TRUE(anyWarning(openTriangleStream(s.source, {})->scene(), "attributes of 1 facets"));
  EXPECT_FALSE(anyWarning(import("b.stl", binary()), "attributes"));
}

TEST_F(SceneStl, CountsThatLieAndFacetsThatAreCut) {
  for (const std::uint32_t said : {0u, 9u, 0xffffffffu}) {
    const Scene s = import("a.stl", binary(said));
    EXPECT_EQ(s.triangleCount(), 4u) << said;
    EXPECT_TRUE(anyReplaced(s, "header says")) << said;
  }
  EXPECT_EQ(import("a.stl", binary().substr(0, 84 + 120)).triangleCount(), 2u);
  EXPECT_TRUE(anyReplaced(import("a.stl", text().substr(0, text().rfind("vertex"))),
                          "fewer than 3 vertices"));
  const Scene s = import("a.stl", text() + "facet\nvertex 1 x 2\nvertex 0 0 0\nvertex 1 1 1\n");
  EXPECT_TRUE(anyReplaced(s, "no numbers"));
  EXPECT_EQ(s.droppedTriangles, 1u);
  for (const std::string& bad : {std::string("hello"), std::string("solid\nendsolid\n"),
                                 std::string(84, '\0'), std::string(60, 'x')}) {
    EXPECT_THROW(import("bad.stl", bad), Error) << bad;
  }
}

TEST_F(SceneStl, StreamsAreTheImport) {
  const auto path = write("a.stl", binary());
  ImportOptions options;
  options.unit = parseUnit("mm");
  options.zUp = true;
  for (const ImportOptions& o : {ImportOptions{}, options}) {
    const auto stream = openTriangleStream(path, o);
    EXPECT_EQ(stream->triangleCount(), 4u);
    EXPECT_EQ(stream->residentBytes(), 0u);  // mapped
    const Scene whole = importScene(path, o);
    const Box3d box = whole.bounds(), streamed = sceneOfStream(*stream).bounds();
    for (int k = 0; k < 3; ++k) {
      EXPECT_NEAR(streamed.lower[k], box.lower[k], 1e-9);
      EXPECT_NEAR(streamed.upper[k], box.upper[k], 1e-9);
    }
  }
  EXPECT_NE(openTriangleStream(path, options)->key(), openTriangleStream(path, {})->key());
}

TEST_F(SceneStl, UnitsAndUp) {
  EXPECT_EQ(parseUnit("mm"), 0.001);
  EXPECT_EQ(parseUnit("in"), 0.0254);
  EXPECT_EQ(parseUnit("2.5"), 2.5);
  for (const char* bad : {"", "yard", "-1", "0", "nan", "1e300"}) {
    EXPECT_THROW(parseUnit(bad), Error) << bad;
  }
  ImportOptions options;
  options.unit = 0.5;
  options.zUp = true;
  for (const auto& [name, file] : {std::pair<std::string, std::string>{"a.stl", binary()},
                                   {"a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 2\nf 1 2 3\n"}}) {
    const Box3d box = import(name, file, options).bounds();
    EXPECT_EQ(box.lower, dvec3(0, 0, -0.5)) << name;
    EXPECT_EQ(box.upper, dvec3(0.5, 1, 0)) << name;
  }
  GlbBuilder b = triangleGlb();
  EXPECT_THROW(import("a.glb", b.glb(), options), Error);
  ImportOptions scene;
  scene.scene = "0";
  EXPECT_THROW(import("a.stl", binary(), scene), Error);
}

}  // namespace
}  // namespace trex::test
