#include "src/scene/gltf_compressed.h"

#include <draco/compression/decode.h>
#include <meshoptimizer.h>

#include <nlohmann/json.hpp>

#include "src/scene/gltf_file.h"

namespace trex::detail {
namespace {

constexpr const char* kMeshopt = "EXT_meshopt_compression";
constexpr const char* kDraco = "KHR_draco_mesh_compression";

/// Bytes that one byte of meshopt's vertex codec becomes at most, and of draco's with room to
/// spare.
constexpr std::uint64_t kMostMeshoptRatio = 256, kMostDracoRatio = 4096;

using Json = nlohmann::json;

/// The extension of a buffer view or buffer, or null.
Json* meshoptOf(Json& object) {
  if (!object.is_object()) return nullptr;
  const auto extensions = object.find("extensions");
  if (extensions == object.end() || !extensions->is_object()) return nullptr;
  const auto found = extensions->find(kMeshopt);
  return found == extensions->end() || !found->is_object() ? nullptr : &*found;
}

/// Views that meshopt compressed become plain views of their compressed bytes.
void plainViews(Json& document) {
  const auto views = document.find("bufferViews");
  if (views == document.end() || !views->is_array()) return;
  for (Json& view : *views) {
    const Json* extension = meshoptOf(view);
    if (extension == nullptr) continue;
    const Json from = *extension;
    view["byteOffset"] = 0;
    for (const char* key : {"buffer", "byteOffset", "byteLength"}) {
      if (from.contains(key)) view[key] = from[key];
    }
    view.erase("byteStride");
  }
}

/// Draco's primitives need no accessors with views for their indices, but tinygltf asks for them.
void dropDracoIndices(Json& document) {
  const auto meshes = document.find("meshes");
  if (meshes == document.end() || !meshes->is_array()) return;
  for (Json& mesh : *meshes) {
    if (!mesh.is_object() || !mesh.contains("primitives") || !mesh["primitives"].is_array()) {
      continue;
    }
    for (Json& p : mesh["primitives"]) {
      if (p.is_object() && p.contains("extensions") && p["extensions"].is_object() &&
          p["extensions"].contains(kDraco)) {
        p.erase("indices");
      }
    }
  }
}

/// How a view is compressed.
struct View {
  std::uint64_t count = 0, stride = 0;
  std::string mode, filter;
};

View readView(const GltfContext& context, const tinygltf::Value& e, std::size_t number) {
  const auto text = [&](const char* key) {
    return e.Has(key) && e.Get(key).IsString() ? e.Get(key).Get<std::string>() : std::string();
  };
  const auto integer = [&](const char* key) {
    const int value = e.Has(key) && e.Get(key).IsNumber() ? indexOf(e.Get(key)) : kNone;
    if (value < 0) context.bad("bufferView {}: {} has no {}", number, kMeshopt, key);
    return static_cast<std::uint64_t>(value);
  };
  return {integer("count"), integer("byteStride"), text("mode"), text("filter")};
}

bool decode(const View& v, std::span<const std::uint8_t> from, std::vector<std::uint8_t>& to) {
  if (v.mode == "ATTRIBUTES") {
    if (v.stride == 0 || v.stride > 256 || v.stride % 4 != 0) return false;
    return meshopt_decodeVertexBuffer(to.data(), v.count, v.stride, from.data(), from.size()) == 0;
  }
  if (v.stride != 2 && v.stride != 4) return false;
  if (v.mode == "TRIANGLES") {
    return v.count % 3 == 0 &&
           meshopt_decodeIndexBuffer(to.data(), v.count, v.stride, from.data(), from.size()) == 0;
  }
  return v.mode == "INDICES" &&
         meshopt_decodeIndexSequence(to.data(), v.count, v.stride, from.data(), from.size()) == 0;
}

bool applyFilter(const View& v, std::vector<std::uint8_t>& data) {
  if (v.filter.empty() || v.filter == "NONE") return true;
  if (v.mode != "ATTRIBUTES") return false;
  if (v.filter == "OCTAHEDRAL" && (v.stride == 4 || v.stride == 8)) {
    meshopt_decodeFilterOct(data.data(), v.count, v.stride);
  } else if (v.filter == "QUATERNION" && v.stride == 8) {
    meshopt_decodeFilterQuat(data.data(), v.count, v.stride);
  } else if (v.filter == "EXPONENTIAL") {
    meshopt_decodeFilterExp(data.data(), v.count, v.stride);
  } else {
    return false;
  }
  return true;
}

/// Values of a draco attribute at all points, as an accessor's component type wants them.
template <typename T>
bool fillValues(const draco::PointAttribute& attribute, std::uint32_t points, int components,
                std::vector<std::uint8_t>& out) {
  out.resize(std::size_t{points} * components * sizeof(T));
  std::array<T, 16> value{};
  for (std::uint32_t i = 0; i < points; ++i) {
    const auto at = attribute.mapped_index(draco::PointIndex(i));
    if (at.value() >= attribute.size() ||
        !attribute.ConvertValue<T>(at, static_cast<std::int8_t>(components), value.data())) {
      return false;
    }
    std::memcpy(out.data() + std::size_t{i} * components * sizeof(T), value.data(),
                components * sizeof(T));
  }
  return true;
}

bool fillValues(const draco::PointAttribute& attribute, std::uint32_t points, int components,
                int type, std::vector<std::uint8_t>& out) {
  switch (type) {
    case TINYGLTF_COMPONENT_TYPE_BYTE:
      return fillValues<std::int8_t>(attribute, points, components, out);
    case TINYGLTF_COMPONENT_TYPE_UNSIGNED_BYTE:
      return fillValues<std::uint8_t>(attribute, points, components, out);
    case TINYGLTF_COMPONENT_TYPE_SHORT:
      return fillValues<std::int16_t>(attribute, points, components, out);
    case TINYGLTF_COMPONENT_TYPE_UNSIGNED_SHORT:
      return fillValues<std::uint16_t>(attribute, points, components, out);
    case TINYGLTF_COMPONENT_TYPE_UNSIGNED_INT:
      return fillValues<std::uint32_t>(attribute, points, components, out);
    case TINYGLTF_COMPONENT_TYPE_FLOAT:
      return fillValues<float>(attribute, points, components, out);
    default:
      return false;
  }
}

/// A copy of an accessor over values of its own; returns its number.
int addAccessor(GltfContext& context, tinygltf::Accessor accessor, std::uint64_t count,
                std::vector<std::uint8_t> data) {
  accessor.bufferView = static_cast<int>(context.model.bufferViews.size());
  accessor.byteOffset = 0;
  accessor.count = count;
  accessor.sparse.isSparse = false;
  setData(context, context.model.bufferViews.emplace_back(), std::move(data));
  context.model.accessors.push_back(std::move(accessor));
  return static_cast<int>(context.model.accessors.size()) - 1;
}

const tinygltf::Accessor& accessorAt(const GltfContext& context, int number) {
  if (number < 0 || std::size_t(number) >= context.model.accessors.size()) {
    context.bad("accessor {} does not exist; there are {}", number, context.model.accessors.size());
  }
  return context.model.accessors[number];
}

std::unique_ptr<draco::Mesh> decodeMesh(const GltfContext& context,
                                        std::span<const std::uint8_t> bytes,
                                        const std::string& where) {
  draco::DecoderBuffer buffer;
  buffer.Init(reinterpret_cast<const char*>(bytes.data()), bytes.size());
  draco::Decoder decoder;
  auto mesh = decoder.DecodeMeshFromBuffer(&buffer);
  if (!mesh.ok()) {
    context.bad("{}: {} can't be decoded: {}", where, kDraco,
                oneLine(mesh.status().error_msg_string()));
  }
  return std::move(mesh).value();
}

int dracoIndices(GltfContext& context, const draco::Mesh& mesh) {
  tinygltf::Accessor accessor;
  accessor.type = TINYGLTF_TYPE_SCALAR;
  accessor.componentType = TINYGLTF_COMPONENT_TYPE_UNSIGNED_INT;
  std::vector<std::uint8_t> data(std::size_t{mesh.num_faces()} * 12);
  for (std::uint32_t f = 0; f < mesh.num_faces(); ++f) {
    const draco::Mesh::Face& face = mesh.face(draco::FaceIndex(f));
    const std::array<std::uint32_t, 3> corners = {face[0].value(), face[1].value(),
                                                  face[2].value()};
    std::memcpy(data.data() + std::size_t{f} * 12, corners.data(), 12);
  }
  return addAccessor(context, std::move(accessor), std::uint64_t{mesh.num_faces()} * 3,
                     std::move(data));
}

}  // namespace

void makeReadable(std::string& json) {
  if (json.find(kMeshopt) == json.npos && json.find(kDraco) == json.npos) return;
  Json document = Json::parse(json, nullptr, false);
  if (!document.is_object()) return;  // the reader says what is wrong
  plainViews(document);
  dropDracoIndices(document);
  json = document.dump(-1, ' ', false, Json::error_handler_t::replace);
}

void decodeMeshopt(GltfContext& context) {
  auto& views = context.model.bufferViews;
  for (std::size_t i = 0; i < views.size(); ++i) {
    const auto found = views[i].extensions.find(kMeshopt);
    if (found == views[i].extensions.end()) continue;
    const bool good = context.attempt("what it holds is left out", [&] {
      const View view = readView(context, found->second, i);
      const auto from = bytesOfView(context, static_cast<int>(i));
      if (view.count * view.stride > kMostMeshoptRatio * from.size()) {
        context.bad("bufferView {}: {} bytes can't hold {} elements of {}", i, from.size(),
                    view.count, view.stride);
      }
      std::vector<std::uint8_t> data(view.count * view.stride);
      if (!decode(view, from, data) || !applyFilter(view, data)) {
        context.bad("bufferView {}: {} can't be decoded (mode '{:.20}', filter '{:.20}')", i,
                    kMeshopt, view.mode, view.filter);
      }
      setData(context, views[i], std::move(data));
      views[i].byteStride = view.mode == "ATTRIBUTES" ? view.stride : 0;
    });
    if (!good) views[i].byteLength = 0;
  }
}

tinygltf::Primitive decodeDraco(GltfContext& context, const tinygltf::Primitive& p,
                                const std::string& where) {
  const auto found = p.extensions.find(kDraco);
  if (found == p.extensions.end()) return p;
  const tinygltf::Value& e = found->second;
  if (!e.IsObject() || !e.Has("bufferView") || !e.Get("bufferView").IsNumber() ||
      !e.Has("attributes") || !e.Get("attributes").IsObject()) {
    context.bad("{}: {} has no bufferView or attributes", where, kDraco);
  }
  const auto bytes = bytesOfView(context, indexOf(e.Get("bufferView")));
  std::uint64_t promised = 0;
  for (const auto& [name, index] : p.attributes) promised += accessorAt(context, index).count;
  if (promised > kMostDracoRatio * bytes.size()) {
    context.bad("{}: {} bytes can't hold what its accessors promise", where, bytes.size());
  }
  const std::unique_ptr<draco::Mesh> mesh = decodeMesh(context, bytes, where);
  tinygltf::Primitive plain = p;
  plain.extensions.erase(kDraco);
  const tinygltf::Value& attributes = e.Get("attributes");
  for (const std::string& name : attributes.Keys()) {
    const auto at = plain.attributes.find(name);
    if (at == plain.attributes.end() || !attributes.Get(name).IsNumber()) continue;
    const tinygltf::Accessor accessor = accessorAt(context, at->second);
    const auto id = static_cast<std::uint32_t>(std::max(indexOf(attributes.Get(name)), 0));
    const draco::PointAttribute* attribute = mesh->GetAttributeByUniqueId(id);
    const int components =
        tinygltf::GetNumComponentsInType(static_cast<std::uint32_t>(accessor.type));
    std::vector<std::uint8_t> data;
    if (attribute == nullptr || components < 1 || components > 4 ||
        !fillValues(*attribute, mesh->num_points(), components, accessor.componentType, data)) {
      context.bad("{}: {} has no attribute {} for {}", where, kDraco, id, name);
    }
    at->second = addAccessor(context, accessor, mesh->num_points(), std::move(data));
  }
  plain.indices = dracoIndices(context, *mesh);
  plain.mode = TINYGLTF_MODE_TRIANGLES;
  return plain;
}

}  // namespace trex::detail
