// The model and the views of a render job.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "src/bundle/bundle.h"
#include "src/command/render_arguments.h"
#include "src/scene/look.h"
#include "src/session/model.h"
#include "src/vulkan/vulkan.h"

namespace trex {

/// Where the model is, if not in the file of the command line.
struct RenderSource {
  std::shared_ptr<const hccm::PageFile> file;  ///< a bundle; null: as the command line says
  std::uint64_t bytes = 0;                     ///< of it
  bool made =
      false;  ///< of the command line's model, for this render: with environment and volumes
  std::string environment;  ///< instead of the command line's; may be empty
  bool writes = true;       ///< this process writes the pictures
};

struct OpenedRender {
  std::shared_ptr<Model> model;
  std::vector<View> views;
  std::optional<Look> look;  ///< not applied yet
  ModelOptions built;
  double importSeconds = 0.0;
  std::jthread imagesOpening;
  std::optional<vulkan::DriversAhead> drivers;

  void applyLook();
};

/// Whether the files that a render writes can be written. Throws Error(kOutput).
void checkFiles(const RenderArguments& a);

/// Bytes of --page-disk in a folder that hold packed pages for other machines, of a model that has
/// so many; the rest is for pages that were unpacked.
std::uint64_t diskForOthers(const RenderArguments& a, const std::filesystem::path& folder,
                            std::uint64_t modelBytes);

/// Opens the model, makes the views, and fits caches and voxels to the memory there is; from its
/// scene on interrupts are caught. Throws Error.
void openForRender(RenderArguments& a, const RenderSource& source, OpenedRender& out);

}  // namespace trex
