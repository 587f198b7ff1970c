// Reading a script: every key is known, every value checked as far as it can be without a scene.
#include <charconv>
#include <fstream>
#include <sstream>

#include "src/core/error.h"
#include "src/core/json_object.h"
#include "src/viewer/replay.h"

namespace trex {
namespace {

constexpr std::uint64_t kMostSteps = 1u << 20;
constexpr double kMostSeconds = 1e6;

constexpr const char* kStepKeys[] = {
    "label", "camera",     "exposure", "material",   "light",   "environment", "section",
    "hide",  "show",       "isolate",  "show_all",   "revert",  "undo",        "redo",
    "open",  "load_edits", "size",     "minimise",   "restore", "view",        "pick",
    "panel", "ui",         "wait",     "frames",     "seconds", "samples",     "settle",
    "idle",  "screenshot", "save",     "save_edits", "close",   "repeat"};

void readSize(const JsonObject& o, std::optional<std::uint32_t>& width,
              std::optional<std::uint32_t>& height) {
  const std::string text = o.text("size");
  const std::size_t cross = text.find('x');
  std::uint32_t w = 0, h = 0;
  if (cross != std::string::npos) {
    std::from_chars(text.data(), text.data() + cross, w);
    std::from_chars(text.data() + cross + 1, text.data() + text.size(), h);
  }
  if (w < 1 || h < 1 || w > 16384 || h > 16384 ||
      text != std::to_string(w) + "x" + std::to_string(h)) {
    o.bad("size", "want WxH with sides from 1 to 16384");
  }
  width = w;
  height = h;
}

int count(const JsonObject& o, const char* key, const nlohmann::json& value) {
  if (value.is_boolean()) return value.get<bool>() ? 1 : 0;
  return static_cast<int>(o.integer(key, 0, 100000));
}

void readView(const JsonObject& o, ReplayStep& step) {
  o.allow({"mode", "voxel_level", "split", "split_at", "paused"});
  if (o.has("mode")) {
    const std::string name = o.text("mode");
    const auto& names = viewModeNames();
    const auto at = std::find(names.begin(), names.end(), name);
    if (at == names.end()) o.bad("mode", "'{}' is not a view", name);
    step.mode = static_cast<ViewMode>(at - names.begin());
  }
  if (o.has("voxel_level")) step.voxelLevel = static_cast<int>(o.integer("voxel_level", 0, 30));
  if (o.has("split")) step.split = o.boolean("split");
  if (o.has("split_at")) step.splitAt = o.real("split_at", 0.0f, 1.0f);
  if (o.has("paused")) step.paused = o.boolean("paused");
}

void readEdits(const JsonObject& o, const nlohmann::json& value, ReplayStep& step) {
  if (o.has("camera")) {
    const nlohmann::json& camera = value.at("camera");
    if (camera.is_string()) {
      step.camera = camera.get<std::string>();
    } else {
      o.object("camera");
      step.cameraMove = camera;
    }
  }
  if (o.has("exposure")) step.exposure = o.real("exposure", -100.0f, 100.0f);
  if (o.has("material")) o.object("material"), step.material = value.at("material");
  if (o.has("light")) o.object("light"), step.light = value.at("light");
  if (o.has("environment")) o.object("environment"), step.environment = value.at("environment");
  if (o.has("section")) {
    step.noSection = value.at("section").is_null();
    if (!step.noSection) o.object("section"), step.section = value.at("section");
  }
  if (o.has("hide")) o.array("hide"), step.hide = value.at("hide");
  if (o.has("show")) o.array("show"), step.show = value.at("show");
  if (o.has("isolate")) step.isolate = value.at("isolate");
  if (o.has("show_all")) step.showAll = o.boolean("show_all");
  if (o.has("revert")) step.revert = o.boolean("revert");
  if (o.has("undo")) step.undo = count(o, "undo", value.at("undo"));
  if (o.has("redo")) step.redo = count(o, "redo", value.at("redo"));
}

void readWindow(const JsonObject& o, ReplayStep& step) {
  if (o.has("open")) step.open = o.text("open");
  if (o.has("load_edits")) step.loadEdits = o.text("load_edits");
  if (o.has("size")) readSize(o, step.width, step.height);
  if (o.has("minimise")) step.minimise = o.boolean("minimise");
  if (o.has("restore")) step.restore = o.boolean("restore");
  if (o.has("view")) readView(o.object("view"), step);
  if (o.has("ui")) step.ui = o.boolean("ui");
  if (o.has("panel")) step.panel = o.text("panel");
  if (o.has("pick")) {
    double at[2];
    o.numbers("pick", at, 2);
    step.pick = vec2(static_cast<float>(at[0]), static_cast<float>(at[1]));
  }
}

void readActions(const JsonObject& o, ReplayStep& step) {
  if (o.has("wait")) {
    step.wait =
        static_cast<ReplayWait>(1 + o.oneOf("wait", {"shown", "ready", "machines", "idle"}));
  }
  if (o.has("frames")) step.frames = static_cast<std::uint32_t>(o.integer("frames", 0, 1000000));
  if (o.has("seconds")) step.seconds = o.number("seconds", 0.0, kMostSeconds);
  if (o.has("samples")) step.samples = o.number("samples", 0.0, kMostSeconds);
  if (o.has("settle")) step.settle = o.number("settle", 0.0, kMostSeconds);
  if (o.has("idle")) step.idle = o.number("idle", 0.0, kMostSeconds);
  if (o.has("screenshot")) step.screenshot = o.text("screenshot");
  if (o.has("save")) step.save = o.text("save");
  if (o.has("save_edits")) step.saveEdits = o.text("save_edits");
  if (o.has("close")) step.close = o.boolean("close");
  if (o.has("repeat")) step.repeat = static_cast<std::uint32_t>(o.integer("repeat", 1, kMostSteps));
}

std::string labelOf(const nlohmann::json& step) {
  for (const char* key : {"camera", "material", "light", "environment", "section", "hide", "show",
                          "isolate", "show_all", "revert", "undo", "redo", "open", "size"}) {
    if (!step.contains(key)) continue;
    const std::string name = key;
    const bool visibility = name == "hide" || name == "show" || name == "isolate" ||
                            name == "show_all" || name == "section";
    return visibility ? "visibility" : name == "environment" ? "light" : name;
  }
  return "step";
}

ReplayStep readStep(const JsonObject& o, const nlohmann::json& value) {
  o.allow(kStepKeys);
  ReplayStep step;
  step.label = o.has("label") ? o.text("label") : labelOf(value);
  readEdits(o, value, step);
  readWindow(o, step);
  readActions(o, step);
  return step;
}

}  // namespace

bool ReplayStep::edits() const {
  return !camera.empty() || !cameraMove.is_null() || exposure || !material.is_null() ||
         !light.is_null() || !environment.is_null() || !section.is_null() || noSection ||
         !hide.is_null() || !show.is_null() || !isolate.is_null() || showAll || revert;
}

ReplayScript parseReplay(const std::string& text, const std::string& name) {
  nlohmann::json json;
  try {
    json = nlohmann::json::parse(text);
  } catch (const nlohmann::json::exception& e) {
    fail(ExitCode::kInput, "{}: not valid JSON: {:.200}", name, e.what());
  }
  const JsonDocument document{name, ""};
  const JsonObject root(json, document, "");
  root.allow({"trex", "size", "ui", "visible", "steps"});
  if (root.integer("trex", 0, 1u << 30) != 1) root.bad("trex", "this program reads version 1");
  ReplayScript script;
  if (root.has("size")) {
    std::optional<std::uint32_t> width, height;
    readSize(root, width, height);
    script.width = *width;
    script.height = *height;
  }
  if (root.has("ui")) script.ui = root.boolean("ui");
  if (root.has("visible")) script.visible = root.boolean("visible");
  const nlohmann::json& steps = root.array("steps");
  if (steps.size() > kMostSteps) root.bad("steps", "more than {}", kMostSteps);
  for (std::size_t i = 0; i < steps.size(); ++i) {
    script.steps.push_back(readStep(root.element("steps", i), steps[i]));
  }
  return script;
}

ReplayScript readReplay(const std::filesystem::path& path) {
  std::ifstream file(path);
  if (!file) fail(ExitCode::kInput, "{}: the replay script can't be read", path.string());
  std::stringstream text;
  text << file.rdbuf();
  return parseReplay(text.str(), path.string());
}

}  // namespace trex
