// What `trex view` was asked for on the command line.
#pragma once

#include <filesystem>
#include <string>

#include "src/viewer/viewer.h"

namespace trex {

struct ViewArguments {
  ViewerOptions viewer;
  std::uint32_t width = 1280, height = 720;  ///< of the window
  int scale = 1;                             ///< window pixels a pixel of the picture, each way
  int threads = 0;
  std::filesystem::path replay, report, screenshotFolder = ".";
  bool localModel = false;  ///< other machines have the model, too
  bool help = false;        ///< --help or --version was answered
};

/// Throws Error(kUsage).
ViewArguments readViewArguments(int argc, const char* const* argv);

}  // namespace trex
