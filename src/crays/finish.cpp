#include "src/crays/finish.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

namespace trex {
namespace {

// Numbers are the paper's.
float sheenFit(float x, float alpha) {
  const float smooth = (1.0f - alpha) * (1.0f - alpha);
  const auto between = [&](float rough, float fine) { return rough + smooth * (fine - rough); };
  const float a = between(21.5473f, 25.3245f), b = between(3.82987f, 3.32435f),
              c = between(0.19823f, 0.16801f), d = between(-1.97760f, -1.27393f),
              e = between(-4.32054f, -4.85967f);
  return a / (1.0f + b * std::pow(x, c)) + d * x + e;
}

float sheenLambda(float cosine, float alpha) {
  return cosine < 0.5f ? std::exp(sheenFit(cosine, alpha))
                       : std::exp(2.0f * sheenFit(0.5f, alpha) - sheenFit(1.0f - cosine, alpha));
}

float sheenDensity(float cosine, float alpha) {
  const float sine2 = std::max(1.0f - cosine * cosine, 0.0f);
  return (2.0f + 1.0f / alpha) * std::pow(sine2, 0.5f / alpha) / (2.0f * kPi);
}

/// By the square roots of cosine and alpha: it changes most where they are small.
class SheenTable {
 public:
  SheenTable() {
    for (int i = 0; i < kCosines; ++i) {
      const float root = std::max(static_cast<float>(i), 0.25f) / (kCosines - 1.0f);
      for (int j = 0; j < kAlphas; ++j) {
        const float roughness = static_cast<float>(j) / (kAlphas - 1.0f);
        values_[i][j] = integrate(root * root, std::max(roughness * roughness, kLeastSheenAlpha));
      }
    }
  }
  float at(float cosine, float alpha) const {
    const float x = std::sqrt(std::clamp(cosine, 0.0f, 1.0f)) * (kCosines - 1.0f),
                y = std::sqrt(std::clamp(alpha, 0.0f, 1.0f)) * (kAlphas - 1.0f);
    const int i = std::min(static_cast<int>(x), kCosines - 2),
              j = std::min(static_cast<int>(y), kAlphas - 2);
    const float u = x - static_cast<float>(i), v = y - static_cast<float>(j);
    const auto row = [&](int k) { return values_[k][j] * (1.0f - v) + values_[k][j + 1] * v; };
    return row(i) * (1.0f - u) + row(i + 1) * u;
  }

 private:
  static constexpr int kCosines = 24, kAlphas = 24, kHeights = 48, kTurns = 32;
  static float integrate(float cosine, float alpha) {
    const vec3 out(std::sqrt(std::max(0.0f, 1.0f - cosine * cosine)), 0.0f, cosine);
    double sum = 0.0;
    for (int i = 0; i < kHeights; ++i) {
      // Denser towards the horizon: z = h^2.
      const float h = (static_cast<float>(i) + 0.5f) / kHeights, z = h * h;
      const float r = std::sqrt(1.0f - z * z);
      for (int j = 0; j < kTurns; ++j) {
        const float phi = kPi * (static_cast<float>(j) + 0.5f) / kTurns;
        const vec3 in(r * std::cos(phi), r * std::sin(phi), z);
        sum += double(sheenReflection(out, in, alpha)) * 2.0 * double(h);
      }
    }
    const double all = sum * 2.0 * double(kPi) / (kHeights * kTurns);
    return static_cast<float>(std::min(all, 1.0));
  }
  std::array<std::array<float, kAlphas>, kCosines> values_;
};

vec3 square(const vec3& v) { return v * v; }

/// Indices of a base by its reflectance at normal incidence, seen from index `outside`.
vec3 indexOf(const vec3& f0, float outside) {
  const vec3 root = glm::sqrt(glm::clamp(f0, vec3(0.0f), vec3(0.9999f)));
  return outside * (1.0f + root) / (1.0f - root);
}
vec3 reflectance(const vec3& index, float outside) {
  return square((index - outside) / (index + outside));
}

/// Fourier transform of the eye's sensitivity at an optical path difference (metres), as linear
/// Rec. 709.
vec3 sensitivity(float difference, const vec3& shift) {
  const float phase = 2.0f * kPi * difference;
  const vec3 value(5.4856e-13f, 4.4201e-13f, 5.2481e-13f),
      place(1.6810e+06f, 1.7953e+06f, 2.2084e+06f), variance(4.3278e+09f, 9.3046e+09f, 6.6121e+09f);
  vec3 xyz = value * glm::sqrt(2.0f * kPi * variance) * glm::cos(place * phase + shift) *
             glm::exp(-phase * phase * variance);
  xyz.x += 9.7470e-14f * std::sqrt(2.0f * kPi * 4.5282e+09f) *
           std::cos(2.2399e+06f * phase + shift.x) * std::exp(-4.5282e+09f * phase * phase);
  xyz /= 1.0685e-7f;
  return {3.2404542f * xyz.x - 1.5371385f * xyz.y - 0.4985314f * xyz.z,
          -0.9692660f * xyz.x + 1.8760108f * xyz.y + 0.0415560f * xyz.z,
          0.0556434f * xyz.x - 0.2040259f * xyz.y + 1.0572252f * xyz.z};
}

template <typename T>
T schlick(const T& f0, float cosine) {
  const float x = std::clamp(1.0f - cosine, 0.0f, 1.0f);
  return f0 + (T(1.0f) - f0) * (x * x * x * x * x);
}

}  // namespace

float sheenReflection(const vec3& out, const vec3& in, float alpha) {
  const vec3 half = glm::normalize(out + in);
  const float masked = 1.0f + sheenLambda(out.z, alpha) + sheenLambda(in.z, alpha);
  return sheenDensity(half.z, alpha) / (masked * 4.0f * std::max(out.z, 1e-6f));
}

float sheenAlbedo(float cosine, float alpha) {
  static const SheenTable table;
  return table.at(cosine, alpha);
}

vec3 filmReflectance(float cosine, float ior, float nanometres, const vec3& f0) {
  // A film that vanishes has the index of what is outside.
  const float there = glm::smoothstep(0.0f, 0.03f, nanometres);
  const float index = 1.0f + there * (ior - 1.0f);
  const float inside2 = 1.0f - (1.0f - cosine * cosine) / (index * index);
  if (inside2 < 0.0f) return vec3(1.0f);
  const float inside = std::sqrt(inside2);
  const float upper = schlick(((index - 1.0f) / (index + 1.0f)) * ((index - 1.0f) / (index + 1.0f)),
                              cosine),
              passed = 1.0f - upper;
  const vec3 base = indexOf(f0, 1.0f), lower = schlick(reflectance(base, index), inside);
  // Half a wave is lost where light meets what is denser.
  const float upperPhase = index < 1.0f ? kPi : 0.0f;
  vec3 phase(kPi - upperPhase);
  for (int k = 0; k < 3; ++k) phase[k] += base[k] < index ? kPi : 0.0f;
  const float difference = 2.0f * index * nanometres * 1e-9f * inside;

  const vec3 both = glm::clamp(upper * lower, vec3(1e-5f), vec3(0.9999f)), root = glm::sqrt(both);
  const vec3 rest = passed * passed * lower / (1.0f - both);
  vec3 sum = vec3(upper) + rest, term = rest - passed;
  for (int m = 1; m <= 2; ++m) {
    const auto order = static_cast<float>(m);
    term *= root;
    sum += term * 2.0f * sensitivity(order * difference, order * phase);
  }
  return glm::clamp(sum, vec3(0.0f), vec3(1.0f));
}

vec3 conductorReflectance(float cosine, const vec3& eta, const vec3& k) {
  // The square root of the complex 1 - sin^2 / n^2 in real numbers.
  const float c = std::clamp(cosine, 0.0f, 1.0f), c2 = c * c, s2 = 1.0f - c2;
  vec3 result;
  for (int i = 0; i < 3; ++i) {
    const float eta2 = eta[i] * eta[i], k2 = k[i] * k[i];
    const float difference = eta2 - k2 - s2;
    const float size = std::sqrt(difference * difference + 4.0f * eta2 * k2);
    const float twice = 2.0f * c * std::sqrt(std::max(0.5f * (size + difference), 0.0f));
    constexpr float kLeast = 1e-20f;  // grazing along an index of 1 divides nothing by nothing
    const float across = (size + c2 - twice) / std::max(size + c2 + twice, kLeast);
    const float a = c2 * size + s2 * s2, b = twice * s2;
    const float along = across * (a - b) / std::max(a + b, kLeast);
    result[i] = std::clamp(0.5f * (across + along), 0.0f, 1.0f);
  }
  return result;
}

}  // namespace trex
