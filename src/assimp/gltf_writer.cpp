#include "src/assimp/gltf_writer.h"

#include <cstring>
#include <stdexcept>

namespace trex {
namespace {

constexpr int kFloat = 5126, kUnsigned = 5125;
constexpr std::size_t kMostBytes = 0xffff0000u;

void put32(std::vector<std::uint8_t>& out, std::size_t value) {
  for (int k = 0; k < 4; ++k) out.push_back(static_cast<std::uint8_t>(value >> (8 * k)));
}

template <typename T>
std::span<const std::uint8_t> bytesOf(const std::vector<T>& values) {
  return {reinterpret_cast<const std::uint8_t*>(values.data()), values.size() * sizeof(T)};
}

}  // namespace

GltfWriter::GltfWriter() {
  root_["asset"]["version"] = "2.0";
  root_["scene"] = 0;
}

int GltfWriter::add(const char* list, Json object) {
  root_[list].push_back(std::move(object));
  return static_cast<int>(root_[list].size()) - 1;
}

int GltfWriter::addView(std::span<const std::uint8_t> bytes) {
  data_.resize((data_.size() + 3) / 4 * 4);
  if (bytes.size() > kMostBytes - data_.size()) throw std::length_error("more than 4 GiB");
  const std::size_t offset = data_.size();
  data_.insert(data_.end(), bytes.begin(), bytes.end());
  return add("bufferViews", {{"buffer", 0}, {"byteOffset", offset}, {"byteLength", bytes.size()}});
}

int GltfWriter::addFloats(const std::vector<float>& values, const char* type,
                          std::size_t components) {
  return add("accessors", {{"bufferView", addView(bytesOf(values))},
                           {"componentType", kFloat},
                           {"type", type},
                           {"count", values.size() / components}});
}

int GltfWriter::addIndices(const std::vector<std::uint32_t>& values) {
  return add("accessors", {{"bufferView", addView(bytesOf(values))},
                           {"componentType", kUnsigned},
                           {"type", "SCALAR"},
                           {"count", values.size()}});
}

std::vector<std::uint8_t> GltfWriter::finish() {
  if (!extensions_.empty()) root_["extensionsUsed"] = extensions_;
  root_["asset"]["extras"] = {{"replaced", replaced_}, {"warnings", warnings_}, {"files", files_}};
  if (!data_.empty()) root_["buffers"] = Json::array({{{"byteLength", data_.size()}}});
  std::string json = root_.dump(-1, ' ', false, Json::error_handler_t::replace);
  json.resize((json.size() + 3) / 4 * 4, ' ');
  data_.resize((data_.size() + 3) / 4 * 4);
  const std::size_t total = 12 + 8 + json.size() + (data_.empty() ? 0 : 8 + data_.size());
  if (total > kMostBytes) throw std::length_error("more than 4 GiB");
  std::vector<std::uint8_t> out = {'g', 'l', 'T', 'F'};
  out.reserve(total);
  put32(out, 2);
  put32(out, total);
  put32(out, json.size());
  put32(out, 0x4e4f534a);  // JSON
  out.insert(out.end(), json.begin(), json.end());
  if (data_.empty()) return out;
  put32(out, data_.size());
  put32(out, 0x004e4942);  // BIN
  out.insert(out.end(), data_.begin(), data_.end());
  return out;
}

}  // namespace trex
