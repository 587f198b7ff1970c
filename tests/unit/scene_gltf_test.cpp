#include <glm/gtc/matrix_transform.hpp>

#include "src/scene/texture.h"
#include "tests/unit/scene_helpers.h"

namespace trex::test {
namespace {

class SceneGltf : public SceneTest {};

TEST_F(SceneGltf, TriangleWithoutIndicesGetsSkyAndCamera) {
  const Scene s = import("a.glb", triangleGlb().glb());
  ASSERT_EQ(s.meshes.size(), 1u);
  EXPECT_EQ(s.triangleCount(), 1u);
  EXPECT_TRUE(s.meshes[0].normals.empty());
  EXPECT_EQ(s.meshes[0].positions[1], vec3(1, 0, 0));
  EXPECT_TRUE(s.environment.present());
  EXPECT_EQ(s.environment.color, vec3(1.0f));
  ASSERT_NE(s.environment.map, nullptr);
  ASSERT_EQ(s.cameras.size(), 1u);
  EXPECT_TRUE(anyWarning(s, "no light"));
  EXPECT_TRUE(anyWarning(s, "no camera"));
}

TEST_F(SceneGltf, NoSkyIfTheCallerHasAnEnvironment) {
  ImportOptions options;
  options.environmentGiven = true;
  const Scene s = import("a.glb", triangleGlb().glb(), options);
  EXPECT_FALSE(s.environment.present());
  EXPECT_FALSE(anyWarning(s, "no light"));
}

TEST_F(SceneGltf, MeshUsedByTwoNodesIsStoredOnce) {
  GlbBuilder b = triangleGlb();
  b.node({{"mesh", 0}, {"translation", {5, 0, 0}}, {"name", "second"}});
  const Scene s = import("a.glb", b.glb());
  EXPECT_EQ(s.meshes.size(), 1u);
  ASSERT_EQ(s.instances.size(), 2u);
  EXPECT_EQ(s.uniqueTriangleCount(), 1u);
  EXPECT_EQ(s.triangleCount(), 2u);
  EXPECT_EQ(s.objects[s.instances[1].object], "second");
  EXPECT_DOUBLE_EQ(s.bounds().upper.x, 6.0);
}

TEST_F(SceneGltf, SameGeometryWithAnotherMaterialIsMarked) {
  GlbBuilder b = triangleGlb();
  b.doc["materials"] = json::array({json::object(), json::object()});
  b.node({{"mesh", b.mesh({{"attributes", {{"POSITION", 0}}}, {"material", 1}})}});
  const Scene s = import("a.glb", b.glb());
  ASSERT_EQ(s.meshes.size(), 2u);
  EXPECT_EQ(s.meshes[1].sameGeometryAs, 0);
  EXPECT_EQ(s.uniqueTriangleCount(), 1u);
}

TEST_F(SceneGltf, NodeTransformsAreMultipliedDownTheTree) {
  GlbBuilder b = triangleGlb();
  const double h = std::sqrt(0.5);
  b.doc["nodes"] = {{{"translation", {1, 2, 3}}, {"children", {1}}},
                    {{"rotation", {0, 0, h, h}}, {"scale", {2, 2, 2}}, {"mesh", 0}}};
  b.doc["scenes"] = {{{"nodes", {0}}}};
  const Scene s = import("a.glb", b.glb());
  const glm::dvec4 p = s.instances[0].transform * glm::dvec4(1, 0, 0, 1);
  EXPECT_NEAR(p.x, 1.0, 1e-12);
  EXPECT_NEAR(p.y, 4.0, 1e-12);
  EXPECT_NEAR(p.z, 3.0, 1e-12);
}

TEST_F(SceneGltf, IndexTypesStripsAndFans) {
  const std::vector<float> square = {0, 0, 0, 1, 0, 0, 0, 1, 0, 1, 1, 0};
  for (const int type : {5121, 5123, 5125}) {
    for (const int mode : {4, 5, 6}) {
      GlbBuilder b;
      const int p = b.floats(square);
      int i = 0;
      if (type == 5121) i = b.accessor<std::uint8_t>({0, 1, 2, 3, 2, 1}, type, "SCALAR", 6);
      if (type == 5123) i = b.accessor<std::uint16_t>({0, 1, 2, 3, 2, 1}, type, "SCALAR", 6);
      if (type == 5125) i = b.accessor<std::uint32_t>({0, 1, 2, 3, 2, 1}, type, "SCALAR", 6);
      b.node(
          {{"mesh", b.mesh({{"attributes", {{"POSITION", p}}}, {"indices", i}, {"mode", mode}})}});
      const Scene s = import("a.glb", b.glb());
      const auto& t = s.meshes[0].triangles;
      ASSERT_EQ(t.size(), mode == 4 ? 2u : mode == 5 ? 3u : 4u) << type << " " << mode;
      EXPECT_EQ(t[0], mode == 6 ? glm::uvec3(1, 2, 0) : glm::uvec3(0, 1, 2));
      if (mode == 5) {
        EXPECT_EQ(t[1], glm::uvec3(1, 3, 2));
      }
    }
  }
}

TEST_F(SceneGltf, UnusedVerticesAreLeftOut) {
  GlbBuilder b;
  std::vector<float> positions(300, 7.0f);
  for (int k = 0; k < 9; ++k) positions[90 + k] = float(k % 4 == 0);
  const int p = b.floats(positions);
  const int i = b.accessor<std::uint16_t>({30, 31, 32}, 5123, "SCALAR", 3);
  b.node({{"mesh", b.mesh({{"attributes", {{"POSITION", p}}}, {"indices", i}})}});
  const Scene s = import("a.glb", b.glb());
  EXPECT_EQ(s.meshes[0].positions.size(), 3u);
  EXPECT_EQ(s.meshes[0].triangles[0], glm::uvec3(0, 1, 2));
  EXPECT_DOUBLE_EQ(s.bounds().upper.x, 1.0);
}

TEST_F(SceneGltf, PointsAndLinesAreSkippedWithAWarning) {
  GlbBuilder b = triangleGlb();
  b.node({{"mesh", b.mesh({{"attributes", {{"POSITION", 0}}}, {"mode", 1}})}});
  const Scene s = import("a.glb", b.glb());
  EXPECT_EQ(s.instances.size(), 1u);
  EXPECT_TRUE(anyReplaced(s, "points or lines"));
}

TEST_F(SceneGltf, SkinsWithoutJointsAreShownUnbent) {
  GlbBuilder b = triangleGlb();
  b.doc["nodes"][0]["skin"] = 0;
  b.doc["skins"] = {{{"joints", {0}}}};
  const Scene s = import("a.glb", b.glb());
  EXPECT_EQ(s.replaced.count, 1u);
  EXPECT_TRUE(anyReplaced(s, "JOINTS_0"));
  EXPECT_EQ(s.bounds().upper, dvec3(1, 1, 0));
}

TEST_F(SceneGltf, VertexColours) {
  struct Case {
    int type;
    std::string shape;
  };
  for (const Case& c : {Case{5126, "VEC3"}, {5126, "VEC4"}, {5121, "VEC4"}, {5123, "VEC4"}}) {
    GlbBuilder b = triangleGlb();
    const std::size_t n = c.shape == "VEC4" ? 4 : 3;
    int a = 0;
    if (c.type == 5126) {
      std::vector<float> v(3 * n, 1.0f);
      v[0] = 0.2f;
      a = b.floats(v, c.shape);
    } else if (c.type == 5121) {
      std::vector<std::uint8_t> v(3 * n, 255);
      v[0] = 51;
      a = b.accessor(v, c.type, c.shape, 3, true);
    } else {
      std::vector<std::uint16_t> v(3 * n, 65535);
      v[0] = 13107;
      a = b.accessor(v, c.type, c.shape, 3, true);
    }
    b.doc["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"] = a;
    const Scene s = import("a.glb", b.glb());
    ASSERT_EQ(s.meshes[0].colors.size(), 3u);
    EXPECT_EQ(s.meshes[0].colors[0], packVertexColor({0.2f, 1.0f, 1.0f, 1.0f}))
        << c.type << c.shape;
  }
}

TEST_F(SceneGltf, SparseAccessor) {
  GlbBuilder b = triangleGlb();
  const int indices = b.view(bytesOf<std::uint16_t>({1}));
  const int values = b.view(bytesOf<float>({9, 8, 7}));
  b.doc["accessors"][0]["sparse"] = {
      {"count", 1},
      {"indices", {{"bufferView", indices}, {"componentType", 5123}}},
      {"values", {{"bufferView", values}}}};
  const Scene s = import("a.glb", b.glb());
  EXPECT_EQ(s.meshes[0].positions[0], vec3(0));
  EXPECT_EQ(s.meshes[0].positions[1], vec3(9, 8, 7));
}

TEST_F(SceneGltf, InterleavedAttributes) {
  GlbBuilder b;
  const int v = b.view(bytesOf<float>({0, 0, 0, 0, 0, 2, 1, 0, 0, 0, 0, 2, 0, 1, 0, 0, 0, 2}), 24);
  b.doc["accessors"] = {
      {{"bufferView", v}, {"componentType", 5126}, {"type", "VEC3"}, {"count", 3}},
      {{"bufferView", v},
       {"byteOffset", 12},
       {"componentType", 5126},
       {"type", "VEC3"},
       {"count", 3}}};
  b.node({{"mesh", b.mesh({{"attributes", {{"POSITION", 0}, {"NORMAL", 1}}}})}});
  const Scene s = import("a.glb", b.glb());
  EXPECT_EQ(s.meshes[0].positions[2], vec3(0, 1, 0));
  EXPECT_EQ(s.meshes[0].normals[2], vec3(0, 0, 1));
}

TEST_F(SceneGltf, NonFiniteTrianglesAreDroppedAndCounted) {
  GlbBuilder b;
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const int p = b.floats({0, 0, 0, 1, 0, 0, 0, 1, 0, nan, 0, 0, 1, kInfinity, 0, 0, 1, 1e-42f});
  b.node({{"mesh", b.mesh({{"attributes", {{"POSITION", p}}}})}});
  const Scene s = import("a.glb", b.glb());
  EXPECT_EQ(s.droppedTriangles, 1u);
  EXPECT_EQ(s.triangleCount(), 1u);
  for (const vec3& q : s.meshes[0].positions) EXPECT_TRUE(isFinite(q));
  EXPECT_TRUE(anyWarning(s, "non-finite"));
}

TEST_F(SceneGltf, UnusableNormalsBecomeThoseOfTheFaces) {
  GlbBuilder b = triangleGlb();
  const int n = b.floats({0, 0, 0, 0, 0, 5, std::nanf(""), 0, 0});
  b.doc["meshes"][0]["primitives"][0]["attributes"]["NORMAL"] = n;
  const Scene s = import("a.glb", b.glb());
  for (const vec3& normal : s.meshes[0].normals) EXPECT_EQ(normal, vec3(0, 0, 1));
}

TEST_F(SceneGltf, Cameras) {
  GlbBuilder b = triangleGlb();
  b.doc["cameras"] = {
      {{"name", "p"}, {"type", "perspective"}, {"perspective", {{"yfov", 0.5}, {"znear", 0.1}}}},
      {{"name", "o"},
       {"type", "orthographic"},
       {"orthographic", {{"xmag", 2}, {"ymag", 1.5}, {"znear", 0.1}, {"zfar", 9}}}}};
  b.node({{"camera", 0}, {"translation", {0, 0, 4}}});
  b.node({{"camera", 1}, {"rotation", {0, 1, 0, 0}}});
  const Scene s = import("a.glb", b.glb());
  ASSERT_EQ(s.cameras.size(), 2u);
  EXPECT_FLOAT_EQ(s.cameras[0].verticalFov, 0.5f);
  EXPECT_EQ(s.cameras[0].forward, vec3(0, 0, -1));
  EXPECT_DOUBLE_EQ(s.cameras[0].eye.z, 4.0);
  EXPECT_TRUE(s.cameras[1].orthographic);
  EXPECT_FLOAT_EQ(s.cameras[1].orthographicHeight, 3.0f);
  EXPECT_NEAR(s.cameras[1].forward.z, 1.0f, 1e-6f);
}

TEST_F(SceneGltf, PunctualLights) {
  GlbBuilder b = triangleGlb();
  b.doc["extensions"]["KHR_lights_punctual"]["lights"] = {
      {{"type", "directional"}, {"intensity", 3}, {"color", {1, 0.5, 0}}},
      {{"type", "spot"}, {"spot", {{"innerConeAngle", 0.1}, {"outerConeAngle", 0.3}}}},
      {{"type", "point"}, {"range", 12}}};
  for (int i = 0; i < 3; ++i) {
    b.node({{"translation", {i, 0, 0}}, {"extensions", {{"KHR_lights_punctual", {{"light", i}}}}}});
  }
  const Scene s = import("a.glb", b.glb());
  ASSERT_EQ(s.lights.size(), 3u);
  EXPECT_EQ(s.lights[0].type, Light::Type::kDirectional);
  EXPECT_EQ(s.lights[0].intensity, vec3(3, 1.5f, 0));
  EXPECT_EQ(s.lights[0].direction, vec3(0, 0, -1));
  EXPECT_FLOAT_EQ(s.lights[1].outerConeAngle, 0.3f);
  EXPECT_FLOAT_EQ(s.lights[2].range, 12.0f);
  EXPECT_DOUBLE_EQ(s.lights[2].position.x, 2.0);
  EXPECT_FALSE(s.environment.present());
}

TEST_F(SceneGltf, MaterialExtensions) {
  GlbBuilder b = triangleGlb();
  b.doc["meshes"][0]["primitives"][0]["material"] = 0;
  b.doc["materials"] = {
      {{"name", "glass"},
       {"doubleSided", true},
       {"alphaMode", "MASK"},
       {"alphaCutoff", 0.25},
       {"emissiveFactor", {1, 0.5, 0.25}},
       {"pbrMetallicRoughness",
        {{"baseColorFactor", {0.1, 0.2, 0.3, 0.4}},
         {"metallicFactor", 7},
         {"roughnessFactor", 0.5}}},
       {"extensions",
        {{"KHR_materials_emissive_strength", {{"emissiveStrength", 8}}},
         {"KHR_materials_specular", {{"specularFactor", 0.5}, {"specularColorFactor", {2, 1, 0}}}},
         {"KHR_materials_ior", {{"ior", 1.33}}},
         {"KHR_materials_transmission", {{"transmissionFactor", 0.75}}},
         {"KHR_materials_volume",
          {{"thicknessFactor", 1}, {"attenuationDistance", 2}, {"attenuationColor", {0.5, 1, 1}}}},
         {"KHR_materials_unlit", json::object()}}}}};
  const Scene s = import("a.glb", b.glb());
  const Material& m = s.materials[0];
  EXPECT_EQ(m.name, "glass");
  EXPECT_EQ(m.baseColor, vec4(0.1f, 0.2f, 0.3f, 0.4f));
  EXPECT_EQ(m.metallic, 1.0f);  // clamped
  EXPECT_TRUE(anyWarning(s, "metallicFactor"));
  EXPECT_EQ(m.emission, vec3(8, 4, 2));
  EXPECT_TRUE(m.doubleSided);
  EXPECT_EQ(m.alphaMode, AlphaMode::kMask);
  EXPECT_FLOAT_EQ(m.alphaCutoff, 0.25f);
  EXPECT_FLOAT_EQ(m.specular, 0.5f);
  EXPECT_EQ(m.specularColor, vec3(2, 1, 0));
  EXPECT_FLOAT_EQ(m.ior, 1.33f);
  EXPECT_FLOAT_EQ(m.transmission, 0.75f);
  EXPECT_TRUE(m.volume);
  EXPECT_FLOAT_EQ(m.attenuationDistance, 2.0f);
  EXPECT_TRUE(m.unlit);
  EXPECT_FALSE(s.environment.present());  // the material shines
}

TEST_F(SceneGltf, ThinGlassHasNoVolume) {
  GlbBuilder b = triangleGlb();
  b.doc["meshes"][0]["primitives"][0]["material"] = 0;
  b.doc["materials"] = {{{"extensions",
                          {{"KHR_materials_transmission", {{"transmissionFactor", 1}}},
                           {"KHR_materials_volume", json::object()}}}}};
  EXPECT_FALSE(import("a.glb", b.glb()).materials[0].volume);
}

/// A triangle whose material reads a texture of the given image entry.
GlbBuilder texturedGlb(const std::string& png, const std::string& uri) {
  GlbBuilder b = triangleGlb();
  const int uv = b.floats({0, 0, 1, 0, 0, 1}, "VEC2");
  b.doc["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_0"] = uv;
  b.doc["meshes"][0]["primitives"][0]["material"] = 0;
  b.doc["materials"] = {
      {{"pbrMetallicRoughness",
        {{"baseColorTexture",
          {{"index", 0},
           {"extensions",
            {{"KHR_texture_transform",
              {{"offset", {0.5, 0}}, {"scale", {2, 3}}, {"rotation", 0.25}}}}}}}}}}};
  b.doc["samplers"] = {{{"wrapS", 33071}, {"wrapT", 33648}}};
  b.doc["textures"] = {{{"source", 0}, {"sampler", 0}}};
  if (uri.empty()) {
    b.doc["images"] = {{{"bufferView", b.view(png)}, {"mimeType", "image/png"}}};
  } else {
    b.doc["images"] = {{{"uri", uri}}};
  }
  return b;
}

TEST_F(SceneGltf, ImagesInBufferViewsDataUrisAndFiles) {
  write("an image.png", tinyPng());
  const std::string encoded = base64(tinyPng());
  std::string percent = "data:image/png,";
  for (const char c : tinyPng()) percent += fmt::format("%{:02X}", static_cast<unsigned char>(c));
  for (const std::string& uri :
       {std::string(), "data:image/png;base64," + encoded, std::string("an%20image.png"),
        "data:image/png;charset=utf-8;BASE64," + encoded, "data:;base64," + encoded, percent,
        "data:image/png;base64," + encoded.substr(0, 21) + "\r\n " + encoded.substr(21)}) {
    const Scene s = import("a.glb", texturedGlb(tinyPng(), uri).glb());
    ASSERT_EQ(s.images.size(), 1u);
    const Image& image = s.images[0];
    EXPECT_EQ(image.width, 2);
    EXPECT_EQ(image.channels, 3);
    EXPECT_EQ(image.bytes,
              (std::vector<std::uint8_t>{255, 0, 0, 0, 255, 0, 0, 0, 255, 255, 255, 255}));
    const Texture& t = s.materials[0].baseColorTexture;
    EXPECT_EQ(t.wrapS, Texture::Wrap::kClamp);
    EXPECT_EQ(t.wrapT, Texture::Wrap::kMirror);
    EXPECT_EQ(t.offset, vec2(0.5f, 0));
    EXPECT_EQ(t.scale, vec2(2, 3));
    EXPECT_FLOAT_EQ(t.rotation, 0.25f);
    EXPECT_EQ(s.meshes[0].texCoords.size(), 3u);
  }
}

TEST_F(SceneGltf, TexturesCanBeLeftOut) {
  ImportOptions options;
  options.loadTextures = false;
  const Scene s = import("a.glb", texturedGlb("broken", "").glb(), options);
  EXPECT_TRUE(s.images.empty());
  EXPECT_FALSE(s.materials[0].baseColorTexture.present());
  EXPECT_TRUE(s.meshes[0].texCoords.empty());
}

TEST_F(SceneGltf, SecondTextureCoordinateSet) {
  GlbBuilder b = texturedGlb(tinyPng(), "");
  json& primitive = b.doc["meshes"][0]["primitives"][0];
  primitive["attributes"]["TEXCOORD_1"] = b.floats({5, 5, 5, 7, 6, 5}, "VEC2");
  const int scaled = b.floats({11, 10, 11, 14, 13, 10}, "VEC2");
  const int unlike = b.floats({1, 0, 2, 5, 3, 1}, "VEC2");
  json& material = b.doc["materials"][0];
  material["pbrMetallicRoughness"]["baseColorTexture"]["texCoord"] = 1;
  const Scene one = import("a.glb", b.glb());
  EXPECT_EQ(one.meshes[0].texCoords[0], vec2(5, 5));
  EXPECT_TRUE(one.meshes[0].secondTexCoords.empty());
  EXPECT_EQ(one.materials[0].baseColorTexture.set, 0);
  // The set that the normal map reads comes first.
  material["normalTexture"] = {{"index", 0}, {"texCoord", 0}};
  const Scene two = import("a.glb", b.glb());
  EXPECT_EQ(two.replaced.count, 0u);
  EXPECT_EQ(two.meshes[0].texCoords[0], vec2(0, 0));
  EXPECT_EQ(two.meshes[0].secondTexCoords[1], vec2(5, 7));
  EXPECT_EQ(two.materials[0].normalTexture.set, 0);
  EXPECT_EQ(two.materials[0].baseColorTexture.set, 1);
  // A third one has no room, unless it is one of the others scaled and shifted.
  primitive["attributes"]["TEXCOORD_4"] = scaled;
  material["emissiveFactor"] = {1, 1, 1};
  material["emissiveTexture"] = {{"index", 0}, {"texCoord", 4}};
  const Scene three = import("a.glb", b.glb());
  EXPECT_EQ(three.replaced.count, 0u);
  const Material& m = three.materials[three.meshes[0].material];
  EXPECT_EQ(m.emissiveTexture.set, 1);
  EXPECT_EQ(transformUv(m.emissiveTexture, vec2(5, 7)), vec2(11, 14));
  primitive["attributes"]["TEXCOORD_4"] = unlike;
  const Scene odd = import("a.glb", b.glb());
  EXPECT_TRUE(anyReplaced(odd, "coordinate sets 0, 1 and 4; set 0 is used for 4"));
  EXPECT_EQ(odd.materials[odd.meshes[0].material].emissiveTexture.set, 0);
}

TEST_F(SceneGltf, ASetThatIsNotThereReadsTheTexelAtZero) {
  GlbBuilder b = texturedGlb(tinyPng(), "");
  json& material = b.doc["materials"][0];
  material["emissiveFactor"] = {1, 1, 1};
  material["emissiveTexture"] = {{"index", 0}, {"texCoord", 1}};
  for (const bool first : {true, false}) {
    material["pbrMetallicRoughness"]["baseColorTexture"]["texCoord"] = first ? 0 : 1;
    material["emissiveTexture"]["texCoord"] = first ? 1 : 0;
    const Scene s = import("a.glb", b.glb());
    EXPECT_TRUE(anyReplaced(s, "there is no TEXCOORD_1; the texel at 0,0 is used"));
    EXPECT_EQ(s.replaced.count, 1u);
    ASSERT_EQ(s.meshes[0].texCoords.size(), 3u);
    EXPECT_TRUE(s.meshes[0].secondTexCoords.empty());
    const Material& m = s.materials[s.meshes[0].material];
    const Texture& gone = first ? m.emissiveTexture : m.baseColorTexture;
    const Texture& there = first ? m.baseColorTexture : m.emissiveTexture;
    EXPECT_EQ(transformUv(gone, vec2(0.7f, 0.3f)), transformUv(gone, vec2(0.0f)));
    EXPECT_NE(transformUv(there, vec2(0.7f, 0.3f)), transformUv(there, vec2(0.0f)));
    EXPECT_TRUE(gone.set == 0 && there.set == 0);
  }
}

TEST_F(SceneGltf, TextWithExternalAndEmbeddedBuffers) {
  GlbBuilder b = triangleGlb();
  write("data.bin", b.bin);
  for (const std::string& uri :
       {std::string("data.bin"), "data:application/octet-stream;base64," + base64(b.bin)}) {
    b.doc["buffers"] = {{{"byteLength", b.bin.size()}, {"uri", uri}}};
    EXPECT_EQ(import("a.gltf", b.doc.dump()).triangleCount(), 1u) << uri;
  }
}

TEST_F(SceneGltf, OptionalExtensionIsAWarning) {
  GlbBuilder b = triangleGlb();
  b.doc["extensionsUsed"] = {"KHR_materials_diffuse_transmission"};
  EXPECT_TRUE(anyWarning(import("a.glb", b.glb()), "KHR_materials_diffuse_transmission"));
}

TEST_F(SceneGltf, FlatTransformIsApplied) {
  GlbBuilder b = triangleGlb();
  b.doc["nodes"][0]["scale"] = {2, 2, 0};
  const Scene s = import("a.glb", b.glb());
  EXPECT_EQ(s.instances[0].transform, dmat4(1.0));
  EXPECT_EQ(s.meshes[s.instances[0].mesh].positions[1], vec3(2, 0, 0));
}

TEST_F(SceneGltf, FarNodeKeepsItsPlace) {
  GlbBuilder b = triangleGlb();
  b.doc["nodes"][0]["translation"] = {5e6, 0.125, 0};
  const Scene s = import("a.glb", b.glb());
  EXPECT_DOUBLE_EQ(s.bounds().lower.x, 5e6);
  EXPECT_DOUBLE_EQ(s.bounds().upper.x, 5e6 + 1);
}

/// Positions of u16 and normals of i8, as KHR_mesh_quantization allows, placed by their node.
TEST_F(SceneGltf, QuantisedPositionsAndNormals) {
  GlbBuilder b;
  const int p = b.view(bytesOf<std::uint16_t>({0, 0, 0, 0, 1000, 0, 0, 0, 1000, 1000, 0, 0}), 8);
  const int n = b.view(bytesOf<std::int8_t>({0, 0, 127, 0, 0, 0, 127, 0, 0, 127, 0, 0}), 4);
  b.doc["accessors"] = {
      {{"bufferView", p}, {"componentType", 5123}, {"type", "VEC3"}, {"count", 3}},
      {{"bufferView", n},
       {"componentType", 5120},
       {"type", "VEC3"},
       {"count", 3},
       {"normalized", true}}};
  b.node({{"mesh", b.mesh({{"attributes", {{"POSITION", 0}, {"NORMAL", 1}}}})},
          {"scale", {0.002, 0.002, 0.002}},
          {"translation", {-1, -1, 0}}});
  b.doc["extensionsUsed"] = b.doc["extensionsRequired"] = {"KHR_mesh_quantization"};
  const Scene s = import("a.glb", b.glb());
  EXPECT_EQ(s.replaced.count, 0u);
  EXPECT_NEAR(s.bounds().lower.x, -1.0, 1e-9);
  EXPECT_NEAR(s.bounds().upper.y, 1.0, 1e-9);
  EXPECT_EQ(s.meshes[0].normals[0], vec3(0, 0, 1));
  EXPECT_EQ(s.meshes[0].normals[2], vec3(0, 1, 0));
}

/// Without a buffer view all is 0 but what is listed, in any order.
TEST_F(SceneGltf, SparseAccessorOfNothing) {
  GlbBuilder b = triangleGlb();
  const int indices = b.view(bytesOf<std::uint16_t>({2, 1}));
  const int values = b.view(bytesOf<float>({0, 3, 0, 2, 0, 0}));
  b.doc["accessors"][0] = {{"componentType", 5126},
                           {"type", "VEC3"},
                           {"count", 3},
                           {"sparse",
                            {{"count", 2},
                             {"indices", {{"bufferView", indices}, {"componentType", 5123}}},
                             {"values", {{"bufferView", values}}}}}};
  const Scene s = import("a.glb", b.glb());
  ASSERT_EQ(s.meshes.size(), 1u);
  EXPECT_EQ(s.meshes[0].positions, (std::vector<vec3>{{0, 0, 0}, {2, 0, 0}, {0, 3, 0}}));
}

TEST_F(SceneGltf, DeepAndWideTreesOfNodes) {
  constexpr int kNodes = 50000;
  GlbBuilder deep = triangleGlb(), wide = triangleGlb();
  json chain = json::array(), children = json::array();
  for (int i = 0; i < kNodes; ++i) {
    chain.push_back({{"translation", {1, 0, 0}}, {"children", {i + 1}}});
    children.push_back(i + 1);
  }
  chain.push_back({{"mesh", 0}});
  deep.doc["nodes"] = std::move(chain);
  const Scene d = import("deep.glb", deep.glb());
  EXPECT_EQ(d.bounds().upper.x, kNodes + 1.0);
  EXPECT_EQ(d.replaced.count, 0u);
  json nodes = json::array({{{"children", std::move(children)}}});
  for (int i = 0; i < kNodes; ++i) nodes.push_back({{"mesh", 0}});
  wide.doc["nodes"] = std::move(nodes);
  EXPECT_EQ(import("wide.glb", wide.glb()).instances.size(), std::size_t(kNodes));
}

/// Blanks, letters beyond ASCII, a percent sign, plus and ampersand, folders in another case.
TEST_F(SceneGltf, NamesOfFilesInUris) {
  const std::string folder = "My dir \xc3\xbc";
  std::filesystem::create_directories(folder_ / folder);
  write(folder + "/tex 100%.png", tinyPng());
  write(folder + "/a+b&c.png", tinyPng());
  GlbBuilder b = triangleGlb();
  const int uv = b.floats({0, 0, 1, 0, 0, 1}, "VEC2");
  write(folder + "/buf fer.bin", b.bin);
  b.doc["buffers"] = {{{"byteLength", b.bin.size()}, {"uri", "My%20dir%20%C3%BC/buf%20fer.bin"}}};
  b.doc["materials"] = {{{"pbrMetallicRoughness", {{"baseColorTexture", {{"index", 0}}}}}}};
  b.doc["meshes"][0]["primitives"][0]["material"] = 0;
  b.doc["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_0"] = uv;
  b.doc["textures"] = {{{"source", 0}}};
  for (const char* uri :
       {"My%20dir%20%C3%BC/tex%20100%25.png", "./My%20dir%20%c3%bc/a%2Bb%26c.png",
        "My dir \xc3\xbc/a+b&c.png", "My dir \xc3\xbc\\a+b&c.png", "my DIR \xc3\xbc/A+B&C.PNG"}) {
    b.doc["images"] = {{{"uri", uri}}};
    const Scene s = import("a.gltf", b.doc.dump());
    EXPECT_EQ(s.replaced.count, 0u) << uri;
    EXPECT_EQ(s.images.size(), 1u) << uri;
    EXPECT_EQ(s.triangleCount(), 1u) << uri;
  }
}

/// What exporters write though the standard has it otherwise.
TEST_F(SceneGltf, LooseJson) {
  GlbBuilder b = triangleGlb();
  b.doc["buffers"] = {
      {{"byteLength", 30}, {"uri", "file://" + (folder_ / "my%20file.bin").string()}}};
  write("my file.bin", b.bin);
  const std::string text = b.doc.dump();
  const auto with = [&](const std::string& from, const std::string& to) {
    std::string changed = text;
    const std::size_t at = changed.find(from);
    EXPECT_NE(at, std::string::npos) << from;
    return changed.replace(at, from.size(), to);
  };
  // Under the other extension, a buffer longer than it says, a URI with its scheme.
  for (const char* name : {"a.gltf", "a.glb"}) {
    const Scene s = import(name, text);
    EXPECT_EQ(s.triangleCount(), 1u);
    EXPECT_EQ(s.replaced.count, 0u);
  }
  EXPECT_EQ(import("whole.gltf", with("\"count\":3", "\"count\":3.0")).triangleCount(), 1u);
  const Scene nan = import(
      "nan.gltf", with("\"mesh\":0",
                       "\"mesh\":0,\"name\":\"a NaN \\\"inf\",\"translation\":[NaN,2,-Infinity]"));
  EXPECT_EQ(nan.bounds().lower, dvec3(0, 2, 0));
  EXPECT_EQ(nan.replaced.count, 2u);
  EXPECT_EQ(nan.objects.at(0), "a NaN \"inf");
  EXPECT_THROW(import("bad.glb", "no glTF"), Error);
  EXPECT_THROW(import("blank.glb", "  "), Error);
}

}  // namespace
}  // namespace trex::test
