// What finishes do to a Bsdf; see bsdf.h.
#include <algorithm>

#include "src/crays/bsdf.h"
#include "src/crays/finish.h"
#include "src/crays/lobe_mean.h"
#include "src/crays/microfacet.h"
#include "src/scene/texture.h"

namespace trex {
namespace {

constexpr float kCoatReflectance = 0.04f;  // of index 1.5, at normal incidence

float coatFresnel(float cosine) {
  const float x = std::clamp(1.0f - cosine, 0.0f, 1.0f);
  return kCoatReflectance + (1.0f - kCoatReflectance) * (x * x * x * x * x);
}

float alphaOf(float roughness) {
  const float r = std::clamp(roughness, 0.0f, 1.0f);
  return r * r;
}

}  // namespace

void Bsdf::readFinish(const Scene& scene, const Surface& surface, const vec3& outgoing) {
  const Finish& f = scene.materials[surface.material].finish;
  const TexCoords& uv = surface.texCoords;
  if (f.anisotropy > 0.0f && surface.tangent != vec3(0.0f)) {
    const vec4 texel = readTexture(scene.images, f.anisotropyTexture, uv, false);
    const vec2 turned =
        f.anisotropyTexture.present() ? 2.0f * vec2(texel) - 1.0f : vec2(1.0f, 0.0f);
    const float c = std::cos(f.anisotropyRotation), s = std::sin(f.anisotropyRotation);
    // Up in a texture is -v; the bitangent points there.
    const vec3 along = (c * turned.x - s * turned.y) * surface.tangent +
                       (s * turned.x + c * turned.y) * surface.bitangent;
    const vec3 flat = along - glm::dot(along, basis_.normal) * basis_.normal;
    const float length = glm::length(flat), strength = f.anisotropy * texel.z;
    if (length > 1e-4f && strength > 0.0f) {
      anisotropic_ = true;
      smooth_ = false;
      alpha_ = std::max(alpha_, kSmallestAlpha);
      across_ = alpha_ + (1.0f - alpha_) * strength * strength;
      sharp_ = across_ <= kSharpAlpha;
      basis_.tangent = flat / length;
      basis_.bitangent = glm::cross(basis_.normal, basis_.tangent);
      out_ = basis_.toLocal(outgoing);
      out_.z = std::max(out_.z, 1e-6f);
    }
  }
  beckmann_ = f.beckmann && !anisotropic_;
  conducts_ = f.conducts();
  metalEta_ = f.metalEta, metalK_ = f.metalK;
  film_ = f.iridescence * readTexture(scene.images, f.iridescenceTexture, uv, false).x;
  filmIor_ = f.iridescenceIor;
  filmNanometres_ = f.iridescenceThinnest +
                    (f.iridescenceThickest - f.iridescenceThinnest) *
                        readTexture(scene.images, f.iridescenceThicknessTexture, uv, false).y;
  if (f.sheens()) {
    sheen_.color = f.sheenColor * vec3(readTexture(scene.images, f.sheenColorTexture, uv, true));
    sheen_.alpha = std::max(
        alphaOf(f.sheenRoughness * readTexture(scene.images, f.sheenRoughnessTexture, uv, false).w),
        kLeastSheenAlpha);
    sheen_.albedo = sheenAlbedo(out_.z, sheen_.alpha);
  }
  coat_.weight = f.clearcoat * readTexture(scene.images, f.clearcoatTexture, uv, false).x;
  if (coat_.weight > 0.0f) {
    coat_.alpha = alphaOf(f.clearcoatRoughness *
                          readTexture(scene.images, f.clearcoatRoughnessTexture, uv, false).y);
    vec3 normal = front_ ? surface.shadingNormal : -surface.shadingNormal;
    if (f.clearcoatNormalTexture.present() && surface.tangent != vec3(0.0f)) {
      const vec3 texel =
          vec3(readTexture(scene.images, f.clearcoatNormalTexture, uv, false)) * 2.0f - 1.0f;
      const vec3 bent =
          f.clearcoatNormalScale * (texel.x * surface.tangent + texel.y * surface.bitangent) +
          texel.z * normal;
      if (glm::length(bent) > 1e-6f) normal = glm::normalize(bent);
    }
    normal = seen(normal, outgoing);
    coat_.basis = Basis(normal);
    coat_.out = coat_.basis.toLocal(outgoing);
    coat_.out.z = std::max(coat_.out.z, 1e-6f);
  }
  finished_ = coat_.weight > 0.0f || sheen_.color != vec3(0.0f);
}

/// Chances that are not yet divided by their sum; those of the base are there.
void Bsdf::addFinishLobes() {
  const float fibres = maxComponent(sheen_.color) * sheen_.albedo,
              coat = coat_.weight * (coat_.weight > 0.0f ? coatFresnel(coat_.out.z) : 0.0f);
  const float base = (1.0f - fibres) * (1.0f - coat);
  lobes_.diffuse *= base;
  lobes_.specular *= base;
  lobes_.transmission *= base;
  lobes_.sheen = luminance(sheen_.color) * sheen_.albedo * (1.0f - coat);
  lobes_.coat = coat;
}

/// Mean of the sheen's albedo at the lower of two directions: the one seen, and all of arriving
/// light, weighted by their cosines.
float Bsdf::lowerSheen() const {
  float sum = 0.0f;
  for (float cosine : {0.408f, 0.707f, 0.913f}) {  // the middle of a third of the light each
    sum += std::max(sheen_.albedo, sheenAlbedo(cosine, sheen_.alpha));
  }
  return sum / 3.0f;
}

/// As underFinish(), of light from everywhere.
vec3 Bsdf::finishAlbedo(const vec3& diffuse, const vec3& gloss, bool coat) const {
  const float color = maxComponent(sheen_.color);
  const float atLower = color > 0.0f ? lowerSheen() : 0.0f;
  const vec3 broad = diffuse * (1.0f - color * atLower) + sheen_.color * sheen_.albedo,
             narrow = gloss * (1.0f - color * sheen_.albedo);
  if (!(coat_.weight > 0.0f)) return broad + narrow;
  // Narrow lobes get light from about the angle that they are seen under.
  const float cosine = coat_.out.z,
              mirrored = glm::mix(kCoatReflectance, 1.0f, lowerMeanWeight(cosine));
  const vec3 below = broad * (1.0f - coat_.weight * mirrored) +
                     narrow * (1.0f - coat_.weight * coatFresnel(cosine));
  if (!coat) return below;
  if (coat_.alpha < kSmallestAlpha) return below + coat_.weight * coatFresnel(cosine);
  const LobeMean mean = ggxMean(cosine, coat_.alpha);
  return below + coat_.weight * coatFresnel(mean.cosine) * mean.energy;
}

/// Whether the coat is such a lobe, and no delta.
bool Bsdf::coatIs(LobeKind kind) const {
  if (!(lobes_.coat > 0.0f) || coat_.alpha < kSmallestAlpha) return false;
  return kind == LobeKind::kAll || (kind == LobeKind::kSharp) == (coat_.alpha <= kSharpAlpha);
}

/// f * |cos|.
vec3 Bsdf::coatReflection(const vec3& incoming) const {
  const vec3 in = coat_.basis.toLocal(incoming);
  if (!(in.z > 0.0f)) return vec3(0.0f);
  const vec3 half = glm::normalize(coat_.out + in);
  return vec3(coat_.weight * coatFresnel(glm::dot(coat_.out, half)) *
              ggxDensity(half.z, coat_.alpha) *
              ggxMaskingShadowing(coat_.out.z, in.z, coat_.alpha) / (4.0f * coat_.out.z));
}

/// Density of the finish's own lobes; in.z > 0.
float Bsdf::finishPdf(const vec3& incoming, const vec3& in) const {
  float p = lobes_.sheen * in.z * kInvPi;
  if (!coatIs(LobeKind::kAll)) return p;
  const vec3 local = coat_.basis.toLocal(incoming);
  if (!(local.z > 0.0f)) return p;
  const vec3 half = glm::normalize(coat_.out + local);
  p += lobes_.coat * ggxVisiblePdf(coat_.out, half, coat_.alpha) /
       (4.0f * glm::dot(coat_.out, half));
  return p;
}

/// Share of light from there that the base gets and gives back; `cosine`, not negative: of that
/// direction, at the base.
float Bsdf::passesFinish(const vec3& incoming, float cosine) const {
  float passes = 1.0f;
  const float color = maxComponent(sheen_.color);
  if (color > 0.0f) {
    passes -= color * std::max(sheen_.albedo, sheenAlbedo(cosine, sheen_.alpha));
  }
  if (coat_.weight > 0.0f) {
    const float lower = std::abs(glm::dot(incoming, coat_.basis.normal));
    passes *= 1.0f - coat_.weight * coatFresnel(std::min(coat_.out.z, lower));
  }
  return passes;
}

/// The base's f * |cos|, and that of the finish over it.
vec3 Bsdf::underFinish(const vec3& base, const vec3& incoming, const vec3& in,
                       LobeKind kind) const {
  vec3 f = base * passesFinish(incoming, std::abs(in.z));
  if (!(in.z > 0.0f)) return f;
  if (lobes_.sheen > 0.0f && kind != LobeKind::kSharp) {
    const float lower = std::abs(glm::dot(incoming, coat_.basis.normal));
    const float passes = coat_.weight > 0.0f
                             ? 1.0f - coat_.weight * coatFresnel(std::min(coat_.out.z, lower))
                             : 1.0f;
    f += sheen_.color * (sheenReflection(out_, in, sheen_.alpha) * passes);
  }
  if (coatIs(kind)) f += coatReflection(incoming);
  return f;
}

bool Bsdf::sampleCoat(Sampler& sampler, BsdfSample& out) const {
  const vec2 u = sampler.next2D();
  const bool smooth = coat_.alpha < kSmallestAlpha;
  const vec3 micro = smooth ? vec3(0.0f, 0.0f, 1.0f) : ggxSampleVisible(coat_.out, coat_.alpha, u);
  const vec3 in = 2.0f * glm::dot(coat_.out, micro) * micro - coat_.out;
  if (!(in.z > 0.0f)) return false;
  out.direction = glm::normalize(coat_.basis.toWorld(in));
  out.roughness = smooth ? 0.0f : coat_.alpha;
  out.delta = smooth;
  const vec3 local = basis_.toLocal(out.direction);
  if (!(local.z > 0.0f) || !aboveHorizon(out.direction)) return false;
  if (smooth) {
    out.weight = vec3(coat_.weight * coatFresnel(coat_.out.z) / lobes_.coat);
    return true;
  }
  return finishSample(local, out);
}

/// Density and weight of a direction that is known; of a delta of the base, what passes.
bool Bsdf::finishSample(const vec3& local, BsdfSample& out) const {
  if (out.delta) {
    // What is refracted lies at another angle; seen from either side it passes once.
    const float cosine = out.transmitted ? out_.z : local.z;
    const vec3 outside = out.transmitted ? basis_.toWorld(out_) : out.direction;
    out.weight *= passesFinish(outside, cosine);
    return true;
  }
  out.pdf = pdf(out.direction);
  if (!(out.pdf > 0.0f)) return false;
  out.weight = evaluate(out.direction) / out.pdf;
  return true;
}

vec3 Bsdf::film(float cosine) const {
  const vec3 dielectric = transmission_ > 0.0f ? glassReflectance(1.0f) : f0_;
  const vec3 f0 = glm::mix(dielectric, conducts_ ? metal(1.0f) : metalColor_, metallic_);
  return filmReflectance(cosine, filmIor_, filmNanometres_, f0);
}

vec3 Bsdf::metal(float cosine) const {
  return metalColor_ * conductorReflectance(cosine, metalEta_, metalK_);
}

// GGX of two roughnesses [Heitz 2014, 2018]: the one of a sphere that is stretched.
float Bsdf::density(const vec3& half) const {
  if (beckmann_) return beckmannDensity(half.z, alpha_);
  if (!anisotropic_) return ggxDensity(half.z, alpha_);
  if (half.z <= 0.0f) return 0.0f;
  const float x = half.x / across_, y = half.y / alpha_, d = x * x + y * y + half.z * half.z;
  return 1.0f / (kPi * across_ * alpha_ * d * d);
}

namespace {
float lambdaOf(const vec3& v, float across, float alpha) {
  const float x = across * v.x, y = alpha * v.y;
  return 0.5f * (std::sqrt(1.0f + (x * x + y * y) / std::max(v.z * v.z, 1e-14f)) - 1.0f);
}
}  // namespace

/// Smith's Lambda; of either side.
float Bsdf::lambda(const vec3& v) const {
  if (beckmann_) return beckmannLambda(v.z, alpha_);
  return anisotropic_ ? lambdaOf(v, across_, alpha_) : ggxLambda(v.z, alpha_);
}

/// Height-correlated, of two directions on the same side.
float Bsdf::maskingShadowing(const vec3& in) const { return 1.0f / (1.0f + masked_ + lambda(in)); }

/// Density of sampleVisible() per solid angle of the micro normal.
float Bsdf::visiblePdf(const Half& half) const {
  if (beckmann_) return half.density * half.up;
  if (anisotropic_) {
    return std::max(half.cosine, 0.0f) * half.density / ((1.0f + masked_) * out_.z);
  }
  return 1.0f / (1.0f + masked_) * std::max(half.cosine, 0.0f) * half.density / out_.z;
}

vec3 Bsdf::sampleVisible(vec2 u) const {
  if (beckmann_) return beckmannSample(alpha_, u);
  return ggxSampleVisible(out_, anisotropic_ ? across_ : alpha_, alpha_, u);
}

}  // namespace trex
