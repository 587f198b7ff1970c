#include "src/frame/layers.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "src/core/error.h"

namespace trex {
namespace {

struct Row {
  const char* name;
  bool PictureLayers::*wanted;
  std::size_t channels;
};

constexpr Row kRows[] = {
    {"A", &PictureLayers::alpha, 1},
    {"direct", &PictureLayers::direct, 3},
    {"indirect", &PictureLayers::indirect, 3},
    {"albedo", &PictureLayers::albedo, 3},
    {"normal", &PictureLayers::normal, 3},
    {"position", &PictureLayers::position, 3},
    {"depth", &PictureLayers::depth, 1},
    {"objectId", &PictureLayers::objectId, 1},
    {"materialId", &PictureLayers::materialId, 1},
    {"sampleCount", &PictureLayers::sampleCount, 1},
    {"variance", &PictureLayers::variance, 3},
    {"exactShare", &PictureLayers::exactShare, 1},
};

}  // namespace

std::size_t PictureLayers::channels() const {
  std::size_t sum = 0;
  for (const Row& row : kRows) sum += this->*row.wanted ? row.channels : 0;
  return sum;
}

const std::vector<std::string>& layerNames() {
  static const std::vector<std::string> names = [] {
    std::vector<std::string> out;
    for (const Row& row : kRows) out.emplace_back(row.name);
    return out;
  }();
  return names;
}

PictureLayers layersFromNames(const std::vector<std::string>& names) {
  PictureLayers layers;
  for (const std::string& name : names) {
    bool known = name == "all";
    for (const Row& row : kRows) {
      if (name != "all" && name != row.name) continue;
      layers.*row.wanted = true;
      known = true;
    }
    if (!known) {
      fail(ExitCode::kUsage, "--aov {}: unknown layer; there are {}, and all", name,
           fmt::join(layerNames(), ", "));
    }
  }
  return layers;
}

}  // namespace trex
