#include "src/scene/image_io.h"

#include <OpenImageIO/filesystem.h>
#include <OpenImageIO/imageio.h>

#include <algorithm>
#include <cstring>
#include <fstream>
#include <mutex>
#include <string_view>

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

/// Reads the first `channels` channels. A short or corrupt file is an error.
void readPixels(OIIO::ImageInput& input, Image& image, OIIO::TypeDesc type, void* target) {
  if (!input.read_image(0, 0, 0, image.channels, type, target)) {
    fail(ExitCode::kInput, "{}: broken image: {}", image.name, oneLine(input.geterror()));
  }
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
  const OIIO::ImageSpec& spec = input->spec();
  checkSize(spec, name, maxWidth);
  Image image;
  image.name = name;
  image.width = spec.width;
  image.height = spec.height;
  image.channels = spec.nchannels >= 3 ? 3 : 1;
  const std::size_t texels = std::size_t(spec.width) * spec.height;
  image.floats.resize(texels * image.channels);
  readPixels(*input, image, OIIO::TypeDesc::FLOAT, image.floats.data());
  if (image.channels == 1) {
    std::vector<float> rgb(texels * 3);
    for (std::size_t i = 0; i < texels * 3; ++i) rgb[i] = image.floats[i / 3];
    image.floats = std::move(rgb);
    image.channels = 3;
  }
  return image;
}

}  // namespace trex::detail
