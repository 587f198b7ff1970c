// trex-view: the window of `trex view`, a program of its own.
#include <unistd.h>

#include <cstdio>
#include <filesystem>
#include <fstream>
#include <iostream>

#include "src/app/view/loop.h"
#include "src/app/view/replay_runner.h"
#include "src/app/view/servers.h"
#include "src/app/view/view_arguments.h"
#include "src/command/run_main.h"
#include "src/core/error.h"
#include "src/core/file.h"
#include "src/core/log.h"
#include "src/core/threads.h"
#include "src/machines/mpi_wire.h"
#include "src/vulkan/vulkan.h"

namespace {

using Clock = trex::ReplayRunner::Clock;

void writeReport(const nlohmann::ordered_json& report, const std::filesystem::path& path) {
  if (path.empty()) {
    std::cout << report.dump(1) << std::endl;
    return;
  }
  trex::writeAtomically(path, [&](const std::filesystem::path& temporary) {
    std::ofstream out(temporary);
    out << report.dump(1) << '\n';
    if (!out.flush()) {
      trex::fail(trex::ExitCode::kOutput, "{}: could not be written", path.string());
    }
  });
}

/// What other machines did; the window's own samples are not counted.
nlohmann::ordered_json machineRows(const trex::machines::Servers& servers) {
  nlohmann::ordered_json out = nlohmann::ordered_json::array();
  for (const trex::machines::MachineRow& row : servers.rows()) {
    out.push_back({{"host", row.host},
                   {"threads", row.threads},
                   {"device", row.device},
                   {"samples", row.work.units},
                   {"processor_seconds", row.times.processor},
                   {"model_bytes_sent", row.servedBytes},
                   {"peak_resident_bytes", row.peakBytes}});
  }
  return out;
}

/// The window was closed; what kept it from showing the model that was asked for has been said.
int closingCode(const trex::Viewer& viewer, int code) {
  return code == 0 && viewer.problem() ? static_cast<int>(*viewer.problem()) : code;
}

/// Errors that are better said before a window opens.
void checkInputs(const trex::ViewArguments& a) {
  for (const std::filesystem::path& path : {a.viewer.input, a.viewer.edits}) {
    std::error_code ignored;
    if (path.empty() || std::filesystem::exists(path, ignored)) continue;
    trex::fail(trex::ExitCode::kInput, "{}: no such file", path.string());
  }
  if (!a.report.empty()) trex::checkWritable(a.report);
}

int view(trex::ViewArguments& a, Clock::time_point started, trex::machines::Servers* servers,
         const std::vector<std::string>& arguments) {
  const bool replays = !a.replay.empty();
  trex::ReplayScript script;
  if (replays) {
    script = trex::readReplay(a.replay);
    a.width = a.viewer.settings.width = script.width;
    a.height = a.viewer.settings.height = script.height;
  }
  checkInputs(a);
  a.viewer.recovery = !replays;
  trex::Window window(
      {.width = a.width, .height = a.height, .visible = !replays || script.visible});
  a.viewer.settings.width = std::max(a.width / static_cast<std::uint32_t>(a.scale), 1u);
  a.viewer.settings.height = std::max(a.height / static_cast<std::uint32_t>(a.scale), 1u);
  if (servers != nullptr) trex::welcomeServers(*servers, a, arguments);
  a.viewer.helper = servers;
  trex::Viewer viewer(a.viewer);
  // Work of the viewer's that reads from another machine ends before the viewer waits for it.
  const std::unique_ptr<const trex::RemoteModel, void (*)(const trex::RemoteModel*)> leaves(
      a.viewer.remote ? &*a.viewer.remote : nullptr,
      [](const trex::RemoteModel* m) { m->leave(); });
  trex::UiOptions options;
  options.screenshotFolder = a.screenshotFolder;
  options.edits = a.viewer.edits;
  options.hidden = replays && !script.ui;
  options.asks = !replays;
  trex::Ui ui(viewer, window, options);
  trex::ViewLoop loop(viewer, window, ui, a.viewer.budgetSeconds, a.scale);
  if (!replays) return closingCode(viewer, loop.run());
  trex::ReplayRunner runner(script, loop, viewer, window, ui, a.viewer.budgetSeconds, started);
  const int code = runner.run();
  nlohmann::ordered_json report = runner.report();
  if (servers != nullptr) report["machines"] = machineRows(*servers);
  writeReport(report, a.report);
  return code;
}

int run(int argc, char** argv) {
  const auto started = Clock::now();
  trex::ViewArguments a = trex::readViewArguments(argc, argv);
  if (a.help) return 0;
  const trex::ThreadLimit limit(a.threads);
  const auto servers = trex::startServers();
  const int code = view(a, started, servers.get(), {argv + 1, argv + argc});
  if (servers) servers->finish(code);
  const auto messages = trex::vulkan::validationMessages();
  if (messages > 0)
    trex::logError("the validation layer had {} things to say, see above", messages);
  const int last = messages == 0 ? code : static_cast<int>(trex::ExitCode::kFailed);
  if (!servers || !trex::machines::mpiEndsUncleanly()) return last;
  std::fflush(nullptr);
  ::_exit(last);
}

}  // namespace

int main(int argc, char** argv) { return trex::runMain(run, argc, argv); }
