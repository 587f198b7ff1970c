#include "src/scene/image_parts.h"

#include <algorithm>
#include <cctype>
#include <cstring>
#include <vector>

#include "src/core/error.h"
#include "src/core/log.h"
#include "src/core/memory.h"
#include "src/scene/image_io.h"
#include "src/scene/import_detail.h"
#include "src/scene/input_file.h"

namespace trex::detail {
namespace {

std::string lowered(std::string text) {
  std::transform(text.begin(), text.end(), text.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return text;
}

/// A channel's layer with its point, and what it is there: "r" of R and of red.
std::pair<std::string, std::string> partsOf(const std::string& channel) {
  const std::size_t point = channel.rfind('.') + 1;
  std::string own = lowered(channel.substr(point));
  for (const auto& [word, letter] : {std::pair("red", "r"), std::pair("green", "g"),
                                     std::pair("blue", "b"), std::pair("alpha", "a")}) {
    if (own == word) own = letter;
  }
  return {lowered(channel.substr(0, point)), own};
}

/// All runs of three channels named R, G, B, with the name of a layer before them or without.
std::vector<Colors> findRuns(ImageFile& file) {
  std::vector<Colors> found;
  ImageFileSpec spec;
  for (int part = 0; imageLibrary().spec(file, part, spec); ++part) {
    const std::vector<std::string>& names = spec.channels;
    for (std::size_t c = 0; c + 2 < names.size(); ++c) {
      const auto [layer, own] = partsOf(names[c]);
      if (own != "r" || partsOf(names[c + 1]) != std::pair(layer, std::string("g")) ||
          partsOf(names[c + 2]) != std::pair(layer, std::string("b"))) {
        continue;
      }
      const bool alpha =
          c + 3 < names.size() && partsOf(names[c + 3]) == std::pair(layer, std::string("a"));
      const std::size_t point = names[c].rfind('.');
      found.push_back({part, static_cast<int>(c),
                       point == std::string::npos ? std::string() : names[c].substr(0, point),
                       alpha ? 4 : 3});
    }
  }
  return found;
}

/// Brightness alone, with alpha or without; nothing where colours lie beside it at half the size.
std::optional<Colors> findGrey(ImageFile& file) {
  const std::vector<std::string> names = specOf(file, 0).channels;
  if (names.empty() || names.size() > 2) return {};
  for (std::size_t c = 0; c < names.size(); ++c) {
    const std::string own = partsOf(names[c]).second;
    const bool alone = names.size() == 1 || partsOf(names[1 - c]).second == "a";
    if (alone && (own == "y" || own == "i" || own == "l")) {
      return Colors{0, static_cast<int>(c), {}, 1};
    }
  }
  return {};
}

Colors chosen(const std::vector<Colors>& found, const std::string& name) {
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
               utf8Of(oneLine(found.front().layer)));
  }
  return found.front();
}

/// Copies what both windows have; the first is the data's.
void copyShared(const ImageFileSpec& spec, std::size_t texelBytes, const std::byte* from,
                std::byte* to) {
  const int left = std::max(spec.x, spec.fullX), top = std::max(spec.y, spec.fullY);
  const int right = std::min(spec.x + spec.width, spec.fullX + spec.fullWidth);
  const int bottom = std::min(spec.y + spec.height, spec.fullY + spec.fullHeight);
  if (left >= right) return;
  for (int y = top; y < bottom; ++y) {
    const auto at = [&](int x0, int y0, int width) {
      return (std::size_t(y - y0) * width + std::size_t(left - x0)) * texelBytes;
    };
    std::memcpy(to + at(spec.fullX, spec.fullY, spec.fullWidth),
                from + at(spec.x, spec.y, spec.width), std::size_t(right - left) * texelBytes);
  }
}

std::size_t sizeOfValue(ImageValues values) {
  return values == ImageValues::kByte ? 1 : values == ImageValues::kFloat ? 4 : 2;
}

}  // namespace

ImageFileSpec specOf(ImageFile& file, int part) {
  ImageFileSpec spec;
  imageLibrary().spec(file, part, spec);
  return spec;
}

std::optional<Colors> findColors(ImageFile& file, const std::string& name, bool alpha) {
  const std::vector<Colors> found = findRuns(file);
  if (found.empty()) return findGrey(file);
  Colors colors = chosen(found, name);
  if (!alpha) colors.channels = 3;
  return colors;
}

void checkSize(const ImageFileSpec& spec, const std::string& name, std::int64_t maxSide) {
  const auto check = [&](std::int64_t width, std::int64_t height) {
    if (width < 1 || height < 1 || spec.channels.empty() || spec.depth > 1 || spec.deep) {
      fail(ExitCode::kInput, "{}: not a plain two-dimensional image ({}x{}, {} channels)", name,
           width, height, spec.channels.size());
    }
    if (width > maxSide || height > maxSide || width * height > kMaxTexels ||
        spec.channels.size() > 1024) {
      fail(ExitCode::kInput, "{}: {}x{} with {} channels is more than this program reads", name,
           width, height, spec.channels.size());
    }
  };
  check(spec.width, spec.height);
  if (!spec.windowed) return;
  check(spec.fullWidth, spec.fullHeight);
  constexpr int kFurthest = 1 << 24;
  for (const int at : {spec.x, spec.y, spec.fullX, spec.fullY}) {
    if (std::abs(at) > kFurthest) {
      fail(ExitCode::kInput, "{}: its windows are too far off", name);
    }
  }
}

void readWindow(ImageFile& file, const Colors& at, const ImageFileSpec& spec, ImageValues as,
                const std::string& name, std::byte* to) {
  const std::size_t texel = std::size_t(at.channels) * sizeOfValue(as);
  const bool other = spec.windowed && spec.cropped();
  std::vector<std::byte> data;
  if (other) {
    const std::size_t bytes = std::size_t(spec.width) * spec.height * texel;
    checkRoom(bytes, name, 0);
    data.resize(bytes);
  }
  std::string error;
  if (!imageLibrary().read(file, at.part, at.channel, at.channel + at.channels, as,
                           other ? data.data() : to, error)) {
    fail(ExitCode::kInput, "{}: broken image: {}", name, utf8Of(oneLine(error)));
  }
  if (other) copyShared(spec, texel, data.data(), to);
}

void setSize(const ImageFileSpec& spec, Image& image) {
  image.width = spec.windowed ? spec.fullWidth : spec.width;
  image.height = spec.windowed ? spec.fullHeight : spec.height;
}

void checkRoom(std::uint64_t bytes, const std::string& name, std::uint64_t maxMemory) {
  const std::uint64_t left = leftBytes(maxMemory);
  if (bytes <= left) return;
  fail(ExitCode::kMemoryOrDevice,
       "{}: the image needs {} to be decoded, {} are left; make --max-memory larger, or the image "
       "smaller",
       name, formatBytes(bytes), formatBytes(left));
}

}  // namespace trex::detail
