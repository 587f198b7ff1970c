#include "src/command/kept_record.h"

#include <fstream>
#include <sstream>

#include "src/core/error.h"
#include "src/core/file.h"
#include "src/core/log.h"

namespace trex {
namespace fs = std::filesystem;
namespace {

constexpr std::uintmax_t kMostOfARecord = 1u << 20;  // bytes

std::string textIn(const fs::path& path) {
  std::error_code error;
  const std::uintmax_t size = fs::file_size(path, error);
  std::ifstream file(path, std::ios::binary);
  if (error || size > kMostOfARecord || !file) {
    fail(ExitCode::kInput, "{}: not a record that can be read; remove it", path.string());
  }
  std::ostringstream text;
  text << file.rdbuf();
  return text.str();
}

}  // namespace

fs::path machineRecordPath() {
  const fs::path folder = stateFolder();
  return folder.empty() ? fs::path() : folder / "machine.json";
}

std::optional<schedule::MachineRecord> keptMachineRecord() {
  const fs::path path = machineRecordPath();
  std::error_code error;
  if (path.empty() || !fs::exists(path, error)) return std::nullopt;
  return schedule::recordOf(textIn(path), path.string());
}

std::shared_ptr<const schedule::MachineRecord> measuredMachine(const RenderSettings& settings) {
  if (settings.guess != GuessKind::kAuto || settings.device == RenderSettings::kNoDevice ||
      settings.exact >= 1.0) {
    return nullptr;
  }
  try {
    auto kept = keptMachineRecord();
    return kept ? std::make_shared<const schedule::MachineRecord>(std::move(*kept)) : nullptr;
  } catch (const Error& e) {
    logWarning("{}; going on as if nothing were known of this machine", e.what());
    return nullptr;
  }
}

}  // namespace trex
