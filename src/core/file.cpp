#include "src/core/file.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <signal.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <system_error>

#include "src/core/error.h"

namespace trex {
namespace fs = std::filesystem;
namespace {

fs::path folderOf(const fs::path& target) {
  return target.has_parent_path() ? target.parent_path() : fs::path(".");
}

/// What the name of a temporary begins with: that of the target, as much of it as leaves room.
std::string beginningOf(const fs::path& target) {
  constexpr std::size_t kLongestName = 255, kOurs = 24;
  const std::string stem = target.stem().string();
  const std::size_t room =
      kLongestName - kOurs - std::min<std::size_t>(target.extension().string().size(), 64);
  return fmt::format(".{}.", stem.substr(0, room));
}

/// Flushes a file or folder; the reason on failure.
bool flush(const fs::path& path, int flags) {
  const int fd = ::open(path.c_str(), flags | O_CLOEXEC);
  if (fd < 0) return false;
  const bool done = ::fsync(fd) == 0;
  const int reason = errno;
  ::close(fd);
  errno = reason;
  return done;
}

}  // namespace

void writeAtomically(const fs::path& target, const std::function<void(const fs::path&)>& write) {
  const fs::path temporary =
      folderOf(target) /
      fmt::format("{}{}.tmp{}", beginningOf(target), ::getpid(), target.extension().string());
  std::error_code ignored;
  try {
    write(temporary);
    if (!flush(temporary, O_RDONLY)) {
      fail(ExitCode::kOutput, "{}: can't be written: {}", target.string(), std::strerror(errno));
    }
    fs::rename(temporary, target);
    flush(folderOf(target), O_RDONLY | O_DIRECTORY);
  } catch (const fs::filesystem_error& e) {
    fs::remove(temporary, ignored);
    fail(ExitCode::kOutput, "{}: can't be written: {}", target.string(), e.code().message());
  } catch (...) {
    fs::remove(temporary, ignored);
    throw;
  }
}

void writeTextAtomically(const fs::path& target, const std::string& text) {
  writeAtomically(target, [&](const fs::path& temporary) {
    std::ofstream file(temporary, std::ios::binary);
    file << text;
    file.close();
    if (!file) fail(ExitCode::kOutput, "{}: can't be written", target.string());
  });
}

std::vector<fs::path> removeDeadTemporaries(const fs::path& target) {
  const std::string before = beginningOf(target);
  const std::string after = fmt::format(".tmp{}", target.extension().string());
  std::vector<fs::path> removed;
  std::error_code ignored;
  for (const fs::directory_entry& entry : fs::directory_iterator(folderOf(target), ignored)) {
    const std::string name = entry.path().filename().string();
    if (name.size() <= before.size() + after.size() || !name.starts_with(before) ||
        !name.ends_with(after)) {
      continue;
    }
    const char* end = name.data() + name.size() - after.size();
    pid_t process = 0;
    const auto [at, problem] = std::from_chars(name.data() + before.size(), end, process);
    if (at != end || problem != std::errc() || process <= 0) continue;
    if (::kill(process, 0) == 0 || errno != ESRCH) continue;
    if (fs::remove(entry.path(), ignored)) removed.push_back(entry.path());
  }
  return removed;
}

fs::path stateFolder() {
  const char* state = std::getenv("XDG_STATE_HOME");
  const char* home = std::getenv("HOME");
  if (state != nullptr && *state != '\0') return fs::path(state) / "trex";
  if (home != nullptr && *home != '\0') return fs::path(home) / ".local" / "state" / "trex";
  return {};
}

void checkWritable(const fs::path& target) {
  const fs::path folder = folderOf(target);
  std::error_code ec;
  if (!fs::is_directory(folder, ec)) {
    fail(ExitCode::kOutput, "{}: no folder {}; make it first", target.string(), folder.string());
  }
  if (fs::is_directory(target, ec)) {
    fail(ExitCode::kOutput, "{}: is a folder; name a file", target.string());
  }
  const fs::path& asked = fs::exists(target, ec) ? target : folder;
  if (ec) {  // a name that is too long, links in a circle
    fail(ExitCode::kOutput, "{}: can't be written: {}", target.string(), ec.message());
  }
  if (::access(asked.c_str(), W_OK) != 0 || ::access(folder.c_str(), W_OK) != 0) {
    fail(ExitCode::kOutput, "{}: can't be written: {}", target.string(), std::strerror(errno));
  }
}

void checkIsNotInput(const std::filesystem::path& target, const std::filesystem::path& input) {
  std::error_code ignored;
  if (std::filesystem::equivalent(target, input, ignored)) {
    fail(ExitCode::kUsage, "-o {}: is what is read; name another file", target.string());
  }
}

}  // namespace trex
