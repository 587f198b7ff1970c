// Mitsuba scenes: shapes, cameras, how they are read, and bad input. Looks:
// scene_mitsuba_looks_test.cpp.
#include <zlib.h>

#include <numbers>

#include "src/scene/mitsuba_xml.h"
#include "tests/unit/scene_mitsuba_helpers.h"

namespace trex::test {
namespace {

TEST_F(Mitsuba, TransformsAreAppliedInTheirOrder) {
  Scene s =
      read(shapeAt("<scale value=\"2\"/><rotate z=\"1\" angle=\"90\"/>"
                   "<translate x=\"1\" y=\"2\" z=\"3\"/>"));
  expectNear(vec3(place(s, {1, 0, 0})), {1, 4, 3});
  s = read(shapeAt("<translate value=\"1, 2, 3\"/><scale x=\"2\" y=\"3\"/>"));
  expectNear(vec3(place(s, {0, 0, 0})), {2, 6, 3});
  s = read(shapeAt("<matrix value=\"1 0 0 5  0 2 0 6  0 0 1 7  0 0 0 1\"/>"));
  expectNear(vec3(place(s, {1, 1, 0})), {6, 8, 7});
  s = read(shapeAt("<lookat origin=\"0,0,5\" target=\"0,0,0\" up=\"0,1,0\"/>"));
  expectNear(vec3(place(s, {0, 0, 1})), {0, 0, 4});  // its z axis points to the target
  expectNear(vec3(place(s, {1, 0, 0})), {-1, 0, 5});
}

TEST_F(Mitsuba, MatricesAreAffine) {
  const auto placed = [&](const char* lastRow) {
    return read(
        std::string("<shape type=\"rectangle\"><transform name=\"to_world\"><matrix value=\""
                    "1 0 0 6 0 2 0 0 0 0 1 0 ") +
        lastRow + "\"/></transform></shape>");
  };
  const Scene halved = placed("0 0 0 2");
  EXPECT_NEAR(halved.bounds().upper.x, 3.5, 1e-9);
  EXPECT_NEAR(halved.bounds().upper.y, 1.0, 1e-9);
  EXPECT_EQ(halved.replaced.count, 0u);
  for (const char* bad : {"0 0 0 0", "0 0.5 0 1"}) {
    const Scene s = placed(bad);
    EXPECT_TRUE(says(s.replaced.texts, "not affine")) << bad;
    EXPECT_NEAR(s.bounds().upper.x, 1.0, 1e-9) << bad;
  }
}

TEST_F(Mitsuba, ShapesHaveTheirSizes) {
  const auto boundsOf = [&](const std::string& shape) { return read(shape).bounds(); };
  Box3d b = boundsOf(
      "<shape type=\"sphere\"><point name=\"center\" x=\"1\" y=\"0\" z=\"0\"/>"
      "<float name=\"radius\" value=\"2\"/></shape>");
  EXPECT_NEAR(b.lower.x, -1.0, 2e-3);
  EXPECT_NEAR(b.upper.z, 2.0, 2e-3);
  b = boundsOf("<shape type=\"cube\"/>");
  expectNear(vec3(b.size()), vec3(2.0f));
  b = boundsOf("<shape type=\"disk\"/>");
  EXPECT_NEAR(b.upper.x, 1.0, 1e-3);
  EXPECT_EQ(b.size().z, 0.0);
  b = boundsOf(
      "<shape type=\"cylinder\"><point name=\"p0\" value=\"0,1,0\"/>"
      "<point name=\"p1\" value=\"0,4,0\"/><float name=\"radius\" value=\"0.5\"/></shape>");
  EXPECT_NEAR(b.lower.y, 1.0, 1e-6);
  EXPECT_NEAR(b.upper.y, 4.0, 1e-6);
  EXPECT_NEAR(b.upper.x, 0.5, 1e-3);
}

TEST_F(Mitsuba, FlippedNormalsTurnTheFront) {
  const auto front = [&](const std::string& inside) {
    const Scene s = read("<shape type=\"rectangle\">" + inside + "</shape>");
    const Mesh& m = s.meshes.at(0);
    const glm::uvec3 t = m.triangles[0];
    const vec3 a = m.positions[t.x];
    return glm::cross(m.positions[t.y] - a, m.positions[t.z] - a).z;
  };
  EXPECT_GT(front(""), 0.0f);
  EXPECT_LT(front("<boolean name=\"flip_normals\" value=\"true\"/>"), 0.0f);
  EXPECT_LT(front("<boolean name=\"flipNormals\" value=\"true\"/>"), 0.0f);
}

TEST_F(Mitsuba, ObjectFilesOneMeshSmoothUnlessToldOtherwise) {
  write("two.obj",
        "o a\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nvt 0 0.25\nusemtl x\ns 1\nf 1/1 2/1 3/1\n"
        "o b\nf 1/1 4/1 2/1\n");
  const std::string file = "<string name=\"filename\" value=\"two.obj\"/>";
  Scene s = read("<shape type=\"obj\">" + file + "</shape>");
  ASSERT_EQ(s.meshes.size(), 1u);
  EXPECT_EQ(s.meshes[0].triangles.size(), 2u);
  EXPECT_NEAR(s.meshes[0].texCoords.at(0).y, 0.75f, 1e-6f);
  // Two faces of right angles at the shared edge: the mean of +z and -y... of their normals.
  expectNear(s.meshes[0].normals.at(0), glm::normalize(vec3(0, 1, 1)), 1e-5f);
  s = read("<shape type=\"obj\">" + file +
           "<boolean name=\"face_normals\" value=\"true\"/></shape>");
  EXPECT_TRUE(s.meshes.at(0).normals.empty());
  s = read("<shape type=\"obj\">" + file + "<float name=\"maxSmoothAngle\" value=\"30\"/></shape>");
  EXPECT_EQ(s.meshes.at(0).normals.size(), 6u);
  expectNear(s.meshes[0].normals[0], {0, 0, 1});
  s = read("<shape type=\"obj\">" + file +
           "<boolean name=\"flip_tex_coords\" value=\"false\"/></shape>");
  EXPECT_NEAR(s.meshes.at(0).texCoords.at(0).y, 0.25f, 1e-6f);
}

TEST_F(Mitsuba, PlyKeepsItsTextureCoordinates) {
  write("one.ply",
        "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n"
        "property float z\nproperty float u\nproperty float v\nelement face 1\n"
        "property list uchar int vertex_indices\nend_header\n0 0 0 0 0.25\n1 0 0 0 0.25\n"
        "0 1 0 0 0.25\n3 0 1 2\n");
  const Scene s = read("<shape type=\"ply\"><string name=\"filename\" value=\"one.ply\"/></shape>");
  EXPECT_NEAR(s.meshes.at(0).texCoords.at(0).y, 0.25f, 1e-6f);
  expectNear(s.meshes[0].normals.at(0), {0, 0, 1});
}

/// A serialized file of two meshes, one triangle each at z = its number.
std::string serialized(std::uint16_t version, bool wide) {
  std::string file;
  std::vector<std::uint64_t> starts;
  const auto put = [](std::string& to, auto value) {
    to.append(reinterpret_cast<const char*>(&value), sizeof(value));
  };
  for (int number = 0; number < 2; ++number) {
    std::string raw;
    put(raw, std::uint32_t(wide ? 0x2000 : 0x1000) | 0x2u);
    if (version == 4) raw += std::string("name\0", 5);
    put(raw, std::uint64_t{3});
    put(raw, std::uint64_t{1});
    const double numbers[] = {
        0, 0, double(number), 1, 0, double(number), 0, 1, double(number), 0, 0.25, 1, 0.25, 0, 0.5};
    for (const double n : numbers) wide ? put(raw, n) : put(raw, float(n));
    for (const std::uint32_t i : {0u, 1u, 2u}) put(raw, i);
    std::string packed(compressBound(raw.size()), '\0');
    uLongf size = packed.size();
    compress(reinterpret_cast<Bytef*>(packed.data()), &size,
             reinterpret_cast<const Bytef*>(raw.data()), raw.size());
    starts.push_back(file.size());
    put(file, std::uint16_t{0x041c});
    put(file, version);
    file += packed.substr(0, size);
  }
  for (const std::uint64_t s : starts) {
    version == 4 ? put(file, s) : put(file, std::uint32_t(s));
  }
  put(file, std::uint32_t{2});
  return file;
}

TEST_F(Mitsuba, SerializedMeshesOfBothVersions) {
  for (const std::uint16_t version : {std::uint16_t{3}, std::uint16_t{4}}) {
    for (const bool wide : {false, true}) {
      write("m.serialized", serialized(version, wide));
      const Scene s = read(
          "<shape type=\"serialized\"><string name=\"filename\" value=\"m.serialized\"/>"
          "<integer name=\"shapeIndex\" value=\"1\"/></shape>");
      ASSERT_EQ(s.triangleCount(), 1u);
      EXPECT_EQ(s.bounds().lower.z, 1.0);
      EXPECT_FLOAT_EQ(s.meshes[0].texCoords.at(2).y, 0.5f);
    }
  }
}

TEST_F(Mitsuba, SerializedMeshesThatLie) {
  const std::string good = serialized(4, false);
  const std::string text =
      "<scene version=\"3.0.0\"><shape type=\"serialized\">"
      "<string name=\"filename\" value=\"m.serialized\"/>";
  const auto refused = [&](const std::string& bytes, const std::string& more = "") {
    write("m.serialized", bytes);
    return refusal(text + more + "</shape></scene>");
  };
  EXPECT_NE(refused(good, "<integer name=\"shape_index\" value=\"2\"/>").find("holds 2 meshes"),
            std::string::npos);
  EXPECT_NE(refused("plainly no mesh").find("is no serialized mesh"), std::string::npos);
  for (std::size_t cut = 8; cut < good.size(); cut += 7) {
    EXPECT_NE(refused(good.substr(0, cut)), "") << cut;
  }
}

TEST_F(Mitsuba, GroupsArePlacedByTheirInstances) {
  std::string text =
      "<shape type=\"shapegroup\" id=\"g\"><shape type=\"cube\"><transform name=\"to_world\">"
      "<translate x=\"1\"/></transform></shape><shape type=\"sphere\"/></shape>";
  for (int i = 0; i < 3; ++i) {
    text += "<shape type=\"instance\"><ref id=\"g\"/><transform name=\"to_world\"><translate y=\"" +
            std::to_string(10 * i) + "\"/></transform></shape>";
  }
  const Scene s = read(text);
  EXPECT_EQ(s.meshes.size(), 2u);
  ASSERT_EQ(s.instances.size(), 6u);
  expectNear(vec3(s.instances[4].transform[3]), {1, 20, 0});
  EXPECT_EQ(s.objects.size(), 3u);
}

TEST_F(Mitsuba, EqualShapesShareTheirTriangles) {
  const Scene s = read(
      "<bsdf type=\"diffuse\" id=\"a\"/><bsdf type=\"diffuse\" id=\"b\"/>"
      "<shape type=\"sphere\"><ref id=\"a\"/></shape><shape type=\"sphere\"><ref id=\"a\"/></shape>"
      "<shape type=\"sphere\"><ref id=\"b\"/></shape>");
  ASSERT_EQ(s.meshes.size(), 2u);
  EXPECT_EQ(s.meshes[1].sameGeometryAs, 0);
  EXPECT_EQ(s.instances.size(), 3u);
}

float verticalFov(const Scene& s) { return s.cameras.at(0).verticalFov; }

TEST_F(Mitsuba, FieldsOfViewByTheirAxis) {
  const auto fov = [&](const std::string& inside) {
    return double(verticalFov(
        read("<sensor type=\"perspective\"><float name=\"fov\" value=\"60\"/>" + inside +
             "<film type=\"hdrfilm\"><integer name=\"width\" value=\"200\"/>"
             "<integer name=\"height\" value=\"100\"/></film></sensor>")));
  };
  const double t = std::tan(std::numbers::pi / 6.0);
  EXPECT_NEAR(fov(""), 2.0 * std::atan(t / 2.0), 1e-6);
  EXPECT_NEAR(fov("<string name=\"fovAxis\" value=\"y\"/>"), 2.0 * std::atan(t), 1e-6);
  EXPECT_NEAR(fov("<string name=\"fov_axis\" value=\"smaller\"/>"), 2.0 * std::atan(t), 1e-6);
  EXPECT_NEAR(fov("<string name=\"fov_axis\" value=\"larger\"/>"), 2.0 * std::atan(t / 2.0), 1e-6);
  EXPECT_NEAR(fov("<string name=\"fov_axis\" value=\"diagonal\"/>"),
              2.0 * std::atan(t / std::sqrt(5.0)), 1e-6);
  EXPECT_NEAR(fov("<string name=\"focal_length\" value=\"50mm\"/>"),
              2.0 * std::atan(std::hypot(36.0, 24.0) / 100.0 / std::sqrt(5.0)), 1e-6);
}

TEST_F(Mitsuba, CamerasLookAlongZ) {
  const Scene s = read(
      "<sensor type=\"thinlens\" id=\"one\"><transform name=\"to_world\"><lookat "
      "origin=\"0,0,5\" target=\"0,0,0\" up=\"0,1,0\"/></transform>"
      "<float name=\"aperture_radius\" value=\"0.1\"/><float name=\"focus_distance\" value=\"5\"/>"
      "</sensor><sensor type=\"perspective\"/>");
  ASSERT_EQ(s.cameras.size(), 2u);
  EXPECT_EQ(s.cameras[0].name, "one");
  expectNear(vec3(s.cameras[0].eye), {0, 0, 5});
  expectNear(s.cameras[0].forward, {0, 0, -1});
  expectNear(s.cameras[0].up, {0, 1, 0});
  EXPECT_NEAR(s.cameras[0].lensRadius(), 0.1f, 1e-6f);
  EXPECT_FLOAT_EQ(s.cameras[0].focus, 5.0f);
}

TEST_F(Mitsuba, ParametersAreFilledIn) {
  const std::string text =
      "<default name=\"r\" value=\"0.25\"/><default name=\"longer\" value=\"0.5\"/>"
      "<shape type=\"rectangle\"><bsdf type=\"diffuse\"><rgb name=\"reflectance\" "
      "value=\"$r, $longer, 0.1\"/></bsdf></shape>";
  const auto color = [&](const ImportOptions& o) {
    return vec3(read(text, o).materials.at(0).baseColor);
  };
  expectNear(color({}), {0.25f, 0.5f, 0.1f});
  expectNear(color({.defines = {"r=0.75"}}), {0.75f, 0.5f, 0.1f});
  EXPECT_NE(ImportOptions{.defines = {"r=1"}}.key(), ImportOptions{}.key());
  EXPECT_NE(refusal("<scene>" + text + "</scene>", {.defines = {"x=1"}}, ExitCode::kUsage)
                .find("no parameter"),
            std::string::npos);
  EXPECT_NE(refusal("<scene>\n<shape type=\"$nothing\"/></scene>").find("scene.xml:2"),
            std::string::npos);
}

TEST_F(Mitsuba, IncludedFilesJoinTheScene) {
  write("part.xml",
        "<scene version=\"3.0.0\"><bsdf type=\"diffuse\" id=\"red\"><rgb "
        "name=\"reflectance\" value=\"$c\"/></bsdf></scene>");
  const Scene s = read(
      "<default name=\"c\" value=\"1, 0, 0\"/><include filename=\"part.xml\"/>"
      "<shape type=\"rectangle\"><ref id=\"red\"/></shape>");
  expectNear(vec3(s.materials.at(0).baseColor), {1, 0, 0});
  EXPECT_EQ(s.files.size(), 2u);
  EXPECT_NE(refusal("<scene>\n\n<include filename=\"none.xml\"/></scene>").find("scene.xml:3"),
            std::string::npos);
  EXPECT_NE(refusal("<scene><include filename=\"scene.xml\"/></scene>").find("deep"),
            std::string::npos);
}

TEST_F(Mitsuba, NamesOfOldVersions) {
  using detail::mitsuba::snakeCase;
  EXPECT_EQ(snakeCase("toWorld"), "to_world");
  EXPECT_EQ(snakeCase("intIOR"), "int_ior");
  EXPECT_EQ(snakeCase("diffuseReflectance"), "diffuse_reflectance");
  EXPECT_EQ(snakeCase("sunRadiusScale"), "sun_radius_scale");
  EXPECT_EQ(snakeCase("to_world"), "to_world");
}

TEST_F(Mitsuba, UnknownPartsAreNamedAndErrorsWithStrict) {
  const std::string text =
      "<shape type=\"rectangle\"><bsdf type=\"velvet\"/></shape><shape type=\"hair\"/>"
      "<emitter type=\"laser\"/>";
  const Scene s = read(text);
  EXPECT_EQ(s.triangleCount(), 2u);
  for (const char* part : {"velvet", "hair", "laser"}) EXPECT_TRUE(says(s.replaced.texts, part));
  EXPECT_NE(refusal("<scene>" + text + "</scene>", {.strict = true}).find("velvet"),
            std::string::npos);
}

/// Of version 3 by name, of the first ones by a texture of its own; colours of floats are linear.
TEST_F(Mitsuba, ColoursOfMeshes) {
  write("c.ply",
        "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty "
        "float z\n"
        "property float r\nproperty float g\nproperty float b\nelement face 1\n"
        "property list uchar int vertex_index\nend_header\n0 0 0 1 0 0\n1 0 0 0 1 0\n0 1 0 0 0 "
        "1\n3 0 1 2\n");
  const auto shape = [](const std::string& type, const std::string& bsdf) {
    return "<shape type=\"" + type + "\"><string name=\"filename\" value=\"c.ply\"/>" + bsdf +
           "</shape>";
  };
  const std::string attribute =
      "<texture type=\"mesh_attribute\" name=\"NAME\"><string name=\"name\" "
      "value=\"vertex_color\"/>"
      "<float name=\"scale\" value=\"0.5\"/></texture>";
  const auto named = [&](const std::string& name) {
    std::string text = attribute;
    return text.replace(text.find("NAME"), 4, name);
  };
  const std::string diffuse = "<bsdf type=\"diffuse\">" + named("reflectance") + "</bsdf>";
  const Scene s = read(shape("ply", "<bsdf type=\"twosided\">" + diffuse + "</bsdf>") +
                       shape("ply", "<bsdf type=\"diffuse\"/>") +
                       shape("ply",
                             "<bsdf type=\"diffuse\"><texture name=\"reflectance\" "
                             "type=\"vertexcolors\"/></bsdf>"));
  EXPECT_EQ(s.replaced.count, 0u) << (s.replaced.texts.empty() ? "" : s.replaced.texts[0]);
  const auto mesh = [&](int i) { return s.meshes.at(s.instances.at(i).mesh); };
  for (const int i : {0, 2}) {
    ASSERT_EQ(mesh(i).colors.size(), 3u);
    EXPECT_EQ(mesh(i).colors[1], packVertexColor(vec4(0, 1, 0, 1)));
    expectNear(vec3(s.materials.at(mesh(i).material).baseColor), vec3(i == 0 ? 0.5f : 1.0f));
  }
  EXPECT_TRUE(mesh(1).colors.empty());
  EXPECT_TRUE(says(read(shape("sphere", diffuse)).replaced.texts, "no colours"));
  // Of what is no base colour they are not known.
  const std::string glossy = "<bsdf type=\"roughconductor\">" + named("alpha") + "</bsdf>";
  EXPECT_TRUE(says(read(shape("ply", glossy)).replaced.texts, "mesh_attribute"));
}

TEST_F(Mitsuba, MissingFilesLeaveTheRest) {
  const Scene s = read(
      "<shape type=\"obj\"><string name=\"filename\" value=\"gone.obj\"/></shape>"
      "<shape type=\"rectangle\"><bsdf type=\"diffuse\"><texture type=\"bitmap\" "
      "name=\"reflectance\"><string name=\"filename\" "
      "value=\"gone.png\"/></texture></bsdf></shape>");
  EXPECT_EQ(s.triangleCount(), 2u);
  EXPECT_TRUE(says(s.replaced.texts, "gone.obj"));
  EXPECT_TRUE(says(s.replaced.texts, "gone.png"));
  expectNear(vec3(s.materials.at(0).baseColor), vec3(0.5f));
}

/// Mitsuba counts the segments of a path.
TEST_F(Mitsuba, DepthOfTheIntegratorLimitsBounces) {
  const struct {
    const char* integrator;
    std::uint32_t most;
  } cases[] = {
      {"", Scene::kAnyBounces},
      {"<integrator type=\"path\"/>", Scene::kAnyBounces},
      {"<integrator type=\"path\"><integer name=\"max_depth\" value=\"-1\"/></integrator>",
       Scene::kAnyBounces},
      {"<integrator type=\"path\"><integer name=\"max_depth\" value=\"1\"/></integrator>", 0},
      {"<integrator type=\"path\"><integer name=\"max_depth\" value=\"2\"/></integrator>", 1},
      {"<integrator type=\"volpath\"><integer name=\"maxDepth\" value=\"17\"/><integer "
       "name=\"rrDepth\" value=\"5\"/></integrator>",
       16},
      {"<integrator type=\"aov\"><string name=\"aovs\" value=\"d:depth\"/><integrator "
       "type=\"path\"><integer name=\"max_depth\" value=\"4\"/></integrator></integrator>",
       3},
      {"<integrator type=\"direct\"/>", 1},
      {"<integrator type=\"path\"><integer name=\"max_depth\" value=\"1e20\"/></integrator>",
       1'000'000'000},
  };
  for (const auto& c : cases) {
    const Scene s = read(std::string(c.integrator) + "<shape type=\"rectangle\"/>");
    EXPECT_EQ(s.maxBounces, c.most) << c.integrator;
    EXPECT_EQ(s.replaced.count, 0u) << c.integrator;
  }
  const Scene s = read(
      "<integrator type=\"path\"><integer name=\"max_depth\" value=\"0\"/></integrator>"
      "<shape type=\"rectangle\"/>");
  EXPECT_EQ(s.maxBounces, 0u);
  EXPECT_TRUE(says(s.warnings, "max_depth 0"));
}

TEST_F(Mitsuba, WhatIsNotShownIsSaid) {
  const Scene s = read(
      "<shape type=\"rectangle\"><bsdf type=\"roughconductor\"><float name=\"glitter\" "
      "value=\"1\"/><string name=\"distribution\" value=\"phong\"/></bsdf></shape>");
  EXPECT_TRUE(says(s.warnings, "glitter"));
  EXPECT_TRUE(says(s.warnings, "'phong' are shown as ggx"));
  EXPECT_TRUE(says(s.warnings, "twosided"));
}

TEST_F(Mitsuba, BrokenFilesAreRefusedWithTheirLine) {
  EXPECT_NE(refusal("<scene>\n<shape>\n</scene>").find("scene.xml:3"), std::string::npos);
  EXPECT_NE(refusal("<html/>").find("<html>"), std::string::npos);
  EXPECT_NE(refusal("no xml at all").find("scene.xml"), std::string::npos);
  std::string deep = "<scene>", end = "</scene>";
  for (int i = 0; i < 100; ++i) deep += "<bsdf type=\"twosided\">", end = "</bsdf>" + end;
  EXPECT_NE(refusal(deep + end).find("nested too deeply"), std::string::npos);
  // Values that grow with each parameter.
  std::string bomb = "<scene><default name=\"a0\" value=\"xxxxxxxxxxxxxxxx\"/>";
  for (int i = 1; i < 40; ++i) {
    const std::string last = "$a" + std::to_string(i - 1);
    bomb += "<default name=\"a" + std::to_string(i) + "\" value=\"" + last + last + "\"/>";
  }
  EXPECT_NE(refusal(bomb + "</scene>").find("characters"), std::string::npos);
}

TEST_F(Mitsuba, ReferencesThatTurnInCirclesEnd) {
  const Scene s = read(
      "<bsdf type=\"twosided\" id=\"a\"><ref id=\"b\"/></bsdf>"
      "<bsdf type=\"twosided\" id=\"b\"><ref id=\"a\"/></bsdf>"
      "<shape type=\"shapegroup\" id=\"g\"><shape type=\"instance\"><ref id=\"g\"/></shape></shape>"
      "<shape type=\"instance\"><ref id=\"g\"/></shape>"
      "<shape type=\"rectangle\"><ref id=\"a\"/></shape>");
  EXPECT_EQ(s.triangleCount(), 2u);
  EXPECT_GE(s.replaced.count, 2u);
}

TEST_F(Mitsuba, NumbersThatAreNoneOrOutOfRange) {
  const Scene s = read(
      "<shape type=\"sphere\"><float name=\"radius\" value=\"-1\"/></shape>"
      "<shape type=\"rectangle\"><transform name=\"to_world\"><scale x=\"0\" y=\"1\" z=\"1\"/>"
      "</transform></shape><shape type=\"disk\"><transform name=\"to_world\">"
      "<scale x=\"nan\"/><matrix value=\"1 2 3\"/></transform></shape>");
  EXPECT_TRUE(says(s.replaced.texts, "radius -1"));
  EXPECT_TRUE(says(s.replaced.texts, "no volume"));
  EXPECT_TRUE(says(s.replaced.texts, "'nan' is not a number"));
}

TEST_F(Mitsuba, OptionsOfOtherFormatsAreUsageErrors) {
  const std::string xml = "<scene><shape type=\"rectangle\"/></scene>";
  EXPECT_NE(refusal(xml, {.unit = 0.01}, ExitCode::kUsage), "");
  EXPECT_NE(refusal(xml, {.variant = "red"}, ExitCode::kUsage), "");
  EXPECT_THROW(import("m.obj", "v 0 0 0\n", {.defines = {"a=1"}}), Error);
}

}  // namespace
}  // namespace trex::test
