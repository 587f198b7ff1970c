#include "src/crays/ray_scene_surface.h"
#include "src/paths/path_tracer.h"
#include "src/paths/wave.h"

namespace trex {

/// Decodes the surfaces that were hit: plain ones into lanes, which are shaded together.
void PathTracer::decode(Wave& wave) const {
  wave.plainCount = 0;
  for (WavePath* path : wave.underWay) {
    path->bsdf.reset();
    path->place = WavePath::kNotPlain;
    if (!decodePlain(*path, wave)) path->surface = rays_.surface(path->hit);
    const bool reads = !path->isPlain() || plain_[path->surface.material].textured();
    if (reads) prefetchTextures(scene_, path->surface);
  }
  if (wave.plainCount == 0) return;
  for (const WavePath* path : wave.underWay) {
    if (path->isPlain()) colourPlain(*path, wave);
  }
  for (std::size_t i = 0; i < wave.plainBlocks(); ++i) kernels_->shade(wave.plain[i]);
  for (WavePath* path : wave.underWay) {
    if (path->isPlain()) finishPlain(*path, wave);
  }
}

/// The corners of a plain surface. False if it is none, as far as is known without its textures.
bool PathTracer::decodePlain(WavePath& path, Wave& wave) const {
  if (plain_.empty() || path.caustics != nullptr || !rays_.inPlace(path.hit)) return false;
  const hccm::Triangle triangle = rays_.triangle(path.hit);
  if (!plain_[triangle.material].plain) return false;
  path.place = static_cast<std::uint8_t>(wave.plainCount++);
  PlainLanes& lanes = wave.plain[path.place / PlainLanes::kLanes];
  const std::size_t lane = Wave::laneOf(path);
  if (lane == 0) lanes.smooth = 0;
  lanes.u[lane] = path.hit.u;
  lanes.v[lane] = path.hit.v;
  for (int corner = 0; corner < 3; ++corner) {
    for (int k = 0; k < 3; ++k) lanes.corner[corner][k][lane] = triangle.position[corner][k];
  }
  if (triangle.hasNormals) {
    lanes.smooth |= 1u << lane;
    for (int corner = 0; corner < 3; ++corner) {
      for (int k = 0; k < 3; ++k) lanes.cornerNormal[corner][k][lane] = triangle.normal[corner][k];
    }
  }
  for (int k = 0; k < 3; ++k) lanes.direction[k][lane] = path.direction[k];
  Surface& surface = path.surface;
  readAttributes(triangle, path.hit, surface);
  surface.material = triangle.material;
  surface.object = triangle.object;
  surface.instance = path.hit.instance;
  surface.cluster = path.hit.cluster;
  surface.triangle = path.hit.triangle;
  return true;
}

/// The material of a plain surface, as Bsdf has it.
void PathTracer::colourPlain(const WavePath& path, Wave& wave) const {
  PlainLanes& lanes = wave.plain[path.place / PlainLanes::kLanes];
  const std::size_t lane = Wave::laneOf(path);
  const PlainMaterial material = plain_[path.surface.material].at(
      scene_, path.surface.material, path.surface.texCoords, path.surface.color);
  for (int k = 0; k < 3; ++k) {
    lanes.color[k][lane] = material.color[k];
    lanes.f0[k][lane] = material.f0[k];
  }
  lanes.f90[lane] = material.f90;
  lanes.metallic[lane] = material.metallic;
  lanes.alpha[lane] = material.alpha;
}

/// What rays ask of the surface. One that turns out not to be plain is decoded anew.
void PathTracer::finishPlain(WavePath& path, const Wave& wave) const {
  const PlainLanes& lanes = wave.lanesOf(path);
  const std::size_t lane = Wave::laneOf(path);
  if (PlainLanes::is(lanes.odd, lane) || !(lanes.alpha[lane] > kClearAlpha)) {
    path.place = WavePath::kNotPlain;
    path.surface = rays_.surface(path.hit);
    return;
  }
  Surface& surface = path.surface;
  surface.position = PlainLanes::vector(lanes.position, lane);
  surface.geometricNormal = PlainLanes::vector(lanes.geometricNormal, lane);
  for (int side = 0; side < 2; ++side) {
    surface.lift[side] = PlainLanes::vector(lanes.lift[side], lane);
  }
  surface.bend = lanes.bend[lane];
}

/// That of any surface, for what is asked too seldom to be done in lanes.
const Bsdf& PathTracer::bsdfOf(WavePath& path) const {
  if (!path.bsdf) path.bsdf.emplace(scene_, rays_.surface(path.hit), -path.direction);
  return *path.bsdf;
}

}  // namespace trex
