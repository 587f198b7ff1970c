#include "src/scene/texture_file.h"

#include <algorithm>

#include "src/scene/image_io.h"
#include "src/scene/import_detail.h"
#include "src/scene/input_file.h"
#include "src/scene/texels.h"
#include "src/scene/texture_cache.h"

namespace trex::detail {
namespace {

namespace fs = std::filesystem;

bool isFile(const fs::path& path) {
  std::error_code error;
  return fs::is_regular_file(path, error);
}

std::string lower(std::string text) {
  std::transform(text.begin(), text.end(), text.begin(), [](unsigned char c) {
    return static_cast<char>(c >= 'A' && c <= 'Z' ? c - 'A' + 'a' : c);
  });
  return text;
}

/// An entry of the folder whose name differs in case alone, the first by name; empty if none.
fs::path otherCase(const fs::path& folder, const fs::path& name, bool file) {
  constexpr int kMostEntries = 10'000;
  const std::string wanted = lower(name.string());
  fs::path best;
  std::error_code error, ignored;
  int entries = 0;
  for (fs::directory_iterator at(folder, error), end; !error && at != end; at.increment(error)) {
    if (++entries > kMostEntries) break;
    const fs::path& found = at->path();
    if (lower(found.filename().string()) != wanted) continue;
    if (file ? !isFile(found) : !fs::is_directory(found, ignored)) continue;
    if (best.empty() || found < best) best = found;
  }
  return best;
}

/// A file below the folder whose path differs in case alone; empty if none.
fs::path otherCase(fs::path folder, const fs::path& path) {
  constexpr int kMostParts = 64;
  std::error_code error;
  int parts = 0;
  for (auto at = path.begin(); at != path.end(); ++at) {
    if (++parts > kMostParts) return {};
    const bool last = std::next(at) == path.end();
    const fs::path plain = folder / *at;
    const bool there = last ? isFile(plain) : fs::is_directory(plain, error);
    folder = there ? plain : otherCase(folder, *at, last);
    if (folder.empty()) return {};
  }
  return folder;
}

}  // namespace

fs::path findFile(const fs::path& folder, std::string name) {
  if (name.size() > 1 && name.front() == '"' && name.back() == '"') {
    name = name.substr(1, name.size() - 2);
  }
  for (const std::string& text : {name, utf8Of(name)}) {
    if (isFile(folder / text)) return folder / text;
  }
  std::replace(name.begin(), name.end(), '\\', '/');
  const fs::path written = folder / name;
  const fs::path beside = folder / fs::path(name).filename();
  for (const fs::path& path : {written, beside}) {
    if (isFile(path)) return path;
  }
  for (const fs::path& path : {fs::path(name), fs::path(name).filename()}) {
    const fs::path from = folder.empty() ? fs::path(".") : folder;
    if (const fs::path other = otherCase(from, path); !other.empty()) return other;
  }
  return written;
}

int imageOfFile(Scene& scene, const fs::path& folder, const std::string& name, bool srgb,
                const std::string& where, const std::string& instead) {
  if (name.find("://") != name.npos) {
    scene.replaced.add(
        fmt::format("{}: '{:.80}' is on the network, which is not read; {}", where, name, instead));
    return kNone;
  }
  const fs::path path = findFile(folder, name);
  const std::string full = path.string();
  // Whole numbers of 16 bits are decoded as they are read, so who reads them otherwise has others.
  const std::string other = full + (srgb ? ", as colours" : ", as numbers");
  bool taken = false;
  for (std::size_t i = 0; i < scene.images.size(); ++i) {
    const Image& image = scene.images[i];
    if (image.name == other) return static_cast<int>(i);
    if (image.name != full) continue;
    const TexelKind kind = texelKind(image);
    if (kind != (srgb ? TexelKind::kWord : TexelKind::kSrgbWord)) return static_cast<int>(i);
    taken = true;
  }
  try {
    Image image =
        decodeImage(readWholeFile(path, where), where + ": " + full, srgb, scene.textures.get());
    image.name = taken ? other : full;
    noteFile(scene, path);
    return addImage(scene, std::move(image));
  } catch (const Error& e) {
    if (e.code() != ExitCode::kInput) throw;
    scene.replaced.add(fmt::format("{}; {}", e.what(), instead));
    return kNone;
  }
}

}  // namespace trex::detail
