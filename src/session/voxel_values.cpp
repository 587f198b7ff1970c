#include "src/session/voxel_values.h"

#include <algorithm>

#include "src/session/voxel_source.h"

namespace trex {
namespace {

vec3 unpackColor(std::uint32_t bits) {
  return vec3(static_cast<float>(bits & 255u), static_cast<float>((bits >> 8) & 255u),
              static_cast<float>((bits >> 16) & 255u)) /
         255.0f;
}

std::uint32_t packColor(const vec3& color) {
  const glm::uvec3 q(glm::clamp(color, 0.0f, 1.0f) * 255.0f + 0.5f);
  return q.x | (q.y << 8) | (q.z << 16);
}

/// What a voxel's albedo becomes: its albedo under the old material tells the texture and vertex
/// colour there, which the new material then multiplies.
vec3 movedAlbedo(const vec3& albedo, const Material& before, const Material& now,
                 const vec3& meanTexture) {
  const vec3 dark = voxelAlbedo(before, vec3(0.0f));
  const vec3 white = voxelAlbedo(before, vec3(1.0f)) - dark;
  vec3 tint;
  for (int c = 0; c < 3; ++c) {
    const float slope = white[c] * before.baseColor[c];
    const bool known = slope > 0.02f;
    tint[c] = known ? std::max(0.0f, (albedo[c] - dark[c]) / slope) : meanTexture[c];
  }
  return voxelAlbedo(now, vec3(now.baseColor) * tint);
}

}  // namespace

VoxelValues::VoxelValues(std::shared_ptr<asvo::Tree> tree, std::vector<Material> materials)
    : tree_(std::move(tree)), built_(std::move(materials)), shown_(built_) {}

void VoxelValues::index() {
  const std::size_t count = tree_->nodes.size(), materials = built_.size();
  const auto materialOf = [&](std::size_t i) {
    return std::min<std::size_t>(source_[i].w & 65535u, materials - 1);
  };
  firsts_.assign(materials + 1, 0);
  for (std::size_t i = 0; i < count; ++i) ++firsts_[materialOf(i) + 1];
  for (std::size_t m = 0; m < materials; ++m) firsts_[m + 1] += firsts_[m];
  order_.resize(count);
  std::vector<std::uint32_t> next = firsts_;
  for (std::size_t i = 0; i < count; ++i) {
    order_[next[materialOf(i)]++] = static_cast<std::uint32_t>(i);
  }
}

void VoxelValues::update(const std::vector<Material>& materials, const std::vector<Image>& images) {
  if (materials == shown_) return;
  if (source_.empty()) {
    source_ = tree_->voxels;
    index();
  }
  for (std::uint32_t m = 0; m < materials.size(); ++m) {
    if (materials[m] != shown_[m]) put(m, materials[m], images);
  }
  shown_ = materials;
}

void VoxelValues::put(std::uint32_t material, const Material& now,
                      const std::vector<Image>& images) {
  const Material& before = built_[material];
  const vec3 texture = meanColor(images, before.baseColorTexture);
  for (std::uint32_t k = firsts_[material]; k < firsts_[material + 1]; ++k) {
    asvo::uvec4& voxel = tree_->voxels[order_[k]];
    voxel = source_[order_[k]];
    if (now == before) continue;
    const vec3 albedo = movedAlbedo(unpackColor(voxel.z), before, now, texture);
    voxel.z = (voxel.z & 0xff000000u) | packColor(albedo);
    // As for its colour, what is not of the voxel's main material stays as it was.
    if (sendsByDirection(now) == sendsByDirection(before)) continue;
    voxel.x = (voxel.x & 0x3fffffffu) | (sendsByDirection(now) ? 3u << 30 : 0u);
  }
}

}  // namespace trex
