// Mutates JSON as a tree, so that the text stays valid and the checks behind the parser are
// reached.
#pragma once

#include <array>
#include <nlohmann/json.hpp>
#include <random>
#include <string>
#include <vector>

namespace trex::fuzz {

using Json = nlohmann::json;

inline void collect(Json& value, std::vector<Json*>& into) {
  into.push_back(&value);
  if (!value.is_structured()) return;
  for (Json& child : value) collect(child, into);
}

inline Json strangeValue(std::minstd_rand& random) {
  static const std::array<Json, 30> kValues = {-1,
                                               0,
                                               1,
                                               2,
                                               3,
                                               4,
                                               5,
                                               6,
                                               9,
                                               255,
                                               5120,
                                               5121,
                                               5122,
                                               5123,
                                               5125,
                                               5126,
                                               65536,
                                               1 << 30,
                                               2147483648,
                                               4294967295,
                                               9223372036854775808ull,
                                               -0.5,
                                               1e-40,
                                               1e39,
                                               1e308,
                                               nullptr,
                                               true,
                                               "",
                                               Json::array(),
                                               Json::object()};
  return kValues[random() % kValues.size()];
}

/// Replaces, copies or removes one value. The empty string if `text` is not JSON.
inline std::string mutateJson(const char* text, std::size_t size, std::minstd_rand& random) {
  Json root = Json::parse(text, text + size, nullptr, false);
  if (root.is_discarded()) return "";
  std::vector<Json*> all;
  collect(root, all);
  for (unsigned changes = 1 + random() % 3; changes > 0; --changes) {
    Json& value = *all[random() % all.size()];
    const unsigned kind = random() % 8;
    if (kind < 4 && !value.is_structured()) {
      value = strangeValue(random);
    } else if (kind == 4 && value.is_structured() && !value.empty()) {
      auto victim = value.begin();
      std::advance(victim, random() % value.size());
      value.erase(victim);
      break;  // The list holds addresses of what is gone.
    } else if (kind == 5 && value.is_array() && !value.empty()) {
      value.push_back(Json(value[random() % value.size()]));
      break;
    } else {
      value = kind == 6 ? strangeValue(random) : Json(*all[random() % all.size()]);
      break;
    }
  }
  return root.dump(-1, ' ', false, Json::error_handler_t::replace);
}

}  // namespace trex::fuzz
