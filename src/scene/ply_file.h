// The header and the numbers of PLY files (G. Turk, "The PLY Polygon File Format", 1994).
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "src/core/error.h"
#include "src/scene/input_file.h"

namespace trex::detail {

enum class PlyType : std::uint8_t {
  kInt8,
  kUint8,
  kInt16,
  kUint16,
  kInt32,
  kUint32,
  kFloat,
  kDouble
};

inline bool isInteger(PlyType type) { return type < PlyType::kFloat; }

struct PlyProperty {
  std::string name;
  PlyType type = PlyType::kFloat;
  bool isList = false;
  PlyType countType = PlyType::kUint8;
};

struct PlyElement {
  std::string name;
  std::uint64_t count = 0;
  std::vector<PlyProperty> properties;
};

/// A PLY file, read from front to back: the header at once, then one number after another, in the
/// order of elements and properties. Text and binary of both byte orders.
class PlyFile {
 public:
  /// Throws Error(kInput) if the header is wrong.
  explicit PlyFile(const std::filesystem::path& path);

  const std::string& name() const { return input_.name(); }
  const std::vector<PlyElement>& elements() const { return elements_; }
  /// File names of `comment TextureFile`, in their order.
  const std::vector<std::string>& textureFiles() const { return textureFiles_; }
  bool isText() const { return format_ == Format::kText; }
  std::uint64_t remaining() const { return input_.remaining(); }

  /// Throws Error(kInput) if the file is too short for an element of that many rows.
  void checkCount(const PlyElement& element) const;
  /// The next number. Of text, what is no number is not-a-number and counted.
  double scalar(PlyType type);
  /// The next number as the length of a list. Throws Error(kInput) if the rest of the file is
  /// shorter.
  std::uint64_t listCount(const PlyProperty& property);
  void skip(const PlyProperty& property);
  void skip(const PlyElement& element);

  /// Words of text that should have been numbers so far; the line and the text of the first.
  std::uint64_t badNumbers() const { return badNumbers_; }
  const std::string& firstBadNumber() const { return firstBadNumber_; }

  template <typename... Args>
  [[noreturn]] void bad(fmt::format_string<Args...> format, Args&&... args) const {
    fail(ExitCode::kInput, "{}: {}", input_.name(),
         fmt::format(format, std::forward<Args>(args)...));
  }

 private:
  enum class Format { kText, kLittle, kBig };

  void readHeader();
  void readFormat(std::string_view line);
  void readElement(std::string_view line);
  void readProperty(std::string_view line);
  void readComment(std::string_view line);
  PlyType parseType(std::string_view word) const;
  double textScalar();
  template <typename T>
  T load();

  InputFile input_;
  Format format_ = Format::kText;
  std::vector<PlyElement> elements_;
  std::vector<std::string> textureFiles_;
  std::string_view rest_;  ///< of the current line, text only
  std::uint64_t badNumbers_ = 0;
  std::string firstBadNumber_;
};

}  // namespace trex::detail
