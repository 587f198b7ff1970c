// G-rays that paths ask for, and what they do where voxels do not know the answer.
#pragma once

#include <cstdint>
#include <vector>

#include "src/core/maths.h"
#include "src/paths/path_state.h"

namespace trex {

/// A G-ray that a path asks for. The answer adds to the guess of its pixel:
/// weight * radiance + background * transmittance.
struct ConeRequest {
  static constexpr std::uint32_t kNoPath = 0xffffffffu;

  vec3 origin, direction;
  float tanHalf = 0.0f, tmin = 0.0f, tmax = kInfinity;
  float jitter = 0.0f;
  vec3 weight{0.0f}, background{0.0f};
  std::uint32_t job = 0;         ///< of the job, see PathTracer::trace()
  std::uint32_t path = kNoPath;  ///< of Cones::paths, the path in whose place it is
  std::uint16_t bounce = 0;      ///< of the path: its later requests have more
  bool shadow = false;           ///< transmittance alone
  bool direct = false;           ///< `background` is direct light
};

/// Those of some samples, and the paths that go on by rays (PathTracer::resume()) where a cone met
/// what voxels do not know (shaderio::kUnknown).
struct Cones {
  std::vector<ConeRequest> requests;
  std::vector<PathState> paths;

  void clear() {
    requests.clear();
    paths.clear();
  }
  void append(const Cones& more) {
    const auto first = static_cast<std::uint32_t>(paths.size());
    for (ConeRequest request : more.requests) {
      if (request.path != ConeRequest::kNoPath) request.path += first;
      requests.push_back(request);
    }
    paths.insert(paths.end(), more.paths.begin(), more.paths.end());
  }
};

}  // namespace trex
