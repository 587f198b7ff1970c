#include "src/scene/gltf_repair.h"

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

}  // namespace

std::string repairedGltf(GltfContext& context, const std::string& json, const TryGltf& problemOf) {
  if (json.size() > kMostRepaired) return {};
  Json document = Json::parse(json, nullptr, false);
  if (!document.is_object() || !document.contains("asset") || !document["asset"].is_object()) {
    return {};  // some other JSON
  }
  GltfRepair(context, document, problemOf).run();
  return dumped(document);
}

}  // namespace trex::detail
