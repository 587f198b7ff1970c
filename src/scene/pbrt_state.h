// Transforms and attributes of pbrt, and their stack.
//
// pbrt's space is left-handed; its numbers are kept as they are here. A point of a shape is
// multiplied by the current transformation matrix (CTM) from the left, and each directive by the
// CTM: CTM = CTM * M.
#pragma once

#include <array>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "src/scene/pbrt_parameters.h"

namespace trex::detail {

/// Matrices of Translate, Scale, Rotate, LookAt and Transform (column after column). Nothing if a
/// number is not finite or the numbers tell no direction.
std::optional<dmat4> pbrtTransform(std::string_view directive, std::span<const double> numbers);
/// How many numbers such a directive has; 0: it is no such directive.
std::size_t pbrtTransformNumbers(std::string_view directive);

/// Whether a matrix is finite, affine and can be inverted.
bool isPlacement(const dmat4& m);

/// What AttributeBegin saves.
struct PbrtState {
  std::array<dmat4, 2> ctm{dmat4(1.0), dmat4(1.0)};  ///< when the shutter opens, and closes
  unsigned active = 3;                               ///< bits of the transforms that change
  bool reverse = false;
  int material = 0;  ///< number of PbrtMaterials
  /// Of the AreaLightSource that shapes get; null: none.
  std::shared_ptr<const PbrtParameters> areaLight;
  std::string inside, outside;  ///< media; empty: none
  std::string colorSpace = "srgb";
  /// By "shape", "light", "material", "medium", "texture": parameters of the directive Attribute.
  std::shared_ptr<const std::map<std::string, PbrtParameters>> attributes;

  bool moves() const { return ctm[0] != ctm[1]; }
  void multiply(const dmat4& m);
  void set(const std::array<dmat4, 2>& to);
};

/// The state and what was saved of it.
class PbrtStack {
 public:
  enum class Kind { kAttribute, kTransform, kObject, kImport };
  static constexpr std::size_t kMaxDepth = 100'000;

  PbrtState& top() { return state_; }
  std::size_t depth() const { return saved_.size(); }
  /// False if it is too deep.
  bool push(Kind kind);
  /// Goes back to what was saved; of kTransform, only the transform. False if the last one that
  /// was saved is of another kind.
  bool pop(Kind kind);
  /// Goes back to what was saved at a depth, whatever its kind.
  void popTo(std::size_t depth);
  /// How many kObject are saved.
  std::size_t objects() const { return objects_; }

 private:
  struct Saved {
    Kind kind;
    PbrtState state;
  };
  PbrtState state_;
  std::vector<Saved> saved_;
  std::size_t objects_ = 0;
};

}  // namespace trex::detail
