#include "src/bundle/stream_bake.h"
#include "asvo/medium.h"

#include <xxhash.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cmath>

#include "src/bundle/arrays.h"
#include "src/bundle/bake_journal.h"
#include "src/bundle/container_stream.h"
#include "src/bundle/describe.h"
#include "src/bundle/page_file.h"
#include "src/core/clock.h"
#include "src/core/error.h"
#include "src/core/file.h"
#include "src/core/log.h"
#include "src/core/memory.h"
#include "src/core/version.h"
#include "src/session/paged_voxels.h"

namespace trex {
namespace {

namespace fs = std::filesystem;

// Measured, rounded up (docs/figures.md).
constexpr std::uint64_t kSpillBytesATriangle = 29, kBundleBytesATriangle = 9;
constexpr double kTrianglesASecond = 2e6;
constexpr std::uint64_t kBuildBytesATriangle = 200;     // of small models
constexpr std::uint64_t kTableBytesATriangle = 1;       // of 20: entries of pages and groups
constexpr std::uint64_t kLeastBuildBytes = 192u << 20;  // buffers of cells, buckets, batches
constexpr std::uint64_t kMostBuildBytes = 1200u << 20;  // more would not be faster
constexpr std::uint64_t kOtherBytes = 64u << 20;        // the program itself
constexpr std::uint64_t kFewestVoxelBytes = 8u << 20;

fs::path besides(const fs::path& target, const char* what) {
  return target.parent_path() / fmt::format(".{}.bake{}.tmp", target.stem().string(), what);
}
fs::path bundleFile(const fs::path& target) { return besides(target, ""); }
fs::path spillFile(const fs::path& target) { return besides(target, "-spill"); }
fs::path journalFile(const fs::path& target) { return besides(target, "-journal"); }

/// The stream as the builder reads it, in render space.
class Source : public hccm::StreamSource {
 public:
  Source(const TriangleStream& stream, const dvec3& renderOrigin)
      : stream_(stream), renderOrigin_(renderOrigin) {}
  std::uint64_t batchCount() const override { return stream_.batchCount(); }
  void read(std::uint64_t number,
            const std::function<void(const hccm::StreamBatch&)>& use) const override {
    TriangleBatch batch;
    stream_.batch(number, batch);
    std::vector<hccm::StreamBatch::Run> runs;
    for (const TriangleBatch::Run& r : batch.runs) {
      runs.push_back({r.material, r.object, r.triangles});
    }
    use({batch.origin - renderOrigin_, batch.positions, batch.normals, batch.texCoords,
         batch.colors, batch.secondTexCoords, runs});
  }

 private:
  const TriangleStream& stream_;
  dvec3 renderOrigin_;
};

/// What decides the pages, besides the program's version.
std::string keyOf(const TriangleStream& stream, const StreamBakeOptions& options,
                  std::uint64_t buildBytes) {
  return fmt::format("trex {} scene {} pages {} | {} | precision {} | build {}", kVersion,
                     bundle::kSceneVersion, hccm::kPageTableVersion, stream.key(),
                     options.precisionBits, buildBytes);
}

std::uint64_t buildBytesFor(const StreamBakeOptions& options, std::uint64_t resident) {
  const std::uint64_t left = options.maxMemory > resident ? options.maxMemory - resident : 0;
  // In steps, so that a few bytes more or less in this process do not change the pages.
  constexpr std::uint64_t kStep = 64u << 20;
  return std::clamp(left / 4 * 3 / kStep * kStep, kLeastBuildBytes / 3, kMostBuildBytes);
}

void removeTemporaries(const fs::path& target) {
  std::error_code ignored;
  for (const fs::path& file : streamBakeFiles(target)) fs::remove(file, ignored);
}

class StreamBake {
 public:
  StreamBake(std::unique_ptr<TriangleStream> stream, const StreamBakeOptions& options,
             const BakeFacts& facts, const fs::path& target)
      : stream_(std::move(stream)), options_(options), facts_(facts), target_(target) {
    const Box3d bounds = stream_->bounds();
    const Box3d box = bounds.empty() ? Box3d{dvec3(0.0), dvec3(0.0)} : bounds;
    renderOrigin_ = box.centre();
    build_.grid = hccm::StreamGrid::make(box.lower - renderOrigin_, box.upper - renderOrigin_,
                                         options.precisionBits);
    build_.memoryBytes = buildBytesFor(options, stream_->residentBytes() + kOtherBytes);
  }

  StreamBakeResult run() {
    const std::string key = keyOf(*stream_, options_, build_.memoryBytes);
    bundle::BakeJournal journal(journalFile(target_), key, options_.resume);
    if (options_.resume && journal.wasOther()) {
      logInfo("{}: what is left of another bake does not fit; starting anew", target_.string());
    }
    spill(journal);
    const std::vector<hccm::Bucket> buckets = hccm::planBuckets(spill_, build_);
    result_.buckets = buckets.size();
    pages(journal, buckets);
    voxels();
    finish();
    std::error_code error;
    fs::rename(bundleFile(target_), target_, error);
    if (error) {
      fail(ExitCode::kOutput, "{}: can't be written: {}", target_.string(), error.message());
    }
    removeTemporaries(target_);
    return result_;
  }

 private:
  hccm::StreamOptions optionsFor(const char* phase) const {
    hccm::StreamOptions o = build_;
    o.keepGoing = [this, phase](double done) { return options_.keepGoing(phase, done); };
    return o;
  }

  void spill(bundle::BakeJournal& journal) {
    const double start = secondsNow();
    std::error_code error;
    std::optional<hccm::Spill> known = journal.takeSpill();
    const std::uint64_t there = fs::file_size(spillFile(target_), error);
    if (known && !error && there >= known->fileBytes) {
      spill_ = std::move(*known);
      logInfo("{}: {} triangles are sorted already", target_.string(), spill_.kept);
    } else {
      journal.cut(0, false);
      const Source source(*stream_, renderOrigin_);
      spill_ = hccm::spillTriangles(source, optionsFor("sorting"), spillFile(target_));
      journal.add(spill_);
    }
    keepScene();
    result_.spillSeconds = secondsNow() - start;
  }

  /// All of the source that is needed from here on; the rest is freed.
  void keepScene() {
    scene_ = stream_->scene();
    brought_ = stream_->attributes();
    stream_.reset();
    for (Mesh& mesh : scene_.meshes) {
      const bool emits = scene_.materials[static_cast<std::size_t>(mesh.material)].emits();
      Mesh kept;
      kept.name = std::move(mesh.name);
      kept.origin = mesh.origin;
      kept.material = mesh.material;
      kept.sameGeometryAs = mesh.sameGeometryAs;
      if (emits) {
        kept.positions = std::move(mesh.positions);
        kept.triangles = std::move(mesh.triangles);
      }
      mesh = std::move(kept);
    }
    if (options_.environment) scene_.environment = *options_.environment;
    scene_.maxBounces = options_.maxBounces.value_or(scene_.maxBounces);
    scene_.media.insert(scene_.media.end(), options_.media.begin(), options_.media.end());
    scene_.droppedTriangles += spill_.nonFinite;
    if (spill_.nonFinite > 0) {
      scene_.replaced.add(fmt::format("{}: {} triangles with non-finite vertices dropped",
                                      scene_.source, spill_.nonFinite),
                          spill_.nonFinite);
    }
    if (spill_.kept == 0) {
      fail(ExitCode::kInput, "{}: no triangle to render ({} given: {} not finite, {} without area)",
           facts_.input, spill_.given, spill_.nonFinite, spill_.flat);
    }
  }

  /// Pages of finished buckets that are whole on disk go into the table; says how many buckets.
  std::size_t reuse(bundle::BakeJournal& journal) {
    std::vector<bundle::FinishedBucket> finished = journal.takeBuckets();
    std::error_code error;
    if (finished.empty() || !fs::exists(bundleFile(target_), error)) return 0;
    const bundle::FilePages file(bundleFile(target_), bundle::kAlignment, ExitCode::kOutput);
    std::vector<std::byte> packed;
    for (std::size_t b = 0; b < finished.size(); ++b) {
      hccm::PageTable with = table_;
      try {
        for (const hccm::BuiltPage& page : finished[b].pages) {
          with.add(page);
          packed.resize(page.entry.packedBytes);
          file.read(with.pages.back().offset, packed);
          if (XXH3_64bits(packed.data(), packed.size()) != page.entry.checksum) return b;
        }
      } catch (const Error&) {
        return b;  // the file ends before
      }
      table_ = std::move(with);
    }
    return finished.size();
  }

  void pages(bundle::BakeJournal& journal, const std::vector<hccm::Bucket>& buckets) {
    const double start = secondsNow();
    table_.stepExponent = build_.grid.stepExponent;
    const std::size_t done = reuse(journal);
    result_.bucketsReused = done;
    journal.cut(done, true);
    if (done > 0) {
      logInfo("{}: {} of {} buckets are there already", target_.string(), done, buckets.size());
    }
    out_ = std::make_unique<bundle::ContainerStream>(bundleFile(target_), target_.string(),
                                                     "world.pages", table_.packedBytes());
    bundle::FinishedBucket bucket;
    const auto sink = [&](const hccm::BuiltPage& page) {
      table_.add(page);
      out_->write(page.packed);
      hccm::BuiltPage& kept = bucket.pages.emplace_back();
      kept.entry = page.entry;
      kept.groups = page.groups;
      kept.sizes = page.sizes;
    };
    const auto finished = [&](std::size_t number) {
      bucket.bucket = number;
      journal.add(bucket);
      bucket = {};
    };
    hccm::buildPages(spillFile(target_), spill_, buckets, done, optionsFor("clustering"), sink,
                     finished);
    table_.droppedTriangles = spill_.nonFinite + spill_.flat;
    std::error_code ignored;
    fs::resize_file(spillFile(target_), spill_.fileBytes, ignored);  // what was spilled again
    result_.meshSeconds = secondsNow() - start;
  }

  void voxels() {
    if (options_.voxelDepth <= 0 || !hasLight(scene_)) return;
    const double start = secondsNow();
    const std::uint64_t here = residentBytes();
    const std::uint64_t left = options_.maxMemory > here ? options_.maxMemory - here : 0;
    // A third for pages, a third for the triangles at hand, a third for the tree.
    const std::uint64_t cache = std::clamp<std::uint64_t>(
        left / 4, 4 * hccm::PageCache::leastBytes(table_),
        std::max<std::uint64_t>(std::uint64_t{1} << 30, 4 * hccm::PageCache::leastBytes(table_)));
    const hccm::PagedMesh mesh(table_,
                               std::make_unique<bundle::FilePages>(
                                   bundleFile(target_), bundle::kAlignment, ExitCode::kOutput),
                               cache, static_cast<std::uint32_t>(scene_.materials.size()));
    asvo::BuildOptions build;
    build.depth = options_.voxelDepth;
    build.deepen = true;
    build.maxBytes = std::max(kFewestVoxelBytes, left / 4);
    tree_ = buildPagedVoxels(scene_, mesh, build, std::max<std::uint64_t>(left / 8, 16u << 20),
                             [this](double done) { return options_.keepGoing("voxels", done); });
    result_.voxelDepth = static_cast<int>(tree_->info.depth);
    result_.voxelSeconds = secondsNow() - start;
  }

  void finish() {
    BakeFacts facts = facts_;
    facts.requirements = bundle::requirementsOf(scene_, options_.voxelDepth > 0);
    // The scene's own meshes may be empty: their triangles come from the stream.
    for (bundle::Requirement& r : facts.requirements) {
      const bool brought = (r.name == "normals" && brought_.normals) ||
                           (r.name == "vertex colours" && brought_.colors);
      if (!r.required && brought) r = {r.name, true, "the model's triangles have them", 0};
    }
    const bundle::Description d =
        bundle::describe(scene_, {renderOrigin_, 0, {}, tree_.has_value()}, facts);
    const auto add = [&](const std::string& name, const auto& bytes) {
      out_->section(name);
      out_->write(std::as_bytes(std::span(bytes)));
    };
    add("world.table", table_.toBytes());
    add("scene.json", bundle::writeDescription(d));
    if (!d.emitters.empty()) add("emitters.bin", bundle::packEmitters(d, scene_.meshes));
    for (std::size_t i = 0; i < scene_.media.size(); ++i) {
      add(fmt::format("medium-{}.fog", i), scene_.media[i].grid->toBytes());
    }
    if (tree_) add("voxels.asvo", tree_->toBytes());
    for (std::size_t i = 0; i < scene_.images.size(); ++i) {
      add(fmt::format("image-{}.tiles", i), *bundle::packImage(scene_.images[i]));
    }
    if (scene_.environment.map) {
      add("environment.zst", bundle::packMap(*scene_.environment.map));
    }
    result_.sections = out_->finish();
    out_.reset();
    result_.triangles = table_.triangles;
    result_.droppedTriangles = table_.droppedTriangles;
    result_.replacedParts = scene_.replaced.count;
    result_.pages = table_.pages.size();
    result_.clusters = table_.clusters();
  }

  std::unique_ptr<TriangleStream> stream_;
  const StreamBakeOptions& options_;
  const BakeFacts& facts_;
  fs::path target_;
  dvec3 renderOrigin_{0.0};
  hccm::StreamOptions build_;
  hccm::Spill spill_;
  hccm::PageTable table_;
  Scene scene_;
  StreamAttributes brought_;
  std::optional<asvo::Tree> tree_;
  std::unique_ptr<bundle::ContainerStream> out_;
  StreamBakeResult result_;
};

}  // namespace

std::vector<fs::path> streamBakeFiles(const fs::path& target) {
  return {bundleFile(target), spillFile(target), journalFile(target)};
}

StreamEstimate estimateStreamBake(const TriangleStream& stream, const StreamBakeOptions& options,
                                  const fs::path& target) {
  StreamEstimate e;
  const std::uint64_t n = stream.triangleCount();
  const std::uint64_t held = stream.residentBytes() + kOtherBytes;
  e.allowed = options.maxMemory;
  const std::uint64_t build = buildBytesFor(options, held);
  // A third of the build goes into batches and compressors beyond its buffers; tables stay.
  const std::uint64_t most = std::min(build / 3 * 4, n * kBuildBytesATriangle);
  e.memory =
      std::max(held + std::max(most, kLeastBuildBytes), kOtherBytes + 2 * kFewestVoxelBytes) +
      n / 20 * kTableBytesATriangle;
  e.spillBytes = n * (kSpillBytesATriangle + stream.attributes().bytes());
  e.bundleBytes = n * (kBundleBytesATriangle + stream.attributes().bytes() / 4);
  e.seconds = static_cast<double>(n) / kTrianglesASecond;
  std::error_code error;
  const fs::path folder = target.has_parent_path() ? target.parent_path() : fs::path(".");
  const fs::space_info space = fs::space(folder, error);
  e.freeBytes = error ? ~std::uint64_t{0} : space.available;
  for (const fs::path& file : streamBakeFiles(target)) {  // these are reused or removed
    const std::uint64_t bytes = fs::file_size(file, error);
    if (!error) e.freeBytes += bytes;
  }
  if (e.memory > e.allowed) {
    fail(ExitCode::kMemoryOrDevice,
         "{}: streaming {} triangles needs about {}, allowed are {}; make --max-memory larger",
         stream.scene().source, n, formatBytes(e.memory), formatBytes(e.allowed));
  }
  if (e.spillBytes + e.bundleBytes > e.freeBytes) {
    fail(
        ExitCode::kMemoryOrDevice,
        "{}: {} triangles need about {} of disk ({} while it is sorted, {} for the bundle), {} has "
        "{} free; free some, or bake to another disk",
        stream.scene().source, n, formatBytes(e.spillBytes + e.bundleBytes),
        formatBytes(e.spillBytes), formatBytes(e.bundleBytes), folder.string(),
        formatBytes(e.freeBytes));
  }
  return e;
}

StreamBakeResult bakeStream(std::unique_ptr<TriangleStream> stream,
                            const StreamBakeOptions& options, const BakeFacts& facts,
                            const fs::path& target) {
  const auto give = [&](ExitCode code, const std::string& why) {
    removeTemporaries(target);
    throw Error(code, fmt::format("{}: {}", target.string(), why));
  };
  bool interrupted = false;
  StreamBakeOptions watched = options;
  watched.keepGoing = [&](const char* phase, double done) {
    interrupted = interrupted || !options.keepGoing(phase, done);
    return !interrupted;
  };
  try {
    return StreamBake(std::move(stream), watched, facts, target).run();
  } catch (const hccm::FileError& e) {
    give(ExitCode::kOutput, fmt::format("{}", e.what()));
  } catch (const hccm::FormatError& e) {
    give(ExitCode::kOutput, fmt::format("a temporary file is damaged: {}; bake again", e.what()));
  } catch (const std::bad_alloc&) {
    give(ExitCode::kMemoryOrDevice, "not enough memory");
  } catch (const Error& e) {
    // What another process holds is its own.
    const bool held = std::string(e.what()).find("another bake") != std::string::npos;
    if (!held) {
      removeTemporaries(target);
    }
    throw;
  } catch (const std::exception& e) {
    if (interrupted) {
      throw Error(ExitCode::kInterrupted,
                  fmt::format("{}: interrupted; --resume goes on", target.string()));
    }
    give(ExitCode::kInput, e.what());
  }
  return {};
}

}  // namespace trex
