// Writes small valid .hccm and .asvo files and pages, where the fuzzing of those formats starts.
// Usage: fuzz_seeds FOLDER
#include <algorithm>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <string>

#include "asvo/asvo.h"
#include "hccmesh/hccmesh.h"
#include "hccmesh/layout.h"
#include "hccmesh/pack.h"
#include "hccmesh/validate.h"
#include "tests/fuzz/plain_page.h"
#include "tests/unit/asvo_shapes.h"
#include "tests/unit/stream_meshes.h"

namespace {

namespace fs = std::filesystem;

void write(const fs::path& path, std::span<const std::byte> bytes) {
  std::ofstream(path, std::ios::binary)
      .write(reinterpret_cast<const char*>(bytes.data()), static_cast<long>(bytes.size()));
}

/// Boxes as wide as they go and a checksum to match: then indices and vertices are free to change.
std::vector<std::byte> loosened(std::vector<std::byte> bytes) {
  namespace layout = hccm::layout;
  layout::Header header;
  std::memcpy(&header, bytes.data(), sizeof(header));
  for (std::uint32_t c = 0; c < header.clusterCount; ++c) {
    std::uint32_t start;
    std::memcpy(&start, bytes.data() + sizeof(header) + 4 * c, 4);
    std::byte* blob = bytes.data() + (std::uint64_t(start) << layout::kTableShift);
    layout::ClusterHeader cluster;
    std::memcpy(&cluster, blob, sizeof(cluster));
    std::byte* plane = blob + sizeof(cluster);
    for (int i = 0; cluster.leafCount > 1 && i < 6; ++i, plane += cluster.leafCount)
      std::fill_n(plane, cluster.leafCount, std::byte(i % 2 == 0 ? 0 : 255));
  }
  const std::uint64_t hash = hccm::checksumOf(bytes);
  std::memcpy(bytes.data() + offsetof(layout::Header, checksum), &hash, sizeof(hash));
  return bytes;
}

/// What fuzz_pack takes: a page's first 12 bytes, then each stream as its size and plain bytes.
std::vector<std::byte> plainPage(const hccm::Mesh& mesh) {
  std::vector<std::span<const std::byte>> blobs;
  for (std::uint32_t c = 0; c < mesh.clusterCount(); ++c) blobs.push_back(mesh.clusterBytes(c));
  return trex::fuzz::plainPageOf(hccm::packClusters(blobs));
}

void writeMeshes(const fs::path& folder, const fs::path& pages) {
  for (const int rings : {0, 1, 2, 6, 12}) {
    for (const bool attributes : {false, true}) {
      asvo_shapes::Shape shape;
      if (rings == 1) shape.add({0, 0, 0}, {1, 0, 0}, {0, 1, 0});
      if (rings > 1) shape.addSphere({1, 2, 3}, 1.0f, rings);
      std::vector<glm::vec3> positions, normals;
      std::vector<glm::vec2> texCoords;
      std::vector<glm::uvec3> triangles;
      for (const asvo::Triangle& t : shape.triangles) {
        const auto first = static_cast<std::uint32_t>(positions.size());
        triangles.push_back({first, first + 1, first + 2});
        positions.insert(positions.end(), t.position, t.position + 3);
      }
      for (const glm::vec3& p : positions) {
        normals.push_back(glm::normalize(p));
        texCoords.push_back(glm::vec2(p) * (rings == 6 ? 1.0f : 9.0f));
      }
      const std::vector<glm::u8vec4> colors(positions.size(), {1, 2, 3, 4});
      hccm::Part part;
      part.positions = positions;
      part.triangles = triangles;
      if (attributes) part.normals = normals, part.texCoords = texCoords, part.colors = colors;
      if (attributes && rings > 2) part.secondTexCoords = texCoords;
      const hccm::Mesh mesh = hccm::Mesh::build({&part, 1}, {.precisionBits = rings == 2 ? 8 : 24});
      const std::vector<std::byte> bytes(mesh.bytes().begin(), mesh.bytes().end());
      const std::string name = std::to_string(rings) + (attributes ? "-attributes" : "");
      write(folder / (name + ".hccm"), bytes);
      write(folder / (name + "-loose.hccm"), loosened(bytes));
      write(pages / name, plainPage(mesh));
    }
  }
}

/// A table's length, the table, its pages: as fuzz_pages reads them.
void writePages(const fs::path& folder) {
  using namespace hccm::test;
  for (const int side : {1, 5, 40}) {
    for (const bool attributes : {false, true}) {
      const hccm::test::Soup soup =
          attributes ? withSecondSet(randomSoup(side * 20, 1.0f, 1), 2.0f) : sheet(side);
      const Streamed s = hccm::test::stream(soup, 3);
      const std::vector<std::byte> table = s.table.toBytes();
      const auto length = static_cast<std::uint32_t>(table.size());
      std::vector<std::byte> bytes(sizeof(length));
      std::memcpy(bytes.data(), &length, sizeof(length));
      bytes.insert(bytes.end(), table.begin(), table.end());
      bytes.insert(bytes.end(), s.pages->bytes.begin(), s.pages->bytes.end());
      write(folder / (std::to_string(side) + (attributes ? "-attributes.pages" : ".pages")), bytes);
    }
  }
}

void writeTrees(const fs::path& folder) {
  for (const int depth : {1, 2, 3, 4}) {
    asvo_shapes::Shape sphere, strip;
    sphere.addSphere({0, 0, 0}, 1.0f, 4);
    strip.add({0, 0, 0}, {1, 0.1f, 0}, {1, 0.2f, 0.3f});
    const std::string name = std::to_string(depth) + ".asvo";
    write(folder / ("strip-" + name), asvo::Tree::build(strip, {.depth = depth}).toBytes());
    if (depth > 2) continue;
    write(folder / ("sphere-" + name), asvo::Tree::build(sphere, {.depth = depth}).toBytes());
    write(folder / ("box-" + name),
          asvo::Tree::build(asvo_shapes::cornellBox(), {.depth = depth}).toBytes());
  }
  write(folder / "empty.asvo", asvo::Tree::build(asvo_shapes::Shape()).toBytes());
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 2) {
    std::fprintf(stderr, "usage: fuzz_seeds FOLDER\n");
    return 2;
  }
  const fs::path folder = argv[1];
  fs::create_directories(folder / "hccm");
  fs::create_directories(folder / "asvo");
  fs::create_directories(folder / "pages");
  fs::create_directories(folder / "pack");
  writeMeshes(folder / "hccm", folder / "pack");
  writeTrees(folder / "asvo");
  writePages(folder / "pages");
}
