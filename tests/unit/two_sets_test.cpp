// A scene that reads textures by its second set of coordinates is one that reads them by its first.
#include <gtest/gtest.h>

#include "src/session/mesh_voxel_source.h"
#include "src/session/paged_voxels.h"
#include "src/session/voxel_source.h"
#include "tests/unit/bundle_scene.h"
#include "tests/unit/stream_meshes.h"

namespace trex {
namespace {

/// A ball in a box, both with pictures of colour and of light; one of them placed mirrored. By the
/// second set: the first one is another at each vertex.
Scene pictures(bool second) {
  Scene scene;
  scene.source = "pictures";
  scene.images = {test::noiseImage(8, 8, 4, false, 1), test::noiseImage(8, 8, 3, false, 2)};
  Material m = test::lambert(0.9f, 3.0f);
  m.alphaMode = AlphaMode::kMask;
  m.alphaCutoff = 0.3f;
  m.baseColorTexture.image = 0;
  m.emissiveTexture.image = 1;
  for (Texture* t : m.textures()) t->set = second ? 1 : 0;
  scene.materials = {m};
  for (Mesh mesh : {test::box(vec3(-4.0f), vec3(4.0f), 0, true), test::sphere({}, 1.5f, 0, 12)}) {
    for (const vec3& p : mesh.positions) mesh.texCoords.emplace_back(0.2f * p.x, p.y + 0.3f * p.z);
    if (second) {
      mesh.secondTexCoords = mesh.texCoords;
      for (vec2& uv : mesh.texCoords) uv = vec2(uv.y, 0.5f) * 2.0f;
    }
    scene.objects.push_back("object");
    test::place(scene, std::move(mesh));
  }
  scene.instances[1].transform[0][0] = -1.0;
  scene.cameras.emplace_back();
  return scene;
}

std::vector<std::byte> voxelsOf(const Scene& scene, bool fromMeshes) {
  const RayScene rays(scene);
  asvo::BuildOptions build;
  build.depth = 4;
  if (fromMeshes) {
    const MeshVoxelSource source(rays, scene, scene.materials, {});
    return asvo::Tree::build(source, build).toBytes();
  }
  const VoxelSource source(scene, scene.materials, rays.renderOrigin());
  return asvo::Tree::build(source, build).toBytes();
}

TEST(TwoSets, VoxelsAreThoseOfOneSet) {
  EXPECT_EQ(voxelsOf(pictures(true), false), voxelsOf(pictures(false), false));
  EXPECT_EQ(voxelsOf(pictures(true), true), voxelsOf(pictures(false), true));
  Scene other = pictures(true);
  for (vec2& uv : other.meshes[1].secondTexCoords) uv.x += 0.3f;
  EXPECT_NE(voxelsOf(other, true), voxelsOf(pictures(true), true));
}

/// Of the ball alone, from pages.
std::vector<std::byte> pagedVoxelsOf(const Scene& scene) {
  const Mesh& mesh = scene.meshes[1];
  hccm::test::Soup soup;
  soup.positions = mesh.positions, soup.triangles = mesh.triangles;
  soup.texCoords = mesh.texCoords, soup.secondTexCoords = mesh.secondTexCoords;
  hccm::test::Streamed streamed = hccm::test::stream(soup);
  const hccm::PagedMesh paged = streamed.mesh();
  asvo::BuildOptions build;
  build.depth = 4;
  return buildPagedVoxels(scene, paged, build, 64u << 20, [](double) { return true; }).toBytes();
}

TEST(TwoSets, VoxelsOfPagesAreThoseOfOneSet) {
  EXPECT_EQ(pagedVoxelsOf(pictures(true)), pagedVoxelsOf(pictures(false)));
  Scene other = pictures(true);
  for (vec2& uv : other.meshes[1].secondTexCoords) uv.x += 0.3f;
  EXPECT_NE(pagedVoxelsOf(other), pagedVoxelsOf(pictures(true)));
}

TEST(TwoSets, ABundleKeepsWhichSetATextureReads) {
  ModelOptions options;
  options.voxels = false;
  const std::vector<std::byte> bytes =
      bundleBytes(makeModel(pictures(true), options), test::littleFacts(0));
  const BundleContents read = test::readBuffer(bytes);  // meshes lie in the bytes
  const Material& m = read.description.scene.materials[0];
  EXPECT_EQ(m.baseColorTexture.set, 1);
  EXPECT_EQ(m.emissiveTexture.set, 1);
  EXPECT_TRUE(read.parts.world.triangle(0, 0).hasSecondTexCoords);
  const auto requirements = bundle::requirementsOf(pictures(true), true);
  EXPECT_NE(requirements[1].reason.find("with a second set"), std::string::npos);
}

}  // namespace
}  // namespace trex
