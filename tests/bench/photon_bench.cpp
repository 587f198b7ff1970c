// Photons and importons a second of one thread of the processor, as walks in waves of several
// sizes, as a Markdown table. Runs of all sizes in turn; medians.
//
//   photon_bench [--runs N] [--photons N] [--sky] MODEL...
//
// --sky: a sky shines. Photons go on to all their landings.
#include <fmt/format.h>
#include <sys/resource.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <cstdlib>
#include <iostream>
#include <string>
#include <vector>

#include "src/bundle/bundle.h"
#include "src/core/error.h"
#include "src/paths/importons.h"
#include "src/paths/photons.h"
#include "src/paths/walk_tracer.h"

namespace trex {
namespace {

constexpr std::size_t kWaves[] = {1, 2, 4, 8, 16};
constexpr std::uint32_t kImportons = 1u << 14;

double processorSeconds() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return double(usage.ru_utime.tv_sec) + 1e-6 * double(usage.ru_utime.tv_usec);
}

double median(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  return values[values.size() / 2];
}

struct Options {
  int runs = 5;
  std::uint64_t photons = 1u << 17;
  bool sky = false;
  std::vector<std::string> models;
};

void measure(const Options& o, const std::string& path) {
  OpenOptions open;
  open.model.voxels = false;
  if (o.sky) open.environment.emplace().color = vec3(1.0f);
  const Model model = openModel(path, open);
  const LightSet lights(model.scene, *model.rays);
  const CameraRays camera(model.scene.cameras.front(), model.rays->renderOrigin(), 256, 256);
  std::vector<double> photons[std::size(kWaves)], importons[std::size(kWaves)];
  std::size_t landings = 0;
  for (int run = 0; run < o.runs; ++run) {
    for (std::size_t i = 0; i < std::size(kWaves); ++i) {
      const WalkTracer walks(*model.rays, kWaves[i]);
      const double start = processorSeconds();
      landings = landPhotons(model.scene, walks, lights, 0, 0, o.photons, true)->size();
      const double middle = processorSeconds();
      traceImportons(model.scene, walks, camera, 256, 256, 0, kImportons);
      photons[i].push_back(middle - start);
      importons[i].push_back(processorSeconds() - middle);
    }
  }
  const double alone = median(photons[0]), aloneToo = median(importons[0]);
  for (std::size_t i = 0; i < std::size(kWaves); ++i) {
    const double s = median(photons[i]), too = median(importons[i]);
    fmt::print("| {} | {} | {:.3f} M | {:.3f} | {:.3f} M | {:.3f} |\n", path, kWaves[i],
               1e-6 * static_cast<double>(o.photons) / s, s / alone, 1e-6 * kImportons / too,
               too / aloneToo);
  }
  std::cerr << fmt::format("{}: {:.2f} landings a photon\n", path,
                           static_cast<double>(landings) / static_cast<double>(o.photons));
}

}  // namespace
}  // namespace trex

int main(int argc, char** argv) {
  using namespace trex;
  try {
    Options o;
    for (int i = 1; i < argc; ++i) {
      const std::string word = argv[i];
      if (word == "--runs" && i + 1 < argc) {
        o.runs = std::max(1, std::atoi(argv[++i]));
      } else if (word == "--photons" && i + 1 < argc) {
        o.photons = static_cast<std::uint64_t>(std::max(1, std::atoi(argv[++i])));
      } else if (word == "--sky") {
        o.sky = true;
      } else {
        o.models.push_back(word);
      }
    }
    fmt::print(
        "| model | wave | photons/s | time | importons/s | time |\n|---|---|---|---|---|---|\n");
    tbb::task_arena one(1);
    one.execute([&] {
      for (const std::string& path : o.models) measure(o, path);
    });
    return 0;
  } catch (const Error& e) {
    std::cerr << "photon_bench: " << e.what() << "\n";
    return static_cast<int>(e.code());
  }
}
