// Materials, lights and cameras as JSON: what bundles and looks share. Keys are in snake_case with
// their unit; numbers survive the way there and back to the bit.
#pragma once

#include <nlohmann/json.hpp>

#include "src/core/json_object.h"
#include "src/scene/scene.h"

namespace trex {

using OrderedJson = nlohmann::ordered_json;

/// Any GLM vector as an array.
template <typename Vector>
OrderedJson jsonList(const Vector& v) {
  OrderedJson out = OrderedJson::array();
  for (int i = 0; i < v.length(); ++i) out.push_back(double{v[i]});
  return out;
}

vec3 jsonVector(const JsonObject& o, const char* key,
                float low = -std::numeric_limits<float>::max(),
                float high = std::numeric_limits<float>::max());
/// Of length 1, within 1e-3.
vec3 jsonUnitVector(const JsonObject& o, const char* key);

/// All of a material but its textures. An infinite attenuation distance is left out.
OrderedJson materialJson(const Material& m);
OrderedJson lightJson(const Light& l);
OrderedJson cameraJson(const Camera& c);

/// Keys of materialJson().
const std::vector<const char*>& materialKeys();
/// Reads what materialJson() writes into `m`. A missing key throws if `all`, else keeps m's value.
void readMaterialJson(const JsonObject& o, Material& m, bool all);
Light readLightJson(const JsonObject& o);
Camera readCameraJson(const JsonObject& o);

}  // namespace trex
