#include "src/app/render_machines.h"

#include <fmt/format.h>
#include <unistd.h>

#include <csignal>
#include <new>

#include "src/app/capture.h"
#include "src/app/lent_files.h"
#include "src/app/render_open.h"
#include "src/bundle/page_file.h"
#include "src/command/interrupt.h"
#include "src/core/error.h"
#include "src/core/log.h"
#include "src/core/threads.h"
#include "src/machines/identity.h"
#include "src/machines/leader.h"
#include "src/machines/mpi_wire.h"
#include "src/machines/worker.h"
#include "src/scene/import.h"

namespace trex {
namespace {

/// Files that machine 0 serves, by number; those that are not wanted are empty.
enum : std::uint32_t { kModelFile, kEditsFile, kPathFile, kEnvironmentFile, kFiles };

/// The model as a bundle in memory.
machines::ServedFile made(const RenderArguments& a, const Model& model, const ModelOptions& built) {
  BakeFacts facts;
  facts.input = a.input;
  facts.precisionBits = built.precisionBits;
  facts.voxelDepth = built.voxelDepth;
  const auto bytes = std::make_shared<const std::vector<std::byte>>(bundleBytes(model, facts));
  return {std::make_shared<bundle::MemoryPages>(*bytes, bytes, a.input, 0), bytes->size()};
}

std::vector<machines::ServedFile> filesOf(const RenderArguments& a, const OpenedRender& opened) {
  std::vector<machines::ServedFile> files(kFiles);
  const bool baked = isBundlePath(a.input);
  files[kModelFile] = baked ? servedFile(a.input) : made(a, *opened.model, opened.built);
  if (!a.edits.empty()) files[kEditsFile] = servedFile(a.edits);
  if (!a.path.empty()) files[kPathFile] = servedFile(a.path);
  if (baked && !a.environment.empty()) {
    files[kEnvironmentFile] = servedFile(environmentFile(a.environment));
  }
  return files;
}

/// Where a machine without files has the model from; names in the arguments become those of copies.
RenderSource sourceOf(RenderArguments& a, machines::Worker& worker,
                      const machines::Welcome& welcome, LentFiles& lent) {
  RenderSource source;
  source.writes = false;
  if (welcome.local) return source;
  source.file = worker.file(kModelFile, a.input);
  source.bytes = welcome.fileBytes[kModelFile];
  source.made = !welcome.baked;
  if (lent.has(kEditsFile)) a.edits = lent.take(kEditsFile, a.edits);
  if (lent.has(kPathFile)) a.path = lent.take(kPathFile, a.path);
  if (lent.has(kEnvironmentFile)) {
    const std::string file = environmentFile(a.environment);
    source.environment = lent.take(kEnvironmentFile, file) + a.environment.substr(file.size());
  }
  return source;
}

void checkTogether(const RenderArguments& a) {
  if (!a.trace.empty()) {
    fail(ExitCode::kUsage, "--trace: shows one machine alone; leave it out under mpirun");
  }
  if (a.sceneDb == "central" && isBundlePath(a.input) && !a.volumes.empty()) {
    fail(ExitCode::kUsage,
         "--volume: other machines have no such file; bake the volume in, or use --scene-db local");
  }
}

void tellMachines(const machines::Leader& leader) {
  std::string text;
  for (const machines::MachineRow& row : leader.rows()) {
    text += text.empty() ? "" : ", ";
    text += fmt::format("{} ({} threads)", row.host, row.threads);
  }
  logInfo("{} machines: {}", leader.machines(), text);
}

int leadJob(RenderArguments& a, machines::Leader& leader) {
  checkFiles(a);
  const bool local = a.sceneDb == "local";
  if (local) leader.welcome(true, false, {});
  a.settings.sharedBytes = machines::kWindowBytes;
  if (a.settings.exact < 1.0) a.settings.sharedBytes += machines::kKeptPhotonBytes;
  a.settings.servesModel = !local && !isBundlePath(a.input);
  OpenedRender opened;
  openForRender(a, {}, opened);
  if (!local) leader.welcome(false, isBundlePath(a.input), filesOf(a, opened));
  opened.applyLook();
  leader.expect(machinesDigest(a, *opened.model, opened.views));
  const auto going = [] { return interruptedBy() == 0; };
  leader.waitForGreetings(going);
  // Jobs of paths that wait for pages are few: whoever comes late finds none.
  if (local || a.settings.rayMemory > 0) leader.waitForModels(going);
  tellMachines(leader);
  Capture capture(a, std::move(opened.model), std::move(opened.views), opened.importSeconds,
                  &leader);
  const int code = capture.run();
  if (interruptedBy() == SIGTERM) {
    logWarning("ended by SIGTERM, which mpirun sends to all when one of them is lost{}",
               a.checkpoint.empty() ? "" : "; --resume goes on, with fewer machines too");
  }
  return code;
}

int lead(RenderArguments& a, const machines::Hello& self) {
  machines::Leader leader(machines::openMpiWire, self);
  int code = 0;
  try {
    code = leadJob(a, leader);
  } catch (const Error& e) {
    leader.stop();
    leader.finish(static_cast<int>(e.code()), e.what());
    throw;
  }
  leader.stop();
  leader.finish(code);
  return code;
}

void followJob(RenderArguments& a, machines::Worker& worker) {
  catchInterrupts();
  const auto welcome = worker.awaitWelcome();
  if (!welcome) return;
  if (welcome->window) {
    fail(ExitCode::kFailed, "machine 0 has a window, which trex worker serves, not trex render");
  }
  if (!welcome->local && welcome->fileBytes.size() != kFiles) {
    fail(ExitCode::kFailed, "machine 0: has not said which files there are");
  }
  const std::filesystem::path folder = std::filesystem::temp_directory_path();
  const std::uint64_t model = welcome->local ? 0 : welcome->fileBytes[kModelFile];
  passPagesOn(worker, *welcome, folder, diskForOthers(a, folder, model));
  LentFiles lent(worker, *welcome);
  OpenedRender opened;
  openForRender(a, sourceOf(a, worker, *welcome, lent), opened);
  opened.applyLook();
  std::vector<Camera> cameras;
  for (const View& view : opened.views) cameras.push_back(view.camera);
  const std::uint64_t digest = machinesDigest(a, *opened.model, opened.views);
  worker.run(std::move(opened.model), cameras, a.settings, digest);
}

/// What goes wrong here is machine 0's to say; only what keeps it from being told is said here.
int follow(RenderArguments& a, const machines::Hello& self) {
  const LogLevel level = logLevel();
  if (level != LogLevel::kVerbose) setLogLevel(LogLevel::kQuiet);
  std::unique_ptr<machines::Worker> worker;
  try {
    worker = std::make_unique<machines::Worker>(machines::openMpiWire, self);
  } catch (const Error& e) {
    setLogLevel(level);
    throw Error(e.code(), fmt::format("machine {} ({}): {}", machines::startedAs().rank, self.host,
                                      e.what()));
  }
  try {
    followJob(a, *worker);
  } catch (const Error& e) {
    if (e.code() != ExitCode::kInterrupted) worker->failed(e);
  } catch (const std::bad_alloc&) {
    worker->failed(Error(ExitCode::kMemoryOrDevice, "out of memory"));
  } catch (const std::exception& e) {
    worker->failed(Error(ExitCode::kFailed, e.what()));
  }
  worker->finish();
  return 0;
}

}  // namespace

int renderTogether(RenderArguments& a) {
  checkTogether(a);
  const machines::Hello self = machines::helloOfThis(static_cast<std::uint32_t>(threadsAllowed()));
  const int code = machines::startedAs().rank == 0 ? lead(a, self) : follow(a, self);
  if (!machines::mpiEndsUncleanly()) return code;
  std::fflush(nullptr);
  ::_exit(code);
}

}  // namespace trex
