#include "src/grays/shaders.h"

namespace trex {

namespace {
#include "gather_paged_spirv.h"
#include "gather_paged_texels_spirv.h"
#include "gather_spirv.h"
#include "gather_texels_spirv.h"
#include "photons_spirv.h"
#include "photons_texels_spirv.h"
}  // namespace

std::span<const std::uint32_t> gatherShader(bool texels) {
  return texels ? std::span<const std::uint32_t>(gather_texels_spirv) : gather_spirv;
}
std::span<const std::uint32_t> pagedGatherShader(bool texels) {
  return texels ? std::span<const std::uint32_t>(gather_paged_texels_spirv) : gather_paged_spirv;
}
std::span<const std::uint32_t> photonShader(bool texels) {
  return texels ? std::span<const std::uint32_t>(photons_texels_spirv) : photons_spirv;
}

}  // namespace trex
