// trex worker: a machine that traces for the window of another (docs/machines.md).
#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <new>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "src/app/app.h"
#include "src/app/lent_files.h"
#include "src/app/view/view_arguments.h"
#include "src/bundle/bundle.h"
#include "src/command/interrupt.h"
#include "src/command/parse.h"
#include "src/core/error.h"
#include "src/core/log.h"
#include "src/core/threads.h"
#include "src/machines/identity.h"
#include "src/machines/mpi_wire.h"
#include "src/machines/server.h"
#include "src/session/preflight.h"

namespace trex {
namespace {

enum : std::uint32_t { kModelFile, kEnvironmentFile, kFiles };

/// As written, and what that means.
struct WorkerArguments {
  std::string model, device, maxMemory, maxGpuMemory, cache;
  int threads = 0;
  std::optional<int> deviceNumber;
  std::uint64_t memoryBytes = 0, gpuMemoryBytes = 0, cacheBytes = 0;
};

/// Throws Error(kUsage), and of a model Error(kInput).
void read(WorkerArguments& w) {
  if (!w.model.empty() && !isBundlePath(w.model)) {
    fail(ExitCode::kUsage, "{}: other machines get bundles alone; bake it", w.model);
  }
  if (!w.device.empty()) w.deviceNumber = parseDevice(w.device);
  if (!w.maxMemory.empty()) w.memoryBytes = parseBytes("--max-memory", w.maxMemory);
  if (!w.maxGpuMemory.empty()) w.gpuMemoryBytes = parseBytes("--max-gpu-memory", w.maxGpuMemory);
  if (!w.cache.empty()) w.cacheBytes = std::max<std::uint64_t>(parseBytes("--cache", w.cache), 1);
}

/// The window's own command line, with what is this machine's.
ViewArguments windowOf(const machines::Serve& serve, const WorkerArguments& w) {
  const std::vector<std::string> arguments = machines::splitArguments(serve.arguments);
  std::vector<const char*> words{"trex view"};
  for (const std::string& argument : arguments) words.push_back(argument.c_str());
  const LogLevel level = logLevel();
  ViewArguments a = readViewArguments(static_cast<int>(words.size()), words.data());
  setLogLevel(level);
  RenderSettings& s = a.viewer.settings;
  s.width = serve.width;
  s.height = serve.height;
  if (w.deviceNumber) s.device = *w.deviceNumber;
  s.maxMemory = w.memoryBytes;
  s.maxGpuMemory = w.gpuMemoryBytes;
  return a;
}

/// As the window opens it.
OpenOptions optionsOf(const ViewArguments& a, const std::string& environment,
                      std::uint64_t cacheBytes, ModelOptions& made) {
  const RenderSettings& s = a.viewer.settings;
  OpenOptions open;
  open.useStale = a.viewer.useStale;
  open.import = a.viewer.import;
  for (const std::string& v : a.viewer.volumes) open.import.volumes.push_back(parseVolume(v));
  open.import.maxMemory = s.maxMemory;
  open.import.textures = textureCacheFor(s, std::filesystem::temp_directory_path());
  open.model.voxels = s.exact < 1.0;
  open.model.voxelsInTheDark = true;
  open.model.voxelDepth = voxelDepthFor(std::uint64_t{s.width} * s.height);
  if (!environment.empty()) open.environment = parseEnvironment(environment);
  open.prepare = [&s, &made, cacheBytes](const Scene& scene, ModelOptions& model) {
    if (!model.bakedVoxels) model.voxelBytes = preflight(scene, s, {}).voxelBytes;
    if (model.paged.pages > 0) model.cacheBytes = std::min(cacheBytes, model.paged.pages);
    made = model;
  };
  return open;
}

/// Where this machine has the model from.
Model modelFor(const WorkerArguments& w, const machines::Welcome& welcome, const std::string& input,
               const OpenOptions& open, machines::Server& server) {
  if (welcome.local) return openModel(input, open);
  if (!w.model.empty()) return openBundle(w.model, open);
  return openRemoteBundle(server.file(welcome.holder, kModelFile, input),
                          welcome.fileBytes[kModelFile], input, open);
}

void serve(const WorkerArguments& w, machines::Server& server) {
  catchInterrupts();
  const auto welcome = server.awaitWelcome();
  if (!welcome) return;
  const auto window = server.awaitServe(*welcome);
  if (!window) return;
  if (!welcome->local && welcome->fileBytes.size() != kFiles) {
    fail(ExitCode::kFailed, "machine 0: has not said which files there are");
  }
  if (!w.model.empty() && welcome->holder == 0) {
    fail(ExitCode::kUsage, "{}: the window has a model too; name it once", w.model);
  }
  const ViewArguments a = windowOf(*window, w);
  const std::string input = welcome->holder == 0 ? a.viewer.input.string() : welcome->model;
  const std::filesystem::path folder = std::filesystem::temp_directory_path();
  const std::uint64_t packed = welcome->local ? 0 : welcome->fileBytes[kModelFile];
  passPagesOn(server, *welcome, folder, std::min(spareDisk(folder) / 4, packed));
  LentFiles lent(server, *welcome);
  std::string environment = a.viewer.environment;
  if (!welcome->local && lent.has(kEnvironmentFile)) {
    const std::string file = environmentFile(environment);
    environment = lent.take(kEnvironmentFile, file) + environment.substr(file.size());
  }
  ModelOptions made;
  const OpenOptions open = optionsOf(a, environment, w.cacheBytes, made);
  if (welcome->local) checkSourceFits(input, a.viewer.settings);
  auto model = std::make_shared<Model>(modelFor(w, *welcome, input, open, server));
  const std::uint64_t digest = machines::windowDigest(welcome->local ? input : std::string());
  auto voxels = std::exchange(model->voxels, nullptr);
  made.voxels = voxels != nullptr;
  server.run(std::move(model), std::move(voxels), made, a.viewer.settings, digest);
}

/// What goes wrong here is machine 0's to say; only what keeps it from being told is said here.
void work(WorkerArguments& w) {
  const machines::Started started = machines::startedAs();
  if (started.size < 2 || started.rank == 0) {
    fail(ExitCode::kUsage,
         "trex worker: is started by mpirun beside a window: mpirun -n 1 trex view MODEL : -n 3 "
         "trex worker");
  }
  read(w);
  const ThreadLimit limit(w.threads);
  machines::Hello self = machines::helloOfThis(static_cast<std::uint32_t>(threadsAllowed()));
  std::vector<machines::ServedFile> files;
  if (!w.model.empty()) {
    self.modelDigest = bundleDigest(w.model);
    files.push_back(servedFile(w.model));
    self.model = w.model;
    self.modelBytes = files[kModelFile].size;
  }
  std::unique_ptr<machines::Server> server;
  try {
    server = std::make_unique<machines::Server>(machines::openMpiWire, self, std::move(files));
  } catch (const Error& e) {
    throw Error(e.code(), fmt::format("machine {} ({}): {}", started.rank, self.host, e.what()));
  }
  try {
    serve(w, *server);
  } catch (const Error& e) {
    if (e.code() != ExitCode::kInterrupted) server->failed(e);
  } catch (const std::bad_alloc&) {
    server->failed(Error(ExitCode::kMemoryOrDevice, "out of memory"));
  } catch (const std::exception& e) {
    server->failed(Error(ExitCode::kFailed, e.what()));
  }
  server->finish();
  if (!machines::mpiEndsUncleanly()) return;
  std::fflush(nullptr);
  ::_exit(0);
}

}  // namespace

void addWorkerCommand(CLI::App& app) {
  auto w = std::make_shared<WorkerArguments>();
  CLI::App* c = app.add_subcommand(
      "worker", "Trace for a window: mpirun -n 1 trex view MODEL : -n 3 trex worker");
  c->add_option(
      "MODEL", w->model,
      "Bundle (.trex) that the window, and all others, get from this machine: mpirun -n 1 "
      "trex view : -n 1 trex worker MODEL.trex");
  c->add_option("--threads", w->threads, "CPU threads [all]")->check(CLI::Range(1, 4096));
  c->add_option("--device", w->device,
                "Vulkan device of the G-rays: number, auto or none [as the window]");
  c->add_option("--max-memory", w->maxMemory, "Memory this process may use, such as 8G [all]");
  c->add_option("--max-gpu-memory", w->maxGpuMemory,
                "Device memory that may be used, such as 2G [all]");
  c->add_option("--cache", w->cache, "Memory for pages of a streamed bundle, such as 2G [all]");
  c->callback([w] { work(*w); });
}

}  // namespace trex
