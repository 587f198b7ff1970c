// The XML of a Mitsuba scene as a tree: files that it includes put in their places, parameters
// ($name) filled in, names of old versions as those of today.
#pragma once

#include <deque>
#include <filesystem>
#include <memory>
#include <string>
#include <string_view>
#include <unordered_map>
#include <vector>

#include "src/scene/import.h"

namespace trex::detail::mitsuba {

/// Texts live as long as the Document.
struct Element {
  std::string_view tag;
  std::vector<std::pair<std::string_view, std::string_view>> attributes;
  std::vector<Element> children;
  std::uint32_t file = 0, line = 0;

  /// Empty if there is none of that name.
  std::string_view attribute(std::string_view name) const;
  std::string_view name() const { return attribute("name"); }
  std::string_view type() const { return attribute("type"); }
};

/// Reads a file and all that it includes. Nothing is expanded but $parameters, and what these grow
/// to is bounded, as are nesting, includes and the number of elements. Mitsuba's rules: a
/// `default` counts unless the parameter is set already; an unknown parameter is an error.
class Document {
 public:
  /// Throws Error(kInput) with file and line; Error(kUsage) if a parameter of `defines` is not in
  /// the file.
  Document(const std::filesystem::path& path, const std::vector<std::string>& defines);
  ~Document();

  const Element& root() const { return root_; }
  /// "scene.xml:12".
  std::string where(const Element& element) const;
  /// All files read, the first one first.
  const std::vector<std::filesystem::path>& files() const { return files_; }
  /// "0.6.0"; empty if the file says none.
  std::string_view version() const { return root_.attribute("version"); }

 private:
  struct Source;
  struct Parameter {
    std::string value;
    bool used = false;
  };

  void readFile(const std::filesystem::path& path, int includes, Element& into);
  void take(const void* node, const Source& source, int depth, int includes, Element& into);
  void include(const Element& element, const Source& source, int includes, Element& into);
  std::string_view keep(std::string text);
  std::string_view filledIn(std::string_view text, const std::string& where);
  std::string_view upgraded(std::string_view name);
  void setDefault(const Element& element);

  Element root_;
  std::vector<std::filesystem::path> files_;
  std::vector<std::unique_ptr<Source>> sources_;
  std::deque<std::string> texts_;
  std::unordered_map<std::string, Parameter> parameters_;
  std::unordered_map<std::string_view, std::string_view> names_;
  std::uint64_t elements_ = 0;
};

/// A name of Mitsuba 0.x as later versions have it: "toWorld" is to_world, "intIOR" is int_ior.
std::string snakeCase(std::string_view name);

}  // namespace trex::detail::mitsuba
