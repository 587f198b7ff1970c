#include "src/scene/mitsuba_shapes.h"

#include <algorithm>

#include "src/scene/texels.h"

namespace trex::detail::mitsuba {
namespace {

constexpr std::size_t kMostParts = std::size_t{1} << 24;

/// Of a flat shape, a matrix with a third axis that has a length: where that is points nowhere.
dmat4 withDepth(dmat4 m) {
  if (usable(m)) return m;
  m[2] = glm::dvec4(glm::cross(dvec3(m[0]), dvec3(m[1])), 0.0);
  const double length = glm::length(dvec3(m[2]));
  if (length > 0.0) m[2] /= std::sqrt(length);
  return m;
}

}  // namespace

void Shapes::add(const Element& shape) {
  const Parts parts = partsOf(shape, 0);
  if (parts.empty()) return;
  checkCount(shape, parts.size());
  Scene& scene = context_.scene();
  const std::string_view id = shape.attribute("id");
  const int object = static_cast<int>(scene.objects.size());
  scene.objects.push_back(id.empty() ? fmt::format("shape {}", object) : std::string(id));
  for (const Part& part : parts) {
    Instance instance;
    instance.name = scene.objects.back();
    instance.mesh = part.mesh;
    instance.transform = part.transform;
    instance.object = object;
    scene.instances.push_back(std::move(instance));
  }
}

void Shapes::checkCount(const Element& at, std::size_t more) {
  if (context_.scene().instances.size() + more <= kMostParts) return;
  fail(ExitCode::kInput, "{}: more than {} parts are placed", context_.document().where(at),
       kMostParts);
}

Shapes::Parts Shapes::partsOf(const Element& shape, int depth) {
  const Properties of(context_, shape);
  if (depth > kMostNested) {
    context_.replace(shape, "shapes are nested too deeply; this one is left out");
    return {};
  }
  if (shape.type() == "shapegroup") return {};  // shown where it is used
  Parts parts = shape.type() == "instance" ? partsOfInstance(of, depth)
                : shape.type() == "merge"  ? partsOfGroup(of, depth)
                                           : partsOfMesh(of);
  of.tellUnused();
  return parts;
}

/// References are not followed: only instances place what is elsewhere.
Shapes::Parts Shapes::partsOfGroup(const Properties& group, int depth) {
  Parts parts;
  static_cast<void>(group.objects("shape"));
  for (const Element& shape : group.element().children) {
    if (shape.tag != "shape") continue;
    const Parts more = partsOf(shape, depth + 1);
    checkCount(shape, parts.size() + more.size());
    parts.insert(parts.end(), more.begin(), more.end());
  }
  return parts;
}

Shapes::Parts Shapes::partsOfInstance(const Properties& instance, int depth) {
  const std::vector<const Element*> groups = instance.objects("shape");
  const dmat4 place = instance.transform("to_world");
  const char* problem = depth > 0 ? "an instance in a group is left out"
                        : groups.empty() || groups.front()->type() != "shapegroup"
                            ? "an instance of no shapegroup is left out"
                        : !usable(place)
                            ? "an instance with a transform that has no volume is left out"
                            : nullptr;
  if (problem != nullptr) {
    context_.replace(instance.element(), problem);
    return {};
  }
  const Element* group = groups.front();
  auto found = groups_.find(group);
  if (found == groups_.end()) {
    found = groups_.emplace(group, partsOfGroup(Properties(context_, *group), depth)).first;
  }
  Parts parts = found->second;
  for (Part& part : parts) part.transform = place * part.transform;
  return parts;
}

const std::vector<int>& Shapes::meshesOf(const Properties& shape, const Geometry& geometry) {
  const auto [found, fresh] = geometries_.try_emplace(geometry.key);
  if (!fresh) return found->second;
  try {
    for (Mesh& mesh : makeGeometry(context_, shape.element(), geometry)) {
      found->second.push_back(static_cast<int>(context_.scene().meshes.size()));
      context_.scene().meshes.push_back(std::move(mesh));
    }
  } catch (const Error& e) {
    if (e.code() != ExitCode::kInput) throw;
    context_.replace(shape.element(), fmt::format("{}; it is left out", e.what()));
  }
  return found->second;
}

Shapes::Parts Shapes::partsOfMesh(const Properties& shape) {
  Geometry geometry;
  if (!describeGeometry(shape, geometry)) return {};
  const Surface surface = surfaceOf(shape);
  if (surface.look.invisible && surface.emitter == nullptr) {
    if (surface.interior != nullptr) {
      context_.replace(*surface.interior, "a medium without a surface is left out");
    }
    return {};
  }
  dmat4 place = shape.transform("to_world") * geometry.place;
  if (geometry.kind == "rectangle" || geometry.kind == "disk") place = withDepth(place);
  if (!usable(place)) {
    context_.replace(shape.element(), "a shape with a transform that has no volume is left out");
    return {};
  }
  limitDetail(shape, geometry);
  geometry.setColored(surface.look.meshColors);
  geometry.setMirrored(glm::determinant(glm::dmat3(place)) < 0.0);
  Parts parts;
  for (const int mesh : meshesOf(shape, geometry)) {
    const int material = materialOf(shape, surface, mesh, place);
    parts.push_back({withMaterial(mesh, material), place});
  }
  return parts;
}

/// Round shapes of many materials are as many meshes.
void Shapes::limitDetail(const Properties& shape, Geometry& geometry) {
  const std::size_t meshes = context_.scene().meshes.size();
  if (geometry.kind != "sphere" && geometry.kind != "cylinder" && geometry.kind != "disk") return;
  if (meshes < 256) return;
  geometry.setError(meshes < 4096 ? 4e-3 : 4e-2);
  context_.note(shape.element(), fmt::format("round shapes are cut to {} of their radius from here "
                                             "on: there are many",
                                             geometry.error));
}

int Shapes::withMaterial(int mesh, int material) {
  Scene& scene = context_.scene();
  const auto firstUse = meshes_.lower_bound({mesh, kNone});
  const bool unused = firstUse == meshes_.end() || firstUse->first.first != mesh;
  const int next = unused ? mesh : static_cast<int>(scene.meshes.size());
  const auto [found, fresh] = meshes_.try_emplace({mesh, material}, next);
  if (!fresh) return found->second;
  if (!unused) {
    scene.meshes.push_back(Mesh(scene.meshes[mesh]));
    scene.meshes.back().sameGeometryAs = mesh;
  }
  scene.meshes[next].material = material;
  return next;
}

Shapes::Surface Shapes::surfaceOf(const Properties& shape) {
  const auto first = [&](std::string_view tag) {
    const std::vector<const Element*> found = shape.objects(tag);
    return found.empty() ? nullptr : found.front();
  };
  Surface surface;
  surface.bsdf = first("bsdf");
  surface.emitter = first("emitter");
  if (surface.emitter == nullptr) surface.emitter = first("luminaire");
  surface.interior = shape.find("interior");
  shape.ignore({"exterior"});
  if (first("subsurface") != nullptr) {
    context_.replace(shape.element(), "light below the surface is not shown");
  }
  surface.look = surface.bsdf != nullptr ? bsdfs_.look(*surface.bsdf)
                                         : bsdfs_.plain(surface.emitter != nullptr);
  return surface;
}

int Shapes::materialOf(const Properties& shape, const Surface& surface, int mesh,
                       const dmat4& place) {
  Scene& scene = context_.scene();
  UvFacts facts;
  if (surface.look.relief != Look::Relief::kNone) facts = uvFactsOf(scene.meshes[mesh], place);
  const std::string key =
      fmt::format("{} {} {} {:.3g} {}", static_cast<const void*>(surface.bsdf),
                  static_cast<const void*>(surface.emitter),
                  static_cast<const void*>(surface.interior), facts.metresPerUv, facts.rightHanded);
  if (const auto found = materials_.find(key); found != materials_.end()) return found->second;
  if (surface.bsdf != nullptr && !surface.look.twosided) {
    context_.note(*surface.bsdf,
                  "surfaces without 'twosided' are black behind; here both sides scatter");
  }
  Material made = makeMaterial(shape, surface, facts);
  const int material = static_cast<int>(scene.materials.size());
  scene.materials.push_back(std::move(made));
  return materials_[key] = material;
}

Material Shapes::makeMaterial(const Properties& shape, const Surface& surface,
                              const UvFacts& facts) {
  Material m = bsdfs_.finished(surface.look, facts);
  if (surface.emitter != nullptr) setEmission(*surface.emitter, m);
  if (surface.interior != nullptr && m.volume) {
    setInterior(*surface.interior, m);
  } else if (surface.interior != nullptr) {
    context_.replace(shape.element(), "a medium that is not in glass is not shown");
  }
  return m;
}

void Shapes::setEmission(const Element& emitter, Material& m) {
  const Properties of(context_, emitter);
  if (emitter.type() != "area") {
    context_.replace(emitter,
                     fmt::format("emitter '{:.40}' of a shape is shown as 'area'", emitter.type()));
  }
  const Element* radiance = of.find("radiance");
  m.emission = vec3(1.0f);
  if (radiance != nullptr && isColor(*radiance)) {
    m.emission = colorOf(context_, *radiance, ColorKind::kEmission);
  } else if (radiance != nullptr) {
    ColorInput input = textures_.read(*radiance);
    if (input.texture.present() && !input.srgb &&
        !isDeep(context_.scene().images[input.texture.image])) {
      input.texture = textures_.changed(input, "as colours", true, [](const vec4& v) { return v; });
    }
    m.emission = input.factor;
    m.emissiveTexture = input.texture;
  }
  of.ignore({"sampling_weight"});
  of.tellUnused();
}

void Shapes::setInterior(const Element& medium, Material& m) {
  const Properties of(context_, medium);
  const double scale = of.number("scale", 1.0, 0.0, 1e12);
  vec3 absorbed = of.color("sigma_a", vec3(0.0f), ColorKind::kIndex);
  vec3 scattered = of.color("sigma_s", vec3(0.0f), ColorKind::kIndex);
  if (of.has("sigma_t") || of.has("albedo")) {
    const vec3 total = of.color("sigma_t", vec3(1.0f), ColorKind::kIndex);
    scattered = total * of.color("albedo", vec3(0.75f), ColorKind::kReflectance);
    absorbed = total - scattered;
  }
  if (medium.type() != "homogeneous" || scattered != vec3(0.0f)) {
    context_.replace(medium, "what scatters in a medium is not shown, only what absorbs");
  }
  of.ignore({"phase", "sample_emitters"});
  const float most = maxComponent(absorbed);
  if (!(most > 0.0f)) return;
  m.attenuationDistance = static_cast<float>(1.0 / (scale * double(most)));
  m.attenuationColor = glm::exp(-absorbed / most);
}

}  // namespace trex::detail::mitsuba
