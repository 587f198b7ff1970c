#include "src/bench/chart.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "src/core/xml_text.h"

namespace trex {
namespace {

constexpr double kWidth = 640, kHeight = 400, kLeft = 70, kRight = 500, kTop = 70, kBottom = 350;
constexpr double kLabelHeight = 15;
/// Dark enough to be read as text on white; apart for the usual colour blindnesses.
constexpr const char* kColors[] = {"#0072b2", "#c14b00", "#007a5a", "#a8488a",
                                   "#7a6200", "#444444", "#5b3fa0", "#b0003a"};

const char* colorOf(std::size_t i) { return kColors[i % std::size(kColors)]; }

/// One axis: values to pixels.
struct Axis {
  double low = 1.0, high = 2.0, from = 0.0, to = 1.0;
  bool logarithmic = true;
  double operator()(double v) const {
    const double at =
        logarithmic ? std::log(v / low) / std::log(high / low) : (v - low) / (high - low);
    return from + (to - from) * at;
  }
};

using Point = std::pair<double, double>;

bool drawable(const Chart& chart, const Point& p) {
  return std::isfinite(p.first) && std::isfinite(p.second) && p.first > 0.0 &&
         (!chart.logY || p.second > 0.0);
}

/// A round number of at least v: 1, 2 or 5 times a power of ten.
double roundUp(double v) {
  const double power = std::pow(10.0, std::floor(std::log10(v)));
  for (double step : {1.0, 2.0, 5.0}) {
    if (step * power >= v * 0.999) return step * power;
  }
  return 10.0 * power;
}

void fitAxes(const Chart& chart, Axis& x, Axis& y) {
  double lowX = HUGE_VAL, highX = 0.0, lowY = HUGE_VAL, highY = 0.0;
  for (const Series& s : chart.series) {
    for (const Point& p : s.points) {
      if (!drawable(chart, p)) continue;
      lowX = std::min(lowX, p.first);
      highX = std::max(highX, p.first);
      lowY = std::min(lowY, p.second);
      highY = std::max(highY, p.second);
    }
  }
  if (highX <= 0.0) lowX = highX = lowY = highY = 1.0;
  x = {lowX / 1.15, highX * 1.15, kLeft, kRight, true};
  y = {0.0, 1.0, kBottom, kTop, chart.logY};
  if (chart.logY) {
    y.low = lowY / 1.3;
    y.high = highY * 1.3;
  } else {
    y.high = std::max(highY * 1.05, 1e-6);
  }
}

/// Powers of two on the time axis; thinned to what fits.
std::vector<double> timeTicks(const Axis& x) {
  std::vector<double> ticks;
  const int first = static_cast<int>(std::ceil(std::log2(x.low)));
  const int last = static_cast<int>(std::floor(std::log2(x.high)));
  const int step = std::max(1, (last - first) / 8);
  for (int i = first; i <= last; i += step) ticks.push_back(std::exp2(i));
  return ticks;
}

std::vector<double> valueTicks(const Axis& y) {
  std::vector<double> ticks;
  if (!y.logarithmic) {
    const double step = roundUp(y.high / 6.0);
    for (int i = 0; i * step <= y.high; ++i) ticks.push_back(i * step);
    return ticks;
  }
  const bool fine = y.high / y.low < 1e3;
  for (int power = static_cast<int>(std::floor(std::log10(y.low))); power < 40; ++power) {
    for (double digit : {1.0, 2.0, 5.0}) {
      const double tick = digit * std::pow(10.0, power);
      if (tick > y.high) return ticks;
      if (tick >= y.low && (fine || digit == 1.0)) ticks.push_back(tick);
    }
  }
  return ticks;
}

std::string text(double x, double y, const std::string& anchor, const std::string& content,
                 const std::string& more = "") {
  return fmt::format("<text x=\"{:.1f}\" y=\"{:.1f}\" text-anchor=\"{}\"{}>{}</text>\n", x, y,
                     anchor, more, escaped(content));
}

std::string line(double x1, double y1, double x2, double y2, const std::string& style) {
  return fmt::format("<line x1=\"{:.1f}\" y1=\"{:.1f}\" x2=\"{:.1f}\" y2=\"{:.1f}\" {}/>\n", x1, y1,
                     x2, y2, style);
}

std::string frame(const Chart& chart, const Axis& x, const Axis& y) {
  const std::string grid = "stroke=\"#ddd\"", axis = "stroke=\"#333\"";
  std::string out;
  for (double tick : timeTicks(x)) {
    out += line(x(tick), kTop, x(tick), kBottom, grid);
    out += text(x(tick), kBottom + 18, "middle", fmt::format("{:g}", tick));
  }
  for (double tick : valueTicks(y)) {
    out += line(kLeft, y(tick), kRight, y(tick), grid);
    out += text(kLeft - 8, y(tick) + 4, "end", fmt::format("{:.3g}", tick));
  }
  out += line(kLeft, kBottom, kRight, kBottom, axis) + line(kLeft, kTop, kLeft, kBottom, axis);
  out += text(kLeft, 22, "start", chart.title, " font-size=\"16\" font-weight=\"bold\"");
  out += text((kLeft + kRight) / 2, kBottom + 40, "middle", chart.xLabel);
  out += text(0, 0, "middle", chart.yLabel,
              fmt::format(" transform=\"translate(18 {:.1f}) rotate(-90)\"", (kTop + kBottom) / 2));
  return out;
}

std::string strokeOf(const Chart& chart, std::size_t i) {
  return fmt::format("stroke=\"{}\" stroke-width=\"2\"{}", colorOf(i),
                     chart.series[i].dashed ? " stroke-dasharray=\"6 4\"" : "");
}

std::string legend(const Chart& chart) {
  std::string out;
  double at = kLeft, y = 42;
  for (std::size_t i = 0; i < chart.series.size(); ++i) {
    const double width = 34 + 6.5 * static_cast<double>(chart.series[i].name.size());
    if (at + width > kWidth && at > kLeft) {
      at = kLeft;
      y += kLabelHeight;
    }
    out += line(at, y - 4, at + 22, y - 4, strokeOf(chart, i));
    out += text(at + 27, y, "start", chart.series[i].name);
    at += width + 8;
  }
  return out;
}

std::string curve(const Chart& chart, std::size_t i, const Axis& x, const Axis& y) {
  std::string path, marks;
  for (const Point& p : chart.series[i].points) {
    if (!drawable(chart, p)) continue;
    path += fmt::format("{:.1f},{:.1f} ", x(p.first), y(p.second));
    marks += fmt::format("<circle cx=\"{:.1f}\" cy=\"{:.1f}\" r=\"2.5\" fill=\"{}\"/>\n",
                         x(p.first), y(p.second), colorOf(i));
  }
  if (path.empty()) return "";
  path.pop_back();
  return fmt::format("<polyline points=\"{}\" fill=\"none\" {}/>\n", path, strokeOf(chart, i)) +
         marks;
}

/// Names at the ends of the curves, moved apart where they would overlap.
std::string endLabels(const Chart& chart, const Axis& x, const Axis& y) {
  struct Label {
    double x, end, y;
    std::size_t series;
  };
  std::vector<Label> labels;
  for (std::size_t i = 0; i < chart.series.size(); ++i) {
    const auto& points = chart.series[i].points;
    const auto last = std::find_if(points.rbegin(), points.rend(),
                                   [&](const Point& p) { return drawable(chart, p); });
    if (last == points.rend()) continue;
    labels.push_back({x(last->first), y(last->second), y(last->second), i});
  }
  std::sort(labels.begin(), labels.end(), [](const Label& a, const Label& b) { return a.y < b.y; });
  for (std::size_t k = 1; k < labels.size(); ++k) {
    labels[k].y = std::max(labels[k].y, labels[k - 1].y + kLabelHeight);
  }
  double lowest = kBottom;
  for (auto label = labels.rbegin(); label != labels.rend(); ++label) {
    label->y = std::min(label->y, lowest);
    lowest = label->y - kLabelHeight;
  }
  std::string out;
  for (const Label& label : labels) {
    out += line(label.x + 4, label.end, kRight + 8, label.y,
                "stroke=\"#999\" stroke-width=\"0.7\" stroke-dasharray=\"1 3\"");
    out += text(kRight + 11, label.y + 4, "start", chart.series[label.series].name,
                fmt::format(" fill=\"{}\"", colorOf(label.series)));
  }
  return out;
}

}  // namespace

std::string chartSvg(const Chart& chart) {
  Axis x, y;
  fitAxes(chart, x, y);
  std::string out = fmt::format(
      "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{0}\" height=\"{1}\" "
      "viewBox=\"0 0 {0} {1}\" font-family=\"sans-serif\" font-size=\"12\" role=\"img\">\n"
      "<title>{2}</title>\n<rect width=\"{0}\" height=\"{1}\" fill=\"white\"/>\n",
      kWidth, kHeight, escaped(chart.title));
  out += frame(chart, x, y) + legend(chart);
  for (std::size_t i = 0; i < chart.series.size(); ++i) out += curve(chart, i, x, y);
  return out + endLabels(chart, x, y) + "</svg>\n";
}

}  // namespace trex
