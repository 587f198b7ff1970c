#include "src/core/json_object.h"

#include <algorithm>
#include <cmath>

namespace trex {

using nlohmann::json;

JsonObject::JsonObject(const json& value, const JsonDocument& document, std::string pointer)
    : value_(value), document_(document), pointer_(std::move(pointer)) {
  if (!value.is_object()) bad("", "is not an object");
}

void JsonObject::allow(std::span<const char* const> keys) const {
  for (const auto& [key, unused] : value_.items()) {
    if (std::find(keys.begin(), keys.end(), key) == keys.end()) {
      bad(key.substr(0, 80).c_str(), "unknown key");
    }
  }
}

const json& JsonObject::at(const char* key) const {
  const auto found = value_.find(key);
  if (found == value_.end()) bad(key, "is missing");
  return *found;
}

JsonObject JsonObject::object(const char* key) const {
  return {at(key), document_, pointer_ + "/" + key};
}

const json& JsonObject::array(const char* key) const {
  const json& value = at(key);
  if (!value.is_array()) bad(key, "is not an array");
  return value;
}

JsonObject JsonObject::element(const char* key, std::size_t i) const {
  return {array(key)[i], document_, pointer_ + "/" + key + "/" + std::to_string(i)};
}

bool JsonObject::boolean(const char* key) const {
  const json& value = at(key);
  if (!value.is_boolean()) bad(key, "is neither true nor false");
  return value.get<bool>();
}

std::string JsonObject::text(const char* key) const {
  const json& value = at(key);
  if (!value.is_string()) bad(key, "is not a string");
  return value.get<std::string>();
}

double JsonObject::numberOf(const json& value, const char* key, double low, double high) const {
  if (!value.is_number()) bad(key, "is not a number");
  const double number = value.get<double>();
  if (!(number >= low && number <= high)) bad(key, "{} is out of range", number);
  return number;
}

double JsonObject::number(const char* key, double low, double high) const {
  return numberOf(at(key), key, low, high);
}

float JsonObject::real(const char* key, float low, float high) const {
  return static_cast<float>(numberOf(at(key), key, double{low}, double{high}));
}

std::uint64_t JsonObject::integer(const char* key, std::uint64_t low, std::uint64_t high) const {
  const json& value = at(key);
  if (!value.is_number_unsigned()) bad(key, "is not an integer of at least 0");
  const auto number = value.get<std::uint64_t>();
  if (number < low || number > high) bad(key, "{} is out of range", number);
  return number;
}

std::int64_t JsonObject::signedInteger(const char* key) const {
  const json& value = at(key);
  const bool fits = value.is_number_unsigned()
                        ? value.get<std::uint64_t>() <= std::uint64_t{1} << 62
                        : value.is_number_integer();
  if (!fits) bad(key, "is not an integer");
  return value.get<std::int64_t>();
}

std::size_t JsonObject::index(const char* key, std::size_t size) const {
  const json& value = at(key);
  if (!value.is_number_unsigned()) bad(key, "is not an integer of at least 0");
  const auto number = value.get<std::uint64_t>();
  if (number >= size) bad(key, "{} does not exist; there are {}", number, size);
  return static_cast<std::size_t>(number);
}

void JsonObject::numbers(const char* key, double* out, std::size_t count) const {
  const json& values = array(key);
  if (values.size() != count) bad(key, "has {} elements, not {}", values.size(), count);
  constexpr double kMost = std::numeric_limits<double>::max();
  for (std::size_t i = 0; i < count; ++i) out[i] = numberOf(values[i], key, -kMost, kMost);
}

void JsonObject::reals(const char* key, float* out, std::size_t count, float low,
                       float high) const {
  const json& values = array(key);
  if (values.size() != count) bad(key, "has {} elements, not {}", values.size(), count);
  for (std::size_t i = 0; i < count; ++i) {
    out[i] = static_cast<float>(numberOf(values[i], key, double{low}, double{high}));
  }
}

std::size_t JsonObject::oneOf(const char* key, std::initializer_list<const char*> words) const {
  const std::string word = text(key);
  const auto found = std::find(words.begin(), words.end(), word);
  if (found == words.end()) bad(key, "'{}' is not known", word.substr(0, 80));
  return static_cast<std::size_t>(found - words.begin());
}

}  // namespace trex
