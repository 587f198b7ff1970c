// HCCMesh against Embree's own triangles: bytes a triangle, rays a second on the same rays in the
// same run (medians of interleaved runs), build time. Prints JSON.
//
//   hccmesh_bench [--triangles 2e6] [--runs 5] [--rays 1048576] [--normals] [--threads 0]
#include <embree3/rtcore.h>
#include <tbb/blocked_range.h>
#include <tbb/global_control.h>
#include <tbb/info.h>
#include <tbb/parallel_for.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <iostream>
#include <memory>
#include <nlohmann/json.hpp>
#include <span>
#include <thread>
#include <vector>

#include "src/crays/ray_scene.h"
#include "tests/bench/bumpy_sphere.h"

namespace {

using namespace trex;
using Clock = std::chrono::steady_clock;

double secondsSince(Clock::time_point start) {
  return std::chrono::duration<double>(Clock::now() - start).count();
}

constexpr std::size_t kSpan = 16;  // our rays that are asked for together

// The same mesh as Embree's own triangles, robust, default quality.
class EmbreeScene {
 public:
  EmbreeScene(const Mesh& mesh, const dvec3& origin) {
    device_ = rtcNewDevice(nullptr);
    rtcSetDeviceMemoryMonitorFunction(
        device_,
        [](void* counter, ssize_t bytes, bool) {
          static_cast<std::atomic<std::int64_t>*>(counter)->fetch_add(bytes);
          return true;
        },
        &bytes_);
    const auto start = Clock::now();
    scene_ = rtcNewScene(device_);
    rtcSetSceneFlags(scene_, RTC_SCENE_FLAG_ROBUST);
    const RTCGeometry g = rtcNewGeometry(device_, RTC_GEOMETRY_TYPE_TRIANGLE);
    void* p = rtcSetNewGeometryBuffer(g, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, sizeof(vec3),
                                      mesh.positions.size());
    std::transform(mesh.positions.begin(), mesh.positions.end(), static_cast<vec3*>(p),
                   [&](const vec3& v) { return vec3(dvec3(v) - origin); });
    void* t = rtcSetNewGeometryBuffer(g, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3,
                                      sizeof(glm::uvec3), mesh.triangles.size());
    std::copy(mesh.triangles.begin(), mesh.triangles.end(), static_cast<glm::uvec3*>(t));
    rtcCommitGeometry(g);
    rtcAttachGeometry(scene_, g);
    rtcReleaseGeometry(g);
    rtcCommitScene(scene_);
    buildSeconds = secondsSince(start);
  }
  ~EmbreeScene() {
    rtcReleaseScene(scene_);
    rtcReleaseDevice(device_);
  }
  EmbreeScene(const EmbreeScene&) = delete;
  EmbreeScene& operator=(const EmbreeScene&) = delete;

  bool intersect(const RayQuery& r, float& t) const {
    RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    RTCRayHit hit;
    set(hit.ray, r);
    hit.hit.geomID = hit.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
    rtcIntersect1(scene_, &context, &hit);
    t = hit.ray.tfar;
    return hit.hit.geomID != RTC_INVALID_GEOMETRY_ID;
  }
  bool occluded(const RayQuery& r) const {
    RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    RTCRay ray;
    set(ray, r);
    rtcOccluded1(scene_, &context, &ray);
    return ray.tfar < 0.0f;
  }
  double bytes() const { return static_cast<double>(bytes_.load()); }
  double buildSeconds = 0.0;

 private:
  static void set(RTCRay& ray, const RayQuery& r) {
    const vec3 origin(r.start.position);
    ray.org_x = origin.x, ray.org_y = origin.y, ray.org_z = origin.z;
    ray.dir_x = r.direction.x, ray.dir_y = r.direction.y, ray.dir_z = r.direction.z;
    ray.tnear = r.tnear, ray.tfar = r.end.distance, ray.time = 0.0f;
    ray.mask = 0xffffffffu, ray.id = ray.flags = 0;
  }
  std::atomic<std::int64_t> bytes_{0};
  RTCDevice device_ = nullptr;
  RTCScene scene_ = nullptr;
};

double median(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  return values[values.size() / 2];
}

// Rays a second of both, and on how many rays they disagree.
struct Comparison {
  double hccmesh = 0.0, embree = 0.0;
  std::uint64_t hits = 0, different = 0;
};

template <typename A, typename B>
Comparison compare(const std::vector<RayQuery>& rays, int runs, const A& ours, const B& theirs) {
  Comparison c;
  std::vector<std::uint8_t> a(rays.size()), b(rays.size());
  std::vector<double> times[2];
  const auto measure = [&](const auto& trace, std::vector<std::uint8_t>& out) {
    const auto start = Clock::now();
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, rays.size(), 4096),
                      [&](const auto& range) {
                        for (std::size_t i = range.begin(); i < range.end(); i += kSpan) {
                          const std::size_t count = std::min(kSpan, range.end() - i);
                          trace(std::span(&rays[i], count), std::span(&out[i], count));
                        }
                      });
    return static_cast<double>(rays.size()) / secondsSince(start);
  };
  measure(ours, a), measure(theirs, b);  // warm up
  for (int run = 0; run < runs; ++run) {
    times[0].push_back(measure(ours, a));
    times[1].push_back(measure(theirs, b));
  }
  c.hccmesh = median(times[0]);
  c.embree = median(times[1]);
  for (std::size_t i = 0; i < rays.size(); ++i) {
    c.hits += a[i];
    c.different += a[i] != b[i];
  }
  return c;
}

// From inside the closed surface, by rows of tiles of 32 x 32 pixels.
std::vector<RayQuery> coherentRays(std::size_t count) {
  const int size = std::max(32, static_cast<int>(std::sqrt(static_cast<double>(count))) / 32 * 32);
  std::vector<RayQuery> rays;
  for (int tile = 0; tile < size / 32 * (size / 32); ++tile)
    for (int pixel = 0; pixel < 1024; ++pixel) {
      const int x = tile % (size / 32) * 32 + pixel % 32, y = tile / (size / 32) * 32 + pixel / 32;
      const vec3 d(2.0f * (float(x) + 0.5f) / float(size) - 1.0f,
                   2.0f * (float(y) + 0.5f) / float(size) - 1.0f, -1.0f);
      rays.push_back({vec3(0.1f, 0.05f, 0.4f), glm::normalize(d)});
    }
  return rays;
}

}  // namespace

int main(int argc, char** argv) {
  double triangles = 2e6;
  int runs = 5, threads = 0;
  std::size_t rayCount = 1u << 20;
  bool normals = false;
  CLI::App app("HCCMesh against Embree's triangles");
  app.add_option("--triangles", triangles)->check(CLI::Range(12.0, 3e8));
  app.add_option("--runs", runs)->check(CLI::Range(1, 1000));
  app.add_option("--rays", rayCount)->check(CLI::Range(1024, 1 << 26));
  app.add_option("--threads", threads, "0: all");
  app.add_flag("--normals", normals, "store normals");
  CLI11_PARSE(app, argc, argv);
  std::unique_ptr<tbb::global_control> limit;
  if (threads > 0)
    limit = std::make_unique<tbb::global_control>(tbb::global_control::max_allowed_parallelism,
                                                  static_cast<std::size_t>(threads));

  const Scene scene = bench::sceneOf(
      bench::bumpySphere(std::max(1, int(std::lround(std::sqrt(triangles / 12.0)))), normals));
  const RayScene ours(scene);
  const EmbreeScene theirs(scene.meshes[0], ours.renderOrigin());
  const auto statistics = ours.statistics();
  const auto count = static_cast<double>(statistics.triangles);

  hccm::Part part;
  part.positions = scene.meshes[0].positions;
  part.triangles = scene.meshes[0].triangles;
  part.normals = scene.meshes[0].normals;
  const auto buildStart = Clock::now();
  const hccm::Mesh mesh = hccm::Mesh::build({&part, 1});
  const double buildSeconds = secondsSince(buildStart);

  using Rays = std::span<const RayQuery>;
  using Answers = std::span<std::uint8_t>;
  const auto nearestOurs = [&](Rays rays, Answers out) {
    std::array<RayHit, kSpan> hits;
    ours.intersect(rays, std::span(hits).first(rays.size()), out);
  };
  const auto nearestTheirs = [&](Rays rays, Answers out) {
    float t;
    for (std::size_t i = 0; i < rays.size(); ++i) out[i] = theirs.intersect(rays[i], t);
  };
  const std::vector<RayQuery> coherent = coherentRays(rayCount);
  std::vector<RayQuery> diffuse, shadow;
  const vec3 light(-0.3f, 0.5f, 0.2f);
  double worst = 0.0;
  for (std::size_t i = 0; i < coherent.size(); ++i) {
    RayHit hit;
    if (!ours.intersect(coherent[i].start, coherent[i].direction, 0.0f, kInfinity, hit)) continue;
    float t = 0.0f;
    theirs.intersect(coherent[i], t);
    worst = std::max(worst, std::abs(double(t) - double(hit.t)));
    const Surface s = ours.surface(hit);
    const vec3 n = -s.geometricNormal;
    const float phi = 2.0f * kPi * bench::uniform(2 * i), u = bench::uniform(2 * i + 1);
    const vec3 local(std::cos(phi) * std::sqrt(u), std::sin(phi) * std::sqrt(u),
                     std::sqrt(1.0f - u));
    const vec3 origin = vec3(s.position) + n * 1e-4f;
    diffuse.push_back({origin, Basis(n).toWorld(local)});
    const vec3 toLight = light - origin;
    shadow.push_back({origin, glm::normalize(toLight), 0.0f, glm::length(toLight)});
  }

  const Comparison results[3] = {
      compare(coherent, runs, nearestOurs, nearestTheirs),
      compare(diffuse, runs, nearestOurs, nearestTheirs),
      compare(
          shadow, runs, [&](Rays rays, Answers out) { ours.occluded(rays, out); },
          [&](Rays rays, Answers out) {
            for (std::size_t i = 0; i < rays.size(); ++i) out[i] = theirs.occluded(rays[i]);
          })};

  const hccm::Sizes z = mesh.sizes();
  const auto share = [&](std::uint64_t bytes) { return static_cast<double>(bytes) / count; };
  nlohmann::ordered_json j;
  j["triangles"] = statistics.triangles;
  j["bytes_per_triangle"] = share(statistics.meshBytes + statistics.topLevelBytes);
  j["bytes_per_triangle_by_part"] = {{"header", share(z.header)},
                                     {"cluster_table", share(z.clusterTable)},
                                     {"cluster_headers", share(z.clusterHeaders)},
                                     {"vertices", share(z.vertices)},
                                     {"topology", share(z.topology)},
                                     {"nodes", share(z.nodes)},
                                     {"normals", share(z.normals)},
                                     {"tex_coords", share(z.texCoords)},
                                     {"colors", share(z.colors)},
                                     {"embree_top_level", share(statistics.topLevelBytes)}};
  j["embree_bytes_per_triangle"] = theirs.bytes() / count;
  j["triangles_per_cluster"] = count / static_cast<double>(statistics.clusters);
  const char* names[3] = {"coherent", "diffuse", "shadow"};
  for (int i = 0; i < 3; ++i) {
    j["rays_per_second"][names[i]] = {{"hccmesh", results[i].hccmesh},
                                      {"embree", results[i].embree}};
    j["ratios"][names[i]] = results[i].hccmesh / results[i].embree;
    j["hits"][names[i]] = {{"hccmesh", results[i].hits},
                           {"different_from_embree", results[i].different}};
  }
  j["largest_difference_of_t_coherent"] = worst;
  j["build_seconds"] = buildSeconds;
  j["build_triangles_per_second"] = count / buildSeconds;
  j["embree_build_triangles_per_second"] = count / theirs.buildSeconds;
  j["runs"] = runs;
  j["rays"] = coherent.size();
  j["instruction_set"] = mesh.targetName();
  j["machine_threads"] = std::thread::hardware_concurrency();
  j["threads_used"] = threads > 0 ? threads : tbb::info::default_concurrency();
  std::cout << j.dump(2) << "\n";
  return 0;
}
