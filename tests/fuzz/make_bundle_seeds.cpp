// Writes small valid bundles and their scene.json, where the fuzzing of those formats starts.
// Usage: fuzz_bundle_seeds FOLDER
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <string>

#include "src/bundle/bundle.h"
#include "tests/unit/bundle_scene.h"

namespace {

namespace fs = std::filesystem;

void write(const fs::path& path, std::span<const std::byte> bytes) {
  std::ofstream(path, std::ios::binary)
      .write(reinterpret_cast<const char*>(bytes.data()), static_cast<long>(bytes.size()));
}

void writeBundle(const fs::path& folder, const std::string& name, trex::Scene scene, bool voxels) {
  trex::BakeFacts facts;
  facts.input = "little.glb";
  facts.requirements = trex::bundle::requirementsOf(scene, voxels);
  facts.voxelDepth = voxels ? 2 : 0;
  const trex::Model model =
      trex::makeModel(std::move(scene), {.voxels = voxels, .voxelDepth = 2, .precisionBits = 12});
  const std::vector<std::byte> bytes = trex::bundleBytes(model, facts);
  write(folder / "bundle" / (name + ".trex"), bytes);
  const trex::bundle::Container file(bytes, name);
  write(folder / "scene" / (name + ".json"), file.section("scene.json"));
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 2) {
    std::fprintf(stderr, "usage: fuzz_bundle_seeds FOLDER\n");
    return 2;
  }
  const fs::path folder = argv[1];
  fs::create_directories(folder / "bundle");
  fs::create_directories(folder / "scene");
  writeBundle(folder, "furnace", trex::test::furnace(0.5f), true);
  writeBundle(folder, "exact", trex::test::furnace(0.5f), false);
  writeBundle(folder, "everything", trex::test::littleOfEverything(), true);
}
