// What the readers of a Mitsuba scene's parts share: where notes go, names of objects, and values
// of their properties.
#pragma once

#include <set>
#include <string>
#include <string_view>
#include <unordered_map>

#include "src/scene/import_detail.h"
#include "src/scene/mitsuba_xml.h"

namespace trex::detail::mitsuba {

/// Deepest nesting of objects in objects, by reference or not.
inline constexpr int kMostNested = 16;

/// One scene under way.
class Context {
 public:
  Context(const std::filesystem::path& path, const ImportOptions& options);

  const Document& document() const { return document_; }
  const ImportOptions& options() const { return options_; }
  Scene& scene() { return scene_; }

  /// What is shown otherwise than the file has it, and yet stands for it; said once.
  void note(const Element& at, std::string text);
  /// What is left out or stands for something else: an error with --strict.
  void replace(const Element& at, std::string text);

  /// The object that a <ref> means, or the element itself; null if there is none of that id.
  const Element* resolve(const Element& element);
  /// A file named in the scene, looked for beside it and in the folders of <path>.
  std::filesystem::path file(std::string_view name) const;

 private:
  void collect(const Element& element);

  const ImportOptions& options_;
  Document document_;
  Scene scene_;
  std::unordered_map<std::string_view, const Element*> ids_;
  std::vector<std::filesystem::path> folders_;
  std::set<std::string> noted_;
};

/// What a colour is of: a surface ([0, 1]), a light, or an index of refraction.
enum class ColorKind { kReflectance, kEmission, kIndex };

/// Whether elements with this tag are objects (shapes, bsdfs, ...), not values.
bool isObject(std::string_view tag);

/// The properties of one object by name. Those that nobody asked for are told at the end.
class Properties {
 public:
  Properties(Context& context, const Element& element)
      : context_(context),
        element_(element),
        used_(element.children.size(), false),
        lost_(element.children.size(), false) {}

  const Element& element() const { return element_; }
  Context& context() const { return context_; }
  /// Null if there is none. References are resolved; one to nothing is told and is none.
  const Element* find(std::string_view name) const;
  bool has(std::string_view name) const { return find(name) != nullptr; }

  // Values, or the default where there is none or it is broken, which is told; numbers are clamped.
  std::string text(std::string_view name, std::string_view otherwise = {}) const;
  double number(std::string_view name, double otherwise, double least = -1e30,
                double most = 1e30) const;
  bool flag(std::string_view name, bool otherwise) const;
  dvec3 vector(std::string_view name, const dvec3& otherwise) const;
  dmat4 transform(std::string_view name) const;
  /// A colour without texture; of a light or of a surface (spectra.h).
  vec3 color(std::string_view name, const vec3& otherwise, ColorKind kind) const;

  /// The objects in it, references resolved, of one of the tags; marks them as asked for.
  std::vector<const Element*> objects(std::string_view tag) const;
  /// Marks as asked for what changes no picture here.
  void ignore(std::initializer_list<std::string_view> names) const;
  void tellUnused() const;

 private:
  Context& context_;
  const Element& element_;
  mutable std::vector<bool> used_, lost_;  ///< asked for; references to nothing
};

/// The matrix of a <transform>; one that is broken is told, and the identity.
dmat4 transformOf(Context& context, const Element& element);
/// Three numbers of a <point>, <vector>, <translate>, ...: x, y, z, or value.
dvec3 vectorOf(Context& context, const Element& element, double otherwise);
double numberOf(Context& context, const Element& element, std::string_view attribute,
                double otherwise);
/// The numbers of a list, separated by blanks or commas; empty if one is none.
std::vector<double> numbersOf(std::string_view text);

/// <rgb>, <srgb>, <spectrum>, <blackbody>, <float>, <color>.
bool isColor(const Element& element);
vec3 colorOf(Context& context, const Element& element, ColorKind kind);

/// Whether shapes can be placed by it: finite and invertible.
bool usable(const dmat4& m);

}  // namespace trex::detail::mitsuba
