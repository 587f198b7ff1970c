// glTF: geometry compressed by EXT_meshopt_compression and KHR_draco_mesh_compression. The standard
// libraries of both decode it; sizes that the file promises are checked against what its bytes can
// hold before anything is allocated.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "src/scene/gltf_detail.h"

namespace trex::detail {

/// Makes the JSON of a compressed file one that tinygltf reads: views that meshopt compressed
/// become plain views of their compressed bytes, draco's primitives lose their indices. Others
/// stay.
void makeReadable(std::string& json);

/// Decodes all views that meshopt compressed, into buffers of their own. One that can't be decoded
/// becomes empty, and that is said.
void decodeMeshopt(GltfContext& context);

/// The primitive with its attributes and indices decoded into accessors of their own, if draco
/// compressed it; else as it is. Throws Error(kInput) if it can't be decoded.
tinygltf::Primitive decodeDraco(GltfContext& context, const tinygltf::Primitive& p,
                                const std::string& where);

}  // namespace trex::detail
