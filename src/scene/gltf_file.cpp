#include "src/scene/gltf_file.h"

#include <algorithm>
#include <nlohmann/json.hpp>

#include "src/scene/gltf_compressed.h"
#include "src/scene/gltf_repair.h"
#include "src/scene/image_io.h"
#include "src/scene/input_file.h"
#include "src/scene/mapped_file.h"
#include "src/scene/texture_file.h"

namespace trex::detail {
namespace {

using Bytes = std::span<const std::uint8_t>;
using Json = nlohmann::json;

/// JSON nested deeper than this would exhaust the stack of a recursive reader.
constexpr int kMaxJsonDepth = 100;
constexpr std::size_t kHeader = 12, kChunkHeader = 8;

std::uint32_t word(Bytes bytes, std::size_t at) {
  std::uint32_t value;
  std::memcpy(&value, bytes.data() + at, sizeof(value));
  return value;
}

/// The parts of a file.
struct Container {
  std::string_view json;
  Bytes binary;  ///< the second chunk of a .glb
};

Container takeApart(const GltfContext& context, Bytes bytes) {
  const char* text = reinterpret_cast<const char*>(bytes.data());
  if (bytes.size() < 4 || std::memcmp(text, "glTF", 4) != 0) {
    const std::string_view json(text, bytes.size());
    const std::size_t first = json.find_first_not_of("\xef\xbb\xbf \t\r\n");
    const std::string extension = context.path.extension().string();
    const bool binary = extension == ".glb" || extension == ".GLB";
    if (binary && (first == json.npos || json[first] != '{')) {
      context.bad("not a .glb file (wrong magic)");
    }
    return {json, {}};
  }
  constexpr std::size_t kJson = kHeader + kChunkHeader;
  if (bytes.size() < kJson) context.bad("truncated: {} bytes are no .glb file", bytes.size());
  if (word(bytes, 4) != 2) context.bad("glTF version {} can't be read, only 2", word(bytes, 4));
  const std::uint64_t length = word(bytes, 8), jsonLength = word(bytes, kHeader);
  if (length > bytes.size()) {
    context.bad("truncated: the header says {} bytes, the file has {}", length, bytes.size());
  }
  if (word(bytes, 16) != 0x4e4f534au || jsonLength > bytes.size() - kJson) {
    context.bad("the first chunk is not JSON or is longer than the file");
  }
  Container out{{text + kJson, static_cast<std::size_t>(jsonLength)}, {}};
  const std::uint64_t second = kJson + jsonLength;
  if (second + kChunkHeader > length) return out;
  const std::uint64_t have = length - second - kChunkHeader, said = word(bytes, second);
  if (said > have) {
    context.bad("truncated: the second chunk says {} bytes, {} are left", said, have);
  }
  if (word(bytes, second + 4) == 0x004e4942u) out.binary = bytes.subspan(second + 8, said);
  return out;
}

/// Walks over JSON without parsing it: checks its depth and finds values of the outermost object.
class JsonScan {
 public:
  JsonScan(const GltfContext& context, std::string_view json) : json_(json) {
    for (at_ = 0; at_ < json.size(); ++at_) {
      const char c = json[at_];
      if (c == '"') {
        readString();
      } else if (c == '{' || c == '[') {
        if (++depth_ > kMaxJsonDepth) context.bad("JSON nested deeper than {}", kMaxJsonDepth);
      } else if (c == '}' || c == ']') {
        if (--depth_ == 0) endValue();
      } else if (depth_ == 1 && c == ':' && start_ == 0) {
        start_ = at_ + 1;
      } else if (depth_ == 1 && c == ',') {
        endValue();
      }
    }
  }

  /// The text with the values of some keys emptied; these values, in the order of the keys.
  std::string without(std::initializer_list<std::string_view> keys,
                      std::vector<std::string_view>& values) const {
    std::string out;
    std::size_t copied = 0;
    values.assign(keys.size(), {});
    for (const Member& m : members_) {
      const auto key = std::find(keys.begin(), keys.end(), m.key);
      if (key == keys.end()) continue;
      out.append(json_.substr(copied, m.start - copied)).append("[]");
      copied = m.end;
      values[static_cast<std::size_t>(key - keys.begin())] = json_.substr(m.start, m.end - m.start);
    }
    return out.append(json_.substr(copied));
  }

 private:
  struct Member {
    std::string_view key;
    std::size_t start, end;  ///< of the value
  };

  void readString() {
    const std::size_t first = ++at_;
    while (at_ < json_.size() && json_[at_] != '"') at_ += json_[at_] == '\\' ? 2 : 1;
    if (depth_ == 1 && start_ == 0) {
      key_ = json_.substr(first, std::min(at_, json_.size()) - first);
    }
  }
  void endValue() {
    if (start_ > 0) members_.push_back({key_, start_, at_});
    start_ = 0;
  }

  std::string_view json_, key_;
  std::size_t at_ = 0, start_ = 0;  ///< of the value under way; 0 before it
  int depth_ = 0;
  std::vector<Member> members_;
};

std::string textOf(const Json& object, const char* key) {
  const auto found = object.find(key);
  return found != object.end() && found->is_string() ? found->get<std::string>() : std::string();
}

/// A list of objects; what is no list is empty, what is no object is one without members.
std::vector<Json> listOf(std::string_view json) {
  std::vector<Json> out;
  Json list = json.empty() ? Json() : Json::parse(json, nullptr, false);
  for (std::size_t i = 0; list.is_array() && i < list.size(); ++i) {
    out.push_back(list[i].is_object() ? std::move(list[i]) : Json::object());
  }
  return out;
}

/// "%20" and the like in a URI.
std::string percentDecoded(const std::string& text) {
  std::string decoded;
  const auto digit = [](char c) {
    return c >= '0' && c <= '9'   ? c - '0'
           : c >= 'a' && c <= 'f' ? c - 'a' + 10
           : c >= 'A' && c <= 'F' ? c - 'A' + 10
                                  : -1;
  };
  for (std::size_t i = 0; i < text.size(); ++i) {
    if (text[i] == '%' && i + 2 < text.size() && digit(text[i + 1]) >= 0 &&
        digit(text[i + 2]) >= 0) {
      decoded.push_back(static_cast<char>(digit(text[i + 1]) * 16 + digit(text[i + 2])));
      i += 2;
    } else {
      decoded.push_back(text[i]);
    }
  }
  return decoded;
}

/// The file that a URI names. Throws Error(kInput) if it is of the network.
std::filesystem::path fileOf(const GltfContext& context, const std::string& uri,
                             const std::string& who) {
  constexpr std::string_view kLocal = "file://";
  if (uri.starts_with(kLocal)) {
    return findFile(context.path.parent_path(), percentDecoded(uri.substr(kLocal.size())));
  }
  if (uri.find(':') < 12 && uri.find('/') > uri.find(':')) {
    fail(ExitCode::kInput, "{}: '{:.80}': only files and data URIs can be read", who, uri);
  }
  return findFile(context.path.parent_path(), percentDecoded(uri));
}

int base64Digit(char c) {
  if (c >= 'A' && c <= 'Z') return c - 'A';
  if (c >= 'a' && c <= 'z') return c - 'a' + 26;
  if (c >= '0' && c <= '9') return c - '0' + 52;
  return c == '+' ? 62 : c == '/' ? 63 : -1;
}

/// Bytes of a "data:" URI [RFC 2397], of base64 or with percent signs; false if it is none.
bool decodeDataUri(const std::string& uri, std::vector<std::uint8_t>& out) {
  constexpr std::size_t kLongestHead = 200;
  const std::size_t comma = uri.find(',');
  if (!uri.starts_with("data:") || comma > kLongestHead) return false;
  std::string head = uri.substr(0, comma);
  for (char& c : head) c = static_cast<char>(c >= 'A' && c <= 'Z' ? c - 'A' + 'a' : c);
  if (!head.ends_with(";base64")) {
    const std::string decoded = percentDecoded(uri.substr(comma + 1));
    out.assign(decoded.begin(), decoded.end());
    return true;
  }
  std::uint32_t bits = 0;
  int count = 0;
  for (const char c : std::string_view(uri).substr(comma + 1)) {
    if (c == ' ' || c == '\n' || c == '\r' || c == '\t') continue;
    const int digit = base64Digit(c);
    if (digit < 0) break;  // '=', or damage
    bits = bits << 6 | static_cast<std::uint32_t>(digit);
    count += 6;
    if (count < 8) continue;
    count -= 8;
    out.push_back(static_cast<std::uint8_t>(bits >> count));
  }
  return true;
}

void hold(GltfBuffer& buffer, std::vector<std::uint8_t> data) {
  const auto owner = std::make_shared<const std::vector<std::uint8_t>>(std::move(data));
  buffer.bytes = *owner;
  buffer.owner = owner;
}

/// Finds the bytes of a buffer; why not is kept for those who want them.
void findBytes(GltfContext& context, const Json& from, Bytes binary, const std::string& who,
               GltfBuffer& to) {
  const std::string uri = textOf(from, "uri");
  std::vector<std::uint8_t> decoded;
  if (uri.empty()) {
    to.bytes = binary;
    if (binary.empty()) to.problem = who + " has no data";
  } else if (decodeDataUri(uri, decoded)) {
    hold(to, std::move(decoded));
  } else {
    try {
      const auto path = fileOf(context, uri, who);
      noteFile(context.scene, path);
      const auto file = std::make_shared<const MappedFile>(path);
      to.bytes = {file->data(), file->size()};
      to.owner = file;
    } catch (const Error& e) {
      to.problem = e.what();
    }
  }
}

void readBuffers(GltfContext& context, std::string_view json, Bytes binary) {
  for (const Json& from : listOf(json)) {
    const std::string who = fmt::format("buffer {}", context.buffers.size());
    GltfBuffer& to = context.buffers.emplace_back();
    findBytes(context, from, context.buffers.size() == 1 ? binary : Bytes(), who, to);
    const auto said = from.find("byteLength");
    if (said == from.end() || !said->is_number_unsigned() || to.bytes.empty()) continue;
    const auto length = said->get<std::uint64_t>();
    if (length > to.bytes.size()) {
      context.replace("{}: its byteLength is {}, but it has {} bytes; what they hold is shown", who,
                      length, to.bytes.size());
    }
  }
}

void readImages(GltfContext& context, std::string_view json) {
  for (const Json& from : listOf(json)) {
    GltfImage& to = context.images.emplace_back();
    to.name = textOf(from, "name");
    to.uri = textOf(from, "uri");
    const auto view = from.find("bufferView");
    if (view != from.end() && view->is_number_unsigned() && view->get<std::uint64_t>() < 1u << 31) {
      to.bufferView = view->get<int>();
    }
  }
}

bool noFile(const std::string&, void*) { return false; }
std::string samePath(const std::string& path, void*) { return path; }
bool readNothing(std::vector<unsigned char>*, std::string*, const std::string&, void*) {
  return false;
}
bool writeNothing(std::string*, const std::string&, const std::vector<unsigned char>&, void*) {
  return false;
}

bool load(const std::string& json, tinygltf::Model& model, std::string& error,
          std::string& warning) {
  tinygltf::TinyGLTF loader;
  loader.SetFsCallbacks({&noFile, &samePath, &readNothing, &writeNothing, nullptr});
  error.clear();
  warning.clear();
  bool good = false;
  try {
    good = json.size() <= 0xffffffffu &&
           loader.LoadASCIIFromString(&model, &error, &warning, json.data(),
                                      static_cast<unsigned>(json.size()), "");
  } catch (const std::bad_alloc&) {
    throw;
  } catch (const std::exception& e) {
    error = e.what();
  }
  error = oneLine(!good && error.empty() ? "it has another form" : error);
  return good;
}

void parseRest(GltfContext& context, const std::string& json) {
  std::string error, warning;
  if (!load(json, context.model, error, warning)) {
    const std::string first = error;
    const std::string repaired = repairedGltf(context, json, [&](const std::string& part) {
      tinygltf::Model model;
      return load(part, model, error, warning) ? std::string() : error;
    });
    context.model = {};
    if (repaired.empty() || !load(repaired, context.model, error, warning)) {
      context.bad("not valid glTF: {}", first);
    }
  }
  // tinygltf goes on after some errors, with a part of the file missing. One is none: a skin may
  // leave these matrices out.
  const std::string allowed = "'inverseBindMatrices' property is missing in Skin.";
  for (auto at = error.find(allowed); at != error.npos; at = error.find(allowed)) {
    error.erase(at, allowed.size());
  }
  if (!trimmed(error).empty()) context.replace("{}; that part is left out", trimmed(error));
  if (!warning.empty()) context.warn("{}", oneLine(warning));
}

}  // namespace

void parseGltf(GltfContext& context, Bytes bytes) {
  const Container parts = takeApart(context, bytes);
  std::vector<std::string_view> lists;
  std::string json = JsonScan(context, parts.json).without({"buffers", "images"}, lists);
  makeReadable(json);
  parseRest(context, json);
  readBuffers(context, lists[0], parts.binary);
  readImages(context, lists[1]);
}

Bytes bytesOfView(const GltfContext& context, int number) {
  const auto& views = context.model.bufferViews;
  if (number < 0 || std::size_t(number) >= views.size()) {
    context.bad("bufferView {} does not exist; there are {}", number, views.size());
  }
  const tinygltf::BufferView& view = views[number];
  if (view.buffer < 0 || std::size_t(view.buffer) >= context.buffers.size()) {
    context.bad("bufferView {}: buffer {} does not exist", number, view.buffer);
  }
  const GltfBuffer& buffer = context.buffers[view.buffer];
  if (!buffer.problem.empty()) context.bad("bufferView {}: {}", number, buffer.problem);
  const std::uint64_t have = buffer.bytes.size();
  if (view.byteOffset > have || view.byteLength > have - view.byteOffset) {
    context.bad("bufferView {}: bytes {} + {} lie outside buffer {} of {} bytes", number,
                view.byteOffset, view.byteLength, view.buffer, have);
  }
  return buffer.bytes.subspan(view.byteOffset, view.byteLength);
}

void setData(GltfContext& context, tinygltf::BufferView& view, std::vector<std::uint8_t> data) {
  view.buffer = static_cast<int>(context.buffers.size());
  view.byteOffset = 0;
  view.byteLength = data.size();
  hold(context.buffers.emplace_back(), std::move(data));
}

Image decodeGltfImage(GltfContext& context, int number, bool srgb) {
  const GltfImage& image = context.images[number];
  const std::string name = fmt::format("{}: image {} ('{}')", context.name, number,
                                       image.uri.empty() ? image.name : image.uri.substr(0, 80));
  const TextureCache* const textures = context.scene.textures.get();
  if (image.uri.empty()) {
    return decodeImage(bytesOfView(context, image.bufferView), name, srgb, textures);
  }
  std::vector<std::uint8_t> encoded;
  if (decodeDataUri(image.uri, encoded)) return decodeImage(encoded, name, srgb, textures);
  const std::filesystem::path path = fileOf(context, image.uri, name);
  noteFile(context.scene, path);
  return decodeImage(readWholeFile(path, name), name, srgb, textures);
}

}  // namespace trex::detail
