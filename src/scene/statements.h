// Lines of OBJ and MTL files: a keyword and its arguments.
#pragma once

#include <set>
#include <string>
#include <string_view>

#include "src/scene/input_file.h"
#include "src/scene/scene.h"

namespace trex::detail {

/// Reads statements as exporters write them: comments after arguments, lines that a backslash
/// continues, keywords in any case. Names of materials, objects and files may have blanks and '#'
/// in them, so a statement of a name keeps all of its line and is never continued.
class Statements {
 public:
  /// The one comment that is a statement: ZBrush writes colours in it.
  static constexpr std::string_view kPolypaint = "#mrgb";

  explicit Statements(const std::filesystem::path& path) : input_(path) {}

  /// The next statement: its keyword in lower case, and its arguments without blanks at both ends.
  /// Both are valid until the next call; false at the end of the file.
  bool next(std::string_view& keyword, std::string_view& arguments);

  const std::string& file() const { return input_.name(); }
  std::uint64_t lineNumber() const { return input_.lineNumber(); }
  std::string where() const { return file() + ":" + std::to_string(lineNumber()); }

 private:
  InputFile input_;
  std::string keyword_, joined_;
};

/// Keywords of statements that are not shown, each once.
class LeftOut {
 public:
  void add(std::string_view keyword);
  /// Tells them in the scene's warnings, if there are any.
  void tell(Scene& scene, const std::string& file) const;

 private:
  std::set<std::string> said_;
  std::string text_;
};

/// A name without the comment behind it, if it looks like having one.
std::string_view withoutComment(std::string_view arguments);

/// Number of a word; "0,5" is one half, and "1.0D2" a hundred. "1.#QNAN", "1.#INF" and "-1.#IND",
/// as one compiler's library writes what is not finite, are not-a-number. False for other words.
bool parseNumber(std::string_view word, double& value);

}  // namespace trex::detail
