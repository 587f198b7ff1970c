// A streaming reader of pbrt's text, versions 3 and 4: one directive at a time.
#include <algorithm>
#include <array>
#include <cmath>
#include <glm/gtc/matrix_inverse.hpp>

#include "src/scene/import_detail.h"
#include "src/scene/pbrt_camera.h"
#include "src/scene/pbrt_lights.h"
#include "src/scene/pbrt_shapes.h"
#include "src/scene/texture_file.h"

namespace trex::detail {
namespace {

namespace fs = std::filesystem;
using Kind = PbrtTokens::Kind;

constexpr std::size_t kMaxIncludeDepth = 32;
constexpr std::size_t kMaxIncludes = 100'000;

class PbrtReader {
 public:
  PbrtReader(const fs::path& path, const ImportOptions& options)
      : path_(path), context_{scene_, options, path.parent_path()} {
    scene_.textures = options.textures;
  }

  Scene read() {
    context_.noted.insert(path_.string());  // importScene() notes the first file
    readFile(path_);
    finish();
    return std::move(scene_);
  }

 private:
  using Handler = void (PbrtReader::*)();

  static Handler handlerOf(const std::string& directive) {
    static const std::unordered_map<std::string_view, Handler> kHandlers = {
        {"Identity", &PbrtReader::identity},
        {"CoordinateSystem", &PbrtReader::coordinateSystem},
        {"CoordSysTransform", &PbrtReader::coordSysTransform},
        {"ActiveTransform", &PbrtReader::activeTransform},
        {"TransformTimes", &PbrtReader::transformTimes},
        {"AttributeBegin", &PbrtReader::attributeBegin},
        {"AttributeEnd", &PbrtReader::attributeEnd},
        {"TransformBegin", &PbrtReader::transformBegin},
        {"TransformEnd", &PbrtReader::transformEnd},
        {"Attribute", &PbrtReader::attribute},
        {"ObjectBegin", &PbrtReader::objectBegin},
        {"ObjectEnd", &PbrtReader::objectEnd},
        {"ObjectInstance", &PbrtReader::objectInstance},
        {"ReverseOrientation", &PbrtReader::reverseOrientation},
        {"Include", &PbrtReader::include},
        {"Import", &PbrtReader::import},
        {"Camera", &PbrtReader::camera},
        {"Film", &PbrtReader::film},
        {"Sampler", &PbrtReader::rendering},
        {"Integrator", &PbrtReader::integrator},
        {"SurfaceIntegrator", &PbrtReader::integrator},
        {"PixelFilter", &PbrtReader::rendering},
        {"Filter", &PbrtReader::rendering},
        {"Accelerator", &PbrtReader::rendering},
        {"ColorSpace", &PbrtReader::colorSpace},
        {"Option", &PbrtReader::option},
        {"WorldBegin", &PbrtReader::worldBegin},
        {"WorldEnd", &PbrtReader::worldEnd},
        {"Material", &PbrtReader::material},
        {"MakeNamedMaterial", &PbrtReader::makeNamedMaterial},
        {"NamedMaterial", &PbrtReader::namedMaterial},
        {"Texture", &PbrtReader::texture},
        {"LightSource", &PbrtReader::lightSource},
        {"AreaLightSource", &PbrtReader::areaLightSource},
        {"MediumInterface", &PbrtReader::mediumInterface},
        {"MakeNamedMedium", &PbrtReader::makeNamedMedium},
        {"Shape", &PbrtReader::shape},
    };
    const auto found = kHandlers.find(directive);
    return found == kHandlers.end() ? nullptr : found->second;
  }

  /// Reads a file that the directive under way includes; the scene's own file has none.
  void readFile(const fs::path& path) {
    PbrtTokens tokens(path);
    PbrtTokens* const outer = tokens_;
    tokens_ = &tokens;
    including_.push_back(path);
    context_.file = path.string();
    context_.note(path);
    while (!done_ && tokens.peek() != Kind::kEnd) readDirective();
    including_.pop_back();
    tokens_ = outer;
    if (outer != nullptr) context_.file = outer->file();
  }

  void readDirective() {
    context_.line = tokens_->line();
    if (tokens_->next() != Kind::kWord) {
      fail(ExitCode::kInput, "{}: '{:.40}' where a directive should be", tokens_->where(),
           tokens_->text());
    }
    directive_ = tokens_->text();
    context_.what = directive_;
    if (const Handler handler = handlerOf(directive_)) {
      (this->*handler)();
    } else if (const std::size_t count = pbrtTransformNumbers(directive_); count > 0) {
      transform(count);
    } else {
      context_.replace("this directive is not known; it is left out");
      while (tokens_->peek() != Kind::kEnd && tokens_->peek() != Kind::kWord) tokens_->next();
    }
  }

  PbrtState& state() { return stack_.top(); }

  double number() {
    double value = 0.0;
    if (tokens_->next() != Kind::kWord || !parseDouble(tokens_->text(), value)) {
      fail(ExitCode::kInput, "{}: {}: '{:.40}' where a number should be", tokens_->where(),
           directive_, tokens_->text());
    }
    return value;
  }

  std::array<double, 16> numbers(std::size_t count) {
    std::array<double, 16> values{};
    const bool bracket = tokens_->peek() == Kind::kOpen;
    if (bracket) tokens_->next();
    for (std::size_t i = 0; i < count; ++i) values[i] = number();
    if (bracket && tokens_->next() != Kind::kClose) {
      fail(ExitCode::kInput, "{}: {}: its bracket is not closed after {} numbers", tokens_->where(),
           directive_, count);
    }
    return values;
  }

  /// A string in quotes; the directive is named by it from then on.
  std::string text() {
    const bool bracket = tokens_->peek() == Kind::kOpen;
    if (bracket) tokens_->next();
    if (tokens_->next() != Kind::kString) {
      fail(ExitCode::kInput, "{}: {}: '{:.40}' where a string in quotes should be",
           tokens_->where(), directive_, tokens_->text());
    }
    std::string value = tokens_->text();
    if (bracket && tokens_->next() != Kind::kClose) {
      fail(ExitCode::kInput, "{}: {}: its bracket is not closed", tokens_->where(), directive_);
    }
    context_.what = fmt::format("{} \"{:.80}\"", directive_, value);
    return value;
  }

  /// With those of the directive Attribute for `target`.
  PbrtParameters parameters(const char* target = nullptr) {
    PbrtParameters made = PbrtParameters::read(*tokens_);
    const auto& all = state().attributes;
    if (target != nullptr && all != nullptr && all->contains(target)) {
      made.addMissing(all->at(target));
    }
    return made;
  }

  void transform(std::size_t count) {
    const std::array<double, 16> values = numbers(count);
    const auto matrix = pbrtTransform(directive_, std::span(values.data(), count));
    if (!matrix) {
      context_.replace("its numbers make no transform; it is left out");
    } else if (directive_ == "Transform") {
      state().set({*matrix, *matrix});
    } else {
      state().multiply(*matrix);
    }
  }

  void identity() { state().set({dmat4(1.0), dmat4(1.0)}); }

  void coordinateSystem() { systems_[text()] = state().ctm; }

  void coordSysTransform() {
    const std::string name = text();
    const auto found = systems_.find(name);
    if (found == systems_.end()) {
      context_.replace("there is no coordinate system of this name; it is left out");
    } else {
      state().set(found->second);
    }
  }

  void activeTransform() {
    if (tokens_->next() != Kind::kWord) {
      fail(ExitCode::kInput, "{}: {}: want StartTime, EndTime or All", tokens_->where(),
           directive_);
    }
    const std::string& when = tokens_->text();
    state().active = when == "StartTime" ? 1u : when == "EndTime" ? 2u : 3u;
  }

  void transformTimes() { numbers(2); }

  void push(PbrtStack::Kind kind) {
    if (!stack_.push(kind)) {
      fail(ExitCode::kInput, "{}: more than {} attributes and transforms are open",
           tokens_->where(), PbrtStack::kMaxDepth);
    }
  }
  void pop(PbrtStack::Kind kind) {
    if (!stack_.pop(kind)) context_.replace("it ends what has not begun; it is left out");
    restoreSpace();
  }
  void restoreSpace() {
    if (state().colorSpace == space_) return;
    space_ = state().colorSpace;
    colors_.setSpace(space_);
  }
  void attributeBegin() { push(PbrtStack::Kind::kAttribute); }
  void attributeEnd() { pop(PbrtStack::Kind::kAttribute); }
  void transformBegin() { push(PbrtStack::Kind::kTransform); }
  void transformEnd() { pop(PbrtStack::Kind::kTransform); }

  void attribute() {
    colors_.version4 = true;
    const std::string target = text();
    PbrtParameters added = PbrtParameters::read(*tokens_);
    auto all = state().attributes ? *state().attributes : std::map<std::string, PbrtParameters>();
    added.addMissing(all[target]);
    all[target] = std::move(added);
    state().attributes = std::make_shared<const std::map<std::string, PbrtParameters>>(all);
  }

  void objectBegin() {
    const std::string name = text();
    if (shapes_.inObject()) {
      context_.replace("it is inside another object; its shapes become that one's");
    } else {
      shapes_.beginObject(name);
    }
    push(PbrtStack::Kind::kObject);
  }
  void objectEnd() {
    pop(PbrtStack::Kind::kObject);
    if (stack_.objects() == 0) shapes_.endObject();
  }
  void objectInstance() {
    const std::string name = text();
    shapes_.instance(name, state());
  }

  void reverseOrientation() { state().reverse = !state().reverse; }

  /// The file that an Include or Import means; empty, which is said, if it can't be read.
  fs::path included() {
    const std::string name = text();
    fs::path path = findFile(context_.folder, name);
    std::error_code error;
    if (!fs::is_regular_file(path, error)) path = findFile(including_.back().parent_path(), name);
    if (!fs::is_regular_file(path, error)) {
      context_.replace("there is no such file; it is left out");
      return {};
    }
    const bool cycle = std::any_of(including_.begin(), including_.end(), [&](const fs::path& p) {
      return fs::equivalent(p, path, error);
    });
    if (cycle || including_.size() > kMaxIncludeDepth || ++includes_ > kMaxIncludes) {
      context_.replace("{}; it is left out",
                       cycle ? "it includes itself" : "files are included too deep or too often");
      return {};
    }
    return path;
  }

  void include() {
    if (const fs::path path = included(); !path.empty()) readFile(path);
  }

  void import() {
    colors_.version4 = true;
    const fs::path path = included();
    if (path.empty()) return;
    push(PbrtStack::Kind::kImport);
    const std::size_t depth = stack_.depth();
    readFile(path);
    stack_.popTo(depth - 1);
    restoreSpace();
    if (stack_.objects() == 0) shapes_.endObject();
  }

  void camera() {
    const std::string kind = text();
    camera_.camera(kind, parameters(), state());
    systems_["camera"] = {glm::affineInverse(state().ctm[0]), glm::affineInverse(state().ctm[1])};
  }

  void film() {
    const std::string kind = text();
    if (kind != "image") colors_.version4 = true;
    camera_.film(kind, parameters());
  }

  /// What says how to render, not what.
  void rendering() {
    text();
    parameters();
  }

  /// Of paths pbrt counts the bounces, which end at 5 where nothing is said: that is nobody's wish,
  /// and there is no limit. Other integrators count otherwise, or something else.
  void integrator() {
    const std::string kind = text();
    const PbrtParameters of = parameters();
    constexpr std::array kPaths = {"path", "volpath",    "bdpt",          "mlt",
                                   "sppm", "simplepath", "simplevolpath", "lightpath"};
    const bool paths = std::find(kPaths.begin(), kPaths.end(), kind) != kPaths.end();
    const double most = of.number("maxdepth", -1.0);
    if (!paths) {
      scene_.warnings.push_back(utf8Of(oneLine(fmt::format(
          "{}: {}: the picture is that of paths of any length", context_.where(), context_.what))));
    } else if (most >= 0.0) {
      scene_.maxBounces = static_cast<std::uint32_t>(std::min(most, 1e9));
    }
  }

  void colorSpace() {
    colors_.version4 = true;
    const std::string name = text();
    if (colors_.setSpace(name)) {
      state().colorSpace = space_ = name;
    } else {
      context_.replace("this colour space is not known; the one before stays");
    }
  }

  void option() {
    colors_.version4 = true;
    text();
    const Kind value = tokens_->next();
    if (value != Kind::kWord && value != Kind::kString) {
      fail(ExitCode::kInput, "{}: {}: its value is missing", tokens_->where(), context_.what);
    }
  }

  void worldBegin() {
    if (world_) {
      context_.replace("only the first world of a file is shown");
      done_ = true;
      return;
    }
    world_ = true;
    state().active = 3u;
    identity();
    systems_["world"] = state().ctm;
    const float exposure = camera_.exposure();
    shapes_.lightScale = lights_.lightScale = exposure;
    if (exposure != 1.0f) {
      scene_.warnings.push_back(
          fmt::format("{}: its film multiplies light by {}; all lights are so much brighter",
                      path_.string(), exposure));
    }
  }

  void worldEnd() {}

  void material() {
    const std::string type = text();
    const PbrtParameters p = parameters("material");
    state().material = materials_.make(type, p, {});
    context_.report(p);
  }

  void makeNamedMaterial() {
    const std::string name = text();
    const PbrtParameters p = parameters("material");
    materials_.setName(name, materials_.make(p.text("type", "matte"), p, name));
    context_.report(p);
  }

  void namedMaterial() {
    const std::string name = text();
    const auto found = materials_.find(name);
    if (!found) context_.replace("there is no material of this name; grey 0.5 is shown");
    state().material = found.value_or(0);
  }

  void texture() {
    const std::string name = text(), valueType = text(), kind = text();
    context_.what = fmt::format("Texture \"{:.80}\" \"{:.40}\"", name, kind);
    const PbrtParameters p = parameters("texture");
    textures_.define(name, valueType, kind, p);
    context_.report(p);
  }

  void lightSource() {
    const std::string kind = text();
    const PbrtParameters p = parameters("light");
    lights_.add(kind, p, state());
    context_.report(p);
  }

  void areaLightSource() {
    const std::string kind = text();
    PbrtParameters p = parameters("light");
    if (kind != "diffuse" && kind != "area") {
      context_.replace("area lights of this kind are not known; it is left out");
      return;
    }
    state().areaLight = std::make_shared<const PbrtParameters>(std::move(p));
  }

  void mediumInterface() {
    state().inside = text();
    state().outside = tokens_->peek() == Kind::kString ? text() : state().inside;
  }

  void makeNamedMedium() {
    const std::string name = text();
    const PbrtParameters p = parameters("medium");
    const std::string type = p.text("type");
    const float scale = static_cast<float>(p.number("scale", 1.0));
    const bool version4 = colors_.version4;
    PbrtMedium medium;
    if (type != "homogeneous" || p.find("preset") != nullptr) {
      context_.replace("this medium is not shown");
      return;
    }
    const vec3 absorbs = version4 ? vec3(1.0f) : vec3(0.0011f, 0.0024f, 0.014f);
    const vec3 scatters = version4 ? vec3(1.0f) : vec3(2.55f, 3.21f, 3.77f);
    medium.absorption = clampedLight(colors_.reflectance(p, "sigma_a").value_or(absorbs) * scale);
    if (maxComponent(colors_.reflectance(p, "sigma_s").value_or(scatters)) > 0.0f) {
      context_.replace("of this medium only what it absorbs is shown, within glass");
    }
    p.ignore({"g", "Le", "Lescale"});
    shapes_.media[name] = medium;
    context_.report(p);
  }

  void shape() {
    const std::string kind = text();
    const PbrtParameters p = parameters("shape");
    if (shapes_.add(kind, p, state())) context_.report(p);
  }

  void finish() {
    if (stack_.depth() > 0) {
      context_.what = "the end";
      context_.replace("{} attributes, transforms or objects are still open", stack_.depth());
    }
    camera_.finish();
    const glm::dmat3 ours = camera_.toWorld();
    for (Instance& instance : scene_.instances)
      instance.transform = dmat4(ours) * instance.transform;
    for (Light& light : scene_.lights) {
      light.position = ours * light.position;
      light.direction = vec3(ours * dvec3(light.direction));
    }
    if (lights_.sky.present() && !context_.options.environmentGiven) {
      scene_.environment = lights_.sky.environment(ours);
    }
    if (scene_.materials.empty()) scene_.materials.push_back(defaultMaterial());
  }

  fs::path path_;
  Scene scene_;
  PbrtContext context_;
  PbrtColors colors_{context_};
  PbrtTextures textures_{context_, colors_};
  PbrtMaterials materials_{context_, colors_, textures_};
  PbrtShapes shapes_{context_, colors_, textures_, materials_};
  PbrtLights lights_{context_, colors_};
  PbrtCamera camera_{context_};
  PbrtStack stack_;
  std::map<std::string, std::array<dmat4, 2>> systems_;
  PbrtTokens* tokens_ = nullptr;  ///< of the file under way
  std::string directive_;
  std::string space_ = "srgb";  ///< that colors_ has
  std::vector<fs::path> including_;
  std::size_t includes_ = 0;
  bool world_ = false, done_ = false;
};

}  // namespace

Scene readPbrt(const std::filesystem::path& path, const ImportOptions& options) {
  return PbrtReader(path, options).read();
}

}  // namespace trex::detail
