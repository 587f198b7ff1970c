#include "src/schedule/machine_record.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "src/core/json_object.h"
#include "src/core/xml_text.h"

namespace trex::schedule {
namespace {

using Json = nlohmann::ordered_json;
constexpr std::uint64_t kVersion = 1;
constexpr std::size_t kMostParts = 64;  ///< of each: more is no machine
constexpr double kMost = 1e30;          ///< of any number

Json timesOf(const MachineRecord& r, std::uint32_t device) {
  Json out = Json::object();
  for (std::uint32_t k = 0; k < r.kinds.size(); ++k) {
    const LinearTime& t = r.timing.at(device, k);
    if (t.rates.empty()) continue;
    out[r.kinds[k]] = {{"setup_seconds", t.setup}, {"seconds_per_unit", t.rates[0]}};
  }
  return out;
}

/// Objects of an array that is not too long.
std::size_t sizeOf(const JsonObject& o, const char* key) {
  const std::size_t size = o.array(key).size();
  if (size > kMostParts) o.bad(key, "{} entries, at most {} are possible", size, kMostParts);
  return size;
}

Channel channelOf(const JsonObject& o, std::size_t memories) {
  o.allow({"name", "bandwidth_bytes_per_second", "latency_seconds", "links"});
  Channel c{o.text("name"),
            o.number("bandwidth_bytes_per_second", 0.0, kMost),
            o.number("latency_seconds", 0.0, kMost),
            {}};
  for (std::size_t i = 0; i < sizeOf(o, "links"); ++i) {
    const JsonObject link = o.element("links", i);
    link.allow({"from", "to"});
    c.links.push_back({static_cast<std::uint32_t>(link.index("from", memories)),
                       static_cast<std::uint32_t>(link.index("to", memories))});
  }
  return c;
}

void readTimes(const JsonObject& o, std::uint32_t device, MachineRecord& out) {
  for (std::uint32_t k = 0; k < out.kinds.size(); ++k) {
    const char* kind = out.kinds[k].c_str();
    if (!o.has(kind)) continue;
    const JsonObject t = o.object(kind);
    t.allow({"setup_seconds", "seconds_per_unit"});
    out.timing.set(
        device, k,
        {t.number("setup_seconds", 0.0, kMost), {t.number("seconds_per_unit", 0.0, kMost)}});
  }
}

MachineRecord readRecord(const JsonObject& o) {
  o.allow({"trex", "machine", "kinds", "memories", "channels", "devices", "errors"});
  o.integer("trex", kVersion, kVersion);
  MachineRecord out;
  out.name = o.text("machine");
  for (std::size_t i = 0; i < sizeOf(o, "kinds"); ++i) {
    const nlohmann::json& kind = o.array("kinds")[i];
    if (!kind.is_string()) o.bad("kinds", "entry {} is no text", i);
    out.kinds.push_back(kind.get<std::string>());
  }
  if (out.kinds.empty()) o.bad("kinds", "is empty");
  for (std::size_t i = 0; i < sizeOf(o, "memories"); ++i) {
    const JsonObject m = o.element("memories", i);
    m.allow({"name", "capacity_bytes"});
    out.graph.memories.push_back({m.text("name"), m.has("capacity_bytes")
                                                      ? m.number("capacity_bytes", 0.0, kMost)
                                                      : kNever});
  }
  const std::size_t memories = out.graph.memories.size();
  for (std::size_t i = 0; i < sizeOf(o, "channels"); ++i) {
    out.graph.channels.push_back(channelOf(o.element("channels", i), memories));
  }
  const std::size_t devices = sizeOf(o, "devices");
  out.timing = TimingModel(static_cast<std::uint32_t>(devices),
                           static_cast<std::uint32_t>(out.kinds.size()));
  for (std::size_t i = 0; i < devices; ++i) {
    const JsonObject d = o.element("devices", i);
    d.allow({"name", "memory", "host", "times"});
    out.graph.devices.push_back({d.text("name"),
                                 static_cast<std::uint32_t>(d.index("memory", memories)),
                                 static_cast<std::uint32_t>(d.index("host", memories))});
    readTimes(d.object("times"), static_cast<std::uint32_t>(i), out);
  }
  const JsonObject errors = o.object("errors");
  errors.allow({"jobs", "median", "percentile_90"});
  out.jobs = errors.integer("jobs", 0, 1u << 30);
  out.medianError = errors.number("median", 0.0, kMost);
  out.percentile90Error = errors.number("percentile_90", 0.0, kMost);
  return out;
}

std::string text(double x, double y, const std::string& content, const char* more = "") {
  return fmt::format("<text x=\"{:.1f}\" y=\"{:.1f}\" text-anchor=\"middle\"{}>{}</text>\n", x, y,
                     more, escaped(content));
}

std::string box(double x, double y, double width, double height, const char* color) {
  return fmt::format(
      "<rect x=\"{:.1f}\" y=\"{:.1f}\" width=\"{:.1f}\" height=\"{:.1f}\" rx=\"4\" fill=\"{}\"/>\n",
      x - width / 2, y, width, height, color);
}

}  // namespace

std::string withPrefix(double value) {
  for (const auto& [scale, prefix] : {std::pair{1e9, "G"}, {1e6, "M"}, {1e3, "k"}}) {
    if (std::abs(value) >= scale) return fmt::format("{:.3g} {}", value / scale, prefix);
  }
  return fmt::format("{:.3g} ", value);
}

std::string textOf(const MachineRecord& r) {
  Json out = {{"trex", kVersion}, {"machine", r.name}, {"kinds", r.kinds}};
  out["memories"] = out["channels"] = out["devices"] = Json::array();
  for (const Memory& m : r.graph.memories) {
    Json memory = {{"name", m.name}};
    if (std::isfinite(m.capacity)) memory["capacity_bytes"] = m.capacity;
    out["memories"].push_back(std::move(memory));
  }
  for (const Channel& c : r.graph.channels) {
    Json links = Json::array();
    for (const Link& link : c.links) links.push_back({{"from", link.from}, {"to", link.to}});
    out["channels"].push_back({{"name", c.name},
                               {"bandwidth_bytes_per_second", c.bandwidth},
                               {"latency_seconds", c.latency},
                               {"links", links}});
  }
  for (std::uint32_t d = 0; d < r.graph.devices.size(); ++d) {
    const Device& device = r.graph.devices[d];
    out["devices"].push_back({{"name", device.name},
                              {"memory", device.memory},
                              {"host", device.host},
                              {"times", timesOf(r, d)}});
  }
  out["errors"] = {
      {"jobs", r.jobs}, {"median", r.medianError}, {"percentile_90", r.percentile90Error}};
  return out.dump(2, ' ', false, Json::error_handler_t::replace) + "\n";
}

MachineRecord recordOf(const std::string& source, const std::string& name) {
  const nlohmann::json json = nlohmann::json::parse(source, nullptr, false);
  const JsonDocument document{name, "; measure again (trex doctor --measure)"};
  if (!json.is_object()) fail(ExitCode::kInput, "{}: no JSON object{}", name, document.advice);
  MachineRecord out = readRecord(JsonObject(json, document, ""));
  try {
    checkGraph(out.graph);
  } catch (const Error& e) {
    fail(ExitCode::kInput, "{}: {}{}", name, e.what(), document.advice);
  }
  return out;
}

std::string graphSvg(const MachineRecord& r) {
  constexpr double kColumn = 300, kMargin = 150, kMemoryTop = 200, kLine = 16;
  const auto columns = static_cast<double>(std::max<std::size_t>(1, r.graph.memories.size()));
  const double width = 2 * kMargin + kColumn * (columns - 1);
  std::vector<double> below(r.graph.memories.size(), kMemoryTop + 70);
  const double deviceHeight = 30 + kLine * static_cast<double>(r.kinds.size());
  const double height =
      kMemoryTop + 90 + (deviceHeight + 12) * static_cast<double>(r.graph.devices.size());
  const auto at = [&](std::uint32_t memory) { return kMargin + kColumn * memory; };
  std::string out = fmt::format(
      "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{0:.0f}\" height=\"{1:.0f}\" viewBox=\"0 "
      "0 "
      "{0:.0f} {1:.0f}\" font-family=\"sans-serif\" font-size=\"12\" "
      "role=\"img\">\n<title>{2}</title>\n"
      "<rect width=\"{0:.0f}\" height=\"{1:.0f}\" fill=\"white\"/>\n",
      width, height, escaped(r.name));
  out += text(width / 2, 22, r.name, " font-size=\"15\" font-weight=\"bold\"");
  for (const Channel& c : r.graph.channels) {
    if (c.links.empty()) continue;
    const double from = at(c.links[0].from), to = at(c.links[0].to), top = kMemoryTop - 60;
    out += fmt::format(
        "<path d=\"M{:.1f} {:.1f}C{:.1f} {:.1f} {:.1f} {:.1f} {:.1f} {:.1f}\" fill=\"none\" "
        "stroke=\"#c14b00\" stroke-width=\"2\"/>\n",
        from, kMemoryTop, from, top, to, top, to, kMemoryTop);
    out += text((from + to) / 2, top - 18, c.name);
    out += text((from + to) / 2, top - 2,
                fmt::format("{}B/s, {:.3g} ms", withPrefix(c.bandwidth), 1e3 * c.latency));
  }
  for (std::uint32_t m = 0; m < r.graph.memories.size(); ++m) {
    const Memory& memory = r.graph.memories[m];
    out += box(at(m), kMemoryTop, 180, 46, "#f2d5c0") + text(at(m), kMemoryTop + 20, memory.name);
    out += text(at(m), kMemoryTop + 37,
                std::isfinite(memory.capacity) ? withPrefix(memory.capacity) + "B" : "store");
  }
  for (std::uint32_t d = 0; d < r.graph.devices.size(); ++d) {
    const Device& device = r.graph.devices[d];
    double y = below[device.memory];
    out += box(at(device.memory), y, 250, deviceHeight, "#cfe3f2");
    out += text(at(device.memory), y += 18, device.name, " font-weight=\"bold\"");
    for (std::uint32_t k = 0; k < r.kinds.size(); ++k) {
      const LinearTime& t = r.timing.at(d, k);
      if (t.rates.empty()) continue;
      out += text(at(device.memory), y += kLine,
                  fmt::format("{}: {}/s, {:.3g} ms a job", r.kinds[k],
                              withPrefix(1.0 / std::max(t.rates[0], 1e-30)), 1e3 * t.setup));
    }
    below[device.memory] += deviceHeight + 12;
  }
  return out + "</svg>\n";
}

}  // namespace trex::schedule
