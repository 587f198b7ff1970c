// A library with the functions of Open Image Denoise 2 that trex calls, for tests. It hands over
// the colours as they are, and fails as the environment's FAKE_OIDN says:
//   version3  is version 3        sick  no device works       gpu   the GPU fails, the CPU works
//   tired     pictures larger than 64 pixels need too much memory
//   flat      all light becomes its mean, as if all of it were noise
//   nan       every second value that comes out is not a number
// Built with FAKE_OIDN_OLD it lacks what version 1 lacks.
#include <cstddef>
#include <cstdlib>
#include <cstring>
#include <map>
#include <string>
#include <vector>

namespace {

constexpr int kCpu = 1, kCuda = 3, kOutOfMemory = 4, kUnsupported = 5;

bool is(const char* what) {
  const char* mode = std::getenv("FAKE_OIDN");
  return mode != nullptr && std::string(mode) == what;
}

struct Device {
  int type = kCuda, error = 0;
  const char* message = nullptr;
};
struct Buffer {
  std::vector<char> bytes;
};
struct Filter {
  Device* device = nullptr;
  std::map<std::string, Buffer*> images;
};

void flatten(Buffer& light) {
  std::vector<float> values(light.bytes.size() / 4);
  std::memcpy(values.data(), light.bytes.data(), light.bytes.size());
  for (std::size_t c = 0; c < 3; ++c) {
    double sum = 0.0;
    for (std::size_t i = c; i < values.size(); i += 3) sum += static_cast<double>(values[i]);
    const auto mean = static_cast<float>(3.0 * sum / static_cast<double>(values.size()));
    for (std::size_t i = c; i < values.size(); i += 3) values[i] = mean;
  }
  std::memcpy(light.bytes.data(), values.data(), light.bytes.size());
}

}  // namespace

extern "C" {

void* oidnNewDevice(int type) {
  auto* device = new Device;
  if (type == kCpu || !is("gpu")) device->type = kCpu;
  return device;
}
void oidnReleaseDevice(void* device) { delete static_cast<Device*>(device); }
void oidnSetDeviceBool(void*, const char*, bool) {}
void oidnSetDeviceInt(void*, const char*, int) {}
int oidnGetDeviceInt(void* device, const char* name) {
  const std::string asked = name;
  if (asked == "type") return static_cast<Device*>(device)->type;
  if (asked == "versionMajor") return is("version3") ? 3 : 2;
  return asked == "versionMinor" ? 9 : 0;
}
int oidnGetDeviceError(void* device, const char** message) {
  auto* d = static_cast<Device*>(device);
  const int error = d->error;
  *message = d->message;
  d->error = 0;
  return error;
}
void oidnCommitDevice(void* device) {
  auto* d = static_cast<Device*>(device);
  if (!is("sick") && !(is("gpu") && d->type == kCuda)) return;
  d->error = kUnsupported;
  d->message = "this device is not well";
}
#ifndef FAKE_OIDN_OLD
int oidnGetNumPhysicalDevices() { return 1; }
int oidnGetPhysicalDeviceInt(int, const char*) { return kCpu; }
const char* oidnGetPhysicalDeviceString(int, const char*) { return "pretended"; }
#endif
void* oidnNewBuffer(void*, std::size_t bytes) { return new Buffer{std::vector<char>(bytes)}; }
void oidnReleaseBuffer(void* buffer) { delete static_cast<Buffer*>(buffer); }
void oidnReadBuffer(void* buffer, std::size_t offset, std::size_t bytes, void* to) {
  std::memcpy(to, static_cast<Buffer*>(buffer)->bytes.data() + offset, bytes);
}
void oidnWriteBuffer(void* buffer, std::size_t offset, std::size_t bytes, const void* from) {
  std::memcpy(static_cast<Buffer*>(buffer)->bytes.data() + offset, from, bytes);
}
void* oidnNewFilter(void* device, const char*) {
  return new Filter{static_cast<Device*>(device), {}};
}
void oidnReleaseFilter(void* filter) { delete static_cast<Filter*>(filter); }
void oidnSetFilterImage(void* filter, const char* name, void* buffer, int, std::size_t, std::size_t,
                        std::size_t, std::size_t, std::size_t) {
  static_cast<Filter*>(filter)->images[name] = static_cast<Buffer*>(buffer);
}
void oidnSetFilterBool(void*, const char*, bool) {}
void oidnSetFilterInt(void*, const char*, int) {}
void oidnCommitFilter(void*) {}
void oidnExecuteFilter(void* filter) {
  auto* f = static_cast<Filter*>(filter);
  Buffer& out = *f->images["output"];
  if (is("tired") && out.bytes.size() > 64 * 64 * 12) {
    f->device->error = kOutOfMemory;
    f->device->message = "out of pretended memory";
    return;
  }
  for (const char* name : {"color", "albedo", "normal"}) {
    if (f->images.count(name) == 0) continue;
    out.bytes = f->images[name]->bytes;
    break;
  }
  if (is("flat")) flatten(out);
  if (!is("nan")) return;
  for (std::size_t i = 0; i + 3 < out.bytes.size(); i += 8) {
    std::memset(out.bytes.data() + i, 0xff, 4);
  }
}

}  // extern "C"
