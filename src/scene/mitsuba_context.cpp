#include "src/scene/mitsuba_context.h"

#include <algorithm>
#include <array>

#include "src/scene/input_file.h"
#include "src/scene/texture_file.h"

namespace trex::detail::mitsuba {

bool isObject(std::string_view tag) {
  constexpr std::array<std::string_view, 14> kTags = {
      "shape", "bsdf", "texture", "emitter", "luminaire", "sensor",  "camera",
      "film",  "ref",  "medium",  "volume",  "phase",     "sampler", "scene"};
  return std::find(kTags.begin(), kTags.end(), tag) != kTags.end();
}

Context::Context(const std::filesystem::path& path, const ImportOptions& options)
    : options_(options), document_(path, options.defines) {
  scene_.textures = options.textures;
  folders_.push_back(path.parent_path());
  for (std::size_t i = 1; i < document_.files().size(); ++i) noteFile(scene_, document_.files()[i]);
  collect(document_.root());
}

void Context::collect(const Element& element) {
  const std::string_view id = element.attribute("id");
  if (element.tag == "path") {
    folders_.push_back(folders_.front() / std::string(element.attribute("value")));
  } else if (element.tag == "alias") {
    if (const auto found = ids_.find(id); found != ids_.end()) {
      ids_[element.attribute("as")] = found->second;
    }
  } else if (element.tag != "ref" && !id.empty()) {
    ids_[id] = &element;
  }
  for (const Element& child : element.children) collect(child);
}

void Context::note(const Element& at, std::string text) {
  constexpr std::size_t kMost = 100;
  if (noted_.size() >= kMost || !noted_.insert(text).second) return;
  scene_.warnings.push_back(fmt::format("{}: {}", document_.where(at), text));
}

void Context::replace(const Element& at, std::string text) {
  scene_.replaced.add(fmt::format("{}: {}", document_.where(at), text));
}

const Element* Context::resolve(const Element& element) {
  if (element.tag != "ref") return &element;
  const auto found = ids_.find(element.attribute("id"));
  if (found != ids_.end()) return found->second;
  replace(element,
          fmt::format("there is no object '{:.80}'; it is left out", element.attribute("id")));
  return nullptr;
}

std::filesystem::path Context::file(std::string_view name) const {
  std::error_code error;
  for (const std::filesystem::path& folder : folders_) {
    std::filesystem::path path = findFile(folder, std::string(name));
    if (std::filesystem::is_regular_file(path, error)) return path;
  }
  return findFile(folders_.front(), std::string(name));
}

const Element* Properties::find(std::string_view name) const {
  for (std::size_t i = 0; i < element_.children.size(); ++i) {
    if (element_.children[i].name() != name) continue;
    used_[i] = true;
    return context_.resolve(element_.children[i]);
  }
  return nullptr;
}

std::vector<const Element*> Properties::objects(std::string_view tag) const {
  std::vector<const Element*> found;
  for (std::size_t i = 0; i < element_.children.size(); ++i) {
    const Element& child = element_.children[i];
    if (lost_[i] || (child.tag != tag && child.tag != "ref")) continue;
    const Element* meant = context_.resolve(child);
    if (meant == nullptr) used_[i] = lost_[i] = true;
    if (meant == nullptr || meant->tag != tag) continue;
    used_[i] = true;
    found.push_back(meant);
  }
  return found;
}

void Properties::ignore(std::initializer_list<std::string_view> names) const {
  for (std::size_t i = 0; i < element_.children.size(); ++i) {
    const std::string_view name = element_.children[i].name();
    if (std::find(names.begin(), names.end(), name) != names.end()) used_[i] = true;
  }
}

void Properties::tellUnused() const {
  for (std::size_t i = 0; i < element_.children.size(); ++i) {
    const Element& child = element_.children[i];
    if (used_[i]) continue;
    const std::string_view name = child.name();
    context_.note(child,
                  fmt::format("{} '{:.40}': {:.20} '{:.40}' is not shown", element_.tag,
                              element_.type(), child.tag, name.empty() ? child.type() : name));
  }
}

std::string Properties::text(std::string_view name, std::string_view otherwise) const {
  const Element* e = find(name);
  return std::string(e == nullptr ? otherwise : e->attribute("value"));
}

double Properties::number(std::string_view name, double otherwise, double least,
                          double most) const {
  const Element* e = find(name);
  if (e == nullptr) return otherwise;
  const double value = numberOf(context_, *e, "value", otherwise);
  if (value >= least && value <= most) return value;
  const double kept = std::clamp(value, least, most);
  context_.replace(*e, fmt::format("{} {} is out of range; {} is used", name, value, kept));
  return kept;
}

bool Properties::flag(std::string_view name, bool otherwise) const {
  const Element* e = find(name);
  if (e == nullptr) return otherwise;
  const std::string_view value = trimmed(e->attribute("value"));
  if (value == "true" || value == "True" || value == "1") return true;
  if (value == "false" || value == "False" || value == "0") return false;
  context_.replace(*e,
                   fmt::format("'{:.40}' is neither true nor false; {} is used", value, otherwise));
  return otherwise;
}

dvec3 Properties::vector(std::string_view name, const dvec3& otherwise) const {
  const Element* e = find(name);
  return e == nullptr ? otherwise : vectorOf(context_, *e, 0.0);
}

dmat4 Properties::transform(std::string_view name) const {
  const Element* e = find(name);
  return e == nullptr ? dmat4(1.0) : transformOf(context_, *e);
}

vec3 Properties::color(std::string_view name, const vec3& otherwise, ColorKind kind) const {
  const Element* e = find(name);
  if (e == nullptr) return otherwise;
  if (isColor(*e)) return colorOf(context_, *e, kind);
  context_.replace(*e, fmt::format("{} is no colour; the default is used", name));
  return otherwise;
}

}  // namespace trex::detail::mitsuba
