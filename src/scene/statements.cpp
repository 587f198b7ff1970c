#include "src/scene/statements.h"

#include <cmath>

#include "src/core/error.h"

namespace trex::detail {
namespace {

bool takesName(std::string_view keyword) {
  for (const std::string_view name :
       {"o", "g", "usemtl", "newmtl", "mtllib", "bump", "norm", "disp", "decal", "refl"}) {
    if (keyword == name) return true;
  }
  return keyword.starts_with("map_");
}

void lowerCase(std::string_view word, std::string& out) {
  out.assign(word);
  for (char& c : out) c = static_cast<char>(c >= 'A' && c <= 'Z' ? c - 'A' + 'a' : c);
}

}  // namespace

void LeftOut::add(std::string_view keyword) {
  constexpr std::size_t kMost = 30, kLongest = 40;
  const std::string_view start = keyword.substr(0, kLongest);
  if (said_.size() < kMost && said_.insert(std::string(start)).second) {
    text_.append(" ").append(utf8Of(start));
  }
}

void LeftOut::tell(Scene& scene, const std::string& file) const {
  if (!text_.empty()) scene.warnings.push_back(fmt::format("{}: not shown:{}", file, text_));
}

std::string_view withoutComment(std::string_view arguments) {
  std::size_t at = arguments.find('#');
  while (at != arguments.npos && at > 0 && arguments[at - 1] != ' ' && arguments[at - 1] != '\t') {
    at = arguments.find('#', at + 1);
  }
  return trimmed(arguments.substr(0, at));
}

bool Statements::next(std::string_view& keyword, std::string_view& arguments) {
  std::string_view line;
  while (input_.readLine(line)) {
    std::string_view word = nextWord(line);
    // Byte order marks lie inside of files that were joined.
    while (word.starts_with("\xef\xbb\xbf")) word.remove_prefix(3);
    if (word.empty()) word = nextWord(line);
    if (word.empty()) continue;
    lowerCase(word, keyword_);
    if (word.front() == '#' && keyword_ != kPolypaint) continue;
    keyword = keyword_;
    if (takesName(keyword_)) {
      arguments = trimmed(line);
      return true;
    }
    arguments = withoutComment(line);
    if (arguments.empty() || arguments.back() != '\\') return true;
    joined_.clear();
    while (!arguments.empty() && arguments.back() == '\\') {
      joined_.append(arguments.substr(0, arguments.size() - 1)).push_back(' ');
      if (joined_.size() > InputFile::kMaxLine) {
        fail(ExitCode::kInput, "{}: line too long", where());
      }
      arguments = {};
      if (input_.readLine(line)) arguments = withoutComment(line);
    }
    joined_.append(arguments);
    arguments = joined_;
    return true;
  }
  return false;
}

bool parseNumber(std::string_view word, double& value) {
  if (parseDouble(word, value)) return true;
  // A comma for the point, as in half of the world, and Fortran's exponents.
  std::string foreign(word);
  const std::size_t comma = foreign.find(','), power = foreign.find_first_of("dD");
  if (comma != foreign.npos && foreign.find('.') == foreign.npos) foreign[comma] = '.';
  if (power != foreign.npos) foreign[power] = 'e';
  if (foreign != word && parseDouble(foreign, value)) return true;
  if (word.find("#QNAN") == word.npos && word.find("#INF") == word.npos &&
      word.find("#IND") == word.npos && word.find("#SNAN") == word.npos) {
    return false;
  }
  value = std::nan("");
  return true;
}

}  // namespace trex::detail
