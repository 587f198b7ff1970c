#include "src/command/run_main.h"

#include <csignal>
#include <exception>
#include <new>

#include "src/core/error.h"
#include "src/core/log.h"

namespace trex {

int runMain(int (*program)(int argc, char** argv), int argc, char** argv) {
  std::signal(SIGXFSZ, SIG_IGN);
  try {
    return program(argc, argv);
  } catch (const Error& e) {
    logError("{}", e.what());
    return static_cast<int>(e.code());
  } catch (const std::bad_alloc&) {
    logError("out of memory; try a smaller --size or model");
    return static_cast<int>(ExitCode::kMemoryOrDevice);
  } catch (const std::exception& e) {
    logError("{}", e.what());
    return static_cast<int>(ExitCode::kFailed);
  }
}

}  // namespace trex
