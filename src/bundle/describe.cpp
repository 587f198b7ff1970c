#include "src/bundle/describe.h"

#include "src/core/version.h"
#include "src/scene/texels.h"

namespace trex::bundle {
namespace {

namespace fs = std::filesystem;

/// The folder of the model in texts would make bundles depend on where they were baked.
std::string withoutFolder(std::string text, const std::string& folder) {
  for (std::size_t at; !folder.empty() && (at = text.find(folder)) != std::string::npos;) {
    text.erase(at, folder.size());
  }
  return text;
}

}  // namespace

Description describe(const Scene& scene, const MadeParts& parts, const BakeFacts& facts) {
  const fs::path input(facts.input);
  const std::string folder = input.has_parent_path() ? input.parent_path().string() + "/" : "";
  Description d;
  d.scene.lights = scene.lights;
  d.scene.cameras = scene.cameras;
  d.scene.environment = scene.environment;
  d.scene.maxBounces = scene.maxBounces;
  d.scene.media = scene.media;
  d.scene.materials = scene.materials;
  d.scene.objects = scene.objects;
  d.scene.instances = scene.instances;
  d.scene.droppedTriangles = scene.droppedTriangles;
  for (const std::string& w : scene.warnings) d.scene.warnings.push_back(withoutFolder(w, folder));
  d.scene.replaced.count = scene.replaced.count;
  for (const std::string& text : scene.replaced.texts) {
    d.scene.replaced.texts.push_back(withoutFolder(text, folder));
  }
  for (const Image& image : scene.images) {
    Image size;
    size.name = withoutFolder(image.name, folder);
    size.width = image.width, size.height = image.height, size.channels = image.channels;
    d.scene.images.push_back(std::move(size));
    d.imageKinds.push_back(texelKind(image));
  }
  for (std::size_t i = 0; i < scene.meshes.size(); ++i) {
    const Mesh& from = scene.meshes[i];
    Mesh mesh;
    mesh.name = from.name;
    mesh.origin = from.origin;
    mesh.material = from.material;
    mesh.sameGeometryAs = from.sameGeometryAs;
    d.scene.meshes.push_back(std::move(mesh));
    if (scene.materials[static_cast<std::size_t>(from.material)].emits()) {
      d.emitters.push_back({i, from.positions.size(), from.triangles.size()});
    }
  }
  d.bakedBy = std::string("trex ") + trex::kVersion;
  d.input = input.filename().string();
  d.files = facts.files;
  d.renderOrigin = parts.renderOrigin;
  d.sharedMeshes = parts.sharedMeshes;
  d.placed = parts.placed;
  d.precisionBits = facts.precisionBits;
  d.voxelDepth = parts.voxels ? facts.voxelDepth : 0;
  d.requirements = facts.requirements;
  return d;
}

}  // namespace trex::bundle
