// Reading JSON that may be hostile: every value is checked, every error names its JSON pointer.
#pragma once

#include <cstdint>
#include <initializer_list>
#include <limits>
#include <nlohmann/json.hpp>
#include <span>
#include <string>

#include "src/core/error.h"

namespace trex {

/// A document as messages name it: "look.json" or "X.trex: scene.json", and what a reader can do
/// about a bad one ("; bake again"), or nothing.
struct JsonDocument {
  std::string name, advice;
};

/// An object of a JSON document. All calls throw Error(kInput).
class JsonObject {
 public:
  /// `document` and `pointer` are for messages; `value` and `document` must outlive this.
  JsonObject(const nlohmann::json& value, const JsonDocument& document, std::string pointer);

  /// Throws for a key that is not in the list.
  void allow(std::span<const char* const> keys) const;
  void allow(std::initializer_list<const char*> keys) const {
    allow(std::span<const char* const>(keys.begin(), keys.size()));
  }
  bool has(const char* key) const { return value_.contains(key); }
  JsonObject object(const char* key) const;
  const nlohmann::json& array(const char* key) const;
  /// Element i of the array at key, an object.
  JsonObject element(const char* key, std::size_t i) const;

  bool boolean(const char* key) const;
  std::string text(const char* key) const;
  double number(const char* key, double low = -std::numeric_limits<double>::max(),
                double high = std::numeric_limits<double>::max()) const;
  /// A number that a float holds exactly.
  float real(const char* key, float low = -std::numeric_limits<float>::max(),
             float high = std::numeric_limits<float>::max()) const;
  std::uint64_t integer(const char* key, std::uint64_t low, std::uint64_t high) const;
  std::int64_t signedInteger(const char* key) const;
  /// An index into something of `size` elements.
  std::size_t index(const char* key, std::size_t size) const;
  /// An array of exactly `count` numbers.
  void numbers(const char* key, double* out, std::size_t count) const;
  void reals(const char* key, float* out, std::size_t count,
             float low = -std::numeric_limits<float>::max(),
             float high = std::numeric_limits<float>::max()) const;
  /// The number of the word in the list.
  std::size_t oneOf(const char* key, std::initializer_list<const char*> words) const;

  template <typename... Args>
  [[noreturn]] void bad(const char* key, fmt::format_string<Args...> format, Args&&... args) const {
    fail(ExitCode::kInput, "{}, {}{}{}: {}{}", document_.name, pointer_, *key ? "/" : "", key,
         fmt::format(format, std::forward<Args>(args)...), document_.advice);
  }

 private:
  const nlohmann::json& at(const char* key) const;
  double numberOf(const nlohmann::json& value, const char* key, double low, double high) const;

  const nlohmann::json& value_;
  const JsonDocument& document_;
  std::string pointer_;
};

}  // namespace trex
