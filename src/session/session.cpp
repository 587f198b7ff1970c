#include "src/session/session.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <chrono>
#include <optional>

#include "src/core/error.h"
#include "src/core/log.h"
#include "src/core/memory.h"
#include "src/frame/denoise.h"
#include "src/session/light_pass.h"
#include "src/session/voxel_source.h"

namespace trex {
namespace {

constexpr std::uint32_t kTileSize = 64;

double now() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

}  // namespace

/// The approximate side: present only where a guess is asked for.
struct Session::VoxelPart {
  asvo::Tree tree;
  std::unique_ptr<GRayTracer> device;
  std::unique_ptr<LightCache> cache;
  std::unique_ptr<LightPass> light;
};

/// A tile between its two stages.
struct Session::TileWork {
  Tile tile{};
  std::uint32_t sample = 0;
  std::vector<PathSample> paths;  ///< by pixel, row by row
  std::vector<std::uint8_t> paired;
  std::vector<std::vector<ConeRequest>> rows;  ///< cones by row, in the order of pixels
  std::vector<shaderio::GatherQuery> queries;
  std::optional<int> ticket;
  bool full = false;
};

Session::Session(std::shared_ptr<const Model> model, const Camera& camera,
                 const RenderSettings& settings, const PictureLayers& layers)
    : settings_(settings),
      layers_(layers),
      model_(std::move(model)),
      frame_(settings.width, settings.height, settings.exact > 0.0 && settings.exact < 1.0),
      tiles_(makeTiles(settings.width, settings.height, kTileSize)) {
  settings_.denoise &= settings_.exact <= 0.0;
  if (settings_.denoise || layers_.features) {
    features_ = std::make_unique<FeatureImage>(settings_.width, settings_.height);
  }
  const RayScene& rays = *model_->rays;
  lights_ = std::make_unique<LightSet>(model_->scene, rays.renderOrigin(), rays.bounds());
  report_.mesh = rays.statistics();
  report_.meshSeconds = model_->meshSeconds;
  report_.voxelSeconds = model_->voxelSeconds;
  GuessOptions guess;
  if (settings_.exact < 1.0 && model_->voxels && lights_->anyPower()) {
    prepareVoxels();
    guess.cache = voxels_->cache.get();
    guess.cones = settings_.guess == GuessKind::kCone ||
                  (settings_.guess == GuessKind::kAuto && !voxels_->device->sharesHostCores());
    report_.cones = guess.cones;
  }
  camera_ =
      std::make_unique<CameraRays>(camera, rays.renderOrigin(), settings_.width, settings_.height);
  if (voxels_) {
    const double mark = now();
    voxels_->light->aim(*camera_, settings_.width, settings_.height);
    report_.aimSeconds = now() - mark;
  }
  integrator_ =
      std::make_unique<Integrator>(model_->scene, rays, *lights_, *camera_, guess, settings_.seed);
}

Session::~Session() = default;

void Session::prepareVoxels() {
  const double mark = now();
  const Scene& scene = model_->scene;
  const asvo::Tree& tree = *model_->voxels;
  report_.voxels = tree.info.nodeCount;
  report_.leaves = tree.info.leafCount;
  report_.voxelDepth = static_cast<int>(tree.info.depth);
  report_.voxelBytes = tree.nodes.size() * sizeof(asvo::uvec2) +
                       (tree.voxels.size() + tree.leaves.size()) * sizeof(asvo::uvec4);
  voxels_ = std::make_unique<VoxelPart>();
  const auto materials = photonMaterials(scene);
  voxels_->device = settings_.device == RenderSettings::kNoDevice
                        ? makeCpuTracer(tree, materials)
                        : makeVulkanTracer(tree, materials, settings_.device);
  voxels_->cache = std::make_unique<LightCache>(tree);
  voxels_->light = std::make_unique<LightPass>(scene, *model_->rays, *lights_, *voxels_->device,
                                               *voxels_->cache, settings_.seed);
  report_.device = voxels_->device->name();
  report_.deviceSeconds = now() - mark;
}

void Session::run(const KeepGoing& keepGoing) {
  start_ = now() - report_.renderSeconds;
  bool going = true;
  while (going && !goalReached()) {
    going = pass(keepGoing);
    report_.renderSeconds = elapsed();
  }
}

/// What is left of one more sample of every pixel. False if it was cut short.
bool Session::pass(const KeepGoing& keepGoing) {
  const std::uint32_t sample = report_.samplesDone;
  if (voxels_) {
    voxels_->light->run(photonTarget(sample, std::uint64_t{settings_.width} * settings_.height));
  }
  TileWork works[2];
  bool going = true;
  for (; tilesDone_ < tiles_.size(); ++tilesDone_) {
    going = keepGoing(progress()) && !(settings_.seconds > 0.0 && elapsed() >= settings_.seconds);
    if (!going) break;
    trace(tiles_[tilesDone_], sample, works[tilesDone_ % 2]);
    merge(works[(tilesDone_ + 1) % 2]);
  }
  merge(works[(tilesDone_ + 1) % 2]);
  if (!going) return false;
  tilesDone_ = 0;
  ++report_.samplesDone;
  return true;
}

/// First stage: C-rays of a tile on all CPU threads; its cones start on the device.
void Session::trace(const Tile& tile, std::uint32_t sample, TileWork& work) {
  work.tile = tile;
  work.sample = sample;
  work.full = true;
  work.paths.assign(std::size_t{tile.width} * tile.height, PathSample{});
  work.paired.assign(work.paths.size(), 0);
  work.rows.resize(tile.height);
  std::vector<RayCounts> counts(tile.height);
  tbb::parallel_for(0u, tile.height, [&](std::uint32_t row) {
    work.rows[row].clear();
    for (std::uint32_t column = 0; column < tile.width; ++column) {
      const std::uint32_t x = tile.x + column, y = tile.y + row;
      const std::uint32_t i = row * tile.width + column;
      const double offset = toUnitFloat(hashCombine(hashCombine(x, y), settings_.seed));
      const bool exact = voxels_ && takesExact(sample, settings_.exact, offset);
      work.paired[i] = exact;
      work.paths[i] =
          integrator_->sample(x, y, settings_.width, sample, exact, i, work.rows[row], counts[row]);
    }
  });
  for (const RayCounts& c : counts) report_.rays.add(c);
  work.queries.clear();
  for (const auto& row : work.rows) {
    for (const ConeRequest& r : row) {
      work.queries.push_back({r.origin, r.tanHalf, r.direction, r.tmin, r.tmax, r.jitter,
                              r.shadow ? shaderio::kQueryShadow : 0u, 0u});
    }
  }
  work.ticket.reset();
  if (!work.queries.empty()) work.ticket = voxels_->device->submitGather(work.queries);
}

/// Second stage: the device's answers join their pixels, the samples enter the frame.
void Session::merge(TileWork& work) {
  if (!work.full) return;
  work.full = false;
  if (work.ticket) {
    const auto scale = static_cast<float>(voxels_->light->scale());
    const auto results = voxels_->device->finishGather(*work.ticket);
    std::size_t next = 0;
    for (const auto& row : work.rows) {
      for (const ConeRequest& r : row) {
        const shaderio::GatherResult& answer = results[next++];
        work.paths[r.pixel].guess +=
            r.weight * answer.radiance * scale + r.background * answer.transmittance;
      }
    }
  }
  for (std::uint32_t row = 0; row < work.tile.height; ++row) {
    for (std::uint32_t column = 0; column < work.tile.width; ++column) {
      const std::size_t i = std::size_t{row} * work.tile.width + column;
      const PathSample& p = work.paths[i];
      const vec3 exact = p.common + p.exact;
      frame_.add(work.tile.x + column, work.tile.y + row, work.sample, p.common + p.guess,
                 work.paired[i] ? &exact : nullptr);
      if (features_) features_->add(work.tile.x + column, work.tile.y + row, p.feature);
    }
  }
}

bool Session::goalReached() const {
  if (settings_.samples > 0 && report_.samplesDone >= settings_.samples) return true;
  return settings_.seconds > 0.0 && report_.renderSeconds >= settings_.seconds;
}

double Session::elapsed() const { return now() - start_; }

double Session::progress() const {
  const double part = static_cast<double>(tilesDone_) / static_cast<double>(tiles_.size());
  double done = 0.0;
  if (settings_.samples > 0) done = (report_.samplesDone + part) / settings_.samples;
  if (settings_.seconds > 0.0) done = std::max(done, elapsed() / settings_.seconds);
  return std::min(done, 1.0);
}

/// What the viewer gets to see of the frame: means, filtered if asked for.
std::vector<vec3> Session::shown() const {
  std::vector<vec3> mean, variance;
  mean.reserve(std::size_t{settings_.width} * settings_.height);
  for (std::uint32_t y = 0; y < settings_.height; ++y) {
    for (std::uint32_t x = 0; x < settings_.width; ++x) {
      mean.emplace_back(frame_.mean(x, y));
      if (settings_.denoise) variance.emplace_back(frame_.varianceOfMean(x, y));
    }
  }
  return settings_.denoise ? denoiseGuess(*features_, mean, variance) : mean;
}

Picture Session::picture() const {
  Picture picture;
  picture.width = settings_.width;
  picture.height = settings_.height;
  std::vector<std::string>& channels = picture.channels;
  channels = {"R", "G", "B"};
  const auto put = [&](const std::string& layer, const char* names) {
    for (const char* n = names; *n; ++n) channels.push_back(layer + '.' + *n);
  };
  if (layers_.variance) put("variance", "RGB");
  if (layers_.sampleCount) channels.emplace_back("sampleCount");
  if (layers_.features) {
    put("albedo", "RGB");
    put("normal", "XYZ");
    put("position", "XYZ");
  }
  std::vector<float>& values = picture.values;
  values.reserve(channels.size() * settings_.width * settings_.height);
  const auto add = [&](const vec3& v) { values.insert(values.end(), {v.x, v.y, v.z}); };
  const std::vector<vec3> colors = shown();
  for (std::uint32_t y = 0; y < settings_.height; ++y) {
    for (std::uint32_t x = 0; x < settings_.width; ++x) {
      add(colors[std::size_t{y} * settings_.width + x]);
      if (layers_.variance) add(vec3(frame_.varianceOfMean(x, y)));
      if (layers_.sampleCount) values.push_back(static_cast<float>(frame_.samples(x, y)));
      if (layers_.features) {
        const Feature f = features_->mean(x, y);
        for (const vec3& v : {f.albedo, f.normal, f.position}) add(v);
      }
    }
  }
  return picture;
}

SessionReport Session::report() const {
  SessionReport out = report_;
  if (voxels_) {
    out.photons = voxels_->light->emitted();
    out.photonsLanded = voxels_->light->landed();
    out.photonSeconds = voxels_->light->seconds();
    out.lightScale = voxels_->light->scale();
  }
  out.nonFinite = frame_.nonFiniteCount();
  return out;
}

}  // namespace trex
