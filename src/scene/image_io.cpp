#include "src/scene/image_io.h"

#include <algorithm>
#include <cstring>
#include <fstream>
#include <memory>
#include <mutex>
#include <string_view>

#include "src/images/image_library.h"
#include "src/scene/image_parts.h"
#include "src/scene/import_detail.h"
#include "src/scene/input_file.h"
#include "src/scene/rgbe.h"
#include "src/scene/texels.h"
#include "src/scene/texture_cache.h"

namespace trex::detail {
namespace {

constexpr std::int64_t kMostSide = 1 << 16;

/// OpenImageIO chooses its reader by extension; names in glTF files need not have one.
const char* extensionOf(std::span<const std::uint8_t> file) {
  const auto starts = [&](std::string_view magic, std::size_t offset = 0) {
    return file.size() >= offset + magic.size() &&
           std::memcmp(file.data() + offset, magic.data(), magic.size()) == 0;
  };
  if (starts("\x89PNG")) return ".png";
  if (starts("\xff\xd8")) return ".jpg";
  if (starts("RIFF") && starts("WEBP", 8)) return ".webp";
  if (starts("BM")) return ".bmp";
  if (starts("GIF8")) return ".gif";
  if (starts("#?")) return ".hdr";
  if (starts("\x76\x2f\x31\x01")) return ".exr";
  if (starts("II*") || starts("MM")) return ".tif";
  if (starts("DDS ")) return ".dds";
  if (starts("PF") || starts("Pf")) return ".pfm";
  return ".tga";
}

/// What is not finite becomes 0.
void sanitise(Image& image) {
  for (float& f : image.floats) {
    if (!std::isfinite(f)) f = 0.0f;
  }
  if (image.wordKind != TexelKind::kHalf) return;
  for (std::uint16_t& half : image.words) {
    if (!isFiniteHalf(half)) half = 0;
  }
}

TexelKind kindOf(const ImageFileSpec& spec, bool srgb) {
  switch (spec.values) {
    case ImageValues::kByte:
      return TexelKind::kByte;
    case ImageValues::kWord:
      return srgb ? TexelKind::kSrgbWord : TexelKind::kWord;
    case ImageValues::kHalf:
      return TexelKind::kHalf;
    case ImageValues::kFloat:
      break;
  }
  return TexelKind::kFloat;
}

}  // namespace

std::vector<std::uint8_t> readWholeFile(const std::filesystem::path& path, const std::string& what,
                                        std::uint64_t limit) {
  std::error_code error;
  const auto status = std::filesystem::status(path, error);
  if (!std::filesystem::exists(status)) {
    fail(ExitCode::kInput, "{}: no such file: {}", what, path.string());
  }
  if (!std::filesystem::is_regular_file(status)) {
    fail(ExitCode::kInput, "{}: not a plain file: {}", what, path.string());
  }
  const std::uint64_t size = std::filesystem::file_size(path, error);
  if (error || size > limit) {
    fail(ExitCode::kInput, "{}: {} has {} bytes, more than this program reads ({})", what,
         path.string(), size, limit);
  }
  std::vector<std::uint8_t> bytes(size);
  std::ifstream stream(path, std::ios::binary);
  stream.read(reinterpret_cast<char*>(bytes.data()), static_cast<std::streamsize>(size));
  if (!stream) fail(ExitCode::kInput, "{}: can't read {}", what, path.string());
  return bytes;
}

Image decodeImage(std::span<const std::uint8_t> file, const std::string& name, bool srgb,
                  const TextureCache* textures) {
  if (file.empty()) fail(ExitCode::kInput, "{}: the image is empty", name);
  const std::uint64_t maxMemory = textures != nullptr ? textures->maxMemory() : 0;
  if (isRgbe(file)) return readRgbe(file, name, kMostSide, maxMemory);
  const std::lock_guard lock(imageDecoding());
  const std::string fileName = std::string("image") + extensionOf(file);
  std::string error;
  const OpenImageFile input(imageLibrary().openMemory(file, fileName, error));
  if (!input) {
    fail(ExitCode::kInput, "{}: not an image that can be decoded: {}", name,
         utf8Of(oneLine(error)));
  }
  Colors at;
  at.channels = std::min(static_cast<int>(specOf(*input, 0).channels.size()), 4);
  if (specOf(*input, 0).windowed) at = findColors(*input, name, true).value_or(at);
  const ImageFileSpec spec = specOf(*input, at.part);
  checkSize(spec, name, kMostSide);
  Image image;
  image.name = name;
  setSize(spec, image);
  image.channels = at.channels;
  const TexelKind kind = kindOf(spec, srgb);
  checkRoom(texelBytes(image, kind), name, maxMemory);
  readWindow(*input, at, spec, spec.values, name, makeTexels(image, kind).data());
  sanitise(image);
  // Of more than 16 bits, no floats.
  if (srgb && !spec.floats && kind == TexelKind::kFloat) {
    const int colors = image.channels == 2 ? 1 : std::min(image.channels, 3);
    for (std::size_t i = 0; i < image.floats.size(); ++i) {
      if (static_cast<int>(i % image.channels) < colors) {
        image.floats[i] = decodeSrgb(image.floats[i]);
      }
    }
  }
  return image;
}

}  // namespace trex::detail
