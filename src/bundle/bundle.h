// Baked bundles: a scene made ready for rays, kept in one file (FORMAT.md).
//
//   bake:  model.glb ─ importScene ─ makeModel ─► Model ─ saveBundle ─► X.trex
//   use:   X.trex ─ openBundle ─► Model: the same bits
//
// HCCMeshes are used where they lie in the mapped file. A bundle that changes while it is in use is
// not guarded against; saveBundle() replaces a file by renaming, which keeps open ones as they are.
#pragma once

#include <cstddef>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "src/bundle/container.h"
#include "src/bundle/contents.h"
#include "src/scene/import.h"
#include "src/session/model.h"

namespace trex {

/// What a bundle holds, read and checked, before Embree sees it.
struct BundleContents {
  bundle::Description description;  ///< its scene has texels, and arrays of meshes that emit
  RayScene::Parts parts;
  std::optional<asvo::Tree> voxels;
  /// Of a bundle with pages; see attachPages().
  std::optional<hccm::PageTable> pageTable;
  std::unique_ptr<hccm::PageFile> pageFile;
};

struct BundleReadOptions {
  bool voxels = true;               ///< read them if they are there
  std::uint64_t maxImageBytes = 0;  ///< of all texels together; 0: what the machine has
  /// That images keep to; null: all of them are in memory.
  std::shared_ptr<TextureCache> textures{};
  /// What starts there in the file, pages of a mesh (or at 0 tiles of images); empty: read from
  /// the bytes.
  std::function<std::unique_ptr<hccm::PageFile>(std::uint64_t start)> pages;
  bundle::Container::Fetch fetch;  ///< of bytes that are not there yet
};

/// Reads a bundle's bytes; reads no other file. They must start at a multiple of 8 and not change
/// while `owner` lives, which meshes keep. Takes hostile bytes: throws Error(kInput) that starts
/// with `name` and says what is wrong and where; Error(kMemoryOrDevice) for images that are too
/// large. Uses the calling oneTBB arena.
BundleContents readBundle(std::span<const std::byte> bytes, std::shared_ptr<const void> owner,
                          const std::string& name, const BundleReadOptions& options = {});

/// Gives the parts their paged mesh, if the bundle has one, with a limit of pages in memory (0:
/// all), and a file for those that were unpacked where not all fit. Throws Error(kMemoryOrDevice)
/// if the limit is less than a page.
void attachPages(BundleContents& contents, std::uint64_t cacheBytes, const PageDisk& disk = {});

/// A read-only map of a whole file. Throws Error(kInput).
std::shared_ptr<const std::span<const std::byte>> mapFile(const std::filesystem::path& path);

enum class SourceState {
  kUnchanged,  ///< same size and time, or same content
  kChanged,
  kAbsent,
};
/// Compares a file that a bundle was baked from. Size and time first; the content if they differ.
SourceState compareSource(const std::filesystem::path& bundle, const bundle::BakedFile& file);

/// Hashes the files that an import read, for a bundle at `target`. Throws Error(kInput) if one has
/// changed since it was read.
std::vector<bundle::BakedFile> hashSources(const std::vector<SourceFile>& files,
                                           const std::filesystem::path& target);

struct OpenOptions {
  ModelOptions model;    ///< a bundle keeps its own depth and precision
  ImportOptions import;  ///< of a source
  /// As BundleReadOptions::pages, of a bundle; empty: from its file.
  std::function<std::unique_ptr<hccm::PageFile>(std::uint64_t start)> pages{};
  bool useStale = false;                   ///< open a bundle whose sources have changed since
  std::optional<Environment> environment;  ///< instead of the scene's
  /// Called with the scene before anything large is built of it; may throw, or change the options.
  /// Meshes of a bundle's scene have no arrays.
  std::function<void(const Scene&, ModelOptions&)> prepare;
};

/// Whether a path names a bundle, by its extension.
bool isBundlePath(const std::filesystem::path& path);

/// The hash of a bundle's header, which covers the hashes of all of its bytes: equal bundles have
/// the same, and no others. Reads header and directory. Throws Error(kInput).
std::uint64_t bundleDigest(const std::filesystem::path& path);

/// Opens a bundle whose `size` bytes lie elsewhere: reads what the options need of them, pages of
/// meshes when rays ask for them. `name`: for messages. Throws as openBundle(), and what `file`
/// throws.
Model openRemoteBundle(std::shared_ptr<const hccm::PageFile> file, std::uint64_t size,
                       const std::string& name, const OpenOptions& options);

/// Opens a bundle. Throws Error(kInput) if it is damaged, of another version, or stale: a source
/// is there and its content has changed. A source that is gone is no error.
Model openBundle(const std::filesystem::path& path, const OpenOptions& options = {});

/// A bundle if the path ends in .trex, else imports the model and makes it ready.
Model openModel(const std::filesystem::path& path, const OpenOptions& options = {});

/// What saveBundle() needs besides the model.
struct BakeFacts {
  std::string input;                              ///< the model's path
  std::vector<bundle::BakedFile> files;           ///< of hashSources()
  std::vector<bundle::Requirement> requirements;  ///< asked before makeModel()
  int precisionBits = 24, voxelDepth = 0;         ///< asked for
};

/// Writes a bundle beside `target` and renames it. Equal models and facts give equal bytes.
/// `written` gets the bytes so far and in all; false from it ends in Error(kInterrupted). Throws
/// Error(kOutput) if it can't be written; the old file then stays. Returns the file's sections.
std::vector<bundle::Section> saveBundle(
    const std::filesystem::path& target, const Model& model, const BakeFacts& facts,
    const std::function<bool(std::uint64_t, std::uint64_t)>& written);

/// The bytes that saveBundle() writes, in memory.
std::vector<std::byte> bundleBytes(const Model& model, const BakeFacts& facts);

}  // namespace trex
