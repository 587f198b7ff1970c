#include "src/viewer/inspect.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

#include "asvo/tracer.h"
#include "src/frame/lattice.h"
#include "src/viewer/screen_picture.h"

namespace trex {
namespace {

/// Largest and least value over the lattice, of those that are not negative.
template <typename Value>
void rangeOf(std::uint32_t width, std::uint32_t height, std::uint32_t spacing, const Value& value,
             float& least, float& largest) {
  least = kInfinity;
  largest = 0.0f;
  for (std::uint32_t y = 0; y < height; y += spacing) {
    for (std::uint32_t x = 0; x < width; x += spacing) {
      const float v = value(x, y);
      if (!(v >= 0.0f)) continue;
      least = std::min(least, v);
      largest = std::max(largest, v);
    }
  }
}

/// Where a ray enters and leaves the cube of a tree.
bool crossCube(const asvo::AsvoInfo& info, const vec3& origin, const vec3& direction, float& enter,
               float& leave) {
  const vec3 lower(info.lowerX, info.lowerY, info.lowerZ);
  enter = 0.0f;
  leave = kInfinity;
  for (int c = 0; c < 3; ++c) {
    const float inverse = 1.0f / (direction[c] == 0.0f ? 1e-20f : direction[c]);
    float a = (lower[c] - origin[c]) * inverse, b = (lower[c] + info.size - origin[c]) * inverse;
    if (a > b) std::swap(a, b);
    enter = std::max(enter, a);
    leave = std::min(leave, b);
  }
  return enter < leave;
}

/// The voxels of a level as cubes, lit from the viewer; the sky is dark grey.
vec3 voxelView(const asvo::Tree& tree, const vec3& origin, const vec3& direction, int level) {
  const asvo::Tracer tracer(tree);
  const vec3 background(0.06f);
  float t = 0.0f, leave = 0.0f;
  if (tree.info.leafCount == 0 || !crossCube(tree.info, origin, direction, t, leave)) {
    return background;
  }
  const auto depth =
      static_cast<std::uint32_t>(std::clamp(level, 0, static_cast<int>(tree.info.depth)));
  const float edge = tree.info.size / static_cast<float>(1u << depth);
  const vec3 lower(tree.info.lowerX, tree.info.lowerY, tree.info.lowerZ);
  int axis = 0;
  bool outside = t > 0.0f;  // the eye may stand in a voxel: those around it are passed
  const float hair = edge * 1e-3f;
  while (t < leave) {
    const vec3 at = origin + direction * (t + hair);
    const std::uint32_t voxel = tracer.asvoFind(at, depth);
    outside |= voxel == asvo::ASVO_NONE;
    if (voxel != asvo::ASVO_NONE && outside) {
      const std::uint32_t c = tree.voxels[voxel].z;
      const vec3 albedo(static_cast<float>(c & 255u), static_cast<float>((c >> 8) & 255u),
                        static_cast<float>((c >> 16) & 255u));
      const float shade = 0.35f + 0.65f * std::abs(direction[axis]) / glm::length(direction);
      return glm::sqrt(albedo / 255.0f) * shade + 0.05f;
    }
    float next = leave;
    for (int k = 0; k < 3; ++k) {
      if (direction[k] == 0.0f) continue;
      const float cell =
          std::floor((at[k] - lower[k]) / edge) + (direction[k] > 0.0f ? 1.0f : 0.0f);
      const float s = (lower[k] + cell * edge - origin[k]) / direction[k];
      if (s > t && s < next) {
        next = s;
        axis = k;
      }
    }
    t = std::max(next, t + hair);
  }
  return background;
}

/// The cached light at the first surface, W/m^2 over pi: what white paper would send back.
vec3 photonView(const Session& session, const dvec3& origin, const vec3& direction) {
  const RayScene& rays = session.rays();
  RayHit hit;
  if (!rays.intersect(origin, direction, 0.0f, kInfinity, hit)) return vec3(0.0f);
  const Surface surface = rays.surface(hit);
  const vec3& n = surface.geometricNormal;
  vec3 light;
  return session.light().at(vec3(surface.position), glm::dot(n, direction) > 0.0f ? -n : n, light)
             ? light * kInvPi
             : vec3(0.0f);
}

}  // namespace

std::function<vec3(const FrameBuffers&, std::uint32_t, std::uint32_t)> viewOf(
    ViewMode mode, const FrameBuffers& frame, std::uint32_t width, std::uint32_t height,
    std::uint32_t spacing) {
  using Pixel = std::uint32_t;
  using Frame = const FrameBuffers&;
  float least = 0.0f, largest = 1.0f;
  switch (mode) {
    case ViewMode::kAlbedo:
      return [](Frame f, Pixel x, Pixel y) { return glm::sqrt(f.features->mean(x, y).albedo); };
    case ViewMode::kNormal:
      return [](Frame f, Pixel x, Pixel y) {
        return f.features->mean(x, y).normal * 0.5f + vec3(0.5f);
      };
    case ViewMode::kDepth:
      rangeOf(
          width, height, spacing, [&](Pixel x, Pixel y) { return frame.firstHits->at(x, y).depth; },
          least, largest);
      return [least, largest](Frame f, Pixel x, Pixel y) {
        const float d = f.firstHits->at(x, y).depth;
        if (d < 0.0f) return vec3(0.0f);
        return vec3(1.0f - 0.9f * (d - least) / std::max(largest - least, 1e-20f));
      };
    case ViewMode::kVariance: {
      // Deviation over the mean, which is what the eye sees of noise.
      return [](Frame f, Pixel x, Pixel y) {
        const float mean = luminance(vec3(f.rawMean(x, y)));
        const float deviation = std::sqrt(luminance(vec3(f.rawVariance(x, y))));
        return heat(std::log2(1.0f + 8.0f * deviation / (mean + 1e-6f)) / 4.0f);
      };
    }
    case ViewMode::kSampleCount:
      rangeOf(
          width, height, spacing,
          [&](Pixel x, Pixel y) { return static_cast<float>(frame.sums.samples(x, y)); }, least,
          largest);
      return [largest](Frame f, Pixel x, Pixel y) {
        return heat(0.75f * static_cast<float>(f.sums.samples(x, y)) / std::max(largest, 1.0f));
      };
    default:
      return [](Frame f, Pixel x, Pixel y) {
        const vec2 rays = f.rayClasses->at(x, y);
        const float share = rays.y / std::max(rays.x + rays.y, 1.0f);
        return glm::mix(vec3(1.0f, 0.55f, 0.1f), vec3(0.1f, 0.45f, 1.0f),
                        std::min(2.0f * share, 1.0f));
      };
  }
}

void inspectCell(const Session& session, const ViewState& state, std::uint32_t cell,
                 std::vector<vec3>& picture) {
  const std::uint32_t width = session.frame().width(), height = session.frame().height();
  const lattice::Place at = lattice::kPlaces[cell];
  const std::uint32_t block = cell == 0 ? 8 : cell < 4 ? 4 : cell < 16 ? 2 : 1;
  const std::uint32_t rows =
      height > at.y ? (height - at.y + lattice::kSide - 1) / lattice::kSide : 0;
  tbb::parallel_for(0u, rows, [&](std::uint32_t row) {
    const std::uint32_t y = at.y + row * lattice::kSide;
    for (std::uint32_t x = at.x; x < width; x += lattice::kSide) {
      dvec3 origin;
      vec3 direction;
      session.cameraRays().ray(static_cast<float>(x) + 0.5f, static_cast<float>(y) + 0.5f, origin,
                               direction);
      const vec3 value = state.mode == ViewMode::kVoxels
                             ? session.light().voxels()
                                   ? voxelView(*session.light().voxels(), vec3(origin), direction,
                                               state.voxelLevel)
                                   : vec3(0.0f)
                             : photonView(session, origin, direction);
      for (std::uint32_t v = y; v < std::min(y + block, height); ++v) {
        for (std::uint32_t u = x; u < std::min(x + block, width); ++u) {
          picture[std::size_t{v} * width + u] = value;
        }
      }
    }
  });
}

void splitWith(const Session& exact, float at, std::vector<vec3>& picture) {
  const std::uint32_t width = exact.frame().width(), height = exact.frame().height();
  const FrameBuffers& frame = exact.shownFrame();
  const std::uint32_t spacing = lattice::spacing(frame.tiles.coarseCells());
  if (spacing == 0 || picture.size() != std::size_t{width} * height) return;
  const auto first =
      static_cast<std::uint32_t>(std::clamp(at, 0.0f, 1.0f) * static_cast<float>(width));
  tbb::parallel_for(0u, height, [&](std::uint32_t y) {
    for (std::uint32_t x = first; x < width; ++x) {
      picture[std::size_t{y} * width + x] =
          x < first + 2 ? vec3(1.0f)
                        : vec3(frame.sums.mean(x / spacing * spacing, y / spacing * spacing));
    }
  });
}

}  // namespace trex
