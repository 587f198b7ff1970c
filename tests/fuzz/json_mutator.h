// Mutates JSON value by value, so that the text stays valid and the checks behind the parser are
// reached. Works on the text: a tree of it would take longer to build than the reader takes.
#pragma once

#include <array>
#include <random>
#include <string>
#include <string_view>
#include <vector>

namespace trex::fuzz {

/// The values of a JSON text and where they lie in it.
class JsonText {
 public:
  struct Value {
    std::size_t member;       ///< where its key begins, or it itself
    std::size_t first, last;  ///< of its characters, the latter one past the last
    std::size_t parent;       ///< its number; its own of the outermost
  };

  explicit JsonText(std::string_view text) : text_(text) {
    valid_ = readValue(0, 0, 0);
    skipBlanks();
    valid_ = valid_ && at_ == text_.size();
  }

  bool valid() const { return valid_; }
  const std::vector<Value>& values() const { return values_; }
  std::string_view textOf(const Value& v) const { return text_.substr(v.first, v.last - v.first); }
  char kindOf(const Value& v) const { return text_[v.first]; }
  bool isStructured(const Value& v) const { return kindOf(v) == '{' || kindOf(v) == '['; }

  std::vector<Value> childrenOf(std::size_t number) const {
    std::vector<Value> out;
    for (std::size_t i = 1; i < values_.size(); ++i) {
      if (values_[i].parent == number) out.push_back(values_[i]);
    }
    return out;
  }

 private:
  static constexpr int kMaxDepth = 100;

  char here() const { return at_ < text_.size() ? text_[at_] : '\0'; }
  void skipBlanks() {
    while (at_ < text_.size() && std::string_view(" \t\r\n").find(text_[at_]) != text_.npos) ++at_;
  }
  bool skip(char c) {
    skipBlanks();
    if (here() != c) return false;
    ++at_;
    return true;
  }

  bool readString() {
    if (!skip('"')) return false;
    while (at_ < text_.size() && text_[at_] != '"') at_ += text_[at_] == '\\' ? 2 : 1;
    return skip('"');
  }

  bool readScalar() {
    if (here() == '"') return readString();
    const std::size_t end = text_.find_first_of(",]} \t\r\n", at_);
    const bool any = end != at_ && at_ < text_.size();
    at_ = std::min(end, text_.size());
    return any;
  }

  /// The members of an object or the elements of an array.
  bool readChildren(std::size_t number, int depth, char close) {
    ++at_;
    if (skip(close)) return true;
    do {
      skipBlanks();
      const std::size_t member = at_;
      if (close == '}' && (!readString() || !skip(':'))) return false;
      if (!readValue(member, number, depth + 1)) return false;
    } while (skip(','));
    return skip(close);
  }

  bool readValue(std::size_t member, std::size_t parent, int depth) {
    skipBlanks();
    const std::size_t number = values_.size();
    values_.push_back({member, at_, at_, parent});
    const char c = here();
    const bool good = depth < kMaxDepth && (c == '{'   ? readChildren(number, depth, '}')
                                            : c == '[' ? readChildren(number, depth, ']')
                                                       : readScalar());
    values_[number].last = at_;
    return good;
  }

  std::string_view text_;
  std::size_t at_ = 0;
  std::vector<Value> values_;
  bool valid_ = false;
};

inline std::string_view strangeValue(std::minstd_rand& random) {
  constexpr std::array<std::string_view, 30> kValues = {
      "-1",    "0",     "1",          "2",          "3",     "4",
      "5",     "6",     "9",          "255",        "5120",  "5121",
      "5122",  "5123",  "5125",       "5126",       "65536", "1073741824",
      "-0.5",  "1e-40", "2147483648", "4294967295", "1e39",  "9223372036854775808",
      "1e308", "null",  "true",       "\"\"",       "[]",    "{}"};
  return kValues[random() % kValues.size()];
}

/// Replaces, copies or removes one to three values. The empty string if `text` is not JSON.
inline std::string mutateJson(const char* bytes, std::size_t size, std::minstd_rand& random) {
  std::string text(bytes, size);
  text.erase(text.find_last_not_of(" \t\r\n") + 1);
  for (unsigned changes = 1 + random() % 3; changes > 0; --changes) {
    const JsonText json(text);
    if (!json.valid()) return "";
    const std::vector<JsonText::Value>& all = json.values();
    const std::size_t number = random() % all.size();
    const JsonText::Value value = all[number];
    const unsigned kind = random() % 8;
    const std::vector<JsonText::Value> children =
        kind == 4 || kind == 5 ? json.childrenOf(number) : std::vector<JsonText::Value>();
    if (kind < 4 && !json.isStructured(value)) {
      text.replace(value.first, value.last - value.first, strangeValue(random));
    } else if (kind == 4 && !children.empty()) {
      const std::size_t victim = random() % children.size();
      const bool isLast = victim + 1 == children.size();
      const std::size_t first =
          isLast && victim > 0 ? children[victim - 1].last : children[victim].member;
      text.erase(first, (isLast ? children[victim].last : children[victim + 1].member) - first);
    } else if (kind == 5 && json.kindOf(value) == '[' && !children.empty()) {
      const std::string copy(json.textOf(children[random() % children.size()]));
      text.insert(children.back().last, "," + copy);
    } else {
      const std::string other(kind == 6 ? strangeValue(random)
                                        : json.textOf(all[random() % all.size()]));
      text.replace(value.first, value.last - value.first, other);
      break;  // such changes are large enough
    }
  }
  return text;
}

}  // namespace trex::fuzz
