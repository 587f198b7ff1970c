#include "tests/image/reference.h"

#include <filesystem>

#include "src/core/error.h"
#include "src/frame/picture_reader.h"
#include "src/scene/import.h"

namespace trex::test {
namespace fs = std::filesystem;

Scene importTestScene(const std::string& name) {
  if (name == "cornell") return importScene(fs::path(TREX_SOURCE_DIR) / "assets/cornell.glb");
  ImportOptions options;
  options.environmentGiven = true;
  Scene scene = importScene(fs::path(TREX_SCENE_DIR) / (name + ".glb"), options);
  if (name == "sun") scene.environment.color = vec3(1.0f, 1.5f, 2.0f);
  return scene;
}

Rendered readReference(const std::string& name) {
  const fs::path path = fs::path(TREX_SOURCE_DIR) / "tests/image/refs" / (name + ".exr");
  const Picture picture = readPicture(path);
  const auto channel = [&](const std::string& wanted) {
    const int index = channelIndex(picture, wanted);
    if (index < 0) fail(ExitCode::kInput, "{}: no channel {}", path.string(), wanted);
    return static_cast<std::size_t>(index);
  };
  const std::size_t mean[3] = {channel("R"), channel("G"), channel("B")};
  const std::size_t variance[3] = {channel("variance.R"), channel("variance.G"),
                                   channel("variance.B")};
  Rendered out;
  out.width = picture.width;
  out.height = picture.height;
  const double pixels = double(out.width) * out.height;
  for (std::size_t i = 0; i < picture.values.size(); i += picture.channels.size()) {
    dvec3 m, v;
    for (int c = 0; c < 3; ++c) {
      m[c] = static_cast<double>(picture.values[i + mean[c]]);
      v[c] = static_cast<double>(picture.values[i + variance[c]]);
    }
    out.mean.push_back(m);
    out.variance.push_back(v);
    out.total += m / pixels;
    out.totalVariance += v / (pixels * pixels);
  }
  return out;
}

}  // namespace trex::test
