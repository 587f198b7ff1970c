#include "tests/image/rendered.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fstream>

#include "src/frame/flip.h"
#include "src/frame/image_diff.h"
#include "src/frame/image_file.h"

namespace trex::test {
namespace fs = std::filesystem;
namespace {

constexpr std::uint32_t kBlock = 8;  // pixels
/// Adds to variances so that two black pixels compare as equal.
constexpr double kNoVariance = 1e-20;

double deviate(double a, double b, double variance) {
  return (a - b) / std::sqrt(variance + kNoVariance);
}

/// Sum of the channels.
double sumOf(const dvec3& v) { return v.x + v.y + v.z; }

/// The variance of a pixel's channel, or the mean of it and its neighbours if that is larger: few
/// samples often miss the rare paths that make most of the variance.
double pooledVariance(const Rendered& image, std::size_t pixel, int channel) {
  const auto width = static_cast<std::int64_t>(image.width);
  const auto height = static_cast<std::int64_t>(image.height);
  const auto at = static_cast<std::int64_t>(pixel);
  double sum = 0.0, count = 0.0;
  for (std::int64_t y = at / width - 1; y <= at / width + 1; ++y) {
    for (std::int64_t x = at % width - 1; x <= at % width + 1; ++x) {
      if (x < 0 || y < 0 || x >= width || y >= height) continue;
      sum += image.variance[y * width + x][channel];
      ++count;
    }
  }
  return std::max(sum / count, image.variance[pixel][channel]);
}

void compareBlock(const Rendered& a, const Rendered& b, std::uint32_t left, std::uint32_t top,
                  Comparison& out) {
  dvec3 ours(0.0), theirs(0.0), variance(0.0);
  for (std::uint32_t y = top; y < top + kBlock; ++y) {
    for (std::uint32_t x = left; x < left + kBlock; ++x) {
      const std::size_t i = std::size_t{y} * a.width + x;
      ours += a.mean[i];
      theirs += b.mean[i];
      variance += a.variance[i] + b.variance[i];
    }
  }
  for (int c = 0; c < 3; ++c) {
    const double p = pValue(deviate(ours[c], theirs[c], variance[c]));
    out.smallestBlockP = std::min(out.smallestBlockP, p);
  }
  if (sumOf(theirs) > 0.0)
    out.worstBlock = std::max(out.worstBlock, std::abs(sumOf(ours) / sumOf(theirs) - 1.0));
}

Picture pictureOf(const Rendered& image, const std::vector<vec3>& colors) {
  Picture picture;
  picture.width = image.width;
  picture.height = image.height;
  picture.channels = {"R", "G", "B"};
  for (const vec3& c : colors) picture.values.insert(picture.values.end(), {c.x, c.y, c.z});
  return picture;
}

Picture pictureOf(const Rendered& image) {
  return pictureOf(image, std::vector<vec3>(image.mean.begin(), image.mean.end()));
}

void writeBoth(const fs::path& folder, const std::string& name, const Picture& picture,
               float exposure) {
  writePicture(folder / (name + ".exr"), picture, ToneMap{});
  writePicture(folder / (name + ".png"), picture, ToneMap{exposure});
}

/// Red where the image is too bright, blue where it is too dark; full at five deviations.
Picture heatMap(const Rendered& image, const Comparison& comparison) {
  std::vector<vec3> heat;
  for (double z : comparison.z) {
    const auto strength = static_cast<float>(std::min(std::abs(z) / 5.0, 1.0));
    heat.push_back(z > 0.0 ? vec3(strength, 0.0f, 0.0f) : vec3(0.0f, 0.0f, strength));
  }
  return pictureOf(image, heat);
}

fs::path artefactFolder(const std::string& name) {
  const fs::path folder = fs::path(TREX_ARTEFACT_DIR) / name;
  fs::create_directories(folder);
  return folder;
}

}  // namespace

RenderSettings settingsFor(std::uint32_t side, double exact, std::uint32_t samples,
                           std::uint32_t seed, int device) {
  RenderSettings s;
  s.width = s.height = side;
  s.exact = exact;
  s.samples = samples;
  s.seed = seed;
  s.device = device;
  return s;
}

Rendered render(std::shared_ptr<const Model> model, const RenderSettings& settings) {
  const Camera camera = model->scene.cameras.front();
  Session session(std::move(model), camera, settings);
  session.run();
  Rendered out;
  out.width = settings.width;
  out.height = settings.height;
  out.report = session.report();
  EXPECT_EQ(out.report.nonFinite, 0u);
  const double pixels = double(out.width) * out.height;
  for (std::uint32_t y = 0; y < out.height; ++y) {
    for (std::uint32_t x = 0; x < out.width; ++x) {
      out.mean.push_back(session.frame().mean(x, y));
      out.variance.push_back(session.frame().varianceOfMean(x, y));
      out.total += out.mean.back() / pixels;
      out.totalVariance += out.variance.back() / (pixels * pixels);
    }
  }
  return out;
}

Rendered render(Scene scene, const RenderSettings& settings, int voxelDepth) {
  ModelOptions options;
  options.voxels = settings.exact < 1.0;
  options.voxelDepth =
      voxelDepth > 0 ? voxelDepth : voxelDepthFor(std::uint64_t{settings.width} * settings.height);
  return render(std::make_shared<const Model>(makeModel(std::move(scene), options)), settings);
}

double pValue(double z) { return std::erfc(std::abs(z) * std::numbers::sqrt2 / 2.0); }

double sidak(double level, double tests) { return -std::expm1(std::log1p(-level) / tests); }

Comparison compare(const Rendered& image, const Rendered& reference, double level) {
  Comparison out;
  const double channels = 3.0 * static_cast<double>(image.mean.size());
  const double pixelLevel = sidak(level, channels);
  double passed = 0.0, square = 0.0;
  for (std::size_t i = 0; i < image.mean.size(); ++i) {
    double worst = 0.0;
    for (int c = 0; c < 3; ++c) {
      const double difference = image.mean[i][c] - reference.mean[i][c];
      const double z = deviate(image.mean[i][c], reference.mean[i][c],
                               pooledVariance(image, i, c) + reference.variance[i][c]);
      passed += pValue(z) > pixelLevel ? 1.0 : 0.0;
      out.smallestPixelP = std::min(out.smallestPixelP, pValue(z));
      if (std::abs(z) > std::abs(worst)) worst = z;
      square += difference * difference;
    }
    out.z.push_back(worst);
  }
  for (std::uint32_t y = 0; y < image.height; y += kBlock) {
    for (std::uint32_t x = 0; x < image.width; x += kBlock) {
      compareBlock(image, reference, x, y, out);
    }
  }
  const double blocks = channels / (kBlock * kBlock);
  out.pixelsPassed = passed / channels;
  out.blockP = -std::expm1(blocks * std::log1p(-out.smallestBlockP));
  out.meanRatio = ratio(image, reference);
  out.relativeRmse = std::sqrt(square / channels) / (sumOf(reference.total) / 3.0);
  return out;
}

double ratio(const Rendered& image, const Rendered& reference) {
  return sumOf(image.total) / sumOf(reference.total);
}

double flip(const Rendered& image, const Rendered& reference) {
  const auto colors = [](const Rendered& r) {
    return ColorImage{r.width, r.height, std::vector<vec3>(r.mean.begin(), r.mean.end())};
  };
  const ColorImage theirs = colors(reference);
  const double scale = displayScale(theirs);
  return meanError(
      flipMap(displayed(theirs, scale), displayed(colors(image), scale), kFlipPixelsPerDegree));
}

void report(const std::string& name, double value, double limit) {
  std::printf("measured %s: %.4g (limit %.4g)\n", name.c_str(), value, limit);
  std::fflush(stdout);
}

void keepArtefacts(const std::string& name, const Rendered& image, const Rendered& reference) {
  const fs::path folder = artefactFolder(name);
  const Comparison comparison = compare(image, reference);
  const float exposure = autoExposure(pictureOf(reference));
  writeBoth(folder, "image", pictureOf(image), exposure);
  writeBoth(folder, "reference", pictureOf(reference), exposure);
  writeBoth(folder, "difference", heatMap(image, comparison), 0.0f);
  std::ofstream(folder / "numbers.txt")
      << "smallest p of a pixel's channel " << comparison.smallestPixelP << "\n"
      << "share of channels passed " << comparison.pixelsPassed << "\n"
      << "p of the worst block, corrected " << comparison.blockP << "\n"
      << "mean ratio " << comparison.meanRatio << "\n"
      << "relative RMSE " << comparison.relativeRmse << "\n";
  std::printf("artefacts: %s\n", folder.c_str());
}

void keepArtefact(const std::string& name, const Rendered& image) {
  const fs::path folder = artefactFolder(name);
  writeBoth(folder, "image", pictureOf(image), autoExposure(pictureOf(image)));
  std::printf("artefacts: %s\n", folder.c_str());
}

}  // namespace trex::test
