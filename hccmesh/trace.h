// The tests of a ray against one cluster, for the best instruction set of this processor.
#pragma once

#include "hccmesh/hccmesh.h"

namespace hccm {

struct Kernels {
  bool (*intersect)(const std::byte* blob, PreparedRay& ray, std::uint32_t cluster, Hit& hit);
  bool (*occluded)(const std::byte* blob, const PreparedRay& ray);
  const char* name;  ///< of the instruction set
};

/// Obeys hwy::SetSupportedTargetsForTest. Thread safe.
Kernels chooseKernels();

}  // namespace hccm
