#include <algorithm>

#include "src/scene/gltf_file.h"

namespace trex::detail {
namespace {

/// Elements of an accessor without data of its own (all zero) that are believed.
constexpr std::uint64_t kMaxWithoutData = std::uint64_t(1) << 24;

int componentBytes(int type) {
  switch (type) {
    case TINYGLTF_COMPONENT_TYPE_BYTE:
    case TINYGLTF_COMPONENT_TYPE_UNSIGNED_BYTE:
      return 1;
    case TINYGLTF_COMPONENT_TYPE_SHORT:
    case TINYGLTF_COMPONENT_TYPE_UNSIGNED_SHORT:
      return 2;
    case TINYGLTF_COMPONENT_TYPE_UNSIGNED_INT:
    case TINYGLTF_COMPONENT_TYPE_FLOAT:
      return 4;
    default:
      return 0;
  }
}

int componentCount(int type) {
  switch (type) {
    case TINYGLTF_TYPE_SCALAR:
      return 1;
    case TINYGLTF_TYPE_VEC2:
      return 2;
    case TINYGLTF_TYPE_VEC3:
      return 3;
    case TINYGLTF_TYPE_VEC4:
      return 4;
    case TINYGLTF_TYPE_MAT4:
      return 16;
    default:
      return 0;
  }
}

template <typename T>
T load(const std::uint8_t* p) {
  T value;
  std::memcpy(&value, p, sizeof value);
  return value;
}

/// glTF is little-endian, and so is every machine this program runs on.
std::uint32_t loadIndex(const std::uint8_t* p, int type) {
  if (type == TINYGLTF_COMPONENT_TYPE_UNSIGNED_BYTE) return *p;
  if (type == TINYGLTF_COMPONENT_TYPE_UNSIGNED_SHORT) return load<std::uint16_t>(p);
  return load<std::uint32_t>(p);
}

bool isIndexType(int type) {
  return type == TINYGLTF_COMPONENT_TYPE_UNSIGNED_BYTE ||
         type == TINYGLTF_COMPONENT_TYPE_UNSIGNED_SHORT ||
         type == TINYGLTF_COMPONENT_TYPE_UNSIGNED_INT;
}

}  // namespace

GltfAccessor::GltfAccessor(const GltfContext& context, int index) : number_(index) {
  const auto& accessors = context.model.accessors;
  if (index < 0 || std::size_t(index) >= accessors.size()) {
    context.bad("accessor {} does not exist; there are {}", index, accessors.size());
  }
  const tinygltf::Accessor& accessor = accessors[index];
  count_ = accessor.count;
  components_ = componentCount(accessor.type);
  componentType_ = accessor.componentType;
  componentSize_ = componentBytes(componentType_);
  normalized_ = accessor.normalized;
  if (components_ == 0 || componentSize_ == 0) {
    context.bad("accessor {}: its type is not one of vertices or indices", index);
  }
  if (count_ == 0 || count_ > kMaxElements) {
    context.bad("accessor {}: {} elements are not possible", index, count_);
  }
  elementSize_ = std::uint64_t(components_) * componentSize_;
  stride_ = elementSize_;
  if (accessor.bufferView >= 0) {
    data_ = viewData(context, accessor.bufferView, accessor.byteOffset, 0, "accessor", stride_);
  } else if (count_ > kMaxWithoutData) {
    context.bad("accessor {}: {} elements, but no bufferView", index, count_);
  } else {
    patched_.assign(count_ * elementSize_, 0);
    data_ = patched_.data();
  }
  if (accessor.sparse.isSparse) applySparse(context, accessor);
}

/// Start of `bytes` bytes (0: of all strided elements) at an offset inside a buffer view.
const std::uint8_t* GltfAccessor::viewData(const GltfContext& context, int view,
                                           std::uint64_t offset, std::uint64_t bytes,
                                           const char* what, std::uint64_t& stride) const {
  const std::span<const std::uint8_t> all = bytesOfView(context, view);
  const tinygltf::BufferView& v = context.model.bufferViews[view];
  if (bytes == 0) {
    if (v.byteStride != 0) stride = v.byteStride;
    if (stride < elementSize_) {
      context.bad("bufferView {}: byteStride {} is less than an element of accessor {}", view,
                  stride, number_);
    }
    bytes = (count_ - 1) * stride + elementSize_;  // at most 2^32 * 252
  }
  if (offset > v.byteLength || bytes > v.byteLength - offset) {
    context.bad("{} {}: needs {} bytes at offset {}, but bufferView {} has {}", what, number_,
                bytes, offset, view, v.byteLength);
  }
  return all.data() + offset;
}

void GltfAccessor::applySparse(const GltfContext& context, const tinygltf::Accessor& accessor) {
  const auto& sparse = accessor.sparse;
  if (sparse.count < 0 || std::uint64_t(sparse.count) > count_ || sparse.indices.byteOffset < 0 ||
      sparse.values.byteOffset < 0) {
    context.bad("accessor {}: impossible sparse count {} or offset", number_, sparse.count);
  }
  if (!isIndexType(sparse.indices.componentType)) {
    context.bad("accessor {}: sparse indices are not unsigned integers", number_);
  }
  if (patched_.empty()) {
    patched_.resize(count_ * elementSize_);
    for (std::uint64_t i = 0; i < count_; ++i) {
      std::memcpy(patched_.data() + i * elementSize_, data_ + i * stride_, elementSize_);
    }
    stride_ = elementSize_;
    data_ = patched_.data();
  }
  if (sparse.count == 0) return;
  const std::uint64_t indexSize = componentBytes(sparse.indices.componentType);
  const std::uint64_t patches = sparse.count;
  std::uint64_t unused = 0;
  const std::uint8_t* indices =
      viewData(context, sparse.indices.bufferView, sparse.indices.byteOffset, patches * indexSize,
               "sparse indices of accessor", unused);
  const std::uint8_t* values =
      viewData(context, sparse.values.bufferView, sparse.values.byteOffset, patches * elementSize_,
               "sparse values of accessor", unused);
  for (std::uint64_t i = 0; i < patches; ++i) {
    const std::uint32_t target = loadIndex(indices + i * indexSize, sparse.indices.componentType);
    if (target >= count_) {
      context.bad("accessor {}: sparse index {} is out of range", number_, target);
    }
    std::memcpy(patched_.data() + target * elementSize_, values + i * elementSize_, elementSize_);
  }
}

float GltfAccessor::value(std::uint64_t element, int component) const {
  const std::uint8_t* p = data_ + element * stride_ + std::uint64_t(component) * componentSize_;
  const auto scaled = [&](auto integer, float most) {
    const float f = static_cast<float>(integer);
    return normalized_ ? std::max(f / most, -1.0f) : f;
  };
  switch (componentType_) {
    case TINYGLTF_COMPONENT_TYPE_FLOAT:
      return load<float>(p);
    case TINYGLTF_COMPONENT_TYPE_BYTE:
      return scaled(load<std::int8_t>(p), 127.0f);
    case TINYGLTF_COMPONENT_TYPE_UNSIGNED_BYTE:
      return scaled(*p, 255.0f);
    case TINYGLTF_COMPONENT_TYPE_SHORT:
      return scaled(load<std::int16_t>(p), 32767.0f);
    case TINYGLTF_COMPONENT_TYPE_UNSIGNED_SHORT:
      return scaled(load<std::uint16_t>(p), 65535.0f);
    default:
      return scaled(load<std::uint32_t>(p), 4294967295.0f);
  }
}

std::uint32_t GltfAccessor::index(std::uint64_t element) const {
  return loadIndex(data_ + element * stride_, componentType_);
}

}  // namespace trex::detail
