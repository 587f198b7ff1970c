#include "src/session/session.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <chrono>
#include <optional>

#include "src/core/error.h"
#include "src/core/log.h"
#include "src/core/memory.h"
#include "src/frame/denoise.h"
#include "src/session/checkpoint.h"
#include "src/session/light_pass.h"
#include "src/session/voxel_source.h"

namespace trex {
namespace {

constexpr std::uint32_t kTileSize = 64;
constexpr std::uint64_t kPairsThatTell = 2;  // a pixel, from which on there is a variance

double now() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

/// Seconds a pixel that the filter takes here, at most: every neighbour counts on an even picture.
double filterSeconds() {
  constexpr std::uint32_t kSide = 64;
  FeatureImage features(kSide, kSide);
  const std::vector<vec3> even(kSide * kSide, vec3(1.0f));
  double best = kInfinity;
  for (int run = 0; run < 2; ++run) {
    const double mark = now();
    denoiseGuess(features, even, even);
    best = std::min(best, now() - mark);
  }
  return best / (kSide * kSide);
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
  settings_.denoise &= settings_.exact < 1.0;
  if (settings_.denoise || layers_.needsFeatures()) {
    features_ = std::make_unique<FeatureImage>(settings_.width, settings_.height);
  }
  if (layers_.needsSplit()) {
    direct_ = std::make_unique<DirectImage>(settings_.width, settings_.height);
  }
  if (layers_.needsFirstHit()) {
    firstHits_ = std::make_unique<FirstHitImage>(settings_.width, settings_.height);
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
    report_.aimSeconds = report_.renderSeconds = now() - mark;
  }
  if (settings_.denoise && settings_.seconds > 0.0) {
    const double filters = settings_.exact > 0.0 ? 2.0 : 1.0;
    filterEstimate_ = filters * filterSeconds() * settings_.width * settings_.height;
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
                        : makeVulkanTracer(tree, materials, settings_.device,
                                           {.maxBytes = settings_.maxGpuMemory});
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
  // The first pass is finished in any case: a picture has no holes.
  const auto going = [&] {
    const bool late = settings_.seconds > 0.0 && sample > 0 && elapsed() >= timeLimit();
    return keepGoing(progress()) && !late;
  };
  if (voxels_ && tilesDone_ == 0) {
    const std::uint64_t pixels = std::uint64_t{settings_.width} * settings_.height;
    if (!voxels_->light->run(photonTarget(sample, pixels), going)) return false;
  }
  TileWork works[2];
  for (; tilesDone_ < tiles_.size() && going(); ++tilesDone_) {
    trace(tiles_[tilesDone_], sample, works[tilesDone_ % 2]);
    merge(works[(tilesDone_ + 1) % 2]);
  }
  merge(works[(tilesDone_ + 1) % 2]);
  if (tilesDone_ < tiles_.size()) return false;
  tilesDone_ = 0;
  ++report_.samplesDone;
  if (settings_.error > 0.0 && report_.samplesDone >= errorCheck_) {
    error_ = frame_.estimatedError();
    errorCheck_ = report_.samplesDone + std::max(report_.samplesDone / 8u, 1u);
  }
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
        PathSample& path = work.paths[r.pixel];
        const vec3 passed = r.background * answer.transmittance;
        path.guess += r.weight * answer.radiance * scale + passed;
        if (r.direct) path.direct += passed;
      }
    }
  }
  for (std::uint32_t row = 0; row < work.tile.height; ++row) {
    for (std::uint32_t column = 0; column < work.tile.width; ++column) add(work, column, row);
  }
}

/// A finished sample enters the frame and its layers.
void Session::add(const TileWork& work, std::uint32_t column, std::uint32_t row) {
  const std::size_t i = std::size_t{row} * work.tile.width + column;
  const std::uint32_t x = work.tile.x + column, y = work.tile.y + row;
  const PathSample& p = work.paths[i];
  const vec3 exact = p.common + p.exact;
  const bool paired = work.paired[i] != 0;
  const bool finite = frame_.add(x, y, work.sample, p.common + p.guess, paired ? &exact : nullptr);
  if (features_) features_->add(x, y, p.feature);
  if (firstHits_) firstHits_->add(x, y, work.sample, p.first);
  if (direct_ && finite) direct_->add(x, y, p.direct, paired ? &p.directExact : nullptr);
}

bool Session::goalReached() const {
  if (settings_.samples > 0 && report_.samplesDone >= settings_.samples) return true;
  if (settings_.error > 0.0 && error_ <= settings_.error) return true;
  return settings_.seconds > 0.0 && report_.samplesDone > 0 && report_.renderSeconds >= timeLimit();
}

double Session::elapsed() const { return now() - start_; }

/// The filter's share of the time is kept free.
double Session::timeLimit() const {
  return std::max(settings_.seconds - filterEstimate_, 0.1 * settings_.seconds);
}

double Session::progress() const {
  const double part = static_cast<double>(tilesDone_) / static_cast<double>(tiles_.size());
  double done = 0.0;
  if (settings_.samples > 0) done = (report_.samplesDone + part) / settings_.samples;
  if (settings_.seconds > 0.0) done = std::max(done, elapsed() / timeLimit());
  if (settings_.error > 0.0) done = std::max(done, settings_.error / error_);
  return std::min(done, 1.0);
}

/// What the viewer gets to see of the frame: means, filtered if asked for.
std::vector<vec3> Session::shown() {
  const double mark = now();
  const auto gather = [&](const auto& value) {
    std::vector<vec3> out;
    out.reserve(std::size_t{settings_.width} * settings_.height);
    for (std::uint32_t y = 0; y < settings_.height; ++y) {
      for (std::uint32_t x = 0; x < settings_.width; ++x) out.emplace_back(value(x, y));
    }
    return out;
  };
  using Pixel = std::uint32_t;
  if (!settings_.denoise) return gather([&](Pixel x, Pixel y) { return frame_.mean(x, y); });
  std::vector<vec3> out =
      denoiseGuess(*features_, gather([&](Pixel x, Pixel y) { return frame_.guess(x, y).mean(); }),
                   gather([&](Pixel x, Pixel y) { return frame_.guess(x, y).varianceOfMean(); }));
  if (settings_.exact > 0.0 && frame_.fewestPairs() >= kPairsThatTell) {
    // A rare bright path makes both mean and variance of its pixel large; a pixel that has met none
    // knows too little of them. So no variance counts as less than that of all pixels together.
    const dvec3 pooled = frame_.pooledDifferenceVariance();
    const auto correction = denoiseCorrection(
        *features_, gather([&](Pixel x, Pixel y) { return frame_.difference(x, y).mean(); }),
        gather([&](Pixel x, Pixel y) {
          const Moments d = frame_.difference(x, y);
          return glm::max(d.varianceOfMean(), pooled / static_cast<double>(d.count()));
        }));
    for (std::size_t i = 0; i < out.size(); ++i) out[i] += correction[i];
  }
  report_.filterSeconds = now() - mark;
  return out;
}

Picture Session::picture() {
  Picture picture;
  picture.width = settings_.width;
  picture.height = settings_.height;
  picture.channels = {"R", "G", "B"};
  const auto put = [&](const std::string& layer, const char* names) {
    for (const char* n = names; *n; ++n) picture.channels.push_back(layer + '.' + *n);
  };
  if (layers_.direct) put("direct", "RGB");
  if (layers_.indirect) put("indirect", "RGB");
  if (layers_.albedo) put("albedo", "RGB");
  if (layers_.normal) put("normal", "XYZ");
  if (layers_.position) put("position", "XYZ");
  if (layers_.depth) picture.channels.emplace_back("depth");
  if (layers_.objectId) picture.channels.emplace_back("objectId");
  if (layers_.materialId) picture.channels.emplace_back("materialId");
  if (layers_.sampleCount) picture.channels.emplace_back("sampleCount");
  if (layers_.variance) put("variance", "RGB");
  std::vector<float>& values = picture.values;
  values.reserve(picture.channels.size() * settings_.width * settings_.height);
  const std::vector<vec3> colors = shown();
  for (std::uint32_t y = 0; y < settings_.height; ++y) {
    for (std::uint32_t x = 0; x < settings_.width; ++x) {
      const vec3& color = colors[std::size_t{y} * settings_.width + x];
      values.insert(values.end(), {color.x, color.y, color.z});
      addLayers(x, y, values);
    }
  }
  return picture;
}

/// The values of a pixel's layers, in the order of their channels.
void Session::addLayers(std::uint32_t x, std::uint32_t y, std::vector<float>& values) const {
  const auto add = [&](const vec3& v) { values.insert(values.end(), {v.x, v.y, v.z}); };
  if (layers_.needsSplit()) {
    const dvec3 direct = direct_->mean(x, y);
    if (layers_.direct) add(vec3(direct));
    if (layers_.indirect) add(vec3(frame_.mean(x, y) - direct));
  }
  if (layers_.needsFeatures()) {
    const Feature& f = features_->mean(x, y);
    if (layers_.albedo) add(f.albedo);
    if (layers_.normal) add(f.normal);
    if (layers_.position) add(f.position);
  }
  if (layers_.needsFirstHit()) {
    const FirstHit& hit = firstHits_->at(x, y);
    if (layers_.depth) values.push_back(hit.depth);
    if (layers_.objectId) values.push_back(hit.object);
    if (layers_.materialId) values.push_back(hit.material);
  }
  if (layers_.sampleCount) values.push_back(static_cast<float>(frame_.samples(x, y)));
  if (layers_.variance) add(vec3(frame_.varianceOfMean(x, y)));
}

SessionReport Session::report() const {
  SessionReport out = report_;
  out.pages = model_->rays->pageStatistics();
  if (voxels_) {
    out.photons = voxels_->light->emitted();
    out.photonsLanded = voxels_->light->landed();
    out.photonSeconds = voxels_->light->seconds();
    out.lightScale = voxels_->light->scale();
    out.deviceBytes = voxels_->device->statistics().deviceBytes;
  }
  out.estimatedError = report_.samplesDone < 2 ? -1.0 : frame_.estimatedError();
  out.nonFinite = frame_.nonFiniteCount();
  return out;
}

/// All that grows with the samples.
std::vector<std::span<std::byte>> Session::state() {
  std::vector<std::span<std::byte>> parts{frame_.guessBytes(), frame_.differenceBytes()};
  if (features_) parts.push_back(features_->bytes());
  if (direct_) parts.push_back(direct_->bytes());
  if (firstHits_) parts.push_back(firstHits_->bytes());
  return parts;
}

void Session::saveCheckpoint(const std::filesystem::path& path, std::uint64_t key,
                             std::uint32_t frame) {
  CheckpointHeader header;
  header.key = key;
  header.frame = frame;
  header.samplesDone = report_.samplesDone;
  header.tilesDone = static_cast<std::uint32_t>(tilesDone_);
  header.errorCheck = errorCheck_;
  header.renderSeconds = report_.renderSeconds;
  header.error = error_;
  header.rays = report_.rays;
  header.nonFinite = frame_.nonFiniteCount();
  header.nonFiniteSamples = frame_.nonFiniteSamples();
  writeCheckpoint(path, header, state());
}

void Session::restoreCheckpoint(CheckpointReader& reader) {
  reader.read(state());
  const CheckpointHeader& header = reader.header();
  if (header.tilesDone > tiles_.size()) reader.refuse("more tiles than the frame has");
  report_.samplesDone = header.samplesDone;
  report_.renderSeconds = header.renderSeconds;
  report_.rays = header.rays;
  tilesDone_ = header.tilesDone;
  errorCheck_ = header.errorCheck;
  error_ = header.error;
  frame_.restoreNonFinite(header.nonFinite, header.nonFiniteSamples);
  if (!voxels_) return;
  // Photons are traced again in the same rounds: guides learn from one round for the next.
  const std::uint64_t pixels = std::uint64_t{settings_.width} * settings_.height;
  const std::uint32_t passes = header.samplesDone + (tilesDone_ > 0 ? 1 : 0);
  for (std::uint32_t s = 0; s < passes; ++s) {
    voxels_->light->run(photonTarget(s, pixels), [] { return true; });
  }
}

}  // namespace trex
