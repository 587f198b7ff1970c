// Line charts as SVG.
#pragma once

#include <string>
#include <utility>
#include <vector>

namespace trex {

struct Series {
  std::string name;
  bool dashed = false;
  std::vector<std::pair<double, double>> points;  ///< x and y, x rising
};

struct Chart {
  std::string title, xLabel, yLabel;
  bool logY = false;  ///< the x axis is always logarithmic
  std::vector<Series> series;
};

/// A complete <svg> element, for a file or inside HTML: axes with ticks, a legend, each curve
/// labelled at its end. Points that are not finite, or not positive on a logarithmic axis, are left
/// out. Depends on the chart alone.
std::string chartSvg(const Chart& chart);

}  // namespace trex
