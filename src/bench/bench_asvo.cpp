// trex bench asvo INPUT: build, size and speed of the voxels of a model, and what their guess of
// known rooms is worth.
#include <embree3/rtcore.h>
#include <fmt/format.h>
#include <tbb/blocked_range.h>
#include <tbb/global_control.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <functional>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>

#include "src/bench/bench.h"
#include "src/bench/bench_rooms.h"
#include "src/bench/median.h"
#include "src/command/parse.h"
#include "src/command/render_arguments.h"
#include "src/core/error.h"
#include "src/core/file.h"
#include "src/core/sampler.h"
#include "src/core/threads.h"
#include "src/grays/grays.h"
#include "src/scene/import.h"
#include "src/session/voxel_source.h"

namespace trex {
namespace {

using Json = nlohmann::ordered_json;
using shaderio::GatherQuery;

constexpr double kApertures[] = {0.1, 0.3, 0.6};  // radians, the whole cone
constexpr double kWalls[] = {0.5, 1.0, 2.0, 4.0};
constexpr float kAlbedos[] = {0.5f, 0.9f};

struct AsvoArguments {
  RenderArguments render;
  std::string json;
  int depth = 8, repeats = 5, threads = 0;
  std::uint64_t cones = 1'000'000;
  bool rooms = true;
};

vec3 uniformSphere(vec2 u) {
  const float z = 1.0f - 2.0f * u.x, r = std::sqrt(std::max(0.0f, 1.0f - z * z));
  return {r * std::cos(2.0f * kPi * u.y), r * std::sin(2.0f * kPi * u.y), z};
}

/// Embree's own triangles of everything that is voxelised: what cones are measured against.
class Triangles {
 public:
  explicit Triangles(const asvo::TriangleSource& source)
      : device_(rtcNewDevice(nullptr)), scene_(rtcNewScene(device_)) {
    const RTCGeometry geometry = rtcNewGeometry(device_, RTC_GEOMETRY_TYPE_TRIANGLE);
    auto* vertices = static_cast<float*>(
        rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3,
                                3 * sizeof(float), 3 * source.count()));
    auto* indices = static_cast<std::uint32_t*>(
        rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3,
                                3 * sizeof(std::uint32_t), source.count()));
    if (vertices == nullptr || indices == nullptr) {
      fail(ExitCode::kMemoryOrDevice, "Embree has no memory for {} triangles", source.count());
    }
    asvo::Triangle triangle;
    for (std::uint64_t i = 0; i < source.count(); ++i) {
      source.get(i, triangle);
      for (std::uint64_t k = 0; k < 3; ++k) {
        indices[3 * i + k] = static_cast<std::uint32_t>(3 * i + k);
        for (int axis = 0; axis < 3; ++axis) *vertices++ = triangle.position[k][axis];
      }
    }
    rtcCommitGeometry(geometry);
    rtcAttachGeometry(scene_, geometry);
    rtcReleaseGeometry(geometry);
    rtcSetSceneFlags(scene_, RTC_SCENE_FLAG_ROBUST);
    rtcCommitScene(scene_);
  }
  ~Triangles() {
    rtcReleaseScene(scene_);
    rtcReleaseDevice(device_);
  }
  Triangles(const Triangles&) = delete;
  Triangles& operator=(const Triangles&) = delete;

  /// Nearest hit along a ray: distance (infinite if none), and the unit normal that faces it.
  float hit(const vec3& origin, const vec3& direction, vec3& normal) const {
    RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    RTCRayHit ray{};
    ray.ray = {origin.x,    origin.y, origin.z,  0.0f,        direction.x, direction.y,
               direction.z, 0.0f,     kInfinity, 0xffffffffu, 0,           0};
    ray.hit.geomID = RTC_INVALID_GEOMETRY_ID;
    rtcIntersect1(scene_, &context, &ray);
    if (ray.hit.geomID == RTC_INVALID_GEOMETRY_ID) return kInfinity;
    normal = glm::normalize(vec3(ray.hit.Ng_x, ray.hit.Ng_y, ray.hit.Ng_z));
    if (glm::dot(normal, direction) > 0.0f) normal = -normal;
    return ray.ray.tfar;
  }

 private:
  RTCDevice device_;
  RTCScene scene_;
};

/// Directions over the hemispheres of surface points seen from random places in the model's box:
/// what diffuse gathering casts, in no order. Cones and apertures are set later.
std::vector<GatherQuery> makeQueries(const asvo::Tree& tree, const Triangles& triangles,
                                     std::uint64_t count) {
  std::vector<GatherQuery> queries;
  const vec3 lower(tree.info.lowerX, tree.info.lowerY, tree.info.lowerZ);
  const float leaf = tree.info.size / static_cast<float>(1u << tree.info.depth);
  for (std::uint32_t i = 0; queries.size() < count && i < 64 * count; ++i) {
    Sampler sampler(0u, i, 1u);
    const vec2 a = sampler.next2D(), b = sampler.next2D(), c = sampler.next2D();
    const vec3 eye = lower + tree.info.size * vec3(a.x, a.y, sampler.next1D());
    vec3 normal;
    const vec3 view = uniformSphere(b);
    const float t = triangles.hit(eye, view, normal);
    if (!(t < kInfinity) || !std::isfinite(normal.x)) continue;
    GatherQuery q{};
    q.direction = glm::normalize(normal + 0.999f * uniformSphere(c));
    q.origin = eye + view * t + normal * (1e-3f * leaf);
    q.tmax = kInfinity;
    q.jitter = sampler.next1D();
    queries.push_back(q);
  }
  if (queries.empty()) fail(ExitCode::kInput, "no ray from inside the model's box meets it");
  return queries;
}

/// As the renderer casts them: from where the cone is as wide as a leaf on.
void setAperture(std::vector<GatherQuery>& queries, double aperture, float leaf) {
  for (GatherQuery& q : queries) {
    q.tanHalf = static_cast<float>(std::tan(0.5 * aperture));
    q.tmin = leaf / q.tanHalf;
  }
}

void traceRays(const Triangles& triangles, const std::vector<GatherQuery>& queries) {
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, queries.size(), 1024), [&](auto& range) {
    vec3 normal;
    for (std::size_t i = range.begin(); i != range.end(); ++i) {
      triangles.hit(queries[i].origin, queries[i].direction, normal);
    }
  });
}

asvo::Tree build(const VoxelSource& source, int depth) {
  asvo::BuildOptions options;
  options.depth = depth;
  options.maxLeaves = std::uint64_t{1} << 28;
  return asvo::Tree::build(source, options);
}

/// Bytes of a voxel by what they hold, without and with leaves, and of each level.
Json sizes(const asvo::Tree& tree) {
  Json levels = Json::array();
  for (std::uint32_t l = 0; l <= tree.info.depth; ++l) {
    const std::uint64_t count = tree.levelOffsets[l + 1] - tree.levelOffsets[l];
    levels.push_back(
        {{"level", l}, {"voxels", count}, {"bytes", count * (l == tree.info.depth ? 48u : 40u)}});
  }
  // A leaf: mask 8 bytes; of the voxel's words 36 + 2 bits coverage, 26 normal, 8 plane, 16 area;
  // material 16, albedo 24; light 16 bytes; emission 12 bytes for those that emit.
  const double emission =
      12.0 * static_cast<double>(tree.emitters.size()) / static_cast<double>(tree.nodes.size());
  return {{"leaf_geometry_bytes", 8 + (36 + 2 + 26 + 8 + 16) / 8},
          {"leaf_material_and_light_bytes", 2 + 3 + 16 + emission},
          {"node_bytes", 8},
          {"levels", levels}};
}

/// As a frame does: a batch is made ready while the one before it is traced.
void gatherAll(GRayTracer& tracer, std::span<const GatherQuery> queries) {
  constexpr std::size_t kBatch = 1u << 17;
  std::optional<int> before;
  for (std::size_t first = 0; first < queries.size(); first += kBatch) {
    const int ticket =
        tracer.submitGather(queries.subspan(first, std::min(kBatch, queries.size() - first)));
    if (before) tracer.finishGather(*before);
    before = ticket;
  }
  if (before) tracer.finishGather(*before);
}

/// Cones a second by aperture over one tree, and Embree's rays between them.
Json coneRates(const AsvoArguments& a, const asvo::Tree& tree, const Scene& scene,
               const Triangles& triangles, std::vector<GatherQuery>& queries,
               std::vector<double>& embree) {
  const std::vector<shaderio::PhotonMaterial> materials =
      photonMaterials(scene.materials, scene.images);
  const std::unique_ptr<GRayTracer> tracer =
      a.render.settings.device == RenderSettings::kNoDevice
          ? makeCpuTracer(tree, materials)
          : makeVulkanTracer(tree, materials, a.render.settings.device);
  const float leaf = tree.info.size / static_cast<float>(1u << tree.info.depth);
  const auto count = static_cast<double>(queries.size());
  std::vector<double> rates[std::size(kApertures)];
  const auto gather = [&] { gatherAll(*tracer, queries); };
  for (int i = -1; i < a.repeats; ++i) {  // the first round warms up
    for (std::size_t k = 0; k < std::size(kApertures); ++k) {
      setAperture(queries, kApertures[k], leaf);
      const double seconds = secondsOf(gather);
      if (i >= 0) rates[k].push_back(count / seconds);
    }
    const double seconds = secondsOf([&] { traceRays(triangles, queries); });
    if (i >= 0) embree.push_back(count / seconds);
  }
  Json out;
  for (std::size_t k = 0; k < std::size(kApertures); ++k) {
    out[fmt::format("{:g}", kApertures[k])] = std::round(median(rates[k]));
  }
  return out;
}

Json rooms(int device) {
  Json out;
  for (const auto& [name, guess] : {std::pair{"", GuessKind::kCone}, {"_ray", GuessKind::kRay}}) {
    for (const double wall : kWalls) {
      out[fmt::format("leak_percent{}", name)][fmt::format("{:g}", wall)] =
          leakPercent(wall, guess, device);
    }
    for (const float albedo : kAlbedos) {
      out[fmt::format("furnace_error_percent{}", name)][fmt::format("{:g}", albedo)] =
          furnaceErrorPercent(albedo, guess, device);
    }
  }
  return out;
}

Json measure(const AsvoArguments& a) {
  Scene scene = importScene(a.render.input);
  const Box3d bounds = scene.bounds();
  const VoxelSource source(scene, scene.materials, 0.5 * (bounds.lower + bounds.upper));
  std::vector<double> builds;
  asvo::Tree tree;
  for (int i = 0; i < a.repeats; ++i) {
    const double seconds = secondsOf([&] { tree = build(source, a.depth); });
    builds.push_back(static_cast<double>(source.count()) / seconds);
  }
  const Triangles triangles(source);
  std::vector<GatherQuery> queries = makeQueries(tree, triangles, a.cones);
  const auto nodes = static_cast<double>(tree.nodes.size());
  Json out{{"bench", "asvo"},
           {"input", a.render.input},
           {"triangles", source.count()},
           {"depth", tree.info.depth},
           {"voxels", tree.nodes.size()},
           {"leaves", tree.info.leafCount},
           {"bytes_per_voxel", (40.0 * nodes + 8.0 * tree.info.leafCount +
                                12.0 * static_cast<double>(tree.emitters.size())) /
                                   nodes},
           {"sizes", sizes(tree)},
           {"build_triangles_per_second", std::round(median(builds))}};
  std::vector<double> embree;
  Json cones;
  cones[fmt::format("depth_{}", tree.info.depth)] =
      coneRates(a, tree, scene, triangles, queries, embree);
  for (int depth = a.depth - 1; depth >= std::max(1, a.depth - 2); --depth) {
    const asvo::Tree coarser = build(source, depth);
    cones[fmt::format("depth_{}", depth)] =
        coneRates(a, coarser, scene, triangles, queries, embree);
  }
  out["cones_per_second"] = cones;
  out["embree_rays_per_second"] = std::round(median(embree));
  if (a.rooms) out.update(rooms(a.render.settings.device));
  return out;
}

void printTable(const Json& d) {
  fmt::print("{}: {} triangles, {} voxels, {} leaves at depth {}\n", d["input"].get<std::string>(),
             d["triangles"].get<std::uint64_t>(), d["voxels"].get<std::uint64_t>(),
             d["leaves"].get<std::uint64_t>(), d["depth"].get<int>());
  fmt::print("bytes a voxel        {:.1f}\nbuilt                {:.2f} M triangles/s\n",
             d["bytes_per_voxel"].get<double>(),
             d["build_triangles_per_second"].get<double>() / 1e6);
  const double rays = d["embree_rays_per_second"].get<double>();
  fmt::print("Embree, same rays    {:.2f} M/s\n", rays / 1e6);
  for (const auto& [depth, rates] : d["cones_per_second"].items()) {
    for (const auto& [aperture, rate] : rates.items()) {
      fmt::print("cones {} {:>4} rad  {:.2f} M/s, {:.2f} of Embree's\n", depth, aperture,
                 rate.get<double>() / 1e6, rate.get<double>() / rays);
    }
  }
  for (const char* key :
       {"leak_percent", "leak_percent_ray", "furnace_error_percent", "furnace_error_percent_ray"}) {
    if (!d.contains(key)) continue;
    for (const auto& [at, value] : d[key].items()) {
      fmt::print("{:<26} {:>4}  {:.4f} %\n", key, at, value.get<double>());
    }
  }
}

void run(AsvoArguments& a) {
  readSettings(a.render);
  if (!a.json.empty() && a.json != "-") checkWritable(a.json);
  const ThreadLimit limit(a.threads);
  const Json document = measure(a);
  if (a.json == "-") {
    fmt::print("{}\n", document.dump(1));
  } else {
    if (!a.json.empty()) writeTextAtomically(a.json, document.dump(1) + "\n");
    printTable(document);
  }
  std::fflush(stdout);
}

}  // namespace

void addBenchAsvoCommand(CLI::App& bench) {
  auto a = std::make_shared<AsvoArguments>();
  CLI::App* c = bench.add_subcommand(
      "asvo", "Voxels of a model: size, build and cones a second against Embree's rays");
  c->add_option("INPUT", a->render.input, "A model: .gltf .glb .ply .obj .stl .xml .pbrt")
      ->required();
  c->add_option("--depth", a->depth, "Levels below the root; leaves hold 4^3 sub-voxels")
      ->check(CLI::Range(1, static_cast<int>(asvo::ASVO_MAX_DEPTH)))
      ->capture_default_str();
  c->add_option("--cones", a->cones, "Cones of each run")
      ->check(CLI::Range(1, 1 << 22))
      ->capture_default_str();
  c->add_option("--repeats", a->repeats, "Runs; medians are printed")
      ->check(CLI::Range(1, 1000))
      ->capture_default_str();
  c->add_flag("!--no-rooms", a->rooms, "Leave out the rooms of known light");
  c->add_option("--device", a->render.device, "Vulkan device: number, auto or none")
      ->capture_default_str();
  c->add_option("--threads", a->threads, "CPU threads [all]")->check(CLI::Range(1, 4096));
  c->add_option("--json", a->json, "Write the document to this file; - is stdout");
  c->callback([a] { run(*a); });
}

}  // namespace trex
