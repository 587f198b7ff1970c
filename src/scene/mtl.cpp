#include "src/scene/mtl.h"

#include <algorithm>

#include "src/scene/image_io.h"
#include "src/scene/import_detail.h"
#include "src/scene/input_file.h"

namespace trex::detail {
namespace {

std::string trimmed(std::string_view text) {
  const char* blanks = " \t\r";
  const std::size_t first = text.find_first_not_of(blanks);
  if (first == text.npos) return {};
  return std::string(text.substr(first, text.find_last_not_of(blanks) - first + 1));
}

class MtlReader {
 public:
  MtlReader(const std::filesystem::path& path, const ImportOptions& options, Scene& scene,
            std::map<std::string, int>& names)
      : input_(path),
        folder_(path.parent_path()),
        options_(options),
        scene_(scene),
        names_(names) {}

  void read() {
    std::string_view line;
    while (input_.readLine(line)) {
      const std::string_view keyword = nextWord(line);
      if (keyword.empty() || keyword.front() == '#') continue;
      if (keyword == "newmtl") {
        finish();
        begin(trimmed(line));
      } else if (current_ != kNone) {
        readStatement(keyword, line);
      }
    }
    finish();
  }

 private:
  Material& material() { return scene_.materials[current_]; }

  void begin(const std::string& name) {
    Material made = defaultMaterial();
    made.name = name;
    current_ = static_cast<int>(scene_.materials.size());
    scene_.materials.push_back(std::move(made));
    names_[name] = current_;
    colorGiven_ = roughnessGiven_ = emissionGiven_ = false;
    specular_ = vec3(0.0f);
    exponent_ = -1.0f;
  }

  void finish() {
    if (current_ == kNone) return;
    Material& m = material();
    if (m.baseColorTexture.present() && !colorGiven_) m.baseColor = vec4(vec3(1.0f), m.baseColor.a);
    if (m.emissiveTexture.present() && !emissionGiven_) m.emission = vec3(1.0f);
    const float strongest = maxComponent(specular_);
    if (strongest > 0.0f) {
      m.specular = std::min(1.0f, 2.0f * strongest);
      m.specularColor = specular_ / strongest;
    }
    if (!roughnessGiven_ && exponent_ >= 0.0f) {
      m.roughness = std::pow(2.0f / (exponent_ + 2.0f), 0.25f);
    }
  }

  float number(std::string_view word, double low, double high) {
    double value = 0.0;
    if (!parseDouble(word, value) || !std::isfinite(value)) {
      fail(ExitCode::kInput, "{}:{}: '{}' is not a number", input_.name(), input_.lineNumber(),
           word.substr(0, 40));
    }
    if (value < low || value > high) {
      scene_.warnings.push_back(fmt::format("{}:{}: {} is out of range and was clamped",
                                            input_.name(), input_.lineNumber(), value));
    }
    return static_cast<float>(std::clamp(value, low, high));
  }

  vec3 color(std::string_view line, double high) {
    const std::string_view red = nextWord(line);
    if (red == "spectral" || red == "xyz") {
      fail(ExitCode::kInput, "{}:{}: only RGB colours are read", input_.name(),
           input_.lineNumber());
    }
    vec3 c(number(red, 0.0, high));
    const std::string_view green = nextWord(line);
    if (!green.empty()) {
      c.y = number(green, 0.0, high);
      c.z = number(nextWord(line), 0.0, high);
    }
    return c;
  }

  void readStatement(std::string_view keyword, std::string_view line) {
    Material& m = material();
    if (keyword == "Kd") {
      m.baseColor = vec4(color(line, 1.0), m.baseColor.a);
      colorGiven_ = true;
    } else if (keyword == "Ks") {
      specular_ = color(line, 1.0);
    } else if (keyword == "Ke") {
      m.emission = color(line, 1e30);
      emissionGiven_ = true;
    } else if (keyword == "Ns") {
      exponent_ = number(nextWord(line), 0.0, 1e9);
    } else if (keyword == "Pr") {
      m.roughness = number(nextWord(line), 0.0, 1.0);
      roughnessGiven_ = true;
    } else if (keyword == "Pm") {
      m.metallic = number(nextWord(line), 0.0, 1.0);
    } else if (keyword == "Ni") {
      m.ior = number(nextWord(line), 1.0, 10.0);
    } else if (keyword == "d" || keyword == "Tr") {
      const float value = number(nextWord(line), 0.0, 1.0);
      m.baseColor.a = keyword == "d" ? value : 1.0f - value;
      m.alphaMode = m.baseColor.a < 1.0f ? AlphaMode::kBlend : AlphaMode::kOpaque;
    } else if (options_.loadTextures && keyword == "map_Kd") {
      m.baseColorTexture = texture(line);
    } else if (options_.loadTextures && keyword == "map_Ke") {
      m.emissiveTexture = texture(line);
    }
  }

  /// "[-option values] file name with blanks"; of the options, -s and -o and -clamp count.
  Texture texture(std::string_view line) {
    Texture made;
    for (;;) {
      std::string_view after = line;
      const std::string_view option = nextWord(after);
      if (option.size() < 2 || option.front() != '-') break;
      std::array<float, 3> values{};
      int count = 0;
      for (std::string_view peek = after; count < 3; after = peek) {
        double value = 0.0;
        const std::string_view word = nextWord(peek);
        if (word == "on" || word == "off") {
          if (option == "-clamp" && word == "on") {
            made.wrapS = made.wrapT = Texture::Wrap::kClamp;
          }
          after = peek;
          break;
        }
        if (!parseDouble(word, value) || !std::isfinite(value)) break;
        values[count++] = static_cast<float>(value);
      }
      line = after;
      // OBJ scales and shifts from the lower left corner, textures here from the upper left.
      if (option == "-s" && count > 0) {
        made.scale = vec2(values[0], count > 1 ? values[1] : values[0]);
        made.offset.y += 1.0f - made.scale.y;
      } else if (option == "-o" && count > 0) {
        made.offset += vec2(values[0], count > 1 ? -values[1] : 0.0f);
      }
    }
    made.image = imageIndex(trimmed(line));
    return made;
  }

  int imageIndex(std::string file) {
    std::replace(file.begin(), file.end(), '\\', '/');
    const std::filesystem::path path = folder_ / file;
    const std::string name = path.string();
    for (std::size_t i = 0; i < scene_.images.size(); ++i) {
      if (scene_.images[i].name == name) return static_cast<int>(i);
    }
    const std::string where = fmt::format("{}:{}: texture", input_.name(), input_.lineNumber());
    noteFile(scene_, path);
    scene_.images.push_back(decodeImage(readWholeFile(path, where), name, true));
    return static_cast<int>(scene_.images.size()) - 1;
  }

  InputFile input_;
  std::filesystem::path folder_;
  const ImportOptions& options_;
  Scene& scene_;
  std::map<std::string, int>& names_;
  int current_ = kNone;
  bool colorGiven_ = false, roughnessGiven_ = false, emissionGiven_ = false;
  vec3 specular_{0.0f};
  float exponent_ = -1.0f;
};

}  // namespace

void readMtl(const std::filesystem::path& path, const ImportOptions& options, Scene& scene,
             std::map<std::string, int>& names) {
  noteFile(scene, path);
  MtlReader(path, options, scene, names).read();
}

}  // namespace trex::detail
