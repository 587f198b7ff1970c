// trex view: hands over to trex-view beside this program, which alone links a window library.
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <string>
#include <vector>

#include "src/app/app.h"
#include "src/core/child.h"
#include "src/core/error.h"
#include "src/core/log.h"
#include "src/machines/mpi_wire.h"

namespace trex {
namespace {

/// Becomes trex-view with the arguments that came after "view".
[[noreturn]] void becomeViewer(const std::vector<std::string>& arguments) {
  const std::string viewer = besideProgram("trex-view").string();
  std::vector<char*> words{const_cast<char*>(viewer.c_str())};
  for (const std::string& argument : arguments) {
    words.push_back(const_cast<char*>(argument.c_str()));
  }
  words.push_back(nullptr);
  execv(viewer.c_str(), words.data());
  fail(ExitCode::kFailed,
       "{}: {}; the window is a program of its own: build the target trex-view (scripts/build)",
       viewer, std::strerror(errno));
}

}  // namespace

void addViewCommand(CLI::App& app, int argc, char** argv) {
  CLI::App* c = app.add_subcommand("view", "Open a model in a window: look around, edit, refine");
  // All that follows, --help included, is trex-view's to read.
  c->prefix_command();
  c->set_help_flag();
  c->fallthrough(false);
  c->callback([argc, argv] {
    if (machines::startedAs().rank > 0) {
      setLogLevel(LogLevel::kError);
      fail(ExitCode::kUsage,
           "one window is enough: mpirun -n 1 trex view MODEL : -n 3 trex worker");
    }
    int first = 1;
    while (first < argc && std::strcmp(argv[first], "view") != 0) ++first;
    std::vector<std::string> arguments(argv + 1, argv + first);
    arguments.insert(arguments.end(), argv + first + 1, argv + argc);
    becomeViewer(arguments);
  });
}

}  // namespace trex
