#include "src/schedule/picture.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "src/core/xml_text.h"

namespace trex::schedule {
namespace {

constexpr double kWidth = 960, kLeft = 130, kRight = 890, kTop = 40, kRowHeight = 22,
                 kBarHeight = 16;
constexpr double kNarrow = 0.4;  ///< pixels that are not seen apart
constexpr const char* kJobs = "#0072b2";
constexpr const char* kTransfers = "#c14b00";

struct Bar {
  double start = 0.0, end = 0.0;  ///< seconds
};

/// Bars of a row, with those joined that have less than `gap` seconds between them.
std::vector<Bar> joined(std::vector<Bar> bars, double gap) {
  std::sort(bars.begin(), bars.end(), [](const Bar& a, const Bar& b) { return a.start < b.start; });
  std::vector<Bar> out;
  for (const Bar& b : bars) {
    if (!out.empty() && b.start - out.back().end < gap) {
      out.back().end = std::max(out.back().end, b.end);
    } else {
      out.push_back(b);
    }
  }
  return out;
}

/// A step of 1, 2 or 5 times a power of ten that gives about ten marks.
double tickOf(double seconds) {
  const double power = std::pow(10.0, std::floor(std::log10(seconds / 10.0)));
  for (double step : {1.0, 2.0, 5.0}) {
    if (seconds / (step * power) <= 12.0) return step * power;
  }
  return 10.0 * power;
}

std::string row(const std::string& name, double share, const std::vector<Bar>& bars, double y,
                double scale, const char* color) {
  std::string out = fmt::format("<text x=\"{}\" y=\"{:.1f}\" text-anchor=\"end\">{}</text>\n",
                                kLeft - 8, y + 12.5, escaped(name));
  out += fmt::format("<text x=\"{}\" y=\"{:.1f}\" fill=\"#555\">{:.0f} %</text>\n", kRight + 8,
                     y + 12.5, 100.0 * share);
  out += fmt::format("<rect x=\"{}\" y=\"{:.1f}\" width=\"{}\" height=\"{}\" fill=\"#f2f2f2\"/>\n",
                     kLeft, y, kRight - kLeft, kBarHeight);
  out += fmt::format("<path fill=\"{}\" d=\"", color);
  for (const Bar& b : bars) {
    out += fmt::format("M{:.2f} {:.1f}h{:.2f}v{}h{:.2f}z", kLeft + b.start * scale, y,
                       (b.end - b.start) * scale, kBarHeight, (b.start - b.end) * scale);
  }
  return out + "\"/>\n";
}

}  // namespace

std::string timelineSvg(const Graph& graph, const Schedule& schedule, const std::string& title) {
  const double makespan = std::max(schedule.makespan(), 1e-9);
  const double scale = (kRight - kLeft) / makespan;
  std::vector<std::vector<Bar>> rows(graph.devices.size() + graph.channels.size());
  for (const Run& r : schedule.runs) rows[r.device].push_back({r.start, r.end});
  for (const Fetch& f : schedule.fetches) {
    rows[graph.devices.size() + f.channel].push_back({f.start, f.end});
  }
  const double bottom = kTop + kRowHeight * static_cast<double>(rows.size());
  std::string out = fmt::format(
      "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{0}\" height=\"{1:.0f}\" "
      "viewBox=\"0 0 {0} {1:.0f}\" font-family=\"sans-serif\" font-size=\"12\" role=\"img\">\n"
      "<title>{2}</title>\n<rect width=\"{0}\" height=\"{1:.0f}\" fill=\"white\"/>\n"
      "<text x=\"12\" y=\"22\" font-size=\"15\" font-weight=\"bold\">{2}</text>\n",
      kWidth, bottom + 40, escaped(title));
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const bool device = i < graph.devices.size();
    double busy = 0.0;
    for (const Bar& b : rows[i]) busy += b.end - b.start;
    out += row(device ? graph.devices[i].name : graph.channels[i - graph.devices.size()].name,
               busy / makespan, joined(rows[i], kNarrow / scale),
               kTop + kRowHeight * static_cast<double>(i), scale, device ? kJobs : kTransfers);
  }
  const double tick = tickOf(makespan);
  for (int k = 0; k * tick <= makespan; ++k) {
    const double x = kLeft + k * tick * scale;
    out += fmt::format(
        "<line x1=\"{0:.1f}\" y1=\"{1}\" x2=\"{0:.1f}\" y2=\"{2:.1f}\" stroke=\"#999\" "
        "stroke-width=\"0.5\"/>\n<text x=\"{0:.1f}\" y=\"{3:.1f}\" text-anchor=\"middle\">{4:g}"
        "</text>\n",
        x, kTop - 4, bottom, bottom + 16, k * tick);
  }
  return out + fmt::format(
                   "<text x=\"{}\" y=\"{:.1f}\" text-anchor=\"middle\">seconds; blue: jobs, "
                   "orange: transfers; right: share of the time</text>\n</svg>\n",
                   (kLeft + kRight) / 2, bottom + 33);
}

}  // namespace trex::schedule
