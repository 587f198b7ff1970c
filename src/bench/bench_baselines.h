// T-ReX against what it was measured against: photon mapping on the CPU [Kim et al. 2014].
#pragma once

#include <nlohmann/json.hpp>

#include "src/bench/bench_scene.h"

namespace trex {

struct BaselineArguments {
  BenchScene scene;
  RenderSettings settings;        ///< size, seed, guess, share of exact samples, the device of (c)
  double seconds = 20.0;          ///< of each run
  double referenceSeconds = 0.0;  ///< of a reference that is rendered
  std::uint64_t photons = 1 << 20;  ///< of photon mapping
  std::uint64_t nearest = 50;       ///< photons that it takes an irradiance of
};

/// Error over time, nothing filtered. The runs: `photons` is photon mapping (photons on HCCMesh
/// into a tree of points; paths of the camera, lights sampled where they meet a surface, one
/// gathering ray, at its end the nearest photons), `cpu` this program without a device, `device`
/// with one, and missing where there is none.
///
/// {"bench": "baselines", "machine", "settings", "input", "reference", "setup", "runs": [{"name",
/// "points": [{"seconds", "samples", "relmse", "flip", ..}]}], "common_relmse", "ratios":
/// {"photons_over_cpu", "cpu_over_device", "photons_over_device"}, "device_shares_cores"}.
/// common_relmse is what all runs have reached, the worst of their last points; a ratio is of the
/// seconds to it. An interrupt ends the bench with what is done. Throws Error.
nlohmann::json benchBaselines(const BaselineArguments& arguments);

}  // namespace trex
