#include "src/scene/look.h"

namespace trex {
namespace {

/// Whether another share of a surface may be there.
bool coverageDiffers(const Material& a, const Material& b) {
  return a.alphaMode != b.alphaMode || a.baseColor.w != b.baseColor.w ||
         a.alphaCutoff != b.alphaCutoff || !(a.baseColorTexture == b.baseColorTexture);
}

}  // namespace

bool Look::operator==(const Look&) const = default;

Look lookOf(const Scene& scene) {
  Look look;
  if (!scene.cameras.empty()) look.camera = scene.cameras.front();
  look.materials = scene.materials;
  look.lights = scene.lights;
  look.environment = scene.environment;
  return look;
}

LookChanges compareLooks(const Look& before, const Look& after) {
  LookChanges c;
  c.camera = before.camera != after.camera;
  c.exposure = before.exposure != after.exposure;
  c.lights = before.lights != after.lights;
  c.environment = before.environment != after.environment;
  c.visibility = before.hidden != after.hidden || before.section != after.section;
  for (std::uint32_t i = 0; i < after.materials.size(); ++i) {
    if (before.materials[i] != after.materials[i]) c.materials.push_back(i);
  }
  return c;
}

Invalidation invalidatedBy(const Look& before, const Look& after) {
  const LookChanges c = compareLooks(before, after);
  Invalidation out;
  const bool visible = c.visibility, shines = c.lights || c.environment;
  out.frame = c.camera || shines || visible || !c.materials.empty();
  out.lights = shines || visible;
  out.flux = shines || visible || !c.materials.empty();
  out.voxelValues = visible || !c.materials.empty();
  out.voxelShape = visible;
  for (const std::uint32_t i : c.materials) {
    const Material &a = before.materials[i], &b = after.materials[i];
    out.lights |= a.emission != b.emission || a.doubleSided != b.doubleSided || a.unlit != b.unlit;
    if (b.emits()) out.lights |= coverageDiffers(a, b);
    out.voxelShape |= passesLight(a) != passesLight(b);
  }
  return out;
}

bool passesLight(const Material& m) {
  const bool clear = m.transmission * (1.0f - m.metallic) > 0.5f && m.roughness < 0.2f;
  const bool faint = m.alphaMode == AlphaMode::kBlend && m.baseColor.w < 0.5f;
  return clear || faint;
}

}  // namespace trex
