// trex diff A B: how far picture A is from reference B.
#include <fmt/format.h>

#include <cmath>
#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>

#include "src/app/app.h"
#include "src/core/error.h"
#include "src/core/file.h"
#include "src/core/log.h"
#include "src/frame/image_diff.h"
#include "src/frame/picture_reader.h"

namespace trex {
namespace {

using nlohmann::json;

struct DiffArguments {
  std::string a, b, output, metric = "flip", exposure = "auto";
  std::optional<double> limit;
  DiffOptions options;
  bool json = false;
};

/// A picture for the eye, not of radiance.
bool isDisplayed(const std::filesystem::path& path) {
  return knownPictureExtension(path) && !isExr(path);
}

void readOptions(DiffArguments& a) {
  if (a.limit && std::isnan(*a.limit)) fail(ExitCode::kUsage, "--max nan: want a number");
  if (std::isnan(a.options.pixelsPerDegree)) fail(ExitCode::kUsage, "--ppd nan: want a number");
  if (!a.output.empty() && !knownPictureExtension(a.output)) {
    fail(ExitCode::kUsage, "-o {}: unknown picture format; use .exr, .png or .jpg", a.output);
  }
  if (a.exposure != "auto") {
    char* end = nullptr;
    const double stops = std::strtod(a.exposure.c_str(), &end);
    if (end == a.exposure.c_str() || *end != '\0' || !(std::abs(stops) < 100.0)) {
      fail(ExitCode::kUsage, "--exposure {}: want stops or auto", a.exposure);
    }
    a.options.exposure = stops;
  } else if (isDisplayed(a.b)) {
    a.options.exposure = 0.0;  // such a picture is as it is to be seen
  }
  if (a.output.empty()) return;
  checkWritable(a.output);
  checkIsNotInput(a.output, a.a);
  checkIsNotInput(a.output, a.b);
}

double metricOf(const std::string& name, const DiffFigures& f) {
  if (name == "flip") return f.flip;
  if (name == "hdrflip") return f.hdrFlip;
  if (name == "relmse") return f.relative.trimmed;
  if (name == "rmse") return f.rmse;
  if (name == "psnr") return f.psnrDb.value_or(HUGE_VAL);
  return f.zTest->leastMeanP;
}

/// Adds a reason if the figure is on the wrong side of the limit; without one, if any value
/// differs.
void judge(const DiffArguments& a, ImageDiff& diff) {
  if (!a.limit && !diff.equalBits && diff.reasons.empty()) {
    diff.reasons.emplace_back("values differ; --max says how much of --metric may");
  }
  if (!a.limit || !diff.figures) return;
  if (a.metric == "z" && !diff.figures->zTest) {
    if (!diff.reasons.empty()) return;
    fail(ExitCode::kInput, "{}: no variance layers for --metric z; render with --aov variance",
         hasVariance(readPicture(a.a)) ? a.b : a.a);
  }
  const double value = metricOf(a.metric, *diff.figures);
  const bool atLeast = a.metric == "psnr" || a.metric == "z";
  if (atLeast ? value >= *a.limit : value <= *a.limit) return;
  diff.reasons.push_back(fmt::format("{} is {:.6g}, {} {:g}", a.metric, value,
                                     atLeast ? "less than" : "more than", *a.limit));
}

json number(double value) { return std::isfinite(value) ? json(value) : json(nullptr); }

json describe(const NonFinite& n) {
  if (n.count == 0) return {{"values", 0}};
  return {{"values", n.count}, {"first_pixel", {n.x, n.y}}, {"first_channel", n.channel}};
}

json describe(const ZTest& z) {
  return {{"share_within_2", z.within2},
          {"share_within_3", z.within3},
          {"share_within_4", z.within4},
          {"largest", number(z.largest)},
          {"largest_pixel", {z.largestX, z.largestY}},
          {"largest_p", z.largestP},
          {"mean_z", {number(z.meanZ[0]), number(z.meanZ[1]), number(z.meanZ[2])}},
          {"mean_p", z.meanP},
          {"mean_least_p", z.leastMeanP}};
}

json describe(const ImageDiff& d) {
  json out = {{"size", {d.widthA, d.heightA}},
              {"size_b", {d.widthB, d.heightB}},
              {"channels_only_in_a", d.onlyInA},
              {"channels_only_in_b", d.onlyInB},
              {"nonfinite_a", describe(d.nonFiniteA)},
              {"nonfinite_b", describe(d.nonFiniteB)},
              {"equal_bits", d.equalBits},
              {"differ", !d.reasons.empty()},
              {"reasons", d.reasons}};
  for (const char* key :
       {"rmse", "relmse", "relmse_trimmed", "psnr_db", "max_error", "max_error_pixel",
        "max_error_channel", "mean_ratio", "flip", "hdr_flip", "exposure_stops", "z"}) {
    out[key] = nullptr;
  }
  if (!d.figures) return out;
  const DiffFigures& f = *d.figures;
  out["rmse"] = number(f.rmse);
  out["relmse"] = number(f.relative.all);
  out["relmse_trimmed"] = number(f.relative.trimmed);
  if (f.psnrDb) out["psnr_db"] = *f.psnrDb;
  out["max_error"] = number(f.maxError);
  out["max_error_pixel"] = {f.maxX, f.maxY};
  out["max_error_channel"] = std::string(1, f.maxChannel);
  out["mean_ratio"] = number(f.meanRatio);
  out["flip"] = f.flip;
  out["hdr_flip"] = f.hdrFlip;
  out["exposure_stops"] = f.exposure;
  if (f.zTest) out["z"] = describe(*f.zTest);
  return out;
}

void printTable(const ImageDiff& d) {
  fmt::print("size            {}x{}\n", d.widthA, d.heightA);
  if (d.figures) {
    const DiffFigures& f = *d.figures;
    fmt::print("FLIP            {:.5f} at {:+.2f} stops\n", f.flip, f.exposure);
    fmt::print("HDR-FLIP        {:.5f}\n", f.hdrFlip);
    fmt::print("RMSE            {:.6g}\n", f.rmse);
    fmt::print("relMSE          {:.6g}, {:.6g} without the largest 0.1 %\n", f.relative.all,
               f.relative.trimmed);
    fmt::print("PSNR            {}\n",
               f.psnrDb ? fmt::format("{:.2f} dB", *f.psnrDb) : "displayed pictures are equal");
    fmt::print("largest error   {:.6g} in {} of pixel {},{}\n", f.maxError, f.maxChannel, f.maxX,
               f.maxY);
    fmt::print("mean ratio      {:.5f}\n", f.meanRatio);
    if (f.zTest) {
      const ZTest& z = *f.zTest;
      fmt::print("|z| < 2, 3, 4   {:.4f} {:.4f} {:.5f} (0.9545 0.9973 0.99994 expected)\n",
                 z.within2, z.within3, z.within4);
      fmt::print("largest |z|     {:.3g} at pixel {},{}, p {:.3g}\n", z.largest, z.largestX,
                 z.largestY, z.largestP);
      fmt::print("z of the means  {:+.2f} {:+.2f} {:+.2f}, p {:.3g}\n", z.meanZ[0], z.meanZ[1],
                 z.meanZ[2], z.leastMeanP);
    }
  }
  fmt::print("equal bits      {}\n", d.equalBits ? "yes" : "no");
  for (const std::string& reason : d.reasons) fmt::print("differ: {}\n", reason);
}

/// A .png or .jpg shows the error in the magma colours, an .exr holds it in the channel "flip".
void writeHeatMap(const DiffArguments& a, const ImageDiff& diff) {
  if (!diff.figures) {
    logWarning("{}: not written, the pictures can't be compared pixel by pixel", a.output);
    return;
  }
  const auto& map = a.metric == "hdrflip" ? diff.figures->hdrFlipMap : diff.figures->flipMap;
  Picture heat{diff.widthA, diff.heightA, {"flip"}, map, {}};
  if (isDisplayed(a.output)) {
    heat.channels = {"R", "G", "B"};
    heat.values.clear();
    for (float error : map) {
      const vec3 c = magma(error);
      heat.values.insert(heat.values.end(), {decodeSrgb(c.x), decodeSrgb(c.y), decodeSrgb(c.z)});
    }
  }
  writePicture(a.output, heat, ToneMap{});
}

ExitCode diff(DiffArguments& a) {
  readOptions(a);
  const Picture first = readPicture(a.a), second = readPicture(a.b);
  ImageDiff result = compareImages(first, second, a.options);
  judge(a, result);
  if (!a.output.empty()) writeHeatMap(a, result);
  if (a.json) {
    fmt::print("{}\n", describe(result).dump(2));
  } else {
    printTable(result);
  }
  std::fflush(stdout);
  return result.reasons.empty() ? ExitCode::kDone : ExitCode::kDiffer;
}

}  // namespace

void addDiffCommand(CLI::App& app, int& exitCode) {
  auto a = std::make_shared<DiffArguments>();
  CLI::App* c = app.add_subcommand("diff", "Compare a picture with a reference");
  c->add_option("A", a->a, "Picture: .exr .png .jpg .hdr")->required();
  c->add_option("B", a->b, "Reference: .exr .png .jpg .hdr")->required();
  c->add_option("--max", a->limit,
                "Largest value of --metric that is no difference, the least one of psnr and z; "
                "without it any difference ends in exit code 6");
  c->add_option("--metric", a->metric,
                "flip, hdrflip, relmse (without the largest 0.1 %), rmse, psnr (dB), or z: the "
                "p-value of the means' z-test")
      ->check(CLI::IsMember({"flip", "hdrflip", "relmse", "rmse", "psnr", "z"}))
      ->capture_default_str();
  c->add_option("-o,--output", a->output,
                "The FLIP error of each pixel: .png or .jpg in colours, .exr as numbers");
  c->add_option("--exposure", a->exposure,
                "Stops for FLIP and PSNR; auto: from the reference, 0 where it is a .png or .jpg")
      ->capture_default_str();
  c->add_option("--ppd", a->options.pixelsPerDegree, "Pixels in a degree of the viewer's sight")
      ->check(CLI::Range(kLeastPixelsPerDegree, kMostPixelsPerDegree))
      ->capture_default_str();
  c->add_flag("--json", a->json, "Print JSON on stdout");
  c->callback([a, &exitCode] { exitCode = static_cast<int>(diff(*a)); });
}

}  // namespace trex
