// Prints the figures of asvo/ as JSON: size by part, build and tracing rates on the threads of the
// machine. Usage: asvo_bench [threads]
#include <oneapi/tbb/global_control.h>
#include <oneapi/tbb/parallel_for.h>

#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <limits>

#include "asvo/tracer.h"
#include "tests/unit/asvo_shapes.h"

namespace {

using asvo_shapes::Random;
using asvo_shapes::Shape;
using Clock = std::chrono::steady_clock;

double secondsSince(Clock::time_point start) {
  return std::chrono::duration<double>(Clock::now() - start).count();
}

/// The best of three, as other work of the machine only slows.
template <typename Work>
double bestSeconds(const Work& work) {
  double best = 1e30;
  for (int i = 0; i < 3; ++i) {
    const auto start = Clock::now();
    work();
    best = std::min(best, secondsSince(start));
  }
  return best;
}

void printBuild(const char* name, const Shape& shape, int depth, bool last) {
  asvo::BuildOptions options;
  options.depth = depth;
  options.maxLeaves = 1ull << 28;
  asvo::Tree tree;
  const double seconds = bestSeconds([&] { tree = asvo::Tree::build(shape, options); });
  const double nodes = static_cast<double>(tree.nodes.size());
  const double leaves = static_cast<double>(tree.leaves.size());
  std::printf(
      "    {\"scene\": \"%s\", \"triangles\": %zu, \"depth\": %u, \"voxels\": %zu, "
      "\"leaves\": %zu,\n     \"bytes_per_voxel\": {\"nodes\": 8, \"voxels\": 16, "
      "\"leaves\": %.2f, \"light\": 16, \"total\": %.2f},\n     \"build_seconds\": %.4f, "
      "\"build_triangles_per_second\": %.0f}%s\n",
      name, shape.triangles.size(), tree.info.depth, tree.nodes.size(), tree.leaves.size(),
      8.0 * leaves / nodes, 40.0 + 8.0 * leaves / nodes, seconds,
      static_cast<double>(shape.triangles.size()) / seconds, last ? "" : ",");
}

struct Query {
  asvo::vec3 origin, direction;
  float jitter;
};

/// Directions over the hemisphere of points on the walls and blocks, as a gathering pass makes
/// them.
std::vector<Query> makeQueries(const asvo::Tracer& tracer, std::size_t count) {
  std::vector<Query> queries;
  Random random(1);
  while (queries.size() < count) {
    asvo::Tracer::AsvoHit hit;
    const asvo::vec3 eye = random.point(-0.9f, 0.9f), view = random.direction();
    if (!tracer.asvoIntersect(eye, view, 0.0f, 10.0f, hit)) continue;
    for (int i = 0; i < 16; ++i) {
      const asvo::vec3 direction = glm::normalize(hit.normal + random.direction() * 0.999f);
      queries.push_back({eye + view * hit.t + hit.normal * 0.008f, direction, random.uniform()});
    }
  }
  return queries;
}

/// Calls per second, in batches as the scheduler hands them out.
template <typename Call>
double rate(const std::vector<Query>& queries, const Call& call) {
  std::vector<float> sums(queries.size());
  const double seconds = bestSeconds([&] {
    tbb::parallel_for(std::size_t{0}, queries.size() / 1024, [&](std::size_t batch) {
      for (std::size_t i = 1024 * batch; i < 1024 * (batch + 1); ++i) sums[i] = call(queries[i]);
    });
  });
  return static_cast<double>(queries.size()) / seconds;
}

void printTracing() {
  asvo::BuildOptions options;
  options.depth = 8;
  const asvo::Tree tree = asvo::Tree::build(asvo_shapes::cornellBox(), options);
  const auto light =
      asvo_shapes::constantLight(tree, asvo::Tracer(tree).asvoPackRgb9e5(asvo::vec3(1)));
  const asvo::Tracer tracer(tree, light);
  const std::vector<Query> queries = makeQueries(tracer, 1u << 20);
  const float infinity = std::numeric_limits<float>::infinity();
  const float voxel = tree.info.size / 256.0f;
  std::printf("  \"cones_per_second\": {");
  const char* separator = "";
  for (const float tanHalf : {0.05f, 0.15f, 0.3f, 0.6f}) {
    const double cones = rate(queries, [&](const Query& q) {
      return tracer.asvoGather(q.origin, q.direction, tanHalf, 3.0f * voxel, infinity, q.jitter)
          .transmittance;
    });
    std::printf("%s\"%.2f\": %.0f", separator, static_cast<double>(tanHalf), cones);
    separator = ", ";
  }
  const double rays = rate(queries, [&](const Query& q) {
    asvo::Tracer::AsvoHit hit;
    return tracer.asvoIntersect(q.origin, q.direction, 0.0f, infinity, hit) ? hit.t : 0.0f;
  });
  std::printf("},\n  \"rays_per_second\": %.0f\n}\n", rays);
}

}  // namespace

int main(int argc, char** argv) {
  const int threads = argc > 1 ? std::atoi(argv[1]) : 0;
  const auto parameter = tbb::global_control::max_allowed_parallelism;
  const auto available = tbb::global_control::active_value(parameter);
  const tbb::global_control control(parameter, threads > 0 ? threads : available);
  std::printf("{\n  \"builds\": [\n");
  printBuild("cornell", asvo_shapes::cornellBox(), 8, false);
  Shape sphere;
  sphere.addSphere(asvo::vec3(0.0f), 1.0f, 700);
  printBuild("sphere", sphere, 8, false);
  sphere.triangles.resize(200000);
  printBuild("part of the sphere", sphere, 8, true);
  std::printf("  ],\n");
  printTracing();
}
