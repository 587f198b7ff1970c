// Numbers, vectors, transforms and colours of a Mitsuba scene.
#include <algorithm>
#include <array>
#include <glm/gtc/matrix_transform.hpp>

#include "src/scene/fresnel.h"
#include "src/scene/image_io.h"
#include "src/scene/input_file.h"
#include "src/scene/mitsuba_context.h"
#include "src/scene/spectra.h"

namespace trex::detail::mitsuba {
namespace {

/// The next entry of a list whose entries end at blanks and commas.
std::string_view nextEntry(std::string_view& text) {
  constexpr std::string_view kEnds = " ,;\t\r\n";
  text.remove_prefix(std::min(text.find_first_not_of(kEnds), text.size()));
  const std::size_t end = std::min(text.find_first_of(kEnds), text.size());
  const std::string_view entry = text.substr(0, end);
  text.remove_prefix(end);
  return entry;
}

dmat4 lookAtOf(Context& context, const Element& e) {
  const auto list = [&](std::string_view name, const dvec3& otherwise) {
    const std::vector<double> n = numbersOf(e.attribute(name));
    return n.size() == 3 ? dvec3(n[0], n[1], n[2]) : otherwise;
  };
  const dvec3 origin = list("origin", dvec3(0.0)), target = list("target", dvec3(0.0, 0.0, 1.0));
  dvec3 up = list("up", dvec3(0.0));
  const dvec3 forward = glm::normalize(target - origin);
  if (!(glm::length(glm::cross(up, forward)) > 1e-12 * glm::length(up))) {
    up = std::abs(forward.y) < 0.9 ? dvec3(0.0, 1.0, 0.0) : dvec3(0.0, 0.0, 1.0);
  }
  const dvec3 left = glm::normalize(glm::cross(up, forward));
  const dmat4 m(glm::dvec4(left, 0.0), glm::dvec4(glm::cross(forward, left), 0.0),
                glm::dvec4(forward, 0.0), glm::dvec4(origin, 1.0));
  if (usable(m)) return m;
  context.replace(e, "a lookat without a direction is left out");
  return dmat4(1.0);
}

dmat4 matrixOf(Context& context, const Element& e) {
  const std::vector<double> n = numbersOf(e.attribute("value"));
  dmat4 m(1.0);
  if (n.size() == 16 || n.size() == 9) {
    const int side = n.size() == 16 ? 4 : 3;
    for (int row = 0; row < side; ++row) {
      for (int column = 0; column < side; ++column) m[column][row] = n[row * side + column];
    }
  } else {
    context.replace(e, "a matrix has 9 or 16 numbers; it is left out");
  }
  if (n.size() != 16) return m;
  if (n[12] != 0.0 || n[13] != 0.0 || n[14] != 0.0 || n[15] == 0.0) {
    context.replace(e, "a matrix that is not affine is left out");
    return dmat4(1.0);
  }
  m /= n[15];
  return m;
}

dmat4 stepOf(Context& context, const Element& e) {
  if (e.tag == "translate") return glm::translate(dmat4(1.0), vectorOf(context, e, 0.0));
  if (e.tag == "scale") return glm::scale(dmat4(1.0), vectorOf(context, e, 1.0));
  if (e.tag == "rotate") {
    const dvec3 axis = vectorOf(context, e, 0.0);
    const double angle = glm::radians(numberOf(context, e, "angle", 0.0));
    // In two dimensions there is no axis to give.
    const bool flat = axis == dvec3(0.0);
    return glm::rotate(dmat4(1.0), angle, flat ? dvec3(0.0, 0.0, 1.0) : glm::normalize(axis));
  }
  if (e.tag == "lookat" || e.tag == "lookAt") return lookAtOf(context, e);
  if (e.tag == "matrix") return matrixOf(context, e);
  context.replace(e, fmt::format("<{:.40}> is no transform; it is left out", e.tag));
  return dmat4(1.0);
}

vec3 rgbOf(Context& context, const Element& e) {
  const std::string_view text = trimmed(e.attribute("value"));
  if (text.size() == 7 && text.front() == '#') {
    const auto hex = std::strtoul(std::string(text.substr(1)).c_str(), nullptr, 16);
    vec3 color;
    for (int c = 0; c < 3; ++c) {
      color[c] = decodeSrgb8(static_cast<std::uint8_t>(hex >> (16 - 8 * c) & 0xff));
    }
    return color;
  }
  const std::vector<double> n = numbersOf(text);
  vec3 color(0.0f);
  if (n.size() == 1 || n.size() == 3) {
    for (int c = 0; c < 3; ++c) color[c] = static_cast<float>(n[n.size() == 1 ? 0 : c]);
  } else {
    context.replace(e, "a colour has one number or three; black is used");
  }
  if (e.tag == "srgb") {
    for (int c = 0; c < 3; ++c) color[c] = decodeSrgb(std::clamp(color[c], 0.0f, 1.0f));
  }
  return color;
}

/// "nm:value, nm:value", or lines of two numbers of a file.
SampledSpectrum samplesOf(Context& context, const Element& e) {
  SampledSpectrum spectrum;
  std::string text(e.attribute("value"));
  if (const std::string_view name = e.attribute("filename"); !name.empty()) {
    const auto path = context.file(name);
    noteFile(context.scene(), path);
    const auto bytes = readWholeFile(path, context.document().where(e), std::uint64_t{1} << 24);
    text.assign(bytes.begin(), bytes.end());
    for (std::size_t at = text.find('#'); at != text.npos; at = text.find('#', at)) {
      const std::size_t end = std::min(text.find('\n', at), text.size());
      text.replace(at, end - at, end - at, ' ');
    }
  }
  std::replace(text.begin(), text.end(), ':', ' ');
  const std::vector<double> n = numbersOf(text);
  for (std::size_t i = 0; i + 1 < n.size(); i += 2) {
    spectrum.nanometres.push_back(static_cast<float>(n[i]));
    spectrum.values.push_back(static_cast<float>(n[i + 1]));
  }
  spectrum.sanitise();
  if (spectrum.nanometres.size() < 2)
    context.replace(e, "a spectrum without values; black is used");
  return spectrum;
}

/// A value of a spectrum that is written as an object: "value" of <float name="value"/>.
std::string_view valueIn(const Element& e, std::string_view name) {
  for (const Element& child : e.children) {
    if (child.name() == name) return child.attribute("value");
  }
  return {};
}

/// Values at the wavelengths that are listed, or evenly spread from the first to the last.
SampledSpectrum tableOf(Context& context, const Element& e) {
  SampledSpectrum spectrum;
  const std::vector<double> values = numbersOf(valueIn(e, "values"));
  std::vector<double> at = numbersOf(valueIn(e, "wavelengths"));
  if (e.type() == "regular") {
    const auto end = [&](const char* name, const char* old, double otherwise) {
      const std::string_view given = valueIn(e, name);
      const std::vector<double> n = numbersOf(given.empty() ? valueIn(e, old) : given);
      return n.size() == 1 ? n[0] : otherwise;
    };
    const double first = end("wavelength_min", "lambda_min", 360.0);
    const double last = end("wavelength_max", "lambda_max", 830.0);
    at.clear();
    for (std::size_t i = 0; i < values.size(); ++i) {
      at.push_back(first + (last - first) * double(i) / std::max(double(values.size()) - 1.0, 1.0));
    }
  }
  for (std::size_t i = 0; i < std::min(at.size(), values.size()); ++i) {
    spectrum.nanometres.push_back(static_cast<float>(at[i]));
    spectrum.values.push_back(static_cast<float>(values[i]));
  }
  spectrum.sanitise();
  if (spectrum.nanometres.size() < 2 || at.size() != values.size()) {
    context.replace(e, "a spectrum needs as many wavelengths as values, two at least");
  }
  return spectrum;
}

/// A spectrum that is written as an object of a type.
vec3 typedSpectrumOf(Context& context, const Element& e, ColorKind kind) {
  const auto number = [&](const char* name, double otherwise) {
    const std::vector<double> n = numbersOf(valueIn(e, name));
    return static_cast<float>(n.size() == 1 ? n[0] : otherwise);
  };
  const std::string_view type = e.type();
  if (type == "uniform") return vec3(number("value", 1.0));
  if (type == "blackbody") return blackbodyRgb(number("temperature", 0.0), false);
  if (type == "regular" || type == "irregular") {
    const SampledSpectrum table = tableOf(context, e);
    return kind == ColorKind::kEmission ? emissionRgb(table) : reflectanceRgb(table);
  }
  // Colours, and D65 that is white or has one.
  vec3 color(1.0f);
  for (const Element& child : e.children) {
    if (child.name() == "color") color = colorOf(context, child, kind);
  }
  return type == "d65" ? color * number("scale", 1.0) : color;
}

vec3 spectrumOf(Context& context, const Element& e, ColorKind kind) {
  const std::string_view value = e.attribute("value");
  if (e.attribute("filename").empty() && value.find(':') == value.npos) {
    return rgbOf(context, e);
  }
  const SampledSpectrum samples = samplesOf(context, e);
  return kind == ColorKind::kEmission ? emissionRgb(samples) : reflectanceRgb(samples);
}

}  // namespace

std::vector<double> numbersOf(std::string_view text) {
  std::vector<double> numbers;
  for (std::string_view entry = nextEntry(text); !entry.empty(); entry = nextEntry(text)) {
    double value = 0.0;
    if (!parseDouble(entry, value) || !std::isfinite(value)) return {};
    numbers.push_back(value);
  }
  return numbers;
}

double numberOf(Context& context, const Element& element, std::string_view attribute,
                double otherwise) {
  const std::string_view text = element.attribute(attribute);
  if (text.empty() && attribute != "value") return otherwise;
  const std::vector<double> n = numbersOf(text);
  if (n.size() == 1) return n[0];
  context.replace(element, fmt::format("'{:.40}' is not a number; {} is used", text, otherwise));
  return otherwise;
}

dvec3 vectorOf(Context& context, const Element& element, double otherwise) {
  if (const std::string_view text = element.attribute("value"); !text.empty()) {
    const std::vector<double> n = numbersOf(text);
    if (n.size() == 1) return dvec3(n[0]);
    if (n.size() == 2) return dvec3(n[0], n[1], otherwise);
    if (n.size() == 3) return dvec3(n[0], n[1], n[2]);
    context.replace(element, fmt::format("'{:.40}' is no vector; {} is used", text, otherwise));
    return dvec3(otherwise);
  }
  return {numberOf(context, element, "x", otherwise), numberOf(context, element, "y", otherwise),
          numberOf(context, element, "z", otherwise)};
}

dmat4 transformOf(Context& context, const Element& element) {
  dmat4 m(1.0);
  for (const Element& child : element.children) m = stepOf(context, child) * m;
  return m;
}

bool isColor(const Element& e) {
  constexpr std::array<std::string_view, 7> kTags = {"rgb",       "srgb",  "spectrum", "color",
                                                     "blackbody", "float", "integer"};
  constexpr std::array<std::string_view, 7> kTypes = {"uniform",   "d65",  "blackbody", "regular",
                                                      "irregular", "srgb", "rgb"};
  const auto among = [](const auto& names, std::string_view name) {
    return std::find(names.begin(), names.end(), name) != names.end();
  };
  return among(kTags, e.tag) || (e.tag == "texture" && among(kTypes, e.type()));
}

vec3 colorOf(Context& context, const Element& e, ColorKind kind) {
  vec3 color(0.0f);
  if (e.tag == "blackbody") {
    std::string_view text = trimmed(e.attribute("temperature"));
    if (!text.empty() && (text.back() == 'K' || text.back() == 'k')) text.remove_suffix(1);
    double kelvin = 0.0;
    if (!parseDouble(text, kelvin)) context.replace(e, "no temperature; black is used");
    color = blackbodyRgb(kelvin, false) * static_cast<float>(numberOf(context, e, "scale", 1.0));
  } else if (e.tag == "texture" || !e.type().empty()) {
    color = typedSpectrumOf(context, e, kind);
  } else if (e.tag == "spectrum") {
    color = spectrumOf(context, e, kind);
  } else {
    color = rgbOf(context, e);
  }
  const vec3 kept = glm::clamp(color, 0.0f, kind == ColorKind::kReflectance ? 1.0f : 1e30f);
  return isFinite(kept) ? kept : vec3(0.0f);
}

bool usable(const dmat4& m) {
  const glm::dmat3 linear(m);
  const double scale = glm::length(linear[0]) * glm::length(linear[1]) * glm::length(linear[2]);
  const double determinant = glm::determinant(linear);
  return std::isnormal(determinant) && std::abs(determinant) > 1e-12 * scale &&
         isFinite(vec3(m[3]));
}

}  // namespace trex::detail::mitsuba
