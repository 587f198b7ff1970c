#include "src/scene/mtl.h"

#include <algorithm>
#include <optional>
#include <set>

#include "src/scene/image_make.h"
#include "src/scene/import_detail.h"
#include "src/scene/phong.h"
#include "src/scene/statements.h"
#include "src/scene/texture_cache.h"
#include "src/scene/texture_file.h"

namespace trex::detail {
namespace {

/// Statements that say nothing about light, or the same as others.
const std::set<std::string_view> kSilent = {"ka", "map_ka", "sharpness", "map_aat"};

/// What one material's statements say, before it is made.
struct Read {
  std::optional<float> dissolve, transparency, roughness, exponent;
  bool color = false, emission = false;
  vec3 specular{0.0f};
  bool specularGiven = false;
  bool glass = false;
  vec3 filter{1.0f};
  float bumpStrength = 1.0f;
  Texture opacity, roughnessMap, metallicMap, bump, normal;
};

class MtlReader {
 public:
  MtlReader(const std::filesystem::path& path, const std::filesystem::path& modelFolder,
            const ImportOptions& options, Scene& scene, std::map<std::string, int>& names)
      : input_(path),
        folder_(path.parent_path()),
        modelFolder_(modelFolder),
        options_(options),
        scene_(scene),
        names_(names) {}

  void read() {
    std::string_view keyword, arguments;
    while (input_.next(keyword, arguments)) {
      if (keyword == "newmtl") {
        finish();
        begin(arguments);
      } else if (current_ != kNone) {
        readStatement(keyword, arguments);
      }
    }
    finish();
    leftOut_.tell(scene_, input_.file());
  }

 private:
  template <typename... Args>
  void replace(fmt::format_string<Args...> format, Args&&... args) {
    scene_.replaced.add(input_.where() + ": " + fmt::format(format, std::forward<Args>(args)...));
  }

  Material& material() { return scene_.materials[current_]; }

  void begin(std::string_view name) {
    Material made = defaultMaterial();
    made.name = utf8Of(name);
    current_ = static_cast<int>(scene_.materials.size());
    scene_.materials.push_back(std::move(made));
    names_[std::string(name)] = current_;
    names_.emplace(withoutComment(name), current_);
    read_ = {};
  }

  void finish() {
    if (current_ == kNone) return;
    Material& m = material();
    if (m.baseColorTexture.present() && !read_.color) m.baseColor = vec4(1.0f);
    if (m.emissiveTexture.present() && !read_.emission) m.emission = vec3(1.0f);
    if (m.specularColorTexture.present() && !read_.specularGiven) read_.specular = vec3(0.5f);
    m.specular = specularOf(read_.specular, m.specularColor);
    if (read_.roughness) {
      m.roughness = *read_.roughness;
    } else if (read_.exponent) {
      m.roughness = roughnessOf(*read_.exponent);
    }
    m.baseColor.a = opacity();
    if (m.baseColor.a < 1.0f) m.alphaMode = AlphaMode::kBlend;
    if (read_.glass) {
      leftOut_.add("illum of glass");
      if (read_.filter != vec3(1.0f)) leftOut_.add("Tf");
    }
    if (read_.opacity.present()) addOpacity(m);
    addRoughnessAndMetallic(m);
    addNormals(m);
    current_ = kNone;
  }

  float opacity() {
    const float opacity = givenOpacity();
    if (opacity == 0.0f) {
      scene_.warnings.push_back(fmt::format("{}: material '{}': its opacity is 0: it is not seen",
                                            input_.file(), material().name));
    }
    return opacity;
  }

  float givenOpacity() {
    const std::string who = fmt::format("{}: material '{}'", input_.file(), material().name);
    if (!read_.transparency) return read_.dissolve.value_or(1.0f);
    const float clear = *read_.transparency;
    if (!read_.dissolve) {
      if (clear < 1.0f) return 1.0f - clear;
      scene_.warnings.push_back(who + ": Tr 1 without d is taken for opaque, as scans have it");
      return 1.0f;
    }
    const float given = *read_.dissolve;
    if (std::abs(given - (1.0f - clear)) < 0.02f) return given;
    const float chosen = given == 0.0f && clear == 0.0f ? 1.0f : given;
    scene_.warnings.push_back(
        fmt::format("{}: d {} and Tr {} differ; opacity {} is used", who, given, clear, chosen));
    return chosen;
  }

  /// Enters an image that was made of others under a name of its own.
  int addImage(Image image, const std::string& name) {
    for (std::size_t i = 0; i < scene_.images.size(); ++i) {
      if (scene_.images[i].name == name) return static_cast<int>(i);
    }
    image.name = name;
    return trex::addImage(scene_, std::move(image));
  }

  const Image* imageOf(const Texture& t) const {
    return t.present() ? &scene_.images[t.image] : nullptr;
  }
  std::string nameOf(const Texture& t) const { return t.present() ? imageOf(t)->name : "none"; }

  /// Two maps share one place on the surface; the first one's counts, or the only one's.
  Texture placeOf(const Texture& first, const Texture& second) {
    Texture place = first.present() ? first : second;
    if (first.present() && second.present()) {
      Texture other = second;
      other.image = place.image;
      if (!(other == place)) {
        scene_.replaced.add(fmt::format("{}: material '{}': {} is placed as {} is", input_.file(),
                                        material().name, nameOf(second), nameOf(first)));
      }
    }
    return place;
  }

  void addOpacity(Material& m) {
    const Texture place = placeOf(m.baseColorTexture, read_.opacity);
    const Image* color = imageOf(m.baseColorTexture);
    const Image* mask = imageOf(read_.opacity);
    const bool same = m.baseColorTexture.image == read_.opacity.image &&
                      (mask->channels == 2 || mask->channels == 4);
    const std::string name =
        same ? mask->name
             : fmt::format("{} with the opacity of {}", nameOf(m.baseColorTexture), mask->name);
    if (!same) m.baseColorTexture.image = addImage(withOpacity(color, *mask), name);
    const int image = m.baseColorTexture.image;
    m.baseColorTexture = place;
    m.baseColorTexture.image = image;
    m.alphaMode = AlphaMode::kBlend;
  }

  void addRoughnessAndMetallic(Material& m) {
    if (!read_.roughnessMap.present() && !read_.metallicMap.present()) return;
    if (read_.roughnessMap.present() && !read_.roughness) m.roughness = 1.0f;
    if (read_.metallicMap.present() && m.metallic == 0.0f) m.metallic = 1.0f;
    m.metallicRoughnessTexture = placeOf(read_.roughnessMap, read_.metallicMap);
    m.metallicRoughnessTexture.image =
        addImage(roughnessAndMetallic(imageOf(read_.roughnessMap), imageOf(read_.metallicMap)),
                 fmt::format("roughness {} and metallic {}", nameOf(read_.roughnessMap),
                             nameOf(read_.metallicMap)));
  }

  void addNormals(Material& m) {
    if (!read_.normal.present() && !read_.bump.present()) return;
    m.normalTexture = read_.normal.present() ? read_.normal : read_.bump;
    const Image& image = *imageOf(m.normalTexture);
    m.normalScale = read_.normal.present() ? 1.0f : read_.bumpStrength;
    if (read_.normal.present() || looksLikeNormals(image)) return;
    scene_.warnings.push_back(
        fmt::format("{}: material '{}': heights of {} become normals, a texel's step a slope of {}",
                    input_.file(), m.name, image.name, read_.bumpStrength));
    m.normalScale = 1.0f;
    m.normalTexture.image =
        addImage(normalsOfHeights(image, read_.bumpStrength),
                 fmt::format("normals of {} times {}", image.name, read_.bumpStrength));
  }

  /// The number, clamped; nothing if it is none.
  std::optional<float> number(std::string_view word, double low, double high) {
    double value = 0.0;
    if (!parseNumber(word, value) || !std::isfinite(value)) {
      replace("'{}' is not a number; the statement is left out", word.substr(0, 40));
      return {};
    }
    if (value < low || value > high) {
      replace("{} is out of range; {} is used", value, std::clamp(value, low, high));
    }
    return static_cast<float>(std::clamp(value, low, high));
  }

  std::optional<vec3> color(std::string_view line, double high) {
    const std::string_view red = nextWord(line);
    if (red == "spectral" || red == "xyz") {
      replace("only RGB colours are read; the statement is left out");
      return {};
    }
    const auto r = number(red, 0.0, high);
    const std::string_view green = nextWord(line);
    if (!r || green.empty()) return r ? std::optional(vec3(*r)) : std::nullopt;
    const auto g = number(green, 0.0, high), b = number(nextWord(line), 0.0, high);
    return g && b ? std::optional(vec3(*r, *g, *b)) : std::nullopt;
  }

  void readStatement(std::string_view keyword, std::string_view line) {
    Material& m = material();
    if (keyword.starts_with("map_") || keyword == "bump" || keyword == "norm") {
      readMap(keyword, line);
    } else if (keyword == "kd") {
      if (const auto c = color(line, 1.0)) m.baseColor = vec4(*c, 1.0f), read_.color = true;
    } else if (keyword == "ks") {
      if (const auto c = color(line, 1.0)) read_.specular = *c, read_.specularGiven = true;
    } else if (keyword == "ke") {
      if (const auto c = color(line, 1e30)) m.emission = *c, read_.emission = true;
    } else if (keyword == "ns") {
      if (const auto n = number(nextWord(line), 0.0, 1e9)) read_.exponent = n;
    } else if (keyword == "pr") {
      if (const auto n = number(nextWord(line), 0.0, 1.0)) read_.roughness = n;
    } else if (keyword == "pm") {
      m.metallic = number(nextWord(line), 0.0, 1.0).value_or(m.metallic);
    } else if (keyword == "ni") {
      m.ior = number(nextWord(line), 1.0, 10.0).value_or(m.ior);
    } else if (keyword == "illum") {
      readIllumination(line);
    } else if (keyword == "tf") {
      read_.filter = color(line, 1.0).value_or(vec3(1.0f));
    } else if (keyword == "d") {
      readDissolve(line);
    } else if (keyword == "tr") {
      if (const auto n = number(nextWord(line), 0.0, 1.0)) read_.transparency = n;
    } else if (!readFinish(keyword, line) && !kSilent.contains(keyword)) {
      ignore(keyword, line);
    }
  }

  /// Pc, Pcr, Ps, aniso, anisor of the PBR extension; false if it is none of them.
  bool readFinish(std::string_view keyword, std::string_view line) {
    constexpr float kSheenRoughness = 0.5f;  // which the extension does not have
    Finish& f = material().finish;
    if (keyword == "ps") {
      if (const auto c = color(line, 1.0)) f.sheenColor = *c, f.sheenRoughness = kSheenRoughness;
      return true;
    }
    float* const target = keyword == "pc"       ? &f.clearcoat
                          : keyword == "pcr"    ? &f.clearcoatRoughness
                          : keyword == "aniso"  ? &f.anisotropy
                          : keyword == "anisor" ? &f.anisotropyRotation
                                                : nullptr;
    if (target == nullptr) return false;
    const float turn = keyword == "anisor" ? 2.0f * kPi : 1.0f;  // a share of it is given
    if (const auto n = number(nextWord(line), 0.0, 1.0)) *target = turn * *n;
    return true;
  }

  /// Models 4, 6, 7 and 9 are of glass.
  void readIllumination(std::string_view line) {
    std::int64_t model = 0;
    parseInteger(nextWord(line), model);
    read_.glass = model == 4 || model == 6 || model == 7 || model == 9;
  }

  void readDissolve(std::string_view line) {
    std::string_view word = nextWord(line);
    if (word == "-halo") {
      replace("-halo is not shown; the opacity is the same from all sides");
      word = nextWord(line);
    }
    if (const auto n = number(word, 0.0, 1.0)) read_.dissolve = n;
  }

  /// Notes a statement once; one of a value of 0 is none.
  void ignore(std::string_view keyword, std::string_view line) {
    double value = 1.0;
    if (!parseNumber(nextWord(line), value) || value != 0.0) leftOut_.add(keyword);
  }

  void readMap(std::string_view keyword, std::string_view line) {
    Material& m = material();
    Texture* target = keyword == "map_kd"                              ? &m.baseColorTexture
                      : keyword == "map_ke"                            ? &m.emissiveTexture
                      : keyword == "map_ks"                            ? &m.specularColorTexture
                      : keyword == "map_d" || keyword == "map_opacity" ? &read_.opacity
                      : keyword == "map_pr"                            ? &read_.roughnessMap
                      : keyword == "map_pm"                            ? &read_.metallicMap
                      : keyword == "norm"                              ? &read_.normal
                      : keyword == "bump" || keyword == "map_bump"     ? &read_.bump
                                                                       : nullptr;
    if (target == nullptr) {
      if (!kSilent.contains(keyword)) ignore(keyword, line);
      return;
    }
    if (options_.loadTextures) *target = texture(keyword, line);
  }

  /// Reads an option of a map with its values off the front of a line. False if there is none.
  bool readOption(std::string_view& line, Texture& made) {
    std::string_view after = line;
    const std::string_view option = nextWord(after);
    if (option.size() < 2 || option.front() != '-') return false;
    std::array<float, 3> values{};
    int count = 0;
    for (std::string_view peek = after; count < 3; after = peek) {
      double value = 0.0;
      const std::string_view word = nextWord(peek);
      if (word == "on" || word == "off" || option == "-imfchan" || option == "-type" ||
          option == "-colorspace") {
        if (option == "-clamp" && word == "on") made.wrapS = made.wrapT = Texture::Wrap::kClamp;
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
    } else if (option == "-bm" && count > 0) {
      read_.bumpStrength = std::clamp(values[0], -100.0f, 100.0f);
    } else if (option == "-imfchan" ||
               (option == "-mm" && (values[0] != 0.0f || values[1] != 1.0f))) {
      leftOut_.add(option);
    }
    return true;
  }

  /// A name without the options behind it, where some exporters have them; those count too.
  std::string_view withoutOptions(std::string_view name, Texture& made) {
    const std::size_t at = name.find(" -");
    if (at == name.npos) return name;
    std::string_view options = trimmed(name.substr(at));
    while (readOption(options, made)) {
    }
    return trimmed(options).empty() ? trimmed(name.substr(0, at)) : name;
  }

  /// "[-option values] file name with blanks"; of the options, -s, -o, -clamp and -bm count.
  Texture texture(std::string_view keyword, std::string_view line) {
    Texture made;
    while (readOption(line, made)) {
    }
    std::string_view name = trimmed(line);
    if (name.empty()) {
      replace("{} names no file; it is left out", keyword);
      return {};
    }
    const std::filesystem::path* folder = &folder_;
    const auto known = [&] {
      std::error_code error;
      for (const auto* from : {&folder_, &modelFolder_}) {
        if (!std::filesystem::is_regular_file(findFile(*from, std::string(name)), error)) continue;
        folder = from;
        return true;
      }
      return false;
    };
    if (!known()) name = withoutComment(name);
    if (!known()) name = withoutOptions(name, made);
    known();
    const bool color = keyword == "map_kd" || keyword == "map_ke" || keyword == "map_ks";
    made.image = imageOfFile(scene_, *folder, std::string(name), color,
                             input_.where() + ": texture", "it is left out");
    return made.present() ? made : Texture{};
  }

  Statements input_;
  std::filesystem::path folder_, modelFolder_;
  const ImportOptions& options_;
  Scene& scene_;
  std::map<std::string, int>& names_;
  int current_ = kNone;
  Read read_;
  LeftOut leftOut_;
};

}  // namespace

void readMtl(const std::filesystem::path& path, const std::filesystem::path& modelFolder,
             const ImportOptions& options, Scene& scene, std::map<std::string, int>& names) {
  noteFile(scene, path);
  MtlReader(path, modelFolder, options, scene, names).read();
}

}  // namespace trex::detail
