#include "src/core/module.h"

#include <dlfcn.h>

#include <string>

#include "src/core/child.h"
#include "src/core/error.h"

namespace trex {

void* findModuleFunction(const char* file, const char* name, const char* what) {
  void* module = dlopen(besideProgram(file).c_str(), RTLD_LAZY | RTLD_LOCAL);
  void* function = module != nullptr ? dlsym(module, name) : nullptr;
  if (function == nullptr) {
    const std::string why = dlerror();
    // What the loader says where memory is limited (ulimit -v).
    const bool memory = why.find("failed to map segment") != std::string::npos ||
                        why.find("cannot allocate memory") != std::string::npos;
    fail(ExitCode::kMemoryOrDevice, "{} can't be used ({}): {}", what, why,
         memory ? "allow this process more memory" : "build all of this program again");
  }
  return function;
}

}  // namespace trex
