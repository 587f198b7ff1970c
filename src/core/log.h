// Messages for people, on stderr; stdout carries results alone.
#pragma once

#include <fmt/format.h>

#include <string>
#include <utility>

namespace trex {

enum class LogLevel { kQuiet, kError, kWarning, kInfo, kVerbose };

/// Sets what is printed; kInfo at start. Thread safe.
void setLogLevel(LogLevel level);
LogLevel logLevel();

/// Prints one line "trex: message" on stderr if the level allows it. Thread safe.
void logLine(LogLevel level, const std::string& message);

template <typename... Args>
void logInfo(fmt::format_string<Args...> format, Args&&... args) {
  logLine(LogLevel::kInfo, fmt::format(format, std::forward<Args>(args)...));
}
template <typename... Args>
void logVerbose(fmt::format_string<Args...> format, Args&&... args) {
  logLine(LogLevel::kVerbose, fmt::format(format, std::forward<Args>(args)...));
}
template <typename... Args>
void logWarning(fmt::format_string<Args...> format, Args&&... args) {
  logLine(LogLevel::kWarning, "warning: " + fmt::format(format, std::forward<Args>(args)...));
}
template <typename... Args>
void logError(fmt::format_string<Args...> format, Args&&... args) {
  logLine(LogLevel::kError, "error: " + fmt::format(format, std::forward<Args>(args)...));
}

}  // namespace trex
