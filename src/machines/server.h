// A machine that traces for a window: machine 0's (servers.h). It follows the window's look and
// light and takes whole samples of tiles; what it has been asked for is void with the next edit.
#pragma once

#include <filesystem>
#include <memory>
#include <string>

#include "src/machines/window_messages.h"
#include "src/machines/worker.h"
#include "src/session/model_editor.h"

namespace trex::machines {

class Server : public Worker {
 public:
  using Worker::Worker;

  /// What the window was started with; nothing if it has closed before. Throws Error.
  std::optional<Serve> awaitServe(const Welcome& welcome);
  /// Takes samples until machine 0 says stop. `model`: without voxels; `voxels`: its own, null
  /// where every sample is exact; `options`: it was made with these; `settings`: the window's.
  void run(std::shared_ptr<Model> model, std::shared_ptr<asvo::Tree> voxels,
           const ModelOptions& options, RenderSettings settings, std::uint64_t digest);
  /// Here, and sends them to a window that wants them.
  std::optional<ShotPhotons> shoot(const PhotonBatch& batch, const ShootHere& here,
                                   const std::function<bool()>& keepGoing) override;

 private:
  struct Window;

  void follow(Window& window, const Edit& edit);
  void goOnWithLight(Window& window);
  void startLight(Window& window);
  bool take(Window& window, const Lent& lent, std::uint32_t begun);

  std::uint32_t shotLight_ = 0;  ///< number of the light whose photons are shot
};

/// Of what machines open that have their own copies of a model, or of none. Throws Error(kInput).
std::uint64_t windowDigest(const std::filesystem::path& model);

/// The arguments of Serve, each ended by a zero, and back.
std::string joinArguments(const std::vector<std::string>& arguments);
std::vector<std::string> splitArguments(const std::string& joined);

}  // namespace trex::machines
