#include "src/crays/media.h"

#include <algorithm>
#include <cmath>

#include "asvo/medium_trace.h"

namespace trex {
namespace {

using asvo::MediumTracer;

float uniformOf(float u) { return std::min(u, 0x1.fffffep-1f); }

/// Emission of a place of a grid by cell; the mean of its eight corners times eight.
vec3 cornersOf(const asvo::Medium& grid, const asvo::Medium::Brick& brick, int cell) {
  const bool emits = grid.emits() || brick.emission != 0;
  if (brick.values == asvo::Medium::kNone) {
    return 8.0f *
           (emits ? asvo::unpackRgb9e5(brick.emission) * grid.emissionScale : vec3(brick.largest));
  }
  vec3 sum(0.0f);
  for (int corner = 0; corner < 8; ++corner) {
    const int x = (cell >> 6) + (corner >> 2), y = (cell >> 3 & 7) + (corner >> 1 & 1),
              z = (cell & 7) + (corner & 1);
    const std::size_t i = std::size_t{brick.values} * asvo::Medium::kBrickValues +
                          static_cast<std::size_t>(x * 81 + y * 9 + z);
    sum += grid.emits()
               ? asvo::unpackRgb9e5(grid.emissions[i]) * grid.emissionScale
               : vec3(brick.largest * (1.0f / 65535.0f) * static_cast<float>(grid.densities[i]));
  }
  return sum;
}

}  // namespace

float henyeyGreenstein(float cosine, float g) {
  const float d = 1.0f + g * g - 2.0f * g * cosine;
  return 0.25f * kInvPi * (1.0f - g * g) / (d * std::sqrt(std::max(d, 1e-12f)));
}

vec3 sampleHenyeyGreenstein(const vec3& forward, float g, vec2 u) {
  float cosine = 1.0f - 2.0f * u.x;
  if (std::abs(g) > 1e-3f) {
    const float s = (1.0f - g * g) / (1.0f - g + 2.0f * g * u.x);
    cosine = std::clamp((1.0f + g * g - s * s) / (2.0f * g), -1.0f, 1.0f);
  }
  const float sine = std::sqrt(std::max(0.0f, 1.0f - cosine * cosine)), phi = 2.0f * kPi * u.y;
  return Basis(forward).toWorld(vec3(sine * std::cos(phi), sine * std::sin(phi), cosine));
}

/// A ray where it lies in a medium's grid.
struct Media::Met {
  asvo::MediumRay ray;  ///< starts where it enters
  float start = 0.0f;   ///< metres from the ray's own origin to there
  float length = 0.0f;  ///< metres inside
  float depth = 0.0f;   ///< optical
  vec3 emission{0.0f};
};

std::unique_ptr<const Media> Media::make(const Scene& scene, const dvec3& renderOrigin) {
  auto media = std::make_unique<Media>();
  for (const Medium& m : scene.media) {
    if (m.grid->empty() || (!(m.density > 0.0f) && !m.emits())) continue;
    One one;
    one.grid = m.grid;
    dmat4 toRender = m.transform;
    toRender[3] -= glm::dvec4(renderOrigin, 0.0);
    dmat4 base(1.0);
    base[3] = glm::dvec4(dvec3(m.grid->base), 1.0);
    one.toRender = toRender * base;
    one.toCells = glm::inverse(one.toRender);
    one.volume = std::abs(glm::determinant(glm::dmat3(one.toRender)));
    one.density = m.density;
    one.albedo = m.albedo;
    one.emission = m.emission;
    one.anisotropy = m.anisotropy;
    for (int corner = 0; corner < 8; ++corner) {
      const dvec3 size = dvec3(m.grid->size * asvo::Medium::kCells);
      const dvec3 place = size * dvec3(corner & 1, corner >> 1 & 1, corner >> 2);
      media->bounds_.extend(vec3(dvec3(one.toRender * glm::dvec4(place, 1.0))));
    }
    media->media_.push_back(std::move(one));
  }
  if (media->media_.empty()) return nullptr;
  media->addSources();
  return media;
}

/// Clips a ray to the grid, in double: the origin may be a million grids away.
bool Media::enter(const One& one, const dvec3& origin, const vec3& direction, float distance,
                  Met& met) const {
  const dvec3 o(one.toCells * glm::dvec4(origin, 1.0));
  const dvec3 d(one.toCells * glm::dvec4(dvec3(direction), 0.0));
  double from = 0.0, to = static_cast<double>(distance);
  for (int axis = 0; axis < 3; ++axis) {
    const double end = one.grid->size[axis] * asvo::Medium::kCells;
    if (d[axis] == 0.0) {
      if (o[axis] < 0.0 || o[axis] > end) return false;
      continue;
    }
    const double a = -o[axis] / d[axis], b = (end - o[axis]) / d[axis];
    from = std::max(from, std::min(a, b));
    to = std::min(to, std::max(a, b));
  }
  if (!(to > from)) return false;
  met.ray = {vec3(o + d * from), vec3(d)};
  met.start = static_cast<float>(from);
  met.length = static_cast<float>(to - from);
  return met.length > 0.0f;
}

float Media::passed(const One& one, const dvec3& origin, const vec3& direction,
                    float distance) const {
  Met met;
  if (!(one.density > 0.0f) || !enter(one, origin, direction, distance, met)) return 1.0f;
  float depth = 0.0f;
  MediumTracer(*one.grid, one.density)
      .walk(met.ray, 0.0f, met.length, [&](float, float, float here, const vec3&) {
        depth += here;
        return depth < MediumTracer::kOpaque;
      });
  return depth < MediumTracer::kOpaque ? std::exp(-depth) : 0.0f;
}

float Media::transmittance(const dvec3& origin, const vec3& direction, float distance) const {
  float all = 1.0f;
  for (const One& one : media_) {
    all *= passed(one, origin, direction, distance);
    if (all <= 0.0f) return 0.0f;
  }
  return all;
}

bool Media::meets(const dvec3& origin, const vec3& direction, float from, float to) const {
  const dvec3 start = origin + dvec3(direction) * double(from);
  for (const One& one : media_) {
    Met met;
    if (enter(one, start, direction, to - from, met) &&
        MediumTracer(*one.grid, 1.0f).meets(met.ray, 0.0f, met.length)) {
      return true;
    }
  }
  return false;
}

MediaStretch Media::stretch(const dvec3& origin, const vec3& direction, float distance,
                            Sampler& sampler) const {
  MediaStretch out;
  thread_local std::vector<Met> met;
  thread_local std::vector<std::uint32_t> who;
  met.resize(media_.size());
  who.resize(media_.size());
  float opacities = 0.0f;
  std::size_t count = 0;
  for (std::size_t i = 0; i < media_.size(); ++i) {
    const One& one = media_[i];
    Met& m = met[count];
    if (!enter(one, origin, direction, distance, m)) continue;
    // Emission that follows density needs no walk of its own.
    const bool dense = one.density > 0.0f;
    const asvo::MediumStretch s =
        MediumTracer(*one.grid, dense ? one.density : 1.0f).through(m.ray, 0.0f, m.length);
    m.depth = dense ? s.depth : 0.0f;
    m.emission = one.emission * s.emission;
    if (!one.grid->emits()) {
      m.emission = one.emission * (dense ? -std::expm1(-s.depth) / one.density : s.depth);
    } else if (!dense) {
      m.emission = vec3(0.0f);
      MediumTracer(*one.grid, 0.0f)
          .walk(m.ray, 0.0f, m.length, [&](float a, float b, float, const vec3& e) {
            m.emission += one.emission * e * (b - a);
            return true;
          });
    }
    if (!(m.depth > 0.0f) && m.emission == vec3(0.0f)) continue;
    out.transmittance *= m.depth < MediumTracer::kOpaque ? std::exp(-m.depth) : 0.0f;
    opacities += -std::expm1(-m.depth);
    who[count++] = static_cast<std::uint32_t>(i);
  }
  if (count == 0) return out;
  const auto others = [&](std::size_t but, float end) {
    float all = 1.0f;
    for (std::size_t j = 0; j < count; ++j) {
      if (j != but) all *= passed(media_[who[j]], origin, direction, end);
    }
    return all;
  };
  for (std::size_t j = 0; j < count; ++j) {
    const vec3& e = met[j].emission;
    if (e == vec3(0.0f)) continue;
    if (count == 1) {
      out.emission += e;
      continue;
    }
    // One place in proportion to what arrives from it.
    const One& one = media_[who[j]];
    const float target = uniformOf(sampler.next1D()) * luminance(e);
    float sum = 0.0f, depth = 0.0f, place = met[j].length;
    vec3 color = e / std::max(luminance(e), 1e-30f);
    MediumTracer(*one.grid, one.density)
        .walk(met[j].ray, 0.0f, met[j].length, [&](float a, float b, float here, const vec3& ge) {
          const float amount = (b - a) * std::exp(-depth) * MediumTracer::meanPassed(here);
          vec3 shine = one.emission * ge * amount;
          if (!one.grid->emits()) {
            const float density =
                one.density > 0.0f
                    ? here / (one.density * (b - a))
                    : MediumTracer(*one.grid, 1.0f)
                          .densityAt(met[j].ray.origin + met[j].ray.direction * (0.5f * (a + b)));
            shine = one.emission * (density * amount);
          }
          const float light = luminance(shine);
          if (light > 0.0f) color = shine / light;
          place = a + (b - a) * std::clamp((target - sum) / std::max(light, 1e-30f), 0.0f, 1.0f);
          sum += light;
          depth += here;
          return sum < target;
        });
    out.emission += color * (luminance(e) * others(j, met[j].start + place));
  }
  if (!(opacities > 0.0f)) return out;
  float u = uniformOf(sampler.next1D()) * opacities;
  std::size_t chosen = 0;
  float opacity = 0.0f;
  for (std::size_t j = 0; j < count; ++j) {
    const float here = -std::expm1(-met[j].depth);
    if (!(here > 0.0f)) continue;
    chosen = j;
    opacity = here;
    if (u < here) break;
    u -= here;
  }
  // What is left of the number says where.
  const One& one = media_[who[chosen]];
  const float target = -std::log1p(-std::min(u, opacity * 0x1.fffffep-1f));
  const float inside =
      MediumTracer(*one.grid, one.density).place(met[chosen].ray, 0.0f, met[chosen].length, target);
  out.distance = std::min(met[chosen].start + inside, distance * 0.9999f);
  out.scatter = one.albedo * opacities;
  if (count > 1) out.scatter *= others(chosen, out.distance);
  out.anisotropy = one.anisotropy;
  return out;
}

bool Media::collide(const dvec3& origin, const vec3& direction, float distance, Sampler& sampler,
                    MediaCollision& out) const {
  bool hit = false;
  for (const One& one : media_) {
    Met met;
    if (!(one.density > 0.0f) || !enter(one, origin, direction, distance, met)) continue;
    const float target = -std::log1p(-uniformOf(sampler.next1D()));
    const float inside =
        MediumTracer(*one.grid, one.density).place(met.ray, 0.0f, met.length, target);
    if (inside >= met.length) continue;
    distance = met.start + inside;
    out = {distance, one.albedo, one.anisotropy};
    hit = true;
  }
  return hit;
}

/// Bricks that shine, with their power.
void Media::addSources() {
  double sum = 0.0;
  float most = 0.0f;  // channel over luminance
  for (std::uint32_t i = 0; i < media_.size(); ++i) {
    const One& one = media_[i];
    if (one.emission == vec3(0.0f)) continue;
    for (std::uint32_t place = 0; place < one.grid->index.size(); ++place) {
      const std::uint32_t number = one.grid->index[place];
      if (number == asvo::Medium::kNone) continue;
      double brick = 0.0;
      for (int cell = 0; cell < 512; ++cell) {
        const vec3 e = one.emission * cornersOf(*one.grid, one.grid->bricks[number], cell);
        const float light = luminance(e);
        if (!(light > 0.0f)) continue;
        most = std::max(most, maxComponent(e) / light);
        brick += static_cast<double>(light) / 8.0 * one.volume;
      }
      if (!(brick > 0.0)) continue;
      if (powers_.empty()) powers_.push_back(0.0);
      sum += 4.0 * std::numbers::pi * brick;
      sources_.push_back({i, place});
      powers_.push_back(sum);
    }
  }
  largestChannel_ = most * static_cast<float>(sum);
}

void Media::emit(Sampler& sampler, dvec3& origin, vec3& direction, vec3& power) const {
  const vec2 choice = sampler.next2D(), inside = sampler.next2D(), way = sampler.next2D();
  const double target = static_cast<double>(choice.x) * powers_.back();
  const auto at = std::upper_bound(powers_.begin() + 1, powers_.end() - 1, target);
  const Source& source = sources_[static_cast<std::size_t>(at - powers_.begin()) - 1];
  const One& one = media_[source.medium];
  const asvo::Medium::Brick& brick = one.grid->bricks[one.grid->index[source.place]];
  const auto light = [&](int cell) {
    return luminance(one.emission * cornersOf(*one.grid, brick, cell));
  };
  float all = 0.0f;
  for (int cell = 0; cell < 512; ++cell) all += light(cell);
  float left = uniformOf(choice.y) * all;
  int chosen = 0;
  for (int cell = 0; cell < 512; ++cell) {
    const float here = light(cell);
    if (!(here > 0.0f)) continue;
    chosen = cell;
    if (left < here) break;
    left -= here;
  }
  // Even within a cell, in its mean colour.
  const vec3 color = one.emission * cornersOf(*one.grid, brick, chosen);
  const auto width = static_cast<std::uint32_t>(one.grid->size.x),
             height = static_cast<std::uint32_t>(one.grid->size.y);
  const glm::ivec3 place(source.place % width, source.place / width % height,
                         source.place / width / height);
  const vec3 cell = vec3(place * 8 + glm::ivec3(chosen >> 6, chosen >> 3 & 7, chosen & 7)) +
                    vec3(inside, sampler.next1D());
  origin = dvec3(one.toRender * glm::dvec4(dvec3(cell), 1.0));
  const float z = 1.0f - 2.0f * way.x, r = std::sqrt(std::max(0.0f, 1.0f - z * z));
  direction = vec3(r * std::cos(2.0f * kPi * way.y), r * std::sin(2.0f * kPi * way.y), z);
  power = color / std::max(luminance(color), 1e-30f) * static_cast<float>(powers_.back());
}

}  // namespace trex
