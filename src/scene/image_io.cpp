#include "src/scene/image_io.h"

#include <fmt/ranges.h>

#include <algorithm>
#include <cctype>
#include <cstring>
#include <fstream>
#include <memory>
#include <mutex>
#include <string_view>

#include "src/core/log.h"
#include "src/core/memory.h"
#include "src/images/image_library.h"
#include "src/scene/import_detail.h"
#include "src/scene/texels.h"
#include "src/scene/texture_cache.h"

namespace trex::detail {
namespace {

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

void checkSize(const ImageFileSpec& spec, const std::string& name, std::int64_t maxSide) {
  if (spec.width < 1 || spec.height < 1 || spec.channels.empty() || spec.depth > 1 || spec.deep) {
    fail(ExitCode::kInput, "{}: not a plain two-dimensional image ({}x{}, {} channels)", name,
         spec.width, spec.height, spec.channels.size());
  }
  if (spec.width > maxSide || spec.height > maxSide ||
      std::int64_t(spec.width) * spec.height > kMaxTexels || spec.channels.size() > 1024) {
    fail(ExitCode::kInput, "{}: {}x{} with {} channels is more than this program reads", name,
         spec.width, spec.height, spec.channels.size());
  }
}

/// Where the colours of a file are: one of its parts, and their first channel there.
struct Colors {
  int part = 0, channel = 0;
  std::string layer;  ///< "ViewLayer.Combined", or empty
  int channels = 3;   ///< 1: grey
};

/// Reads `channels` channels. A short or corrupt file is an error.
void readPixels(ImageFile& file, Image& image, ImageValues as, void* target,
                const Colors& at = {}) {
  const int end = at.channel + image.channels;
  std::string error;
  if (!imageLibrary().read(file, at.part, at.channel, end, as, target, error)) {
    fail(ExitCode::kInput, "{}: broken image: {}", image.name, oneLine(error));
  }
}

ImageFileSpec specOf(ImageFile& file, int part) {
  ImageFileSpec spec;
  imageLibrary().spec(file, part, spec);
  return spec;
}

std::string lowered(std::string text) {
  std::transform(text.begin(), text.end(), text.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return text;
}

/// All runs of three channels named R, G, B, with the name of a layer before them or without.
std::vector<Colors> findColors(ImageFile& file) {
  std::vector<Colors> found;
  ImageFileSpec spec;
  for (int part = 0; imageLibrary().spec(file, part, spec); ++part) {
    const std::vector<std::string>& names = spec.channels;
    for (std::size_t c = 0; c + 2 < names.size(); ++c) {
      if (names[c].empty() || std::toupper(static_cast<unsigned char>(names[c].back())) != 'R') {
        continue;
      }
      const std::string layer = names[c].substr(0, names[c].size() - 1);
      if (!layer.empty() && layer.back() != '.') continue;
      const bool run = lowered(names[c + 1]) == lowered(layer) + "g" &&
                       lowered(names[c + 2]) == lowered(layer) + "b";
      if (run) found.push_back({part, static_cast<int>(c), layer.substr(0, layer.rfind('.'))});
    }
  }
  return found;
}

/// The picture itself before any layer; of layers the one with all light, or else the first.
Colors chooseColors(ImageFile& file, const std::string& name) {
  const std::vector<Colors> found = findColors(file);
  if (found.empty()) {
    const std::vector<std::string> names = specOf(file, 0).channels;
    if (names.size() == 1 && (names[0] == "Y" || names[0] == "I")) return {0, 0, {}, 1};
    fail(ExitCode::kInput, "{}: no channels R, G, B in any part of it; its first has {}", name,
         fmt::join(names, ", "));
  }
  const auto best = [&](const auto& wanted) {
    return std::find_if(found.begin(), found.end(), wanted);
  };
  auto at = best([](const Colors& c) { return c.layer.empty(); });
  if (at != found.end()) return *at;
  at = best([](const Colors& c) {
    const std::string layer = lowered(c.layer);
    return layer.ends_with("combined") || layer.ends_with("beauty");
  });
  if (at != found.end()) return *at;
  if (found.size() > 1) {
    logWarning("{}: has {} layers of colours, of which '{}' is taken", name, found.size(),
               found.front().layer);
  }
  return found.front();
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

/// Before it is allocated.
void checkRoom(std::uint64_t bytes, const std::string& name, const TextureCache* textures) {
  const std::uint64_t left = leftBytes(textures != nullptr ? textures->maxMemory() : 0);
  if (bytes <= left) return;
  fail(ExitCode::kMemoryOrDevice,
       "{}: the image needs {} to be decoded, {} are left; make --max-memory larger, or the image "
       "smaller",
       name, formatBytes(bytes), formatBytes(left));
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
  const std::lock_guard lock(imageDecoding());
  const std::string fileName = std::string("image") + extensionOf(file);
  std::string error;
  const OpenImageFile input(imageLibrary().openMemory(file, fileName, error));
  if (!input) {
    fail(ExitCode::kInput, "{}: not an image that can be decoded: {}", name, oneLine(error));
  }
  const ImageFileSpec spec = specOf(*input, 0);
  checkSize(spec, name, 1 << 16);
  Image image;
  image.name = name;
  image.width = spec.width;
  image.height = spec.height;
  image.channels = std::min(static_cast<int>(spec.channels.size()), 4);
  const TexelKind kind = kindOf(spec, srgb);
  checkRoom(texelBytes(image, kind), name, textures);
  readPixels(*input, image, spec.values, makeTexels(image, kind).data());
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

Image readFloatImage(const std::filesystem::path& path, int maxWidth) {
  const std::string name = path.string();
  const std::lock_guard lock(imageDecoding());
  std::string error;
  const OpenImageFile input(imageLibrary().open(name, "", false, error));
  if (!input) {
    fail(ExitCode::kInput, "{}: not an image that can be decoded: {}", name, oneLine(error));
  }
  const Colors at = chooseColors(*input, name);
  const ImageFileSpec spec = specOf(*input, at.part);
  checkSize(spec, name, maxWidth);
  if (spec.cropped()) {
    fail(ExitCode::kInput, "{}: its data and display windows differ; write it uncropped", name);
  }
  Image image;
  image.name = name;
  image.width = spec.width;
  image.height = spec.height;
  image.channels = at.channels;
  const std::size_t texels = std::size_t(spec.width) * spec.height;
  image.floats.resize(texels * image.channels);
  readPixels(*input, image, ImageValues::kFloat, image.floats.data(), at);
  if (image.channels == 1) {
    std::vector<float> rgb(texels * 3);
    for (std::size_t i = 0; i < texels * 3; ++i) rgb[i] = image.floats[i / 3];
    image.floats = std::move(rgb);
    image.channels = 3;
  }
  return image;
}

}  // namespace trex::detail
