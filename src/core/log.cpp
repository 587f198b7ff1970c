#include "src/core/log.h"

#include <spdlog/sinks/stdout_sinks.h>
#include <spdlog/spdlog.h>

#include <atomic>
#include <memory>

namespace trex {
namespace {

std::atomic<LogLevel> level_{LogLevel::kInfo};

spdlog::logger& logger() {
  static const std::shared_ptr<spdlog::logger> instance = [] {
    auto made =
        std::make_shared<spdlog::logger>("trex", std::make_shared<spdlog::sinks::stderr_sink_mt>());
    made->set_pattern("trex: %v");
    made->set_level(spdlog::level::info);
    made->flush_on(spdlog::level::info);
    return made;
  }();
  return *instance;
}

}  // namespace

void setLogLevel(LogLevel level) { level_ = level; }
LogLevel logLevel() { return level_; }

void logLine(LogLevel level, const std::string& message) {
  if (level <= level_.load()) logger().info("{}", message);
}

}  // namespace trex
