#include "src/paths/plain_wave.h"

#include "src/crays/ray_scene_surface.h"

namespace trex {

PlainSurfaces::PlainSurfaces(const Scene& scene, const RayScene& rays, float leastAlpha)
    : scene_(scene),
      rays_(rays),
      materials_(plainMaterials(scene.materials)),
      leastAlpha_(leastAlpha),
      kernels_(choosePlainKernels()) {
  for (PlainMaterial& m : materials_) m.plain &= m.roughnessTexture || m.alpha > leastAlpha_;
}

PlainSurfaces PlainSurfaces::none(const Scene& scene, const RayScene& rays) {
  PlainSurfaces none(scene, rays, kClearAlpha);
  none.materials_.clear();
  return none;
}

std::uint8_t PlainSurfaces::decode(const RayHit& hit, const vec3& direction, PlainWave& wave,
                                   Surface& surface) const {
  if (materials_.empty() || !rays_.inPlace(hit)) return PlainWave::kNotPlain;
  const hccm::Triangle triangle = rays_.triangle(hit);
  if (!materials_[triangle.material].plain) return PlainWave::kNotPlain;
  const auto place = static_cast<std::uint8_t>(wave.plainCount++);
  PlainLanes& lanes = wave.plain[PlainWave::blockOf(place)];
  const std::size_t lane = PlainWave::laneOf(place);
  if (lane == 0) lanes.smooth = 0;
  lanes.u[lane] = hit.u;
  lanes.v[lane] = hit.v;
  for (int corner = 0; corner < 3; ++corner) {
    for (int k = 0; k < 3; ++k) lanes.corner[corner][k][lane] = triangle.position[corner][k];
  }
  if (triangle.hasNormals) {
    lanes.smooth |= 1u << lane;
    for (int corner = 0; corner < 3; ++corner) {
      for (int k = 0; k < 3; ++k) lanes.cornerNormal[corner][k][lane] = triangle.normal[corner][k];
    }
  }
  for (int k = 0; k < 3; ++k) lanes.direction[k][lane] = direction[k];
  readAttributes(triangle, hit, surface);
  surface.material = triangle.material;
  surface.object = triangle.object;
  surface.instance = hit.instance;
  surface.cluster = hit.cluster;
  surface.triangle = hit.triangle;
  return place;
}

void PlainSurfaces::colour(std::uint8_t place, const Surface& surface, PlainWave& wave) const {
  PlainLanes& lanes = wave.plain[PlainWave::blockOf(place)];
  const std::size_t lane = PlainWave::laneOf(place);
  const PlainMaterial material =
      materials_[surface.material].at(scene_, surface.material, surface.texCoords, surface.color);
  for (int k = 0; k < 3; ++k) {
    lanes.color[k][lane] = material.color[k];
    lanes.f0[k][lane] = material.f0[k];
  }
  lanes.f90[lane] = material.f90;
  lanes.metallic[lane] = material.metallic;
  lanes.alpha[lane] = material.alpha;
}

void PlainSurfaces::shade(PlainWave& wave) const {
  for (std::size_t i = 0; i < wave.plainBlocks(); ++i) kernels_->shade(wave.plain[i]);
}

bool PlainSurfaces::finish(std::uint8_t place, const PlainWave& wave, Surface& surface) const {
  const PlainLanes& lanes = wave.lanesOf(place);
  const std::size_t lane = PlainWave::laneOf(place);
  if (PlainLanes::is(lanes.odd, lane) || !(lanes.alpha[lane] > leastAlpha_)) return false;
  surface.position = PlainLanes::vector(lanes.position, lane);
  surface.geometricNormal = PlainLanes::vector(lanes.geometricNormal, lane);
  for (int side = 0; side < 2; ++side) {
    surface.lift[side] = PlainLanes::vector(lanes.lift[side], lane);
  }
  surface.bend = lanes.bend[lane];
  return true;
}

}  // namespace trex
