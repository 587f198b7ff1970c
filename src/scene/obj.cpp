// A streaming reader of Wavefront OBJ. Every (object, material) pair becomes one mesh.
#include <algorithm>
#include <array>
#include <map>

#include "src/scene/import_detail.h"
#include "src/scene/input_file.h"
#include "src/scene/mtl.h"

namespace trex::detail {
namespace {

/// Indices of position, texture coordinate and normal; -1 where absent.
struct Corner {
  std::int32_t position = -1, texCoord = -1, normal = -1;
  bool operator==(const Corner&) const = default;
};

/// Numbers the distinct corners of a mesh in order of appearance. Open addressing: 4 bytes a slot.
class CornerTable {
 public:
  std::uint32_t indexOf(const Corner& corner) {
    if (corners_.size() * 2 >= slots_.size()) grow();
    std::uint32_t& slot = slots_[find(corner)];
    if (slot == 0) {
      corners_.push_back(corner);
      slot = static_cast<std::uint32_t>(corners_.size());
    }
    return slot - 1;
  }
  const std::vector<Corner>& corners() const { return corners_; }

 private:
  static std::size_t hash(const Corner& c) {
    std::uint64_t h = std::uint32_t(c.position) * 0x9e3779b97f4a7c15ull;
    h = (h ^ (h >> 29) ^ std::uint32_t(c.texCoord)) * 0xbf58476d1ce4e5b9ull;
    h = (h ^ (h >> 32) ^ std::uint32_t(c.normal)) * 0x94d049bb133111ebull;
    return static_cast<std::size_t>(h ^ (h >> 31));
  }
  std::size_t find(const Corner& corner) const {
    const std::size_t mask = slots_.size() - 1;
    std::size_t at = hash(corner) & mask;
    while (slots_[at] != 0 && !(corners_[slots_[at] - 1] == corner)) at = (at + 1) & mask;
    return at;
  }
  void grow() {
    slots_.assign(std::max<std::size_t>(64, slots_.size() * 2), 0);
    for (std::size_t i = 0; i < corners_.size(); ++i) {
      slots_[find(corners_[i])] = static_cast<std::uint32_t>(i + 1);
    }
  }

  std::vector<std::uint32_t> slots_;  ///< 1 + index into corners_; 0 is free
  std::vector<Corner> corners_;
};

struct Group {
  int object = 0, material = 0;
  CornerTable table;
  std::vector<glm::uvec3> triangles;
};

class ObjReader {
 public:
  ObjReader(const std::filesystem::path& path, const ImportOptions& options)
      : input_(path), path_(path), options_(options) {
    scene_.materials.push_back(defaultMaterial());
  }

  Scene read() {
    std::string_view line;
    std::string joined;
    while (input_.readLine(line)) {
      // A backslash at the end of a line continues it.
      if (!line.empty() && line.back() == '\\') {
        joined.append(line.substr(0, line.size() - 1)).push_back(' ');
        if (joined.size() > InputFile::kMaxLine) bad("line too long");
        continue;
      }
      if (joined.empty()) {
        readStatement(line);
      } else {
        joined.append(line);
        readStatement(joined);
        joined.clear();
      }
    }
    return finish();
  }

 private:
  template <typename... Args>
  [[noreturn]] void bad(fmt::format_string<Args...> format, Args&&... args) const {
    fail(ExitCode::kInput, "{}:{}: {}", input_.name(), input_.lineNumber(),
         fmt::format(format, std::forward<Args>(args)...));
  }

  void readStatement(std::string_view line) {
    const std::string_view keyword = nextWord(line);
    if (keyword.empty() || keyword.front() == '#') return;
    if (keyword == "v") {
      readPosition(line);
    } else if (keyword == "f") {
      readFace(line);
    } else if (keyword == "vn") {
      readNormal(line);
    } else if (keyword == "vt") {
      readTexCoord(line);
    } else if (keyword == "usemtl") {
      useMaterial(rest(line));
    } else if (keyword == "o") {
      objectsNamed_ = true;
      beginObject(rest(line));
    } else if (keyword == "g" && !objectsNamed_) {
      beginObject(rest(line));
    } else if (keyword == "mtllib") {
      readLibraries(line);
    } else if (keyword == "l" || keyword == "p") {
      ++linesAndPoints_;
    }
  }

  static std::string rest(std::string_view line) {
    while (!line.empty() && (line.back() == ' ' || line.back() == '\t')) line.remove_suffix(1);
    const std::size_t first = line.find_first_not_of(" \t");
    return first == line.npos ? std::string() : std::string(line.substr(first));
  }

  double number(std::string_view word) const {
    double value = 0.0;
    if (!parseDouble(word, value)) {
      if (word.empty()) bad("a number is missing");
      bad("'{}' is not a number", word.substr(0, 40));
    }
    return value;
  }

  void readPosition(std::string_view line) {
    dvec3 p;
    for (int i = 0; i < 3; ++i) p[i] = number(nextWord(line));
    if (positions_.size() >= 0x7fffffffu) bad("too many vertices");
    positions_.push_back(frame_.toLocal(p));
    std::array<float, 4> extra{};
    std::size_t count = 0;
    for (std::string_view w = nextWord(line); !w.empty() && count < 4; w = nextWord(line)) {
      extra[count++] = static_cast<float>(number(w));
    }
    if (count < 3) return;  // none, or a weight
    const auto channel = [&](std::size_t i) {
      return toUnorm8(decodeSrgb(std::clamp(extra[i + (count == 4)], 0.0f, 1.0f)));
    };
    // Vertices before the first coloured one are white.
    colors_.resize(positions_.size() - 1, glm::u8vec4(255));
    colors_.push_back({channel(0), channel(1), channel(2), std::uint8_t(255)});
  }

  void readNormal(std::string_view line) {
    vec3 n;
    for (int i = 0; i < 3; ++i) n[i] = static_cast<float>(number(nextWord(line)));
    normals_.push_back(n);
  }

  void readTexCoord(std::string_view line) {
    const float u = static_cast<float>(number(nextWord(line)));
    const std::string_view second = nextWord(line);
    const float v = second.empty() ? 0.0f : static_cast<float>(number(second));
    texCoords_.push_back(vec2(u, 1.0f - v));
  }

  void beginObject(const std::string& name) {
    scene_.objects.push_back(name.empty() ? fmt::format("object {}", scene_.objects.size()) : name);
    object_ = static_cast<int>(scene_.objects.size()) - 1;
    group_ = nullptr;
  }

  void readLibraries(std::string_view line) {
    const std::string whole = rest(line);
    const std::filesystem::path folder = path_.parent_path();
    std::error_code error;
    // Several names are allowed, and so are blanks in a name.
    if (std::filesystem::is_regular_file(folder / whole, error)) {
      readMtl(folder / whole, options_, scene_, materialNames_);
      return;
    }
    for (std::string_view name = nextWord(line); !name.empty(); name = nextWord(line)) {
      const std::filesystem::path file = folder / name;
      if (std::filesystem::is_regular_file(file, error)) {
        readMtl(file, options_, scene_, materialNames_);
      } else {
        scene_.warnings.push_back(fmt::format("{}:{}: no material file {}", input_.name(),
                                              input_.lineNumber(), file.string()));
      }
    }
  }

  void useMaterial(const std::string& name) {
    const auto found = materialNames_.find(name);
    material_ = found == materialNames_.end() ? 0 : found->second;
    group_ = nullptr;
    if (found == materialNames_.end() && materialNames_.emplace(name, 0).second) {
      scene_.warnings.push_back(fmt::format("{}:{}: material '{}' is not defined; grey is used",
                                            input_.name(), input_.lineNumber(), name));
    }
  }

  Group& group() {
    if (group_ != nullptr) return *group_;
    if (object_ == kNone) beginObject(path_.stem().string());
    const auto [at, isNew] = groups_.try_emplace({object_, material_});
    group_ = &at->second;
    if (isNew) {
      group_->object = object_;
      group_->material = material_;
    }
    return *group_;
  }

  /// One of "v", "v/t", "v//n", "v/t/n"; from 1, or backwards from the last if negative.
  Corner readCorner(std::string_view word) const {
    const std::array<std::size_t, 3> sizes = {positions_.size(), texCoords_.size(),
                                              normals_.size()};
    constexpr std::array<const char*, 3> kNames = {"vertex", "texture coordinate", "normal"};
    std::array<std::int32_t, 3> index = {-1, -1, -1};
    std::string_view left = word;
    for (int i = 0; i < 3; ++i) {
      const std::size_t slash = left.find('/');
      const std::string_view part = left.substr(0, slash);
      if (!part.empty() || i == 0) {
        std::int64_t value = 0;
        if (!parseInteger(part, value)) bad("'{}' is not a corner of a face", word.substr(0, 40));
        const std::int64_t size = static_cast<std::int64_t>(sizes[i]);
        const std::int64_t zeroBased = value > 0 ? value - 1 : size + value;
        if (value == 0 || zeroBased < 0 || zeroBased >= size) {
          bad("{} {} is out of range; there are {}", kNames[i], value, size);
        }
        index[i] = static_cast<std::int32_t>(zeroBased);
      }
      if (slash == left.npos) return {index[0], index[1], index[2]};
      left.remove_prefix(slash + 1);
    }
    bad("'{}' is not a corner of a face", word.substr(0, 40));
  }

  void readFace(std::string_view line) {
    Group& g = group();
    std::uint32_t first = 0, last = 0;
    int corners = 0;
    for (std::string_view w = nextWord(line); !w.empty() && w.front() != '#'; w = nextWord(line)) {
      const std::uint32_t index = g.table.indexOf(readCorner(w));
      if (corners == 0) first = index;
      if (corners >= 2) {
        if (g.triangles.size() >= kMaxElements) bad("too many triangles");
        g.triangles.push_back({first, last, index});
      }
      last = index;
      ++corners;
    }
    if (corners < 3) ++smallFaces_;
  }

  void addMesh(Group& g) {
    Mesh mesh;
    mesh.name = scene_.objects[g.object];
    mesh.origin = frame_.origin();
    mesh.material = g.material;
    mesh.triangles = std::move(g.triangles);
    const std::vector<Corner>& corners = g.table.corners();
    const auto any = [&](std::int32_t Corner::*member) {
      return std::any_of(corners.begin(), corners.end(),
                         [&](const Corner& c) { return c.*member >= 0; });
    };
    const Material& material = scene_.materials[g.material];
    const bool textured = material.baseColorTexture.present() || material.emissiveTexture.present();
    const bool uv = textured && any(&Corner::texCoord), normals = any(&Corner::normal);
    mesh.positions.reserve(corners.size());
    for (const Corner& c : corners) {
      mesh.positions.push_back(positions_[c.position]);
      if (uv) mesh.texCoords.push_back(c.texCoord < 0 ? vec2(0.0f) : texCoords_[c.texCoord]);
      // A missing normal becomes that of the face.
      if (normals) mesh.normals.push_back(c.normal < 0 ? vec3(0.0f) : normals_[c.normal]);
      if (!colors_.empty()) mesh.colors.push_back(colors_[c.position]);
    }
    g.table = CornerTable();
    sanitiseMesh(scene_, mesh, fmt::format("{}: object '{}'", input_.name(), mesh.name));
    Instance instance;
    instance.name = mesh.name;
    instance.mesh = static_cast<int>(scene_.meshes.size());
    instance.object = g.object;
    scene_.meshes.push_back(std::move(mesh));
    scene_.instances.push_back(std::move(instance));
  }

  Scene finish() {
    if (!colors_.empty()) {
      colors_.resize(positions_.size(), glm::u8vec4(255));
      scene_.materials[0].baseColor = vec4(1.0f);
    }
    for (auto& [key, g] : groups_) addMesh(g);
    const auto warnCount = [&](std::uint64_t count, const char* what) {
      if (count > 0) {
        scene_.warnings.push_back(fmt::format("{}: {} {}", input_.name(), count, what));
      }
    };
    warnCount(linesAndPoints_, "lines and points ignored");
    warnCount(smallFaces_, "faces with fewer than 3 corners ignored");
    return std::move(scene_);
  }

  InputFile input_;
  std::filesystem::path path_;
  const ImportOptions& options_;
  Scene scene_;
  std::map<std::string, int> materialNames_;
  std::map<std::pair<int, int>, Group> groups_;
  Group* group_ = nullptr;  ///< of the current object and material; looked up on the next face
  int object_ = kNone, material_ = 0;
  bool objectsNamed_ = false;
  LocalFrame frame_;
  std::vector<vec3> positions_, normals_;
  std::vector<vec2> texCoords_;
  std::vector<glm::u8vec4> colors_;
  std::uint64_t linesAndPoints_ = 0, smallFaces_ = 0;
};

}  // namespace

Scene readObj(const std::filesystem::path& path, const ImportOptions& options) {
  return ObjReader(path, options).read();
}

}  // namespace trex::detail
