// Small model files that the scene tests write for themselves.
#pragma once

#include <gtest/gtest.h>
#include <unistd.h>

#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "src/core/error.h"
#include "src/core/log.h"
#include "src/scene/import.h"

namespace trex::test {

using nlohmann::json;

/// A folder that is removed at the end of the test.
class SceneTest : public ::testing::Test {
 protected:
  void SetUp() override {
    setLogLevel(LogLevel::kError);
    const auto* info = ::testing::UnitTest::GetInstance()->current_test_info();
    std::string name = std::string(info->test_suite_name()) + "_" + info->name();
    for (char& c : name) c = c == '/' ? '_' : c;
    folder_ =
        std::filesystem::temp_directory_path() / ("trex_" + name + "_" + std::to_string(getpid()));
    std::filesystem::create_directories(folder_);
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }

  std::filesystem::path write(const std::string& name, const std::string& bytes) const {
    std::ofstream(folder_ / name, std::ios::binary) << bytes;
    return folder_ / name;
  }
  Scene import(const std::string& name, const std::string& bytes,
               const ImportOptions& options = {}) const {
    return importScene(write(name, bytes), options);
  }

  std::filesystem::path folder_;
};

template <typename T>
std::string bytesOf(const std::vector<T>& values) {
  return {reinterpret_cast<const char*>(values.data()), values.size() * sizeof(T)};
}

/// Builds a .glb piece by piece.
struct GlbBuilder {
  json doc = {{"asset", {{"version", "2.0"}}}, {"scene", 0}};
  std::string bin;

  int view(const std::string& bytes, int stride = 0) {
    bin.resize((bin.size() + 3) / 4 * 4);
    json v = {{"buffer", 0}, {"byteOffset", bin.size()}, {"byteLength", bytes.size()}};
    if (stride > 0) v["byteStride"] = stride;
    bin += bytes;
    doc["bufferViews"].push_back(v);
    return int(doc["bufferViews"].size()) - 1;
  }
  template <typename T>
  int accessor(const std::vector<T>& values, int componentType, const std::string& type,
               std::size_t count, bool normalized = false) {
    const int v = view(bytesOf(values));
    json a = {
        {"bufferView", v}, {"componentType", componentType}, {"type", type}, {"count", count}};
    if (normalized) a["normalized"] = true;
    doc["accessors"].push_back(a);
    return int(doc["accessors"].size()) - 1;
  }
  int floats(const std::vector<float>& values, const std::string& type = "VEC3") {
    const std::size_t n = type == "VEC4" ? 4 : type == "VEC3" ? 3 : type == "VEC2" ? 2 : 1;
    return accessor(values, 5126, type, values.size() / n);
  }
  int mesh(const json& primitive) {
    doc["meshes"].push_back({{"name", "m"}, {"primitives", json::array({primitive})}});
    return int(doc["meshes"].size()) - 1;
  }
  int node(json n) {
    doc["nodes"].push_back(std::move(n));
    const int index = int(doc["nodes"].size()) - 1;
    if (!doc.contains("scenes")) doc["scenes"] = {{{"nodes", json::array()}}};
    doc["scenes"][0]["nodes"].push_back(index);
    return index;
  }
  std::string json_() {
    if (!bin.empty() && !doc.contains("buffers")) {
      doc["buffers"] = json::array({{{"byteLength", bin.size()}}});
    }
    return doc.dump();
  }
  std::string glb() {
    std::string text = json_();
    text.resize((text.size() + 3) / 4 * 4, ' ');
    std::string data = bin;
    data.resize((data.size() + 3) / 4 * 4);
    const auto u32 = [](std::size_t v) {
      const auto u = static_cast<std::uint32_t>(v);
      return std::string(reinterpret_cast<const char*>(&u), 4);
    };
    std::string out =
        "glTF" + u32(2) + u32(20 + text.size() + (data.empty() ? 0 : 8 + data.size()));
    out += u32(text.size()) + "JSON" + text;
    if (!data.empty()) out += u32(data.size()) + std::string("BIN\0", 4) + data;
    return out;
  }
};

/// One triangle in a node; positions are accessor 0, buffer view 0.
inline GlbBuilder triangleGlb() {
  GlbBuilder b;
  const int p = b.floats({0, 0, 0, 1, 0, 0, 0, 1, 0});
  b.node({{"mesh", b.mesh({{"attributes", {{"POSITION", p}}}})}});
  return b;
}

/// A 2x2 RGB PNG, stored without compression: red, green; blue, white.
std::string tinyPng();

std::string base64(const std::string& bytes);

inline bool anyReplaced(const Scene& scene, const std::string& part) {
  for (const std::string& text : scene.replaced.texts) {
    if (text.find(part) != std::string::npos) return true;
  }
  return false;
}

/// What was said on import, of replaced parts too.
inline bool anyWarning(const Scene& scene, const std::string& part) {
  for (const std::string& w : scene.warnings) {
    if (w.find(part) != std::string::npos) return true;
  }
  return anyReplaced(scene, part);
}

}  // namespace trex::test
