// Load times and sizes of models, and texture look-ups a second, as JSON.
//
//   scene_bench FILE...
#include <chrono>
#include <ctime>
#include <iostream>
#include <nlohmann/json.hpp>

#include "src/core/error.h"
#include "src/core/memory.h"
#include "src/scene/import.h"
#include "src/scene/texels.h"
#include "src/scene/texture.h"

namespace {

double secondsSince(std::chrono::steady_clock::time_point start) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

nlohmann::json measureImport(const char* path) {
  const auto start = std::chrono::steady_clock::now();
  const trex::Scene scene = trex::importScene(path);
  const double seconds = secondsSince(start);
  std::uint64_t imageBytes = 0;
  for (const trex::Image& image : scene.images) {
    imageBytes += trex::wholeTexels(image).size();
  }
  const trex::Box3d bounds = scene.bounds();
  return {{"file", path},
          {"import_seconds", seconds},
          {"triangles", scene.triangleCount()},
          {"unique_triangles", scene.uniqueTriangleCount()},
          {"instances", scene.instances.size()},
          {"meshes", scene.meshes.size()},
          {"materials", scene.materials.size()},
          {"images", scene.images.size()},
          {"image_bytes", imageBytes},
          {"cameras", scene.cameras.size()},
          {"lights", scene.lights.size()},
          {"dropped_triangles", scene.droppedTriangles},
          {"lower", {bounds.lower.x, bounds.lower.y, bounds.lower.z}},
          {"upper", {bounds.upper.x, bounds.upper.y, bounds.upper.z}},
          {"warnings", scene.warnings},
          {"peak_resident_bytes", trex::peakResidentBytes()}};
}

/// Look-ups for each second of processor time at scattered coordinates in a 1024x1024 RGB image.
double measureTexture() {
  trex::Image image;
  image.width = image.height = 1024;
  image.channels = 3;
  image.bytes.assign(3u << 20, 90);
  const trex::Texture texture;
  constexpr int kCount = 4'000'000;
  const std::clock_t start = std::clock();
  float sum = 0.0f;
  std::uint32_t state = 1;
  for (int i = 0; i < kCount; ++i) {
    state = state * 1664525u + 1013904223u;
    const trex::vec2 uv(float(state >> 16) * 1e-3f, float(state & 0xffffu) * 1e-3f);
    sum += trex::sampleTexture(image, texture, uv, true).x;
  }
  const double seconds = double(std::clock() - start) / CLOCKS_PER_SEC;
  return sum > 0.0f ? kCount / seconds : 0.0;
}

}  // namespace

int main(int argc, char** argv) {
  try {
    nlohmann::json result;
    for (int i = 1; i < argc; ++i) result["imports"].push_back(measureImport(argv[i]));
    result["texture_lookups_per_processor_second"] = measureTexture();
    std::cout << result.dump(1) << "\n";
    return 0;
  } catch (const trex::Error& e) {
    std::cerr << "scene_bench: " << e.what() << "\n";
    return static_cast<int>(e.code());
  }
}
