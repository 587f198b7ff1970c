// The progress line: a bar on a terminal, at most four times a second; a plain line every 10 s
// elsewhere.
#pragma once

#include <cstdint>
#include <string>

namespace trex {

class Progress {
 public:
  Progress();
  ~Progress();
  Progress(const Progress&) = delete;
  Progress& operator=(const Progress&) = delete;
  /// `share` of the goal done, [0, 1]; `samples` a pixel so far.
  void show(double share, std::uint32_t samples);
  /// The same with a word on what is under way.
  void show(double share, const std::string& what);

 private:
  void clear();
  bool terminal_, shown_ = false;
  double start_, next_;
};

}  // namespace trex
