#include "src/scene/pbrt_shapes.h"

#include <algorithm>
#include <cmath>

#include "src/scene/import_detail.h"
#include "src/scene/texture.h"
#include "src/scene/texture_file.h"

namespace trex::detail {
namespace {

/// Of one scene: some 200 bytes each.
constexpr std::size_t kMaxInstances = std::size_t(1) << 26;

/// Of a mesh in the world.
double areaOf(const Mesh& mesh, const dmat4& toWorld) {
  const glm::dmat3 linear(toWorld);
  double twice = 0.0;
  for (const glm::uvec3& t : mesh.triangles) {
    const dvec3 a(mesh.positions[t.x]), b(mesh.positions[t.y]), c(mesh.positions[t.z]);
    twice += glm::length(glm::cross(linear * (b - a), linear * (c - a)));
  }
  return 0.5 * twice;
}

std::string stemOf(const std::string& file) { return std::filesystem::path(file).stem().string(); }

}  // namespace

bool PbrtShapes::add(const std::string& kind, const PbrtParameters& parameters,
                     const PbrtState& state) {
  parameters.ignore({"shadowalpha", "emissionfilename", "edgelength", "displacement",
                     "displacement.edgelength", "displacement.uvscale"});
  Material material;
  if (!surface(parameters, state, material)) return false;
  std::optional<PbrtQuadric> quadric;
  if (isPbrtQuadric(kind)) {
    quadric = pbrtQuadric(context_, kind, parameters);
    if (!quadric) return false;
  }
  const std::string file = kind == "plymesh" ? parameters.text("filename") : std::string();
  const dmat4 toWorld = quadric ? state.ctm[0] * quadric->placement : state.ctm[0];
  if (!placeable(toWorld)) return false;
  if (state.moves()) context_.replace("it moves; it is shown as when the shutter opens");

  const bool imageShines =
      state.areaLight != nullptr && state.areaLight->find("filename") != nullptr;
  const bool textured = material.textured() || materials_.hasRelief(state.material) || imageShines;
  const PbrtFaces faces{state.reverse, colors_.version4, textured};
  Uses* uses = nullptr;
  if (quadric || kind == "plymesh") {
    uses =
        &uses_[fmt::format("{}{}{} {}", faces.reverse ? "-" : "+", faces.version4 ? "4" : "3",
                           faces.textured && !quadric ? "t" : "", quadric ? quadric->key() : file)];
  }
  std::optional<Mesh> made;
  if (uses == nullptr || uses->first == kNone) {
    made = make(kind, parameters, quadric ? &*quadric : nullptr, faces);
    if (!made) return false;
    made->name = file.empty() ? kind : utf8Of(stemOf(file));
    sanitiseMesh(context_.scene, *made, context_.where());
  }
  const Mesh& mesh = made ? *made : context_.scene.meshes[uses->first];
  addEmission(mesh, state, toWorld, material);
  materials_.applyRelief(state.material, mesh, toWorld, material);
  const std::string name = made ? made->name : context_.scene.meshes[uses->first].name;
  place(meshOf(std::move(made), uses, materials_.indexOf(material)), toWorld, name);
  return true;
}

std::optional<Mesh> PbrtShapes::make(const std::string& kind, const PbrtParameters& parameters,
                                     const PbrtQuadric* quadric, const PbrtFaces& faces) {
  if (quadric != nullptr) {
    constexpr std::size_t kManyMeshes = 1000;  // of different shapes: kept coarser, in all smaller
    return quadric->mesh(faces.reverse,
                         uses_.size() > kManyMeshes ? 20.0 * kShapeError : kShapeError);
  }
  if (kind != "plymesh") return pbrtMesh(context_, kind, parameters, faces);
  return pbrtPlyMesh(context_, parameters.text("filename"), faces);
}

/// The material without what it sends out. False if nothing of the shape is seen.
bool PbrtShapes::surface(const PbrtParameters& parameters, const PbrtState& state,
                         Material& material) {
  const bool invisible = materials_.invisible(state.material);
  const bool emits = state.areaLight != nullptr && !inObject();
  if (invisible && !emits) return false;
  material = materials_.material(state.material);
  const PbrtTexture alpha = textures_.number(parameters, "alpha", 1.0f);
  if (invisible) {
    context_.replace("it shines without a surface; a black one is shown");
    material.baseColor = vec4(0.0f, 0.0f, 0.0f, 1.0f);
  } else if (emits && !alpha.varies() && alpha.factor.x <= 0.0f) {
    context_.replace("it shines but is not seen; it is shown");
  } else if (alpha.varies() || alpha.factor.x < 1.0f) {
    materials_.applyOpacity(alpha, material);
  }
  const auto medium = media.find(state.inside);
  if (material.volume && medium != media.end()) {
    const float strongest = maxComponent(medium->second.absorption);
    if (strongest > 0.0f) {
      material.attenuationDistance = 1.0f / strongest;
      material.attenuationColor = glm::exp(-medium->second.absorption / strongest);
    }
  }
  return true;
}

void PbrtShapes::addEmission(const Mesh& shape, const PbrtState& state, const dmat4& toWorld,
                             Material& material) {
  if (state.areaLight == nullptr) return;
  if (inObject()) {
    context_.replace("pbrt's objects do not shine; its area light is left out");
    return;
  }
  const PbrtParameters& p = *state.areaLight;
  material.doubleSided = p.flag("twosided", false);
  vec3 radiance = colors_.light(p, "L").value_or(vec3(1.0f));
  radiance *= glm::max(colors_.reflectance(p, "scale").value_or(vec3(1.0f)), vec3(0.0f));
  float mean = 1.0f;
  if (const std::string file = p.text("filename"); !file.empty()) {
    addEmissionImage(file, material);
    const Texture& t = material.emissiveTexture;
    if (t.present()) mean = luminance(vec3(textureMean(context_.scene.images[t.image], true)));
  }
  if (const double power = p.number("power", -1.0); power > 0.0) {
    const double sides = material.doubleSided ? 2.0 : 1.0;
    const double emitted = std::numbers::pi * sides * areaOf(shape, toWorld) * double{mean};
    if (emitted > 0.0) radiance *= static_cast<float>(power / emitted);
  }
  p.ignore({"samples", "nsamples"});
  material.emission = clampedLight(radiance * lightScale);
}

void PbrtShapes::addEmissionImage(const std::string& file, Material& material) {
  if (!context_.options.loadTextures) return;
  material.emissiveTexture = {};
  material.emissiveTexture.nearest = true;
  material.emissiveTexture.image = textures_.imageOfFileName(file, 0.0f, "its mean is taken for 1");
  if (!material.emissiveTexture.present()) material.emissiveTexture = {};
}

/// The mesh of a material: the one that was made, or a copy of what was made before.
int PbrtShapes::meshOf(std::optional<Mesh> made, Uses* uses, int material) {
  std::vector<Mesh>& meshes = context_.scene.meshes;
  if (uses != nullptr) {
    const auto known = uses->byMaterial.find(material);
    if (known != uses->byMaterial.end()) return known->second;
  }
  if (!made) {
    made = meshes[uses->first];
    made->sameGeometryAs = uses->first;
  }
  made->material = material;
  const int index = static_cast<int>(meshes.size());
  meshes.push_back(std::move(*made));
  if (uses != nullptr) {
    if (uses->first == kNone) uses->first = index;
    uses->byMaterial[material] = index;
  }
  return index;
}

bool PbrtShapes::placeable(const dmat4& toWorld) {
  if (isPlacement(toWorld)) return true;
  context_.replace("its transform is not finite, flat or not affine; it is left out");
  return false;
}

void PbrtShapes::place(int mesh, const dmat4& toWorld, const std::string& name) {
  if (inObject()) {
    object_->push_back({mesh, toWorld});
    return;
  }
  Scene& scene = context_.scene;
  scene.instances.push_back({name, mesh, toWorld, static_cast<int>(scene.objects.size())});
  scene.objects.push_back(name);
}

void PbrtShapes::beginObject(const std::string& name) {
  object_ = &objects_[name];
  object_->clear();
}

void PbrtShapes::instance(const std::string& name, const PbrtState& state) {
  if (inObject()) {
    context_.replace("an instance in an object is not placed by pbrt, nor here");
    return;
  }
  const auto found = objects_.find(name);
  if (found == objects_.end()) {
    context_.replace("there is no object of this name; it is left out");
    return;
  }
  if (state.moves()) context_.replace("it moves; it is shown as when the shutter opens");
  Scene& scene = context_.scene;
  if (scene.instances.size() + found->second.size() > kMaxInstances) {
    fail(ExitCode::kMemoryOrDevice, "{}: more than {} instances", context_.where(), kMaxInstances);
  }
  const int object = static_cast<int>(scene.objects.size());
  const std::string shown = utf8Of(name);
  for (const Part& part : found->second) {
    const dmat4 toWorld = state.ctm[0] * part.transform;
    if (placeable(toWorld)) scene.instances.push_back({shown, part.mesh, toWorld, object});
  }
  scene.objects.push_back(shown);
}

}  // namespace trex::detail
