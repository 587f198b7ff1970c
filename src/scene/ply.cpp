// A streaming reader of PLY (G. Turk, "The PLY Polygon File Format", 1994).
#include <algorithm>
#include <array>
#include <bit>
#include <cstring>
#include <map>

#include "src/scene/import_detail.h"
#include "src/scene/input_file.h"

namespace trex::detail {
namespace {

enum class Type : std::uint8_t { kInt8, kUint8, kInt16, kUint16, kInt32, kUint32, kFloat, kDouble };
constexpr std::array<std::size_t, 8> kTypeSize = {1, 1, 2, 2, 4, 4, 4, 8};

bool isInteger(Type type) { return type < Type::kFloat; }

struct Property {
  std::string name;
  Type type = Type::kFloat;
  bool isList = false;
  Type countType = Type::kUint8;
};

struct Element {
  std::string name;
  std::uint64_t count = 0;
  std::vector<Property> properties;
};

enum class Format { kAscii, kLittle, kBig };

/// What a vertex property is stored as.
enum Slot { kX, kY, kZ, kNx, kNy, kNz, kU, kV, kRed, kGreen, kBlue, kAlpha, kSlots, kUnused };

class PlyReader {
 public:
  explicit PlyReader(const std::filesystem::path& path) : input_(path) {}

  Scene read() {
    readHeader();
    for (const Element& element : elements_) {
      checkCount(element);
      if (element.name == "vertex") {
        readVertices(element);
      } else if (element.name == "face") {
        readFaces(element);
      } else {
        skipElement(element);
      }
    }
    return finish();
  }

 private:
  template <typename... Args>
  [[noreturn]] void bad(fmt::format_string<Args...> format, Args&&... args) const {
    fail(ExitCode::kInput, "{}: {}", input_.name(),
         fmt::format(format, std::forward<Args>(args)...));
  }

  void readHeader() {
    std::string_view line;
    if (!input_.readLine(line) || nextWord(line) != "ply") bad("not a PLY file (wrong magic)");
    bool formatSeen = false;
    while (input_.readLine(line)) {
      const std::string_view keyword = nextWord(line);
      if (keyword == "end_header") {
        if (!formatSeen) bad("the header names no format");
        return;
      }
      if (keyword == "format") {
        readFormat(line);
        formatSeen = true;
      } else if (keyword == "element") {
        readElement(line);
      } else if (keyword == "property") {
        readProperty(line);
      } else if (!keyword.empty() && keyword != "comment" && keyword != "obj_info") {
        bad("header line {}: unknown keyword '{}'", input_.lineNumber(), keyword);
      }
    }
    bad("the header has no end_header");
  }

  void readFormat(std::string_view line) {
    const std::string_view name = nextWord(line);
    if (name == "ascii") {
      format_ = Format::kAscii;
    } else if (name == "binary_little_endian") {
      format_ = Format::kLittle;
    } else if (name == "binary_big_endian") {
      format_ = Format::kBig;
    } else {
      bad("header line {}: unknown format '{}'", input_.lineNumber(), name);
    }
  }

  void readElement(std::string_view line) {
    Element element;
    element.name = nextWord(line);
    std::int64_t count = -1;
    if (!parseInteger(nextWord(line), count) || count < 0 || element.name.empty()) {
      bad("header line {}: an element needs a name and a count", input_.lineNumber());
    }
    for (const Element& other : elements_) {
      if (other.name == element.name) bad("element {} is given twice", element.name);
    }
    element.count = static_cast<std::uint64_t>(count);
    elements_.push_back(std::move(element));
  }

  Type parseType(std::string_view word) const {
    static const std::map<std::string_view, Type> kTypes = {
        {"char", Type::kInt8},     {"int8", Type::kInt8},     {"uchar", Type::kUint8},
        {"uint8", Type::kUint8},   {"short", Type::kInt16},   {"int16", Type::kInt16},
        {"ushort", Type::kUint16}, {"uint16", Type::kUint16}, {"int", Type::kInt32},
        {"int32", Type::kInt32},   {"uint", Type::kUint32},   {"uint32", Type::kUint32},
        {"float", Type::kFloat},   {"float32", Type::kFloat}, {"double", Type::kDouble},
        {"float64", Type::kDouble}};
    const auto found = kTypes.find(word);
    if (found == kTypes.end()) bad("header line {}: unknown type '{}'", input_.lineNumber(), word);
    return found->second;
  }

  void readProperty(std::string_view line) {
    if (elements_.empty()) bad("header line {}: property before element", input_.lineNumber());
    Property property;
    std::string_view word = nextWord(line);
    if (word == "list") {
      property.isList = true;
      property.countType = parseType(nextWord(line));
      if (!isInteger(property.countType)) {
        bad("header line {}: a list's count must be an integer", input_.lineNumber());
      }
      word = nextWord(line);
    }
    property.type = parseType(word);
    property.name = nextWord(line);
    if (property.name.empty()) {
      bad("header line {}: property without a name", input_.lineNumber());
    }
    elements_.back().properties.push_back(std::move(property));
  }

  /// A row takes some bytes at least, so a count larger than the file can hold is a lie.
  void checkCount(const Element& element) const {
    std::uint64_t rowBytes = 0;
    for (const Property& p : element.properties) {
      rowBytes += format_ == Format::kAscii ? 2 : kTypeSize[int(p.isList ? p.countType : p.type)];
    }
    const std::uint64_t slack = format_ == Format::kAscii ? 1 : 0;  // no line end at the end
    if (rowBytes > 0 && element.count > (input_.remaining() + slack) / rowBytes) {
      bad("the header promises {} of element {}, more than the {} bytes that follow can hold",
          element.count, element.name, input_.remaining());
    }
    if (element.count > kMaxElements && !element.properties.empty()) {
      bad("{} of element {} are more than this program reads", element.count, element.name);
    }
  }

  double asciiScalar() {
    std::string_view word = nextWord(rest_);
    while (word.empty()) {
      if (!input_.readLine(rest_)) bad("the file ends too early (truncated)");
      word = nextWord(rest_);
    }
    double value = 0.0;
    if (!parseDouble(word, value)) {
      bad("line {}: '{}' is not a number", input_.lineNumber(), word.substr(0, 40));
    }
    return value;
  }

  template <typename T>
  T load() {
    std::array<std::uint8_t, sizeof(T)> bytes;
    std::memcpy(bytes.data(), input_.take(sizeof(T)), sizeof(T));
    if ((format_ == Format::kBig) != (std::endian::native == std::endian::big)) {
      std::reverse(bytes.begin(), bytes.end());
    }
    return std::bit_cast<T>(bytes);
  }

  double scalar(Type type) {
    if (format_ == Format::kAscii) return asciiScalar();
    switch (type) {
      case Type::kInt8:
        return load<std::int8_t>();
      case Type::kUint8:
        return load<std::uint8_t>();
      case Type::kInt16:
        return load<std::int16_t>();
      case Type::kUint16:
        return load<std::uint16_t>();
      case Type::kInt32:
        return load<std::int32_t>();
      case Type::kUint32:
        return load<std::uint32_t>();
      case Type::kFloat:
        return load<float>();
      case Type::kDouble:
        break;
    }
    return load<double>();
  }

  std::uint64_t listCount(const Property& property) {
    const double count = scalar(property.countType);
    if (!(count >= 0.0) || count != std::floor(count) ||
        count > static_cast<double>(input_.remaining() + rest_.size())) {
      bad("a list of {} {} is longer than the file, or its count is not a count", count,
          property.name);
    }
    return static_cast<std::uint64_t>(count);
  }

  void skip(const Property& property) {
    const std::uint64_t count = property.isList ? listCount(property) : 1;
    for (std::uint64_t i = 0; i < count; ++i) scalar(property.type);
  }

  void skipElement(const Element& element) {
    if (element.properties.empty()) return;
    if (element.count > 0) {
      warnings_.push_back(fmt::format("{}: element {} ignored", input_.name(), element.name));
    }
    for (std::uint64_t i = 0; i < element.count; ++i) {
      for (const Property& property : element.properties) skip(property);
    }
  }

  static Slot slotOf(const Property& property) {
    static const std::map<std::string_view, Slot> kNames = {{"x", kX},
                                                            {"y", kY},
                                                            {"z", kZ},
                                                            {"nx", kNx},
                                                            {"ny", kNy},
                                                            {"nz", kNz},
                                                            {"u", kU},
                                                            {"s", kU},
                                                            {"texture_u", kU},
                                                            {"v", kV},
                                                            {"t", kV},
                                                            {"texture_v", kV},
                                                            {"red", kRed},
                                                            {"green", kGreen},
                                                            {"blue", kBlue},
                                                            {"alpha", kAlpha},
                                                            {"diffuse_red", kRed},
                                                            {"diffuse_green", kGreen},
                                                            {"diffuse_blue", kBlue},
                                                            {"r", kRed},
                                                            {"g", kGreen},
                                                            {"b", kBlue},
                                                            {"a", kAlpha}};
    const auto found = property.isList ? kNames.end() : kNames.find(property.name);
    return found == kNames.end() ? kUnused : found->second;
  }

  /// What integers must be divided by to lie in [0, 1].
  static double colorScale(Type type) {
    switch (type) {
      case Type::kInt8:
        return 127.0;
      case Type::kUint8:
        return 255.0;
      case Type::kInt16:
        return 32767.0;
      case Type::kUint16:
        return 65535.0;
      case Type::kInt32:
        return 2147483647.0;
      case Type::kUint32:
        return 4294967295.0;
      default:
        return 1.0;
    }
  }

  void readVertices(const Element& element) {
    std::vector<Slot> slots;
    std::array<bool, kSlots> has{};
    std::array<double, kSlots> value{};
    std::array<double, kSlots> divisor;
    divisor.fill(1.0);
    bool srgb = false, wide = false;
    for (const Property& p : element.properties) {
      const Slot slot = slotOf(p);
      slots.push_back(slot);
      if (slot == kUnused) continue;
      has[slot] = true;
      if (slot >= kRed) divisor[slot] = colorScale(p.type);
      if (slot == kRed) srgb = isInteger(p.type);
      wide |= slot <= kZ && p.type == Type::kDouble;
    }
    if (!(has[kX] && has[kY] && has[kZ])) bad("element vertex has no x, y and z");
    const bool normals = has[kNx] && has[kNy] && has[kNz], uv = has[kU] && has[kV];
    const bool colors = has[kRed] && has[kGreen] && has[kBlue];
    mesh_.positions.reserve(element.count);
    if (normals) mesh_.normals.reserve(element.count);
    if (uv) mesh_.texCoords.reserve(element.count);
    if (colors) mesh_.colors.reserve(element.count);
    const auto channel = [&](Slot slot, bool decode) {
      const float c = static_cast<float>(value[slot] / divisor[slot]);
      return toUnorm8(decode ? decodeSrgb(c) : c);
    };
    for (std::uint64_t i = 0; i < element.count; ++i) {
      for (std::size_t k = 0; k < slots.size(); ++k) {
        const Property& property = element.properties[k];
        if (slots[k] == kUnused) {
          skip(property);
        } else {
          value[slots[k]] = scalar(property.type);
        }
      }
      const dvec3 p(value[kX], value[kY], value[kZ]);
      // Text has as many digits as it likes, so it is treated like doubles.
      mesh_.positions.push_back(wide ? frame_.toLocal(p) : vec3(p));
      if (normals) mesh_.normals.push_back(vec3(value[kNx], value[kNy], value[kNz]));
      if (uv) mesh_.texCoords.push_back(vec2(value[kU], 1.0 - value[kV]));
      if (colors) {
        mesh_.colors.push_back({channel(kRed, srgb), channel(kGreen, srgb), channel(kBlue, srgb),
                                has[kAlpha] ? channel(kAlpha, false) : std::uint8_t(255)});
      }
    }
  }

  std::uint32_t faceIndex(const Property& property, std::uint64_t face) {
    const double index = scalar(property.type);
    if (!(index >= 0.0 && index <= 4294967295.0) || index != std::floor(index)) {
      bad("face {} refers to vertex {}", face, index);
    }
    return static_cast<std::uint32_t>(index);
  }

  void readFaces(const Element& element) {
    std::size_t indices = element.properties.size();
    for (std::size_t k = 0; k < element.properties.size(); ++k) {
      const Property& p = element.properties[k];
      if (p.isList && (p.name == "vertex_indices" || p.name == "vertex_index")) indices = k;
    }
    if (indices == element.properties.size()) bad("element face has no list vertex_indices");
    if (!isInteger(element.properties[indices].type)) bad("vertex_indices must be integers");
    mesh_.triangles.reserve(std::min<std::uint64_t>(element.count, input_.remaining() / 4));
    std::uint64_t small = 0;
    for (std::uint64_t i = 0; i < element.count; ++i) {
      for (std::size_t k = 0; k < element.properties.size(); ++k) {
        const Property& property = element.properties[k];
        if (k != indices) {
          skip(property);
        } else if (!readPolygon(property, i)) {
          ++small;
        }
      }
    }
    if (small > 0) {
      warnings_.push_back(
          fmt::format("{}: {} faces with fewer than 3 corners ignored", input_.name(), small));
    }
  }

  /// A fan around the first corner. False if there are too few corners.
  bool readPolygon(const Property& property, std::uint64_t face) {
    const std::uint64_t corners = listCount(property);
    std::uint32_t first = 0, last = 0;
    for (std::uint64_t c = 0; c < corners; ++c) {
      const std::uint32_t index = faceIndex(property, face);
      if (c == 0) first = index;
      if (c >= 2) {
        if (mesh_.triangles.size() >= kMaxElements) bad("too many triangles");
        mesh_.triangles.push_back({first, last, index});
      }
      last = index;
    }
    return corners >= 3;
  }

  Scene finish() {
    Scene scene;
    scene.warnings = std::move(warnings_);
    Material material = defaultMaterial();
    if (!mesh_.colors.empty()) material.baseColor = vec4(1.0f);
    scene.materials.push_back(std::move(material));
    mesh_.name = std::filesystem::path(input_.name()).stem().string();
    mesh_.origin = frame_.origin();
    sanitiseMesh(scene, mesh_, input_.name());
    Instance instance;
    instance.name = mesh_.name;
    scene.objects.push_back(mesh_.name);
    scene.meshes.push_back(std::move(mesh_));
    scene.instances.push_back(std::move(instance));
    return scene;
  }

  InputFile input_;
  Format format_ = Format::kAscii;
  std::vector<Element> elements_;
  std::string_view rest_;  ///< of the current line, ASCII only
  Mesh mesh_;
  LocalFrame frame_;
  std::vector<std::string> warnings_;
};

}  // namespace

Scene readPly(const std::filesystem::path& path) { return PlyReader(path).read(); }

}  // namespace trex::detail
