#include <fmt/format.h>

#include "src/app/view/panels.h"
#include "src/core/memory.h"

namespace trex {
namespace {

std::string rate(double perSecond) {
  if (perSecond >= 1e6) return fmt::format("{:.2f} M/s", 1e-6 * perSecond);
  if (perSecond >= 1e3) return fmt::format("{:.1f} k/s", 1e-3 * perSecond);
  return fmt::format("{:.0f} /s", perSecond);
}

std::string estimate(double value) {
  return value < 0.0 ? "not known yet" : fmt::format("{:.3g}", value);
}

const char* phaseName(OpenPhase phase) {
  switch (phase) {
    case OpenPhase::kEmpty:
      return "nothing is open";
    case OpenPhase::kImporting:
      return "reading the model";
    case OpenPhase::kVoxels:
      return "making voxels";
    case OpenPhase::kReady:
      return "ready";
    default:
      return "failed";
  }
}

}  // namespace

void statusPanel(Ui& ui) {
  const ViewerFigures f = ui.viewer.figures();
  heading("How far from the truth");
  figure("Distance", estimate(f.truthDistance),
         "Estimated relMSE against the exact picture: noise and bias together");
  figure("of it noise", estimate(f.noise));
  figure("of it bias", estimate(f.bias), "What the fast guess gets wrong on average");
  if (f.splitError >= 0.0) {
    figure("Split, error", estimate(f.splitError), "Between both sides of the divider");
  }
  heading("Work");
  figure("Samples", fmt::format("{:.1f} a pixel", f.samplesPerPixel));
  figure("Traced exactly", fmt::format("{:.1f} %", 100.0 * f.exactShare));
  figure("C-rays", rate(f.cRaysPerSecond), "Exact rays against the mesh, on the CPU");
  figure("G-rays", rate(f.gRaysPerSecond), "Wide rays and photons through voxels, on the device");
  figure("Photons", fmt::format("{:.2f} M", 1e-6 * static_cast<double>(f.session.photons)));
  if (f.machines > 0) {
    figure("Machines", fmt::format("{} of {} others help", f.readyMachines, f.machines));
  }
  figure("State", f.converged ? "converged" : phaseName(ui.viewer.phase()));
  heading("Memory");
  figure("Mesh", formatBytes(f.meshBytes), "With all of its hierarchy, for C-rays");
  figure("Voxels", formatBytes(f.voxelBytes), fmt::format("Depth {}", f.voxelDepth).c_str());
  figure("Process", formatBytes(f.residentBytes));
  figure("Device", formatBytes(f.deviceBytes));
  heading("Devices");
  weakText("G-rays: " + f.device);
  weakText("Window: " + ui.window.deviceName());
}

}  // namespace trex
