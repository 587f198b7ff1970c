#include "src/scene/look_file.h"

#include <algorithm>
#include <cmath>
#include <fstream>

#include "src/core/error.h"
#include "src/core/file.h"
#include "src/scene/scene_json.h"

namespace trex {
namespace {

using nlohmann::json;

constexpr int kVersion = 1;
constexpr std::uintmax_t kMostBytes = 64u << 20;

OrderedJson changedMaterials(const Look& look, const Look& source) {
  OrderedJson out = OrderedJson::array();
  for (std::size_t i = 0; i < look.materials.size(); ++i) {
    if (look.materials[i] == source.materials[i]) continue;
    const OrderedJson now = materialJson(look.materials[i]),
                      before = materialJson(source.materials[i]);
    OrderedJson entry = {{"index", i}, {"name", source.materials[i].name}};
    for (const auto& [key, value] : now.items()) {
      if (!before.contains(key) || before[key] != value) entry[key] = value;
    }
    if (std::isinf(look.materials[i].attenuationDistance) &&
        !std::isinf(source.materials[i].attenuationDistance)) {
      entry["attenuation_distance_metres"] = double{std::numeric_limits<float>::max()};
    }
    out.push_back(entry);
  }
  return out;
}

json parse(const std::filesystem::path& path) {
  std::error_code problem;
  const std::uintmax_t size = std::filesystem::file_size(path, problem);
  if (problem) fail(ExitCode::kInput, "{}: {}", path.string(), problem.message());
  if (size > kMostBytes) {
    fail(ExitCode::kInput, "{}: {} bytes; edits have at most {}", path.string(), size, kMostBytes);
  }
  std::ifstream file(path);
  try {
    return json::parse(file);
  } catch (const json::exception& e) {
    fail(ExitCode::kInput, "{}: not valid JSON: {:.200}", path.string(), e.what());
  }
}

/// The entry that {"index", "name"} means; see the header.
template <typename NameOf>
std::size_t indexOf(const JsonObject& o, std::size_t count, const NameOf& nameOf) {
  const std::size_t index = o.integer("index", 0, 0xffffffffu);
  if (!o.has("name")) {
    if (index >= count) o.bad("index", "{} does not exist; there are {}", index, count);
    return index;
  }
  const std::string name = o.text("name");
  if (index < count && nameOf(index) == name) return index;
  std::size_t found = count, matches = 0;
  for (std::size_t i = 0; i < count; ++i) {
    if (nameOf(i) != name) continue;
    found = i;
    ++matches;
  }
  if (matches != 1) {
    o.bad("name", "'{:.80}' is not the name of number {}, and {} others have it", name, index,
          matches == 0 ? "no" : "several");
  }
  return found;
}

void readMaterials(const JsonObject& root, const Scene& scene, Look& look) {
  std::vector<const char*> keys = materialKeys();
  keys.push_back("index");
  for (std::size_t i = 0; i < root.array("materials").size(); ++i) {
    const JsonObject o = root.element("materials", i);
    o.allow(keys);
    const std::size_t index =
        indexOf(o, scene.materials.size(), [&](std::size_t m) { return scene.materials[m].name; });
    Material& m = look.materials[index];
    const std::string name = m.name;
    readMaterialJson(o, m, false);
    m.name = name;  // the name says which one, it is no edit
  }
}

void readHidden(const JsonObject& root, const Scene& scene, Look& look) {
  look.hidden.clear();
  for (std::size_t i = 0; i < root.array("hidden").size(); ++i) {
    const JsonObject o = root.element("hidden", i);
    o.allow({"index", "name"});
    look.hidden.push_back(static_cast<std::uint32_t>(
        indexOf(o, scene.objects.size(), [&](std::size_t k) { return scene.objects[k]; })));
  }
  std::sort(look.hidden.begin(), look.hidden.end());
  look.hidden.erase(std::unique(look.hidden.begin(), look.hidden.end()), look.hidden.end());
}

Look read(const JsonObject& root, const Scene& scene, const Look& source, LookLight* light) {
  root.allow({"trex", "edits_of", "camera", "exposure", "materials", "lights", "environment",
              "hidden", "section", "light"});
  if (root.integer("trex", 0, 1u << 30) != kVersion) {
    root.bad("trex", "this program reads version {}", kVersion);
  }
  Look look = source;
  if (root.has("camera")) look.camera = readCameraJson(root.object("camera"));
  if (root.has("exposure")) look.exposure = root.real("exposure", -100.0f, 100.0f);
  if (root.has("materials")) readMaterials(root, scene, look);
  if (root.has("lights")) {
    look.lights.clear();
    for (std::size_t i = 0; i < root.array("lights").size(); ++i) {
      look.lights.push_back(readLightJson(root.element("lights", i)));
    }
  }
  if (root.has("environment")) {
    const JsonObject o = root.object("environment");
    o.allow({"color", "rotation_radians"});
    look.environment.color = jsonVector(o, "color", 0.0f);
    look.environment.rotation = o.real("rotation_radians", -1e4f, 1e4f);
  }
  if (root.has("hidden")) readHidden(root, scene, look);
  if (root.has("section")) {
    const JsonObject o = root.object("section");
    o.allow({"point", "normal"});
    look.section.emplace();
    o.numbers("point", &look.section->point[0], 3);
    look.section->normal = jsonUnitVector(o, "normal");
  }
  if (root.has("light")) {
    const JsonObject o = root.object("light");
    o.allow({"photons", "aim"});
    LookLight found{o.integer("photons", 0, std::uint64_t{1} << 31), {}};
    if (o.has("aim")) found.aim = readCameraJson(o.object("aim"));
    if (light) *light = found;
  }
  return look;
}

}  // namespace

std::string lookText(const Look& look, const Scene& scene, const Look& source,
                     const LookLight& light) {
  OrderedJson out = {{"trex", kVersion}, {"edits_of", scene.source}};
  if (look.camera != source.camera) out["camera"] = cameraJson(look.camera);
  if (look.exposure != source.exposure) out["exposure"] = double{look.exposure};
  if (look.materials != source.materials) out["materials"] = changedMaterials(look, source);
  if (look.lights != source.lights) {
    out["lights"] = OrderedJson::array();
    for (const Light& lamp : look.lights) out["lights"].push_back(lightJson(lamp));
  }
  if (look.environment != source.environment) {
    out["environment"] = {{"color", jsonList(look.environment.color)},
                          {"rotation_radians", double{look.environment.rotation}}};
  }
  if (!look.hidden.empty()) {
    out["hidden"] = OrderedJson::array();
    for (const std::uint32_t i : look.hidden) {
      out["hidden"].push_back({{"index", i}, {"name", scene.objects[i]}});
    }
  }
  if (look.section) {
    out["section"] = {{"point", jsonList(look.section->point)},
                      {"normal", jsonList(look.section->normal)}};
  }
  if (light.photons > 0 || light.aim) {
    out["light"] = {{"photons", light.photons}};
    if (light.aim) out["light"]["aim"] = cameraJson(*light.aim);
  }
  return out.dump(2, ' ', false, OrderedJson::error_handler_t::replace) + "\n";
}

void writeLook(const std::filesystem::path& path, const Look& look, const Scene& scene,
               const Look& source, const LookLight& light) {
  writeTextAtomically(path, lookText(look, scene, source, light));
}

Look readLook(const std::filesystem::path& path, const Scene& scene, const Look& source,
              LookLight* light) {
  const json document = parse(path);
  const JsonDocument place{path.string(), ""};
  return read(JsonObject(document, place, ""), scene, source, light);
}

Look parseLook(const std::string& text, const std::string& name, const Scene& scene,
               const Look& source, LookLight* light) {
  json document;
  try {
    document = json::parse(text);
  } catch (const json::exception& e) {
    fail(ExitCode::kInput, "{}: not valid JSON: {:.200}", name, e.what());
  }
  const JsonDocument place{name, ""};
  return read(JsonObject(document, place, ""), scene, source, light);
}

}  // namespace trex
