// trex doctor: what this machine offers, and what to do about what is missing.
#include <fmt/format.h>
#include <tbb/info.h>

#include <memory>
#include <nlohmann/json.hpp>

#include "src/app/app.h"
#include "src/core/error.h"
#include "src/core/memory.h"
#include "src/core/version.h"
#include "src/vulkan/vulkan.h"

namespace trex {
namespace {

struct Findings {
  std::vector<vulkan::DeviceInfo> devices;
  std::string problem;  ///< empty if a device can be used
};

Findings examine() {
  Findings found;
  try {
    found.devices = vulkan::listDevices();
  } catch (const Error& e) {
    found.problem = e.what();
    return found;
  }
  bool usable = false;
  for (const vulkan::DeviceInfo& d : found.devices) usable |= d.unusable.empty();
  if (!usable) {
    found.problem =
        "no usable Vulkan device; install mesa-vulkan-drivers, or render with --device none";
  }
  return found;
}

nlohmann::json describe(const vulkan::DeviceInfo& d) {
  return {{"index", d.index},
          {"name", d.name},
          {"type", d.type},
          {"driver", d.driver},
          {"api_version", d.apiVersion},
          {"unusable", d.unusable},
          {"shares_host_cores", d.sharesHostCores},
          {"max_storage_buffer_range_bytes", d.maxStorageBufferRange},
          {"heap_bytes", d.heapBytes}};
}

void doctor(bool json) {
  const Findings found = examine();
  if (json) {
    nlohmann::json out = {{"version", kVersion},
                          {"threads", tbb::info::default_concurrency()},
                          {"memory_bytes", availableMemoryLimit()},
                          {"devices", nlohmann::json::array()},
                          {"problem", found.problem}};
    for (const vulkan::DeviceInfo& d : found.devices) out["devices"].push_back(describe(d));
    fmt::print("{}\n", out.dump(2));
    return;
  }
  fmt::print("trex {}\nCPU: {} threads, {} of memory; C-rays and exact mode work\n", kVersion,
             tbb::info::default_concurrency(), formatBytes(availableMemoryLimit()));
  for (const vulkan::DeviceInfo& d : found.devices) {
    fmt::print("device {}: {} ({}, {}, Vulkan {}), {} of memory, {} a buffer{}\n", d.index, d.name,
               d.type, d.driver, d.apiVersion, formatBytes(d.heapBytes),
               formatBytes(d.maxStorageBufferRange),
               d.unusable.empty() ? "" : "; can't be used: " + d.unusable);
  }
  if (found.problem.empty()) {
    fmt::print("G-rays work\n");
  } else {
    fmt::print("G-rays: {}\n", found.problem);
  }
}

}  // namespace

void addDoctorCommand(CLI::App& app) {
  auto json = std::make_shared<bool>(false);
  CLI::App* c = app.add_subcommand("doctor", "Tell what this machine offers and what is missing");
  c->add_flag("--json", *json, "Print JSON on stdout");
  c->callback([json] { doctor(*json); });
}

}  // namespace trex
