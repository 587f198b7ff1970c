#include "src/scene/rgbe.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <string_view>
#include <vector>

#include "src/core/error.h"
#include "src/core/log.h"
#include "src/scene/image_io.h"
#include "src/scene/image_parts.h"
#include "src/scene/input_file.h"
#include "src/scene/spectra.h"

namespace trex::detail {
namespace {

using Texel = std::array<std::uint8_t, 4>;  ///< red, green, blue, exponent

/// How the file goes through the picture: "-Y height +X width" is row by row from the top.
struct Order {
  bool columns = false;  ///< its lines are columns of the picture
  bool linesTurned = false, texelsTurned = false;
  std::int64_t lines = 0, texels = 0;
};

class RgbeReader {
 public:
  RgbeReader(std::span<const std::uint8_t> file, const std::string& name)
      : left_(file), name_(name) {}

  Image read(std::int64_t maxSide, std::uint64_t maxMemory) {
    readHeader();
    readOrder(maxSide);
    Image image;
    image.name = name_;
    image.channels = 3;
    image.width = static_cast<int>(order_.columns ? order_.lines : order_.texels);
    image.height = static_cast<int>(order_.columns ? order_.texels : order_.lines);
    checkRoom(std::uint64_t(order_.lines * order_.texels) * 3 * sizeof(float), name_, maxMemory);
    image.floats.resize(std::size_t(image.width) * image.height * 3);
    line_.resize(static_cast<std::size_t>(order_.texels));
    for (std::int64_t i = 0; i < order_.lines; ++i) {
      readLine();
      putLine(i, image);
    }
    return image;
  }

 private:
  template <typename... Args>
  [[noreturn]] void bad(fmt::format_string<Args...> format, Args&&... args) const {
    fail(ExitCode::kInput, "{}: broken image: {}", name_,
         fmt::format(format, std::forward<Args>(args)...));
  }

  /// A line of text, without its end.
  std::string_view text() {
    constexpr std::size_t kLongest = 4096;
    const std::size_t most = std::min(left_.size(), kLongest);
    const auto* begin = reinterpret_cast<const char*>(left_.data());
    const std::size_t length = std::string_view(begin, most).find('\n');
    if (length == std::string_view::npos) bad("its header does not end");
    left_ = left_.subspan(length + 1);
    std::string_view line(begin, length);
    if (line.ends_with('\r')) line.remove_suffix(1);
    return line;
  }

  void readHeader() {
    constexpr int kMostLines = 10'000;
    text();  // "#?RADIANCE"
    for (int i = 0; i < kMostLines; ++i) {
      const std::string_view line = text();
      if (line.empty()) return tellFactor();
      const std::size_t at = line.find('=');
      if (line.front() == '#' || at == line.npos) continue;
      const std::string_view key = trimmed(line.substr(0, at)),
                             value = trimmed(line.substr(at + 1));
      if (key == "FORMAT" && value == "32-bit_rle_xyze") {
        xyz_ = true;
      } else if (key == "FORMAT" && value != "32-bit_rle_rgbe") {
        bad("its format '{}' is not known", utf8Of(oneLine(std::string(value.substr(0, 40)))));
      } else if (key == "EXPOSURE" || key == "COLORCORR") {
        multiply(value);
      }
    }
    bad("its header does not end");
  }

  /// Of one number or three; each such line was one more step of a program.
  void multiply(std::string_view numbers) {
    dvec3 by(1.0);
    for (int c = 0; c < 3; ++c) {
      const std::string_view word = nextWord(numbers);
      if (word.empty() && c == 1) {
        by = dvec3(by.x);
        break;
      }
      if (!parseDouble(word, by[c])) return;
    }
    constexpr double kMost = 1e12;
    for (int c = 0; c < 3; ++c) {
      if (!(by[c] >= 1.0 / kMost && by[c] <= kMost)) return;
    }
    multiplied_ *= by;
  }

  void tellFactor() {
    if (multiplied_ == dvec3(1.0)) return;
    logWarning("{}: was multiplied by {:.4g},{:.4g},{:.4g}, as its header says; that is taken out",
               name_, multiplied_.x, multiplied_.y, multiplied_.z);
  }

  void readOrder(std::int64_t maxSide) {
    std::string_view line = text();
    const std::string_view first = nextWord(line), lines = nextWord(line);
    const std::string_view second = nextWord(line), texels = nextWord(line);
    const auto axis = [](std::string_view word) {
      const bool good = word.size() == 2 && (word[0] == '+' || word[0] == '-') &&
                        (word[1] == 'X' || word[1] == 'Y');
      return good ? word[1] : '?';
    };
    const char a = axis(first), b = axis(second);
    if (a == '?' || b == '?' || a == b || !parseInteger(lines, order_.lines) ||
        !parseInteger(texels, order_.texels)) {
      bad("its size is not given as -Y HEIGHT +X WIDTH");
    }
    if (order_.lines < 1 || order_.texels < 1 || order_.lines > maxSide ||
        order_.texels > maxSide || order_.lines * order_.texels > kMaxTexels) {
      fail(ExitCode::kInput, "{}: {} lines of {} texels are more than this program reads, or none",
           name_, order_.lines, order_.texels);
    }
    // However alike its texels are, a line takes some bytes, and runs of runs end.
    constexpr std::int64_t kLeastLine = 4, kMostTexelsAByte = 1 << 13;
    const auto bytes = static_cast<std::int64_t>(left_.size());
    if (order_.lines > bytes / kLeastLine || order_.texels / kMostTexelsAByte > bytes) {
      bad("it ends early");
    }
    order_.columns = a == 'X';
    // Y counts from below, X from the left.
    order_.linesTurned = first[0] == (order_.columns ? '-' : '+');
    order_.texelsTurned = second[0] == (order_.columns ? '+' : '-');
  }

  std::span<const std::uint8_t> take(std::size_t bytes) {
    if (left_.size() < bytes) bad("it ends early");
    const auto taken = left_.first(bytes);
    left_ = left_.subspan(bytes);
    return taken;
  }

  void readLine() {
    constexpr std::size_t kLeast = 8, kMost = 0x7fff;
    const bool runs = line_.size() >= kLeast && line_.size() <= kMost && left_.size() >= 4 &&
                      left_[0] == 2 && left_[1] == 2 && (left_[2] & 0x80) == 0;
    if (!runs) return readOldLine();
    const auto head = take(4);
    if ((std::size_t(head[2]) << 8 | head[3]) != line_.size()) bad("a line has another length");
    for (int c = 0; c < 4; ++c) {
      for (std::size_t i = 0; i < line_.size();) {
        const std::size_t code = take(1)[0];
        const std::size_t count = code > 128 ? code - 128 : code;
        if (count == 0 || count > line_.size() - i) bad("a run goes beyond its line");
        const auto values = take(code > 128 ? 1 : count);
        for (std::size_t k = 0; k < count; ++k) {
          line_[i++][c] = values[code > 128 ? 0 : k];
        }
      }
    }
  }

  /// Texels; one of 1, 1, 1 says how often the one before comes again, others after it the next
  /// eight bits of that number.
  void readOldLine() {
    int shift = 0;
    for (std::size_t i = 0; i < line_.size();) {
      const auto bytes = take(4);
      if (bytes[0] != 1 || bytes[1] != 1 || bytes[2] != 1) {
        std::memcpy(line_[i++].data(), bytes.data(), 4);
        shift = 0;
        continue;
      }
      if (i == 0 || shift > 16) bad("a run begins with nothing");
      const std::size_t count = std::size_t(bytes[3]) << shift;
      if (count > line_.size() - i) bad("a run goes beyond its line");
      std::fill_n(line_.begin() + static_cast<std::ptrdiff_t>(i), count, line_[i - 1]);
      i += count;
      shift += 8;
    }
  }

  vec3 colorOf(const Texel& t) const {
    constexpr int kExcess = 128 + 8;
    const float scale = t[3] == 0 ? 0.0f : std::ldexp(1.0f, int(t[3]) - kExcess);
    const vec3 value(static_cast<float>(t[0]) * scale, static_cast<float>(t[1]) * scale,
                     static_cast<float>(t[2]) * scale);
    if (!xyz_ && multiplied_ == dvec3(1.0)) return value;
    dvec3 color = dvec3(value) / multiplied_;
    if (xyz_) color = glm::max(rgbOfXyz(color), dvec3(0.0));
    return vec3(color);
  }

  void putLine(std::int64_t number, Image& image) const {
    const std::int64_t line = order_.linesTurned ? order_.lines - 1 - number : number;
    for (std::int64_t i = 0; i < order_.texels; ++i) {
      const std::int64_t along = order_.texelsTurned ? order_.texels - 1 - i : i;
      const std::int64_t x = order_.columns ? line : along, y = order_.columns ? along : line;
      const vec3 color = colorOf(line_[static_cast<std::size_t>(i)]);
      float* to = &image.floats[static_cast<std::size_t>(y * image.width + x) * 3];
      for (int c = 0; c < 3; ++c) to[c] = color[c];
    }
  }

  std::span<const std::uint8_t> left_;
  const std::string& name_;
  Order order_;
  std::vector<Texel> line_;
  dvec3 multiplied_{1.0};
  bool xyz_ = false;
};

}  // namespace

bool isRgbe(std::span<const std::uint8_t> file) {
  return file.size() >= 2 && file[0] == '#' && file[1] == '?';
}

Image readRgbe(std::span<const std::uint8_t> file, const std::string& name, std::int64_t maxSide,
               std::uint64_t maxMemory) {
  return RgbeReader(file, name).read(maxSide, maxMemory);
}

}  // namespace trex::detail
