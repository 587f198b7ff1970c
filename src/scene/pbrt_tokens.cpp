#include "src/scene/pbrt_tokens.h"

#include <string_view>

#include "src/core/error.h"

namespace trex::detail {

PbrtTokens::PbrtTokens(const std::filesystem::path& path) : input_(path) {
  constexpr std::string_view kMark = "\xef\xbb\xbf";
  for (const char c : kMark) {
    if (input_.peek() != static_cast<unsigned char>(c)) break;
    input_.next();
  }
}

/// The first byte of the next token, which is taken; -1 at the end.
int PbrtTokens::skipBlanks() {
  for (;;) {
    int c = input_.next();
    if (c == '#') {
      while (c >= 0 && c != '\n') c = input_.next();
    }
    if (c == '\n') ++at_;
    if (c != ' ' && c != '\t' && c != '\r' && c != '\n' && c != '\f' && c != '\v') return c;
  }
}

void PbrtTokens::append(int byte) {
  if (text_.size() >= kMaxText) {
    fail(ExitCode::kInput, "{}: a word or string of more than {} bytes", where(), kMaxText);
  }
  text_.push_back(static_cast<char>(byte));
}

void PbrtTokens::read() {
  const int c = skipBlanks();
  peeked_ = true;
  line_ = at_;
  text_.clear();
  if (c < 0) {
    kind_ = Kind::kEnd;
  } else if (c == '[') {
    kind_ = Kind::kOpen;
  } else if (c == ']') {
    kind_ = Kind::kClose;
  } else if (c == '"') {
    readString();
  } else {
    readWord(c);
  }
}

void PbrtTokens::readWord(int first) {
  kind_ = Kind::kWord;
  append(first);
  constexpr std::string_view kEnds = " \t\r\n\f\v\"[]#";
  for (int c = input_.peek(); c >= 0 && kEnds.find(static_cast<char>(c)) == kEnds.npos;
       c = input_.peek()) {
    append(input_.next());
  }
}

void PbrtTokens::readString() {
  kind_ = Kind::kString;
  constexpr std::string_view kEscaped = "bfnrt\\'\"", kMeant = "\b\f\n\r\t\\'\"";
  for (;;) {
    int c = input_.next();
    if (c == '"') return;
    if (c < 0 || c == '\n') {
      fail(ExitCode::kInput, "{}: a string without its closing quote: \"{:.40}", where(),
           utf8Of(oneLine(text_)));
    }
    if (c == '\\') {
      const int escaped = input_.peek();
      const std::size_t which =
          escaped < 0 ? kEscaped.npos : kEscaped.find(static_cast<char>(escaped));
      if (which != kEscaped.npos) {
        input_.next();
        c = static_cast<unsigned char>(kMeant[which]);
      }
    }
    append(c);
  }
}

}  // namespace trex::detail
