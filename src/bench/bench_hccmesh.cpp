#include "src/bench/bench_hccmesh.h"

#include <fmt/format.h>
#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <functional>
#include <memory>
#include <numeric>
#include <span>
#include <vector>

#include "hccmesh/pack.h"
#include "src/bench/embree_triangles.h"
#include "src/bench/median.h"
#include "src/core/sampler.h"
#include "src/crays/ray_scene.h"
#include "src/scene/import.h"

namespace trex {
namespace {

using Json = nlohmann::ordered_json;
using Clock = std::chrono::steady_clock;

double secondsSince(Clock::time_point start) {
  return std::chrono::duration<double>(Clock::now() - start).count();
}

struct Rays {
  std::vector<RayQuery> queries;
  /// For Embree's triangles, which know none that a ray leaves: off it by a hair.
  std::vector<vec3> origins;

  std::size_t size() const { return queries.size(); }
  void add(const RayQuery& query, const vec3& origin) {
    queries.push_back(query);
    origins.push_back(origin);
  }
};

/// Whether rays [first, end) hit.
using Trace = std::function<void(const Rays&, std::size_t first, std::size_t end, std::uint8_t*)>;

/// `answer` is asked for up to 16 rays together.
template <typename Answer>
Trace traceWith(const Answer& answer) {
  static constexpr std::size_t kSpan = 16;
  return [answer](const Rays& rays, std::size_t first, std::size_t end, std::uint8_t* out) {
    for (std::size_t i = first; i < end; i += kSpan) {
      const std::size_t count = std::min(kSpan, end - i);
      answer(std::span(rays.queries).subspan(i, count), &rays.origins[i],
             std::span(out + (i - first), count));
    }
  };
}

/// A contender with what it measured.
struct Contender {
  const char* name;
  Trace trace;
  std::vector<double> rates;
  std::vector<std::uint8_t> hits;
};

void run(const Rays& rays, Contender& c) {
  c.hits.resize(rays.size());
  const auto start = Clock::now();
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, rays.size(), 4096), [&](const auto& range) {
    c.trace(rays, range.begin(), range.end(), c.hits.data() + range.begin());
  });
  c.rates.push_back(static_cast<double>(rays.size()) / secondsSince(start));
}

/// Rays a second of all, taking turns; in how many rays the others differ from the first.
void compare(const Rays& rays, int runs, std::vector<Contender> contenders, const char* kind,
             Json& out) {
  if (rays.size() == 0) return;
  for (Contender& c : contenders) run(rays, c), c.rates.clear();  // warm up
  for (int i = 0; i < runs; ++i)
    for (Contender& c : contenders) run(rays, c);
  for (const Contender& c : contenders) {
    out["rays_per_second"][kind][c.name] = median(c.rates);
    std::uint64_t different = 0;
    for (std::size_t i = 0; i < rays.size(); ++i) different += c.hits[i] != contenders[0].hits[i];
    if (&c != &contenders[0]) out["different_hits"][kind][c.name] = different;
  }
  out["rays"][kind] = rays.size();
  out["hits"][kind] =
      std::accumulate(contenders[0].hits.begin(), contenders[0].hits.end(), std::uint64_t{0});
}

/// By rows of tiles of 32 x 32 pixels.
Rays coherentRays(const Camera& camera, const dvec3& renderOrigin, std::uint64_t count) {
  const int tiles = std::max(1, static_cast<int>(std::sqrt(static_cast<double>(count)) / 32.0));
  const auto size = static_cast<float>(32 * tiles);
  const vec3 right = glm::cross(camera.forward, camera.up);
  const float scale = std::tan(0.5f * camera.verticalFov);
  Rays rays;
  for (int tile = 0; tile < tiles * tiles; ++tile)
    for (int pixel = 0; pixel < 1024; ++pixel) {
      const auto x = static_cast<float>(tile % tiles * 32 + pixel % 32),
                 y = static_cast<float>(tile / tiles * 32 + pixel / 32);
      const vec3 d = camera.forward + scale * (2.0f * (x + 0.5f) / size - 1.0f) * right -
                     scale * (2.0f * (y + 0.5f) / size - 1.0f) * camera.up;
      const dvec3 eye = camera.eye - renderOrigin;
      rays.add({eye, glm::normalize(d)}, vec3(eye));
    }
  return rays;
}

/// From what coherent rays hit: one ray by the cosine, and one to a light beside the camera.
void secondaryRays(const RayScene& scene, const Rays& coherent, Rays& diffuse, Rays& shadow) {
  const Box3f box = scene.bounds();
  const vec3 light = coherent.origins[0] + 0.25f * glm::length(box.size()) * vec3(0.5f, 0.7f, 0.5f);
  for (std::uint32_t i = 0; i < coherent.size(); ++i) {
    RayHit hit;
    const RayQuery& ray = coherent.queries[i];
    if (!scene.intersect(ray.start, ray.direction, 0.0f, kInfinity, hit)) continue;
    const Surface s = scene.surface(hit);
    const vec3 n =
        glm::dot(s.geometricNormal, ray.direction) < 0.0f ? s.geometricNormal : -s.geometricNormal;
    const float phi = 2.0f * kPi * toUnitFloat(hash32(2 * i)), u = toUnitFloat(hash32(2 * i + 1));
    const vec3 local(std::cos(phi) * std::sqrt(u), std::sin(phi) * std::sqrt(u),
                     std::sqrt(1.0f - u));
    const vec3 origin = vec3(s.position) + n * (1e-6f * glm::length(box.size()));
    diffuse.add({s.leave(), Basis(n).toWorld(local)}, origin);
    const vec3 toLight = light - origin;
    shadow.add({s.leave(), glm::normalize(toLight), 0.0f, glm::length(toLight)}, origin);
  }
}

hccm::Sizes sizesOf(const RayScene::Parts& parts) {
  hccm::Sizes sum = parts.world.sizes();
  for (const hccm::Mesh& mesh : parts.shared) sum += mesh.sizes();
  return sum;
}

std::uint64_t diskBytes(const RayScene::Parts& parts) {
  std::uint64_t sum = hccm::packedBytes(parts.world);
  for (const hccm::Mesh& mesh : parts.shared) sum += hccm::packedBytes(mesh);
  return sum;
}

void describeBytes(const RayScene& scene, Json& out) {
  const RayScene::Statistics statistics = scene.statistics();
  const hccm::Sizes z = sizesOf(scene.parts());
  const auto share = [&](std::uint64_t bytes) {
    return static_cast<double>(bytes) / static_cast<double>(statistics.uniqueTriangles);
  };
  out["triangles"] = statistics.uniqueTriangles;
  out["placed_triangles"] = statistics.triangles;
  out["bytes_per_triangle"] = share(statistics.meshBytes + statistics.topLevelBytes);
  out["bytes_per_triangle_by_part"] = {{"vertices", share(z.vertices)},
                                       {"topology", share(z.topology)},
                                       {"nodes", share(z.nodes)},
                                       {"top_level", share(statistics.topLevelBytes)},
                                       {"cluster_headers", share(z.clusterHeaders)},
                                       {"cluster_table", share(z.clusterTable)},
                                       {"padding", share(z.padding)},
                                       {"header", share(z.header)},
                                       {"normals", share(z.normals)},
                                       {"tex_coords", share(z.texCoords)},
                                       {"colors", share(z.colors)}};
  out["disk_bytes_per_triangle"] = share(diskBytes(scene.parts()));
  out["triangles_per_cluster"] =
      static_cast<double>(statistics.uniqueTriangles) / static_cast<double>(statistics.clusters);
  out["error_bound_metres"] = scene.parts().world.errorBound();
}

}  // namespace

Json benchHccmesh(const HccmeshBenchArguments& a) {
  const Scene scene = importScene(a.input);
  const Camera camera = a.camera.empty() ? scene.cameras.at(0) : parseCamera(a.camera, scene);
  RayScene::Options options;
  options.precisionBits = a.precisionBits;
  const auto start = Clock::now();
  const RayScene ours(scene, options);
  const double buildSeconds = secondsSince(start);
  Json out = {{"bench", "hccmesh"}, {"input", a.input}};
  describeBytes(ours, out);
  out["build_seconds"] = buildSeconds;

  std::unique_ptr<EmbreeTriangles> embree, compact;
  if (a.embree) {
    embree = std::make_unique<EmbreeTriangles>(scene, ours.renderOrigin(), false);
    compact = std::make_unique<EmbreeTriangles>(scene, ours.renderOrigin(), true);
    const auto share = [](const EmbreeTriangles& e) {
      return static_cast<double>(e.bytes()) / static_cast<double>(e.triangles());
    };
    out["embree_bytes_per_triangle"] = share(*embree);
    out["embree_compact_bytes_per_triangle"] = share(*compact);
    out["embree_build_seconds"] = embree->buildSeconds();
  }

  const auto contenders = [&](bool shadow) {
    using Queries = std::span<const RayQuery>;
    using Answers = std::span<std::uint8_t>;
    std::vector<Contender> list(1);
    list[0].name = "hccmesh";
    list[0].trace = shadow ? traceWith([&](Queries rays, const vec3*, Answers answers) {
      ours.occluded(rays, answers);
    })
                           : traceWith([&](Queries rays, const vec3*, Answers answers) {
                               std::array<RayHit, 16> hits;
                               ours.intersect(rays, std::span(hits).first(rays.size()), answers);
                             });
    for (const EmbreeTriangles* e : {embree.get(), compact.get()}) {
      if (!e) continue;
      const auto answer = [e, shadow](Queries rays, const vec3* origins, Answers answers) {
        for (std::size_t i = 0; i < rays.size(); ++i) {
          const vec3& d = rays[i].direction;
          const float far = rays[i].end.distance;
          answers[i] = shadow ? e->occluded(origins[i], d, far)
                              : e->intersect(origins[i], d, far) < kInfinity;
        }
      };
      list.push_back({e == embree.get() ? "embree" : "embree_compact", traceWith(answer), {}, {}});
    }
    return list;
  };
  const Rays coherent = coherentRays(camera, ours.renderOrigin(), a.rays);
  Rays diffuse, shadow;
  secondaryRays(ours, coherent, diffuse, shadow);
  compare(coherent, a.runs, contenders(false), "coherent", out);
  compare(diffuse, a.runs, contenders(false), "diffuse", out);
  compare(shadow, a.runs, contenders(true), "shadow", out);
  out["runs"] = a.runs;
  out["instruction_set"] = ours.parts().world.targetName();
  return out;
}

void printHccmeshBench(const Json& d) {
  fmt::print("{}: {} triangles, {:.2f} bytes each, {:.2f} on disk\n", d["input"].get<std::string>(),
             d["triangles"].dump(), d["bytes_per_triangle"].get<double>(),
             d["disk_bytes_per_triangle"].get<double>());
  for (const auto& [part, bytes] : d["bytes_per_triangle_by_part"].items()) {
    fmt::print("  {:<16} {:8.3f}\n", part, bytes.get<double>());
  }
  if (d.contains("embree_bytes_per_triangle")) {
    fmt::print("Embree: {:.1f} bytes a triangle with its copy of the mesh, compact {:.1f}\n",
               d["embree_bytes_per_triangle"].get<double>(),
               d["embree_compact_bytes_per_triangle"].get<double>());
  }
  if (!d.contains("rays_per_second")) return;
  fmt::print("{:<16} {:>10} {:>10} {:>16} {:>8} {:>8}\n", "million rays/s", "HCCMesh", "Embree",
             "Embree compact", "ratio", "compact");
  for (const auto& [kind, rates] : d["rays_per_second"].items()) {
    const double ours = rates["hccmesh"].get<double>(), theirs = rates.value("embree", 0.0),
                 compact = rates.value("embree_compact", 0.0);
    const auto ratio = [&](double rate) {
      return rate > 0.0 ? fmt::format("{:.2f}", ours / rate) : std::string("-");
    };
    fmt::print("{:<16} {:10.3f} {:10.3f} {:16.3f} {:>8} {:>8}\n", kind, ours * 1e-6, theirs * 1e-6,
               compact * 1e-6, ratio(theirs), ratio(compact));
  }
}

}  // namespace trex
