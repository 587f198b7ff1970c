// Libraries that are opened when something needs them.
#pragma once

#include <bit>

namespace trex {

/// A function of a library that is built beside this program (besideProgram()), which is opened by
/// the first call and stays so. `what` it holds, for the error: Error(kMemoryOrDevice) if it can't
/// be loaded. Thread safe.
void* findModuleFunction(const char* file, const char* name, const char* what);

template <typename Function>
Function* moduleFunction(const char* file, const char* name, const char* what) {
  return std::bit_cast<Function*>(findModuleFunction(file, name, what));
}

}  // namespace trex
