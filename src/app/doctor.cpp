// trex doctor: what this machine offers, and what to do about what is missing.
#include <embree3/rtcore.h>
#include <fmt/format.h>
#include <sys/resource.h>
#include <tbb/info.h>
#include <tbb/version.h>
#include <unistd.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>

#include "hccmesh/hccmesh.h"
#include "src/app/app.h"
#include "src/app/doctor_measure.h"
#include "src/command/kept_record.h"
#include "src/core/error.h"
#include "src/core/memory.h"
#include "src/core/version.h"
#include "src/frame/oidn.h"
#include "src/images/image_library.h"
#include "src/machines/mpi_wire.h"
#include "src/vulkan/vulkan.h"

namespace trex {
namespace {

/// A small picture of a small model takes about half of this, measured.
constexpr std::uint64_t kLeastMemory = 256ull << 20;
constexpr std::uint64_t kLeastDisk = 64ull << 20;
/// Voxels of the default depth, sums of photons and batches of cones.
constexpr std::uint64_t kLeastDeviceMemory = 512ull << 20;

struct Memory {
  std::uint64_t physical = 0, available = 0;  ///< bytes
  std::optional<std::uint64_t> cgroupLimit, addressLimit;
};

struct Disk {
  const char* use;
  std::string folder;
  std::uint64_t freeBytes = 0;
  bool writable = false;
};

/// What --denoise auto takes.
struct Denoising {
  std::string library, version, device;  ///< of Open Image Denoise; empty if there is none
  std::string problem;                   ///< why there is none
};

struct Findings {
  std::vector<std::pair<std::string, std::string>> libraries;  ///< name, version
  std::vector<vulkan::DeviceInfo> devices;
  int chosen = -1;  ///< the device of `--device auto`
  Memory memory;
  std::vector<Disk> disks;
  std::string display;  ///< "DISPLAY=:0", or empty
  std::string simdTarget;
  Denoising denoising;
  std::optional<schedule::MachineRecord> measured;
  std::string problem;                ///< of G-rays; empty if a device can be used
  std::vector<std::string> problems;  ///< all, each with what to do
  std::string fatal;                  ///< why nothing can be rendered; empty if something can
};

void examineDevices(Findings& found) {
  try {
    found.libraries.emplace_back("Vulkan loader", vulkan::loaderVersion());
    found.devices = vulkan::listDevices();
    // Starting one tells more than asking for its limits.
    const vulkan::Device device({});
    found.chosen = device.info().index;
    if (device.info().heapBytes < kLeastDeviceMemory) {
      found.problems.push_back(fmt::format(
          "{} has only {} of memory: voxels may be coarser; choose another --device N, or use "
          "--device none",
          device.info().name, formatBytes(device.info().heapBytes)));
    }
  } catch (const Error& e) {
    found.problem = e.what();
    found.problems.push_back(found.problem);
  }
}

std::string versionText(long major, long minor, long patch) {
  return fmt::format("{}.{}.{}", major, minor, patch);
}

void examineLibraries(Findings& found) {
  RTCDevice embree = rtcNewDevice(nullptr);
  if (embree == nullptr) {
    if (found.fatal.empty()) found.fatal = "Embree does not start: reinstall libembree3-3";
    return;
  }
  const auto version = rtcGetDeviceProperty(embree, RTC_DEVICE_PROPERTY_VERSION);
  rtcReleaseDevice(embree);
  found.libraries.emplace_back("Embree",
                               versionText(version / 10000, version / 100 % 100, version % 100));
  try {
    const int images = imageLibrary().version;
    found.libraries.emplace_back("OpenImageIO",
                                 versionText(images / 10000, images / 100 % 100, images % 100));
  } catch (const Error& e) {
    found.problems.emplace_back(e.what());
  }
  if (machines::hasMpi()) {
    try {
      found.libraries.emplace_back("MPI", machines::mpiLibrary());
    } catch (const Error& e) {
      found.problems.emplace_back(e.what());
    }
  }
  found.libraries.emplace_back("oneTBB", TBB_runtime_version());
  found.libraries.emplace_back(
      "GLM", versionText(GLM_VERSION_MAJOR, GLM_VERSION_MINOR, GLM_VERSION_PATCH));
  found.libraries.emplace_back(
      "fmt", versionText(FMT_VERSION / 10000, FMT_VERSION / 100 % 100, FMT_VERSION % 100));
  found.simdTarget = hccm::Mesh::build({}).targetName();
}

/// A number in kB behind a key of a file like /proc/meminfo, as bytes; 0 if there is none.
std::uint64_t procBytes(const char* path, const std::string& key) {
  std::ifstream file(path);
  std::string word;
  std::uint64_t value = 0;
  while (file >> word) {
    if (word == key && file >> value) return value * 1024;
  }
  return 0;
}

void examineMemory(Findings& found) {
  Memory& m = found.memory;
  m.physical = static_cast<std::uint64_t>(sysconf(_SC_PHYS_PAGES)) *
               static_cast<std::uint64_t>(sysconf(_SC_PAGE_SIZE));
  const std::uint64_t limit = availableMemoryLimit();
  if (limit < m.physical) m.cgroupLimit = limit;
  m.available = std::min(procBytes("/proc/meminfo", "MemAvailable:"), limit);
  rlimit address{};
  if (getrlimit(RLIMIT_AS, &address) == 0 && address.rlim_cur != RLIM_INFINITY) {
    m.addressLimit = address.rlim_cur;
    const std::uint64_t used = procBytes("/proc/self/status", "VmSize:");
    m.available = std::min<std::uint64_t>(
        m.available, address.rlim_cur - std::min<std::uint64_t>(used, *m.addressLimit));
  }
  if (m.available < kLeastMemory) {
    found.fatal = fmt::format(
        "only {} of memory are available, {} are needed for a small picture: end other programs, "
        "or raise the limit (ulimit -v, cgroup)",
        formatBytes(m.available), formatBytes(kLeastMemory));
  }
}

void examineDisk(Findings& found, const char* use, const std::filesystem::path& folder) {
  std::error_code error;
  Disk disk{use, folder.string()};
  const std::filesystem::space_info space = std::filesystem::space(folder, error);
  if (!error) disk.freeBytes = space.available;
  disk.writable = access(folder.c_str(), W_OK) == 0;
  if (!disk.writable) {
    found.problems.push_back(fmt::format("{} can't be written to: {}", disk.folder,
                                         std::string_view(use) == "current"
                                             ? "give -o in another folder"
                                             : "set TMPDIR to another folder"));
  } else if (disk.freeBytes < kLeastDisk) {
    found.problems.push_back(
        fmt::format("{} has only {} free: make room", disk.folder, formatBytes(disk.freeBytes)));
  }
  found.disks.push_back(std::move(disk));
}

void examineDenoiser(Findings& found) {
  const OidnSearch& search = findOidn();
  if (search.library) {
    found.denoising = {search.library->file(), search.library->version(), search.library->device(),
                       ""};
    return;
  }
  found.denoising.problem = search.problem;
  if (search.broken) found.problems.push_back(search.problem);
}

/// What was measured before.
void examineRecord(Findings& found) {
  try {
    found.measured = keptMachineRecord();
  } catch (const Error& e) {
    found.problems.emplace_back(e.what());
  }
}

Findings examine() {
  Findings found;
  examineMemory(found);
  examineLibraries(found);
  examineDevices(found);
  examineRecord(found);
  examineDenoiser(found);
  std::error_code error;
  const std::filesystem::path current = std::filesystem::current_path(error);
  examineDisk(found, "current", error ? "." : current);
  const char* temporary = std::getenv("TMPDIR");
  examineDisk(found, "temporary", temporary && *temporary ? temporary : "/tmp");
  for (const char* name : {"WAYLAND_DISPLAY", "DISPLAY"}) {
    const char* value = std::getenv(name);
    if (value != nullptr && *value != '\0') found.display = fmt::format("{}={}", name, value);
  }
  if (!found.fatal.empty()) found.problems.insert(found.problems.begin(), found.fatal);
  return found;
}

nlohmann::json toJson(const vulkan::DeviceInfo& d) {
  return {{"index", d.index},
          {"name", d.name},
          {"type", d.type},
          {"driver", d.driver},
          {"api_version", d.apiVersion},
          {"unusable", d.unusable},
          {"shares_host_cores", d.sharesHostCores},
          {"mapped_memory", d.mappedMemory},
          {"heap_bytes", d.heapBytes},
          {"max_storage_buffer_range_bytes", d.maxStorageBufferRange},
          {"max_allocation_bytes", d.maxAllocationBytes},
          {"max_texel_buffer_elements", d.maxTexelBufferElements},
          {"max_workgroup_invocations", d.maxWorkgroupInvocations},
          {"max_workgroup_count", d.maxWorkgroupCount},
          {"shared_memory_bytes", d.sharedMemoryBytes},
          {"subgroup_size", d.subgroupSize},
          {"int64", d.int64},
          {"int64_atomics", d.int64Atomics}};
}

nlohmann::json orNull(const std::optional<std::uint64_t>& value) {
  return value ? nlohmann::json(*value) : nlohmann::json(nullptr);
}

nlohmann::json toJson(const Findings& found) {
  nlohmann::json out = {
      {"version", kVersion},
      {"threads", tbb::info::default_concurrency()},
      {"simd_target", found.simdTarget},
      {"memory_bytes", availableMemoryLimit()},
      {"physical_memory_bytes", found.memory.physical},
      {"cgroup_limit_bytes", orNull(found.memory.cgroupLimit)},
      {"address_limit_bytes", orNull(found.memory.addressLimit)},
      {"available_memory_bytes", found.memory.available},
      {"display", found.display},
      {"default_device", found.chosen < 0 ? nlohmann::json(nullptr) : nlohmann::json(found.chosen)},
      {"can_render", found.fatal.empty()},
      {"problem", found.problem},
      {"problems", found.problems}};
  const Denoising& denoising = found.denoising;
  out["denoiser"] = {{"default", denoising.library.empty() ? "filter" : "oidn"},
                     {"library", denoising.library},
                     {"version", denoising.version},
                     {"device", denoising.device},
                     {"problem", denoising.problem}};
  out["libraries"] = nlohmann::json::array();
  for (const auto& [name, version] : found.libraries) {
    out["libraries"].push_back({{"name", name}, {"version", version}});
  }
  out["disks"] = nlohmann::json::array();
  for (const Disk& d : found.disks) {
    out["disks"].push_back({{"use", d.use},
                            {"folder", d.folder},
                            {"free_bytes", d.freeBytes},
                            {"writable", d.writable}});
  }
  out["measured"] = nullptr;
  if (found.measured) out["measured"] = nlohmann::json::parse(textOf(*found.measured));
  out["devices"] = nlohmann::json::array();
  for (const vulkan::DeviceInfo& d : found.devices) out["devices"].push_back(toJson(d));
  return out;
}

void print(const vulkan::DeviceInfo& d, bool chosen) {
  fmt::print("device {}: {} ({}, {}, Vulkan {}){}\n", d.index, d.name, d.type, d.driver,
             d.apiVersion, chosen ? ", the default" : "");
  if (!d.unusable.empty()) {
    fmt::print("  can't be used: {}\n", d.unusable);
    return;
  }
  fmt::print("  memory {}, an allocation {}, a storage buffer {}, a texel buffer {} elements\n",
             formatBytes(d.heapBytes), formatBytes(d.maxAllocationBytes),
             formatBytes(d.maxStorageBufferRange), d.maxTexelBufferElements);
  fmt::print("  workgroup {}, shared memory {}, subgroup {}, 64-bit integers {}\n",
             d.maxWorkgroupInvocations, formatBytes(d.sharedMemoryBytes), d.subgroupSize,
             d.int64 ? "yes" : "no (not needed)");
}

void print(const Findings& found) {
  fmt::print("trex {}\nCPU: {} threads, meshes traced with {}\n", kVersion,
             tbb::info::default_concurrency(), found.simdTarget.empty() ? "?" : found.simdTarget);
  const Memory& m = found.memory;
  fmt::print("memory: {} physical, {} available{}{}\n", formatBytes(m.physical),
             formatBytes(m.available),
             m.cgroupLimit ? ", limit of the cgroup " + formatBytes(*m.cgroupLimit) : "",
             m.addressLimit ? ", limit of addresses " + formatBytes(*m.addressLimit) : "");
  for (const Disk& d : found.disks) {
    fmt::print("{} folder: {}, {} free\n", d.use, d.folder, formatBytes(d.freeBytes));
  }
  fmt::print("display: {}\n",
             found.display.empty() ? "none (nothing but a viewer needs one)" : found.display);
  std::string libraries;
  for (const auto& [name, version] : found.libraries) {
    libraries += fmt::format("{}{} {}", libraries.empty() ? "" : ", ", name, version);
  }
  fmt::print("libraries: {}\n", libraries);
  const Denoising& denoising = found.denoising;
  if (denoising.library.empty()) {
    fmt::print("denoiser: the filter; {}\n", denoising.problem);
  } else {
    fmt::print("denoiser: Open Image Denoise {} on {} ({})\n", denoising.version, denoising.device,
               denoising.library);
  }
  for (const vulkan::DeviceInfo& d : found.devices) print(d, d.index == found.chosen);
  if (found.measured) printRecord(*found.measured);
  if (found.fatal.empty()) {
    fmt::print("C-rays and --exact 1 work\n{}\n",
               found.problem.empty()
                   ? "G-rays work"
                   : "G-rays work on the CPU alone: --device auto is --device none");
  }
  for (const std::string& problem : found.problems) fmt::print("problem: {}\n", problem);
}

struct DoctorArguments {
  bool json = false, measure = false;
  std::string picture;
};

void doctor(const DoctorArguments& a) {
  if (!a.picture.empty() && !a.measure) {
    fail(ExitCode::kUsage, "-o: draws what --measure measures; give it too");
  }
  if (a.measure) measureAndKeep(a.picture);
  const Findings found = examine();
  if (a.json) {
    fmt::print("{}\n", toJson(found).dump(2));
  } else {
    print(found);
  }
  std::fflush(stdout);
  if (!found.fatal.empty()) {
    fail(ExitCode::kMemoryOrDevice, "nothing can be rendered here: {}", found.fatal);
  }
}

}  // namespace

void addDoctorCommand(CLI::App& app) {
  auto a = std::make_shared<DoctorArguments>();
  CLI::App* c = app.add_subcommand("doctor", "Tell what this machine offers and what is missing");
  c->add_flag("--json", a->json, "Print JSON on stdout");
  c->add_flag(
      "--measure", a->measure,
      "Measure disk, copies, rays, cones and photons for some seconds, and keep the figures");
  c->add_option("-o,--output", a->picture, "With --measure: draw the device graph, FILE.svg");
  c->callback([a] { doctor(*a); });
}

}  // namespace trex
