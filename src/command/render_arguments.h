// What `trex render` was asked for on the command line.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "src/frame/image_file.h"
#include "src/frame/layers.h"
#include "src/scene/import.h"
#include "src/scene/look.h"
#include "src/session/settings.h"

namespace trex {

struct RenderArguments {
  std::string input, output;
  std::string size = "640x360", environment, device = "auto", exposure = "auto";
  std::string tonemap = toneOperatorNames()[static_cast<std::size_t>(kDefaultToneOperator)];
  FileOptions file;
  std::vector<std::string> cameras;  ///< names or EYE/TARGET/UP/VFOV; "all"
  std::string path;                  ///< file of cameras, one a frame
  std::string edits;                 ///< overlay on the scene, as the viewer saves it
  std::vector<std::string> volumes;  ///< as --volume
  std::string maxMemory, maxGpuMemory, cache, textureMemory;
  std::string rayMemory = "auto", pageDisk = "auto", pageOrder = "plan";
  std::vector<std::string> layers;
  std::string trace;  ///< file of what was planned and done while paths waited for pages
  std::string checkpoint;
  double checkpointSeconds = 60.0;
  bool resume = false;
  std::string stale = "refuse";     ///< or "use"
  std::string sceneDb = "central";  ///< or "local"
  RenderSettings settings;
  int threads = 0;
  bool json = false;
  ImportOptions import;  ///< without volumes and the memory limit
};

/// Fills the settings from the texts. Throws Error(kUsage).
void readSettings(RenderArguments& a);

/// The layers that were asked for, with A if there is no background. Throws Error(kUsage).
PictureLayers layersOf(const RenderArguments& a);

/// One picture of the job.
struct View {
  Camera camera;
  std::string output;
};

/// Cameras and file names of all pictures: the scene's first camera, those named, or those of the
/// path. With several, the number of the picture, from 1, takes the place of a run of # in the
/// output's name, or goes before its extension. Throws Error(kUsage or kInput).
std::vector<View> makeViews(const RenderArguments& a, const Scene& scene,
                            const std::optional<Look>& look = {});

}  // namespace trex
