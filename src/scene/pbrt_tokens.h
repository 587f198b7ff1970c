// The words of pbrt files, versions 3 and 4: names, numbers, strings in quotes, brackets; comments
// run from '#' to the end of the line.
#pragma once

#include <filesystem>
#include <string>

#include "src/scene/input_file.h"

namespace trex::detail {

/// Reads a file from front to back in bounded memory.
class PbrtTokens {
 public:
  enum class Kind { kEnd, kWord, kString, kOpen, kClose };
  /// Longest word or string, bytes.
  static constexpr std::size_t kMaxText = std::size_t(1) << 20;

  /// Throws Error(kInput) if the file can't be opened.
  explicit PbrtTokens(const std::filesystem::path& path);

  /// The kind of the next token, which stays there. Throws Error(kInput) with file and line for a
  /// string without end or a text that is too long.
  Kind peek() {
    if (!peeked_) read();
    return kind_;
  }
  /// Takes the next token.
  Kind next() {
    const Kind kind = peek();
    peeked_ = false;
    return kind;
  }
  /// Of the token that was peeked or taken last: a word, or a string without quotes, with its
  /// escapes resolved. Valid until another token is peeked or taken.
  const std::string& text() const { return text_; }

  const std::string& file() const { return input_.name(); }
  /// Of the token that was peeked or taken last, from 1.
  std::uint64_t line() const { return line_; }
  std::string where() const { return file() + ":" + std::to_string(line_); }

 private:
  void read();
  void readString();
  void readWord(int first);
  int skipBlanks();
  void append(int byte);

  InputFile input_;
  Kind kind_ = Kind::kEnd;
  std::string text_;
  std::uint64_t line_ = 1, at_ = 1;  ///< of the token; reached
  bool peeked_ = false;
};

}  // namespace trex::detail
