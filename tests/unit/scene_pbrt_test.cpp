// pbrt files: their text, transforms, instances and shapes, and what is said of what is wrong.
#include <glm/gtc/matrix_transform.hpp>

#include "tests/unit/scene_helpers.h"

namespace trex::test {
namespace {

/// A camera of a right-handed world: what follows is in pbrt's coordinates as they are.
const std::string kHead = "Scale -1 1 1\nCamera \"perspective\"\nWorldBegin\n";
const std::string kTriangle =
    "Shape \"trianglemesh\" \"point P\" [0 0 0  1 0 0  0 1 0] \"integer indices\" [0 1 2]\n";

class ScenePbrt : public SceneTest {
 protected:
  Scene read(const std::string& world, const std::string& head = kHead) const {
    return import("a.pbrt", head + world);
  }
  /// Where the first vertex of each instance lies.
  static std::vector<dvec3> places(const Scene& s) {
    std::vector<dvec3> all;
    for (const Instance& i : s.instances) {
      const Mesh& m = s.meshes[i.mesh];
      all.emplace_back(i.transform * glm::dvec4(m.origin + dvec3(m.positions[0]), 1.0));
    }
    return all;
  }
  static void expectNear(const dvec3& a, const dvec3& b, double error = 1e-9) {
    EXPECT_LT(glm::length(a - b), error)
        << a.x << " " << a.y << " " << a.z << " is not " << b.x << " " << b.y << " " << b.z;
  }
  void expectRefused(const std::string& world, const std::string& message) const {
    try {
      read(world);
      ADD_FAILURE() << "accepted: " << world;
    } catch (const Error& e) {
      EXPECT_EQ(e.code(), ExitCode::kInput);
      EXPECT_NE(std::string(e.what()).find(message), std::string::npos) << e.what();
      EXPECT_NE(std::string(e.what()).find("a.pbrt:"), std::string::npos) << e.what();
    }
  }
};

TEST_F(ScenePbrt, TransformsMultiplyFromTheRight) {
  const Scene s = read(
      "Translate 1 2 3\nRotate 90 0 0 1\nScale 2 3 4\n"
      "Shape \"trianglemesh\" \"point3 P\" [1 0 0  1 1 0  0 1 1]\n");
  EXPECT_EQ(s.replaced.count, 0u);
  // Scaled to (2, 0, 0), turned to (0, 2, 0), moved.
  expectNear(places(s)[0], {1, 4, 3});
}

TEST_F(ScenePbrt, MatricesAreColumnAfterColumn) {
  const Scene s = read("Translate 5 5 5\nTransform [1 0 0 0  0 1 0 0  0 0 1 0  7 8 9 1]\n" +
                       kTriangle + "ConcatTransform [2 0 0 0 0 2 0 0 0 0 2 0 1 1 1 1]\n" +
                       kTriangle + "Identity\n" + kTriangle);
  const auto at = places(s);
  ASSERT_EQ(at.size(), 3u);
  expectNear(at[0], {7, 8, 9});
  expectNear(at[1], {8, 9, 10});
  expectNear(at[2], {0, 0, 0});
}

TEST_F(ScenePbrt, StacksKeepWhatTheySay) {
  const Scene s = read(
      "Translate 1 0 0\nAttributeBegin\nTranslate 1 0 0\nMaterial "
      "\"mirror\"\nReverseOrientation\n" +
      kTriangle + "TransformBegin\nTranslate 1 0 0\nMaterial \"glass\"\nTransformEnd\n" +
      kTriangle + "AttributeEnd\n" + kTriangle);
  const auto at = places(s);
  ASSERT_EQ(at.size(), 3u);
  expectNear(at[0], {2, 0, 0});
  expectNear(at[1], {2, 0, 0});
  expectNear(at[2], {1, 0, 0});
  const auto material = [&](int i) { return s.materials[s.meshes[s.instances[i].mesh].material]; };
  EXPECT_EQ(material(0).metallic, 1.0f);
  EXPECT_EQ(material(1).transmission, 1.0f);  // TransformEnd keeps the material
  EXPECT_EQ(material(2).metallic, 0.0f);
  EXPECT_EQ(s.meshes[0].triangles[0], glm::uvec3(0, 2, 1));
  EXPECT_EQ(s.meshes[2].triangles[0], glm::uvec3(0, 1, 2));
}

TEST_F(ScenePbrt, CoordinateSystems) {
  const Scene s = read(
      "Translate 3 0 0\nCoordinateSystem \"there\"\nIdentity\n"
      "CoordSysTransform \"there\"\n" +
          kTriangle + "CoordSysTransform \"camera\"\n" + kTriangle,
      "Scale -1 1 1\nTranslate 0 0 4\nCamera \"perspective\"\nWorldBegin\n");
  const auto at = places(s);
  expectNear(at[0], {3, 0, 0});
  expectNear(at[1], {0, 0, -4});  // the camera's own place
}

TEST_F(ScenePbrt, MotionIsShownAtTheStartAndSaid) {
  const Scene s = read(
      "ActiveTransform EndTime\nTranslate 9 0 0\nActiveTransform All\n"
      "Translate 1 0 0\n" +
          kTriangle,
      "TransformTimes 0 1\n" + kHead);
  expectNear(places(s)[0], {1, 0, 0});
  EXPECT_TRUE(anyReplaced(s, "moves"));
}

TEST_F(ScenePbrt, InstancesLieUnderBothTransforms) {
  const Scene s = read("Translate 1 0 0\nObjectBegin \"o\"\nTranslate 0 1 0\n" + kTriangle +
                       "Shape \"sphere\" \"float radius\" 2\nObjectEnd\n"
                       "AttributeBegin\nScale 2 2 2\nObjectInstance \"o\"\nAttributeEnd\n"
                       "ObjectInstance \"o\"\n");
  ASSERT_EQ(s.instances.size(), 4u);
  EXPECT_EQ(s.meshes.size(), 2u);
  const auto at = places(s);
  // CTM of the instance times that of the definition: (1 0 0) * scale 2 * (1 1 0).
  expectNear(at[0], {3, 2, 0});
  expectNear(at[2], {2, 1, 0});
  EXPECT_EQ(s.instances[0].object, s.instances[1].object);
  EXPECT_NE(s.instances[0].object, s.instances[2].object);
  EXPECT_EQ(s.instances[0].name, "o");
  EXPECT_NEAR(glm::length(dvec3(s.instances[1].transform[0])), 4.0, 1e-9);  // radius and scale
}

TEST_F(ScenePbrt, ObjectsDoNotShineAsInPbrt) {
  const Scene s =
      read("ObjectBegin \"o\"\nAreaLightSource \"diffuse\" \"rgb L\" [1 1 1]\n" + kTriangle +
           "ObjectInstance \"p\"\nObjectEnd\nObjectInstance \"o\"\n"
           "ObjectInstance \"none\"\n");
  EXPECT_EQ(s.instances.size(), 1u);
  EXPECT_FALSE(s.materials[s.meshes[0].material].emits());
  EXPECT_TRUE(anyReplaced(s, "do not shine"));
  EXPECT_TRUE(anyReplaced(s, "ObjectInstance \"p\""));
  EXPECT_TRUE(anyReplaced(s, "ObjectInstance \"none\""));
}

TEST_F(ScenePbrt, EqualShapesShareTheirMesh) {
  std::string world;
  for (int i = 0; i < 50; ++i) {
    world += fmt::format(
        "AttributeBegin\nTranslate {} 0 0\nShape \"sphere\" \"float radius\" {}\n"
        "AttributeEnd\n",
        i, 0.1 * (i + 1));
  }
  const Scene s = read(world + "Material \"mirror\"\nShape \"sphere\"\n");
  ASSERT_EQ(s.meshes.size(), 2u);  // one a material
  EXPECT_EQ(s.meshes[1].sameGeometryAs, 0);
  EXPECT_EQ(s.instances.size(), 51u);
  const Box3d box = s.bounds();
  EXPECT_NEAR(box.upper.x, 49.0 + 5.0, 0.01);
}

TEST_F(ScenePbrt, QuadricsAreTheirParts) {
  const Scene s = read(
      "Shape \"disk\" \"float height\" 2 \"float radius\" 3 \"float innerradius\" 1\n"
      "Shape \"cylinder\" \"float radius\" 2 \"float zmin\" -1 \"float zmax\" 4\n"
      "Shape \"sphere\" \"float radius\" 2 \"float zmin\" 0 \"float phimax\" 90\n");
  ASSERT_EQ(s.instances.size(), 3u);
  const auto box = [&](int i) {
    Scene one;
    one.meshes = s.meshes;
    one.instances = {s.instances[i]};
    return one.bounds();
  };
  expectNear(box(0).lower, {-3, -3, 2}, 0.01);
  expectNear(box(0).upper, {3, 3, 2}, 0.01);
  expectNear(box(1).lower, {-2, -2, -1}, 0.01);
  expectNear(box(1).upper, {2, 2, 4}, 0.01);
  expectNear(box(2).lower, {0, 0, 0}, 0.01);
  expectNear(box(2).upper, {2, 2, 2}, 0.01);
}

TEST_F(ScenePbrt, FrontsFollowNormalsAndOrientation) {
  const std::string normals =
      "Shape \"trianglemesh\" \"point P\" [0 0 0 1 0 0 0 1 0] "
      "\"normal N\" [0 0 -1 0 0 -1 0 0 -1]\n";
  const Scene s = read(normals + "ReverseOrientation\n" + normals + kTriangle);
  // Counter-clockwise as seen from where the normals point; pbrt-v3 does not turn those.
  EXPECT_EQ(s.meshes[0].triangles[0], glm::uvec3(0, 2, 1));
  EXPECT_EQ(s.meshes[1].triangles[0], glm::uvec3(0, 2, 1));
  EXPECT_EQ(s.meshes[2].triangles[0], glm::uvec3(0, 2, 1));
  const Scene v4 = read("ReverseOrientation\n" + normals,
                        "Scale -1 1 1\nFilm \"rgb\"\nCamera \"perspective\"\nWorldBegin\n");
  EXPECT_EQ(v4.meshes[0].triangles[0], glm::uvec3(0, 1, 2));
  EXPECT_EQ(v4.meshes[0].normals[0], vec3(0, 0, 1));
}

TEST_F(ScenePbrt, BilinearPatches) {
  // p00, p10, p01, p11: a flat square is two triangles that face +z; a twisted one is finer.
  const Scene s = read(
      "Shape \"bilinearmesh\" \"point3 P\" [0 0 0 1 0 0 0 1 0 1 1 0]\n"
      "Shape \"bilinearmesh\" \"point3 P\" [0 0 0 1 0 0 0 1 0 1 1 1]\n");
  EXPECT_EQ(s.meshes[0].triangles.size(), 2u);
  for (const glm::uvec3& t : s.meshes[0].triangles) {
    const auto& p = s.meshes[0].positions;
    EXPECT_GT(glm::cross(p[t.y] - p[t.x], p[t.z] - p[t.x]).z, 0.0f);
  }
  ASSERT_GT(s.meshes[1].triangles.size(), 50u);
  for (const vec3& p : s.meshes[1].positions) EXPECT_NEAR(p.z, p.x * p.y, 1e-6);
}

TEST_F(ScenePbrt, PlyMeshesAreReadOnce) {
  write("m.ply",
        "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\n"
        "property float z\nproperty float u\nproperty float v\nelement face 1\n"
        "property list uchar int vertex_indices\nend_header\n0 0 0 0 0\n1 0 0 1 0\n1 1 0 1 1\n"
        "0 1 0 0 1\n4 0 1 2 3\n");
  const Scene s = read(
      "Shape \"plymesh\" \"string filename\" \"m.ply\"\nMaterial \"mirror\"\n"
      "Shape \"plymesh\" \"string filename\" [\"m.ply\"]\nTranslate 1 0 0\n"
      "Shape \"plymesh\" \"string filename\" [\"m.ply\"]\n"
      "Shape \"plymesh\" \"string filename\" [\"none.ply\"]\n");
  EXPECT_EQ(s.meshes.size(), 2u);
  EXPECT_EQ(s.instances.size(), 3u);
  EXPECT_EQ(s.triangleCount(), 6u);
  EXPECT_EQ(s.meshes[0].texCoords[0], vec2(0, 1));
  EXPECT_EQ(s.files.size(), 2u);
  EXPECT_TRUE(anyReplaced(s, "none.ply"));
}

TEST_F(ScenePbrt, IncludesAndImports) {
  write("in.pbrt", "Translate 1 0 0\nMaterial \"mirror\"\nAttributeBegin\n");
  write("b.pbrt", "Translate 0 1 0\nAttributeBegin\n" + kTriangle);
  const Scene s = read("Include \"in.pbrt\"\nImport \"b.pbrt\"\n" + kTriangle + "AttributeEnd\n");
  EXPECT_EQ(s.replaced.count, 0u);
  const auto at = places(s);
  expectNear(at[0], {1, 1, 0});
  expectNear(at[1], {1, 0, 0});  // what an Import changes ends with it
  EXPECT_EQ(s.materials[s.meshes[1].material].metallic, 1.0f);
  EXPECT_EQ(s.files.size(), 3u);
}

TEST_F(ScenePbrt, IncludesThatDoNotEnd) {
  write("loop.pbrt", "Include \"other.pbrt\"\n");
  write("other.pbrt", kTriangle + "Include \"loop.pbrt\"\nInclude \"none.pbrt\"\n");
  const Scene s = read("Include \"loop.pbrt\"\n");
  EXPECT_EQ(s.instances.size(), 1u);
  EXPECT_TRUE(anyReplaced(s, "other.pbrt:2: Include \"loop.pbrt\": it includes itself"));
  EXPECT_TRUE(anyReplaced(s, "none.pbrt"));
  EXPECT_THROW(importScene(folder_ / "a.pbrt", {.strict = true}), Error);
}

TEST_F(ScenePbrt, TextAsExportersWriteIt) {
  const std::string text =
      "\xef\xbb\xbf# made by a test\r\nScale -1 1 1 # mirrored\r\n"
      "Camera\"perspective\"\"float fov\"[40]WorldBegin\r\n"
      "Shape\"trianglemesh\"\"point P\"[0 0 0 +1 0 0 0 1e0 .0]# end\r\n"
      "\"bool alpha_\" [\"true\"] \"integer indices\"[0\r\n1 2]WorldEnd";
  const Scene s = import("a.pbrt", text);
  EXPECT_EQ(s.triangleCount(), 1u);
  EXPECT_TRUE(anyReplaced(s, "bool alpha_"));
  EXPECT_EQ(s.cameras.size(), 1u);
  // Escapes are resolved: the file is called a"b.ply.
  EXPECT_TRUE(anyReplaced(
      read("Shape \"plymesh\" \"string filename\" \"a\\\"b.ply\"\n" + kTriangle), "a\"b.ply"));
}

TEST_F(ScenePbrt, WhatIsNoPbrtIsRefusedWithItsLine) {
  expectRefused("Shape \"sphere", "a.pbrt:4: a string without its closing quote");
  expectRefused("Shape \"sphere\n\"", "closing quote");
  expectRefused("\nShape \"sphere\" \"float radius\" [1 2\n", "a.pbrt:5");
  expectRefused("Translate 1 2\n" + kTriangle, "a number should be");
  expectRefused("Translate [1 2 3 4]\n", "bracket");
  expectRefused("Shape sphere\n", "string in quotes");
  expectRefused("Shape \"sphere\" \"radius\" 1\n", "type and name");
  expectRefused("Shape \"sphere\" \"float radius\"\n", "no value");
  expectRefused("Shape \"sphere\" \"float radius\" [ 1 abc ]\n", "'abc'");
  expectRefused("]\n", "directive");
  expectRefused("ActiveTransform \"a\"\n", "want StartTime");
  expectRefused("", "no triangle");
}

TEST_F(ScenePbrt, WhatIsNotKnownIsSaidAndTheRestShown) {
  struct Case {
    const char *text, *message;
  };
  for (const Case& c :
       {Case{"Bogus \"a\" \"float b\" [1 2]\n", "Bogus: this directive"},
        {"Shape \"loopsubdiv\" \"point P\" [0 0 0]\n", "Shape \"loopsubdiv\""},
        {"Shape \"curve\" \"point P\" [0 0 0]\n", "Shape \"curve\""},
        {"Shape \"cone\"\n", "Shape \"cone\""},
        {"Shape \"sphere\" \"float radius\" -1\n", "radius"},
        {"Shape \"trianglemesh\" \"integer indices\" [0 1 5] \"point P\" [0 0 0 1 0 "
         "0 0 1 0]\n",
         "that exist"},
        {"Shape \"trianglemesh\"\n", "no indices"},
        {"Scale 0 1 1\nShape \"sphere\"\nIdentity\n", "transform"},
        {"Rotate 1 0 0 0\n", "no transform"},
        {"AttributeEnd\n", "not begun"},
        {"AttributeBegin\n", "still open"},
        {"TransformBegin\nAttributeEnd\nTransformEnd\n", "not begun"},
        {"NamedMaterial \"none\"\n", "no material"},
        {"Material \"bogus\"\n", "not known"},
        {"LightSource \"bogus\"\n", "not known"},
        {"CoordSysTransform \"bogus\"\n", "no coordinate system"},
        {"Texture \"a\" \"spectrum\" \"marble\"\n", "not shown as a texture"},
        {"Material \"matte\" \"texture Kd\" \"none\"\n", "no texture 'none'"},
        {"Shape \"sphere\" \"float bogus\" 2\n", "float bogus"},
        {"Shape \"sphere\" \"float radius\" [nan]\n", "not finite"},
        {"Shape \"sphere\" \"float radius\" \"one\"\n", "no number"},
        {"MakeNamedMedium \"m\" \"string type\" \"heterogeneous\"\n", "medium"},
        {"ColorSpace \"bogus\"\n", "colour space"}}) {
    const Scene s = read(c.text + kTriangle);
    EXPECT_GE(s.instances.size(), 1u) << c.text;
    EXPECT_TRUE(anyReplaced(s, c.message))
        << c.text << (s.replaced.texts.empty() ? "" : s.replaced.texts[0]);
    EXPECT_TRUE(anyReplaced(s, "a.pbrt:")) << c.text;
    EXPECT_THROW(importScene(folder_ / "a.pbrt", {.strict = true}), Error) << c.text;
  }
}

TEST_F(ScenePbrt, WhatSaysHowToRenderIsRead) {
  const Scene s = read(kTriangle + "WorldEnd\n",
                       "Option \"seed\" 1\nOption \"rendercoordsys\" \"world\"\n"
                       "Sampler \"halton\" \"integer pixelsamples\" [16]\nIntegrator \"path\"\n"
                       "PixelFilter \"box\" \"float xwidth\" 1\nAccelerator \"bvh\"\n" +
                           kHead);
  EXPECT_EQ(s.replaced.count, 0u);
  expectRefused("Option \"seed\" [", "value is missing");
}

TEST_F(ScenePbrt, DepthOfTheIntegratorLimitsBounces) {
  const auto most = [&](const std::string& integrator, const ImportOptions& options = {}) {
    read(kTriangle, integrator + kHead);
    return importScene(folder_ / "a.pbrt", options).maxBounces;
  };
  EXPECT_EQ(most(""), Scene::kAnyBounces);
  EXPECT_EQ(most("Integrator \"path\"\n"), Scene::kAnyBounces);
  EXPECT_EQ(most("Integrator \"path\" \"integer maxdepth\" [ 65 ]\n"), 65u);
  EXPECT_EQ(most("SurfaceIntegrator \"bdpt\" \"integer maxdepth\" 0\n"), 0u);
  EXPECT_EQ(most("Integrator \"volpath\" \"integer maxdepth\" -1\n"), Scene::kAnyBounces);
  EXPECT_EQ(most("Integrator \"path\" \"integer maxdepth\" 2\n", {.maxBounces = 7}), 7u);
  EXPECT_EQ(most("Integrator \"directlighting\" \"integer maxdepth\" 2\n"), Scene::kAnyBounces);
  const Scene s = read(kTriangle, "Integrator \"ambientocclusion\"\n" + kHead);
  EXPECT_TRUE(std::any_of(s.warnings.begin(), s.warnings.end(), [](const std::string& w) {
    return w.find("a.pbrt:1: Integrator \"ambientocclusion\": the picture is that of paths") !=
           std::string::npos;
  }));
}

TEST_F(ScenePbrt, AttributesAreParametersOfWhatFollows) {
  const Scene s = read(
      "AttributeBegin\nAttribute \"shape\" \"float radius\" 2 \"float zmax\" 0\n"
      "Attribute \"shape\" \"float radius\" 3\n"
      "Attribute \"material\" \"rgb reflectance\" [.1 .2 .3]\n"
      "Material \"diffuse\"\nShape \"sphere\"\nShape \"sphere\" \"float radius\" 5\n"
      "AttributeEnd\nShape \"sphere\"\n");
  EXPECT_EQ(s.replaced.count, 0u);
  ASSERT_EQ(s.instances.size(), 3u);
  const auto radius = [&](int i) { return glm::length(dvec3(s.instances[i].transform[0])); };
  EXPECT_NEAR(radius(0), 3.0, 1e-9);
  EXPECT_NEAR(radius(1), 5.0, 1e-9);
  EXPECT_NEAR(radius(2), 1.0, 1e-9);
  EXPECT_EQ(s.materials[s.meshes[0].material].baseColor, vec4(0.1f, 0.2f, 0.3f, 1.0f));
  EXPECT_LT(s.meshes[0].positions.size(), s.meshes.back().positions.size());  // half a sphere
}

TEST_F(ScenePbrt, NamesAreOneLineOfUtf8) {
  const Scene s = read("ObjectBegin \"\xe9t\xe9\"\n" + kTriangle +
                       "ObjectEnd\n"
                       "ObjectInstance \"\xe9t\xe9\"\nShape \"a\\nb\xff\"\n");
  EXPECT_EQ(s.instances[0].name, "\xc3\xa9t\xc3\xa9");
  EXPECT_EQ(s.objects[0], "\xc3\xa9t\xc3\xa9");
  ASSERT_EQ(s.replaced.texts.size(), 1u);
  EXPECT_EQ(s.replaced.texts[0].find('\n'), std::string::npos);
  EXPECT_NE(s.replaced.texts[0].find("a b\xc3\xbf"), std::string::npos) << s.replaced.texts[0];
}

TEST_F(ScenePbrt, UnitsAreOfBareModels) {
  ImportOptions options;
  options.zUp = true;
  EXPECT_THROW(import("a.pbrt", kHead + kTriangle, options), Error);
}

TEST_F(ScenePbrt, GeometryIsThatOfTheSameObj) {
  const Scene obj = import("a.obj", "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 2\nf 1 2 3\nf 1 3 4\n");
  const Scene s = read(
      "Shape \"trianglemesh\" \"point P\" [0 0 0 1 0 0 1 1 0 0 1 2] "
      "\"integer indices\" [0 1 2 0 2 3]\n");
  ASSERT_EQ(s.meshes.size(), 1u);
  EXPECT_EQ(s.meshes[0].triangles, obj.meshes[0].triangles);
  EXPECT_EQ(s.meshes[0].positions, obj.meshes[0].positions);
  EXPECT_EQ(s.instances[0].transform, obj.instances[0].transform);
}

}  // namespace
}  // namespace trex::test
