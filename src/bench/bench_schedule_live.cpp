#include "src/bench/bench_schedule_live.h"

#include <fmt/format.h>

#include <algorithm>
#include <memory>
#include <vector>

#include "src/bench/cold_pages.h"
#include "src/bundle/bundle.h"
#include "src/bundle/page_disk.h"
#include "src/command/parse.h"
#include "src/core/clock.h"
#include "src/core/error.h"
#include "src/core/file.h"
#include "src/session/session.h"

namespace trex {
namespace {

using Json = nlohmann::ordered_json;

struct Way {
  const char* name;
  bool all, waits, predicts, keeps;
};
constexpr Way kWays[] = {{"all in memory", true, false, false, false},
                         {"on demand", false, false, false, false},
                         {"batched", false, true, false, false},
                         {"batched, predicted", false, true, true, false},
                         {"same, kept unpacked", false, true, true, true}};

struct Rendered {
  Json row;
  std::vector<float> values;
};

void writeTraces(const LiveArguments& a, const Session& session) {
  const TrafficRecord& record = *session.traffic();
  if (!a.picture.empty()) {
    writeTextAtomically(a.picture, record.svg(fmt::format("{}, {} samples", a.bundle, a.samples)));
  }
  if (!a.trace.empty()) writeTextAtomically(a.trace, record.chromeTrace());
}

Rendered render(const LiveArguments& a, const Way& way) {
  OpenOptions open;
  if (a.cold || a.diskRate > 0.0) {
    const auto disk = std::make_shared<SlowDisk>(1e6 * a.diskRate, 1e-3 * a.diskLatency);
    open.pages = [&a, disk](std::uint64_t start) {
      return std::make_unique<ColdPages>(a.bundle, start, disk);
    };
  }
  open.model.voxels = a.exact < 1.0;
  open.prepare = [&](const Scene&, ModelOptions& model) {
    if (model.paged.pages == 0) {
      fail(ExitCode::kInput, "{}: has no pages; bake it with --stream", a.bundle);
    }
    const double share = a.cacheShare * static_cast<double>(model.paged.pages);
    model.cacheBytes = way.all ? 0 : std::max<std::uint64_t>(static_cast<std::uint64_t>(share), 1);
    const auto folder = std::filesystem::temp_directory_path();
    if (way.keeps) model.pageDisk = {folder, std::min(spareDisk(folder), 2 * model.paged.pages)};
  };
  const auto model = std::make_shared<const Model>(openModel(a.bundle, open));
  RenderSettings settings;
  parseSize(a.size, settings.width, settings.height);
  settings.samples = way.all || way.waits ? a.samples : std::min(a.samples, a.demandSamples);
  settings.exact = a.exact;
  settings.device = RenderSettings::kNoDevice;
  settings.rayMemory = way.waits ? parseBytes("--ray-memory", a.rayMemory) : 0;
  settings.loadOrder = way.predicts ? LoadOrder::kPlan : LoadOrder::kWaiting;
  settings.recordTraffic = way.predicts && !(a.picture.empty() && a.trace.empty());
  Session session(model, model->scene.cameras.front(), settings);
  const double before = processorSeconds();
  session.run();
  const double processors = processorSeconds() - before;
  const SessionReport r = session.report();
  if (settings.recordTraffic) writeTraces(a, session);
  Rendered out;
  out.row = {{"way", way.name},
             {"samples", settings.samples},
             {"seconds", r.renderSeconds},
             {"processor_seconds", processors},
             {"photons", r.photons},
             {"photon_seconds", r.photonSeconds},
             {"page_loads", r.pages.loads},
             {"page_loads_restored", r.pages.restored},
             {"pages", r.mesh.pages},
             {"page_cache_bytes", r.mesh.cacheBytes},
             {"page_peak_bytes", r.pages.peakBytes}};
  if (way.waits) {
    out.row["page_loads_on_demand"] = r.pages.loads - r.traffic.loads;
    out.row["waiting_share"] = r.traffic.waiting / r.traffic.tracing;
    out.row["unpacking_share"] = r.traffic.unpacking / r.traffic.tracing;
    out.row["reading_seconds"] = r.traffic.reading;
    out.row["pages_read_ahead"] = r.traffic.readAhead;
    out.row["pages_read_in_vain"] = r.traffic.readInVain;
  }
  out.values = session.picture().values;
  return out;
}

}  // namespace

nlohmann::ordered_json benchLive(const LiveArguments& a) {
  Json document = {{"bench", "schedule, live"},
                   {"bundle", a.bundle},
                   {"size", a.size},
                   {"samples", a.samples},
                   {"exact", a.exact},
                   {"cache_share", a.cacheShare},
                   {"ray_memory_bytes", parseBytes("--ray-memory", a.rayMemory)},
                   {"cold", a.cold || a.diskRate > 0.0},
                   {"disk_bytes_a_second", 1e6 * a.diskRate},
                   {"rows", Json::array()}};
  std::vector<float> whole;
  for (const Way& way : kWays) {
    if (!way.all && !way.waits && a.demandSamples == 0) continue;
    Rendered made = render(a, way);
    if (way.all) whole = made.values;
    if (made.row["samples"] == a.samples) made.row["same_bytes"] = made.values == whole;
    document["rows"].push_back(made.row);
  }
  return document;
}

void printLive(const nlohmann::ordered_json& document) {
  fmt::print("{:<19} {:>7} {:>9} {:>11} {:>10} {:>10} {:>13} {:>6} {:>8} {:>9} {:>5}\n", "",
             "samples", "seconds", "processors", "loads", "unpacked", "loads/sample", "ahead",
             "waiting", "unpacking", "same");
  for (const Json& r : document["rows"]) {
    const auto share = [&](const char* key) {
      return r.contains(key) ? fmt::format("{:.1f} %", 100.0 * r[key].get<double>())
                             : std::string();
    };
    const bool same = r.value("same_bytes", false);
    const std::uint64_t loads = r["page_loads"], restored = r["page_loads_restored"];
    fmt::print(
        "{:<19} {:>7} {:>7.2f} s {:>9.2f} s {:>10} {:>10} {:>13.0f} {:>6} {:>8} {:>9} {:>5}\n",
        r["way"].get<std::string>(), r["samples"].get<int>(), r["seconds"].get<double>(),
        r["processor_seconds"].get<double>(), loads, loads - restored,
        static_cast<double>(loads) / r["samples"].get<double>(),
        r.contains("pages_read_ahead")
            ? fmt::format("{}", r["pages_read_ahead"].get<std::uint64_t>())
            : std::string(),
        share("waiting_share"), share("unpacking_share"),
        r.contains("same_bytes") ? (same ? "yes" : "NO") : "");
  }
}

}  // namespace trex
