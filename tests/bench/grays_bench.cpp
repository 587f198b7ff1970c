// Speed of G-rays: gathering cones and photon segments a second, on the device and in the C++
// build, as JSON on stdout. Usage: grays_bench [--depth 8] [--cones 1000000] [--photons 200000]
// [--repeats 7] [--device N|none] [--storage-buffers 0|1] [--limits 1] [--page-bits 10]
//
// --limits 1: cones alone, with device memory of 100 %, 50 %, ... of what the tree takes that fits,
// as a table: rates beside the unlimited device's in the same run, and what the missing pages
// change.
//
// The scene is a furnished room (tests/gpu/room.h). Cones start some voxels off a random point
// inside, in random directions, with tanHalf in [0.15, 0.3): incoherent, as diffuse gathering asks
// for. As in a frame they begin where they are as wide as a leaf: nearer is a C-ray's.
#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdlib>
#include <ctime>
#include <functional>
#include <string>
#include <string_view>
#include <vector>

#include "asvo/tracer.h"
#include "src/core/error.h"
#include "src/core/log.h"
#include "src/grays/grays.h"
#include "src/vulkan/vulkan.h"
#include "tests/gpu/room.h"

namespace {

using namespace trex;

struct Options {
  int depth = 8, repeats = 7, device = -1;
  bool useDevice = true, limitsAlone = false;
  VulkanLimits limits;
  std::size_t cones = 1'000'000, photons = 200'000;
};

double secondsOf(const std::function<void()>& work) {
  const auto start = std::chrono::steady_clock::now();
  work();
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

/// Rates of one kind of work: median by wall clock, and by the processor time of the whole process
/// (steadier on a busy machine; meaningless for a device with cores of its own).
class Rates {
 public:
  void add(double items, const std::function<void()>& work) {
    const std::clock_t before = std::clock();
    const double seconds = secondsOf(work);
    wall_.push_back(items / seconds);
    core_.push_back(items * CLOCKS_PER_SEC / static_cast<double>(std::clock() - before + 1));
  }
  std::string json(std::string_view name) {
    return fmt::format("\"{0}_per_second\": {1:.0f}, \"{0}_per_core_second\": {2:.0f}", name,
                       median(wall_), median(core_));
  }

 private:
  static double median(std::vector<double>& values) {
    std::sort(values.begin(), values.end());
    return values[values.size() / 2];
  }
  std::vector<double> wall_, core_;
};

std::vector<shaderio::GatherQuery> makeQueries(const asvo::Tree& tree, std::size_t count) {
  test::Random random(1);
  const asvo::Tracer tracer(tree);
  const float edge = tree.info.size / static_cast<float>(1u << tree.info.depth);
  std::vector<shaderio::GatherQuery> queries(count);
  for (auto& q : queries) {
    // A surface point seen from inside the room, and a direction about its normal.
    asvo::Tracer::AsvoHit hit;
    glm::vec3 origin, direction;
    do {
      origin = random.inside({0.1f, 0.1f, 0.1f}, {3.9f, 2.9f, 4.9f});
      direction = random.direction();
    } while (!tracer.asvoIntersect(origin, direction, 0.0f, 1e30f, hit));
    q.origin = origin + direction * hit.t + hit.normal * edge;
    q.direction = glm::normalize(hit.normal + 0.999f * random.direction());
    q.tanHalf = 0.15f + 0.15f * random.next();
    q.tmin = edge / q.tanHalf;
    q.tmax = 1e30f;
    q.jitter = random.next();
  }
  return queries;
}

std::vector<shaderio::PhotonRecord> makeRecords(const asvo::Tree& tree, std::size_t count) {
  test::Random random(2);
  const asvo::Tracer tracer(tree);
  std::vector<shaderio::PhotonRecord> records;
  while (records.size() < count) {
    asvo::Tracer::AsvoHit hit;
    const glm::vec3 origin(2.0f, 2.7f, 1.8f), direction = random.direction();
    if (!tracer.asvoIntersect(origin, direction, 0.0f, 1e30f, hit)) continue;
    records.push_back({origin + direction * hit.t, tracer.asvoOctEncode(hit.normal),
                       glm::vec3(100.0f), static_cast<std::uint32_t>(records.size())});
  }
  return records;
}

std::string measure(GRayTracer& tracer, const Options& options,
                    const std::vector<shaderio::GatherQuery>& queries,
                    const std::vector<shaderio::PhotonRecord>& records) {
  const double firstPhotons = secondsOf([&] { tracer.tracePhotons({&records[0], 1}, 1e-6); });
  Rates photonRates, coneRates;
  const std::uint64_t before = tracer.statistics().photonDeposits;
  tracer.tracePhotons(records, 1e-6);
  const auto deposits = static_cast<double>(tracer.statistics().photonDeposits - before);
  for (int i = 0; i < options.repeats; ++i) {
    photonRates.add(deposits, [&] { tracer.tracePhotons(records, 1e-6); });
  }
  const double resolve = secondsOf([&] { tracer.resolveLight(records.size()); });
  const double firstCone = secondsOf([&] {
    tracer.finishGather(tracer.submitGather({&queries[0], 1}));
  });
  double sum = 0.0;
  for (int i = 0; i < options.repeats; ++i) {
    coneRates.add(static_cast<double>(queries.size()), [&] {
      for (const auto& result : tracer.finishGather(tracer.submitGather(queries))) {
        sum += result.radiance.x;
      }
    });
  }
  return fmt::format(
      "{{\"name\": \"{}\", {}, {}, \"first_gather_seconds\": {:.4f}, "
      "\"first_photon_seconds\": {:.4f}, \"resolve_light_seconds\": {:.4f}, "
      "\"device_bytes\": {}, \"lost_deposits\": {}, \"check_sum\": {:.6g}}}",
      tracer.name(), coneRates.json("cones"), photonRates.json("photon_segments"), firstCone,
      firstPhotons, resolve, tracer.statistics().deviceBytes, tracer.statistics().lostDeposits,
      sum);
}

Options parse(int argc, char** argv) {
  Options options;
  for (int i = 1; i + 1 < argc; i += 2) {
    const std::string_view key = argv[i];
    const char* value = argv[i + 1];
    if (key == "--depth") options.depth = std::atoi(value);
    if (key == "--repeats") options.repeats = std::max(1, std::atoi(value));
    if (key == "--cones") options.cones = static_cast<std::size_t>(std::atoll(value));
    if (key == "--photons") options.photons = static_cast<std::size_t>(std::atoll(value));
    if (key == "--storage-buffers") options.limits.storageBuffers = std::atoi(value) != 0;
    if (key == "--limits") options.limitsAlone = std::atoi(value) != 0;
    if (key == "--page-bits") {
      options.limits.pageBits = static_cast<std::uint32_t>(std::atoi(value));
    }
    if (key == "--device") {
      options.useDevice = std::string_view(value) != "none";
      if (options.useDevice) options.device = std::atoi(value);
    }
  }
  return options;
}

/// Batches as a frame's: one is made ready while the one before it is traced.
std::vector<shaderio::GatherResult> gatherAll(GRayTracer& tracer,
                                              std::span<const shaderio::GatherQuery> queries) {
  constexpr std::size_t kBatch = 1u << 14;
  std::vector<shaderio::GatherResult> all;
  const auto take = [&](int ticket) {
    const auto results = tracer.finishGather(ticket);
    all.insert(all.end(), results.begin(), results.end());
  };
  int before = -1;
  for (std::size_t first = 0; first < queries.size(); first += kBatch) {
    const int ticket =
        tracer.submitGather(queries.subspan(first, std::min(kBatch, queries.size() - first)));
    if (before >= 0) take(before);
    before = ticket;
  }
  if (before >= 0) take(before);
  return all;
}

/// One row of the table of limits.
struct Limited {
  std::string name;
  std::uint64_t bytes = 0;
  std::unique_ptr<GRayTracer> tracer;
  std::vector<double> seconds;
  double mean = 0.0, rms = 0.0;  // of its answers against the unlimited, relative
};

void measureLimits(const Options& options, const asvo::Tree& tree,
                   std::span<const shaderio::GatherQuery> queries,
                   std::span<const shaderio::PhotonRecord> records) {
  const std::vector<shaderio::PhotonMaterial> materials(1);
  std::vector<Limited> rows;
  std::vector<shaderio::GatherResult> whole;
  for (const int percent : {0, 100, 50, 25, 10, 5, 2, 1}) {
    Limited& row = rows.emplace_back();
    VulkanLimits limits = options.limits;
    row.bytes = percent == 0 ? 0 : rows[0].bytes / 100 * static_cast<std::uint64_t>(percent);
    limits.maxBytes = row.bytes;
    row.name = percent == 0 ? "none" : fmt::format("{} %", percent);
    row.tracer = makeVulkanTracer(tree, materials, options.device, limits);
    row.tracer->tracePhotons(records, 1e-6);
    row.tracer->resolveLight(records.size());
    const auto results = gatherAll(*row.tracer, queries);
    if (percent == 0) {
      whole = results;
      row.bytes = row.tracer->statistics().deviceBytes;
    }
    double sum = 0.0, expected = 0.0, square = 0.0;
    for (std::size_t i = 0; i < results.size(); ++i) {
      const double a = results[i].radiance.x, b = whole[i].radiance.x;
      sum += a;
      expected += b;
      square += (a - b) * (a - b);
    }
    const auto count = static_cast<double>(results.size());
    row.mean = sum / expected;
    row.rms = std::sqrt(square / count) / (expected / count);
  }
  for (int i = 0; i < options.repeats; ++i) {
    for (Limited& row : rows) {
      row.seconds.push_back(secondsOf([&] { gatherAll(*row.tracer, queries); }));
    }
  }
  fmt::print("{} voxels, {} leaves, {} bytes on the device without a limit\n", tree.info.nodeCount,
             tree.info.leafCount, rows[0].bytes);
  fmt::print(
      "| limit | MiB | pages at a time | cones/s | of unlimited | mean | RMS | missed reads a "
      "cone | pages loaded |\n|---|---|---|---|---|---|---|---|---|\n");
  const auto median = [](std::vector<double>& values) {
    std::sort(values.begin(), values.end());
    return values[values.size() / 2];
  };
  const double unlimited = median(rows[0].seconds);
  for (Limited& row : rows) {
    const GRayStatistics s = row.tracer->statistics();
    const double seconds = median(row.seconds);
    fmt::print("| {} | {:.1f} | {} of {} | {:.2f} M | {:.2f} | {:.3f} | {:.3f} | {:.3f} | {} |\n",
               row.name, static_cast<double>(row.bytes) / 1048576.0, s.pageSlots, s.pages,
               static_cast<double>(queries.size()) / seconds / 1e6, unlimited / seconds, row.mean,
               row.rms, static_cast<double>(s.missedReads) / static_cast<double>(s.cones),
               s.pageLoads);
  }
}

int run(const Options& options) {
  asvo::BuildOptions build;
  build.depth = options.depth;
  const asvo::Tree tree = asvo::Tree::build(test::furnishedRoom(), build);
  const auto queries = makeQueries(tree, options.cones);
  const auto records = makeRecords(tree, options.photons);
  const std::vector<shaderio::PhotonMaterial> materials(1);
  if (options.limitsAlone) {
    measureLimits(options, tree, queries, records);
    return 0;
  }

  std::string results;
  if (options.useDevice) {
    std::unique_ptr<GRayTracer> device;
    const double start = secondsOf(
        [&] { device = makeVulkanTracer(tree, materials, options.device, options.limits); });
    results = fmt::format("\"device_start_seconds\": {:.4f}, \"device\": {}, ", start,
                          measure(*device, options, queries, records));
  }
  const auto cpu = makeCpuTracer(tree, materials);
  fmt::print(
      "{{\"depth\": {}, \"leaves\": {}, \"nodes\": {}, \"cones\": {}, \"repeats\": {}, {}"
      "\"cpu\": {}}}\n",
      tree.info.depth, tree.info.leafCount, tree.info.nodeCount, queries.size(), options.repeats,
      results, measure(*cpu, options, queries, records));
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  try {
    setLogLevel(LogLevel::kVerbose);
    return run(parse(argc, argv));
  } catch (const Error& error) {
    logError("{}", error.what());
    return static_cast<int>(error.code());
  }
}
