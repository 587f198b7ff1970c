// The C++ build of the tracer: the oracle of the shader's tests and the fallback without a device.
#pragma once

#include <bit>
#include <glm/glm.hpp>
#include <span>

#include "asvo/asvo.h"

namespace asvo {
namespace trace {

// The GLSL names that asvo_trace.h uses for scalars; those of vectors are found by their arguments.
using glm::abs;
using glm::exp2;
using glm::log2;
using glm::max;
using glm::min;
inline int bitCount(uint x) { return std::popcount(x); }
inline uint bitWidth(uint x) { return static_cast<uint>(std::bit_width(x)); }
inline uint floatBitsToUint(float x) { return std::bit_cast<uint>(x); }
inline float uintBitsToFloat(uint x) { return std::bit_cast<float>(x); }

/// Reads a tree (and its cached light) that must outlive it; cheap to copy. All functions are those
/// of asvo_trace.h, without side effects, and thread safe.
class Tracer {
 public:
  /// `light` has an entry a node (asvo_layout.h), or none: then gathering is black.
  explicit Tracer(const Tree& tree, std::span<const uvec4> light = {})
      : info_(tree.info),
        nodes_(tree.nodes.data()),
        voxels_(tree.voxels.data()),
        leaves_(tree.leaves.data()),
        light_(light.size() >= tree.nodes.size() ? light.data() : nullptr) {}

#define ASVO_NODE(i) (nodes_[i])
#define ASVO_VOXEL(i) (voxels_[i])
#define ASVO_LEAF(k) (leaves_[k])
#define ASVO_LIGHT(i) (light_ ? light_[i] : uvec4(0u))
#define ASVO_INFO info_
#include "asvo/asvo_trace.h"
#undef ASVO_NODE
#undef ASVO_VOXEL
#undef ASVO_LEAF
#undef ASVO_LIGHT
#undef ASVO_INFO
#undef ASVO_CONE
#undef ASVO_CONE_FINE
#undef ASVO_FINE

 private:
  AsvoInfo info_;
  const uvec2* nodes_;
  const uvec4* voxels_;
  const uvec2* leaves_;
  const uvec4* light_;
};

}  // namespace trace

using trace::Tracer;

}  // namespace asvo
