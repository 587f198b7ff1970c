// Errors of a mesh in pages as errors of the program.
#pragma once

#include <exception>
#include <new>

#include "src/core/error.h"

namespace trex {

/// What `function` returns. A page that can't be read or is damaged ends in Error(kInput), one that
/// finds no memory in Error(kMemoryOrDevice).
template <typename Function>
auto readingPages(const Function& function) {
  try {
    return function();
  } catch (const Error&) {
    throw;
  } catch (const std::bad_alloc&) {
    fail(ExitCode::kMemoryOrDevice, "not enough memory for a page of the mesh");
  } catch (const std::exception& e) {
    fail(ExitCode::kInput, "{}", e.what());
  }
}

}  // namespace trex
