#include "src/app/render_report.h"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>

#include "src/core/clock.h"
#include "src/core/memory.h"
#include "src/core/version.h"
#include "src/machines/identity.h"
#include "src/scene/import.h"

namespace trex {
namespace {

std::string guessName(const SessionReport& r) {
  return r.device == "none" ? "none" : guessText(r.coneShare);
}

const char* photonName(const SessionReport& r) {
  if (r.photons == 0) return "none";
  return r.photonRays ? "ray" : "voxel";
}

/// Machines whose samples or photons are in the picture, this one first.
std::vector<machines::MachineRow> contributors(const machines::Leader* leader) {
  std::vector<machines::MachineRow> rows;
  if (leader == nullptr) return rows;
  for (const machines::MachineRow& row : leader->rows()) {
    if (rows.empty() || row.work.jobs > 0 || row.photons > 0) rows.push_back(row);
  }
  return rows;
}

/// The devices of all machines, each once.
std::string deviceText(const SessionReport& r, const machines::Leader* leader) {
  std::vector<std::string> names{r.device};
  const auto rows = contributors(leader);
  for (std::size_t i = 1; i < rows.size(); ++i) {
    if (std::find(names.begin(), names.end(), rows[i].device) == names.end()) {
      names.push_back(rows[i].device);
    }
  }
  std::string text = names[0];
  for (std::size_t i = 1; i < names.size(); ++i) text += "; " + names[i];
  return text;
}

nlohmann::json machineRows(const machines::Leader& leader, const SessionReport& own) {
  nlohmann::json out = nlohmann::json::array();
  auto rows = leader.rows();
  rows[0].device = own.device;
  machines::MachineTimes& times = rows[0].times;
  times = {processorSeconds(),  own.photonSeconds, own.traffic.waiting, own.traffic.unpacking,
           own.traffic.reading, own.pages.loads,   own.pages.restored};
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const machines::MachineRow& row = rows[i];
    const auto measured = [&](double value) {
      return row.link.known() ? nlohmann::json(value) : nlohmann::json();
    };
    out.push_back({{"machine", i},
                   {"host", row.host},
                   {"threads", row.threads},
                   {"instructions", machines::instructionText(row.instructions)},
                   {"device", row.device},
                   {"jobs", row.work.jobs},
                   {"jobs_of_no_use", row.work.twice},
                   {"tile_samples", row.work.units},
                   {"tracing_seconds", row.work.seconds},
                   {"photons", row.photons},
                   {"processor_seconds", row.times.processor},
                   {"photon_seconds", row.times.photons},
                   {"waiting_thread_seconds", row.times.waiting},
                   {"unpacking_thread_seconds", row.times.unpacking},
                   {"reading_thread_seconds", row.times.reading},
                   {"page_loads", row.times.pageLoads},
                   {"page_loads_restored", row.times.pagesRestored},
                   {"link_round_trip_seconds", measured(row.link.roundTrip)},
                   {"link_bytes_a_second", measured(row.link.bandwidth)},
                   {"model_bytes_sent", row.servedBytes},
                   {"page_bytes_planned", row.times.plannedBytes},
                   {"page_bytes_received", row.times.receivedBytes},
                   {"page_bytes_passed_on", row.times.passedBytes},
                   {"peak_resident_bytes", row.peakBytes}});
  }
  return out;
}

}  // namespace

nlohmann::json summary(const RenderArguments& a, const View& view, const Session& session,
                       std::uint64_t replacedParts, double importSeconds, float exposure,
                       const machines::Leader* leader) {
  const SessionReport r = session.report();
  const double error = session.estimatedError();
  nlohmann::json out = {
      {"input", a.input},
      {"output", view.output},
      {"camera", cameraText(view.camera)},
      {"width", a.settings.width},
      {"height", a.settings.height},
      {"samples", r.samplesDone},
      {"exact", a.settings.dial ? nlohmann::json("auto") : nlohmann::json(a.settings.exact)},
      {"exact_share", r.exactShare},
      {"seed", a.settings.seed},
      {"device", deviceText(r, leader)},
      {"guess", guessName(r)},
      {"photon_bounces", photonName(r)},
      {"triangles", r.mesh.triangles},
      {"unique_triangles", r.mesh.uniqueTriangles},
      {"instances", r.mesh.instances},
      {"replaced_parts", replacedParts},
      {"import_seconds", importSeconds},
      {"mesh_build_seconds", r.meshSeconds},
      {"voxel_build_seconds", r.voxelSeconds},
      {"device_start_seconds", r.deviceSeconds},
      {"aim_seconds", r.aimSeconds},
      {"render_seconds", r.renderSeconds},
      {"first_picture_seconds", r.firstPictureSeconds},
      {"photon_seconds", r.photonSeconds},
      {"caustic_seconds", r.causticSeconds},
      {"caustic_photons", r.causticPhotons},
      {"filter_seconds", r.filterSeconds},
      {"denoiser", r.denoiser},
      {"photons", r.photons},
      {"photons_landed", r.photonsLanded},
      {"c_rays", r.rays.cRays},
      {"shadow_rays", r.rays.shadowRays},
      {"g_rays", r.rays.cones},
      {"cache_reads", r.rays.cacheReads},
      {"gather_seconds", r.gRays.gatherSeconds},
      {"gathered_by_device", r.rays.deviceCones},
      {"gathered_by_cpu", r.rays.cones - r.rays.deviceCones + r.rays.cacheReads},
      {"exact_paths", r.rays.exactPaths},
      {"mesh_bytes", r.mesh.meshBytes},
      {"top_level_bytes", r.mesh.topLevelBytes},
      {"texture_bytes", r.textures.texelBytes},
      {"texture_peak_bytes", r.textures.peakBytes},
      {"voxels", r.voxels},
      {"voxel_depth", r.voxelDepth},
      {"voxel_bytes", r.voxelBytes},
      {"device_bytes", r.gRays.deviceBytes},
      {"nonfinite_samples", r.nonFinite},
      {"estimated_relmse", error < 0.0 ? nlohmann::json() : nlohmann::json(error)},
      {"exposure_stops", exposure},
      {"tonemap", a.tonemap},
      {"peak_resident_bytes", peakResidentBytes()}};
  if (leader != nullptr) {
    out["machines"] = machineRows(*leader, r);
    out["jobs_given_out_again"] = leader->jobsAgain();
    out["machine_bytes_sent"] = leader->traffic().sentBytes;
    out["machine_bytes_received"] = leader->traffic().receivedBytes;
  }
  if (r.gRays.pages > 0) {
    out["voxel_pages"] = r.gRays.pages;
    out["voxel_page_slots"] = r.gRays.pageSlots;
    out["voxel_page_loads"] = r.gRays.pageLoads;
    out["voxel_page_evictions"] = r.gRays.pageEvictions;
    out["voxel_missed_reads"] = r.gRays.missedReads;
  }
  if (r.textures.pagedImages > 0) {
    out["paged_images"] = r.textures.pagedImages;
    out["texture_loads"] = r.textures.loads;
    out["texture_evictions"] = r.textures.evictions;
    out["texture_bytes_read"] = r.textures.bytesRead;
  }
  if (r.mesh.pages == 0) return out;
  out["pages"] = r.mesh.pages;
  out["page_cache_bytes"] = r.mesh.cacheBytes;
  out["page_peak_bytes"] = r.pages.peakBytes;
  out["page_loads"] = r.pages.loads;
  out["page_evictions"] = r.pages.evictions;
  out["page_loads_restored"] = r.pages.restored;
  out["page_bytes_read"] = r.pages.bytesRead;
  out["page_disk_bytes"] = r.pages.keptBytes;
  out["ray_memory_bytes"] = a.settings.rayMemory;
  if (a.settings.rayMemory == 0) return out;
  out["page_loads_on_demand"] = r.pages.loads - r.traffic.loads;
  out["tracing_thread_seconds"] = r.traffic.tracing;
  out["waiting_thread_seconds"] = r.traffic.waiting;
  out["unpacking_thread_seconds"] = r.traffic.unpacking;
  out["reading_thread_seconds"] = r.traffic.reading;
  out["pages_read_ahead"] = r.traffic.readAhead;
  out["pages_read_in_vain"] = r.traffic.readInVain;
  out["rays_that_waited"] = r.traffic.rays;
  out["ray_waits"] = r.traffic.waits;
  return out;
}

void addMetadata(Picture& picture, const RenderArguments& a, const View& view,
                 const Session& session, const machines::Leader* leader) {
  const SessionReport r = session.report();
  const auto put = [&](const char* key, const std::string& value) {
    picture.metadata.emplace_back(std::string("trex:") + key, value);
  };
  const dvec3 origin = session.rays().renderOrigin();
  put("version", kVersion);
  put("scene", std::filesystem::path(a.input).filename().string());
  put("camera", cameraText(view.camera));
  put("environment", a.environment.empty() ? "of the scene" : a.environment);
  put("samples", std::to_string(r.samplesDone));
  put("seed", std::to_string(a.settings.seed));
  put("exact", exactText(a.settings));
  put("guess", guessName(r));
  put("photonBounces", photonName(r));
  put("denoised", r.denoiser);
  if (a.settings.transparent) put("transparent", "yes");
  if (a.import.maxBounces) put("maxBounces", bouncesText(*a.import.maxBounces));
  put("device", deviceText(r, leader));
  if (const auto rows = contributors(leader);
      std::any_of(rows.begin(), rows.end(), [&](const machines::MachineRow& row) {
        return row.instructions != rows[0].instructions;
      })) {
    std::string text;
    for (const machines::MachineRow& row : rows) {
      text += (text.empty() ? "" : "; ") + row.host + ": " +
              machines::instructionText(row.instructions);
    }
    put("instructions", text);
  }
  put("nonFiniteSamples", std::to_string(r.nonFinite));
  put("renderOrigin", fmt::format("{},{},{}", origin.x, origin.y, origin.z));
}

}  // namespace trex
