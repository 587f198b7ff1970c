#include "src/crays/bsdf.h"

#include <algorithm>

#include "src/crays/lobe_mean.h"
#include "src/crays/microfacet.h"
#include "src/scene/emission.h"
#include "src/scene/texture.h"

namespace trex {
namespace {

float schlickWeight(float cosine) {
  const float x = std::clamp(1.0f - cosine, 0.0f, 1.0f);
  return x * x * x * x * x;
}

/// The interpolated normal, bent by the normal map where there is one.
vec3 mappedNormal(const Scene& scene, const Material& material, const Surface& surface) {
  if (!material.normalTexture.present() || surface.tangent == vec3(0.0f)) {
    return surface.shadingNormal;
  }
  const vec3 texel =
      vec3(readTexture(scene.images, material.normalTexture, surface.texCoords, false)) * 2.0f -
      1.0f;
  const vec3 bent =
      material.normalScale * (texel.x * surface.tangent + texel.y * surface.bitangent) +
      texel.z * surface.shadingNormal;
  const float length = glm::length(bent);
  return length > 1e-6f ? bent / length : surface.shadingNormal;
}

}  // namespace

bool isClearGlass(const Material& m) {
  const bool textured = m.metallicRoughnessTexture.present();
  const bool smooth = textured || m.roughness * m.roughness < kSmallestAlpha;
  return m.transmission > 0.0f && (textured || m.metallic < 1.0f) && !m.unlit && smooth;
}

float fresnelDielectric(float cosine, float eta) {
  cosine = std::clamp(cosine, 0.0f, 1.0f);
  const float sinT2 = (1.0f - cosine * cosine) / (eta * eta);
  if (sinT2 >= 1.0f) return 1.0f;
  const float cosT = std::sqrt(1.0f - sinT2);
  const float parallel = (eta * cosine - cosT) / (eta * cosine + cosT);
  const float perpendicular = (cosine - eta * cosT) / (cosine + eta * cosT);
  return 0.5f * (parallel * parallel + perpendicular * perpendicular);
}

/// A normal that the viewer can't see (a bent one at a grazing angle) is turned until he can, so
/// that no pixel turns black.
vec3 Bsdf::seen(const vec3& normal, const vec3& outgoing) {
  constexpr float kLeastCosine = 1e-3f;
  const float cosine = glm::dot(normal, outgoing);
  if (cosine >= kLeastCosine) return normal;
  return glm::normalize(normal + (kLeastCosine - cosine) * outgoing);
}

void prefetchTextures(const Scene& scene, const Surface& surface) {
  const Material& material = scene.materials[surface.material];
  for (const Texture* texture :
       {&material.baseColorTexture, &material.metallicRoughnessTexture, &material.normalTexture}) {
    if (!texture->present()) continue;
    prefetchTexture(scene.images[static_cast<std::size_t>(texture->image)], *texture,
                    surface.texCoords[texture->set]);
  }
}

Bsdf::Bsdf(const Scene& scene, const Surface& surface, const vec3& outgoing) {
  const Material& material = scene.materials[surface.material];
  const bool front = front_ = glm::dot(surface.geometricNormal, outgoing) >= 0.0f;
  geometricNormal_ = front ? surface.geometricNormal : -surface.geometricNormal;
  vec3 normal = mappedNormal(scene, material, surface);
  if (!front) normal = -normal;
  normal = seen(normal, outgoing);
  if (glm::dot(normal, geometricNormal_) <= 0.0f) normal = geometricNormal_;
  const bool lifts = surface.lift[front ? 0 : 1] != vec3(0.0f);
  smoothNormal_ = !lifts  ? geometricNormal_
                  : front ? surface.shadingNormal
                          : -surface.shadingNormal;
  basis_ = Basis(normal);
  out_ = basis_.toLocal(outgoing);
  out_.z = std::max(out_.z, 1e-6f);
  readMaterial(scene, surface, front);
  if (material.finish.present() && !unlit_) readFinish(scene, surface, outgoing);
  chooseLobes();
}

void Bsdf::readMaterial(const Scene& scene, const Surface& surface, bool frontSide) {
  const Material& m = scene.materials[surface.material];
  const TexCoords& uv = surface.texCoords;
  const vec4 base =
      m.baseColor * surface.color * readTexture(scene.images, m.baseColorTexture, uv, true);
  const vec3 color = glm::clamp(vec3(base), 0.0f, 1.0f);
  if (m.alphaMode != AlphaMode::kOpaque) coverage_ = coverageOf(m, base.w);

  unlit_ = m.unlit;
  if (m.emits() && (frontSide || m.doubleSided)) emission_ = emissionAt(m, scene.images, uv);
  if (unlit_) {
    emission_ = color;
    return;
  }
  const vec4 metalRough = readTexture(scene.images, m.metallicRoughnessTexture, uv, false);
  metallic_ = std::clamp(m.metallic * metalRough.z, 0.0f, 1.0f);
  const float roughness = std::clamp(m.roughness * metalRough.y, 0.0f, 1.0f);
  alpha_ = roughness * roughness;
  smooth_ = alpha_ < kSmallestAlpha;
  sharp_ = !smooth_ && alpha_ <= kSharpAlpha;
  transmission_ = m.transmission * readTexture(scene.images, m.transmissionTexture, uv, false).x;
  refracts_ = transmission_ > 0.0f && m.volume;
  entering_ = frontSide;
  eta_ = frontSide || !refracts_ ? m.ior : 1.0f / m.ior;
  if (refracts_ && std::isfinite(m.attenuationDistance) && m.attenuationDistance > 0.0f) {
    absorption_ =
        -glm::log(glm::clamp(m.attenuationColor, vec3(1e-6f), vec3(1.0f))) / m.attenuationDistance;
  }
  const float specular = m.specular * readTexture(scene.images, m.specularTexture, uv, false).w;
  const vec3 tint =
      m.specularColor * vec3(readTexture(scene.images, m.specularColorTexture, uv, true));
  const float f0 = (m.ior - 1.0f) * (m.ior - 1.0f) / ((m.ior + 1.0f) * (m.ior + 1.0f));
  metalColor_ = color;
  f0_ = glm::min(f0 * tint, vec3(1.0f)) * specular;
  glassTint_ = specular * tint;
  f90_ = specular;
  diffuse_ = color * (1.0f - metallic_) * (1.0f - transmission_);
  transmissionTint_ = color * (1.0f - metallic_) * transmission_;
}

/// Reflectance of the dielectric part's interface, before its tint.
float Bsdf::dielectricWeight(float cosine) const {
  const float exact = fresnelDielectric(cosine, eta_);
  // A thin sheet reflects at both faces and between them: R' = R + T^2 R / (1 - R^2) = 2R / (1 +
  // R).
  return refracts_ ? exact : 2.0f * exact / (1.0f + exact);
}

/// Reflectance of glass: what the specular factor and colour leave of its interface's, the colour
/// up to grazing angles as of F0 and F90. Total reflection stays that.
vec3 Bsdf::glassReflectance(float cosine) const {
  const float exact = dielectricWeight(cosine);
  if (glassTint_ == vec3(1.0f) || exact >= 1.0f) return vec3(exact);
  const vec3 tint = glassTint_ + (vec3(f90_) - glassTint_) * schlickWeight(cosine);
  return glm::min(exact * tint, vec3(1.0f));
}

/// At angle `cosine` to the micro normal, all parts together.
Bsdf::Reflectance Bsdf::reflectance(float cosine) const {
  if (lambertian_) return {vec3(0.0f), 0.0f};
  const vec3 dielectric = transmission_ > 0.0f ? glassReflectance(cosine)
                                               : f0_ + (vec3(f90_) - f0_) * schlickWeight(cosine);
  const vec3 bare = glm::mix(dielectric, conducts_ ? metal(cosine) : metalColor_, metallic_);
  const float below = maxComponent(dielectric);
  if (!(film_ > 0.0f)) return {bare, below};
  const vec3 coloured = film(cosine);
  return {glm::mix(bare, coloured, film_), glm::mix(below, maxComponent(coloured), film_)};
}

void Bsdf::chooseLobes() {
  if (unlit_) return;
  lambertian_ = f0_ == vec3(0.0f) && f90_ == 0.0f && metallic_ == 0.0f && transmission_ == 0.0f &&
                !(film_ > 0.0f) && !finished_;
  if (!lambertian_ && !smooth_) masked_ = lambda(out_);
  const Reflectance seen = reflectance(out_.z);
  lobes_.specular = luminance(seen.specular);
  lobes_.diffuse = luminance(diffuse_) * (1.0f - seen.interface);
  lobes_.transmission = luminance(transmissionTint_) * (1.0f - seen.interface);
  if (finished_) addFinishLobes();
  const float sum =
      lobes_.specular + lobes_.diffuse + lobes_.transmission + lobes_.coat + lobes_.sheen;
  if (sum > 0.0f) {
    for (float* lobe :
         {&lobes_.specular, &lobes_.diffuse, &lobes_.transmission, &lobes_.coat, &lobes_.sheen}) {
      if (*lobe > 0.0f) *lobe /= sum;
    }
  }
  onlyDelta_ = lobes_.diffuse + lobes_.sheen == 0.0f && smooth_ &&
               (lobes_.coat == 0.0f || coat_.alpha < kSmallestAlpha);
  showsOthers_ = lobes_.diffuse + lobes_.sheen == 0.0f && alpha_ <= kClearAlpha &&
                 (lobes_.coat == 0.0f || coat_.alpha <= kClearAlpha);
  const float sharp = (smooth_ ? lobes_.specular : lobes_.specular * metallic_) +
                      (coat_.alpha <= kSharpAlpha ? lobes_.coat : 0.0f);
  cacheable_ = sharp + lobes_.transmission <= kMostSharp;
}

vec3 Bsdf::diffuseAlbedo() const {
  if (lobes_.specular == 0.0f) return diffuse_;
  return diffuse_ * (1.0f - interface(diffuseMeanCosine(out_.z)));
}

vec3 Bsdf::glossAlbedo() const {
  if (smooth_ || lobes_.specular == 0.0f) return fresnel(out_.z);
  const float alpha =
      anisotropic_ ? std::sqrt(0.5f * (alpha_ * alpha_ + across_ * across_)) : alpha_;
  const LobeMean mean = ggxMean(out_.z, alpha);
  return fresnel(mean.cosine) * mean.energy;
}

vec3 Bsdf::cachedAlbedo() const {
  // A broad specular lobe of a few percent may be cached as if diffuse; a metal's may not.
  const vec3 gloss =
      smooth_ ? vec3(0.0f) : glossAlbedo() * ((1.0f - metallic_) * (1.0f - transmission_));
  return albedoOf(diffuseAlbedo(), gloss, coat_.alpha > kSharpAlpha);
}

vec3 Bsdf::albedo() const {
  if (unlit_) return vec3(0.0f);
  if (lobes_.transmission == 0.0f) return albedoOf(diffuseAlbedo(), glossAlbedo(), true);
  return cacheable_ ? cachedAlbedo() : vec3(1.0f);
}

/// With the finish over both; `coat`: of what that reflects too.
vec3 Bsdf::albedoOf(const vec3& diffuse, const vec3& gloss, bool coat) const {
  return glm::min(finished_ ? finishAlbedo(diffuse, gloss, coat) : diffuse + gloss, vec3(1.0f));
}

/// Of two directions on the side of the normal, one of them `outgoing`.
Bsdf::Half Bsdf::half(const vec3& in) const {
  const vec3 direction = glm::normalize(out_ + in);
  Half half{glm::dot(out_, direction), direction.z};
  if (!smooth_) half.density = density(direction);
  return half;
}

vec3 Bsdf::evaluateReflection(const vec3& in, const Half& half, LobeKind kind) const {
  const Reflectance reflected = reflectance(half.cosine);
  vec3 f(0.0f);
  if (hasSpecular(kind)) {
    f = reflected.specular * (half.density * maskingShadowing(in) / (4.0f * out_.z));
  }
  if (lobes_.diffuse > 0.0f && kind != LobeKind::kSharp) {
    f += diffuse_ * ((1.0f - reflected.interface) * kInvPi * in.z);
  }
  return f;
}

BsdfValue Bsdf::reflection(const vec3& in, LobeKind kind) const {
  if (lambertian_) {
    const vec3 f = kind == LobeKind::kSharp ? vec3(0.0f) : diffuse_ * (kInvPi * in.z);
    return {f, lobes_.diffuse * in.z * kInvPi};
  }
  const Half between = half(in);
  return {evaluateReflection(in, between, kind), pdfReflection(in, between)};
}

/// f * |cos| of rough transmission; in.z < 0.
vec3 Bsdf::evaluateTransmission(const vec3& in) const {
  if (smooth_ || lobes_.transmission == 0.0f) return vec3(0.0f);
  if (!refracts_) {  // a thin sheet: the reflection lobe mirrored to the far side
    const vec3 mirrored(in.x, in.y, -in.z);
    const Half between = half(mirrored);
    const vec3 through = vec3(1.0f) - glassReflectance(between.cosine);
    return transmissionTint_ *
           (through * between.density * maskingShadowing(mirrored) / (4.0f * out_.z));
  }
  vec3 half = out_ + in * eta_;
  const float length = glm::length(half);
  if (length < 1e-7f) return vec3(0.0f);
  half *= (half.z < 0.0f ? -1.0f : 1.0f) / length;
  const float outH = glm::dot(out_, half), inH = glm::dot(in, half);
  if (outH <= 0.0f || inH >= 0.0f) return vec3(0.0f);
  const float denominator = outH + eta_ * inH;
  const vec3 through = vec3(1.0f) - glassReflectance(outH);
  const vec3 value = through * density(half) * maskingShadowing(vec3(in.x, in.y, -in.z)) * eta_ *
                     eta_ * outH * -inH / (out_.z * denominator * denominator);
  // Radiance is compressed by 1 / eta^2 on the way in and expands on the way out.
  return transmissionTint_ * (value / (eta_ * eta_));
}

float Bsdf::pdfReflection(const vec3& in, const Half& half) const {
  float p = lobes_.diffuse * in.z * kInvPi;
  if (!smooth_ && lobes_.specular > 0.0f) {
    p += lobes_.specular * visiblePdf(half) / (4.0f * half.cosine);
  }
  return p;
}

float Bsdf::pdfTransmission(const vec3& in) const {
  if (smooth_ || lobes_.transmission == 0.0f) return 0.0f;
  if (!refracts_) {
    const Half between = half(vec3(in.x, in.y, -in.z));
    return lobes_.transmission * visiblePdf(between) / (4.0f * between.cosine);
  }
  vec3 half = out_ + in * eta_;
  const float length = glm::length(half);
  if (length < 1e-7f) return 0.0f;
  half *= (half.z < 0.0f ? -1.0f : 1.0f) / length;
  const float outH = glm::dot(out_, half), inH = glm::dot(in, half);
  if (outH <= 0.0f || inH >= 0.0f) return 0.0f;
  const float denominator = outH + eta_ * inH;
  // Total internal reflection is decided before this lobe is sampled; see sampleTransmission.
  const float visible = visiblePdf({outH, half.z, density(half)});
  return lobes_.transmission * visible * eta_ * eta_ * -inH / (denominator * denominator);
}

/// Whether light from there reaches the surface: of the triangle, or of the smooth one that it
/// stands for (RayScene::leave).
bool Bsdf::aboveHorizon(const vec3& direction) const {
  return glm::dot(direction, geometricNormal_) > 0.0f || glm::dot(direction, smoothNormal_) > 0.0f;
}

vec3 Bsdf::evaluate(const vec3& incoming, LobeKind kind) const {
  if (unlit_) return vec3(0.0f);
  const vec3 in = basis_.toLocal(incoming);
  vec3 f(0.0f);
  if (in.z > 0.0f && aboveHorizon(incoming)) {
    f = lambertian_ ? reflection(in, kind).f : evaluateReflection(in, half(in), kind);
  } else if (in.z < 0.0f && glm::dot(incoming, geometricNormal_) < 0.0f) {
    if (hasSpecular(kind)) f = evaluateTransmission(in);
  } else {
    return f;
  }
  return finished_ ? underFinish(f, incoming, in, kind) : f;
}

float Bsdf::pdf(const vec3& incoming) const {
  if (unlit_) return 0.0f;
  const vec3 in = basis_.toLocal(incoming);
  const float p = in.z > 0.0f   ? pdfReflection(in, half(in))
                  : in.z < 0.0f ? pdfTransmission(in)
                                : 0.0f;
  return finished_ && in.z > 0.0f ? p + finishPdf(incoming, in) : p;
}

BsdfValue Bsdf::value(const vec3& incoming, LobeKind kind) const {
  if (unlit_) return {};
  const vec3 in = basis_.toLocal(incoming);
  if (finished_ || !(in.z > 0.0f)) return {evaluate(incoming, kind), pdf(incoming)};
  BsdfValue value = reflection(in, kind);
  if (!aboveHorizon(incoming)) value.f = vec3(0.0f);
  return value;
}

bool Bsdf::refract(const vec3& microNormal, vec3& in) const {
  const float cosine = glm::dot(out_, microNormal);
  const float sinT2 = (1.0f - cosine * cosine) / (eta_ * eta_);
  if (cosine <= 0.0f || sinT2 >= 1.0f) return false;
  in = glm::normalize(-out_ / eta_ + (cosine / eta_ - std::sqrt(1.0f - sinT2)) * microNormal);
  return in.z < 0.0f;
}

vec3 Bsdf::clearTransmission() const {
  if (!smooth_ || lobes_.transmission <= 0.0f) return vec3(0.0f);
  const float passes = finished_ ? passesFinish(-basis_.toWorld(out_), out_.z) : 1.0f;
  return transmissionTint_ * ((vec3(1.0f) - glassReflectance(out_.z)) * passes);
}

bool Bsdf::clearRefraction(vec3& direction) const {
  vec3 local;
  if (!refract(vec3(0.0f, 0.0f, 1.0f), local)) return false;
  direction = basis_.toWorld(local);
  return glm::dot(direction, geometricNormal_) < 0.0f;
}

bool Bsdf::sampleSpecular(Sampler& sampler, BsdfSample& out) const {
  const vec2 u = sampler.next2D();
  out.roughness = smooth_ ? 0.0f : alpha_;
  if (smooth_) {
    out.delta = true;
    out.direction = vec3(-out_.x, -out_.y, out_.z);
    out.weight = fresnel(out_.z) / lobes_.specular;
    return true;
  }
  const vec3 micro = sampleVisible(u);
  out.direction = glm::normalize(2.0f * glm::dot(out_, micro) * micro - out_);
  return out.direction.z > 0.0f;
}

bool Bsdf::sampleTransmission(Sampler& sampler, BsdfSample& out) const {
  const vec2 u = sampler.next2D();
  out.roughness = smooth_ ? 0.0f : alpha_;
  out.transmitted = true;
  const vec3 micro = smooth_ ? vec3(0.0f, 0.0f, 1.0f) : sampleVisible(u);
  if (refracts_) {
    if (!refract(micro, out.direction)) return false;
    out.etaSquared = eta_ * eta_;
  } else if (smooth_) {
    out.direction = -out_;
  } else {
    const vec3 mirrored = glm::normalize(2.0f * glm::dot(out_, micro) * micro - out_);
    if (mirrored.z <= 0.0f) return false;
    out.direction = vec3(mirrored.x, mirrored.y, -mirrored.z);
  }
  if (smooth_) {
    out.delta = true;
    const vec3 through = vec3(1.0f) - glassReflectance(out_.z);
    const float compression = refracts_ ? 1.0f / (eta_ * eta_) : 1.0f;
    out.weight = transmissionTint_ * (through * compression / lobes_.transmission);
  }
  return true;
}

bool Bsdf::sample(Sampler& sampler, BsdfSample& out) const {
  return sample(sampler, sampler.next1D(), out);
}

bool Bsdf::sample(Sampler& sampler, float choice, BsdfSample& out) const {
  out = BsdfSample{};
  bool found = false;
  if (finished_) {
    if (choice < lobes_.coat) return sampleCoat(sampler, out);
    choice -= lobes_.coat;
  }
  // A sheen is so broad that the diffuse lobe's directions do for it.
  if (choice < lobes_.diffuse + lobes_.sheen) {
    out.direction = cosineSample(sampler.next2D());
    found = out.direction.z > 0.0f;
  } else if (choice < lobes_.diffuse + lobes_.sheen + lobes_.specular) {
    found = sampleSpecular(sampler, out);
  } else if (lobes_.transmission > 0.0f) {
    found = sampleTransmission(sampler, out);
  }
  if (!found) return false;
  const vec3 local = out.direction;
  out.direction = basis_.toWorld(local);
  const bool through = glm::dot(out.direction, geometricNormal_) < 0.0f;
  if (out.transmitted ? !through : !aboveHorizon(out.direction)) return false;
  if (finished_) return finishSample(local, out);
  if (out.delta) return true;
  const BsdfValue value = out.transmitted
                              ? BsdfValue{evaluateTransmission(local), pdfTransmission(local)}
                              : reflection(local, LobeKind::kAll);
  out.pdf = value.pdf;
  if (!(out.pdf > 0.0f)) return false;
  out.weight = value.f / out.pdf;
  return true;
}

bool Bsdf::goesOnSharp(Sampler& sampler, BsdfSample& sampled) const {
  if (!sharp() || !hasBroad()) return sharp();
  const vec3 sharp = evaluate(sampled.direction, LobeKind::kSharp),
             broad = evaluate(sampled.direction, LobeKind::kBroad);
  const float both = luminance(sharp + broad);
  if (!(both > 0.0f)) return false;
  const float chance = luminance(sharp) / both;
  const bool taken = sampler.next1D() < chance;
  sampled.weight = taken ? sharp / (sampled.pdf * chance) : broad / (sampled.pdf * (1.0f - chance));
  return taken;
}

float Bsdf::photonFactor(const vec3& next) const {
  return trex::photonFactor(geometricNormal_, basis_.tangent, basis_.bitangent, basis_.normal, out_,
                            next);
}

}  // namespace trex
