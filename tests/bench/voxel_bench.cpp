// Triangles a second that voxels are built from, as JSON: 10^6 placed cubes, 10^4 placed parts of
// 1,200 triangles each that are a few leaves wide, one dense mesh, and files if any are named.
//
//   voxel_bench [--runs N] [--only cubes|parts|mesh] [FILE...]
//
// A second of the clock and one of the processor (all threads) are told apart, as other work of the
// machine slows the first alone. Best of the runs.
#include <sys/resource.h>

#include <cstdlib>
#include <glm/gtc/matrix_transform.hpp>
#include <iostream>
#include <nlohmann/json.hpp>

#include "src/core/clock.h"
#include "src/core/error.h"
#include "src/core/memory.h"
#include "src/scene/import.h"
#include "src/session/voxel_source.h"
#include "tests/bench/bumpy_sphere.h"

namespace trex {
namespace {

double processorSeconds() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  const auto seconds = [](const timeval& t) { return double(t.tv_sec) + 1e-6 * double(t.tv_usec); };
  return seconds(usage.ru_utime) + seconds(usage.ru_stime);
}

nlohmann::json measure(const Scene& scene, int depth, int runs) {
  const Box3d bounds = scene.bounds();
  asvo::BuildOptions options;
  options.depth = depth;
  asvo::Tree tree;
  double best = 1e300, processor = 1e300;
  std::uint64_t triangles = 0;
  for (int i = 0; i < runs; ++i) {
    const double start = secondsNow(), used = processorSeconds();
    const VoxelSource source(scene, scene.materials, 0.5 * (bounds.lower + bounds.upper));
    tree = asvo::Tree::build(source, options);
    best = std::min(best, secondsNow() - start);
    processor = std::min(processor, processorSeconds() - used);
    triangles = source.count();
  }
  return {{"scene", scene.source},
          {"triangles", triangles},
          {"instances", scene.instances.size()},
          {"depth_asked", depth},
          {"depth", tree.info.depth},
          {"leaves", tree.info.leafCount},
          {"seconds", best},
          {"processor_seconds", processor},
          {"triangles_per_second", std::round(double(triangles) / best)},
          {"triangles_per_processor_second", std::round(double(triangles) / processor)},
          {"peak_resident_bytes", peakResidentBytes()}};
}

Mesh cube(float half) {
  Mesh mesh;
  for (int axis = 0; axis < 3; ++axis) {
    for (const float side : {-1.0f, 1.0f}) {
      const auto first = static_cast<std::uint32_t>(mesh.positions.size());
      for (int corner = 0; corner < 4; ++corner) {
        vec3 p(0.0f);
        p[axis] = side;
        p[(axis + 1) % 3] = side * (corner == 1 || corner == 2 ? 1.0f : -1.0f);
        p[(axis + 2) % 3] = corner >= 2 ? 1.0f : -1.0f;
        mesh.positions.push_back(half * p);
      }
      mesh.triangles.emplace_back(first, first + 1, first + 2);
      mesh.triangles.emplace_back(first, first + 2, first + 3);
    }
  }
  return mesh;
}

/// On a lattice of edge 1, each turned by its number if `turned`.
void place(Scene& scene, int along, bool turned) {
  scene.instances.clear();
  for (int i = 0; i < along * along * along; ++i) {
    Instance instance;
    instance.transform =
        glm::translate(dmat4(1.0), dvec3(i % along, i / along % along, i / along / along));
    if (turned) {
      instance.transform = glm::rotate(instance.transform, 0.7 * i, dvec3(0.36, 0.48, 0.8));
    }
    scene.instances.push_back(instance);
  }
}

Scene cubes() {
  Scene scene = bench::sceneOf(cube(0.4f));
  scene.source = "cubes";
  place(scene, 100, false);
  return scene;
}

Scene parts() {
  Mesh part = bench::bumpySphere(10, false);
  for (vec3& p : part.positions) p *= 0.05f;
  Scene scene = bench::sceneOf(std::move(part));
  scene.source = "parts";
  place(scene, 22, true);
  return scene;
}

Scene denseMesh() {
  Scene scene = bench::sceneOf(bench::bumpySphere(600, false));
  scene.source = "mesh";
  return scene;
}

}  // namespace
}  // namespace trex

int main(int argc, char** argv) {
  using namespace trex;
  try {
    int runs = 3;
    std::string only;
    nlohmann::json out = nlohmann::json::array();
    std::vector<std::string> files;
    for (int i = 1; i < argc; ++i) {
      const std::string word = argv[i];
      if (word == "--runs" && i + 1 < argc) {
        runs = std::max(1, std::atoi(argv[++i]));
      } else if (word == "--only" && i + 1 < argc) {
        only = argv[++i];
      } else {
        files.push_back(word);
      }
    }
    const auto wanted = [&](const char* name) { return only.empty() || only == name; };
    if (wanted("cubes")) out.push_back(measure(cubes(), 7, runs));
    if (wanted("parts")) out.push_back(measure(parts(), 8, runs));
    if (wanted("mesh")) out.push_back(measure(denseMesh(), 8, runs));
    for (const std::string& file : files) out.push_back(measure(importScene(file), 8, runs));
    std::cout << out.dump(1) << "\n";
    return 0;
  } catch (const Error& e) {
    std::cerr << "voxel_bench: " << e.what() << "\n";
    return static_cast<int>(e.code());
  }
}
