#include "src/images/images.h"

#include <OpenImageIO/filesystem.h>
#include <OpenImageIO/imageio.h>

#include <memory>
#include <optional>

namespace trex {

struct ImageFile {
  std::optional<OIIO::Filesystem::IOMemReader> memory;
  std::unique_ptr<OIIO::ImageInput> input;
};

namespace {

OIIO::TypeDesc typeOf(ImageValues values) {
  switch (values) {
    case ImageValues::kByte:
      return OIIO::TypeDesc::UINT8;
    case ImageValues::kWord:
      return OIIO::TypeDesc::UINT16;
    case ImageValues::kHalf:
      return OIIO::TypeDesc::HALF;
    case ImageValues::kFloat:
      break;
  }
  return OIIO::TypeDesc::FLOAT;
}

ImageValues valuesOf(OIIO::TypeDesc type) {
  for (const ImageValues v : {ImageValues::kByte, ImageValues::kWord, ImageValues::kHalf}) {
    if (type == typeOf(v)) return v;
  }
  return ImageValues::kFloat;
}

/// Colour comes multiplied by alpha else.
OIIO::ImageSpec alphaApart() {
  OIIO::ImageSpec config;
  config["oiio:UnassociatedAlpha"] = 1;
  return config;
}

ImageFile* open(const std::string& path, const std::string& format, bool apart,
                std::string& error) {
  auto file = std::make_unique<ImageFile>();
  if (format.empty()) {
    const OIIO::ImageSpec config = apart ? alphaApart() : OIIO::ImageSpec();
    file->input = OIIO::ImageInput::open(path, &config);
    if (!file->input) error = OIIO::geterror();
    return file->input ? file.release() : nullptr;
  }
  OIIO::attribute("threads", 1);
  file->input = OIIO::ImageInput::create(format);
  if (!file->input) {
    error = OIIO::geterror();
    return nullptr;
  }
  OIIO::ImageSpec spec;
  if (file->input->open(path, spec, apart ? alphaApart() : OIIO::ImageSpec())) {
    return file.release();
  }
  error = file->input->geterror();
  return nullptr;
}

ImageFile* openMemory(std::span<const std::uint8_t> bytes, const std::string& name,
                      std::string& error) {
  auto file = std::make_unique<ImageFile>();
  file->memory.emplace(const_cast<std::uint8_t*>(bytes.data()), bytes.size());
  OIIO::ImageSpec config = alphaApart();
  OIIO::Filesystem::IOProxy* proxy = &*file->memory;
  config.attribute("oiio:ioproxy", OIIO::TypeDesc::PTR, &proxy);
  file->input = OIIO::ImageInput::open(name, &config, proxy);
  if (file->input) return file.release();
  error = OIIO::geterror();
  return nullptr;
}

void close(ImageFile* file) { delete file; }

bool spec(ImageFile& file, int part, ImageFileSpec& out) {
  if (!file.input->seek_subimage(part, 0)) return false;
  const OIIO::ImageSpec& s = file.input->spec();
  out = {.width = s.width,
         .height = s.height,
         .depth = s.depth,
         .x = s.x,
         .y = s.y,
         .fullX = s.full_x,
         .fullY = s.full_y,
         .fullWidth = s.full_width,
         .fullHeight = s.full_height,
         .tileHeight = s.tile_width > 0 ? s.tile_height : 0,
         .deep = s.deep,
         .windowed = std::string_view(file.input->format_name()) == "openexr",
         .values = valuesOf(s.format),
         .floats = s.format.is_floating_point(),
         .channels = s.channelnames,
         .texts = {}};
  out.channels.resize(static_cast<std::size_t>(std::max(s.nchannels, 0)));
  for (const OIIO::ParamValue& attribute : s.extra_attribs) {
    out.texts.emplace_back(attribute.name().string(), attribute.get_string());
  }
  return true;
}

bool read(ImageFile& file, int part, int begin, int end, ImageValues as, void* to,
          std::string& error) {
  const bool good = file.input->read_image(part, 0, begin, end, typeOf(as), to);
  if (!good) error = file.input->geterror();
  return good;
}

bool readRows(ImageFile& file, int begin, int end, float* to, std::string& error) {
  OIIO::ImageInput& input = *file.input;
  const OIIO::ImageSpec s = input.spec();
  const int x0 = s.x, x1 = s.x + s.width, y0 = s.y + begin, y1 = s.y + end;
  const OIIO::TypeDesc type = OIIO::TypeDesc::FLOAT;
  const bool good = s.tile_width > 0
                        ? input.read_tiles(0, 0, x0, x1, y0, y1, 0, 1, 0, s.nchannels, type, to)
                        : input.read_scanlines(0, 0, y0, y1, 0, 0, s.nchannels, type, to);
  if (!good) error = input.geterror();
  return good;
}

OIIO::ImageSpec specOf(const ImageToWrite& image) {
  OIIO::ImageSpec spec(image.width, image.height, static_cast<int>(image.channels.size()),
                       typeOf(image.values));
  spec.channelnames = image.channels;
  if (image.values == ImageValues::kFloat) {
    spec.attribute("compression", "zip");
    spec.attribute("DateTime", "1970:01:01 00:00:00");  // equal renders make equal files
    spec.attribute("oiio:ColorSpace", "linear");
    if (!image.chromaticities.empty()) {
      spec.attribute("chromaticities", OIIO::TypeDesc(OIIO::TypeDesc::FLOAT, 8),
                     image.chromaticities.data());
    }
  } else {
    spec.attribute("oiio:ColorSpace", "sRGB");
  }
  if (image.jpegQuality > 0) {
    spec.attribute("Compression", "jpeg:" + std::to_string(image.jpegQuality));
    spec.attribute("jpeg:subsampling", "4:4:4");
  }
  for (const auto& [key, value] : image.texts) spec.attribute(key, value);
  return spec;
}

bool write(const std::string& path, const ImageToWrite& image, std::string& error) {
  const std::unique_ptr<OIIO::ImageOutput> out = OIIO::ImageOutput::create(path);
  if (!out) {
    error = OIIO::geterror();
    return false;
  }
  const bool good = out->open(path, specOf(image)) &&
                    out->write_image(typeOf(image.values), image.data) && out->close();
  if (!good) error = "can't be written: " + out->geterror();
  return good;
}

}  // namespace

const ImageFunctions* trexImageFunctions() {
  static const ImageFunctions all{
      OIIO::openimageio_version(), open, openMemory, close, spec, read, readRows, write};
  return &all;
}

}  // namespace trex
