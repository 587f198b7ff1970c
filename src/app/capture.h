// The pictures of a render job, one after another, with checkpoints between.
#pragma once

#include <memory>
#include <nlohmann/json.hpp>
#include <optional>

#include "src/app/progress.h"
#include "src/command/render_arguments.h"
#include "src/frame/layers.h"
#include "src/machines/leader.h"
#include "src/session/checkpoint.h"
#include "src/session/model.h"
#include "src/session/session.h"

namespace trex {

class Capture {
 public:
  /// `leader`: of other machines that take samples too; may be null.
  Capture(const RenderArguments& arguments, std::shared_ptr<const Model> model,
          std::vector<View> views, double importSeconds, machines::Leader* leader = nullptr);

  /// Renders all pictures, or what a checkpoint says is left of them. Returns the exit code: 0, or
  /// 130 or 143 after an interrupt, with the picture so far and the checkpoint saved. If memory or
  /// the device fails the picture so far is saved and the Error passes on.
  int run();

 private:
  void openCheckpoint();
  void runView(std::uint32_t frame);
  void advance(Session& session, std::uint32_t frame);
  void save(Session& session, const View& view, bool report);
  void saveTrace(const Session& session, const View& view) const;
  void saveCheckpoint(Session& session, std::uint32_t frame);
  void tryCheckpoint(Session& session, std::uint32_t frame);

  const RenderArguments& a_;
  std::shared_ptr<const Model> model_;
  std::vector<View> views_;
  PictureLayers layers_;
  double importSeconds_;
  machines::Leader* leader_;
  std::uint64_t key_ = 0;  ///< of the job, if it has checkpoints
  std::optional<CheckpointReader> resumed_;
  double nextCheckpoint_ = 0.0;
  nlohmann::json summaries_ = nlohmann::json::array();  ///< of finished pictures
};

/// Stops of a tone-mapped picture: as asked for, or from the picture. Throws Error(kUsage).
float exposureOf(const RenderArguments& a, const Picture& picture);

/// Hash of all that decides the bits of a job's pictures: the source files, the settings, the
/// views.
std::uint64_t jobKey(const RenderArguments& a, const Model& model, const std::vector<View>& views);
/// Of what several machines must have alike; of the files only where each opens its own.
std::uint64_t machinesDigest(const RenderArguments& a, const Model& model,
                             const std::vector<View>& views);

}  // namespace trex
