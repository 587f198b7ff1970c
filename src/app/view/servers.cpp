#include "src/app/view/servers.h"

#include "src/app/lent_files.h"
#include "src/bundle/bundle.h"
#include "src/core/child.h"
#include "src/core/error.h"
#include "src/core/threads.h"
#include "src/machines/identity.h"
#include "src/machines/mpi_wire.h"
#include "src/machines/server.h"
#include "src/scene/import.h"

namespace trex {

std::unique_ptr<machines::Servers> startServers() {
  if (machines::startedAs().size < 2) return nullptr;
  const auto self =
      machines::helloOfThis(static_cast<std::uint32_t>(threadsAllowed()), besideProgram("trex"));
  return std::make_unique<machines::Servers>(machines::openMpiWire, self);
}

void welcomeServers(machines::Servers& servers, const ViewArguments& a,
                    const std::vector<std::string>& arguments) {
  const std::string input = a.viewer.input.string();
  if (input.empty()) {
    fail(ExitCode::kUsage, "trex view under mpirun: name the model, which all have open");
  }
  if (!a.localModel && !isBundlePath(input)) {
    fail(ExitCode::kUsage,
         "{}: other machines get bundles alone; bake it, or use --scene-db local where each has it",
         input);
  }
  if (!a.localModel && !a.viewer.volumes.empty()) {
    fail(ExitCode::kUsage,
         "--volume: other machines have no such file; bake the volume in, or use --scene-db local");
  }
  std::vector<machines::ServedFile> files;
  if (!a.localModel) {
    files.push_back(servedFile(input));
    files.push_back(servedFile(environmentFile(a.viewer.environment)));
  }
  const RenderSettings& s = a.viewer.settings;
  servers.welcome(a.localModel, std::move(files),
                  {s.width, s.height, machines::joinArguments(arguments)},
                  machines::windowDigest(a.localModel ? input : std::string()));
}

}  // namespace trex
