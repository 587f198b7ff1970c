#include "src/bench/report_html.h"

#include <fmt/format.h>

#include "src/bench/bench_tradeoff.h"
#include "src/bench/chart.h"
#include "src/core/xml_text.h"

namespace trex {
namespace {

using nlohmann::json;

constexpr const char* kStyle =
    "body{font:15px/1.45 sans-serif;max-width:1340px;margin:1.5em auto;padding:0 1em;color:#222}"
    "table{border-collapse:collapse;margin:.8em 0}"
    "td,th{border:1px solid #ccc;padding:.25em .6em;text-align:right}"
    "td:first-child,th:first-child{text-align:left}"
    ".row{display:flex;flex-wrap:wrap;gap:10px}figure{margin:0}"
    "figure img{width:256px;image-rendering:pixelated;display:block}"
    "figcaption{font-size:13px;max-width:256px}svg{max-width:100%;height:auto}";

using Cells = std::vector<std::string>;

/// Cells of a row in turn; `tag` is td or th.
std::string row(const Cells& cells, const char* tag) {
  std::string out = "<tr>";
  for (const std::string& cell : cells) out += fmt::format("<{0}>{1}</{0}>", tag, escaped(cell));
  return out + "</tr>\n";
}

std::string table(const Cells& header, const std::vector<Cells>& rows) {
  std::string out = "<table>\n" + row(header, "th");
  for (const Cells& cells : rows) out += row(cells, "td");
  return out + "</table>\n";
}

/// A number with so many significant digits; a dash for null or what is not there.
std::string number(const json& object, const char* key, int digits = 3) {
  const auto at = object.find(key);
  if (at == object.end() || !at->is_number()) return "-";
  return fmt::format("{:.{}g}", at->get<double>(), digits);
}

std::string seconds(const json& object, const char* key) {
  const auto at = object.find(key);
  if (at == object.end() || !at->is_number()) return "-";
  return fmt::format("{:.2f}", at->get<double>());
}

std::string percent(const json& object, const char* key) {
  return fmt::format("{:.1f} %", 100.0 * object.at(key).get<double>());
}

std::string nameOf(const json& run) {
  const std::string share = shareText(run);
  return share == "0" ? "guess (exact 0)" : "exact " + share;
}

std::string picture(const json& shown, const std::string& caption) {
  return fmt::format(
      "<figure><img alt=\"{0}\" src=\"data:image/png;base64,{1}\"><figcaption>{0}</figcaption>"
      "</figure>\n",
      escaped(caption), escaped(shown.at("png_base64").get<std::string>()));
}

std::string pictures(const json& scene, const char* which) {
  std::string out = "<div class=\"row\">\n" + picture(scene.at("reference"), "reference");
  const auto add = [&](const json& of, const std::string& name) {
    if (!of.contains(which)) return;
    out += picture(of.at(which), fmt::format("{}, {} s", name, seconds(of.at(which), "seconds")));
  };
  for (const json& run : scene.at("runs")) add(run, nameOf(run));
  for (const json& peer : scene.at("peers")) add(peer, peer.at("renderer"));
  return out + "</div>\n";
}

std::string rayTable(const json& scene) {
  std::vector<Cells> rows;
  for (const json& run : scene.at("runs")) {
    const json& rays = run.at("rays");
    rows.push_back({nameOf(run), number(rays, "c_rays"), percent(rays, "c_ray_share"),
                    number(rays, "shadow_rays"), percent(rays, "shadow_ray_share"),
                    number(rays, "g_rays"), percent(rays, "g_ray_share"),
                    number(rays, "cache_reads"), percent(rays, "cache_read_share"),
                    number(rays, "exact_paths"), number(run, "photons")});
  }
  return table({"rays", "C-rays", "share", "shadow rays", "share", "G-rays", "share", "cache reads",
                "share", "exact paths", "photons"},
               rows);
}

std::string startTable(const json& scene) {
  const json& setup = scene.at("setup");
  std::vector<Cells> rows;
  for (const json& run : scene.at("runs")) {
    const bool voxels = shareText(run) != "1";
    rows.push_back({nameOf(run), seconds(setup, "import_seconds"),
                    seconds(setup, "mesh_build_seconds"),
                    voxels ? seconds(setup, "voxel_build_seconds") : "-",
                    voxels ? seconds(run, "device_start_seconds") : "-",
                    voxels ? seconds(run, "aim_seconds") : "-"});
  }
  for (const json& peer : scene.at("peers")) {
    rows.push_back({peer.at("renderer"), seconds(peer, "start_seconds"), "-", "-", "-", "-"});
  }
  return table({"start-up, seconds", "import", "mesh", "voxels", "device", "aiming photons"}, rows);
}

std::string pointTable(const json& scene) {
  std::vector<Cells> rows;
  const auto add = [&](const json& of, const std::string& name) {
    for (const json& p : of.at("points")) {
      rows.push_back({name, seconds(p, "seconds"), number(p, "samples", 6), number(p, "relmse", 4),
                      number(p, "flip", 4), number(p, "mean_ratio", 5)});
    }
  };
  for (const json& run : scene.at("runs")) add(run, nameOf(run));
  for (const json& peer : scene.at("peers")) add(peer, peer.at("renderer"));
  return "<details><summary>All points</summary>\n" +
         table({"", "seconds", "samples", "relMSE", "FLIP", "mean ratio"}, rows) + "</details>\n";
}

std::string slopeTable(const json& scene) {
  std::vector<Cells> rows;
  for (const json& run : scene.at("runs")) {
    if (run.at("points").empty()) continue;
    const json& last = run.at("points").back();
    rows.push_back({nameOf(run), seconds(last, "seconds"), number(last, "samples", 6),
                    number(last, "relmse"), number(last, "flip"), number(last, "mean_ratio", 4),
                    number(run, "slope")});
  }
  return table({"at the end", "seconds", "samples", "relMSE", "FLIP", "mean ratio", "relMSE ~ t^"},
               rows);
}

std::string referenceText(const json& reference) {
  if (reference.at("file") != "auto") return "Reference: a picture of another run or renderer.";
  return fmt::format(
      "Reference: exact mode, {} s, {} samples, another seed; its own noise is in "
      "the errors.",
      seconds(reference, "seconds"), number(reference, "samples", 6));
}

std::string sceneSection(const json& scene) {
  std::string out = fmt::format("<h2>{}</h2>\n<p>{}</p>\n", escaped(scene.at("name")),
                                escaped(referenceText(scene.at("reference"))));
  out += "<div class=\"row\">\n" + tradeoffSvg(scene, "relmse") + tradeoffSvg(scene, "flip") +
         "</div>\n" + slopeTable(scene);
  out += "<h3>Early</h3>\n" + pictures(scene, "picture_early");
  out += "<h3>At the end</h3>\n" + pictures(scene, "picture_last");
  return out + rayTable(scene) + startTable(scene) + pointTable(scene);
}

}  // namespace

std::string tradeoffSvg(const json& scene, const std::string& metric) {
  const bool flip = metric == "flip";
  Chart chart{fmt::format("{}: {} over time", scene.at("name").get<std::string>(),
                          flip ? "FLIP" : "relMSE"),
              "seconds of rendering, filter included",
              flip ? "FLIP" : "relMSE",
              !flip,
              {}};
  const auto add = [&](const json& of, const std::string& name, bool dashed) {
    Series series{name, dashed, {}};
    for (const json& p : of.at("points")) {
      if (!p.at(metric).is_number()) continue;
      series.points.emplace_back(p.at("seconds"), p.at(metric));
    }
    chart.series.push_back(std::move(series));
  };
  for (const json& run : scene.at("runs")) add(run, nameOf(run), false);
  for (const json& peer : scene.at("peers")) add(peer, peer.at("renderer"), true);
  return chartSvg(chart);
}

std::string tradeoffHtml(const json& document) {
  const json& machine = document.at("machine");
  const json& settings = document.at("settings");
  std::string out = fmt::format(
      "<!DOCTYPE html>\n<html lang=\"en\">\n<head><meta charset=\"utf-8\">"
      "<title>Speed against accuracy</title>\n<style>{}</style></head>\n<body>\n"
      "<h1>Speed against accuracy</h1>\n<p>{}, {} threads of {}; G-rays on {}; trex {}; {}x{}, "
      "seed {}. Error against seconds of rendering; start-up is listed apart.</p>\n",
      kStyle, escaped(machine.at("cpu")), machine.at("threads").get<int>(),
      machine.at("cores").get<int>(), escaped(machine.at("device")), escaped(machine.at("version")),
      settings.at("width").get<int>(), settings.at("height").get<int>(),
      settings.at("seed").get<std::uint32_t>());
  for (const json& scene : document.at("scenes")) out += sceneSection(scene);
  return out + "</body>\n</html>\n";
}

}  // namespace trex
