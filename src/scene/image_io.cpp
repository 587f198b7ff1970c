#include "src/scene/image_io.h"

#include <OpenImageIO/filesystem.h>
#include <OpenImageIO/imageio.h>
#include <OpenImageIO/strutil.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cctype>
#include <cstring>
#include <fstream>
#include <mutex>
#include <string_view>

#include "src/core/log.h"
#include "src/scene/import_detail.h"

namespace trex::detail {
namespace {

/// Decoding from several threads at once crashed now and then with OpenImageIO 2.4.7.
std::mutex decodeMutex;

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

void checkSize(const OIIO::ImageSpec& spec, const std::string& name, std::int64_t maxSide) {
  if (spec.width < 1 || spec.height < 1 || spec.nchannels < 1 || spec.depth > 1 || spec.deep) {
    fail(ExitCode::kInput, "{}: not a plain two-dimensional image ({}x{}, {} channels)", name,
         spec.width, spec.height, spec.nchannels);
  }
  if (spec.width > maxSide || spec.height > maxSide ||
      std::int64_t(spec.width) * spec.height > kMaxTexels || spec.nchannels > 1024) {
    fail(ExitCode::kInput, "{}: {}x{} with {} channels is more than this program reads", name,
         spec.width, spec.height, spec.nchannels);
  }
}

/// Where the colours of a file are: one of its parts, and their first channel there.
struct Colors {
  int part = 0, channel = 0;
  std::string layer;  ///< "ViewLayer.Combined", or empty
  int channels = 3;   ///< 1: grey
};

/// Reads `channels` channels. A short or corrupt file is an error.
void readPixels(OIIO::ImageInput& input, Image& image, OIIO::TypeDesc type, void* target,
                const Colors& at = {}) {
  const int end = at.channel + image.channels;
  if (!input.read_image(at.part, 0, at.channel, end, type, target)) {
    fail(ExitCode::kInput, "{}: broken image: {}", image.name, oneLine(input.geterror()));
  }
}

/// All runs of three channels named R, G, B, with the name of a layer before them or without.
std::vector<Colors> findColors(OIIO::ImageInput& input) {
  std::vector<Colors> found;
  for (int part = 0; input.seek_subimage(part, 0); ++part) {
    const std::vector<std::string> names = input.spec(part).channelnames;
    for (std::size_t c = 0; c + 2 < names.size(); ++c) {
      if (names[c].empty() || std::toupper(static_cast<unsigned char>(names[c].back())) != 'R') {
        continue;
      }
      const std::string layer = names[c].substr(0, names[c].size() - 1);
      if (!layer.empty() && layer.back() != '.') continue;
      const bool run = OIIO::Strutil::iequals(names[c + 1], layer + "G") &&
                       OIIO::Strutil::iequals(names[c + 2], layer + "B");
      if (run) found.push_back({part, static_cast<int>(c), layer.substr(0, layer.rfind('.'))});
    }
  }
  return found;
}

/// The picture itself before any layer; of layers the one with all light, or else the first.
Colors chooseColors(OIIO::ImageInput& input, const std::string& name) {
  const std::vector<Colors> found = findColors(input);
  if (found.empty()) {
    const std::vector<std::string> names = input.spec(0).channelnames;
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
    return OIIO::Strutil::iends_with(c.layer, "combined") ||
           OIIO::Strutil::iends_with(c.layer, "beauty");
  });
  if (at != found.end()) return *at;
  if (found.size() > 1) {
    logWarning("{}: has {} layers of colours, of which '{}' is taken", name, found.size(),
               found.front().layer);
  }
  return found.front();
}

void sanitiseFloats(Image& image) {
  for (float& f : image.floats) {
    if (!std::isfinite(f)) f = 0.0f;
  }
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

Image decodeImage(std::span<const std::uint8_t> file, const std::string& name, bool srgb) {
  if (file.empty()) fail(ExitCode::kInput, "{}: the image is empty", name);
  const std::lock_guard lock(decodeMutex);
  OIIO::Filesystem::IOMemReader reader(const_cast<std::uint8_t*>(file.data()), file.size());
  OIIO::ImageSpec config;
  config["oiio:UnassociatedAlpha"] = 1;  // else colour comes multiplied by alpha
  OIIO::Filesystem::IOProxy* proxy = &reader;
  config.attribute("oiio:ioproxy", OIIO::TypeDesc::PTR, &proxy);
  const std::string fileName = std::string("image") + extensionOf(file);
  const auto input = OIIO::ImageInput::open(fileName, &config, proxy);
  if (!input) {
    fail(ExitCode::kInput, "{}: not an image that can be decoded: {}", name,
         oneLine(OIIO::geterror()));
  }
  const OIIO::ImageSpec& spec = input->spec();
  checkSize(spec, name, 1 << 16);
  Image image;
  image.name = name;
  image.width = spec.width;
  image.height = spec.height;
  image.channels = std::min(spec.nchannels, 4);
  const std::size_t count = std::size_t(spec.width) * spec.height * image.channels;
  if (spec.format == OIIO::TypeDesc::UINT8) {
    image.bytes.resize(count);
    readPixels(*input, image, OIIO::TypeDesc::UINT8, image.bytes.data());
    return image;
  }
  image.floats.resize(count);
  readPixels(*input, image, OIIO::TypeDesc::FLOAT, image.floats.data());
  sanitiseFloats(image);
  if (srgb && !spec.format.is_floating_point()) {
    const int colors = image.channels == 2 ? 1 : std::min(image.channels, 3);
    for (std::size_t i = 0; i < count; ++i) {
      if (static_cast<int>(i % image.channels) < colors) {
        image.floats[i] = decodeSrgb(image.floats[i]);
      }
    }
  }
  return image;
}

Image readFloatImage(const std::filesystem::path& path, int maxWidth) {
  const std::string name = path.string();
  const std::lock_guard lock(decodeMutex);
  const auto input = OIIO::ImageInput::open(name);
  if (!input) {
    fail(ExitCode::kInput, "{}: not an image that can be decoded: {}", name,
         oneLine(OIIO::geterror()));
  }
  const Colors at = chooseColors(*input, name);
  input->seek_subimage(at.part, 0);
  const OIIO::ImageSpec& spec = input->spec();
  checkSize(spec, name, maxWidth);
  if (spec.x != spec.full_x || spec.y != spec.full_y || spec.width != spec.full_width ||
      spec.height != spec.full_height) {
    fail(ExitCode::kInput, "{}: its data and display windows differ; write it uncropped", name);
  }
  Image image;
  image.name = name;
  image.width = spec.width;
  image.height = spec.height;
  image.channels = at.channels;
  const std::size_t texels = std::size_t(spec.width) * spec.height;
  image.floats.resize(texels * image.channels);
  readPixels(*input, image, OIIO::TypeDesc::FLOAT, image.floats.data(), at);
  if (image.channels == 1) {
    std::vector<float> rgb(texels * 3);
    for (std::size_t i = 0; i < texels * 3; ++i) rgb[i] = image.floats[i / 3];
    image.floats = std::move(rgb);
    image.channels = 3;
  }
  return image;
}

}  // namespace trex::detail
