#include "src/scene/pbrt_parameters.h"

#include <algorithm>
#include <cmath>

#include "src/core/error.h"

namespace trex::detail {
namespace {

using Kind = PbrtTokens::Kind;

void addValue(PbrtTokens& tokens, PbrtParameter& parameter) {
  const std::string& text = tokens.text();
  double number = 0.0;
  if (tokens.next() == Kind::kString || text == "true" || text == "false") {
    parameter.strings.push_back(text);
  } else if (parseDouble(text, number)) {
    parameter.numbers.push_back(number);
  } else {
    fail(ExitCode::kInput, "{}: '{:.40}' is no value of the parameter \"{:.40} {:.40}\"",
         tokens.where(), text, parameter.type, parameter.name);
  }
}

void readValues(PbrtTokens& tokens, PbrtParameter& parameter) {
  const std::string where = tokens.where();
  const auto isValue = [&] {
    return tokens.peek() == Kind::kWord || tokens.peek() == Kind::kString;
  };
  if (tokens.peek() != Kind::kOpen) {
    if (!isValue()) {
      fail(ExitCode::kInput, "{}: the parameter \"{:.40} {:.40}\" has no value", where,
           parameter.type, parameter.name);
    }
    return addValue(tokens, parameter);
  }
  tokens.next();
  while (isValue()) addValue(tokens, parameter);
  if (tokens.next() != Kind::kClose) {
    fail(ExitCode::kInput, "{}: the bracket of the parameter \"{:.40} {:.40}\" is not closed",
         where, parameter.type, parameter.name);
  }
}

/// Types of different names and one meaning.
std::string plainType(std::string_view type) {
  if (type == "color") return "rgb";
  if (type == "point3") return "point";
  if (type == "vector3") return "vector";
  return std::string(type);
}

}  // namespace

PbrtParameters PbrtParameters::read(PbrtTokens& tokens) {
  PbrtParameters made;
  while (tokens.peek() == Kind::kString) {
    std::string_view declaration = tokens.text();
    PbrtParameter parameter;
    parameter.type = plainType(nextWord(declaration));
    parameter.name = nextWord(declaration);
    if (parameter.name.empty() || !trimmed(declaration).empty()) {
      fail(ExitCode::kInput, "{}: \"{:.60}\" is not the type and name of a parameter",
           tokens.where(), tokens.text());
    }
    tokens.next();
    tokens.peek();
    readValues(tokens, parameter);
    made.list_.push_back(std::move(parameter));
  }
  return made;
}

void PbrtParameters::addMissing(const PbrtParameters& others) {
  for (const PbrtParameter& p : others.list_) {
    const bool known = std::any_of(list_.begin(), list_.end(),
                                   [&](const PbrtParameter& own) { return own.name == p.name; });
    if (known) continue;
    list_.push_back(p);
    list_.back().used = true;  // those of many directives need not mean something to each
  }
}

const PbrtParameter* PbrtParameters::find(std::string_view name) const {
  const auto found = std::find_if(list_.begin(), list_.end(),
                                  [&](const PbrtParameter& p) { return p.name == name; });
  if (found == list_.end()) return nullptr;
  found->used = true;
  return &*found;
}

double PbrtParameters::number(std::string_view name, double otherwise) const {
  const std::span<const double> values = numbers(name);
  if (values.empty()) return otherwise;
  if (std::isfinite(values[0])) return values[0];
  problems_.push_back(fmt::format("'{}' is not finite; {} is used", name, otherwise));
  return otherwise;
}

bool PbrtParameters::flag(std::string_view name, bool otherwise) const {
  const std::span<const std::string> values = texts(name);
  return values.empty() ? otherwise : values[0] == "true";
}

std::string PbrtParameters::text(std::string_view name, std::string otherwise) const {
  const std::span<const std::string> values = texts(name);
  return values.empty() ? otherwise : values[0];
}

dvec3 PbrtParameters::point(std::string_view name, const dvec3& otherwise) const {
  const std::span<const double> values = numbers(name);
  if (values.empty()) return otherwise;
  if (values.size() == 3 &&
      std::all_of(values.begin(), values.end(), [](double v) { return std::isfinite(v); })) {
    return {values[0], values[1], values[2]};
  }
  problems_.push_back(fmt::format("'{}' is not three finite numbers; {} {} {} is used", name,
                                  otherwise.x, otherwise.y, otherwise.z));
  return otherwise;
}

std::span<const double> PbrtParameters::numbers(std::string_view name) const {
  const PbrtParameter* found = find(name);
  if (found == nullptr) return {};
  if (found->numbers.empty()) {
    problems_.push_back(fmt::format("'{}' has no number; it is left out", name));
  }
  return found->numbers;
}

std::span<const std::string> PbrtParameters::texts(std::string_view name) const {
  const PbrtParameter* found = find(name);
  if (found == nullptr) return {};
  if (found->strings.empty()) {
    problems_.push_back(fmt::format("'{}' is not in quotes; it is left out", name));
  }
  return found->strings;
}

std::string PbrtParameters::texture(std::string_view name) const {
  const PbrtParameter* found = find(name);
  if (found == nullptr || found->type != "texture" || found->strings.empty()) return {};
  return found->strings[0];
}

void PbrtParameters::ignore(std::initializer_list<std::string_view> names) const {
  for (const std::string_view name : names) find(name);
}

void PbrtParameters::ignoreAll() const {
  for (const PbrtParameter& p : list_) p.used = true;
}

std::vector<std::string> PbrtParameters::problems() const {
  std::vector<std::string> all = problems_;
  for (const PbrtParameter& p : list_) {
    if (!p.used) all.push_back(fmt::format("'{} {}' means nothing here", p.type, p.name));
  }
  return all;
}

}  // namespace trex::detail
