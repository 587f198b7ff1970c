// A file read once from front to back in bounded memory; one packed by gzip is unpacked on the way.
#pragma once

#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

struct gzFile_s;  // of zlib

namespace trex::detail {

class InputFile {
 public:
  /// Longest line that readLine returns, bytes.
  static constexpr std::size_t kMaxLine = std::size_t(1) << 24;

  /// What gzip has packed may grow to so many times its size and kUnpackedBytes, else it is an
  /// Error(kInput): text packs 3 to 20 to 1, a file made to fill memory 1000.
  static constexpr std::uint64_t kMostUnpacked = 100, kUnpackedBytes = std::uint64_t(1) << 20;

  /// Opens a plain file; throws Error(kInput) otherwise.
  explicit InputFile(const std::filesystem::path& path);

  const std::string& name() const { return name_; }
  /// Bytes that follow, at most.
  std::uint64_t remaining() const { return fileLeft_ + (filled_ - at_); }
  std::uint64_t lineNumber() const { return line_; }  ///< of the line last read, from 1

  /// Next line without its end ("\n" or "\r\n"; "\r" if the first line ends so, and then "\n"
  /// becomes a blank), valid until the next read; false at the end. A byte order mark in front of
  /// the first line is skipped; one of UTF-16 is an Error(kInput).
  bool readLine(std::string_view& line);

  /// The next byte, or -1 at the end; peek() leaves it there. Lines are not counted.
  int peek() { return at_ < filled_ || refill() ? buffer_[at_] : -1; }
  int next() {
    const int byte = peek();
    at_ += byte >= 0;
    return byte;
  }

  /// The next `count` bytes (at most 64), valid until the next read. Throws Error(kInput) if the
  /// file ends before.
  const std::uint8_t* take(std::size_t count) {
    if (filled_ - at_ < count) require(count);
    const std::uint8_t* p = buffer_.data() + at_;
    at_ += count;
    return p;
  }

 private:
  struct Close {
    void operator()(std::FILE* f) const { std::fclose(f); }
    void operator()(gzFile_s* f) const;
  };

  bool refill();
  std::size_t unpack(std::uint8_t* to, std::size_t most);
  void beginText();
  void require(std::size_t count);

  std::string name_;
  std::unique_ptr<std::FILE, Close> file_;
  std::unique_ptr<gzFile_s, Close> packed_;  ///< in its place
  std::uint64_t fileLeft_ = 0;
  std::uint64_t line_ = 0;
  char lineEnd_ = '\n';
  std::size_t at_ = 0, filled_ = 0;
  std::vector<std::uint8_t> buffer_;
};

/// Takes the next word off the front of `text`; empty at the end. Words end at blanks and tabs.
std::string_view nextWord(std::string_view& text);

/// Without blanks at both ends.
std::string_view trimmed(std::string_view text);

/// Text as UTF-8: as it is if it is that already, else its bytes are taken for Latin-1.
std::string utf8Of(std::string_view text);

/// Parses a whole word as a number ("nan" and "inf" included). False if it is none.
bool parseDouble(std::string_view word, double& value);
bool parseInteger(std::string_view word, std::int64_t& value);

/// Takes a key with its numbers; returns what is wrong with them, or nothing.
using SetOption =
    std::function<std::string(const std::string& key, std::span<const double> numbers)>;
/// Parses "key=value&key=value,value", what follows the question mark of --volume, --env and
/// --camera. Returns the first thing that is wrong, or nothing.
std::string parseOptions(std::string_view text, const SetOption& set);

}  // namespace trex::detail
