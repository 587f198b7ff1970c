#include "src/app/view/servers.h"

#include "src/app/lent_files.h"
#include "src/bundle/bundle.h"
#include "src/command/interrupt.h"
#include "src/core/child.h"
#include "src/core/error.h"
#include "src/core/threads.h"
#include "src/machines/identity.h"
#include "src/machines/mpi_wire.h"
#include "src/machines/server.h"
#include "src/scene/import.h"

namespace trex {
namespace {

/// The model is another machine's.
void welcomeFrom(machines::Servers& servers, ViewArguments& a, const machines::Serve& serve) {
  if (a.localModel) {
    fail(ExitCode::kUsage, "--scene-db local: each machine opens its own copy; name the model");
  }
  catchInterrupts();
  const std::uint32_t holder = servers.findHolder([] { return interruptedBy() == 0; });
  servers.welcomeTo(holder, {{}, servedFile(environmentFile(a.viewer.environment))}, serve);
  const machines::MachineRow row = servers.rows()[holder];
  a.viewer.input = row.model;
  a.viewer.remote =
      RemoteModel{servers.model(holder), row.modelBytes, [&] { servers.leaveFiles(); }, &servers};
}

}  // namespace

std::unique_ptr<machines::Servers> startServers() {
  if (machines::startedAs().size < 2) return nullptr;
  const auto self =
      machines::helloOfThis(static_cast<std::uint32_t>(threadsAllowed()), besideProgram("trex"));
  return std::make_unique<machines::Servers>(machines::openMpiWire, self);
}

void welcomeServers(machines::Servers& servers, ViewArguments& a,
                    const std::vector<std::string>& arguments) {
  const std::string input = a.viewer.input.string();
  if (!a.localModel && !input.empty() && !isBundlePath(input)) {
    fail(ExitCode::kUsage,
         "{}: other machines get bundles alone; bake it, or use --scene-db local where each has it",
         input);
  }
  if (!a.localModel && !a.viewer.volumes.empty()) {
    fail(ExitCode::kUsage,
         "--volume: other machines have no such file; bake the volume in, or use --scene-db local");
  }
  const RenderSettings& s = a.viewer.settings;
  const machines::Serve serve{s.width, s.height, machines::joinArguments(arguments)};
  if (input.empty()) return welcomeFrom(servers, a, serve);
  std::vector<machines::ServedFile> files;
  if (!a.localModel) {
    files.push_back(servedFile(input));
    files.push_back(servedFile(environmentFile(a.viewer.environment)));
  }
  servers.welcome(a.localModel, std::move(files), serve,
                  machines::windowDigest(a.localModel ? input : std::string()));
}

}  // namespace trex
