// The approximate side of a session: voxels, the device that traces in them, and their light.
// Private to src/session; present only where a guess is asked for.
#pragma once

#include <memory>

#include "src/core/clock.h"
#include "src/session/light_pass.h"
#include "src/session/session.h"

namespace trex {

struct Session::LightSide {
  std::shared_ptr<const asvo::Tree> tree;
  std::unique_ptr<GRayTracer> device;
  std::unique_ptr<LightCache> cache;
  std::unique_ptr<LightPass> pass;
};

}  // namespace trex
