// Models in pages of which few may be there, for tests of rays that wait.
#pragma once

#include <memory>
#include <vector>

#include "src/crays/ray_scene.h"
#include "tests/unit/scenes.h"
#include "tests/unit/stream_meshes.h"

namespace trex::test {

/// Wavy sheets above each other, of materials in turn: rays meet many groups before a hit.
/// `smooth`: with normals of an even rounder surface.
inline hccm::test::Soup sheets(bool smooth = false) {
  hccm::test::Soup all;
  for (int i = 0; i < 5; ++i) {
    const hccm::test::Soup one = hccm::test::sheet(60);
    const auto first = static_cast<std::uint32_t>(all.positions.size());
    for (glm::vec3 p : one.positions) {
      if (smooth) {
        all.normals.push_back(
            glm::normalize(vec3(std::sin(9.0f * p.x), std::cos(7.0f * p.y), 1.0f)));
      }
      p.z += 0.06f * static_cast<float>(i) + 0.02f * std::sin(20.0f * p.x);
      all.positions.push_back(p);
    }
    // With holes, so that rays go on to what is behind.
    for (std::size_t t = 0; t < one.triangles.size(); ++t) {
      if (t / 40 % 3 == static_cast<std::size_t>(i) % 3) continue;
      all.triangles.push_back(one.triangles[t] + first);
    }
  }
  return all;
}

/// A model in pages of which so many bytes may be there.
struct Paged {
  Scene scene;
  std::unique_ptr<RayScene> rays;
  const hccm::PagedMesh& mesh() const { return *rays->parts().paged; }
  hccm::PageCache& cache() const { return mesh().cache(); }
};

inline std::uint64_t leastBytes(const hccm::PageTable& table) {
  return hccm::PageCache::leastBytes(table);
}

/// `pages`: that may be there. `failing`: one that can't be read. `change`, may be null: adds to
/// the scene. `readSeconds`: that each read takes. `atOnce`: pages that are to be asked for at
/// once. `keptBytes`: of a file of unpacked pages; 0: none.
inline Paged paged(const std::vector<Material>& materials, std::uint64_t pages, bool smooth = false,
                   bool failing = false, void (*change)(Scene&) = nullptr, double readSeconds = 0.0,
                   unsigned atOnce = 1, std::uint64_t keptBytes = 0) {
  static const hccm::test::Soup soups[] = {sheets(false), sheets(true)};
  hccm::test::Streamed streamed =
      hccm::test::stream(soups[smooth], static_cast<std::uint32_t>(materials.size()));
  streamed.pages->readSeconds = readSeconds;
  streamed.pages->atOnce = atOnce;
  if (failing)
    streamed.pages->failAt = streamed.table.pages[streamed.table.pages.size() / 2].offset;
  Paged out;
  out.scene.materials = materials;
  for (std::size_t i = 0; i < 7 * materials.size(); ++i) out.scene.objects.push_back("sheet");
  out.scene.environment.color = vec3(0.5f, 0.7f, 1.0f);
  Light lamp;
  lamp.position = dvec3(0.1, 0.2, 0.9);
  lamp.intensity = vec3(3.0f, 2.0f, 1.0f);
  out.scene.lights = {lamp};
  out.scene.cameras = {lookAt(dvec3(0.3, -0.5, 0.6), dvec3(0.0, 0.0, 0.1), 0.9f)};
  if (change != nullptr) change(out.scene);
  RayScene::Parts parts{dvec3(0.0), hccm::Mesh::build({}), {}, {}, nullptr};
  const std::uint64_t bytes = pages * leastBytes(streamed.table);
  const std::size_t all = streamed.table.pages.size();
  parts.paged = std::make_unique<hccm::PagedMesh>(
      streamed.table, std::move(streamed.pages), bytes, 0xffffffffu,
      keptBytes > 0 ? hccm::test::keptPages(all, keptBytes) : nullptr);
  out.rays = std::make_unique<RayScene>(out.scene, std::move(parts));
  return out;
}

}  // namespace trex::test
