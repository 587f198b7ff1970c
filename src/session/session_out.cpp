// What comes out of a session: pictures, reports, checkpoints.
#include <algorithm>

#include "src/core/clock.h"
#include "src/core/error.h"
#include "src/paths/walk_tracer.h"
#include "src/session/checkpoint.h"
#include "src/session/session.h"
#include "src/session/unfiltered_pixels.h"

namespace trex {

/// The frame as a screen or a file shows it.
std::vector<vec3> Session::shown() {
  const double mark = secondsNow();
  DenoiseMethod method = method_;
  report_.denoiseProblem.clear();
  std::vector<vec3> picture;
  try {
    picture = shownBy(method);
  } catch (const Error& e) {
    if (!isOidn(method)) throw;
    report_.denoiseProblem = e.what();
    method = DenoiseMethod::kFilter;
    picture = shownBy(method);
  }
  report_.filterSeconds = method_ == DenoiseMethod::kOff ? 0.0 : secondsNow() - mark;
  report_.denoiser = denoiserName(method);
  return picture;
}

double Session::denoiseWithin(double seconds) {
  RenderSettings limited = settings_;
  limited.seconds = seconds;
  method_ = denoiseMethod(limited);
  return denoiseSeconds(method_, limited, corrected());
}

std::vector<vec3> Session::shownBy(DenoiseMethod method) const {
  ShownOptions options = shownOptions();
  options.method = method;
  ShownPicture picture(*frame_, settings_.width, settings_.height, options);
  picture.advance([] { return true; });
  return picture.take();
}

ShownOptions Session::shownOptions() const {
  return {method_, settings_.exact > 0.0 && settings_.exact < 1.0, 1};
}

Picture Session::picture() {
  Picture picture;
  picture.width = settings_.width;
  picture.height = settings_.height;
  picture.channels = {"R", "G", "B"};
  picture.premultiplied = settings_.transparent;
  const auto put = [&](const std::string& layer, const char* names) {
    for (const char* n = names; *n; ++n) picture.channels.push_back(layer + '.' + *n);
  };
  if (layers_.alpha) picture.channels.emplace_back("A");
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
  if (layers_.exactShare) picture.channels.emplace_back("exactShare");
  std::vector<float>& values = picture.values;
  values.reserve(picture.channels.size() * settings_.width * settings_.height);
  const std::vector<vec3> colors = shown();
  const UnfilteredPixels pixels(*frame_);
  for (std::uint32_t y = 0; y < settings_.height; ++y) {
    for (std::uint32_t x = 0; x < settings_.width; ++x) {
      const vec3& color = colors[std::size_t{y} * settings_.width + x];
      values.insert(values.end(), {color.x, color.y, color.z});
      addLayers(pixels, x, y, values);
    }
  }
  return picture;
}

/// The values of a pixel's layers, in the order of their channels.
void Session::addLayers(const UnfilteredPixels& pixels, std::uint32_t x, std::uint32_t y,
                        std::vector<float>& values) const {
  const auto add = [&](const vec3& v) { values.insert(values.end(), {v.x, v.y, v.z}); };
  if (layers_.alpha) values.push_back(frame_->coverage->mean(x, y));
  if (layers_.needsSplit()) {
    const dvec3 direct = pixels.direct(x, y);
    if (layers_.direct) add(vec3(direct));
    if (layers_.indirect) add(vec3(pixels.mean(x, y) - direct));
  }
  if (layers_.needsFeatures()) {
    const Feature f = frame_->features->mean(x, y);
    if (layers_.albedo) add(f.albedo);
    if (layers_.normal) add(f.normal);
    if (layers_.position) add(f.position);
  }
  if (layers_.needsFirstHit()) {
    const FirstHit& hit = frame_->firstHits->at(x, y);
    if (layers_.depth) values.push_back(hit.depth);
    if (layers_.objectId) values.push_back(hit.object);
    if (layers_.materialId) values.push_back(hit.material);
  }
  if (layers_.sampleCount) values.push_back(static_cast<float>(frame_->sums.samples(x, y)));
  if (layers_.variance) add(vec3(pixels.variance(x, y)));
  if (layers_.exactShare) {
    const double pairs = static_cast<double>(frame_->sums.pairs(x, y));
    const double samples = static_cast<double>(frame_->sums.samples(x, y));
    values.push_back(source_.pairs ? static_cast<float>(pairs / std::max(samples, 1.0)) : 1.0f);
  }
}

SessionReport Session::report() const {
  SessionReport out = report_;
  out.pages = model_->rays->pageStatistics();
  out.textures = textureStatistics(model_->scene);
  out.traffic = walks_->report();
  if (source_.batched) out.traffic.add(source_.batched->report());
  out.samplesDone = samplesDone();
  out.rays = samples_.rays();
  out.nonFinite = frame_->sums.nonFiniteCount();
  out.exactShare = !source_.pairs ? 1.0 : frame_->dial ? frame_->dial->share() : settings_.exact;
  if (const asvo::Tree* tree = light_.presentVoxels()) {
    out.device = light_.presentDevice()->name();  // it may have failed, and another gone on
    out.voxels = tree->info.nodeCount;
    out.leaves = tree->info.leafCount;
    out.voxelDepth = static_cast<int>(tree->info.depth);
    out.voxelBytes = bytesOf(*tree);
  }
  if (const LightPass* pass = light_.pass()) {
    out.photons = pass->emitted();
    out.photonsLanded = pass->landed();
    out.photonSeconds = pass->seconds();
    out.photonRays = pass->rayBounces();
    out.deviceSharesCores = light_.presentDevice()->sharesHostCores();
    out.lightScale = pass->scale();
    out.gRays = light_.presentDevice()->statistics();
  }
  if (caustics_) {
    out.causticPhotons = caustics_->photons();
    out.causticSeconds = caustics_->seconds();
  }
  return out;
}

/// All that grows with the samples.
std::vector<std::span<std::byte>> Session::sums() {
  std::vector<std::span<std::byte>> parts{frame_->sums.guessBytes(),
                                          frame_->sums.differenceBytes()};
  if (frame_->dial) parts.push_back(frame_->dial->bytes());
  if (frame_->lightNoise) parts.push_back(frame_->lightNoise->bytes());
  if (frame_->photonNoise) parts.push_back(frame_->photonNoise->bytes());
  if (frame_->features) parts.push_back(frame_->features->bytes());
  if (frame_->direct) parts.push_back(frame_->direct->bytes());
  if (frame_->coverage) parts.push_back(frame_->coverage->bytes());
  if (frame_->firstHits) parts.push_back(frame_->firstHits->bytes());
  return parts;
}

void Session::saveCheckpoint(const std::filesystem::path& path, std::uint64_t key,
                             std::uint32_t frame) {
  CheckpointHeader header;
  header.key = key;
  header.frame = frame;
  header.samplesDone = samplesDone();
  header.tilesDone = frame_->tiles.tilesDone();
  header.errorCheck = goal_.nextLook();
  header.renderSeconds = report_.renderSeconds;
  header.error = goal_.estimate();
  header.coneShare = coneShare();
  header.rays = samples_.rays();
  header.nonFinite = frame_->sums.nonFiniteCount();
  header.nonFiniteSamples = frame_->sums.nonFiniteSamples();
  writeCheckpoint(path, header, sums());
}

void Session::restoreCheckpoint(CheckpointReader& reader) {
  reader.read(sums());
  const CheckpointHeader& header = reader.header();
  if (header.tilesDone > frame_->tiles.tiles().size())
    reader.refuse("more tiles than the frame has");
  report_.renderSeconds = header.renderSeconds;
  setConeShare(header.coneShare);
  samples_.restoreRays(header.rays);
  frame_->tiles.restore(header.samplesDone, header.tilesDone);
  if (frame_->dial) frame_->dial->restore(header.samplesDone);
  goal_.restore(header.errorCheck, header.error);
  frame_->sums.restoreNonFinite(header.nonFinite, header.nonFiniteSamples);
  // Photons are traced again; their light depends on their number alone.
  const std::uint32_t passes = header.samplesDone + (header.tilesDone > 0 ? 1 : 0);
  if (light_.state() == VoxelLight::State::kAbsent || passes == 0) return;
  renewLight();
  const std::uint64_t photons = photonsFor(passes - 1, pixels(), light_.leastPhotons(), inPages());
  light_.shoot(
      photons, [] { return true; }, photonsBefore(photons));
}

}  // namespace trex
