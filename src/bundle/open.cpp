// From the file of a bundle to a model.
#include <fcntl.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <tbb/parallel_for.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <cstring>

#include "asvo/medium.h"
#include "src/bundle/arrays.h"
#include "src/bundle/bundle.h"
#include "src/bundle/page_disk.h"
#include "src/bundle/page_file.h"
#include "src/core/clock.h"
#include "src/core/error.h"
#include "src/core/log.h"
#include "src/core/memory.h"
#include "src/scene/texels.h"
#include "src/scene/texture_cache.h"

namespace trex {
namespace {

namespace fs = std::filesystem;
using bundle::Container;
using Bytes = std::span<const std::byte>;

hccm::Mesh readMesh(const Container& container, const std::string& section,
                    const std::shared_ptr<const void>& owner, std::size_t materials) {
  try {
    hccm::Mesh mesh = hccm::Mesh::fromView(container.section(section), owner);
    for (std::uint32_t i = 0; i < mesh.clusterCount(); ++i) {
      if (mesh.clusterMaterial(i) < materials) continue;
      fail(ExitCode::kInput, "{}: {}: material {} does not exist; there are {}; bake again",
           container.name(), section, mesh.clusterMaterial(i), materials);
    }
    return mesh;
  } catch (const hccm::FormatError& e) {
    fail(ExitCode::kInput, "{}: {}: {}; bake again", container.name(), section, e.what());
  }
}

/// `file`: where the packed texels lie, at offsets in the bundle; `here`: the same in its bytes,
/// once they are there.
void readImages(const Container& container, const std::shared_ptr<const TexelFile>& file,
                const std::shared_ptr<const TexelFile>& here, bundle::Description& d,
                const BundleReadOptions& options) {
  Scene& scene = d.scene;
  scene.textures = options.textures;
  std::uint64_t bytes = 0, mapBytes = 0;
  for (std::size_t i = 0; i < scene.images.size(); ++i) {
    bytes += texelBytes(scene.images[i], d.imageKinds[i]);
  }
  if (scene.environment.map) mapBytes = texelBytes(*scene.environment.map, TexelKind::kFloat);
  const bool whole = !scene.textures || scene.textures->fits(bytes);
  const std::uint64_t limit =
      options.maxImageBytes > 0 ? options.maxImageBytes : availableMemoryLimit();
  if (const std::uint64_t needed = mapBytes + (whole ? bytes : 0); needed > limit) {
    fail(ExitCode::kMemoryOrDevice, "{}: its images need {}, there are {}", container.name(),
         formatBytes(needed), formatBytes(limit));
  }
  const auto nameOf = [](std::size_t i) { return fmt::format("image-{}.tiles", i); };
  const auto stays = [&](std::size_t i) {
    return whole || texelBytes(scene.images[i], d.imageKinds[i]) <= kTileBytes;
  };
  // From elsewhere what stays comes in large parts, and not tile by tile.
  for (std::size_t i = 0; options.fetch && i < scene.images.size(); ++i) {
    if (stays(i)) container.section(nameOf(i));
  }
  tbb::parallel_for(std::size_t{0}, scene.images.size(), [&](std::size_t i) {
    const std::string section = nameOf(i);
    Image& image = scene.images[i];
    try {
      auto tiles = std::make_shared<const PagedTexels>(
          image, d.imageKinds[i], stays(i) && options.fetch ? here : file,
          container.offsetOf(section), container.uncheckedSection(section).size(), scene.textures);
      if (stays(i)) {
        tiles->whole(image);
      } else {
        image.paged = std::move(tiles);
      }
    } catch (const Error& e) {
      fail(e.code(), "{}: {}", section, e.what());
    }
  });
  if (scene.textures) scene.textures->admit(scene.images);
  if (!scene.environment.map) return;
  auto map = std::make_shared<Image>(*scene.environment.map);
  const std::string where = container.name() + ": environment.zst";
  bundle::unpackMap(container.section("environment.zst"), where, *map);
  for (const float f : map->floats) {
    if (f < 0.0f) fail(ExitCode::kInput, "{}: has a negative texel; bake again", where);
  }
  scene.environment.map = std::move(map);
}

void readMedia(const Container& container, Scene& scene) {
  for (std::size_t i = 0; i < scene.media.size(); ++i) {
    const std::string section = fmt::format("medium-{}.fog", i);
    try {
      scene.media[i].grid =
          std::make_shared<const asvo::Medium>(asvo::Medium::fromBytes(container.section(section)));
    } catch (const asvo::FormatError& e) {
      fail(ExitCode::kInput, "{}: {}: {}; bake again", container.name(), section, e.what());
    }
  }
}

/// The table of a bundle with pages, and where they lie.
void readPages(const Container& container, const std::shared_ptr<const void>& owner,
               const BundleReadOptions& options, BundleContents& out) {
  const Bytes pages = container.uncheckedSection("world.pages");
  const std::uint64_t start = container.offsetOf("world.pages");
  try {
    out.pageTable = hccm::PageTable::fromBytes(container.section("world.table"), pages.size());
  } catch (const hccm::FormatError& e) {
    fail(ExitCode::kInput, "{}: world.table: {}; bake again", container.name(), e.what());
  }
  if (options.pages) {
    out.pageFile = options.pages(start);
  } else {
    out.pageFile = std::make_unique<bundle::MemoryPages>(pages, owner, container.name(), start);
  }
}

std::size_t sectionsExpected(const bundle::Description& d, bool paged) {
  return 2 + (paged ? 1 : 0) + d.sharedMeshes + (d.emitters.empty() ? 0 : 1) +
         (d.voxelDepth > 0 ? 1 : 0) + d.scene.images.size() + (d.scene.environment.map ? 1 : 0) +
         d.scene.media.size();
}

/// Throws for sources that have changed; says which are gone.
void checkSources(const fs::path& path, const bundle::Description& d, bool useStale) {
  for (const bundle::BakedFile& file : d.files) {
    const SourceState state = compareSource(path, file);
    if (state == SourceState::kAbsent) {
      logVerbose("{}: {}, which it was baked from, is not there", path.string(), file.file.path);
    }
    if (state != SourceState::kChanged) continue;
    if (!useStale) {
      fail(ExitCode::kInput,
           "{}: was baked from {}, which has changed since; bake again, or --stale use",
           path.string(), file.file.path);
    }
    logWarning("{}: was baked from {}, which has changed since", path.string(), file.file.path);
  }
}

PagedSizes sizesOf(const BundleContents& contents) {
  if (!contents.pageTable) return {};
  constexpr std::uint64_t kTopLevelBytes = 200;  // a group: Embree's hierarchy, and our table
  const hccm::PageTable& table = *contents.pageTable;
  std::uint64_t pages = 0;
  for (const hccm::PageEntry& p : table.pages) pages += hccm::PageCache::bytesOf(p);
  return {pages, table.packedBytes(), table.groups.size() * kTopLevelBytes,
          hccm::PageCache::leastBytes(table)};
}

/// Says where pictures will differ from those of the source.
void noteVoxels(const fs::path& path, const BundleContents& contents, const ModelOptions& wanted) {
  if (!wanted.voxels || !hasLight(contents.description.scene)) return;
  if (!contents.voxels) {
    logWarning("{}: has no voxels; every sample is traced exactly", path.string());
    return;
  }
  const auto depth = static_cast<int>(contents.voxels->info.depth);
  const int asked = contents.description.voxelDepth;
  const bool finer = asked > wanted.voxelDepth && depth > wanted.voxelDepth;
  const bool coarser = asked < wanted.voxelDepth && depth >= asked;
  if (finer || coarser) {
    logInfo("{}: its voxels, of depth {}, are {} than the model itself would get for this picture",
            path.string(), depth, finer ? "finer" : "coarser");
  }
}

}  // namespace

std::shared_ptr<const Bytes> mapFile(const fs::path& path) {
  const int file = ::open(path.c_str(), O_RDONLY | O_CLOEXEC);
  if (file < 0) {
    fail(ExitCode::kInput, "{}: can't be opened: {}", path.string(), std::strerror(errno));
  }
  struct stat status {};
  const bool plain = ::fstat(file, &status) == 0 && S_ISREG(status.st_mode);
  const auto size = static_cast<std::size_t>(plain ? status.st_size : 0);
  void* const start =
      size > 0 ? ::mmap(nullptr, size, PROT_READ, MAP_PRIVATE, file, 0) : MAP_FAILED;
  const int reason = errno;
  ::close(file);
  if (!plain) fail(ExitCode::kInput, "{}: not a plain file", path.string());
  if (size == 0) fail(ExitCode::kInput, "{}: the file is empty", path.string());
  if (start == MAP_FAILED) {
    fail(ExitCode::kInput, "{}: can't be mapped: {}", path.string(), std::strerror(reason));
  }
  return {new Bytes(static_cast<const std::byte*>(start), size), [](const Bytes* bytes) {
            ::munmap(const_cast<std::byte*>(bytes->data()), bytes->size());
            delete bytes;
          }};
}

BundleContents readBundle(Bytes bytes, std::shared_ptr<const void> owner, const std::string& name,
                          const BundleReadOptions& options) {
  const Container container(bytes, name, options.fetch);
  bundle::Description d = bundle::readDescription(container.section("scene.json"), name);
  const bool paged = container.has("world.table");
  if (container.sections().size() != sectionsExpected(d, paged)) {
    fail(ExitCode::kInput, "{}: has {} sections, scene.json speaks of {}; bake again", name,
         container.sections().size(), sectionsExpected(d, paged));
  }
  const std::size_t materials = d.scene.materials.size();
  BundleContents out{
      {},
      {d.renderOrigin,
       paged ? hccm::Mesh::build({}) : readMesh(container, "world.hccm", owner, materials),
       {},
       {},
       nullptr},
      std::nullopt,
      std::nullopt,
      nullptr};
  if (paged) readPages(container, owner, options, out);
  RayScene::Parts& parts = out.parts;
  for (std::uint32_t i = 0; i < d.sharedMeshes; ++i) {
    parts.shared.push_back(readMesh(container, fmt::format("mesh-{}.hccm", i), owner, materials));
  }
  parts.placed = d.placed;
  if (!d.emitters.empty()) {
    bundle::unpackEmitters(container.section("emitters.bin"), name + ": emitters.bin", d);
  }
  const auto here = std::make_shared<bundle::BundleTexels>(
      std::make_unique<bundle::MemoryPages>(bytes, owner, name, 0));
  readImages(container,
             options.pages ? std::make_shared<bundle::BundleTexels>(options.pages(0)) : here, here,
             d, options);
  readMedia(container, d.scene);
  if (options.voxels && d.voxelDepth > 0) {
    try {
      out.voxels = asvo::Tree::fromBytes(container.section("voxels.asvo"));
    } catch (const asvo::FormatError& e) {
      fail(ExitCode::kInput, "{}: voxels.asvo: {}; bake again", name, e.what());
    }
  }
  d.scene.source = name;
  out.description = std::move(d);
  return out;
}

void attachPages(BundleContents& contents, std::uint64_t cacheBytes, const PageDisk& disk) {
  if (!contents.pageTable) return;
  hccm::PageTable& table = *contents.pageTable;
  const std::uint64_t least = hccm::PageCache::leastBytes(table);
  std::uint64_t all = 0;
  for (const hccm::PageEntry& p : table.pages) all += hccm::PageCache::bytesOf(p);
  if (cacheBytes == 0 || cacheBytes > all) cacheBytes = std::max(all, least);
  if (cacheBytes < least) {
    fail(ExitCode::kMemoryOrDevice,
         "{}: a cache of {} is smaller than the largest page of {}; make --cache or --max-memory "
         "larger",
         contents.description.scene.source, formatBytes(cacheBytes), formatBytes(least));
  }
  const auto materials = static_cast<std::uint32_t>(contents.description.scene.materials.size());
  auto kept = openUnpackedPages(disk.folder, cacheBytes < all ? disk.bytes : 0, table.pages.size());
  contents.parts.paged = std::make_unique<hccm::PagedMesh>(
      std::move(table), std::move(contents.pageFile), cacheBytes, materials, std::move(kept));
  contents.pageTable.reset();
}

bool isBundlePath(const fs::path& path) { return path.extension() == ".trex"; }

namespace {

/// Memory for a file's bytes, none of which takes any before it is written.
std::shared_ptr<const std::span<std::byte>> reserveBytes(std::uint64_t size,
                                                         const std::string& name) {
  using Room = std::span<std::byte>;
  void* const start = ::mmap(nullptr, std::max<std::uint64_t>(size, 1), PROT_READ | PROT_WRITE,
                             MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
  if (start == MAP_FAILED) {
    fail(ExitCode::kMemoryOrDevice, "{}: no room for {}: {}", name, formatBytes(size),
         std::strerror(errno));
  }
  return {new Room(static_cast<std::byte*>(start), size), [](const Room* bytes) {
            ::munmap(bytes->data(), std::max<std::size_t>(bytes->size(), 1));
            delete bytes;
          }};
}

/// The model of a bundle's contents, whose scene knows the files it is of.
Model modelOf(BundleContents contents, const OpenOptions& options) {
  const fs::path path(contents.description.scene.source);
  Scene& scene = contents.description.scene;
  if (options.environment) scene.environment = *options.environment;
  scene.maxBounces = options.import.maxBounces.value_or(scene.maxBounces);
  tellReplaced(scene, options.import.strict);
  noteVoxels(path, contents, options.model);
  addVolumes(scene, options.import.volumes, options.import.maxMemory);
  ModelOptions wanted = options.model;
  wanted.paged = sizesOf(contents);
  wanted.bakedVoxels = contents.voxels ? bytesOf(*contents.voxels) : 0;
  if (options.prepare) options.prepare(scene, wanted);
  attachPages(contents, wanted.cacheBytes, wanted.pageDisk);
  Model model;
  model.scene = std::move(scene);
  const double start = secondsNow();
  model.rays = std::make_unique<RayScene>(model.scene, std::move(contents.parts));
  model.meshSeconds = secondsNow() - start;
  if (contents.voxels) {
    model.voxels = std::make_shared<asvo::Tree>(std::move(*contents.voxels));
  }
  return model;
}

}  // namespace

Model openBundle(const fs::path& path, const OpenOptions& options) {
  const auto bytes = mapFile(path);
  BundleReadOptions read;
  read.voxels = options.model.voxels;
  read.textures = options.import.textures;
  read.pages = options.pages;
  if (!read.pages) {
    read.pages = [&](std::uint64_t start) {
      return std::make_unique<bundle::FilePages>(path, start);
    };
  }
  BundleContents contents = readBundle(*bytes, bytes, path.string(), read);
  checkSources(path, contents.description, options.useStale);
  contents.description.scene.files = {examineSource(path)};
  return modelOf(std::move(contents), options);
}

Model openRemoteBundle(std::shared_ptr<const hccm::PageFile> file, std::uint64_t size,
                       const std::string& name, const OpenOptions& options) {
  const auto room = reserveBytes(size, name);
  BundleReadOptions read;
  read.voxels = options.model.voxels;
  read.textures = options.import.textures;
  read.fetch = [&](std::uint64_t offset, std::uint64_t count) {
    file->read(offset, room->subspan(offset, count));
  };
  read.pages = [&](std::uint64_t start) {
    return std::make_unique<bundle::PagesWithin>(file, start);
  };
  return modelOf(readBundle(*room, room, name, read), options);
}

std::uint64_t bundleDigest(const fs::path& path) {
  const auto bytes = mapFile(path);
  return Container(*bytes, path.string()).digest();
}

Model openModel(const fs::path& path, const OpenOptions& options) {
  if (isBundlePath(path)) return openBundle(path, options);
  ImportOptions import = options.import;
  import.environmentGiven |= options.environment.has_value();
  Scene scene = importScene(path, import);
  if (options.environment) scene.environment = *options.environment;
  ModelOptions build = options.model;
  if (options.prepare) options.prepare(scene, build);
  return makeModel(std::move(scene), build);
}

}  // namespace trex
