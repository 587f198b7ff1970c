#include "src/command/run_main.h"

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <exception>
#include <new>
#include <system_error>

#include "src/core/error.h"
#include "src/core/log.h"

namespace trex {
namespace {

void openStandardStreams() {
  for (int stream = 0; stream <= 2; ++stream) {
    // The lowest number that is free is the one that is closed.
    if (fcntl(stream, F_GETFD) == -1 && errno == EBADF && open("/dev/null", O_RDWR) == -1) return;
  }
}

int cantPrint(const char* why) {
  logError("stdout: can't be written: {}", why);
  return static_cast<int>(ExitCode::kOutput);
}

/// Of results that were printed and are still in memory: `code`, or that of what was lost.
int finishStdout(int code) {
  if (std::fflush(stdout) == 0 && std::ferror(stdout) == 0) return code;
  const int problem = errno;
  return problem == EPIPE || code != 0 ? code : cantPrint(std::strerror(problem));
}

int runOrSay(int (*program)(int argc, char** argv), int argc, char** argv) {
  try {
    return program(argc, argv);
  } catch (const Error& e) {
    logError("{}", e.what());
    return static_cast<int>(e.code());
  } catch (const std::bad_alloc&) {
    logError("out of memory; try a smaller --size or model");
    return static_cast<int>(ExitCode::kMemoryOrDevice);
  } catch (const std::system_error& e) {
    // Only what is printed throws these, by fmt; files have errors of ours.
    if (e.code().value() == EPIPE) return 128 + SIGPIPE;
    if (std::ferror(stdout) != 0) return cantPrint(e.what());
    logError("{}", e.what());
    return static_cast<int>(ExitCode::kFailed);
  } catch (const std::exception& e) {
    logError("{}", e.what());
    return static_cast<int>(ExitCode::kFailed);
  }
}

}  // namespace

int runMain(int (*program)(int argc, char** argv), int argc, char** argv) {
  openStandardStreams();
  std::signal(SIGXFSZ, SIG_IGN);
  std::signal(SIGPIPE, SIG_IGN);
  return finishStdout(runOrSay(program, argc, argv));
}

}  // namespace trex
