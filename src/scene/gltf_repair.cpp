#include "src/scene/gltf_repair.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <nlohmann/json.hpp>

namespace trex::detail {
namespace {

using Json = nlohmann::json;

constexpr std::size_t kMostRepaired = std::size_t(64) << 20;

/// A list of the file, and an element of it that harms nobody.
struct GltfList {
  const char *key, *empty;
};
constexpr GltfList kLists[] = {
    {"bufferViews", R"({"buffer":0,"byteLength":0})"},
    {"accessors", R"({"componentType":5126,"count":0,"type":"SCALAR"})"},
    {"meshes", R"({"primitives":[]})"},
    {"nodes", "{}"},
    {"scenes", "{}"},
    {"materials", "{}"},
    {"textures", "{}"},
    {"samplers", "{}"},
    {"animations", R"({"channels":[],"samplers":[]})"},
    {"skins", R"({"joints":[]})"},
    {"cameras", R"({"type":"perspective","perspective":{"yfov":1,"znear":1}})"}};

Json alone(const char* key, Json value) {
  return {{"asset", {{"version", "2.0"}}}, {key, std::move(value)}};
}

std::string dumped(const Json& json) {
  return json.dump(-1, ' ', false, Json::error_handler_t::replace);
}

bool isIndex(const Json& object, const char* key, std::size_t size) {
  const auto found = object.find(key);
  return found != object.end() && found->is_number_unsigned() && found->get<std::uint64_t>() < size;
}

std::size_t sizeOf(const Json& document, const char* key) {
  const auto found = document.find(key);
  return found != document.end() && found->is_array() ? found->size() : 0;
}

class GltfRepair {
 public:
  GltfRepair(GltfContext& context, Json& document, const TryGltf& problemOf)
      : context_(context), document_(document), problemOf_(problemOf) {}

  void run() {
    if (Json& asset = document_["asset"]; !asset.contains("version")) {
      context_.replace("its asset tells no version; 2.0 is taken");
      asset["version"] = "2.0";
    }
    for (const GltfList& list : kLists) {
      if (sizeOf(document_, list.key) > 0) repairList(list);
    }
    if (sizeOf(document_, "meshes") > 0) dropBadIndices();
    if (!document_.contains("extensions")) return;
    const std::string problem = problemOf_(dumped(alone("extensions", document_["extensions"])));
    if (problem.empty()) return;
    context_.replace("extensions: {}; they are left out", problem);
    document_.erase("extensions");
  }

 private:
  void repairList(const GltfList& list) {
    Json& elements = document_[list.key];
    if (problemOf_(dumped(alone(list.key, withoutIndices(elements)))).empty()) return;
    for (std::size_t i = 0; i < elements.size(); ++i) {
      const std::string problem =
          problemOf_(dumped(alone(list.key, withoutIndices(Json::array({elements[i]})))));
      if (problem.empty()) continue;
      context_.replace("{} {}: {}; {}", list.key, i, problem, kLeftOut);
      elements[i] = Json::parse(list.empty);
    }
  }

  /// Of meshes: indices are refused where their accessors are not there too.
  static Json withoutIndices(Json elements) {
    for (Json& e : elements) {
      if (!e.is_object() || sizeOf(e, "primitives") == 0) continue;
      for (Json& p : e["primitives"]) {
        if (p.is_object()) p.erase("indices");
      }
    }
    return elements;
  }

  void dropBadIndices() {
    Json& meshes = document_["meshes"];
    for (std::size_t m = 0; m < meshes.size(); ++m) {
      if (!meshes[m].is_object() || sizeOf(meshes[m], "primitives") == 0) continue;
      Json kept = Json::array();
      Json& primitives = meshes[m]["primitives"];
      for (std::size_t i = 0; i < primitives.size(); ++i) {
        if (hasGoodIndices(primitives[i])) {
          kept.push_back(std::move(primitives[i]));
        } else {
          context_.replace("mesh {} primitive {}: its indices have no accessor with data; {}", m, i,
                           kLeftOut);
        }
      }
      primitives = std::move(kept);
    }
  }

  bool hasGoodIndices(const Json& primitive) const {
    if (!primitive.is_object() || !primitive.contains("indices")) return true;
    if (!isIndex(primitive, "indices", sizeOf(document_, "accessors"))) return false;
    const Json& accessor = document_["accessors"][primitive["indices"].get<std::size_t>()];
    return isIndex(accessor, "bufferView", sizeOf(document_, "bufferViews"));
  }

  GltfContext& context_;
  Json& document_;
  const TryGltf& problemOf_;
};

/// JSON with 0 for what is no number in it, though some exporters write it.
std::string finite(const std::string& json, std::uint64_t& count) {
  constexpr std::array<std::string_view, 6> kWords = {"Infinity", "-Infinity", "NaN",
                                                      "-NaN",     "nan",       "inf"};
  constexpr std::string_view kFirst = "INni-";
  std::string out;
  bool inText = false;
  for (std::size_t i = 0; i < json.size(); ++i) {
    const std::string_view rest = std::string_view(json).substr(i);
    const bool mayBegin = !inText && kFirst.find(json[i]) != kFirst.npos;
    const auto word = std::find_if(kWords.begin(), kWords.end(), [&](std::string_view w) {
      return mayBegin && rest.starts_with(w);
    });
    if (word != kWords.end()) {
      out.push_back('0');
      ++count;
      i += word->size() - 1;
      continue;
    }
    inText ^= json[i] == '"';
    out.push_back(json[i]);
    if (inText && json[i] == '\\' && i + 1 < json.size()) out.push_back(json[++i]);
  }
  return out;
}

/// Counts and indices that were written as 3.0.
void makeWhole(Json& json) {
  if (json.is_structured()) {
    for (Json& part : json) makeWhole(part);
  } else if (json.is_number_float()) {
    const double value = json.get<double>();
    if (std::abs(value) < 0x1p53 && std::trunc(value) == value)
      json = static_cast<std::int64_t>(value);
  }
}

}  // namespace

std::string repairedGltf(GltfContext& context, const std::string& json, const TryGltf& problemOf) {
  if (json.size() > kMostRepaired) return {};
  Json document = Json::parse(json, nullptr, false);
  if (document.is_discarded()) {
    std::uint64_t count = 0;
    document = Json::parse(finite(json, count), nullptr, false);
    if (document.is_object() && count > 0) {
      context.scene.replaced.add(
          fmt::format("{}: {} numbers are not finite; 0 is used", context.name, count), count);
    }
  }
  if (!document.is_object() || !document.contains("asset") || !document["asset"].is_object()) {
    return {};  // some other JSON
  }
  makeWhole(document);
  GltfRepair(context, document, problemOf).run();
  return dumped(document);
}

}  // namespace trex::detail
