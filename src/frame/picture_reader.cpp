#include "src/frame/picture_reader.h"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <mutex>
#include <set>

#include "src/core/error.h"
#include "src/core/memory.h"
#include "src/images/image_library.h"

namespace trex {
namespace fs = std::filesystem;
namespace {

constexpr int kLargestSide = 65536;
constexpr std::size_t kMostChannels = 1024;
constexpr std::uint64_t kMostBytes = std::uint64_t{1} << 35;
constexpr int kBandRows = 64;

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

OpenImageFile openInput(const fs::path& path) {
  const char* format = formatOf(path);
  checkFile(path);
  std::string error;
  OpenImageFile input(imageLibrary().open(path.string(), format, true, error));
  if (!input) {
    fail(ExitCode::kInput, "{}: not a picture that can be read: {}", path.string(), oneLine(error));
  }
  return input;
}

void checkSpec(const ImageFileSpec& spec, const std::string& name) {
  if (spec.width < 1 || spec.height < 1 || spec.channels.empty() || spec.depth > 1 || spec.deep) {
    fail(ExitCode::kInput, "{}: not a plain two-dimensional picture", name);
  }
  if (spec.width > kLargestSide || spec.height > kLargestSide ||
      spec.channels.size() > kMostChannels) {
    fail(ExitCode::kInput, "{}: {}x{} with {} channels is more than this program reads", name,
         spec.width, spec.height, spec.channels.size());
  }
  if (spec.cropped()) {
    fail(ExitCode::kInput, "{}: its data and display windows differ; write it uncropped", name);
  }
  const std::uint64_t bytes =
      std::uint64_t(spec.width) * spec.height * spec.channels.size() * sizeof(float);
  if (bytes > kMostBytes) {
    fail(ExitCode::kInput, "{}: {} of pixels is more than this program reads", name,
         formatBytes(bytes));
  }
  if (bytes > availableMemoryLimit()) {
    fail(ExitCode::kMemoryOrDevice, "{}: its pixels need {}, more than the memory of this machine",
         name, formatBytes(bytes));
  }
  if (std::set<std::string>(spec.channels.begin(), spec.channels.end()).size() !=
      spec.channels.size()) {
    fail(ExitCode::kInput, "{}: two channels have one name", name);
  }
}

/// Rows by bands, so that a file cut short is noticed before all of its memory is touched.
void readRows(ImageFile& input, const ImageFileSpec& spec, const std::string& name,
              Picture& picture) {
  const int band = spec.tileHeight > 0 ? spec.tileHeight : kBandRows;
  const std::size_t rowValues = std::size_t(spec.width) * spec.channels.size();
  picture.values.reserve(rowValues * spec.height);
  for (int y = 0; y < spec.height; y += band) {
    const int end = std::min(spec.height, y + band);
    picture.values.resize(rowValues * end);
    float* rows = picture.values.data() + rowValues * y;
    std::string error;
    if (!imageLibrary().readRows(input, y, end, rows, error)) {
      fail(ExitCode::kInput, "{}: broken picture: {}", name, oneLine(error));
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
  const std::lock_guard lock(imageDecoding());
  const std::string name = path.string();
  const OpenImageFile input = openInput(path);
  ImageFileSpec spec;
  imageLibrary().spec(*input, 0, spec);
  checkSpec(spec, name);
  Picture picture;
  picture.width = static_cast<std::uint32_t>(spec.width);
  picture.height = static_cast<std::uint32_t>(spec.height);
  picture.channels = spec.channels;
  for (const auto& [key, text] : spec.texts) {
    if (key.starts_with("trex:")) picture.metadata.emplace_back(key, text);
  }
  readRows(*input, spec, name, picture);
  if (!spec.floats) decodeColors(picture);
  spreadGrey(picture);
  return picture;
}

std::string metadataOf(const Picture& picture, const std::string& key) {
  for (const auto& [name, value] : picture.metadata) {
    if (name == key) return value;
  }
  return "";
}

bool isDenoised(const Picture& picture) {
  const std::string by = metadataOf(picture, "trex:denoised");
  return !by.empty() && by != "no" && by != "none";
}

int channelIndex(const Picture& picture, const std::string& name) {
  const auto at = std::find(picture.channels.begin(), picture.channels.end(), name);
  return at == picture.channels.end() ? -1 : static_cast<int>(at - picture.channels.begin());
}

}  // namespace trex
