#include "src/bench/measure_machine.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <tbb/blocked_range.h>
#include <tbb/info.h>
#include <tbb/parallel_for.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <vector>

#include "asvo/tracer.h"
#include "src/bench/median.h"
#include "src/core/error.h"
#include "src/core/log.h"
#include "src/core/maths.h"
#include "src/core/memory.h"
#include "src/core/sampler.h"
#include "src/crays/ray_scene.h"
#include "src/grays/grays.h"
#include "src/scene/synth.h"
#include "src/session/voxel_source.h"
#include "src/vulkan/vulkan.h"

namespace trex {
namespace {

using schedule::MachineRecord;
using schedule::TimingSample;

enum MeasuredKind : std::uint32_t { kRayJobs, kConeJobs, kPhotonJobs };
constexpr const char* kModel = "synth:scan?triangles=200000";
constexpr int kDepth = 8;
constexpr std::size_t kLeastJob = 256, kMostJob = 65536;  ///< units
constexpr int kRepeats = 4;  ///< of each size; every other one is fitted
constexpr std::size_t kFileBytes = 64u << 20;
constexpr double kAperture = 0.3;  ///< radians of a cone

/// What both kinds of tracers are given: points of the model, and directions from there.
struct TestWork {
  std::vector<RayStart> starts;
  std::vector<vec3> directions;
  std::vector<shaderio::GatherQuery> cones;
  std::vector<shaderio::PhotonRecord> photons;
};

TestWork makeWork(const RayScene& scene, const asvo::Tree& tree) {
  TestWork work;
  const asvo::Tracer tracer(tree);
  const Box3f box = scene.bounds();
  const float leaf = tree.info.size / static_cast<float>(1u << tree.info.depth);
  for (std::uint32_t i = 0; work.starts.size() < kMostJob && i < 64 * kMostJob; ++i) {
    Sampler sampler(0u, i, 1u);
    const auto sphere = [&] {
      const vec2 u = sampler.next2D();
      const float z = 1.0f - 2.0f * u.x, r = std::sqrt(std::max(0.0f, 1.0f - z * z));
      return vec3(r * std::cos(2.0f * kPi * u.y), r * std::sin(2.0f * kPi * u.y), z);
    };
    const vec3 eye = 0.5f * (box.lower + box.upper) + glm::length(box.size()) * sphere();
    const vec3 target = box.lower + box.size() * vec3(sampler.next2D(), sampler.next1D());
    const vec3 direction = glm::normalize(target - eye);
    RayHit hit;
    if (!scene.intersect(RayStart(eye), direction, 0.0f, kInfinity, hit)) continue;
    const Surface s = scene.surface(hit);
    const vec3 n =
        glm::dot(s.geometricNormal, direction) < 0.0f ? s.geometricNormal : -s.geometricNormal;
    const vec3 out = glm::normalize(n + 0.999f * sphere());
    work.starts.push_back(s.leave());
    work.directions.push_back(out);
    shaderio::GatherQuery q{};
    q.origin = vec3(s.position) + n * (1e-3f * leaf);
    q.direction = out;
    q.tanHalf = static_cast<float>(std::tan(0.5 * kAperture));
    q.tmin = leaf / q.tanHalf;
    q.tmax = kInfinity;
    q.jitter = sampler.next1D();
    work.cones.push_back(q);
    work.photons.push_back(
        {vec3(s.position), tracer.asvoOctEncode(n), vec3(1.0f), static_cast<std::uint32_t>(i)});
  }
  if (work.starts.size() < kMostJob) fail(ExitCode::kFailed, "{}: rays do not meet it", kModel);
  return work;
}

/// Jobs of all sizes, from other places each time, in turn: what a size has to itself (a cold
/// cache, another program) does not fall on one half.
struct Jobs {
  std::vector<TimingSample> fitted, others;
};

Jobs timeJobs(const std::function<void(std::size_t first, std::size_t count)>& job) {
  Jobs jobs;
  job(0, kMostJob);  // warms up
  for (int repeat = 0; repeat < kRepeats; ++repeat) {
    for (std::size_t size = kLeastJob; size <= kMostJob; size *= 2) {
      const std::size_t count = size - size / 4 * static_cast<std::size_t>(repeat % 2);
      const std::size_t first = (kMostJob - count) / 3 * static_cast<std::size_t>(repeat);
      const std::size_t begin = std::min(first, kMostJob - count);
      const TimingSample sample{{static_cast<double>(count)},
                                secondsOf([&] { job(begin, count); })};
      (repeat < kRepeats / 2 ? jobs.fitted : jobs.others).push_back(sample);
    }
  }
  return jobs;
}

/// The machine, as far as it is known.
class Measurement {
 public:
  Measurement() {
    record_.kinds = {"rays", "cones", "photons"};
    record_.name = fmt::format("{} CPU threads", tbb::info::default_concurrency());
  }

  void add(std::uint32_t device, std::uint32_t kind, const Jobs& jobs) {
    const schedule::LinearTime time = schedule::fitLinear(jobs.fitted);
    times_.push_back({device, kind, time});
    for (const TimingSample& s : jobs.others) {
      errors_.push_back(std::abs(time.seconds(s.amounts) - s.seconds) / s.seconds);
    }
  }

  /// A channel's latency and bandwidth from transfers of these bytes.
  void addChannel(const std::string& name, const std::vector<TimingSample>& transfers,
                  std::vector<schedule::Link> links) {
    const schedule::LinearTime t = schedule::fitLinear(transfers);
    record_.graph.channels.push_back(
        {name, 1.0 / std::max(t.rates[0], 1e-15), t.setup, std::move(links)});
  }

  schedule::Graph& graph() { return record_.graph; }
  void addName(const std::string& more) { record_.name += ", " + more; }

  MachineRecord take() {
    record_.timing = schedule::TimingModel(static_cast<std::uint32_t>(record_.graph.devices.size()),
                                           static_cast<std::uint32_t>(record_.kinds.size()));
    for (const auto& [device, kind, time] : times_) record_.timing.set(device, kind, time);
    std::sort(errors_.begin(), errors_.end());
    record_.jobs = errors_.size();
    record_.medianError = errors_[errors_.size() / 2];
    record_.percentile90Error = errors_[errors_.size() * 9 / 10];
    schedule::checkGraph(record_.graph);
    return std::move(record_);
  }

 private:
  struct Time {
    std::uint32_t device, kind;
    schedule::LinearTime time;
  };
  MachineRecord record_;
  std::vector<Time> times_;
  std::vector<double> errors_;
};

/// A file without a name, gone when it is closed.
class TemporaryFile {
 public:
  TemporaryFile() {
    const char* folder = std::getenv("TMPDIR");
    path_ = (std::filesystem::path(folder != nullptr && *folder != '\0' ? folder : "/tmp") /
             "trex-measure-XXXXXX")
                .string();
    descriptor_ = mkstemp(path_.data());
    if (descriptor_ < 0) refuse();
    unlink(path_.c_str());
    const std::vector<char> zeros(1u << 20, 'x');
    for (std::size_t at = 0; at < kFileBytes; at += zeros.size()) {
      if (write(descriptor_, zeros.data(), zeros.size()) == static_cast<ssize_t>(zeros.size())) {
        continue;
      }
      close(descriptor_);
      refuse();
    }
    fsync(descriptor_);
  }
  ~TemporaryFile() { close(descriptor_); }
  TemporaryFile(const TemporaryFile&) = delete;
  TemporaryFile& operator=(const TemporaryFile&) = delete;

  /// Seconds of reading from the disk and not from what the system keeps of it.
  double readSeconds(std::size_t first, std::vector<char>& to) const {
    posix_fadvise(descriptor_, 0, 0, POSIX_FADV_DONTNEED);
    return secondsOf([&] {
      if (pread(descriptor_, to.data(), to.size(), static_cast<off_t>(first)) !=
          static_cast<ssize_t>(to.size())) {
        fail(ExitCode::kInput, "{}: can't be read: {}", path_, std::strerror(errno));
      }
    });
  }

 private:
  [[noreturn]] void refuse() const {
    fail(ExitCode::kOutput, "{}: can't be written: {}; set TMPDIR to another folder", path_,
         std::strerror(errno));
  }
  std::string path_;
  int descriptor_ = -1;
};

void measureDisk(Measurement& m) {
  const TemporaryFile file;
  std::vector<TimingSample> reads;
  for (int repeat = 0; repeat < kRepeats; ++repeat) {
    for (std::size_t bytes = 4096; bytes <= kFileBytes / 4; bytes *= 4) {
      std::vector<char> to(bytes);
      const std::size_t first = kFileBytes / 4 * static_cast<std::size_t>(repeat % 3);
      reads.push_back({{static_cast<double>(bytes)}, file.readSeconds(first, to)});
    }
  }
  m.addChannel("read", reads, {{0, 1}});
}

/// Cones and photons, by a tracer of any device.
void measureTracer(Measurement& m, std::uint32_t device, GRayTracer& tracer, const TestWork& work) {
  m.add(device, kPhotonJobs, timeJobs([&](std::size_t first, std::size_t count) {
          tracer.tracePhotons(std::span(work.photons).subspan(first, count), 1e-6);
        }));
  tracer.resolveLight(work.photons.size());
  m.add(device, kConeJobs, timeJobs([&](std::size_t first, std::size_t count) {
          tracer.finishGather(tracer.submitGather(std::span(work.cones).subspan(first, count)));
        }));
}

void measureRays(Measurement& m, const RayScene& scene, const TestWork& work) {
  m.add(0, kRayJobs, timeJobs([&](std::size_t first, std::size_t count) {
          tbb::parallel_for(
              tbb::blocked_range<std::size_t>(first, first + count, 64), [&](const auto& range) {
                RayHit hit;
                for (std::size_t i = range.begin(); i != range.end(); ++i) {
                  scene.intersect(work.starts[i], work.directions[i], 0.0f, kInfinity, hit);
                }
              });
        }));
}

void measureCopies(Measurement& m, vulkan::Device& device) {
  constexpr std::size_t kMostBytes = 16u << 20;
  vulkan::Buffer buffer(device, "test of copies", kMostBytes, vulkan::Place::kDevice);
  const std::vector<std::byte> bytes(kMostBytes);
  std::vector<TimingSample> copies;
  buffer.upload(bytes);  // warms up
  for (int repeat = 0; repeat < kRepeats; ++repeat) {
    for (std::size_t size = 4096; size <= kMostBytes; size *= 4) {
      copies.push_back({{static_cast<double>(size)},
                        secondsOf([&] { buffer.upload(std::span(bytes).first(size)); })});
    }
  }
  m.addChannel("copy", copies, {{1, 2}, {2, 1}});
}

/// Nothing is added if there is no device that works.
void measureDevice(Measurement& m, const asvo::Tree& tree,
                   std::span<const shaderio::PhotonMaterial> materials, const TestWork& work) {
  try {
    vulkan::Device device({});
    const std::unique_ptr<GRayTracer> tracer =
        makeVulkanTracer(tree, materials, device.info().index);
    m.graph().memories.push_back({"device", static_cast<double>(device.info().heapBytes)});
    m.graph().devices.push_back({device.info().name, 2, 1});
    measureCopies(m, device);
    measureTracer(m, 1, *tracer, work);
    m.addName(device.info().name + (device.info().sharesHostCores ? " (on the same cores)" : ""));
  } catch (const Error& e) {
    if (m.graph().devices.size() > 1) throw;  // it worked at first
    logWarning("no device is measured: {}", e.what());
  }
}

}  // namespace

MachineRecord measureMachine() {
  Measurement m;
  m.graph().memories = {{"disk", schedule::kNever},
                        {"main", static_cast<double>(availableMemoryLimit())}};
  m.graph().devices = {{"CPU", 1, 1}};
  measureDisk(m);
  const Scene scene = makeSynth(kModel);
  const RayScene rays(scene);
  asvo::BuildOptions options;
  options.depth = kDepth;
  const asvo::Tree tree =
      asvo::Tree::build(VoxelSource(scene, scene.materials, rays.renderOrigin()), options);
  const std::vector<shaderio::PhotonMaterial> materials =
      photonMaterials(scene.materials, scene.images);
  const TestWork work = makeWork(rays, tree);
  measureRays(m, rays, work);
  const std::unique_ptr<GRayTracer> tracer = makeCpuTracer(tree, materials);
  measureTracer(m, 0, *tracer, work);
  measureDevice(m, tree, materials, work);
  return m.take();
}

}  // namespace trex
