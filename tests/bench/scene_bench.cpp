// Load times and sizes of models, and texture look-ups a second, as JSON.
//
//   scene_bench FILE...
#include <OpenImageIO/imagecache.h>
#include <OpenImageIO/imageio.h>

#include <chrono>
#include <ctime>
#include <filesystem>
#include <iostream>
#include <nlohmann/json.hpp>

#include "src/core/error.h"
#include "src/core/memory.h"
#include "src/scene/import.h"
#include "src/scene/texels.h"
#include "src/scene/texture.h"
#include "src/scene/texture_cache.h"

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

constexpr int kSide = 8192;

/// A picture without end: nothing that a cache could guess.
trex::Image noise() {
  trex::Image image;
  image.width = image.height = kSide;
  image.channels = 3;
  image.bytes.resize(std::size_t{3} * kSide * kSide);
  std::uint32_t state = 1;
  for (std::uint8_t& b : image.bytes) {
    state = state * 1664525u + 1013904223u;
    b = static_cast<std::uint8_t>(90 + (state >> 27));
  }
  return image;
}

/// Look-ups for each second of processor time: scattered ones, or such along a line in steps of a
/// texel. Waves of 16 are asked for before they are read, as paths do.
double measureTexture(const trex::Image& image, int count, bool scattered) {
  constexpr int kWave = 16;
  const trex::Texture texture;
  const std::clock_t start = std::clock();
  float sum = 0.0f;
  std::uint32_t state = 1;
  for (int i = 0; i < count; i += kWave) {
    trex::vec2 uv[kWave];
    for (int k = 0; k < kWave; ++k) {
      state = state * 1664525u + 1013904223u;
      const float u = scattered ? float(state >> 8) * 0x1p-24f : float(i + k) / float(kSide);
      state = state * 1664525u + 1013904223u;
      uv[k] = {u, scattered ? float(state >> 8) * 0x1p-24f : u * 0.37f};
      trex::prefetchTexture(image, texture, uv[k]);
    }
    for (const trex::vec2& at : uv) sum += trex::sampleTexture(image, texture, at, true).x;
  }
  const double seconds = double(std::clock() - start) / CLOCKS_PER_SEC;
  return sum > 0.0f ? count / seconds : 0.0;
}

/// The same of OpenImageIO's cache, of a file without tiles, from which it makes some.
double measureOtherCache(const trex::Image& image, std::uint64_t limit, int count) {
  const std::filesystem::path path = std::filesystem::temp_directory_path() / "trex-bench.png";
  const auto out = OIIO::ImageOutput::create(path.string());
  out->open(path.string(), OIIO::ImageSpec(kSide, kSide, 3, OIIO::TypeDesc::UINT8));
  out->write_image(OIIO::TypeDesc::UINT8, image.bytes.data());
  out->close();
  OIIO::ImageCache* const cache = OIIO::ImageCache::create(false);
  cache->attribute("autotile", 64);
  cache->attribute("max_memory_MB", static_cast<float>(limit >> 20));
  const OIIO::ustring name(path.string());
  const std::clock_t start = std::clock();
  std::uint32_t state = 1, sum = 0;
  for (int i = 0; i < count; ++i) {
    state = state * 1664525u + 1013904223u;
    const int x = static_cast<int>(state >> 8) % (kSide - 2);
    state = state * 1664525u + 1013904223u;
    const int y = static_cast<int>(state >> 8) % (kSide - 2);
    std::uint8_t four[12] = {};
    cache->get_pixels(name, 0, 0, x, x + 2, y, y + 2, 0, 1, OIIO::TypeDesc::UINT8, four);
    sum += four[0];
  }
  const double seconds = double(std::clock() - start) / CLOCKS_PER_SEC;
  OIIO::ImageCache::destroy(cache);
  std::filesystem::remove(path);
  return sum > 0 ? count / seconds : 0.0;
}

nlohmann::json measureTextures() {
  constexpr int kCount = 4'000'000, kFew = 200'000, kFewer = 40;
  const std::uint64_t all = std::uint64_t{3} * kSide * kSide, tenth = all / 10;
  const std::filesystem::path folder = std::filesystem::temp_directory_path();
  const trex::Image whole = noise();
  trex::Image quarter;  // that the first makes no room for
  quarter.width = kSide, quarter.height = kSide / 4, quarter.channels = 3;
  quarter.bytes.resize(all / 4);
  const auto inTiles = [&](std::uint64_t limit) {
    trex::Scene scene;
    scene.textures = std::make_shared<trex::TextureCache>(limit, 0, folder);
    addImage(scene, whole);
    addImage(scene, quarter);
    return scene;
  };
  const trex::Scene most = inTiles(all + tenth), few = inTiles(tenth);
  measureTexture(most.images[0], kCount, true);  // fills the pool
  return {
      {"texel_bytes", all},
      {"scattered_whole", measureTexture(whole, kCount, true)},
      {"scattered_in_tiles", measureTexture(most.images[0], kCount, true)},
      {"scattered_in_tiles_a_tenth_of_them_in_memory", measureTexture(few.images[0], kFew, true)},
      {"scattered_by_openimageio_a_tenth_in_memory", measureOtherCache(whole, tenth, kFewer)},
      {"along_a_line_whole", measureTexture(whole, kCount, false)},
      {"along_a_line_in_tiles", measureTexture(most.images[0], kCount, false)}};
}

}  // namespace

int main(int argc, char** argv) {
  try {
    nlohmann::json result;
    for (int i = 1; i < argc; ++i) result["imports"].push_back(measureImport(argv[i]));
    result["texture_lookups_per_processor_second"] = measureTextures();
    std::cout << result.dump(1) << "\n";
    return 0;
  } catch (const trex::Error& e) {
    std::cerr << "scene_bench: " << e.what() << "\n";
    return static_cast<int>(e.code());
  }
}
