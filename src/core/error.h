// Errors that a user can meet. A run-time failure is thrown as Error and ends in one line on stderr
// and the exit code below; a logic error is an assert.
#pragma once

#include <fmt/format.h>

#include <algorithm>
#include <stdexcept>
#include <string>
#include <utility>

namespace trex {

/// Exit codes of the program; documented in `trex --help` and the README.
enum class ExitCode : int {
  kDone = 0,
  kFailed = 1,
  kUsage = 2,
  kInput = 3,
  kMemoryOrDevice = 4,
  kOutput = 5,
  kDiffer = 6,
  kInterrupted = 130,
  kTerminated = 143,
};

/// An error with the exit code it ends in. The message says what was wrong with what, where, and
/// what to do next, on one line.
class Error : public std::runtime_error {
 public:
  Error(ExitCode code, const std::string& message) : std::runtime_error(message), code_(code) {}
  ExitCode code() const { return code_; }

 private:
  ExitCode code_;
};

/// Throws an Error with a formatted message: fail(ExitCode::kInput, "{}: no such file", path).
template <typename... Args>
[[noreturn]] void fail(ExitCode code, fmt::format_string<Args...> format, Args&&... args) {
  throw Error(code, fmt::format(format, std::forward<Args>(args)...));
}

/// Text of a library for a message: without line breaks, and white space at its end.
inline std::string oneLine(std::string text) {
  text.erase(text.find_last_not_of(" \t\r\n") + 1);
  std::replace(text.begin(), text.end(), '\n', ' ');
  return text;
}

}  // namespace trex
