// Rays aimed at the edges and vertices of three closed meshes from inside: none may get out. With
// the mesh at the world's origin and 10 km and 5000 km off; instanced and turned; and with ray
// origins far outside (there each ray must hit). Prints JSON; fails if a ray gets through.
//
//   crack_bench [--rays 1e8] [--triangles 2e5]
#include <fmt/format.h>
#include <tbb/blocked_range.h>
#include <tbb/parallel_reduce.h>

#include <CLI/CLI.hpp>
#include <chrono>
#include <iostream>
#include <nlohmann/json.hpp>

#include "tests/bench/bench_meshes.h"
#include "tests/bench/crack.h"

int main(int argc, char** argv) {
  using namespace trex;
  double rays = 1e8, triangles = 2e5;
  CLI::App app("Rays at edges and vertices of a closed mesh");
  app.add_option("--rays", rays)->check(CLI::Range(1.0, 1e12));
  app.add_option("--triangles", triangles)->check(CLI::Range(12.0, 1e8));
  CLI11_PARSE(app, argc, argv);

  nlohmann::ordered_json j;
  std::uint64_t lost = 0;
  constexpr double kRuns = 12.0;
  const auto run = [&](const std::string& name, const char* kind, const dmat4& transform,
                       bool twice, double distance) {
    Scene scene = bench::sceneOf(bench::meshOfKind(kind, triangles));
    scene.instances[0].transform = transform;
    if (twice) {  // an Embree instance
      scene.instances.push_back(scene.instances[0]);
      scene.instances[1].transform[3] += glm::dvec4(1e4, 0.0, 0.0, 0.0);
    }
    const RayScene rayScene(scene);
    const auto start = std::chrono::steady_clock::now();
    const auto count = static_cast<std::uint64_t>(rays / kRuns);
    const std::uint64_t through = tbb::parallel_reduce(
        tbb::blocked_range<std::uint64_t>(0, count, 4096), std::uint64_t{0},
        [&](const auto& range, std::uint64_t sum) {
          for (std::uint64_t i = range.begin(); i < range.end(); ++i)
            sum += !bench::crackRayHits(rayScene, scene, i, distance);
          return sum;
        },
        std::plus<>());
    const double seconds =
        std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    j[name] = {{"rays", count}, {"through", through}, {"seconds", seconds}};
    lost += through;
  };
  for (const char* kind : {"sphere", "scan", "needles"})
    for (double offset : {0.0, 1e4, 5e6}) {
      dmat4 far(1.0);
      far[3] = glm::dvec4(offset, -0.6 * offset, 0.8 * offset, 1.0);
      run(fmt::format("{} {:g} m", kind, offset), kind, far, false, 0.0);
    }
  const dmat4 turned(glm::dmat3(0.36, 0.48, -0.8, -0.8, 0.6, 0.0, 0.48, 0.64, 0.6));
  run("sphere, instanced and turned", "sphere", turned, true, 0.0);
  run("sphere, origins 1e3 m away", "sphere", dmat4(1.0), false, 1e3);
  run("scan, origins 1e7 m away", "scan", dmat4(1.0), false, 1e7);
  j["through"] = lost;
  std::cout << j.dump(2) << "\n";
  return lost == 0 ? 0 : 1;
}
