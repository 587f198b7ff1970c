// Scattering at a surface point: glTF 2.0 metallic-roughness with the KHR extensions of Material.
//
// A finish adds lobes over the others: a clear coat of index 1.5, and a sheen. What they reflect,
// the layers below do not get: of light that comes and of light that leaves, the larger share
// counts, so that no energy is made and both directions are alike. Emission is not dimmed by them.
// A film replaces Fresnel's reflectance; anisotropy makes the base's lobe broader along one
// direction. A metal has its base colour at all angles, or Fresnel's reflectance by its index.
//
// Sources: glTF 2.0 appendix B (BRDF), KHR_materials_specular, _ior, _transmission, _volume;
// GGX with visible normals [Heitz, JCGT 2018]; Beckmann, rough refraction [Walter et al., EGSR
// 2007].
#pragma once

#include "src/core/maths.h"
#include "src/core/sampler.h"
#include "src/crays/microfacet.h"
#include "src/crays/ray_scene.h"
#include "src/scene/scene.h"

namespace trex {

/// A sampled direction. weight is f * |cos| / pdf. A delta lobe has pdf 0 and `delta` set.
struct BsdfSample {
  vec3 direction{0.0f};
  vec3 weight{0.0f};
  float pdf = 0.0f;        ///< per solid angle
  float roughness = 1.0f;  ///< alpha of the sampled lobe: 1 diffuse, 0 delta
  bool delta = false;
  bool transmitted = false;
  /// Squared index of the far side over this side if refracted, else 1. weight, meant for radiance,
  /// contains its reciprocal; a photon's power does not, and Russian roulette should not see it.
  float etaSquared = 1.0f;
};

/// What a Bsdf says of a direction: f(outgoing, incoming) * |cos incoming|, and the density of
/// sample() per solid angle. Delta lobes are left out of both.
struct BsdfValue {
  vec3 f{0.0f};
  float pdf = 0.0f;
};

/// Which of the lobes that are no delta: those as narrow as kSharpAlpha, the others.
enum class LobeKind : std::uint8_t { kAll, kSharp, kBroad };

/// Asks for the texels that a Bsdf will read first, for those who have other work meanwhile.
void prefetchTextures(const Scene& scene, const Surface& surface);

/// The material at one surface point seen from one side, textures read. Directions are unit vectors
/// that point away from the surface. Immutable, so thread safe.
class Bsdf {
 public:
  /// Of what a cache tells nearly all: the largest chance of lobes that it can't serve.
  static constexpr float kMostSharp = 0.1f;

  /// `outgoing` points to where the ray came from.
  Bsdf(const Scene& scene, const Surface& surface, const vec3& outgoing);

  /// f(outgoing, incoming) * |cos incoming|; 0 for delta lobes.
  vec3 evaluate(const vec3& incoming, LobeKind kind = LobeKind::kAll) const;
  /// Density of sample() per solid angle, delta lobes left out.
  float pdf(const vec3& incoming) const;
  /// evaluate() and pdf(), for less than the two; the density is of all lobes.
  BsdfValue value(const vec3& incoming, LobeKind kind = LobeKind::kAll) const;
  /// False if the sampled path ends (absorbed or below the surface).
  bool sample(Sampler& sampler, BsdfSample& out) const;
  /// The same with a given choice of lobe, [0, 1): where showsBothSides() 0 is what is in front,
  /// anything from 1 - shareBehind() on what is behind.
  bool sample(Sampler& sampler, float choice, BsdfSample& out) const;
  /// Settles by which kind of lobe a sampled direction goes on, where both may: its weight is then
  /// that kind's alone. True: the sharp one. Not for deltas.
  bool goesOnSharp(Sampler& sampler, BsdfSample& sampled) const;

  /// What a photon's power that came from `outgoing` takes on its way to `next`, beside its weight,
  /// where the shading normal is not the geometric one: so that photons carry what paths find
  /// [Veach 1997, 5.3.2]. At most 16, of photons that graze the triangle.
  float photonFactor(const vec3& next) const;

  /// Radiance emitted towards `outgoing`; 0 behind a single-sided emitter. The base colour if
  /// unlit.
  vec3 emission() const { return emission_; }
  bool unlit() const { return unlit_; }
  /// Coverage in [0, 1]: 1 - alpha is the chance that a ray passes.
  float coverage() const { return coverage_; }
  /// True if only delta lobes exist: light sampling has nothing to do here.
  bool onlyDelta() const { return onlyDelta_; }
  /// Whether there are sharp lobes that are no delta, and whether there are no broad ones.
  bool sharp() const { return sharp_ || coatIs(LobeKind::kSharp); }
  bool hasBroad() const {
    return lobes_.diffuse > 0.0f || !(smooth_ || sharp_) || lobes_.sheen > 0.0f ||
           (lobes_.coat > 0.0f && coat_.alpha > kSharpAlpha);
  }
  /// Whether light of the far side may reach `outgoing`, delta lobes included.
  bool transmits() const { return lobes_.transmission > 0.0f; }
  /// True if what is seen in or through the surface stands for it: mirrors, clear glass, and lobes
  /// hardly wider.
  bool showsOthers() const { return showsOthers_; }
  /// True if sample() has no choice between lobes.
  bool oneLobe() const { return lobes_.specular == 1.0f || lobes_.transmission == 1.0f; }
  /// Whether such a surface shows what is in front of it and what is behind.
  bool showsBothSides() const {
    return showsOthers_ && lobes_.specular > 0.0f && lobes_.transmission > 0.0f &&
           lobes_.coat == 0.0f;
  }
  /// Then: how often sample() chooses what is behind.
  float shareBehind() const { return lobes_.transmission; }
  /// Reflectance that a cache of irradiance can serve: the diffuse albedo plus that of the broad
  /// part of the specular lobe. [0, 1].
  vec3 cachedAlbedo() const;
  /// True if cachedAlbedo() tells nearly all of what leaves the surface.
  bool cacheable() const { return cacheable_; }
  /// What it reflects of light from everywhere, by its colour, off by up to 0.03; one if most of
  /// its light is what it lets pass. [0, 1].
  vec3 albedo() const;
  /// Unit geometric and shading normals on the side of `outgoing`.
  const vec3& geometricNormal() const { return geometricNormal_; }
  const vec3& normal() const { return basis_.normal; }
  /// Share of light, by colour, that the covered part lets pass smoothly; 0 if it is rough.
  vec3 clearTransmission() const;
  /// Whether that light is refracted (a face of a volume); it goes straight on otherwise.
  bool refracts() const { return refracts_; }
  /// Index of the far side over that of the near one, where it is.
  float eta() const { return eta_; }
  /// Where a ray that came from `outgoing` goes on; false if it is reflected totally.
  bool clearRefraction(vec3& direction) const;
  /// Absorption per metre of where a direction leads, if on this side it is `here`.
  vec3 absorptionTowards(const vec3& direction, const vec3& here) const {
    if (!refracts_ || glm::dot(direction, geometricNormal_) >= 0.0f) return here;
    return entering_ ? absorption_ : vec3(0.0f);
  }
  /// Whether a scattered ray leaves on the triangle's front.
  bool leavesFront(const vec3& direction) const {
    return front_ == (glm::dot(direction, basis_.normal) > 0.0f);
  }

 private:
  /// The micro normal that reflects one direction into another, as the lobes ask for it.
  struct Half {
    float cosine;          ///< of both directions to it
    float up;              ///< its cosine to the normal
    float density = 0.0f;  ///< of micro normals there; 0 where no lobe asks
  };
  /// Of the specular lobe, and what light from there does not reach of what lies below.
  struct Reflectance {
    vec3 specular;
    float interface;
  };
  struct Lobes {
    float diffuse, specular, transmission, coat, sheen;  ///< chances, sum 1 (or all 0)
  };
  struct Coat {
    Basis basis{vec3(0, 0, 1)};
    vec3 out{0.0f};  ///< outgoing in the basis
    float weight = 0.0f, alpha = 0.0f;
  };
  struct Sheen {
    vec3 color{0.0f};
    float alpha = 1.0f, albedo = 0.0f;  ///< of `outgoing`
  };
  void readMaterial(const Scene& scene, const Surface& surface, bool frontSide);
  void chooseLobes();
  static vec3 seen(const vec3& normal, const vec3& outgoing);
  void readFinish(const Scene& scene, const Surface& surface, const vec3& outgoing);
  void addFinishLobes();
  vec3 diffuseAlbedo() const;
  vec3 glossAlbedo() const;
  vec3 albedoOf(const vec3& diffuse, const vec3& gloss, bool coat) const;
  float lowerSheen() const;
  vec3 finishAlbedo(const vec3& diffuse, const vec3& gloss, bool coat) const;
  Reflectance reflectance(float cosine) const;
  vec3 fresnel(float cosine) const { return reflectance(cosine).specular; }
  float interface(float cosine) const { return reflectance(cosine).interface; }
  Half half(const vec3& in) const;
  bool coatIs(LobeKind kind) const;
  vec3 coatReflection(const vec3& incoming) const;
  float finishPdf(const vec3& incoming, const vec3& in) const;
  float passesFinish(const vec3& incoming, float cosine) const;
  vec3 underFinish(const vec3& base, const vec3& incoming, const vec3& in, LobeKind kind) const;
  bool sampleCoat(Sampler& sampler, BsdfSample& out) const;
  bool finishSample(const vec3& local, BsdfSample& out) const;
  vec3 film(float cosine) const;
  vec3 metal(float cosine) const;
  float density(const vec3& half) const;
  float lambda(const vec3& v) const;
  float maskingShadowing(const vec3& in) const;
  float visiblePdf(const Half& half) const;
  vec3 sampleVisible(vec2 u) const;
  float dielectricWeight(float cosine) const;
  vec3 glassReflectance(float cosine) const;
  bool hasSpecular(LobeKind kind) const {
    return !smooth_ && (kind == LobeKind::kAll || (kind == LobeKind::kSharp) == sharp_);
  }
  vec3 evaluateReflection(const vec3& in, const Half& half, LobeKind kind = LobeKind::kAll) const;
  vec3 evaluateTransmission(const vec3& in) const;
  float pdfReflection(const vec3& in, const Half& half) const;
  BsdfValue reflection(const vec3& in, LobeKind kind) const;
  float pdfTransmission(const vec3& in) const;
  bool sampleSpecular(Sampler& sampler, BsdfSample& out) const;
  bool sampleTransmission(Sampler& sampler, BsdfSample& out) const;
  bool refract(const vec3& microNormal, vec3& in) const;
  bool aboveHorizon(const vec3& direction) const;

  Basis basis_{vec3(0, 0, 1)};
  vec3 geometricNormal_, out_;  ///< out_: outgoing in the basis
  vec3 smoothNormal_;           ///< whose horizon counts, besides the triangle's own
  vec3 emission_{0.0f}, diffuse_{0.0f}, f0_{0.0f}, transmissionTint_{0.0f};
  vec3 glassTint_{1.0f};  ///< of what glass reflects
  vec3 metalColor_{0.0f}, metalEta_{0.0f}, metalK_{0.0f}, absorption_{0.0f};
  float f90_ = 1.0f, metallic_ = 0.0f, transmission_ = 0.0f, alpha_ = 1.0f, coverage_ = 1.0f;
  float eta_ = 1.0f;     ///< index on the far side over this side, if it refracts
  float masked_ = 0.0f;  ///< Smith's Lambda of `outgoing`
  float across_ = 1.0f;  ///< alpha along the basis's tangent, if anisotropic_; alpha_ is the other
  float film_ = 0.0f, filmIor_ = 1.0f, filmNanometres_ = 0.0f;  ///< film_: share
  Coat coat_;
  Sheen sheen_;
  Lobes lobes_{};
  bool front_ = true, unlit_ = false, onlyDelta_ = false, smooth_ = false, sharp_ = false,
       refracts_ = false, entering_ = true;
  bool cacheable_ = true, showsOthers_ = false, finished_ = false, anisotropic_ = false,
       conducts_ = false, beckmann_ = false, lambertian_ = false;
};

/// Whether a material has smooth transmission somewhere.
bool isClearGlass(const Material& material);

/// Fresnel reflectance of a dielectric, unpolarised. cosine >= 0 on the incident side; eta: index
/// of the far side over the near side. 1 at total internal reflection.
float fresnelDielectric(float cosine, float eta);

}  // namespace trex
