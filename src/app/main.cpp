// trex: command line, exit codes, and the last stop of every error.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <exception>
#include <string>
#include <string_view>
#include <vector>

#include "src/app/app.h"
#include "src/bench/bench.h"
#include "src/command/run_main.h"
#include "src/core/error.h"
#include "src/core/log.h"
#include "src/core/version.h"
#include "src/machines/mpi_wire.h"

namespace {

constexpr const char* kFooter =
    "Results go to stdout, messages to stderr.\n"
    "Exit codes: 0 done, 1 failed, 2 usage, 3 input, 4 memory or device, 5 output not written,\n"
    "            6 images differ, 130/143 interrupted after saving.";

int run(int argc, char** argv) {
  CLI::App app{"T-ReX: hybrid global illumination of massive models", "trex"};
  app.footer(kFooter);
  app.set_version_flag("--version", std::string("trex ") + trex::kVersion);
  app.require_subcommand(1);
  app.fallthrough();
  bool quiet = false, verbose = false;
  app.add_flag("-q,--quiet", quiet, "Errors alone");
  app.add_flag("-v,--verbose", verbose, "Say more");
  int exitCode = 0;
  app.parse_complete_callback([&] {
    if (quiet && trex::machines::startedAs().rank == 0) {
      trex::setLogLevel(trex::LogLevel::kError);
    }
    if (verbose) trex::setLogLevel(trex::LogLevel::kVerbose);
  });
  trex::addRenderCommand(app, exitCode);
  trex::addViewCommand(app, argc, argv);
  trex::addWorkerCommand(app);
  trex::addBakeCommand(app);
  trex::addInfoCommand(app);
  trex::addDoctorCommand(app);
  trex::addDiffCommand(app, exitCode);
  trex::addMergeCommand(app);
  trex::addDenoiseCommand(app);
  trex::addExportVdbCommand(app);
  trex::addBenchCommand(app, exitCode);
  const trex::machines::Started started = trex::machines::startedAs();
  if (started.rank > 0) {  // machine 0 says it, but how a worker was called wrongly
    const bool isWorker = std::find(argv, argv + argc, std::string_view("worker")) != argv + argc;
    trex::setLogLevel(isWorker ? trex::LogLevel::kError : trex::LogLevel::kQuiet);
  }
  if (started.size > 1) {
    const auto together = [](const std::string& name) {
      return name == "render" || name == "view" || name == "worker";
    };
    for (CLI::App* command :
         app.get_subcommands([&](CLI::App* c) { return !together(c->get_name()); })) {
      command->preparse_callback([name = command->get_name()](std::size_t) {
        trex::fail(trex::ExitCode::kUsage,
                   "trex {}: runs on one machine; mpirun is for trex render, and trex view with "
                   "trex worker",
                   name);
      });
    }
  }
  // As CLI11 wants them: from the last to the first.
  std::vector<std::string> arguments(argv + 1, argv + argc);
  std::reverse(arguments.begin(), arguments.end());
  if (!arguments.empty() && arguments.back() == "help") {
    arguments.pop_back();
    arguments.insert(arguments.end() - (arguments.empty() ? 0 : 1), "--help");
  }
  try {
    app.parse(std::move(arguments));
  } catch (const CLI::ParseError& e) {
    if (e.get_exit_code() == static_cast<int>(CLI::ExitCodes::Success)) return app.exit(e);
    const bool unknown = app.get_subcommands().empty() && argc > 1 && argv[1][0] != '-';
    trex::logError("{}; see trex --help",
                   unknown ? fmt::format("no command '{}'", argv[1]) : e.what());
    return static_cast<int>(trex::ExitCode::kUsage);
  }
  return exitCode;
}

}  // namespace

int main(int argc, char** argv) { return trex::runMain(run, argc, argv); }
