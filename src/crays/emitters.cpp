#include "src/crays/emitters.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <tuple>

#include "src/crays/emitter_texels.h"
#include "src/crays/reading_pages.h"
#include "src/scene/emission.h"
#include "src/scene/texture.h"

namespace trex {
namespace {

constexpr std::uint64_t kMostSamples = 1u << 23;  // of textures, all triangles together
constexpr std::uint64_t kMostTexels = 1u << 25;   // that are looked at one by one, likewise
constexpr std::uint64_t kMostCells = 1u << 22;    // 16 MiB
constexpr std::uint32_t kMostEdgeCells = 256, kMostEdgeSamples = 1024, kLeastEdgeSamples = 4;
/// What a triangle counts with, at most, that had no light at any sample but has texels between
/// them: otherwise as much as if one sample had been lit.
constexpr float kUnseenShare = 1e-3f;
/// Shares of a cell's weight that do not follow its mean: its brightest sample, so that a spark has
/// a chance that suits it; and the triangle's mean, for what samples have missed.
constexpr float kPeakShare = 0.05f, kEvenShare = 0.01f;

std::uint64_t pairOf(std::uint32_t high, std::uint32_t low) {
  return std::uint64_t{high} << 32 | low;
}

/// Whether all of a triangle of this material sends out the same.
bool isPlain(const Material& m) {
  return !m.emissiveTexture.present() && m.alphaMode == AlphaMode::kOpaque;
}

vec3 sentOut(const Scene& scene, const Material& m, const TexCoords& uv, float alpha) {
  return emissionAt(m, scene.images, uv) * coverageAt(m, scene.images, uv, alpha);
}

/// The number of the cell at these weights, of `edge` along an edge: row by row of the second
/// corner's weight, in each the lower and upper ones in turn.
std::uint32_t cellAt(std::uint32_t edge, float u, float v) {
  const float x = std::max(u, 0.0f) * static_cast<float>(edge);
  const float y = std::max(v, 0.0f) * static_cast<float>(edge);
  const std::uint32_t i = std::min(static_cast<std::uint32_t>(x), edge - 1);
  const std::uint32_t j = std::min(static_cast<std::uint32_t>(y), edge - 1 - i);
  const bool upper = x - static_cast<float>(i) + (y - static_cast<float>(j)) > 1.0f;
  return i * (2 * edge - i) + 2 * j + (upper && i + j + 1 < edge ? 1 : 0);
}

/// Weights of a point of a cell, from those within it.
glm::dvec2 inCell(std::uint32_t edge, std::uint32_t cell, const glm::dvec2& local) {
  const double left = std::ceil(std::sqrt(static_cast<double>(edge) * edge - cell));
  const std::uint32_t i = edge - static_cast<std::uint32_t>(left);
  const std::uint32_t place = cell - i * (2 * edge - i);
  const glm::dvec2 corner(i, place / 2);
  return ((place & 1u) == 0 ? corner + local : corner + 1.0 - local) / static_cast<double>(edge);
}

}  // namespace

/// Shining triangles of one cluster.
struct Emitters::Run {
  std::uint32_t instance, cluster, material;
  std::vector<std::uint32_t> triangles;
};

/// Samples and cells that a triangle may have along an edge, and texels to look at in all.
struct Emitters::Budget {
  std::uint32_t edgeSamples, edgeCells;
  std::uint64_t texels;
};

struct Emitters::Measured {
  Triangle triangle;
  std::uint32_t object;
  std::vector<float> cells;
  float ratio = 1.0f;
};

/// Triangles that shine evenly, by where they lie.
class Emitters::Places {
 public:
  Places(const std::vector<Material>& materials, const std::vector<Triangle>& triangles)
      : materials_(materials), triangles_(triangles) {}

  /// The number of the one that `t` lies on and shines like, else kNotFound: it will be `number`.
  std::uint32_t findOrAdd(const Triangle& t, std::uint32_t number) {
    const Material& m = materials_[t.material];
    const std::array<dvec3, 3> corners = cornersOf(t);
    std::uint64_t key = 0;
    for (const dvec3& p : corners) {
      for (int axis = 0; axis < 3; ++axis) {
        key = (key ^ std::bit_cast<std::uint64_t>(p[axis] + 0.0)) * 0x9e3779b97f4a7c15u;
        key ^= key >> 29;
      }
    }
    const auto [first, last] = known_.equal_range(key);
    for (auto at = first; at != last; ++at) {
      const Triangle& other = triangles_[at->second];
      const Material& o = materials_[other.material];
      if (o.emission == m.emission && o.doubleSided == m.doubleSided &&
          cornersOf(other) == corners &&
          (m.doubleSided || glm::dot(other.normal, t.normal) > 0.0f)) {
        return at->second;
      }
    }
    known_.emplace(key, number);
    return kNotFound;
  }

 private:
  /// In an order that does not depend on the triangle's.
  static std::array<dvec3, 3> cornersOf(const Triangle& t) {
    std::array<dvec3, 3> out{t.corner, t.corner + dvec3(t.edge1), t.corner + dvec3(t.edge2)};
    std::sort(out.begin(), out.end(), [](const dvec3& a, const dvec3& b) {
      return std::tie(a.x, a.y, a.z) < std::tie(b.x, b.y, b.z);
    });
    return out;
  }

  const std::vector<Material>& materials_;
  const std::vector<Triangle>& triangles_;
  std::unordered_multimap<std::uint64_t, std::uint32_t> known_;
};

Emitters::Emitters(const Scene& scene, const RayScene& rays) : scene_(scene), rays_(rays) {
  if (std::none_of(scene.materials.begin(), scene.materials.end(),
                   [](const Material& m) { return m.emits() && !m.unlit; })) {
    return;
  }
  const std::vector<Run> all = runs();
  std::uint64_t pictures = 1;
  for (const Run& run : all) {
    if (!isPlain(scene.materials[run.material])) pictures += run.triangles.size();
  }
  const auto edge = [&](std::uint64_t most) {
    return static_cast<std::uint32_t>(std::sqrt(static_cast<double>(most / pictures)));
  };
  Budget budget{std::clamp(edge(kMostSamples), kLeastEdgeSamples, kMostEdgeSamples), 1,
                kMostTexels / pictures};
  while (2 * budget.edgeCells <= std::min(edge(kMostCells), kMostEdgeCells)) budget.edgeCells *= 2;
  std::vector<std::vector<Measured>> measured(all.size());
  tbb::parallel_for(std::size_t{0}, all.size(),
                    [&](std::size_t i) { measured[i] = measureRun(all[i], budget); });
  Places places(scene.materials, triangles_);
  for (std::size_t i = 0; i < all.size(); ++i) {
    add(all[i], measured[i], places);
    std::vector<Measured>().swap(measured[i]);
  }
}

bool Emitters::shines(std::uint32_t material) const {
  const Material& m = scene_.materials[material];
  return !m.unlit && luminance(m.emission) > 0.0f;
}

std::vector<Emitters::Run> Emitters::runs() const {
  std::vector<Run> out;
  const auto addMesh = [&](std::uint32_t instance, const hccm::Mesh& mesh) {
    for (std::uint32_t c = 0; c < mesh.clusterCount(); ++c) {
      if (!shines(mesh.clusterMaterial(c))) continue;
      Run& run = out.emplace_back(Run{instance, c, mesh.clusterMaterial(c), {}});
      mesh.forTriangles(c, [&](std::uint32_t t) { run.triangles.push_back(t); });
    }
  };
  const RayScene::Parts& parts = rays_.parts();
  if (parts.paged) {
    addPages(out);
  } else {
    addMesh(RayScene::kWorldMesh, parts.world);
  }
  for (std::uint32_t i = 0; i < parts.placed.size(); ++i) {
    addMesh(i, parts.shared[parts.placed[i].mesh]);
  }
  return out;
}

/// Clusters of a mesh in pages: of those groups that overlap a mesh of the scene that shines.
void Emitters::addPages(std::vector<Run>& out) const {
  std::vector<Box3f> boxes;
  for (const Instance& instance : scene_.instances) {
    const Mesh& mesh = scene_.meshes[static_cast<std::size_t>(instance.mesh)];
    if (!shines(static_cast<std::uint32_t>(mesh.material))) continue;
    Box3f& box = boxes.emplace_back();
    for (const vec3& p : mesh.positions) {
      const dvec3 local = mesh.origin + dvec3(p);
      box.extend(vec3(dvec3(instance.transform * glm::dvec4(local, 1.0)) - rays_.renderOrigin()));
    }
  }
  const hccm::PagedMesh& paged = *rays_.parts().paged;
  for (const hccm::PageGroup& g : paged.table().groups) {
    const vec3 lower(g.lower[0], g.lower[1], g.lower[2]), upper(g.upper[0], g.upper[1], g.upper[2]);
    const bool near = std::any_of(boxes.begin(), boxes.end(), [&](const Box3f& box) {
      return glm::all(glm::lessThanEqual(box.lower, upper)) &&
             glm::all(glm::lessThanEqual(lower, box.upper));
    });
    if (!near) continue;
    const auto pin = readingPages([&] { return paged.page(g.page); });
    for (std::uint32_t c = g.first; c < std::uint32_t{g.first} + g.count; ++c) {
      const std::uint32_t material = pin.mesh().clusterMaterial(c);
      if (!shines(material)) continue;
      Run& run = out.emplace_back(
          Run{RayScene::kWorldMesh, g.page * hccm::kPageClusters + c, material, {}});
      pin.mesh().forTriangles(c, [&](std::uint32_t t) { run.triangles.push_back(t); });
    }
  }
}

std::vector<Emitters::Measured> Emitters::measureRun(const Run& run, const Budget& budget) const {
  std::vector<Measured> out;
  out.reserve(run.triangles.size());
  for (const std::uint32_t t : run.triangles) {
    Measured one{};
    if (measure({0.0, 0.0, 0.0f, run.instance, run.cluster, t}, budget, one)) {
      out.push_back(std::move(one));
    }
  }
  return out;
}

/// What a triangle sends out. False if that is nothing.
bool Emitters::measure(const RayHit& corner, const Budget& budget, Measured& out) const {
  RayHit hit = corner;
  Surface surface[3];
  for (int i = 0; i < 3; ++i) {
    hit.u = i == 1 ? 1.0 : 0.0;
    hit.v = i == 2 ? 1.0 : 0.0;
    surface[i] = rays_.surface(hit);
  }
  if (!rays_.visibility().shows(surface[0].object)) return false;
  Triangle& t = out.triangle;
  t.corner = dvec3(surface[0].position);
  const dvec3 edge1 = dvec3(surface[1].position) - t.corner;
  const dvec3 edge2 = dvec3(surface[2].position) - t.corner;
  t.edge1 = vec3(edge1);
  t.edge2 = vec3(edge2);
  t.normal = surface[0].geometricNormal;
  t.area = static_cast<float>(0.5 * glm::length(glm::cross(edge1, edge2)));
  t.material = surface[0].material;
  t.instance = hit.instance;
  t.cluster = hit.cluster;
  t.triangle = hit.triangle;
  out.object = surface[0].object;
  if (!(t.area > 0.0f) || !std::isfinite(t.area)) return false;
  const Material& material = scene_.materials[t.material];
  if (isPlain(material)) {
    t.radiance = luminance(material.emission);
    out.ratio = maxComponent(material.emission) / t.radiance;
  } else {
    measurePicture(surface, budget, out);
  }
  return t.radiance > 0.0f;
}

/// Samples what is sent out at the centres of small congruent triangles, as many in each cell; or,
/// where there are too few of these to see every texel, at the centres of texels.
void Emitters::measurePicture(const Surface (&corner)[3], const Budget& budget,
                              Measured& out) const {
  const Material& m = scene_.materials[corner[0].material];
  Footprint finest = footprintOf(scene_, m.emissiveTexture, corner);
  if (m.alphaMode != AlphaMode::kOpaque) {
    const Footprint other = footprintOf(scene_, m.baseColorTexture, corner);
    if (other.along > finest.along) finest = other;
  }
  const std::uint32_t wanted = std::max(
      static_cast<std::uint32_t>(std::min(2.0f * finest.along, 1e6f)) + 1, kLeastEdgeSamples);
  const std::uint32_t samples = std::min(wanted, budget.edgeSamples);
  std::uint32_t edge = 1;
  while (2 * edge <= std::min(samples, budget.edgeCells)) edge *= 2;
  const std::uint32_t inner = (samples + edge - 1) / edge;
  const std::uint32_t count = edge * edge;
  std::vector<float> weights(count), largest(count), peaks(count);
  std::vector<std::uint32_t> taken(count);
  const auto sentAt = [&](const glm::dvec2& at) {
    const auto u = static_cast<float>(at.x), v = static_cast<float>(at.y), w = 1.0f - u - v;
    TexCoords uv;
    for (std::size_t set = 0; set < uv.size(); ++set) {
      uv[set] = w * corner[0].texCoords[set] + u * corner[1].texCoords[set] +
                v * corner[2].texCoords[set];
    }
    return sentOut(scene_, m, uv,
                   w * corner[0].color.w + u * corner[1].color.w + v * corner[2].color.w);
  };
  const auto add = [&](std::uint32_t cell, const vec3& sent, float share, float most) {
    weights[cell] += share * luminance(sent);
    peaks[cell] = std::max(peaks[cell], most * luminance(sent));
    largest[cell] = std::max(largest[cell], most * maxComponent(sent));
  };
  const bool byTexels =
      samples < wanted && texelArea(finest) > 2.0 * count && hasFewTexels(finest, budget.texels);
  if (byTexels) {
    const TexelSteps step(finest);
    forTexels(finest, [&](const glm::dvec2& at) {
      const auto cellOf = [&](const glm::dvec2& place) {
        return cellAt(edge, static_cast<float>(place.x), static_cast<float>(place.y));
      };
      const vec3 sent = sentAt(at);
      ++taken[cellOf(at)];
      if (sent == vec3(0.0f)) return;
      // Look-ups mix it into the texels around it, which may lie in other cells.
      for (int y = -1; y <= 1; ++y) {
        for (int x = -1; x <= 1; ++x) {
          const float share = (x == 0 ? 0.75f : 0.125f) * (y == 0 ? 0.75f : 0.125f);
          const float most = (x == 0 ? 1.0f : 0.5f) * (y == 0 ? 1.0f : 0.5f);
          add(cellOf(at + 0.75 * (static_cast<double>(x) * step.column +
                                  static_cast<double>(y) * step.row)),
              sent, share, most);
        }
      }
    });
  } else {
    for (std::uint32_t cell = 0; cell < count; ++cell) {
      for (std::uint32_t k = 0; k < inner * inner; ++k) {
        add(cell, sentAt(inCell(edge, cell, inCell(inner, k, glm::dvec2(1.0 / 3.0)))), 1.0f, 1.0f);
        ++taken[cell];
      }
    }
  }
  double sum = 0.0;
  for (std::uint32_t cell = 0; cell < count; ++cell) {
    const auto all = static_cast<float>(std::max(taken[cell], 1u));
    weights[cell] = glm::mix(weights[cell] / all, peaks[cell], kPeakShare);
    sum += static_cast<double>(weights[cell]);
  }
  const auto mean = static_cast<float>(sum / count);
  out.triangle.radiance = mean;
  if (!(mean > 0.0f)) {
    if (samples < wanted) {
      const float unseen = byTexels ? 0.0f : 1.0f / static_cast<float>(samples * samples);
      out.triangle.radiance = std::min(kUnseenShare, unseen) * luminance(m.emission);
    }
    return;
  }
  const auto [least, most] = std::minmax_element(weights.begin(), weights.end());
  const bool even = *most < 1.1f * *least;
  for (std::uint32_t cell = 0; cell < count; ++cell) {
    weights[cell] = even ? mean : glm::mix(weights[cell], mean, kEvenShare);
    // Twice: what lies between the samples.
    out.ratio = std::max(out.ratio, 2.0f * largest[cell] / weights[cell]);
  }
  if (even) return;
  out.triangle.edgeCells = edge;
  out.cells.resize(count);
  double before = 0.0;
  for (std::uint32_t cell = 0; cell < count; ++cell) {
    before += static_cast<double>(weights[cell]);
    out.cells[cell] = static_cast<float>(before / sum);
  }
  out.cells.back() = 1.0f;
}

/// Takes the triangles of a cluster, in their order.
void Emitters::add(const Run& run, std::vector<Measured>& measured, Places& places) {
  if (measured.empty()) return;
  const std::size_t base = slots_.size();
  const std::uint32_t count = measured.back().triangle.triangle + 1;
  clusters_[pairOf(run.instance, run.cluster)] = {base, count};
  slots_.resize(base + count, kNotFound);
  const Material& m = scene_.materials[run.material];
  const bool plain = isPlain(m);
  for (Measured& one : measured) {
    Triangle& t = one.triangle;
    const auto number = static_cast<std::uint32_t>(triangles_.size());
    std::uint32_t& slot = slots_[base + t.triangle];
    if (plain) slot = places.findOrAdd(t, number);
    if (slot != kNotFound) continue;
    slot = number;
    const auto lamp = lampOf_.try_emplace(pairOf(one.object, t.material),
                                          static_cast<std::uint32_t>(lamps_.size()));
    if (lamp.second) {
      lamps_.push_back({.emission = m.emission, .plain = plain, .shinesBack = m.doubleSided});
    }
    t.lamp = lamp.first->second;
    lamps_[t.lamp].area += t.area;
    if (!one.cells.empty()) {
      t.cells = static_cast<std::uint32_t>(cells_.size());
      cells_.insert(cells_.end(), one.cells.begin(), one.cells.end());
    }
    largestRatio_ = std::max(largestRatio_, one.ratio);
    triangles_.push_back(t);
  }
}

std::uint32_t Emitters::find(const RayHit& hit) const {
  const auto found = clusters_.find(pairOf(hit.instance, hit.cluster));
  // Of triangles behind the cluster's last that shines there is no slot.
  if (found == clusters_.end() || hit.triangle >= found->second.count) return kNotFound;
  return slots_[found->second.first + hit.triangle];
}

Emitters::Place Emitters::sample(const Triangle& t, double u, float v) const {
  Place out;
  std::uint32_t cell = 0;
  out.density = 1.0f / t.area;
  if (t.cells != kNotFound) {
    const float* const first = &cells_[t.cells];
    const std::uint32_t count = t.edgeCells * t.edgeCells;
    const float* const at = std::upper_bound(first, first + count - 1, u);
    cell = static_cast<std::uint32_t>(at - first);
    const float before = cell == 0 ? 0.0f : at[-1];
    u = std::clamp((u - static_cast<double>(before)) / static_cast<double>(*at - before), 0.0,
                   0x1.fffffffffffffp-1);
    out.density *= (*at - before) * static_cast<float>(count);
  }
  const double root = std::sqrt(u);
  glm::dvec2 weights = root * glm::dvec2(1.0 - static_cast<double>(v), v);
  if (t.edgeCells > 1) weights = inCell(t.edgeCells, cell, weights);
  out.position = t.corner + weights.x * dvec3(t.edge1) + weights.y * dvec3(t.edge2);
  const Lamp& lamp = lamps_[t.lamp];
  if (lamp.plain) {
    out.radiance = lamp.emission;
  } else {
    const Surface surface =
        rays_.surface({weights.x, weights.y, 0.0f, t.instance, t.cluster, t.triangle});
    out.radiance =
        sentOut(scene_, scene_.materials[t.material], surface.texCoords, surface.color.w);
  }
  return out;
}

float Emitters::density(const Triangle& t, float u, float v) const {
  if (t.cells == kNotFound) return 1.0f / t.area;
  const std::uint32_t cell = cellAt(t.edgeCells, u, v);
  const float* const at = &cells_[t.cells + cell];
  const float share = *at - (cell == 0 ? 0.0f : at[-1]);
  return share * static_cast<float>(t.edgeCells * t.edgeCells) / t.area;
}

std::uint64_t Emitters::bytes() const {
  return triangles_.size() * sizeof(Triangle) + cells_.size() * sizeof(float) +
         lamps_.size() * sizeof(Lamp) + slots_.size() * sizeof(std::uint32_t) +
         clusters_.size() * 32;
}

}  // namespace trex
