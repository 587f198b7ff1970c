// Vulkan compute in five classes: Device, Buffer, Kernel, Bindings, Batch. Vulkan 1.2 core, 32-bit
// integers, storage buffers; nothing else is asked of a device. No vulkan.h is needed by users.
//
//   vulkan::Device device({});                                        // the best there is
//   vulkan::Buffer data(device, "data", 1024, vulkan::Place::kDevice);
//   vulkan::Kernel kernel(device, {.name = "double", .spirv = kSpirv, .bindings = 1});
//   vulkan::Bindings bindings(device, kernel, std::array<const vulkan::Buffer*, 1>{&data});
//   vulkan::Batch batch(device);
//   batch.dispatch(kernel, bindings, pushConstants, 4); batch.submit(); batch.wait();
//
// Every failure is an Error(kMemoryOrDevice) that names the device, what was asked of it, and
// `--device none`. Objects keep the Device by reference: it must outlive them.
//
// Thread safety: listDevices() and the validation counter are thread safe; a Device and all made
// from it belong to one thread at a time. Work submitted by a Batch goes on beside the caller.
//
// Environment: TREX_VALIDATION=1 turns on VK_LAYER_KHRONOS_validation with its synchronisation
// checks; every message goes to stderr and into validationMessages(). TREX_FAIL_SUBMIT=n: as
// DeviceOptions::failSubmit, for tests of whole programs.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <thread>
#include <vector>

namespace trex::vulkan {

/// A physical device and the limits that matter to a tracer of voxels.
struct DeviceInfo {
  int index = -1;                ///< number for `--device`: order of enumeration
  std::string name;              ///< "llvmpipe (LLVM 15.0.6, 256 bits)"
  std::string type;              ///< "discrete", "integrated", "virtual", "cpu", "other"
  std::string driver;            ///< "llvmpipe Mesa 22.3.6"
  std::string apiVersion;        ///< "1.3.230"
  std::string unusable;          ///< why it cannot be used; empty if it can
  bool sharesHostCores = false;  ///< a software device: it computes on the host's own cores
  bool mappedMemory = false;     ///< device memory is host visible: no staging copies
  std::uint64_t heapBytes = 0;   ///< largest device-local heap
  std::uint64_t maxStorageBufferRange = 0, maxAllocationBytes = 0;  ///< bytes
  std::uint64_t maxTexelBufferElements = 0;
  std::uint32_t maxWorkgroupInvocations = 0, maxWorkgroupCount = 0;
  std::uint32_t sharedMemoryBytes = 0, subgroupSize = 0;
  bool int64 = false, int64Atomics = false, sparse = false;  ///< to report; none is used
};

/// All devices in order of enumeration; empty if there is none. Throws if the loader is missing or
/// if TREX_VALIDATION asks for a layer that is not installed.
std::vector<DeviceInfo> listDevices();

/// Highest version of Vulkan that the loader speaks, "1.3.239". Throws if the loader is missing.
std::string loaderVersion();

/// Messages of the validation layer in this process so far (warnings and errors).
std::uint64_t validationMessages();

struct DeviceOptions {
  int index = -1;                           ///< -1: discrete > integrated > virtual > cpu
  std::uint64_t maxBytes = 0;               ///< `--max-gpu-memory`; 0: the heap's size
  std::uint64_t maxStorageBufferRange = 0;  ///< lowers the device's limit (tests); 0: its own
  bool forceStaging = false;                ///< treat device memory as not host visible (tests)
  /// Failures to simulate (tests): from the n-th call on, counted from 1; 0: none. Allocations end
  /// in "out of device memory", submits and waits in "device lost".
  std::uint64_t failAllocation = 0, failSubmit = 0, failWait = 0;
};

/// Seconds spent on starting, for reports.
struct StartTimes {
  double instance = 0.0, device = 0.0, kernels = 0.0;
};

class Instance;

/// Loads the drivers in a thread of its own from now on, which takes a tenth of a second, so that
/// the first Device need not wait. What fails is left for the Device to tell. The end waits for the
/// thread, and keeps the drivers until then.
class DriversAhead {
 public:
  DriversAhead();
  DriversAhead(const DriversAhead&) = delete;
  DriversAhead& operator=(const DriversAhead&) = delete;

 private:
  std::shared_ptr<Instance> instance_;
  std::jthread loading_;  // ends before what it writes to
};

class Device {
 public:
  explicit Device(const DeviceOptions& options);
  ~Device();
  Device(const Device&) = delete;
  Device& operator=(const Device&) = delete;

  const DeviceInfo& info() const;
  std::uint64_t allocatedBytes() const;
  /// Bytes that buffers may take in all: the heap's size or `--max-gpu-memory`.
  std::uint64_t maxBytes() const;
  StartTimes startTimes() const;
  /// Waits until the device is idle.
  void waitIdle();

  struct Impl;
  Impl& impl() const { return *impl_; }

 private:
  std::unique_ptr<Impl> impl_;
};

enum class Place {
  kDevice,  ///< fast for the device; mapped if its memory is host visible
  kHost,    ///< mapped always: queries in, results out
};

/// A storage buffer with memory of its own. Contents are undefined at first.
class Buffer {
 public:
  /// Throws before allocating if bytes exceed the device's storage buffer range or what is left of
  /// its memory; `name` is the buffer in that message ("photon sums").
  Buffer(Device& device, const std::string& name, std::uint64_t bytes, Place place);
  ~Buffer();
  Buffer(const Buffer&) = delete;
  Buffer& operator=(const Buffer&) = delete;

  std::uint64_t size() const;  ///< bytes as asked for, at least 16
  /// The memory itself if host visible, else null. Writes before submit() are seen by the device,
  /// device writes are seen after wait().
  std::byte* mapped() const;
  /// Copies at a byte offset; through a staging buffer where memory is not mapped. The buffer must
  /// not be in use by a batch under way. Asserts that the range is inside.
  void upload(std::span<const std::byte> bytes, std::uint64_t offset = 0);
  void download(std::span<std::byte> bytes, std::uint64_t offset = 0) const;
  /// Sets every byte to zero.
  void clear();

  struct Impl;
  const Impl& impl() const { return *impl_; }

 private:
  void release();
  std::unique_ptr<Impl> impl_;
};

struct KernelOptions {
  std::string name;                      ///< for messages
  std::span<const std::uint32_t> spirv;  ///< compute shader, entry point "main"
  std::uint32_t bindings = 0;            ///< buffers at set 0, bindings 0 to bindings - 1
  /// 32-bit words an element (1, 2 or 4) of each of the first bindings, which are uniform texel
  /// buffers of unsigned integers; the others are storage buffers.
  std::vector<std::uint32_t> texelWords;
  std::uint32_t pushBytes = 0;           ///< at most 128
  std::vector<std::uint32_t> constants;  ///< specialisation constants 0, 1, ...
};

/// A compute pipeline. Making one may take 100 ms on a software device: make it when first needed.
class Kernel {
 public:
  Kernel(Device& device, const KernelOptions& options);
  ~Kernel();
  Kernel(const Kernel&) = delete;
  Kernel& operator=(const Kernel&) = delete;

  struct Impl;
  const Impl& impl() const { return *impl_; }

 private:
  std::unique_ptr<Impl> impl_;
};

/// The buffers a kernel reads and writes, in order of binding. They must outlive the bindings.
class Bindings {
 public:
  Bindings(Device& device, const Kernel& kernel, std::span<const Buffer* const> buffers);
  ~Bindings();
  Bindings(const Bindings&) = delete;
  Bindings& operator=(const Bindings&) = delete;

  struct Impl;
  const Impl& impl() const { return *impl_; }

 private:
  void write(const Kernel& kernel, std::span<const Buffer* const> buffers);
  void release();
  std::unique_ptr<Impl> impl_;
};

/// Commands recorded, submitted and waited for as one. Reusable after wait(). Dispatches and copies
/// of one batch run in order, each seeing the writes of those before it. Each is submitted on its
/// own, so a device's watchdog sees short pieces of work.
class Batch {
 public:
  explicit Batch(Device& device);
  ~Batch();  ///< waits
  Batch(const Batch&) = delete;
  Batch& operator=(const Batch&) = delete;

  /// Records `groups` workgroups (at most maxWorkgroupCount) along x.
  void dispatch(const Kernel& kernel, const Bindings& bindings,
                std::span<const std::byte> pushConstants, std::uint32_t groups);
  /// Records a copy of bytes between two buffers. Dispatches recorded later see it, those submitted
  /// before have ended when it runs.
  void copy(const Buffer& from, std::uint64_t fromOffset, const Buffer& to, std::uint64_t toOffset,
            std::uint64_t bytes);
  /// Hands the recorded work to the device and returns at once.
  void submit();
  /// Returns when the work is done. Throws if the device is lost. Without a submit: nothing.
  void wait();
  /// Whether work is under way; does not block.
  bool busy() const;

  struct Impl;

 private:
  template <typename Function>
  void record(const std::string& what, const Function& function);
  std::unique_ptr<Impl> impl_;
};

/// How many items one dispatch may take so that it ends within about `kTargetSeconds`: starts
/// careful, then follows what was measured.
class Slicer {
 public:
  static constexpr double kTargetSeconds = 0.05;
  explicit Slicer(std::uint64_t first) : items_(first) {}
  std::uint64_t items() const { return items_; }
  /// Tells that `items` took `seconds`.
  void measured(std::uint64_t items, double seconds);

 private:
  std::uint64_t items_;
};

}  // namespace trex::vulkan
