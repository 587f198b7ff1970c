#include <charconv>
#include <cstdlib>

#include "src/command/parse.h"
#include "src/core/error.h"
#include "src/session/settings.h"
#include "src/session/share_rule.h"

namespace trex {
namespace {

constexpr std::uint32_t kLargestSide = 65536;

bool parseNumber(const char* first, const char* last, std::uint32_t& value) {
  const auto [end, problem] = std::from_chars(first, last, value);
  return problem == std::errc() && end == last;
}

double parsePointSize(const std::string& text) {
  double size = 0.0;
  const auto [end, problem] = std::from_chars(text.data(), text.data() + text.size(), size);
  if (problem != std::errc() || *end != '\0' || !(size >= 1e-9 && size <= 1e9)) {
    fail(ExitCode::kUsage, "--point-size {}: want metres from 1e-9 to 1e9, such as 0.01", text);
  }
  return size;
}

std::uint32_t parseBounces(const std::string& text) {
  std::uint32_t most = Scene::kAnyBounces;
  if (text == "all") return most;
  if (!parseNumber(text.data(), text.data() + text.size(), most) || most == Scene::kAnyBounces) {
    fail(ExitCode::kUsage, "--max-bounces {}: want a number such as 4, or all", text);
  }
  return most;
}

}  // namespace

void parseSize(const std::string& text, std::uint32_t& width, std::uint32_t& height) {
  const std::size_t cross = text.find_first_of("xX");
  const char* data = text.data();
  const bool good = cross != std::string::npos && parseNumber(data, data + cross, width) &&
                    parseNumber(data + cross + 1, data + text.size(), height);
  if (!good || width < 1 || height < 1 || width > kLargestSide || height > kLargestSide) {
    fail(ExitCode::kUsage, "--size {}: want WxH with sides from 1 to {}, such as 640x360", text,
         kLargestSide);
  }
}

std::uint64_t parseBytes(const char* option, const std::string& text) {
  double value = 0.0;
  const auto [end, problem] = std::from_chars(text.data(), text.data() + text.size(), value);
  std::string unit(end, static_cast<const char*>(text.data() + text.size()));
  if (!unit.empty() && (unit.back() == 'B' || unit.back() == 'b')) unit.pop_back();
  if (!unit.empty() && unit.back() == 'i') unit.pop_back();
  double factor = 0.0;
  if (unit.empty()) factor = 1.0;
  if (unit == "K" || unit == "k") factor = 0x1p10;
  if (unit == "M" || unit == "m") factor = 0x1p20;
  if (unit == "G" || unit == "g") factor = 0x1p30;
  if (unit == "T" || unit == "t") factor = 0x1p40;
  if (problem != std::errc() || factor == 0.0 || !(value > 0.0) || value * factor > 0x1p62) {
    fail(ExitCode::kUsage, "{} {}: want a size such as 512M or 8G", option, text);
  }
  return static_cast<std::uint64_t>(value * factor);
}

int parseDevice(const std::string& text) {
  if (text == "none") return RenderSettings::kNoDevice;
  if (text == "auto") return RenderSettings::kBestDevice;
  char* end = nullptr;
  const long number = std::strtol(text.c_str(), &end, 10);
  if (end == text.c_str() || *end != '\0' || number < 0 || number > 255) {
    fail(ExitCode::kUsage, "--device {}: want a number, auto or none", text);
  }
  return static_cast<int>(number);
}

void setExact(const std::string& text, RenderSettings& settings) {
  settings.dial = text == "auto";
  settings.exact = kFirstShare;
  if (settings.dial) return;
  const auto [end, problem] =
      std::from_chars(text.data(), text.data() + text.size(), settings.exact);
  if (problem != std::errc() || *end != '\0' || !(settings.exact >= 0.0 && settings.exact <= 1.0)) {
    fail(ExitCode::kUsage, "--exact {}: want 0 to 1, or auto", text);
  }
}

void addExact(CLI::App& command, RenderSettings& settings) {
  setExact("auto", settings);
  command
      .add_option_function<std::string>(
          "--exact", [&settings](const std::string& text) { setExact(text, settings); },
          "Share of samples traced exactly: 0 fast and biased, 1 a path tracer; auto: of each "
          "region the share that lowers the error most")
      ->default_str(exactText(settings));
}

void setGuess(const std::string& text, RenderSettings& settings) {
  settings.guess = text == "auto"   ? GuessKind::kAuto
                   : text == "ray"  ? GuessKind::kRay
                   : text == "cone" ? GuessKind::kCone
                                    : GuessKind::kMixed;
  if (settings.guess != GuessKind::kMixed) return;
  double& share = settings.coneShare;
  const auto [end, problem] = std::from_chars(text.data(), text.data() + text.size(), share);
  if (problem != std::errc() || *end != '\0' || !(share >= 0.0 && share <= 1.0)) {
    fail(ExitCode::kUsage, "--guess {}: want ray, cone, a share of cones from 0 to 1, or auto",
         text);
  }
}

void addGuess(CLI::App& command, RenderSettings& settings) {
  command
      .add_option_function<std::string>(
          "--guess", [&settings](const std::string& text) { setGuess(text, settings); },
          "Guess of far, wide rays: ray, into cached light; cone, on the device; 0 to 1, cones for "
          "that share of the samples; auto: as much as pays for the device")
      ->default_str(guessText(settings));
}

void addMaxBounces(CLI::App& command, ImportOptions& options) {
  command.add_option_function<std::string>(
      "--max-bounces",
      [&options](const std::string& text) { options.maxBounces = parseBounces(text); },
      "Reflections and scatterings of light, at most: 0 emission alone, 1 direct light too; all "
      "[what a Mitsuba or pbrt file says, else all]");
}

void addImportOptions(CLI::App& command, ImportOptions& options) {
  command.add_option_function<std::string>(
      "--unit", [&options](const std::string& text) { options.unit = parseUnit(text); },
      "Of the numbers of a .ply, .obj or .stl: mm, cm, m, in, ft or metres [m]");
  command
      .add_option_function<std::string>(
          "--up", [&options](const std::string& axis) { options.zUp = axis == "z"; },
          "Axis that points up in a .ply, .obj or .stl: y or z [y]")
      ->check(CLI::IsMember({"y", "z"}));
  command.add_option_function<std::string>(
      "--point-size",
      [&options](const std::string& text) { options.pointSize = parsePointSize(text); },
      "Show the points of a .ply without faces, that many metres across: squares across their "
      "normals, or octahedra [they are refused]");
  addMaxBounces(command, options);
  command.add_option("--scene", options.scene, "Scene of a glTF: name or number [its default]");
  command.add_option("--variant", options.variant,
                     "Variant of a glTF's materials (KHR_materials_variants): name or number");
  command.add_option("--animation", options.animation,
                     "Animation of a glTF, by name or number [the rest pose]");
  command.add_option("--at", options.atSeconds, "Seconds into --animation")
      ->check(CLI::Range(-1e9, 1e9))
      ->capture_default_str();
  command
      .add_option("-D,--define", options.defines,
                  "NAME=VALUE of a parameter of Mitsuba's .xml; may be repeated")
      ->allow_extra_args(false);
  command.add_flag("--strict", options.strict,
                   "A part of the model that can't be shown as it is (a missing texture, a broken "
                   "index) is an error, not a warning");
}

void addDenoise(CLI::App& command, Denoise& denoise) {
  denoise = Denoise::kAuto;
  const auto set = [&denoise](const std::string& name) {
    denoise = name == "off"      ? Denoise::kOff
              : name == "filter" ? Denoise::kFilter
              : name == "oidn"   ? Denoise::kOidn
                                 : Denoise::kAuto;
  };
  command
      .add_option_function<std::string>(
          "--denoise", set,
          "Open Image Denoise (oidn), the filter of this program (filter), the former where it is "
          "there and pays, else the latter, neither of an exact picture (auto), or none (off)")
      ->check(CLI::IsMember({"auto", "oidn", "filter", "off"}))
      ->default_str("auto");
}

void addPhotonBounces(CLI::App& command, PhotonKind& kind) {
  const auto set = [&kind](const std::string& name) {
    kind = name == "ray"     ? PhotonKind::kRay
           : name == "voxel" ? PhotonKind::kVoxel
                             : PhotonKind::kAuto;
  };
  command
      .add_option_function<std::string>("--photon-bounces", set,
                                        "Photons bounce between surfaces (ray), in the voxels on "
                                        "the device (voxel), or (auto) in "
                                        "the voxels if the device has cores of its own")
      ->check(CLI::IsMember({"auto", "ray", "voxel"}))
      ->default_str("auto");
}

}  // namespace trex
