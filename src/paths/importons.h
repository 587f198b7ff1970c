// Importons: camera paths that mark the places whose cached light would be read, so that photons
// are sent there (photon_guide.h).
#pragma once

#include <cstdint>
#include <span>

#include "src/crays/camera_rays.h"
#include "src/crays/lights.h"
#include "src/crays/photon_guide.h"

namespace trex {

class WalkTracer;

/// Traces `paths` camera paths, their numbers fixed by `seed`, over a picture of width x height,
/// and notes the surfaces that diffuse bounces find. Deterministic: see WalkTracer::follow().
ImportanceMap traceImportons(const Scene& scene, const WalkTracer& walks, const CameraRays& camera,
                             std::uint32_t width, std::uint32_t height, std::uint32_t seed,
                             std::uint32_t paths = 4096);

/// Hints from importons for guides of the lights, by source: LightSet::hint().
void hintGuides(const Scene& scene, const WalkTracer& walks, const LightSet& lights,
                const ImportanceMap& importance, std::span<EmissionGuide> guides);

}  // namespace trex
