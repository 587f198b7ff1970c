// trex denoise IN.exr -o OUT.exr: takes the noise of a picture that was made before.
#include <fmt/format.h>
#include <tbb/global_control.h>

#include <cmath>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>

#include "src/app/app.h"
#include "src/core/clock.h"
#include "src/core/error.h"
#include "src/core/file.h"
#include "src/core/log.h"
#include "src/frame/picture_denoise.h"
#include "src/frame/picture_reader.h"
#include "src/session/denoiser.h"

namespace trex {
namespace {

struct DenoiseArguments {
  std::string input, output;
  int threads = 0;
  bool json = false;
};

/// Sum of the colours that the picture shows.
double sumOf(const Picture& picture, const PictureLayersFound& layers) {
  double sum = 0.0;
  for (const vec3& v : layers.colors(picture)) {
    for (int c = 0; c < 3; ++c) sum += std::isfinite(v[c]) ? static_cast<double>(v[c]) : 0.0;
  }
  return sum;
}

void warnOfMissing(const DenoiseArguments& a, const PictureLayersFound& layers) {
  if (layers.albedo().empty()) {
    logWarning("{}: has no albedo layer: textures may get soft{}", a.input,
               layers.normal().empty() ? ", and without a normal layer edges too"
                                       : "; its normals are not used without one");
  } else if (layers.normal().empty()) {
    logWarning("{}: has no normal layer: edges of one colour may get soft", a.input);
  }
}

void setMetadata(Picture& picture, const std::string& key, const std::string& value) {
  std::erase_if(picture.metadata, [&](const auto& entry) { return entry.first == key; });
  picture.metadata.emplace_back(key, value);
}

void denoise(const DenoiseArguments& a) {
  if (!isExr(a.output)) {
    fail(ExitCode::kUsage, "-o {}: a denoised picture keeps its layers; use .exr", a.output);
  }
  checkWritable(a.output);
  std::optional<tbb::global_control> limit;
  if (a.threads > 0) {
    limit.emplace(tbb::global_control::max_allowed_parallelism,
                  static_cast<std::size_t>(a.threads));
  }
  Picture picture = readPicture(a.input);
  const PictureLayersFound layers(picture, a.input);
  const OidnSearch& search = findOidn();
  if (!search.library) fail(ExitCode::kMemoryOrDevice, "{}", search.problem);
  warnOfMissing(a, layers);
  const double before = sumOf(picture, layers), mark = secondsNow();
  layers.denoise(picture, *search.library);
  const double seconds = secondsNow() - mark;
  const std::string by = denoiserName(DenoiseMethod::kOidnThorough);
  setMetadata(picture, "trex:denoised", by);
  writePicture(a.output, picture, ToneMap{});
  if (!a.json) {
    fmt::print("{}\n", a.output);
    return;
  }
  const auto named = [](const std::string& layer) {
    return layer.empty() ? nlohmann::json() : nlohmann::json(layer);
  };
  const nlohmann::json out = {{"input", a.input},
                              {"output", a.output},
                              {"width", picture.width},
                              {"height", picture.height},
                              {"denoiser", by},
                              {"albedo_layer", named(layers.albedo())},
                              {"normal_layer", named(layers.normal())},
                              {"mean_ratio", before > 0.0 ? sumOf(picture, layers) / before : 1.0},
                              {"filter_seconds", seconds}};
  fmt::print("{}\n", out.dump(2));
}

}  // namespace

void addDenoiseCommand(CLI::App& app) {
  auto a = std::make_shared<DenoiseArguments>();
  CLI::App* c = app.add_subcommand("denoise", "Take the noise of a picture that was made before");
  c->add_option("PICTURE", a->input,
                "Picture (.exr) with layers albedo and normal, of this program or another")
      ->required();
  c->add_option("-o,--output", a->output, "The denoised picture (.exr)")->required();
  c->add_option("--threads", a->threads, "CPU threads [all]")->check(CLI::Range(1, 4096));
  c->add_flag("--json", a->json, "Print a JSON summary on stdout");
  c->callback([a] { denoise(*a); });
}

}  // namespace trex
