// What a render is asked for.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>

#include "src/paths/load_order.h"
#include "src/scene/scene.h"

namespace trex::schedule {
struct MachineRecord;
}

namespace trex {

/// Which rung of the ladder serves as the guess of far, wide rays.
enum class GuessKind : std::uint8_t {
  kAuto,   ///< a share of kMixed as the device pays for: see cone_share.h
  kRay,    ///< G1: an exact ray that ends in cached light
  kCone,   ///< G0: a cone through the voxels beyond the near field
  kMixed,  ///< G0 for a share of the samples, G1 for the others
};

/// How photons go on from their first surface.
enum class PhotonKind : std::uint8_t {
  kAuto,   ///< through voxels where the device has cores of its own, else by rays
  kRay,    ///< as C-rays between the real surfaces
  kVoxel,  ///< through the voxels, on the device
};

/// What takes the noise of a picture.
enum class Denoise : std::uint8_t {
  kOff,
  kFilter,  ///< of ours: src/frame/denoise.h
  kOidn,    ///< Open Image Denoise, or an error
  kAuto,  ///< Open Image Denoise where it can be used and pays, else the filter; nothing at exact 1
};

struct RenderSettings {
  static constexpr int kBestDevice = -1;
  static constexpr int kNoDevice = -2;

  std::uint32_t width = 640, height = 360;
  std::uint32_t samples = 0;  ///< a pixel; 0: no limit
  double seconds = 0.0;       ///< of rendering after set-up; 0: no limit
  double error = 0.0;         ///< estimated relMSE of the noise to stop at; 0: no limit
  double exact = 0.0;         ///< share of samples traced exactly, [0, 1]
  bool dial = false;  ///< the share is chosen as it renders (dial.h), and `exact` kFirstShare
  std::uint32_t seed = 0;
  int device = kBestDevice;  ///< number of a Vulkan device, or one of the above
  GuessKind guess = GuessKind::kAuto;
  double coneShare = 0.0;  ///< of kMixed, [0, 1]
  /// What was measured of this machine, for kAuto; null: nothing.
  std::shared_ptr<const schedule::MachineRecord> machine;
  PhotonKind photonKind = PhotonKind::kAuto;
  Denoise denoise = Denoise::kOff;
  bool transparent = false;         ///< no background; R, G, B are premultiplied by the layer A
  bool interactive = false;         ///< driven by step(), see session.h
  std::uint64_t photons = 0;        ///< at least so many before the first sample
  std::optional<Camera> aim;        ///< where photons from outside are aimed; none: the camera
  std::uint64_t maxMemory = 0;      ///< bytes this process may use; 0: what the machine has
  std::uint64_t textureMemory = 0;  ///< bytes of texels in memory; 0: all of them
  /// Bytes of paths that wait for pages, where these do not fit in memory; 0: threads wait.
  std::uint64_t rayMemory = 0;
  std::uint64_t sharedBytes = 0;           ///< of what comes from and goes to other machines
  bool servesModel = false;                ///< which are given a copy of the model in memory
  bool recordTraffic = false;              ///< of paths that wait: Session::traffic()
  LoadOrder loadOrder = LoadOrder::kPlan;  ///< of pages that paths wait for
  std::uint64_t maxGpuMemory = 0;          ///< bytes of device memory; 0: what the device has
};

/// The share of exact samples as a user gives it: a number, or auto.
std::string exactText(const RenderSettings& settings);
/// The guess as a user gives it: auto, ray, cone, or the share of cones.
std::string guessText(const RenderSettings& settings);
/// The same of a share: ray is 0, cone is 1.
std::string guessText(double coneShare);

}  // namespace trex
