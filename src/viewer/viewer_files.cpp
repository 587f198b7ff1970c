// What the viewer tells and saves: picking, figures, pictures, edits, recovery.
#include <fmt/format.h>

#include <cmath>
#include <cstring>
#include <numbers>
#include <utility>

#include "src/core/log.h"
#include "src/core/memory.h"
#include "src/core/version.h"
#include "src/scene/import.h"
#include "src/viewer/viewer_parts.h"

namespace trex {
namespace fs = std::filesystem;

Box3d Viewer::bounds() const {
  const Box3f box = impl_->session->rays().bounds();
  const dvec3 origin = impl_->session->rays().renderOrigin();
  Box3d out;
  if (!box.empty()) {
    out.extend(dvec3(box.lower) + origin);
    out.extend(dvec3(box.upper) + origin);
  }
  return out;
}

int Viewer::voxelDepth() const {
  const asvo::Tree* tree = impl_->session ? impl_->session->light().voxels() : nullptr;
  return tree ? static_cast<int>(tree->info.depth) : 0;
}

std::optional<Pick> Viewer::pick(float x, float y) const {
  if (!impl_->session) return {};
  dvec3 origin;
  vec3 direction;
  impl_->session->cameraRays().ray(x, y, origin, direction);
  const RayScene& rays = impl_->session->rays();
  RayHit hit;
  if (!rays.intersect(origin, direction, 0.0f, kInfinity, hit)) return {};
  const Surface surface = rays.surface(hit);
  Pick pick;
  pick.object = surface.object;
  pick.material = surface.material;
  pick.position = surface.position + rays.renderOrigin();
  pick.normal = glm::dot(surface.geometricNormal, direction) > 0.0f ? -surface.geometricNormal
                                                                    : surface.geometricNormal;
  pick.distance = hit.t;
  return pick;
}

bool Viewer::project(const dvec3& world, vec2& pixel) const {
  const Camera& c = impl_->shownLook.camera;
  const vec3 right = glm::normalize(glm::cross(c.forward, c.up));
  const dvec3 offset = world - c.eye;
  const double depth = glm::dot(offset, dvec3(c.forward));
  const double x = glm::dot(offset, dvec3(right)), y = glm::dot(offset, dvec3(c.up));
  const double half = c.orthographic ? 0.5 * static_cast<double>(c.orthographicHeight)
                                     : depth * std::tan(0.5 * static_cast<double>(c.verticalFov));
  if (!(half > 0.0) || depth <= 0.0) return false;
  const double height = impl_->session->frame().height(), width = impl_->session->frame().width();
  pixel = vec2(0.5 * width + 0.5 * height * x / half, 0.5 * height - 0.5 * height * y / half);
  return true;
}

ViewerFigures Viewer::figures() const {
  ViewerFigures f;
  const Impl& m = *impl_;
  f.residentBytes = residentBytes();
  if (!m.session) return f;
  f.session = m.session->report();
  if (m.options.helper != nullptr) {
    f.machines = m.options.helper->machines();
    f.readyMachines = m.options.helper->readyMachines();
  }
  const SessionReport& r = f.session;
  const FrameBuffers& frame = m.session->shownFrame();
  f.device = r.device;
  f.voxelDepth = voxelDepth();
  f.meshBytes = r.mesh.meshBytes + r.mesh.topLevelBytes;
  f.voxelBytes = r.voxelBytes;
  f.deviceBytes = r.gRays.deviceBytes;
  if (m.rates.seconds > 0.0) {
    f.cRaysPerSecond = m.rates.cRays / m.rates.seconds;
    f.gRaysPerSecond = m.rates.gRays / m.rates.seconds;
  }
  f.samplesPerPixel = frame.tiles.meanProgress();
  const double exact = m.options.settings.exact;
  const bool guesses = m.session->lights().anyPower() && m.session->light().voxels();
  const Dial* dial = frame.dial.get();
  f.exactShare = !guesses ? 1.0 : dial != nullptr ? dial->share() : exact;
  f.noise = m.session->previewing() ? -1.0
            : dial != nullptr       ? dial->noise()
                                    : m.noiseEstimate.of(*m.session);
  if (exact > 0.0) f.bias = dial != nullptr ? dial->bias() : 0.0;
  if (exact <= 0.0 && m.bias.count >= 64) {
    f.bias = std::max(0.0, m.bias.sum / static_cast<double>(m.bias.count));
  }
  if (f.noise >= 0.0 && f.bias >= 0.0) f.truthDistance = f.noise + f.bias;
  f.splitError = m.measureSplit();
  f.converged = m.session->goalReached();
  f.longestWait = frame.tiles.longestWait();
  f.tiles = static_cast<std::uint32_t>(frame.tiles.tiles().size());
  return f;
}

/// relMSE between both halves' modes where both have two samples, less what noise adds.
double Viewer::Impl::measureSplit() const {
  if (!state.split || !exact || session->previewing()) return -1.0;
  const FrameBuffers &a = session->shownFrame(), &b = exact->shownFrame();
  if (a.tiles.samplesDone() < 2 || b.tiles.samplesDone() < 2) return -1.0;
  const std::uint32_t width = session->frame().width(), height = session->frame().height();
  double mean = 0.0, sum = 0.0, count = 0.0;
  constexpr std::uint32_t kStep = 3;
  const auto each = [&](const auto& visit) {
    for (std::uint32_t y = 0; y < height; y += kStep) {
      for (std::uint32_t x = 0; x < width; x += kStep) visit(x, y);
    }
  };
  each([&](std::uint32_t x, std::uint32_t y) {
    mean += static_cast<double>(luminance(vec3(b.rawMean(x, y))));
    count += 1.0;
  });
  mean /= count;
  each([&](std::uint32_t x, std::uint32_t y) {
    const dvec3 d = a.rawMean(x, y) - b.rawMean(x, y), truth = b.rawMean(x, y);
    const dvec3 noise = a.rawVariance(x, y) + b.rawVariance(x, y);
    const dvec3 part = (d * d - noise) / (truth * truth + 0.01 * mean * mean + 1e-12);
    sum += (part.x + part.y + part.z) / 3.0;
  });
  return std::max(0.0, sum / count);
}

float Viewer::suitableExposure() const { return impl_->suitableExposure(); }

/// Of the picture on the screen.
float Viewer::Impl::suitableExposure() const {
  Picture picture;
  picture.width = screen.image().width;
  picture.height = screen.image().height;
  picture.channels = {"R", "G", "B"};
  for (const vec3& v : screen.linear()) {
    picture.values.insert(picture.values.end(), {v.x, v.y, v.z});
  }
  return picture.values.empty() ? history->current().exposure : autoExposure(picture);
}

void Viewer::savePicture(const fs::path& path) {
  if (!knownPictureExtension(path)) {
    fail(ExitCode::kUsage, "{}: unknown picture format; use .exr, .png or .jpg", path.string());
  }
  Impl& m = *impl_;
  if (!m.session) fail(ExitCode::kOutput, "{}: nothing is open to be saved", path.string());
  if (!isExr(path) && m.screen.image().version > 0) {
    const ScreenImage& screen = m.screen.image();
    writeScreen(path, screen.width, screen.height, screen.rgba);
    return;
  }
  // A picture has no holes: the first sample of every pixel is finished first.
  const bool paused = std::exchange(m.state.paused, false);
  while (m.session->samplesDone() == 0) {
    if (m.lost) fail(ExitCode::kOutput, "{}: {}", path.string(), m.message);
    m.step(0.05);
  }
  m.state.paused = paused;
  Picture picture = m.session->picture();
  picture.metadata = {{"trex:version", kVersion},
                      {"trex:scene", m.input.string()},
                      {"trex:samples", std::to_string(m.session->samplesDone())},
                      {"trex:seed", std::to_string(m.options.settings.seed)},
                      {"trex:exact", exactText(m.options.settings)},
                      {"trex:denoised", m.session->report().denoiser}};
  writePicture(path, picture, ToneMap{m.shownLook.exposure, m.state.toneOperator});
}

LookLight Viewer::Impl::light() const {
  return {session->light().leastPhotons(), session->light().aim()};
}

void Viewer::saveEdits(const fs::path& path) {
  Impl& m = *impl_;
  writeLook(path, m.history->current(), m.editor->model().scene, m.editor->source(), m.light());
  m.history->markSaved();
  discardRecovery();
}

void Viewer::loadEdits(const fs::path& path) {
  Impl& m = *impl_;
  edit(readLook(path, m.editor->model().scene, m.editor->source()), true,
       "load " + path.filename().string());
  m.exposureSet = true;
}

std::optional<fs::path> Viewer::recoveryFile() const {
  if (!impl_->options.recovery || impl_->input.empty()) return {};
  const fs::path path = recoveryPath(impl_->input);
  std::error_code problem;
  if (path.empty() || !fs::is_regular_file(path, problem)) return {};
  return path;
}

void Viewer::restoreRecovery() {
  if (const auto path = recoveryFile()) loadEdits(*path);
}

void Viewer::discardRecovery() {
  impl_->recoveryDue = false;
  if (const auto path = recoveryFile()) {
    std::error_code problem;
    fs::remove(*path, problem);
  }
}

/// Unsaved edits go to their file, at most once a second. Trouble with it is said, not fatal.
void Viewer::Impl::keepRecovery() {
  nextRecovery = secondsNow() + 1.0;
  if (!recoveryDue || !options.recovery || !history || !editor || !history->unsaved()) return;
  recoveryDue = false;
  const fs::path path = recoveryPath(input);
  if (path.empty()) return;
  try {
    fs::create_directories(path.parent_path());
    writeLook(path, history->current(), editor->model().scene, editor->source());
  } catch (const std::exception& e) {
    logWarning("unsaved edits could not be kept: {}", e.what());
  }
}

std::string Viewer::headlessCommand(const std::string& editsPath, const std::string& output) const {
  const Impl& m = *impl_;
  const RenderSettings& s = m.options.settings;
  const auto quoted = [](const std::string& text) {
    const bool plain = text.find_first_not_of(
                           "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789"
                           "_-./,:=+") == std::string::npos;
    if (plain && !text.empty()) return text;
    std::string out = "'";
    for (const char c : text) out += c == '\'' ? std::string("'\\''") : std::string(1, c);
    return out + "'";
  };
  std::string command =
      fmt::format("trex render {} -o {} --size {}x{} --spp {} --exact {} --seed {} --edits {}",
                  quoted(m.input.string()), quoted(output), s.width, s.height,
                  std::max(m.session ? m.session->samplesDone() : 1u, 1u), exactText(s), s.seed,
                  quoted(editsPath));
  const ImportOptions& i = m.options.import;
  if (i.unit != 1.0) command += fmt::format(" --unit {}", i.unit);
  if (i.zUp) command += " --up z";
  if (i.pointSize > 0.0) command += fmt::format(" --point-size {}", i.pointSize);
  if (!i.scene.empty()) command += " --scene " + quoted(i.scene);
  if (!i.variant.empty()) command += " --variant " + quoted(i.variant);
  if (!i.animation.empty()) {
    command += fmt::format(" --animation {} --at {}", quoted(i.animation), i.atSeconds);
  }
  for (const std::string& define : i.defines) command += " -D " + quoted(define);
  if (i.maxBounces) command += " --max-bounces " + bouncesText(*i.maxBounces);
  for (const std::string& v : m.options.volumes) command += " --volume " + quoted(v);
  if (!m.options.environment.empty()) command += " --env " + quoted(m.options.environment);
  if (s.guess != GuessKind::kAuto) command += " --guess " + guessText(s);
  if (s.photonKind != PhotonKind::kAuto) {
    command +=
        s.photonKind == PhotonKind::kRay ? " --photon-bounces ray" : " --photon-bounces voxel";
  }
  command += s.denoise == Denoise::kOff ? " --denoise off" : " --denoise filter";
  if (m.state.toneOperator != kDefaultToneOperator) {
    command += " --tonemap " + toneOperatorNames()[static_cast<std::size_t>(m.state.toneOperator)];
  }
  if (s.device == RenderSettings::kNoDevice) command += " --device none";
  if (s.device >= 0) command += fmt::format(" --device {}", s.device);
  return command;
}

}  // namespace trex
