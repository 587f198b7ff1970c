#include "src/scene/ply_file.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>
#include <map>

#include "src/scene/import_detail.h"
#include "src/scene/statements.h"

namespace trex::detail {
namespace {

constexpr std::array<std::size_t, 8> kTypeSize = {1, 1, 2, 2, 4, 4, 4, 8};

}  // namespace

PlyFile::PlyFile(const std::filesystem::path& path) : input_(path) { readHeader(); }

void PlyFile::readHeader() {
  std::string_view line;
  if (!input_.readLine(line) || nextWord(line) != "ply") bad("not a PLY file (wrong magic)");
  bool formatSeen = false;
  while (input_.readLine(line)) {
    const std::string_view keyword = nextWord(line);
    if (keyword == "end_header") {
      if (!formatSeen) bad("the header names no format");
      return;
    }
    if (keyword == "format") {
      readFormat(line);
      formatSeen = true;
    } else if (keyword == "element") {
      readElement(line);
    } else if (keyword == "property") {
      readProperty(line);
    } else if (keyword == "comment") {
      readComment(line);
    } else if (!keyword.empty() && keyword != "obj_info") {
      bad("header line {}: unknown keyword '{}'", input_.lineNumber(), keyword);
    }
  }
  bad("the header has no end_header");
}

void PlyFile::readFormat(std::string_view line) {
  const std::string_view name = nextWord(line);
  if (name == "ascii") {
    format_ = Format::kText;
  } else if (name == "binary_little_endian") {
    format_ = Format::kLittle;
  } else if (name == "binary_big_endian") {
    format_ = Format::kBig;
  } else {
    bad("header line {}: unknown format '{}'", input_.lineNumber(), name);
  }
}

void PlyFile::readElement(std::string_view line) {
  PlyElement element;
  element.name = nextWord(line);
  std::int64_t count = -1;
  if (!parseInteger(nextWord(line), count) || count < 0 || element.name.empty()) {
    bad("header line {}: an element needs a name and a count", input_.lineNumber());
  }
  for (const PlyElement& other : elements_) {
    if (other.name == element.name) bad("element {} is given twice", element.name);
  }
  element.count = static_cast<std::uint64_t>(count);
  elements_.push_back(std::move(element));
}

PlyType PlyFile::parseType(std::string_view word) const {
  using enum PlyType;
  static const std::map<std::string_view, PlyType> kTypes = {
      {"char", kInt8},   {"int8", kInt8},     {"uchar", kUint8},   {"uint8", kUint8},
      {"short", kInt16}, {"int16", kInt16},   {"ushort", kUint16}, {"uint16", kUint16},
      {"int", kInt32},   {"int32", kInt32},   {"uint", kUint32},   {"uint32", kUint32},
      {"float", kFloat}, {"float32", kFloat}, {"double", kDouble}, {"float64", kDouble}};
  const auto found = kTypes.find(word);
  if (found == kTypes.end()) bad("header line {}: unknown type '{}'", input_.lineNumber(), word);
  return found->second;
}

void PlyFile::readProperty(std::string_view line) {
  if (elements_.empty()) bad("header line {}: property before element", input_.lineNumber());
  PlyProperty property;
  std::string_view word = nextWord(line);
  if (word == "list") {
    property.isList = true;
    property.countType = parseType(nextWord(line));
    if (!isInteger(property.countType)) {
      bad("header line {}: a list's count must be an integer", input_.lineNumber());
    }
    word = nextWord(line);
  }
  property.type = parseType(word);
  property.name = nextWord(line);
  if (property.name.empty()) {
    bad("header line {}: property without a name", input_.lineNumber());
  }
  elements_.back().properties.push_back(std::move(property));
}

void PlyFile::readComment(std::string_view line) {
  constexpr std::size_t kMostTextures = 1000;
  if (nextWord(line) != "TextureFile" || textureFiles_.size() >= kMostTextures) return;
  if (!trimmed(line).empty()) textureFiles_.emplace_back(trimmed(line));
}

/// A row takes some bytes at least, so a count larger than the file can hold is a lie.
void PlyFile::checkCount(const PlyElement& element) const {
  std::uint64_t rowBytes = 0;
  for (const PlyProperty& p : element.properties) {
    rowBytes += isText() ? 2 : kTypeSize[static_cast<std::size_t>(p.isList ? p.countType : p.type)];
  }
  const std::uint64_t slack = isText() ? 1 : 0;  // no line end at the end
  if (rowBytes > 0 && element.count > (input_.remaining() + slack) / rowBytes) {
    bad("the header promises {} of element {}, more than the {} bytes that follow can hold",
        element.count, element.name, input_.remaining());
  }
  if (element.count > kMaxElements && !element.properties.empty()) {
    bad("{} of element {} are more than this program reads", element.count, element.name);
  }
}

double PlyFile::textScalar() {
  std::string_view word = nextWord(rest_);
  while (word.empty()) {
    if (!input_.readLine(rest_)) bad("the file ends too early (truncated)");
    word = nextWord(rest_);
  }
  double value = 0.0;
  if (parseNumber(word, value)) return value;
  if (badNumbers_++ == 0) {
    firstBadNumber_ = fmt::format("line {}: '{}'", input_.lineNumber(), word.substr(0, 40));
  }
  return std::nan("");
}

template <typename T>
T PlyFile::load() {
  std::array<std::uint8_t, sizeof(T)> bytes;
  std::memcpy(bytes.data(), input_.take(sizeof(T)), sizeof(T));
  if ((format_ == Format::kBig) != (std::endian::native == std::endian::big)) {
    std::reverse(bytes.begin(), bytes.end());
  }
  return std::bit_cast<T>(bytes);
}

double PlyFile::scalar(PlyType type) {
  if (isText()) return textScalar();
  switch (type) {
    case PlyType::kInt8:
      return load<std::int8_t>();
    case PlyType::kUint8:
      return load<std::uint8_t>();
    case PlyType::kInt16:
      return load<std::int16_t>();
    case PlyType::kUint16:
      return load<std::uint16_t>();
    case PlyType::kInt32:
      return load<std::int32_t>();
    case PlyType::kUint32:
      return load<std::uint32_t>();
    case PlyType::kFloat:
      return load<float>();
    case PlyType::kDouble:
      break;
  }
  return load<double>();
}

std::uint64_t PlyFile::listCount(const PlyProperty& property) {
  const double count = scalar(property.countType);
  if (!(count >= 0.0) || count != std::floor(count) ||
      count > static_cast<double>(input_.remaining() + rest_.size())) {
    bad("a list of {} {} is longer than the file, or its count is not a count", count,
        property.name);
  }
  return static_cast<std::uint64_t>(count);
}

void PlyFile::skip(const PlyProperty& property) {
  const std::uint64_t count = property.isList ? listCount(property) : 1;
  for (std::uint64_t i = 0; i < count; ++i) scalar(property.type);
}

void PlyFile::skip(const PlyElement& element) {
  if (element.properties.empty()) return;
  for (std::uint64_t i = 0; i < element.count; ++i) {
    for (const PlyProperty& property : element.properties) skip(property);
  }
}

}  // namespace trex::detail
