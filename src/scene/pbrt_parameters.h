// Parameters of pbrt's directives: "type name" value or "type name" [values].
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "src/core/maths.h"
#include "src/scene/pbrt_tokens.h"

namespace trex::detail {

struct PbrtParameter {
  std::string type, name;
  std::vector<double> numbers;
  std::vector<std::string> strings;  ///< bare words (true, false) too
  mutable bool used = false;
};

/// A list of them. Look-ups mark what they find as used, also if it is not of the type that is
/// asked for, which problems() tells then.
class PbrtParameters {
 public:
  /// Takes the parameters in front of the next directive off the tokens. Throws Error(kInput) with
  /// file and line where the text is not of that form.
  static PbrtParameters read(PbrtTokens& tokens);

  /// Appends those of another list whose names are not in this one.
  void addMissing(const PbrtParameters& others);

  /// The first of this name, whatever its type; null if there is none.
  const PbrtParameter* find(std::string_view name) const;

  double number(std::string_view name, double otherwise) const;
  bool flag(std::string_view name, bool otherwise) const;
  std::string text(std::string_view name, std::string otherwise = {}) const;
  dvec3 point(std::string_view name, const dvec3& otherwise) const;
  /// Numbers of a parameter that has any, else none.
  std::span<const double> numbers(std::string_view name) const;
  std::span<const std::string> texts(std::string_view name) const;
  /// The texture that a parameter names; empty if it names none.
  std::string texture(std::string_view name) const;

  /// Marks parameters that change nothing that is shown.
  void ignore(std::initializer_list<std::string_view> names) const;

  void ignoreAll() const;

  /// What is wrong with those that were looked up, and which were not.
  std::vector<std::string> problems() const;

 private:
  std::vector<PbrtParameter> list_;
  mutable std::vector<std::string> problems_;
};

}  // namespace trex::detail
