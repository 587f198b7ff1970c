#include "src/schedule/chrome_trace.h"

#include <fmt/format.h>

#include <nlohmann/json.hpp>

namespace trex::schedule {
namespace {

using Json = nlohmann::ordered_json;

Json event(const std::string& name, std::size_t row, double start, double end) {
  return {{"name", name}, {"ph", "X"},         {"pid", 1},
          {"tid", row},   {"ts", start * 1e6}, {"dur", (end - start) * 1e6}};
}

Json rowName(const std::string& name, std::size_t row) {
  return {
      {"name", "thread_name"}, {"ph", "M"}, {"pid", 1}, {"tid", row}, {"args", {{"name", name}}}};
}

}  // namespace

std::string chromeTrace(const Graph& graph, const Schedule& schedule, const Names& names) {
  Json events = Json::array();
  for (std::size_t d = 0; d < graph.devices.size(); ++d) {
    events.push_back(rowName(graph.devices[d].name, d));
  }
  const std::size_t first = graph.devices.size();
  for (std::size_t c = 0; c < graph.channels.size(); ++c) {
    events.push_back(rowName(graph.channels[c].name, first + c));
  }
  for (const Run& r : schedule.runs) {
    const std::string name = names.job ? names.job(r.job) : fmt::format("job {}", r.job);
    events.push_back(event(name, r.device, r.start, r.end));
  }
  for (const Fetch& f : schedule.fetches) {
    const std::string name = names.item ? names.item(f.item) : fmt::format("item {}", f.item);
    events.push_back(event(name, first + f.channel, f.start, f.end));
    events.back()["args"] = {{"from", graph.memories[f.from].name},
                             {"to", graph.memories[f.to].name}};
  }
  const Json document = {{"displayTimeUnit", "ms"}, {"traceEvents", events}};
  return document.dump(-1, ' ', false, Json::error_handler_t::replace) + "\n";
}

}  // namespace trex::schedule
