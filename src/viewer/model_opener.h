// Opens a model beside the screen: first its meshes, then the voxels and a device that reads them.
#pragma once

#include <functional>
#include <memory>
#include <optional>

#include "src/bundle/bundle.h"
#include "src/grays/grays.h"
#include "src/session/settings.h"
#include "src/viewer/background.h"
#include "src/viewer/viewer.h"

namespace trex {

/// What is asked for, and who takes it; the takers run on the screen's thread.
struct ModelOpening {
  std::filesystem::path input;
  std::optional<RemoteModel> remote;  ///< `input` is a bundle there
  std::uint64_t cacheBytes = 0;       ///< as ViewerOptions
  OpenOptions options;
  RenderSettings settings;
  std::function<void(std::shared_ptr<Model>, const ModelOptions&)> takeMeshes;
  std::function<void(std::shared_ptr<asvo::Tree>, std::shared_ptr<std::unique_ptr<GRayTracer>>)>
      takeVoxels;
};

/// The job for Background.
Background::Job openingJob(ModelOpening opening);

}  // namespace trex
