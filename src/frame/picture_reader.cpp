#include "src/frame/picture_reader.h"

#include <OpenImageIO/imageio.h>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <memory>
#include <mutex>
#include <set>

#include "src/core/error.h"
#include "src/core/memory.h"

namespace trex {
namespace fs = std::filesystem;
namespace {

constexpr int kLargestSide = 65536;
constexpr int kMostChannels = 1024;
constexpr std::uint64_t kMostBytes = std::uint64_t{1} << 35;
constexpr int kBandRows = 64;

/// Decoding from several threads at once crashed now and then with OpenImageIO 2.4.7.
std::mutex decodeMutex;

/// OpenImageIO's name of the format; a reader chosen by the content would be a wider door.
const char* formatOf(const fs::path& path) {
  std::string extension = path.extension().string();
  std::transform(extension.begin(), extension.end(), extension.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  if (extension == ".exr") return "openexr";
  if (extension == ".png") return "png";
  if (extension == ".jpg" || extension == ".jpeg") return "jpeg";
  if (extension == ".hdr") return "hdr";
  fail(ExitCode::kInput, "{}: unknown picture format; use .exr, .png, .jpg or .hdr", path.string());
}

void checkFile(const fs::path& path) {
  std::error_code error;
  const fs::file_status status = fs::status(path, error);
  if (!fs::exists(status)) fail(ExitCode::kInput, "{}: no such file", path.string());
  if (!fs::is_regular_file(status)) fail(ExitCode::kInput, "{}: not a plain file", path.string());
}

std::unique_ptr<OIIO::ImageInput> openInput(const fs::path& path) {
  const char* format = formatOf(path);
  checkFile(path);
  OIIO::attribute("threads", 1);
  std::unique_ptr<OIIO::ImageInput> input = OIIO::ImageInput::create(format);
  if (!input) fail(ExitCode::kFailed, "OpenImageIO can't read {}: {}", format, OIIO::geterror());
  OIIO::ImageSpec config, spec;
  config["oiio:UnassociatedAlpha"] = 1;  // else colour comes multiplied by alpha
  if (!input->open(path.string(), spec, config)) {
    fail(ExitCode::kInput, "{}: not a picture that can be read: {}", path.string(),
         oneLine(input->geterror()));
  }
  return input;
}

void checkSpec(const OIIO::ImageSpec& spec, const std::string& name) {
  if (spec.width < 1 || spec.height < 1 || spec.nchannels < 1 || spec.depth > 1 || spec.deep) {
    fail(ExitCode::kInput, "{}: not a plain two-dimensional picture", name);
  }
  if (spec.width > kLargestSide || spec.height > kLargestSide || spec.nchannels > kMostChannels) {
    fail(ExitCode::kInput, "{}: {}x{} with {} channels is more than this program reads", name,
         spec.width, spec.height, spec.nchannels);
  }
  if (spec.x != spec.full_x || spec.y != spec.full_y || spec.width != spec.full_width ||
      spec.height != spec.full_height) {
    fail(ExitCode::kInput, "{}: its data and display windows differ; write it uncropped", name);
  }
  const std::uint64_t bytes =
      std::uint64_t(spec.width) * spec.height * spec.nchannels * sizeof(float);
  if (bytes > kMostBytes) {
    fail(ExitCode::kInput, "{}: {} of pixels is more than this program reads", name,
         formatBytes(bytes));
  }
  if (bytes > availableMemoryLimit()) {
    fail(ExitCode::kMemoryOrDevice, "{}: its pixels need {}, more than the memory of this machine",
         name, formatBytes(bytes));
  }
  if (std::set<std::string>(spec.channelnames.begin(), spec.channelnames.end()).size() !=
      static_cast<std::size_t>(spec.nchannels)) {
    fail(ExitCode::kInput, "{}: two channels have one name", name);
  }
}

/// Rows by bands, so that a file cut short is noticed before all of its memory is touched.
void readRows(OIIO::ImageInput& input, const std::string& name, Picture& picture) {
  const OIIO::ImageSpec spec = input.spec();
  const bool tiled = spec.tile_width > 0;
  const int band = tiled ? spec.tile_height : kBandRows;
  const std::size_t rowValues = std::size_t(spec.width) * spec.nchannels;
  picture.values.reserve(rowValues * spec.height);
  for (int y = 0; y < spec.height; y += band) {
    const int end = std::min(spec.height, y + band);
    picture.values.resize(rowValues * end);
    float* rows = picture.values.data() + rowValues * y;
    const int x0 = spec.x, x1 = spec.x + spec.width, y0 = spec.y + y, y1 = spec.y + end;
    const bool good = tiled ? input.read_tiles(0, 0, x0, x1, y0, y1, 0, 1, 0, spec.nchannels,
                                               OIIO::TypeDesc::FLOAT, rows)
                            : input.read_scanlines(0, 0, y0, y1, 0, 0, spec.nchannels,
                                                   OIIO::TypeDesc::FLOAT, rows);
    if (!good) {
      fail(ExitCode::kInput, "{}: broken picture: {}", name, oneLine(input.geterror()));
    }
  }
}

void decodeColors(Picture& picture) {
  const std::size_t stride = picture.channels.size();
  for (std::size_t c = 0; c < stride; ++c) {
    if (picture.channels[c] == "A") continue;
    for (std::size_t i = c; i < picture.values.size(); i += stride) {
      picture.values[i] = decodeSrgb(picture.values[i]);
    }
  }
}

void spreadGrey(Picture& picture) {
  const std::string& name = picture.channels.front();
  if (picture.channels.size() != 1 || (name != "Y" && name != "I")) return;
  std::vector<float> colors;
  colors.reserve(picture.values.size() * 3);
  for (float v : picture.values) colors.insert(colors.end(), {v, v, v});
  picture.values = std::move(colors);
  picture.channels = {"R", "G", "B"};
}

}  // namespace

Picture readPicture(const fs::path& path) {
  const std::lock_guard lock(decodeMutex);
  const std::string name = path.string();
  const std::unique_ptr<OIIO::ImageInput> input = openInput(path);
  const OIIO::ImageSpec spec = input->spec();
  checkSpec(spec, name);
  Picture picture;
  picture.width = static_cast<std::uint32_t>(spec.width);
  picture.height = static_cast<std::uint32_t>(spec.height);
  picture.channels = spec.channelnames;
  for (const OIIO::ParamValue& attribute : spec.extra_attribs) {
    const std::string key = attribute.name().string();
    if (key.starts_with("trex:")) picture.metadata.emplace_back(key, attribute.get_string());
  }
  readRows(*input, name, picture);
  if (!spec.format.is_floating_point()) decodeColors(picture);
  spreadGrey(picture);
  return picture;
}

int channelIndex(const Picture& picture, const std::string& name) {
  const auto at = std::find(picture.channels.begin(), picture.channels.end(), name);
  return at == picture.channels.end() ? -1 : static_cast<int>(at - picture.channels.begin());
}

}  // namespace trex
