#include "src/session/preflight.h"

#include <algorithm>
#include <cctype>

#include "src/core/error.h"
#include "src/core/log.h"
#include "src/core/memory.h"
#include "src/crays/ray_scene.h"
#include "src/frame/accumulator.h"
#include "src/frame/denoise.h"
#include "src/frame/features.h"
#include "src/frame/look_image.h"
#include "src/frame/oidn.h"
#include "src/scene/import.h"
#include "src/scene/synth.h"
#include "src/scene/texture_cache.h"
#include "src/session/denoiser.h"
#include "src/session/light_noise.h"
#include "src/session/photon_noise.h"

namespace trex {
namespace {

// Measured peaks, bytes, rounded up (docs/figures.md).
constexpr std::uint64_t kBuildBytesATriangle = 48;  // of clusters, beside the source
constexpr std::uint64_t kExpandedBytes = 48;        // a triangle of small meshes (RayScene)
constexpr std::uint64_t kMeshBytesATriangle = 12;   // clusters and their hierarchy
constexpr std::uint64_t kPlacedBytes = 24;          // a placed triangle while voxels are built
constexpr std::uint64_t kVoxelCopies = 6;           // built; kept, on the device, flux and light
/// Beside the tree, thirds of its bytes: on the device, flux, light, tables, faces.
constexpr std::uint64_t kLightThirds = 16;
constexpr std::uint64_t kFewestVoxelBytes = 4u << 20;
constexpr std::uint64_t kProgramBytes = 128u << 20;  // with the libraries that read images
constexpr std::uint64_t kCorrectionBytes = 96;       // a pixel's differences, in its parts
constexpr std::uint64_t kDeviceBytes = 96u << 20;    // driver, compiled shaders, batches of cones

std::uint64_t allowedBytes(const RenderSettings& settings) {
  const std::uint64_t all = availableMemoryLimit();
  return settings.maxMemory > 0 ? std::min(settings.maxMemory, all) : all;
}

/// `lit`: samples have guesses, so that exact ones may be paired with them.
std::uint64_t frameBytes(const RenderSettings& s, const PictureLayers& layers, bool lit) {
  const std::uint64_t pixels = std::uint64_t{s.width} * s.height;
  const bool pairs = s.exact > 0.0 && s.exact < 1.0 && (lit || s.interactive);
  std::uint64_t bytes = Accumulator::bytesNeeded(s.width, s.height, pairs);
  const bool filter =
      s.denoise != Denoise::kOff && !(s.denoise == Denoise::kAuto && s.exact >= 1.0);
  const bool oidn = mayUseOidn(s);
  if (filter || layers.needsFeatures()) bytes += FeatureImage::bytesNeeded(s.width, s.height);
  if (s.interactive) {  // the preview's sums, and the looks of both
    bytes += bytes + (filter ? LookImage::bytesNeeded(s.width, s.height) : 0);
  }
  if (s.dial && lit && !s.interactive) {
    bytes += PhotonNoise::bytesNeeded(s.width, s.height) +
             (filter ? LightNoise::bytesNeeded(s.width, s.height) : 0);
  }
  if (oidn || layers.needsSplit()) bytes += pixels * DirectImage::kBytesAPixel;
  if (layers.alpha) bytes += pixels * CoverageImage::kBytesAPixel;
  if (layers.needsFirstHit()) bytes += pixels * FirstHitImage::kBytesAPixel;
  // One after the other: the filter is for the correction, and takes over if the other fails.
  // A dial needs another frame's features to estimate the error.
  std::uint64_t denoiser = filter ? GuessFilter::bytesNeeded(s.width, s.height) : 0;
  if (filter && s.dial) bytes += FeatureImage::bytesNeeded(s.width, s.height);
  if (filter && pairs) bytes += pixels * kCorrectionBytes;
  if (oidn) denoiser = std::max(denoiser, Oidn::bytesNeeded(s.width, s.height));
  bytes += denoiser;
  // The picture, and what its file's writer holds of it.
  return bytes + pixels * (3 + layers.channels()) * sizeof(float) * 2 + pixels * 2 * sizeof(vec3);
}

/// What is freed once meshes and voxels are built.
std::uint64_t sourceBytes(const Scene& scene) {
  std::uint64_t bytes = 0;
  for (const Mesh& m : scene.meshes) {
    bytes += m.positions.size() * sizeof(vec3) + m.triangles.size() * sizeof(glm::uvec3) +
             m.normals.size() * sizeof(vec3) +
             (m.texCoords.size() + m.secondTexCoords.size()) * sizeof(vec2) +
             m.colors.size() * sizeof(glm::u8vec4);
  }
  return bytes;
}

/// Of a model that is not baked.
constexpr const char* kBakeInstead =
    "; or trex bake --stream it to a bundle, which is read in parts";

/// `less`: that would do with --exact 0.
void refuse(const Preflight& p, const RenderSettings& settings, bool baked, bool less) {
  std::string table;
  for (const Preflight::Phase& phase : p.phases) {
    table += fmt::format(" {} {},", phase.name, formatBytes(phase.bytes));
  }
  table.back() = '.';
  fail(ExitCode::kMemoryOrDevice,
       "needs about {}, allowed are {}:{} Make --max-memory larger, --size smaller, or use {}{}{}",
       formatBytes(p.needed), formatBytes(p.allowed), table, less ? "--exact 0, or " : "",
       settings.device == RenderSettings::kNoDevice ? "a smaller model" : "--device none",
       baked ? "" : kBakeInstead);
}

/// Of a generated model's arrays, before they are made.
void checkSynthFits(const std::string& name, const RenderSettings& settings) {
  constexpr std::uint64_t kBytesATriangle = 48;
  const std::uint64_t triangles = parseSynthName(name).triangles, allowed = allowedBytes(settings);
  const std::uint64_t least = triangles * (kBytesATriangle + kBuildBytesATriangle);
  if (triangles <= kMostSynthInMemory && residentBytes() + least <= allowed) return;
  fail(ExitCode::kMemoryOrDevice,
       "{}: {} triangles need about {} of memory as they are, allowed are {}; trex bake '{}' -o "
       "X.trex, and render that",
       name, triangles, formatBytes(least), formatBytes(allowed), name);
}

}  // namespace

std::shared_ptr<TextureCache> textureCacheFor(const RenderSettings& settings,
                                              const std::filesystem::path& folder) {
  std::uint64_t limit = settings.textureMemory;
  if (limit == 0 && settings.maxMemory == 0) return nullptr;
  if (limit == 0) {
    const std::uint64_t left = std::max(settings.maxMemory, kProgramBytes) - kProgramBytes;
    limit = std::max(left / 2, settings.maxMemory / 8);
  }
  return std::make_shared<TextureCache>(limit, settings.maxMemory, folder);
}

void checkSourceFits(const std::filesystem::path& source, const RenderSettings& settings) {
  std::error_code problem;
  const std::uint64_t size = std::filesystem::file_size(source, problem);
  if (problem && isSynthName(source.string())) return checkSynthFits(source.string(), settings);
  if (problem) return;  // the importer says what is wrong
  std::string extension = source.extension().string();
  for (char& c : extension) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  // Text takes more room in a file than in memory.
  const std::uint64_t least = extension == ".obj" ? size / 4 : size / 2;
  const std::uint64_t allowed = allowedBytes(settings);
  if (residentBytes() + least > allowed) {
    fail(ExitCode::kMemoryOrDevice,
         "{}: {} of model need at least {} of memory, allowed are {}; make --max-memory larger{}",
         source.string(), formatBytes(size), formatBytes(residentBytes() + least),
         formatBytes(allowed), kBakeInstead);
  }
}

Preflight preflight(const Scene& scene, const RenderSettings& settings, const PictureLayers& layers,
                    std::optional<std::uint64_t> bakedVoxels, std::uint64_t topLevelBytes) {
  Preflight p;
  p.allowed = allowedBytes(settings);
  const auto phase = [&p](const char* name, std::uint64_t bytes) {
    p.phases.push_back({name, bytes});
    p.needed = std::max(p.needed, bytes);
    logVerbose("memory: {:>10} {}", formatBytes(bytes), name);
  };
  const std::uint64_t here = residentBytes(), unique = scene.uniqueTriangleCount();
  const std::uint64_t meshes = unique * kMeshBytesATriangle +
                               std::min(unique, 8 * RayScene::kExpandedLeaves) * kExpandedBytes;
  const bool voxels = settings.exact < 1.0 && hasLight(scene);
  const TextureCache::Statistics textures = textureStatistics(scene);
  // Tiles that are not here yet.
  const std::uint64_t tiles =
      textures.pagedImages > 0 ? scene.textures->limit() - textures.bytes : 0;
  logVerbose("memory: {:>10} of textures, {}", formatBytes(textures.texelBytes),
             textures.pagedImages > 0
                 ? fmt::format("at most {} at a time", formatBytes(scene.textures->limit()))
                 : "all in memory");
  const bool device = voxels && settings.device != RenderSettings::kNoDevice;
  phase("now, with the source,", here);
  phase("building meshes", here + unique * kBuildBytesATriangle);
  if (voxels && !bakedVoxels) {
    phase("building voxels",
          here + meshes + scene.triangleCount() * kPlacedBytes + tiles + 2 * kFewestVoxelBytes);
  }
  // Memory that was freed may stay with the process in part: half is counted on.
  // A bundle's voxels are resident by now; what is made of them is not.
  const std::uint64_t voxelBytes =
      bakedVoxels ? *bakedVoxels * kLightThirds / 3 : kFewestVoxelBytes * kVoxelCopies;
  phase("rendering", here - std::min(here, sourceBytes(scene) / 2) + meshes + topLevelBytes +
                         tiles + (device ? kDeviceBytes : 0) + (voxels ? voxelBytes : 0) +
                         (settings.servesModel ? meshes + kFewestVoxelBytes : 0) +
                         settings.sharedBytes + frameBytes(settings, layers, voxels));
  logVerbose("memory: {:>10} allowed", formatBytes(p.allowed));
  if (p.needed > p.allowed) {
    RenderSettings guess = settings;
    guess.exact = 0.0;
    guess.dial = false;
    const std::uint64_t saved =
        frameBytes(settings, layers, voxels) - frameBytes(guess, layers, voxels);
    refuse(p, settings, bakedVoxels.has_value(),
           settings.exact < 1.0 && p.needed - saved <= p.allowed);
  }
  if (voxels) {
    // What does not fit on the device is paged.
    p.voxelBytes = kFewestVoxelBytes + (p.allowed - p.needed) / kVoxelCopies;
  }
  return p;
}

}  // namespace trex
