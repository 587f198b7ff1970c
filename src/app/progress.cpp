#include "src/app/progress.h"

#include <fmt/format.h>
#include <unistd.h>

#include <chrono>
#include <cstdio>
#include <string>

#include "src/core/clock.h"
#include "src/core/log.h"
#include "src/core/memory.h"

namespace trex {
Progress::Progress() : terminal_(isatty(2) == 1), start_(secondsNow()) {
  next_ = start_ + (terminal_ ? 0.25 : 10.0);
}

Progress::~Progress() { clear(); }

void Progress::clear() {
  if (shown_) std::fputs("\r\033[K", stderr);
  shown_ = false;
}

void Progress::show(double share, std::uint32_t samples) {
  show(share, fmt::format("{} samples", samples));
}

void Progress::show(double share, const std::string& what) {
  const double at = secondsNow();
  if (at < next_ || logLevel() < LogLevel::kInfo) return;
  next_ = at + (terminal_ ? 0.25 : 10.0);
  const double elapsed = at - start_;
  const std::string left =
      share > 0.0 ? fmt::format("{:.0f} s left", elapsed * (1.0 - share) / share) : "";
  const std::string memory = formatBytes(peakResidentBytes());
  if (!terminal_) {
    logInfo("{:3.0f} %  {}  {:.0f} s  {}  {}", share * 100.0, what, elapsed, left, memory);
    return;
  }
  const int filled = static_cast<int>(share * 30.0);
  // Not by fmt::print, which throws where the terminal has gone.
  const std::string bar = fmt::format("\r[{:<30}] {:3.0f} %  {}  {:.0f} s  {}  {} \033[K",
                                      std::string(static_cast<std::size_t>(filled), '='),
                                      share * 100.0, what, elapsed, left, memory);
  std::fputs(bar.c_str(), stderr);
  std::fflush(stderr);
  shown_ = true;
}

}  // namespace trex
