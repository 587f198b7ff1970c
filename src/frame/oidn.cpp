#include "src/frame/oidn.h"

#include <dlfcn.h>
#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <mutex>
#include <string_view>
#include <utility>

#include "src/core/error.h"
#include "src/core/threads.h"

namespace trex {
namespace {

namespace fs = std::filesystem;

// What is used of its C API, as its manual describes it ("Open Image Denoise API", version 2).
using DeviceHandle = void*;
using BufferHandle = void*;
using FilterHandle = void*;
constexpr int kDefaultDevice = 0, kCpuDevice = 1;
constexpr int kFloat3 = 3;
constexpr int kMajorVersion = 2;
constexpr const char* kLibrary = "libOpenImageDenoise.so.2";
constexpr const char* kGetIt = "scripts/oidn brings version 2.5; --denoise filter does without";

// Of the CPU's device, measured: src/frame/oidn.h.
constexpr int kScratchMegabytes = 512;
constexpr std::uint64_t kLibraryBytes = 64u << 20, kScratchBytesAPixel = 750;
constexpr std::uint64_t kMostScratchBytes = 512u << 20;
constexpr std::uint64_t kImagesAtOnce = 11;

// Filters that are kept between runs: pixels of the largest, and how many.
constexpr std::uint64_t kKeptPixels = 1u << 17;
constexpr std::size_t kMostKept = 4;

struct Api {
  DeviceHandle (*newDevice)(int type);
  void (*releaseDevice)(DeviceHandle);
  void (*setDeviceBool)(DeviceHandle, const char* name, bool value);
  void (*setDeviceInt)(DeviceHandle, const char* name, int value);
  int (*getDeviceInt)(DeviceHandle, const char* name);
  int (*getDeviceError)(DeviceHandle, const char** message);
  void (*commitDevice)(DeviceHandle);
  int (*physicalDevices)();
  int (*physicalInt)(int id, const char* name);
  const char* (*physicalString)(int id, const char* name);
  BufferHandle (*newBuffer)(DeviceHandle, std::size_t bytes);
  void (*releaseBuffer)(BufferHandle);
  void (*readBuffer)(BufferHandle, std::size_t offset, std::size_t bytes, void* to);
  void (*writeBuffer)(BufferHandle, std::size_t offset, std::size_t bytes, const void* from);
  FilterHandle (*newFilter)(DeviceHandle, const char* type);
  void (*releaseFilter)(FilterHandle);
  void (*setFilterImage)(FilterHandle, const char* name, BufferHandle, int format,
                         std::size_t width, std::size_t height, std::size_t offset,
                         std::size_t pixelStride, std::size_t rowStride);
  void (*setFilterBool)(FilterHandle, const char* name, bool value);
  void (*setFilterInt)(FilterHandle, const char* name, int value);
  void (*commitFilter)(FilterHandle);
  void (*executeFilter)(FilterHandle);
};

template <typename Function>
void find(void* library, const std::string& file, const char* name, Function& function) {
  void* const found = dlsym(library, name);
  if (found == nullptr) {
    fail(ExitCode::kMemoryOrDevice, "{}: has no {}: not Open Image Denoise {}; {}", file, name,
         kMajorVersion, kGetIt);
  }
  function = std::bit_cast<Function>(found);
}

Api findApi(void* library, const std::string& file) {
  Api a{};
  const auto get = [&](const char* name, auto& function) { find(library, file, name, function); };
  get("oidnNewDevice", a.newDevice);
  get("oidnReleaseDevice", a.releaseDevice);
  get("oidnSetDeviceBool", a.setDeviceBool);
  get("oidnSetDeviceInt", a.setDeviceInt);
  get("oidnGetDeviceInt", a.getDeviceInt);
  get("oidnGetDeviceError", a.getDeviceError);
  get("oidnCommitDevice", a.commitDevice);
  get("oidnGetNumPhysicalDevices", a.physicalDevices);
  get("oidnGetPhysicalDeviceInt", a.physicalInt);
  get("oidnGetPhysicalDeviceString", a.physicalString);
  get("oidnNewBuffer", a.newBuffer);
  get("oidnReleaseBuffer", a.releaseBuffer);
  get("oidnReadBuffer", a.readBuffer);
  get("oidnWriteBuffer", a.writeBuffer);
  get("oidnNewFilter", a.newFilter);
  get("oidnReleaseFilter", a.releaseFilter);
  get("oidnSetFilterImage", a.setFilterImage);
  get("oidnSetFilterBool", a.setFilterBool);
  get("oidnSetFilterInt", a.setFilterInt);
  get("oidnCommitFilter", a.commitFilter);
  get("oidnExecuteFilter", a.executeFilter);
  return a;
}

std::string deviceTypeName(int type) {
  constexpr const char* kNames[] = {"default", "CPU", "SYCL", "CUDA", "HIP", "Metal"};
  const bool known = type >= 0 && type < static_cast<int>(std::size(kNames));
  return known ? kNames[type] : fmt::format("type {}", type);
}

/// Of light: not negative, and finite.
void clean(std::vector<vec3>& light) {
  for (vec3& v : light) {
    for (int c = 0; c < 3; ++c) v[c] = std::isfinite(v[c]) ? std::max(v[c], 0.0f) : 0.0f;
  }
}

/// Scales what came of `in` so that its sum stays; see denoiseLight().
void keepMean(const std::vector<vec3>& in, std::vector<vec3>& out) {
  constexpr double kMost = 1.1;
  const auto sumOf = [](const std::vector<vec3>& light) {
    double sum = 0.0;
    for (const vec3& v : light) sum += static_cast<double>(v.x + v.y + v.z);
    return sum;
  };
  const double before = sumOf(in);
  if (before == 0.0) return out.assign(out.size(), vec3(0.0f));
  const double scale = before / sumOf(out);
  if (!(scale <= kMost && scale >= 1.0 / kMost)) return;
  for (vec3& v : out) v *= static_cast<float>(scale);
}

/// Its networks see hardly anything of a picture smaller than this: its edges are repeated then.
constexpr std::uint32_t kLeastSide = 32;

/// A picture of another size: its edges repeated, or what lies beyond cut off.
std::vector<vec3> resized(const std::vector<vec3>& from, std::uint32_t width, std::uint32_t height,
                          std::uint32_t toWidth, std::uint32_t toHeight) {
  std::vector<vec3> out;
  out.reserve(std::size_t{toWidth} * toHeight);
  for (std::uint32_t y = 0; y < toHeight; ++y) {
    const std::size_t row = std::size_t{std::min(y, height - 1)} * width;
    for (std::uint32_t x = 0; x < toWidth; ++x) out.push_back(from[row + std::min(x, width - 1)]);
  }
  return out;
}

/// By their names; the first is what is filtered.
using Images = std::vector<std::pair<const char*, const std::vector<vec3>*>>;

}  // namespace

struct Oidn::Impl {
  /// A filter with its images, ready to run.
  struct Ready {
    struct Release {
      void (*release)(void*);
      void operator()(void* p) const { release(p); }
    };
    using Handle = std::unique_ptr<void, Release>;
    std::uint32_t width, height;
    std::string names;  ///< of its images
    bool light, cleanGuides;
    OidnQuality quality;
    std::vector<Handle> buffers{};  ///< of what goes in, then of what comes out
    Handle filter{nullptr, {nullptr}};

    bool isLike(const Ready& o) const {
      return width == o.width && height == o.height && names == o.names && light == o.light &&
             cleanGuides == o.cleanGuides && quality == o.quality;
    }
    std::size_t bytes() const { return std::size_t{width} * height * sizeof(vec3); }
  };

  Api api{};
  DeviceHandle handle = nullptr;
  std::string file, version, device;
  mutable std::mutex running;
  mutable std::vector<Ready> kept;  ///< the one that ran last comes last

  void open();
  bool start(int type, std::string& problem);
  std::string nameOf(int type) const;
  void check() const;
  void make(Ready& ready, const Images& in) const;
  const Ready& find(std::uint32_t width, std::uint32_t height, const Images& in, bool light,
                    bool cleanGuides, OidnQuality quality) const;
  std::vector<vec3> run(std::uint32_t width, std::uint32_t height, const Images& in, bool light,
                        bool cleanGuides, OidnQuality quality) const;
  std::vector<vec3> filter(std::uint32_t width, std::uint32_t height, const Images& in, bool light,
                           bool cleanGuides, OidnQuality quality) const;
  void release() {
    kept.clear();
    if (handle != nullptr) api.releaseDevice(handle);
    handle = nullptr;
  }
};

/// The library stays open: code of its threads may be running.
void Oidn::Impl::open() {
  void* const library = dlopen(file.c_str(), RTLD_NOW | RTLD_LOCAL);
  if (library == nullptr) {
    fail(ExitCode::kMemoryOrDevice, "Open Image Denoise can't be opened ({}): {}",
         oneLine(dlerror()), kGetIt);
  }
  api = findApi(library, file);
  std::string best, problem;
  // A GPU is taken for the best until it fails.
  if (start(kDefaultDevice, best) || start(kCpuDevice, problem)) return;
  fail(ExitCode::kMemoryOrDevice, "{}: no device of it works: {}; {}", file,
       problem.empty() ? best : problem, kGetIt);
}

/// True if a device of this type filters a small picture.
bool Oidn::Impl::start(int type, std::string& problem) {
  constexpr std::uint32_t kSide = 16;
  try {
    handle = api.newDevice(type);
    check();
    if (handle == nullptr) fail(ExitCode::kMemoryOrDevice, "no {} device", deviceTypeName(type));
    const int found = api.getDeviceInt(handle, "type");
    const int major = api.getDeviceInt(handle, "versionMajor");
    version = fmt::format("{}.{}.{}", major, api.getDeviceInt(handle, "versionMinor"),
                          api.getDeviceInt(handle, "versionPatch"));
    if (major != kMajorVersion) {
      fail(ExitCode::kMemoryOrDevice, "is version {}, wanted is {}", version, kMajorVersion);
    }
    if (found == kCpuDevice) {
      // Threads belong to oneTBB, whose other work must not be bound to cores.
      api.setDeviceBool(handle, "setAffinity", false);
      api.setDeviceInt(handle, "numThreads", threadsAllowed());
    }
    api.commitDevice(handle);
    check();
    device = nameOf(found);
    const std::vector<vec3> grey(kSide * kSide, vec3(0.5f));
    filter(kSide, kSide, {{"color", &grey}}, true, false, OidnQuality::kFast);
    return true;
  } catch (const Error& e) {
    problem = e.what();
    release();
    return false;
  }
}

std::string Oidn::Impl::nameOf(int type) const {
  for (int i = 0; i < api.physicalDevices(); ++i) {
    if (api.physicalInt(i, "type") != type) continue;
    const char* const name = api.physicalString(i, "name");
    if (name != nullptr && *name != '\0') return fmt::format("{}, {}", deviceTypeName(type), name);
  }
  return deviceTypeName(type);
}

void Oidn::Impl::check() const {
  const char* message = nullptr;
  const int code = api.getDeviceError(handle, &message);
  if (code == 0) return;
  fail(ExitCode::kMemoryOrDevice, "Open Image Denoise, {}: {}",
       device.empty() ? "starting" : device,
       message != nullptr ? oneLine(message) : fmt::format("error {}", code));
}

/// Buffers of the library are used everywhere: not every GPU reads the host's memory.
void Oidn::Impl::make(Ready& ready, const Images& in) const {
  ready.filter = {api.newFilter(handle, "RT"), {api.releaseFilter}};
  check();
  const auto bind = [&](const char* name) {
    ready.buffers.push_back({api.newBuffer(handle, ready.bytes()), {api.releaseBuffer}});
    check();
    api.setFilterImage(ready.filter.get(), name, ready.buffers.back().get(), kFloat3, ready.width,
                       ready.height, 0, 0, 0);
  };
  for (const auto& image : in) bind(image.first);
  bind("output");
  if (ready.light) api.setFilterBool(ready.filter.get(), "hdr", true);
  api.setFilterBool(ready.filter.get(), "cleanAux", ready.cleanGuides);
  api.setFilterInt(ready.filter.get(), "quality", static_cast<int>(ready.quality));
  api.setFilterInt(ready.filter.get(), "maxMemoryMB", kScratchMegabytes);
  api.commitFilter(ready.filter.get());
  check();
}

/// One that is kept, or a new one in the place of what ran longest ago. Of large pictures none is
/// kept: they take memory, and seconds beside which the making is nothing.
const Oidn::Impl::Ready& Oidn::Impl::find(std::uint32_t width, std::uint32_t height,
                                          const Images& in, bool light, bool cleanGuides,
                                          OidnQuality quality) const {
  Ready wanted{width, height, {}, light, cleanGuides, quality};
  for (const auto& image : in) wanted.names += fmt::format("{} ", image.first);
  const auto at =
      std::find_if(kept.begin(), kept.end(), [&](const Ready& r) { return r.isLike(wanted); });
  if (at != kept.end()) {
    std::rotate(at, at + 1, kept.end());
    return kept.back();
  }
  const bool small = std::uint64_t{width} * height <= kKeptPixels;
  if (!small) kept.clear();
  if (kept.size() == kMostKept) kept.erase(kept.begin());
  make(wanted, in);
  kept.push_back(std::move(wanted));
  return kept.back();
}

/// One run of its filter.
std::vector<vec3> Oidn::Impl::run(std::uint32_t width, std::uint32_t height, const Images& in,
                                  bool light, bool cleanGuides, OidnQuality quality) const {
  const std::lock_guard lock(running);
  try {
    const Ready& ready = find(width, height, in, light, cleanGuides, quality);
    for (std::size_t i = 0; i < in.size(); ++i) {
      api.writeBuffer(ready.buffers[i].get(), 0, ready.bytes(), in[i].second->data());
    }
    api.executeFilter(ready.filter.get());
    check();
    std::vector<vec3> out(std::size_t{width} * height);
    api.readBuffer(ready.buffers.back().get(), 0, ready.bytes(), out.data());
    check();
    if (std::uint64_t{width} * height > kKeptPixels) kept.clear();
    return out;
  } catch (const Error&) {
    kept.clear();  // who knows what is left of them
    throw;
  }
}

std::vector<vec3> Oidn::Impl::filter(std::uint32_t width, std::uint32_t height, const Images& in,
                                     bool light, bool cleanGuides, OidnQuality quality) const {
  const std::uint32_t w = std::max(width, kLeastSide), h = std::max(height, kLeastSide);
  if (w == width && h == height) return run(w, h, in, light, cleanGuides, quality);
  std::vector<std::vector<vec3>> larger;
  larger.reserve(in.size());
  Images images;
  for (const auto& [name, image] : in) {
    larger.push_back(resized(*image, width, height, w, h));
    images.emplace_back(name, &larger.back());
  }
  return resized(run(w, h, images, light, cleanGuides, quality), w, h, width, height);
}

Oidn::Oidn(const std::string& file) : impl_(std::make_unique<Impl>()) {
  impl_->file = file;
  impl_->open();
}

Oidn::~Oidn() { impl_->release(); }

const std::string& Oidn::file() const { return impl_->file; }
const std::string& Oidn::version() const { return impl_->version; }
const std::string& Oidn::device() const { return impl_->device; }

void Oidn::smooth(OidnGuides& guides, OidnQuality quality) const {
  const auto one = [&](const char* name, std::vector<vec3>& image) {
    if (image.empty()) return;
    image = impl_->filter(guides.width, guides.height, {{name, &image}}, false, false, quality);
  };
  one("albedo", guides.albedo);
  one("normal", guides.normal);
  guides.smooth = true;
}

std::vector<vec3> Oidn::denoise(const OidnGuides& guides, const std::vector<vec3>& light,
                                OidnQuality quality) const {
  std::vector<vec3> in = light;
  clean(in);
  Images images{{"color", &in}};
  // Of its networks none takes a normal without an albedo.
  if (!guides.albedo.empty()) {
    images.emplace_back("albedo", &guides.albedo);
    if (!guides.normal.empty()) images.emplace_back("normal", &guides.normal);
  }
  std::vector<vec3> out =
      impl_->filter(guides.width, guides.height, images, true, guides.smooth, quality);
  clean(out);
  return out;
}

void Oidn::prepare(std::uint32_t width, std::uint32_t height, bool cleanGuides,
                   OidnQuality quality) const {
  if (std::uint64_t{width} * height > kKeptPixels) return;
  const std::lock_guard lock(impl_->running);
  impl_->find(std::max(width, kLeastSide), std::max(height, kLeastSide),
              {{"color", nullptr}, {"albedo", nullptr}, {"normal", nullptr}}, true, cleanGuides,
              quality);
}

std::uint64_t Oidn::bytesNeeded(std::uint32_t width, std::uint32_t height) {
  const std::uint64_t pixels = std::uint64_t{width} * height;
  return kLibraryBytes + std::min(pixels * kScratchBytesAPixel, kMostScratchBytes) +
         pixels * kImagesAtOnce * sizeof(vec3);
}

std::vector<vec3> denoiseLight(const Oidn& library, OidnGuides guides,
                               const std::vector<std::vector<vec3>>& parts, bool thorough) {
  if (thorough && !guides.smooth) library.smooth(guides, OidnQuality::kFast);
  guides.smooth = thorough;  // the other network copes with what noise there is left
  std::vector<vec3> sum;
  for (const std::vector<vec3>& part : parts) {
    std::vector<vec3> light =
        library.denoise(guides, part, thorough ? OidnQuality::kHigh : OidnQuality::kBalanced);
    keepMean(part, light);
    if (sum.empty()) {
      sum = std::move(light);
    } else {
      for (std::size_t i = 0; i < sum.size(); ++i) sum[i] += light[i];
    }
  }
  return sum;
}

void prepareLight(const Oidn& library, std::uint32_t width, std::uint32_t height) {
  library.prepare(width, height, false, OidnQuality::kBalanced);
  library.prepare(width, height, true, OidnQuality::kHigh);
}

std::vector<std::string> oidnPlaces() {
  if (const char* named = std::getenv("TREX_OIDN"); named != nullptr && *named != '\0') {
    if (std::string_view(named) == "none") return {};
    return {named};
  }
  const char *data = std::getenv("XDG_DATA_HOME"), *home = std::getenv("HOME");
  fs::path folder;
  if (data != nullptr && *data == '/') {  // the XDG specification: others are to be ignored
    folder = data;
  } else if (home != nullptr && *home != '\0') {
    folder = fs::path(home) / ".local/share";
  }
  std::error_code error;
  const fs::path brought = folder / "trex/oidn/lib" / kLibrary;
  if (!folder.empty() && fs::exists(brought, error)) return {brought.string(), kLibrary};
  return {kLibrary};
}

OidnSearch searchOidn(const std::vector<std::string>& places) {
  OidnSearch s;
  s.problem = fmt::format("Open Image Denoise is not wanted (TREX_OIDN); {}", kGetIt);
  for (const std::string& place : places) {
    // A system need not have one.
    s.broken = place != kLibrary || dlopen(kLibrary, RTLD_LAZY | RTLD_LOCAL) != nullptr;
    try {
      s.library = std::make_shared<const Oidn>(place);
      break;
    } catch (const Error& e) {
      s.problem = e.what();
    }
    if (s.broken) break;
  }
  return s;
}

const OidnSearch& findOidn() {
  // Never released: at the end of the program the driver of a GPU may be gone before.
  static const OidnSearch* const search = new OidnSearch(searchOidn(oidnPlaces()));
  return *search;
}

}  // namespace trex
