#include "src/crays/lobe_mean.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "src/crays/microfacet.h"

namespace trex {
namespace {

constexpr int kCosines = 20, kAlphas = 16, kTurns = 8, kRadii = 16;

float fifth(float x) { return x * x * x * x * x; }

/// Nodes are closer where the cosine, or alpha, is small: their square roots are even.
struct Place {
  int node;
  float after;  ///< share of the next one
};
Place placeOf(float value, int nodes) {
  const float x = std::sqrt(std::clamp(value, 0.0f, 1.0f)) * (static_cast<float>(nodes) - 1.0f);
  const int node = std::min(static_cast<int>(x), nodes - 2);
  return {node, x - static_cast<float>(node)};
}
float valueOf(int node, int nodes) {
  const float root = static_cast<float>(node) / (static_cast<float>(nodes) - 1.0f);
  return std::max(root * root, 1e-4f);
}

/// Calls visit(u) for points that are even in the unit square, half of it by symmetry.
template <typename Visit>
void overHalfSquare(Visit visit) {
  for (int i = 0; i < kRadii; ++i) {
    for (int j = 0; j < kTurns; ++j) {
      visit(vec2((static_cast<float>(i) + 0.5f) / kRadii,
                 0.5f * (static_cast<float>(j) + 0.5f) / kTurns));
    }
  }
}

vec3 directionOf(float cosine) {
  return {std::sqrt(std::max(0.0f, 1.0f - cosine * cosine)), 0.0f, cosine};
}

class Tables {
 public:
  Tables() {
    for (int i = 0; i < kCosines; ++i) {
      const float cosine = valueOf(i, kCosines);
      for (int j = 0; j < kAlphas; ++j) gloss_[i][j] = ofGloss(cosine, valueOf(j, kAlphas));
      diffuse_[i] = ofDiffuse(cosine);
    }
  }
  LobeMean gloss(float cosine, float alpha) const {
    const Place c = placeOf(cosine, kCosines), a = placeOf(alpha, kAlphas);
    const auto between = [&](float LobeMean::*what) {
      const auto row = [&](int i) {
        const auto& of = gloss_[i];
        return glm::mix(of[a.node].*what, of[a.node + 1].*what, a.after);
      };
      return glm::mix(row(c.node), row(c.node + 1), c.after);
    };
    return {between(&LobeMean::energy), between(&LobeMean::cosine)};
  }
  float diffuse(float cosine) const {
    const Place c = placeOf(cosine, kCosines);
    return glm::mix(diffuse_[c.node], diffuse_[c.node + 1], c.after);
  }

 private:
  static float cosineOf(double weight) {
    return 1.0f - static_cast<float>(std::pow(std::clamp(weight, 0.0, 1.0), 0.2));
  }
  static LobeMean ofGloss(float cosine, float alpha) {
    const vec3 out = directionOf(cosine);
    double energy = 0.0, weight = 0.0;
    overHalfSquare([&](vec2 u) {
      const vec3 micro = ggxSampleVisible(out, alpha, vec2(u.x, u.y + 0.25f));
      const float met = glm::dot(out, micro), in = 2.0f * met * micro.z - out.z;
      if (!(in > 0.0f)) return;
      const double share =
          double(ggxMaskingShadowing(out.z, in, alpha)) / double(ggxMasking(out.z, alpha));
      energy += share;
      weight += share * double(fifth(1.0f - std::min(met, 1.0f)));
    });
    return {static_cast<float>(energy / (kRadii * kTurns)),
            energy > 0.0 ? cosineOf(weight / energy) : cosine};
  }
  static float ofDiffuse(float cosine) {
    const vec3 out = directionOf(cosine);
    double weight = 0.0;
    overHalfSquare([&](vec2 u) {
      const vec3 half = glm::normalize(out + cosineSample(u));
      weight += double(fifth(1.0f - std::min(glm::dot(out, half), 1.0f)));
    });
    return cosineOf(weight / (kRadii * kTurns));
  }

  std::array<std::array<LobeMean, kAlphas>, kCosines> gloss_;
  std::array<float, kCosines> diffuse_;
};

const Tables& tables() {
  static const Tables made;
  return made;
}

}  // namespace

LobeMean ggxMean(float cosine, float alpha) { return tables().gloss(cosine, alpha); }

float diffuseMeanCosine(float cosine) { return tables().diffuse(cosine); }

float lowerMeanWeight(float cosine) {
  const float x = std::clamp(1.0f - cosine, 0.0f, 1.0f), x5 = fifth(x), x6 = x5 * x;
  return x5 * (1.0f - cosine * cosine) + (1.0f - x6) / 3.0f - 2.0f * (1.0f - x6 * x) / 7.0f;
}

}  // namespace trex
