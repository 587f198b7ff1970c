#include "src/scene/mitsuba_xml.h"

#include <algorithm>
#include <cctype>
#include <pugixml.hpp>

#include "src/scene/image_io.h"
#include "src/scene/import_detail.h"
#include "src/scene/texture_file.h"

namespace trex::detail::mitsuba {
namespace {

constexpr int kMostDepth = 64;     // of elements in elements
constexpr int kMostIncluded = 15;  // files in files, as in Mitsuba
constexpr std::size_t kMostFiles = 1000;
constexpr std::size_t kMostText = 1u << 16;  // of a value with parameters filled in
constexpr std::uint64_t kMostElements = 1u << 25;

bool lower(char c) { return c >= 'a' && c <= 'z'; }
bool upper(char c) { return c >= 'A' && c <= 'Z'; }
bool ofName(char c) { return lower(c) || upper(c) || (c >= '0' && c <= '9') || c == '_'; }

}  // namespace

std::string snakeCase(std::string_view name) {
  std::string made;
  for (std::size_t i = 0; i < name.size(); ++i) {
    const bool starts = upper(name[i]) && i > 0 && lower(name[i - 1]);
    if (starts) made += '_';
    made += upper(name[i]) ? static_cast<char>(name[i] - 'A' + 'a') : name[i];
  }
  return made;
}

std::string_view Element::attribute(std::string_view name) const {
  for (const auto& [key, value] : attributes) {
    if (key == name) return value;
  }
  return {};
}

/// A parsed file, and where its lines begin.
struct Document::Source {
  std::string name;
  std::filesystem::path folder;
  std::uint32_t number = 0;
  std::vector<std::uint8_t> bytes;
  std::vector<std::size_t> lineStarts;
  pugi::xml_document document;

  std::uint32_t lineOf(std::ptrdiff_t offset) const {
    const auto next =
        std::upper_bound(lineStarts.begin(), lineStarts.end(),
                         static_cast<std::size_t>(std::max<std::ptrdiff_t>(offset, 0)));
    return static_cast<std::uint32_t>(next - lineStarts.begin());
  }
};

Document::Document(const std::filesystem::path& path, const std::vector<std::string>& defines) {
  for (const std::string& define : defines) {
    const std::size_t equal = define.find('=');
    if (equal == 0 || equal == define.npos) {
      fail(ExitCode::kUsage, "-D {}: want NAME=VALUE", define);
    }
    parameters_[define.substr(0, equal)] = {define.substr(equal + 1)};
  }
  std::vector<std::string> given;
  for (const auto& [name, parameter] : parameters_) given.push_back(name);
  readFile(path, 0, root_);
  for (const std::string& name : given) {
    if (parameters_[name].used) continue;
    fail(ExitCode::kUsage, "-D {}: {} has no parameter of that name", name, path.string());
  }
}

Document::~Document() = default;

std::string Document::where(const Element& element) const {
  return fmt::format("{}:{}", files_[element.file].string(), element.line);
}

std::string_view Document::keep(std::string text) { return texts_.emplace_back(std::move(text)); }

std::string_view Document::upgraded(std::string_view name) {
  if (std::none_of(name.begin(), name.end(), upper)) return name;
  const auto [found, made] = names_.try_emplace(name);
  if (made) found->second = keep(snakeCase(name));
  return found->second;
}

/// The longest parameter that fits behind each $ counts.
std::string_view Document::filledIn(std::string_view text, const std::string& where) {
  if (text.find('$') == text.npos) return text;
  std::string made;
  for (std::size_t i = 0; i < text.size();) {
    if (text[i] != '$') {
      made += text[i++];
      continue;
    }
    std::size_t end = i + 1;
    while (end < text.size() && ofName(text[end])) ++end;
    std::size_t length = end - i - 1;
    auto found = parameters_.end();
    for (; length > 0 && found == parameters_.end(); --length) {
      found = parameters_.find(std::string(text.substr(i + 1, length)));
      if (found != parameters_.end()) break;
    }
    if (found == parameters_.end()) {
      fail(ExitCode::kInput, "{}: parameter '{}' has no value; give one with -D NAME=VALUE", where,
           text.substr(i, std::min<std::size_t>(end - i, 80)));
    }
    found->second.used = true;
    made += found->second.value;
    i += 1 + length;
    if (made.size() > kMostText) {
      fail(ExitCode::kInput, "{}: a value of more than {} characters once parameters are filled in",
           where, kMostText);
    }
  }
  return keep(std::move(made));
}

void Document::setDefault(const Element& element) {
  const std::string name(element.name());
  if (name.empty()) fail(ExitCode::kInput, "{}: a default without a name", where(element));
  const auto [found, made] = parameters_.try_emplace(name);
  if (made) found->second.value = element.attribute("value");
  found->second.used = true;
}

void Document::readFile(const std::filesystem::path& path, int includes, Element& into) {
  if (files_.size() >= kMostFiles) {
    fail(ExitCode::kInput, "{}: more than {} files are included", files_[0].string(), kMostFiles);
  }
  Source& source = *sources_.emplace_back(std::make_unique<Source>());
  source.name = path.string();
  source.folder = path.parent_path();
  source.number = static_cast<std::uint32_t>(files_.size());
  files_.push_back(path);
  source.bytes = readWholeFile(path, source.name);
  source.lineStarts.push_back(0);
  for (std::size_t i = 0; i < source.bytes.size(); ++i) {
    if (source.bytes[i] == '\n') source.lineStarts.push_back(i + 1);
  }
  // Neither document types nor entities beyond the five of XML are known to it.
  const pugi::xml_parse_result result =
      source.document.load_buffer_inplace(source.bytes.data(), source.bytes.size());
  if (!result) {
    fail(ExitCode::kInput, "{}:{}: broken XML: {}", source.name, source.lineOf(result.offset),
         result.description());
  }
  const pugi::xml_node top = source.document.document_element();
  if (std::string_view(top.name()) != "scene") {
    fail(ExitCode::kInput, "{}:{}: <{:.40}> where a Mitsuba scene has <scene>", source.name,
         source.lineOf(top.offset_debug()), top.name());
  }
  take(&top, source, 0, includes, into);
}

/// The attributes and children of a node; those of an included <scene> join what is there.
void Document::take(const void* node, const Source& source, int depth, int includes,
                    Element& into) {
  const pugi::xml_node& from = *static_cast<const pugi::xml_node*>(node);
  const std::uint32_t line = source.lineOf(from.offset_debug());
  if (into.tag.empty()) {
    into.tag = from.name();
    into.file = source.number, into.line = line;
    const std::string place = fmt::format("{}:{}", source.name, line);
    for (const pugi::xml_attribute& a : from.attributes()) {
      const std::string_view key = a.name();
      std::string_view value = filledIn(a.value(), place);
      if (key == "name" && into.tag != "default") value = upgraded(value);
      into.attributes.emplace_back(key, value);
    }
  }
  if (depth > kMostDepth || ++elements_ > kMostElements) {
    fail(ExitCode::kInput, "{}:{}: {}", source.name, line,
         depth > kMostDepth ? "elements are nested too deeply" : "too many elements");
  }
  for (const pugi::xml_node& child : from.children()) {
    if (child.type() != pugi::node_element) continue;
    Element made;
    take(&child, source, depth + 1, includes, made);
    if (made.tag == "default") {
      setDefault(made);
    } else if (made.tag == "include") {
      include(made, source, includes, into);
    } else {
      into.children.push_back(std::move(made));
    }
  }
}

void Document::include(const Element& element, const Source& source, int includes, Element& into) {
  if (includes >= kMostIncluded) {
    fail(ExitCode::kInput, "{}: files include files more than {} deep", where(element),
         kMostIncluded);
  }
  const std::string name(element.attribute("filename"));
  const std::filesystem::path path = findFile(source.folder, name);
  std::error_code error;
  if (name.empty() || !std::filesystem::is_regular_file(path, error)) {
    fail(ExitCode::kInput, "{}: no file {} to include", where(element), path.string());
  }
  readFile(path, includes + 1, into);
}

}  // namespace trex::detail::mitsuba
