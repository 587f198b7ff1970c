#include "src/scene/pbrt_colors.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "src/scene/chromaticities.h"
#include "src/scene/texture_file.h"

namespace trex::detail {
namespace {

constexpr double kSodium = 589.3;  ///< nanometres

std::optional<Chromaticities> spaceOf(const std::string& name) {
  if (name == "srgb") return kRec709;
  if (name == "dci-p3") {
    return Chromaticities{{{0.68, 0.32}, {0.265, 0.69}, {0.15, 0.06}, {0.3127, 0.3290}}};
  }
  if (name == "rec2020") {
    return Chromaticities{{{0.708, 0.292}, {0.170, 0.797}, {0.131, 0.046}, {0.3127, 0.3290}}};
  }
  if (name == "aces2065-1") {
    return Chromaticities{{{0.7347, 0.2653}, {0.0, 1.0}, {0.0001, -0.077}, {0.32168, 0.33767}}};
  }
  return {};
}

/// Of names such as glass-BK7; pbrt calls flint glass F5 or SF5.
std::optional<float> glassIndex(std::string_view name) {
  if (!name.starts_with("glass-")) return {};
  name.remove_prefix(6);
  return dielectricNamed((name.starts_with("F1") || name == "F5" ? "S" : "") + std::string(name));
}

/// "Cu" of metal-Cu-eta and of spds/Cu.eta.spd.
std::string metalName(std::string_view text) {
  text = text.substr(text.find_last_of("/\\") + 1);
  if (!text.starts_with("metal-")) return std::string(text.substr(0, text.find('.')));
  text.remove_prefix(6);
  return std::string(text.substr(0, text.rfind('-')));
}

vec3 finiteOr(const dvec3& color, const vec3& otherwise) {
  const vec3 narrow(color);
  return isFinite(narrow) ? narrow : otherwise;
}

}  // namespace

bool PbrtColors::setSpace(const std::string& name) {
  const auto space = spaceOf(name);
  if (!space) return false;
  toRec709_ = name == "srgb" ? glm::dmat3(1.0) : glm::inverse(toXyz(kRec709)) * toXyz(*space);
  return true;
}

std::optional<vec3> PbrtColors::triple(const PbrtParameter& p) {
  if (p.numbers.size() != 3) {
    context_.replace("'{}' has {} numbers, not 3; it is left out", p.name, p.numbers.size());
    return {};
  }
  const dvec3 given(p.numbers[0], p.numbers[1], p.numbers[2]);
  const dvec3 color = p.type == "xyz" ? glm::inverse(toXyz(kRec709)) * given : toRec709_ * given;
  if (!isFinite(vec3(color))) {
    context_.replace("'{}' is not finite; it is left out", p.name);
    return {};
  }
  return vec3(color);
}

PbrtColors::Spectrum PbrtColors::spectrumOfFile(const std::string& name) {
  const auto known = files_.find(name);
  if (known != files_.end()) return known->second;
  auto read = std::make_shared<SampledSpectrum>();
  const std::filesystem::path path = findFile(context_.folder, name);
  std::error_code error;
  if (std::filesystem::is_regular_file(path, error)) {
    context_.note(path);
    PbrtTokens tokens(path);
    std::vector<float> values;
    double value = 0.0;
    while (tokens.next() == PbrtTokens::Kind::kWord && parseDouble(tokens.text(), value)) {
      values.push_back(static_cast<float>(value));
    }
    for (std::size_t i = 0; i + 1 < values.size(); i += 2) {
      read->nanometres.push_back(values[i]);
      read->values.push_back(values[i + 1]);
    }
    read->sanitise();
  }
  const Spectrum made = read->nanometres.empty() ? nullptr : std::move(read);
  files_.emplace(name, made);
  return made;
}

/// Of numbers in pairs, or of a file; null if it is neither.
PbrtColors::Spectrum PbrtColors::spectrumOf(const PbrtParameter& p) {
  if (p.numbers.empty()) return p.strings.empty() ? nullptr : spectrumOfFile(p.strings[0]);
  if (p.numbers.size() == 1) {
    return std::make_shared<SampledSpectrum>(SampledSpectrum{
        {0.0f, 1e5f}, {static_cast<float>(p.numbers[0]), static_cast<float>(p.numbers[0])}});
  }
  auto made = std::make_shared<SampledSpectrum>();
  for (std::size_t i = 0; i + 1 < p.numbers.size(); i += 2) {
    made->nanometres.push_back(static_cast<float>(p.numbers[i]));
    made->values.push_back(static_cast<float>(p.numbers[i + 1]));
  }
  made->sanitise();
  return made->nanometres.empty() ? nullptr : std::move(made);
}

std::optional<vec3> PbrtColors::reflectance(const PbrtParameters& parameters,
                                            std::string_view name) {
  const PbrtParameter* p = parameters.find(name);
  if (p == nullptr || p->type == "texture") return {};
  if (p->type == "rgb" || p->type == "xyz") return triple(*p);
  if (p->type == "float" && p->numbers.size() == 1) return finiteOr(dvec3(p->numbers[0]), vec3(0));
  if (p->type == "blackbody" && !p->numbers.empty()) {
    const vec3 color = blackbodyRgb(p->numbers[0], true);
    return color / std::max(maxComponent(color), 1e-6f);
  }
  if (p->type == "spectrum") {
    if (const Spectrum s = spectrumOf(*p)) return finiteOr(dvec3(reflectanceRgb(*s)), vec3(0.5f));
  }
  context_.replace("'{} {}' is no colour that is known here; it is left out", p->type, name);
  return {};
}

std::optional<vec3> PbrtColors::light(const PbrtParameters& parameters, std::string_view name) {
  const PbrtParameter* p = parameters.find(name);
  if (p == nullptr) return {};
  const auto normalised = [&](vec3 color) {
    if (version4) color /= std::max(luminance(color), 1e-12f);
    return glm::max(color, vec3(0.0f));
  };
  if (p->type == "rgb" || p->type == "xyz") {
    const std::optional<vec3> color = triple(*p);
    return color ? std::optional(glm::max(*color, vec3(0.0f))) : color;
  }
  if (p->type == "float" && p->numbers.size() == 1) {
    return vec3(finiteOr(dvec3(std::max(p->numbers[0], 0.0)), vec3(0.0f)));
  }
  if (p->type == "blackbody" && !p->numbers.empty()) {
    const vec3 color = blackbodyRgb(p->numbers[0], true);
    const double scale = version4 || p->numbers.size() < 2 ? 1.0 : p->numbers[1];
    return finiteOr(dvec3(normalised(color)) * std::max(scale, 0.0), vec3(0.0f));
  }
  if (p->type == "spectrum") {
    if (const Spectrum s = spectrumOf(*p)) return normalised(finiteOr(emissionRgb(*s), vec3(0.0f)));
    if (!p->strings.empty() && p->strings[0].starts_with("stdillum-D65")) return vec3(1.0f);
  }
  context_.replace("'{} {}' is no light that is known here; white is shown", p->type, name);
  return vec3(1.0f);
}

/// One of the two parts of a conductor's index, by colour.
std::optional<vec3> PbrtColors::indexPart(const PbrtParameters& parameters, std::string_view name,
                                          bool absorbing) {
  const PbrtParameter* p = parameters.find(name);
  if (p == nullptr) return {};
  if (p->type == "spectrum" && !p->strings.empty()) {
    if (const auto metal = conductorNamed(metalName(p->strings[0]))) {
      return absorbing ? metal->k : metal->eta;
    }
  }
  const std::optional<vec3> color = reflectance(parameters, name);
  return color ? std::optional(glm::max(*color, vec3(0.0f))) : color;
}

ComplexIor PbrtColors::conductor(const PbrtParameters& parameters, std::string_view eta,
                                 std::string_view k) {
  const ComplexIor copper = conductorNamed("Cu").value();
  return {indexPart(parameters, eta, false).value_or(copper.eta),
          indexPart(parameters, k, true).value_or(copper.k)};
}

float PbrtColors::index(const PbrtParameters& parameters, std::string_view name, float otherwise) {
  const PbrtParameter* p = parameters.find(name);
  if (p == nullptr) return otherwise;
  double index = std::nan("");
  if (p->type == "spectrum") {
    const auto glass = p->strings.empty() ? std::nullopt : glassIndex(p->strings[0]);
    const Spectrum s = glass ? nullptr : spectrumOf(*p);
    index = glass ? double{*glass} : s ? double{s->at(kSodium)} : std::nan("");
  } else if (!p->numbers.empty()) {
    index = p->numbers[0];
  }
  if (index > 0.0 && index < 1.0) {
    context_.replace("an index of {} below 1 is not shown; {} is used", index, 1.0 / index);
    index = 1.0 / index;
  }
  if (index >= 1.0 && index <= 10.0) return static_cast<float>(index);
  context_.replace("the index '{}' is not in [1, 10]; {} is used", name, otherwise);
  return otherwise;
}

}  // namespace trex::detail
