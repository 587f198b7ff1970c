// Puts binary glTF together.
#pragma once

#include <cstdint>
#include <map>
#include <nlohmann/json.hpp>
#include <set>
#include <span>
#include <string>
#include <vector>

namespace trex {

class GltfWriter {
 public:
  using Json = nlohmann::json;

  GltfWriter();

  /// Adds to a list of the document; returns the number of the object in it.
  int add(const char* list, Json object);
  Json& root() { return root_; }

  int addView(std::span<const std::uint8_t> bytes);
  /// An accessor of floats: `type` is SCALAR, VEC2, VEC3 or VEC4, of `components` numbers.
  int addFloats(const std::vector<float>& values, const char* type, std::size_t components);
  int addIndices(const std::vector<std::uint32_t>& values);
  void useExtension(const char* name) { extensions_.insert(name); }

  /// Parts that are not shown as the file has them; a text is kept once.
  void replaced(const std::string& text) { replaced_.insert(text); }
  void warn(const std::string& text) { warnings_.insert(text); }
  void usedFiles(std::vector<std::string> files) { files_ = std::move(files); }

  /// Throws std::length_error beyond the 4 GiB that the format can have.
  std::vector<std::uint8_t> finish();

 private:
  Json root_;
  std::vector<std::uint8_t> data_;
  std::set<std::string> extensions_, replaced_, warnings_;
  std::vector<std::string> files_;
};

}  // namespace trex
