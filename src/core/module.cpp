#include "src/core/module.h"

#include <dlfcn.h>

#include "src/core/child.h"
#include "src/core/error.h"

namespace trex {

void* findModuleFunction(const char* file, const char* name, const char* what) {
  void* module = dlopen(besideProgram(file).c_str(), RTLD_LAZY | RTLD_LOCAL);
  void* function = module != nullptr ? dlsym(module, name) : nullptr;
  if (function == nullptr) {
    fail(ExitCode::kMemoryOrDevice, "{} can't be used ({}): build all of this program again", what,
         dlerror());
  }
  return function;
}

}  // namespace trex
