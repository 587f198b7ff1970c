#include "src/scene/obj_reader.h"

#include <algorithm>
#include <array>
#include <charconv>

#include "src/scene/mtl.h"
#include "src/scene/texture_file.h"

namespace trex::detail {
namespace {

/// Statements that do not change what is seen of polygons.
const std::set<std::string_view> kUnseen = {
    "g",         "vp",   "mg",   "lod",  "bevel", "c_interp", "d_interp", "shadow_obj",
    "trace_obj", "bmat", "step", "parm", "trim",  "hole",     "scrv",     "cstype",
    "deg",       "sp",   "end",  "con",  "ctech", "stech"};

std::string outOfRange(std::size_t kind, std::int64_t value, std::size_t size) {
  constexpr std::array<const char*, 3> kNames = {"vertex", "texture coordinate", "normal"};
  return fmt::format("{} {} is out of range; there are {}", kNames[kind], value, size);
}

}  // namespace

ObjReader::ObjReader(const std::filesystem::path& path, const ImportOptions& options,
                     const std::filesystem::path& folder)
    : positions_(folder),
      normals_(folder),
      texCoords_(folder),
      colors_(folder),
      madeNormals_(folder),
      input_(path),
      path_(path),
      options_(options),
      waiting_(folder),
      waitingCorners_(folder) {
  scene_.textures = options.textures;
  scene_.materials.push_back(defaultMaterial());
}

void ObjReader::readAll() {
  std::string_view keyword, arguments;
  while (input_.next(keyword, arguments)) readStatement(keyword, arguments);
  addWaitingFaces();
  if (!colors_.empty()) {
    colors_.fill(positions_.size(), glm::u8vec4(255));
    scene_.materials[0].baseColor = vec4(1.0f);
  }
  tellWhatIsLeftOut();
}

void ObjReader::readStatement(std::string_view keyword, std::string_view line) {
  if (keyword == "v") {
    readPosition(line);
  } else if (keyword == "f" || keyword == "fo") {
    readFace(line);
  } else if (keyword == "vn") {
    readNormal(line);
  } else if (keyword == "vt") {
    readTexCoord(line);
  } else if (keyword == Statements::kPolypaint) {
    readPolypaint(line);
  } else if (options_.geometryOnly) {
    return;
  } else if (keyword == "usemtl") {
    useMaterial(line);
  } else if (keyword == "o") {
    objectsNamed_ = true;
    beginObject(line);
  } else if (keyword == "g" && !objectsNamed_) {
    beginObject(line);
  } else if (keyword == "s") {
    readSmoothing(line);
  } else if (keyword == "mtllib") {
    readLibraries(line);
  } else if (keyword == "l" || keyword == "p") {
    ++linesAndPoints_;
  } else if (keyword == "surf" || keyword == "curv" || keyword == "curv2") {
    ++freeForms_;
  } else if (!kUnseen.contains(keyword) && keyword.front() >= 'a' && keyword.front() <= 'z') {
    leftOut_.add(keyword);
  }
}

double ObjReader::number(std::string_view word) {
  double value = 0.0;
  if (parseNumber(word, value)) return value;
  if (word.empty()) {
    replace("a number is missing; not-a-number is used");
  } else {
    replace("'{}' is not a number; not-a-number is used", word.substr(0, 40));
  }
  return std::nan("");
}

void ObjReader::readPosition(std::string_view line) {
  dvec3 p;
  for (int i = 0; i < 3; ++i) p[i] = number(nextWord(line));
  if (positions_.size() >= 0x7fffffffu) {
    fail(ExitCode::kInput, "{}: too many vertices", input_.where());
  }
  positions_.push_back(frame_.toLocal(p));
  std::array<float, 4> extra{};
  std::size_t count = 0;
  for (std::string_view w = nextWord(line); !w.empty() && count < 4; w = nextWord(line)) {
    extra[count++] = static_cast<float>(number(w));
  }
  if (count < 3) return;  // none, or a weight
  const std::size_t first = count == 4;
  addColor({extra[first], extra[first + 1], extra[first + 2]});
}

/// Of the last vertex, from 0 to 1 or, in a file of scanners' programs, to 255.
void ObjReader::addColor(const vec3& color) {
  if (colors_.empty()) firstColor_ = positions_.size() - 1;
  const auto packed = [](const vec3& c) {
    const vec3 in = glm::clamp(c, vec3(0.0f), vec3(1.0f));
    return packVertexColor({decodeSrgb(in.x), decodeSrgb(in.y), decodeSrgb(in.z), 1.0f});
  };
  // Vertices before the first coloured one are white.
  colors_.fill(positions_.size() - 1, glm::u8vec4(255));
  if (colorRange_ == 1.0f && maxComponent(color) >= 2.0f) {
    colorRange_ = 255.0f;
    scene_.warnings.push_back(where() + ": colours of vertices are taken as of 0 to 255");
    for (std::size_t i = firstColor_; i < colors_.size(); ++i) {
      const vec3 c(unpackVertexColor(colors_[i]));
      colors_[i] = packed(vec3(encodeSrgb(c.x), encodeSrgb(c.y), encodeSrgb(c.z)) / colorRange_);
    }
  }
  colors_.push_back(packed(color / colorRange_));
}

/// ZBrush's comments of colours: for each vertex eight digits of mask, red, green and blue.
void ObjReader::readPolypaint(std::string_view line) {
  constexpr std::size_t kDigits = 8;
  for (; line.size() >= kDigits; line.remove_prefix(kDigits)) {
    std::uint32_t value = 0;
    const char* end = line.data() + kDigits;
    if (std::from_chars(line.data(), end, value, 16).ptr != end) break;
    if (painted_ >= positions_.size()) break;
    const auto channel = [&](int shift) {
      return decodeSrgb(static_cast<float>(value >> shift & 255u) / 255.0f);
    };
    colors_.fill(painted_ + 1, glm::u8vec4(255));
    colors_[painted_++] = packVertexColor({channel(16), channel(8), channel(0), 1.0f});
  }
  if (!line.empty()) replace("colours that are of no vertex or no colours are left out");
}

void ObjReader::readNormal(std::string_view line) {
  vec3 n;
  for (int i = 0; i < 3; ++i) n[i] = static_cast<float>(number(nextWord(line)));
  normals_.push_back(n);
}

void ObjReader::readTexCoord(std::string_view line) {
  const float u = static_cast<float>(number(nextWord(line)));
  const std::string_view second = nextWord(line);
  const float v = second.empty() ? 0.0f : static_cast<float>(number(second));
  texCoords_.push_back(vec2(u, 1.0f - v));
}

void ObjReader::beginObject(std::string_view name) {
  scene_.objects.push_back(name.empty() ? fmt::format("object {}", scene_.objects.size())
                                        : utf8Of(name));
  object_ = static_cast<int>(scene_.objects.size()) - 1;
}

/// "off" and 0 are flat. Groups are positive; what is no number smooths too, with its like.
void ObjReader::readSmoothing(std::string_view line) {
  std::int64_t group = 1;
  parseInteger(line, group);
  smoothing_ = line == "off" || line.empty() || group <= 0 || group > 0x7fffffff
                   ? 0
                   : static_cast<std::int32_t>(group);
}

bool ObjReader::readLibrary(std::string_view name) {
  const auto [known, isNew] = libraries_.try_emplace(std::string(name), false);
  if (!isNew) return known->second;  // some exporters name it again for each object
  std::error_code error;
  const std::filesystem::path file = findFile(path_.parent_path(), std::string(name));
  if (!std::filesystem::is_regular_file(file, error)) return false;
  known->second = true;
  try {
    readMtl(file, path_.parent_path(), options_, scene_, materialNames_);
  } catch (const Error& e) {
    if (e.code() != ExitCode::kInput) throw;
    replace("{}; the rest of that file is left out", e.what());
  }
  return true;
}

/// Several names are allowed, and so are blanks in a name.
void ObjReader::readLibraries(std::string_view line) {
  if (readLibrary(line)) return;
  line = withoutComment(line);
  if (readLibrary(line)) return;
  std::filesystem::path renamed = path_.filename();
  renamed.replace_extension(".mtl");
  for (std::string_view name = nextWord(line); !name.empty(); name = nextWord(line)) {
    if (readLibrary(name) || !missingLibraries_.insert(std::string(name)).second) continue;
    const std::string missing = (path_.parent_path() / std::string(name)).string();
    if (readLibrary(renamed.string())) {
      replace("no material file {}; {} is used", missing, renamed.string());
    } else {
      replace("no material file {}; grey is used", missing);
    }
  }
}

void ObjReader::useMaterial(std::string_view written) {
  auto found = materialNames_.find(std::string(written));
  if (found == materialNames_.end()) {
    found = materialNames_.find(std::string(withoutComment(written)));
  }
  material_ = found == materialNames_.end() ? 0 : found->second;
  if (found == materialNames_.end() && materialNames_.emplace(written, 0).second) {
    replace("material '{}' is not defined; grey is used", utf8Of(written.substr(0, 200)));
  }
}

/// One of "v", "v/t", "v//n", "v/t/n"; from 1, or backwards from the last if negative. Those that
/// have not come yet are taken as they are. Returns what is wrong, or nothing.
std::string ObjReader::readCorner(std::string_view word, ObjCorner& corner) const {
  const std::array<std::size_t, 3> sizes = {positions_.size(), texCoords_.size(), normals_.size()};
  corner = {-1, -1, -1};
  std::string_view left = word;
  for (std::size_t i = 0; i < 3; ++i) {
    const std::size_t slash = left.find('/');
    const std::string_view part = left.substr(0, slash);
    if (!part.empty() || i == 0) {
      std::int64_t value = 0;
      if (!parseInteger(part, value)) break;
      const std::int64_t size = static_cast<std::int64_t>(sizes[i]);
      const std::int64_t zeroBased = value > 0 ? value - 1 : size + value;
      if (value == 0 || zeroBased < 0 || zeroBased > 0x7ffffffe) {
        return outOfRange(i, value, sizes[i]);
      }
      corner[i] = static_cast<std::int32_t>(zeroBased);
    }
    if (slash == left.npos) return {};
    left.remove_prefix(slash + 1);
  }
  return fmt::format("'{}' is not a corner of a face", word.substr(0, 40));
}

bool ObjReader::known(const ObjCorner& c) const {
  return c[0] < static_cast<std::int64_t>(positions_.size()) &&
         c[1] < static_cast<std::int64_t>(texCoords_.size()) &&
         c[2] < static_cast<std::int64_t>(normals_.size());
}

void ObjReader::readFace(std::string_view line) {
  facesSeen_ = true;
  corners_.clear();
  bool allKnown = true;
  for (std::string_view w = nextWord(line); !w.empty(); w = nextWord(line)) {
    const std::string problem = readCorner(w, corners_.emplace_back());
    if (!problem.empty()) return replace("{}; the face is left out", problem);
    allKnown = allKnown && known(corners_.back());
  }
  if (object_ == kNone) beginObject(path_.stem().string());
  if (corners_.size() < 3) {
    ++smallFaces_;
  } else if (allKnown) {
    addFace(object_, material_, smoothing_);
  } else {
    waiting_.push_back({object_, material_, smoothing_, input_.lineNumber(), waitingCorners_.size(),
                        corners_.size()});
    for (const ObjCorner& c : corners_) waitingCorners_.push_back(c);
  }
}

void ObjReader::addWaitingFaces() {
  for (std::size_t i = 0; i < waiting_.size(); ++i) {
    const WaitingFace& face = waiting_[i];
    const ObjCorner* first = &waitingCorners_[face.firstCorner];
    corners_.assign(first, first + face.corners);
    if (checkWaiting(face)) addFace(face.object, face.material, face.smoothing);
  }
}

/// What never came: without a vertex there is no face, texture coordinates and normals may lack.
bool ObjReader::checkWaiting(const WaitingFace& face) {
  const auto tell = [&](std::size_t kind, std::int32_t value, std::size_t size,
                        const char* instead) {
    scene_.replaced.add(fmt::format("{}:{}: {}; {}", input_.file(), face.line,
                                    outOfRange(kind, std::int64_t{value} + 1, size), instead));
  };
  for (ObjCorner& c : corners_) {
    if (c[0] >= static_cast<std::int64_t>(positions_.size())) {
      tell(0, c[0], positions_.size(), "the face is left out");
      return false;
    }
    if (c[1] >= static_cast<std::int64_t>(texCoords_.size())) {
      tell(1, c[1], texCoords_.size(), "0 is used");
      c[1] = -1;
    }
    if (c[2] >= static_cast<std::int64_t>(normals_.size())) {
      tell(2, c[2], normals_.size(), "the face's own is used");
      c[2] = -1;
    }
  }
  return true;
}

std::span<const glm::uvec3> ObjReader::cutFace() {
  points_.clear();
  for (const ObjCorner& c : corners_) points_.push_back(dvec3(positions_[c[0]]));
  const auto triangles = cutter_.cut(points_);
  crossedFaces_ += cutter_.failed();
  return triangles;
}

/// The face of `corners_`.
void ObjReader::addFace(int object, int material, std::int32_t smoothing) {
  const auto lacks = [](const ObjCorner& c) { return c[2] == -1; };
  const bool flat = smoothing == 0 && std::all_of(corners_.begin(), corners_.end(), lacks);
  const std::span<const glm::uvec3> triangles = cutFace();
  if (!flat && std::any_of(corners_.begin(), corners_.end(), lacks)) {
    makeNormals(smoothing, triangles);
  }
  take({object, material, !flat}, corners_, triangles);
}

/// Corners without a normal share one with those of the same vertex and smoothing group, weighted
/// by area; without a group the face's own.
void ObjReader::makeNormals(std::int32_t smoothing, std::span<const glm::uvec3> triangles) {
  dvec3 face(0.0);
  for (const glm::uvec3& t : triangles) {
    face += glm::cross(points_[t.y] - points_[t.x], points_[t.z] - points_[t.x]);
  }
  if (smoothing == 0) smoothing = --ownNormals_;
  for (ObjCorner& c : corners_) {
    if (c[2] != -1) continue;
    const std::uint32_t number = smoothVertices_.indexOf({c[0], smoothing});
    if (number == madeNormals_.size()) madeNormals_.push_back(dvec3(0.0));
    madeNormals_[number] += face;
    c[2] = -2 - static_cast<std::int32_t>(number);
  }
}

vec3 ObjReader::normalOf(const ObjCorner& c) const {
  if (c[2] >= 0) return normals_[c[2]];
  const dvec3& made = madeNormals_[static_cast<std::size_t>(-2 - c[2])];
  const double length = glm::length(made);
  return length > 0.0 && std::isfinite(length) ? vec3(made / length) : vec3(0.0f, 1.0f, 0.0f);
}

Mesh ObjReader::meshOf(const ObjGroup& group, const std::vector<ObjCorner>& corners,
                       std::vector<glm::uvec3> triangles, bool texCoords) {
  Mesh mesh;
  mesh.origin = frame_.origin();
  mesh.triangles = std::move(triangles);
  mesh.positions.reserve(corners.size());
  for (const ObjCorner& c : corners) {
    mesh.positions.push_back(positions_[c[0]]);
    if (texCoords) mesh.texCoords.push_back(texCoordOf(c));
    if (group.normals) mesh.normals.push_back(normalOf(c));
    if (!colors_.empty()) mesh.colors.push_back(colors_[c[0]]);
  }
  sanitiseMesh(scene_, mesh, fmt::format("{}: object '{}'", file(), scene_.objects[group.object]));
  return mesh;
}

void ObjReader::addMesh(const ObjGroup& group, Mesh mesh) {
  mesh.name = scene_.objects[group.object];
  mesh.material = group.material;
  Instance instance;
  instance.name = mesh.name;
  instance.mesh = static_cast<int>(scene_.meshes.size());
  instance.object = group.object;
  scene_.meshes.push_back(std::move(mesh));
  scene_.instances.push_back(std::move(instance));
}

void ObjReader::tellWhatIsLeftOut() {
  const auto tell = [&](std::uint64_t count, const char* what) {
    if (count == 0) return;
    scene_.replaced.add(fmt::format("{}: {} {}", file(), count, what), count);
  };
  tell(linesAndPoints_, "lines and points are left out");
  tell(freeForms_, "free-form curves and surfaces are left out");
  tell(smallFaces_, "faces with fewer than 3 corners are left out");
  tell(crossedFaces_, "faces cross themselves; fans of triangles are used");
  if (linesAndPoints_ + freeForms_ == 0 && !facesSeen_) {
    tellPoints(scene_, file(), positions_.size(), "make a surface of them first");
  }
  leftOut_.tell(scene_, file());
}

}  // namespace trex::detail
