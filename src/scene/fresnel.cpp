#include "src/scene/fresnel.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace trex::detail {
namespace {

struct NamedConductor {
  const char* name;
  vec3 eta, k;
};

constexpr std::array kConductors = {
    NamedConductor{"a-C", {2.9440f, 2.2271f, 1.9682f}, {0.8875f, 0.7993f, 0.8153f}},
    NamedConductor{"Ag", {0.1553f, 0.1167f, 0.1384f}, {4.8284f, 3.1222f, 2.1469f}},
    NamedConductor{"Al", {1.6575f, 0.8804f, 0.5212f}, {9.2238f, 6.2695f, 4.8370f}},
    NamedConductor{"AlAs", {3.6053f, 3.2329f, 2.2163f}, {0.0007f, 0.0000f, 0.0075f}},
    NamedConductor{"Au", {0.1430f, 0.3753f, 1.4420f}, {3.9830f, 2.3856f, 1.6034f}},
    NamedConductor{"Be", {4.1850f, 3.1850f, 2.7841f}, {3.8355f, 3.0101f, 2.8690f}},
    NamedConductor{"Cr", {4.3697f, 2.9165f, 1.6549f}, {5.2065f, 4.2313f, 3.7547f}},
    NamedConductor{"CsI", {2.1449f, 1.7023f, 1.6624f}, {0.0f, 0.0f, 0.0f}},
    NamedConductor{"Cu", {0.2010f, 0.9237f, 1.1022f}, {3.9133f, 2.4530f, 2.1421f}},
    NamedConductor{"Cu2O", {3.5518f, 2.9499f, 2.7519f}, {0.1142f, 0.1939f, 0.6061f}},
    NamedConductor{"CuO", {3.2475f, 2.4478f, 2.2102f}, {0.5211f, 0.5700f, 0.7222f}},
    NamedConductor{"CuZn", {0.444f, 0.527f, 1.094f}, {3.695f, 2.765f, 1.829f}},
    NamedConductor{"d-C", {2.7087f, 2.3188f, 2.2289f}, {0.0f, 0.0f, 0.0f}},
    NamedConductor{"Hg", {2.3989f, 1.4400f, 0.9096f}, {6.3276f, 4.3719f, 3.4218f}},
    NamedConductor{"HgTe", {4.7790f, 3.2312f, 2.6599f}, {1.6316f, 1.5808f, 1.7293f}},
    NamedConductor{"Ir", {3.0863f, 2.0822f, 1.6179f}, {5.5922f, 4.0671f, 3.2673f}},
    NamedConductor{"K", {0.0640f, 0.0464f, 0.0382f}, {2.1042f, 1.3489f, 0.9131f}},
    NamedConductor{"Li", {0.2658f, 0.1956f, 0.2209f}, {3.5402f, 2.3111f, 1.6686f}},
    NamedConductor{"MgO", {2.0896f, 1.6507f, 1.5949f}, {0.0f, 0.0f, 0.0f}},
    NamedConductor{"Mo", {4.4840f, 3.5251f, 2.7763f}, {4.1114f, 3.4208f, 3.1506f}},
    NamedConductor{"Na", {0.0603f, 0.0561f, 0.0620f}, {3.1793f, 2.1125f, 1.5790f}},
    NamedConductor{"Nb", {3.4201f, 2.7901f, 2.3956f}, {3.4414f, 2.7377f, 2.5797f}},
    NamedConductor{"Ni", {2.3673f, 1.6634f, 1.4671f}, {4.4988f, 3.0502f, 2.3454f}},
    NamedConductor{"Rh", {2.5858f, 1.8602f, 1.5543f}, {6.7823f, 4.7030f, 3.9761f}},
    NamedConductor{"Se", {4.0583f, 2.8429f, 2.8209f}, {0.7540f, 0.6384f, 0.5218f}},
    NamedConductor{"SiC", {3.1723f, 2.5260f, 2.4794f}, {0.0f, 0.0f, 0.0f}},
    NamedConductor{"SnTe", {4.5242f, 1.9816f, 1.2816f}, {0.0f, 0.0f, 0.0f}},
    NamedConductor{"Ta", {2.0627f, 2.3929f, 2.6279f}, {2.4084f, 1.7415f, 1.9470f}},
    NamedConductor{"Te", {7.3902f, 4.4821f, 2.6371f}, {3.2560f, 3.5271f, 3.2921f}},
    NamedConductor{"ThF4", {1.8307f, 1.4422f, 1.3876f}, {0.0f, 0.0f, 0.0f}},
    NamedConductor{"TiC", {3.7005f, 2.8374f, 2.5823f}, {3.2656f, 2.3516f, 2.1728f}},
    NamedConductor{"TiN", {1.6484f, 1.1505f, 1.3798f}, {3.3683f, 1.9435f, 1.1021f}},
    NamedConductor{"TiO2", {3.4566f, 2.8017f, 2.9052f}, {0.0001f, 0.0f, 0.0007f}},
    NamedConductor{"V", {4.2776f, 3.5129f, 2.7611f}, {3.4913f, 2.8894f, 3.1115f}},
    NamedConductor{"VC", {3.6576f, 2.7528f, 2.5327f}, {3.0683f, 2.1987f, 1.9632f}},
    NamedConductor{"VN", {2.8656f, 2.1192f, 1.9401f}, {3.0322f, 2.0561f, 1.6163f}},
    NamedConductor{"W", {4.3708f, 3.3002f, 2.9984f}, {3.5006f, 2.6049f, 2.2732f}},
};

struct NamedDielectric {
  const char* name;
  float ior;
};

constexpr std::array<NamedDielectric, 29> kDielectrics = {{{"vacuum", 1.0f},
                                                           {"helium", 1.000036f},
                                                           {"hydrogen", 1.000132f},
                                                           {"air", 1.000277f},
                                                           {"carbon dioxide", 1.00045f},
                                                           {"water", 1.333f},
                                                           {"acetone", 1.36f},
                                                           {"ethanol", 1.361f},
                                                           {"carbon tetrachloride", 1.461f},
                                                           {"glycerol", 1.4729f},
                                                           {"benzene", 1.501f},
                                                           {"silicone oil", 1.52045f},
                                                           {"bromine", 1.661f},
                                                           {"water ice", 1.31f},
                                                           {"fused quartz", 1.458f},
                                                           {"pyrex", 1.47f},
                                                           {"acrylic glass", 1.49f},
                                                           {"polypropylene", 1.49f},
                                                           {"bk7", 1.5046f},
                                                           {"sodium chloride", 1.544f},
                                                           {"amber", 1.55f},
                                                           {"pet", 1.575f},
                                                           {"diamond", 2.419f},
                                                           {"baf10", 1.67f},
                                                           {"fk51a", 1.487f},
                                                           {"lasf9", 1.85f},
                                                           {"sf5", 1.6727f},
                                                           {"sf10", 1.7283f},
                                                           {"sf11", 1.7847f}}};

template <typename Of>
vec3 byColor(const ComplexIor& ior, const Of& of) {
  vec3 result;
  for (int c = 0; c < 3; ++c) {
    result[c] = static_cast<float>(of(std::complex<double>(ior.eta[c], ior.k[c])));
  }
  return result;
}

}  // namespace

double fresnelReflectance(double cosine, std::complex<double> index) {
  cosine = std::clamp(cosine, 0.0, 1.0);
  const std::complex<double> sine2 = (1.0 - cosine * cosine) / (index * index);
  const std::complex<double> cosT = std::sqrt(1.0 - sine2);
  const std::complex<double> parallel = (index * cosine - cosT) / (index * cosine + cosT);
  const std::complex<double> perpendicular = (cosine - index * cosT) / (cosine + index * cosT);
  const double r = 0.5 * (std::norm(parallel) + std::norm(perpendicular));
  return std::isfinite(r) ? std::clamp(r, 0.0, 1.0) : 1.0;
}

double meanReflectance(std::complex<double> index) {
  // The integral of F(c) 2c is that of F(sqrt(x)) over x in [0, 1].
  constexpr int kSteps = 1024;
  double sum = 0.0;
  for (int i = 0; i < kSteps; ++i) sum += fresnelReflectance(std::sqrt((i + 0.5) / kSteps), index);
  return sum / kSteps;
}

vec3 ComplexIor::normalReflectance() const {
  return byColor(*this, [](std::complex<double> n) { return fresnelReflectance(1.0, n); });
}

vec3 ComplexIor::meanReflectance() const {
  return byColor(*this, [](std::complex<double> n) { return detail::meanReflectance(n); });
}

void setMetal(const ComplexIor& index, Material& material) {
  material.metallic = 1.0f;
  material.baseColor = vec4(vec3(1.0f), material.baseColor.a);
  if (index.eta == vec3(0.0f)) return;  // a perfect mirror
  material.finish.metalEta = glm::clamp(index.eta, 0.0f, Finish::kMostMetalIndex);
  material.finish.metalK = glm::clamp(index.k, 0.0f, Finish::kMostMetalIndex);
}

Material withMeanMetal(Material material) {
  Finish& f = material.finish;
  if (!f.conducts()) return material;
  const vec3 mean = ComplexIor{f.metalEta, f.metalK}.meanReflectance();
  material.baseColor *= vec4(glm::mix(vec3(1.0f), mean, material.metallic), 1.0f);
  f.metalEta = f.metalK = vec3(0.0f);
  return material;
}

std::optional<ComplexIor> conductorNamed(const std::string& name) {
  const std::string plain = name.substr(0, name.find("_palik"));
  if (plain == "none") return ComplexIor{vec3(0.0f), vec3(1.0f)};
  for (const NamedConductor& c : kConductors) {
    if (plain == c.name) return ComplexIor{c.eta, c.k};
  }
  return {};
}

std::optional<float> dielectricNamed(std::string name) {
  std::transform(name.begin(), name.end(), name.begin(), [](unsigned char c) {
    return static_cast<char>(c >= 'A' && c <= 'Z' ? c - 'A' + 'a' : c == '_' ? ' ' : c);
  });
  for (const NamedDielectric& d : kDielectrics) {
    if (name == d.name) return d.ior;
  }
  return {};
}

}  // namespace trex::detail
