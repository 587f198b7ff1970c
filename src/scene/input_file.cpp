#include "src/scene/input_file.h"

#include <zlib.h>

#include <algorithm>
#include <bit>
#include <charconv>
#include <cstring>
#include <limits>

#include "src/core/error.h"

namespace trex::detail {
namespace {

constexpr std::size_t kBufferSize = std::size_t(1) << 18;

bool isBlank(char c) { return c == ' ' || c == '\t' || c == '\r' || c == '\v' || c == '\f'; }

}  // namespace

void InputFile::Close::operator()(gzFile_s* f) const { gzclose(f); }

InputFile::InputFile(const std::filesystem::path& path) : name_(path.string()) {
  std::error_code error;
  const auto status = std::filesystem::status(path, error);
  if (!std::filesystem::exists(status)) fail(ExitCode::kInput, "{}: no such file", name_);
  if (!std::filesystem::is_regular_file(status)) {
    fail(ExitCode::kInput, "{}: not a plain file", name_);
  }
  fileLeft_ = std::filesystem::file_size(path, error);
  file_.reset(std::fopen(name_.c_str(), "rb"));
  if (error || !file_) fail(ExitCode::kInput, "{}: can't be opened for reading", name_);
  const int first = std::getc(file_.get()), second = std::getc(file_.get());
  std::rewind(file_.get());
  if (first == 0x1f && second == 0x8b) {
    file_.reset();
    packed_.reset(gzopen(name_.c_str(), "rb"));
    if (!packed_) fail(ExitCode::kInput, "{}: can't be opened for reading", name_);
    gzbuffer(packed_.get(), 1u << 17);
    fileLeft_ = kMostUnpacked * fileLeft_ + kUnpackedBytes;
  }
  buffer_.resize(std::min<std::uint64_t>(kBufferSize, fileLeft_ + 1));
}

/// Up to `most` bytes of what gzip has packed.
std::size_t InputFile::unpack(std::uint8_t* to, std::size_t most) {
  const auto piece = static_cast<unsigned>(std::min<std::size_t>(most, 1u << 30));
  const int got = gzread(packed_.get(), to, piece);
  int problem = Z_OK;
  gzerror(packed_.get(), &problem);
  if (got < 0 || (problem != Z_OK && problem != Z_STREAM_END)) {
    fail(ExitCode::kInput, "{}: what gzip has packed is broken or cut off", name_);
  }
  if (static_cast<std::uint64_t>(got) > fileLeft_) {
    fail(ExitCode::kInput,
         "{}: unpacks to more than {} times its size; unpack it (gunzip) if that is right", name_,
         kMostUnpacked);
  }
  return static_cast<std::size_t>(got);
}

bool InputFile::refill() {
  if (at_ > 0) std::memmove(buffer_.data(), buffer_.data() + at_, filled_ - at_);
  filled_ -= at_;
  at_ = 0;
  if (filled_ == buffer_.size()) buffer_.resize(buffer_.size() * 2);
  std::uint8_t* const to = buffer_.data() + filled_;
  const std::size_t most = buffer_.size() - filled_;
  const std::size_t got = packed_ ? unpack(to, most) : std::fread(to, 1, most, file_.get());
  filled_ += got;
  // A file that grows while it is read must not make `remaining` wrap around.
  fileLeft_ = got == 0 ? 0 : fileLeft_ - std::min<std::uint64_t>(fileLeft_, got);
  return got > 0;
}

void InputFile::require(std::size_t count) {
  while (filled_ - at_ < count) {
    if (!refill()) fail(ExitCode::kInput, "{}: the file ends too early (truncated)", name_);
  }
}

/// Before the first line: skips the byte order mark and looks how lines end.
void InputFile::beginText() {
  while (filled_ - at_ < 3 && refill()) {
  }
  const auto begins = [&](std::string_view mark) {
    return filled_ - at_ >= mark.size() &&
           std::memcmp(buffer_.data() + at_, mark.data(), mark.size()) == 0;
  };
  if (begins("\xef\xbb\xbf")) at_ += 3;
  if (begins("\xff\xfe") || begins("\xfe\xff")) {
    fail(ExitCode::kInput, "{}: is text of UTF-16, which is not read; save it as UTF-8", name_);
  }
  for (std::size_t i = 0; i + at_ <= filled_; ++i) {
    if (i + at_ + 1 >= filled_ && (i > kMaxLine || !refill())) return;
    const std::uint8_t c = buffer_[at_ + i], next = buffer_[at_ + i + 1];
    if (c == '\r' && next != '\n' && next != '\r') lineEnd_ = '\r';
    if (c == '\r' || c == '\n') return;
  }
}

bool InputFile::readLine(std::string_view& line) {
  if (line_ == 0) beginText();
  std::size_t searched = 0;
  for (;;) {
    const std::uint8_t* start = buffer_.data() + at_;
    const std::size_t have = filled_ - at_;
    const void* found = std::memchr(start + searched, lineEnd_, have - searched);
    const bool whole = found != nullptr;
    if (!whole && have <= kMaxLine) {
      searched = have;
      if (refill()) continue;
      if (have == 0) return false;
    }
    start = buffer_.data() + at_;
    std::size_t length =
        whole ? static_cast<std::size_t>(static_cast<const std::uint8_t*>(found) - start) : have;
    ++line_;
    if (length > kMaxLine) fail(ExitCode::kInput, "{}:{}: line too long", name_, line_);
    // Where "\r" ends lines, names and messages are of one line too.
    std::uint8_t* text = buffer_.data() + at_;
    if (lineEnd_ == '\r') std::replace(text, text + length, '\n', ' ');
    at_ += length + (whole ? 1 : 0);
    if (length > 0 && start[length - 1] == '\r') --length;
    line = {reinterpret_cast<const char*>(start), length};
    return true;
  }
}

std::string_view nextWord(std::string_view& text) {
  std::size_t start = 0;
  while (start < text.size() && isBlank(text[start])) ++start;
  std::size_t end = start;
  while (end < text.size() && !isBlank(text[end])) ++end;
  const std::string_view word = text.substr(start, end - start);
  text.remove_prefix(end);
  return word;
}

std::string_view trimmed(std::string_view text) {
  while (!text.empty() && isBlank(text.front())) text.remove_prefix(1);
  while (!text.empty() && isBlank(text.back())) text.remove_suffix(1);
  return text;
}

std::string utf8Of(std::string_view text) {
  // Each byte after a leading one of n ones in a row is one of n - 1 that start with 10.
  bool valid = true;
  for (std::size_t i = 0; valid && i < text.size(); ++i) {
    const int ones = std::countl_one(static_cast<std::uint8_t>(text[i]));
    valid = ones == 0 || (ones >= 2 && ones <= 4 && i + ones <= text.size());
    for (int k = 1; valid && k < ones; ++k) {
      valid = (static_cast<std::uint8_t>(text[++i]) & 0xc0) == 0x80;
    }
  }
  if (valid) return std::string(text);
  std::string out;
  for (const char c : text) {
    const auto byte = static_cast<std::uint8_t>(c);
    if (byte >= 0x80) out.push_back(static_cast<char>(0xc0 | (byte >> 6)));
    out.push_back(static_cast<char>(byte >= 0x80 ? 0x80 | (byte & 0x3f) : byte));
  }
  return out;
}

bool parseDouble(std::string_view word, double& value) {
  if (!word.empty() && word.front() == '+') word.remove_prefix(1);
  const char* end = word.data() + word.size();
  const auto [at, error] = std::from_chars(word.data(), end, value);
  if (at != end || word.empty()) return false;
  if (error == std::errc::result_out_of_range) {
    // Too large or too small for double: the sign of the exponent tells which.
    const bool tiny = word.find("e-") != word.npos || word.find("E-") != word.npos ||
                      word.find_first_of("eE") == word.npos;
    value = tiny ? 0.0 : std::numeric_limits<double>::infinity();
    return true;
  }
  return error == std::errc();
}

std::string parseOptions(std::string_view text, const SetOption& set) {
  while (!text.empty()) {
    const std::size_t end = std::min(text.find('&'), text.size());
    const std::string_view part = text.substr(0, end);
    text = end < text.size() ? text.substr(end + 1) : std::string_view();
    const std::size_t equals = part.find('=');
    if (equals == part.npos) return fmt::format("'{}' has no value", part);
    std::vector<double> numbers;
    for (std::string_view list = part.substr(equals + 1);;) {
      const std::string_view word = list.substr(0, list.find(','));
      double number = 0.0;
      if (!parseDouble(word, number)) return fmt::format("'{}' is no number", word);
      numbers.push_back(number);
      if (word.size() == list.size()) break;
      list = list.substr(word.size() + 1);
    }
    const std::string problem = set(std::string(part.substr(0, equals)), numbers);
    if (!problem.empty()) return problem;
  }
  return {};
}

bool parseInteger(std::string_view word, std::int64_t& value) {
  if (!word.empty() && word.front() == '+') word.remove_prefix(1);
  const char* end = word.data() + word.size();
  const auto [at, error] = std::from_chars(word.data(), end, value);
  return at == end && !word.empty() && error == std::errc();
}

}  // namespace trex::detail
