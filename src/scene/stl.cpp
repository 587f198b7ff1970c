// STL (3D Systems, 1989): triangles without shared vertices, as text or binary.
#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>

#include "src/scene/corner_table.h"
#include "src/scene/import_detail.h"
#include "src/scene/statements.h"
#include "src/scene/stl_file.h"

namespace trex::detail {
namespace {

class StlReader {
 public:
  explicit StlReader(const std::filesystem::path& path)
      : input_(path), name_(path.stem().string()), kind_(kindOfStl(path)) {}

  Scene read() {
    if (kind_.binary) {
      readBinary();
    } else {
      readText();
    }
    return finish();
  }

 private:
  void readBinary() {
    for (std::size_t left = kStlHeader; left > 0;) {
      const std::size_t part = std::min<std::size_t>(left, 64);
      input_.take(part);
      left -= part;
    }
    if (kind_.triangles > kMaxElements) fail(ExitCode::kInput, "{}: too large", input_.name());
    mesh_.triangles.reserve(kind_.triangles);
    std::uint64_t attributed = 0;
    for (std::uint64_t i = 0; i < kind_.triangles; ++i) {
      std::array<float, 9> corners;
      const auto* facet = input_.take(kStlTriangle);
      std::memcpy(corners.data(), facet + 12, sizeof(corners));
      attributed += hasAttributes(facet);
      for (int k = 0; k < 3; ++k) {
        add({corners[3 * k], corners[3 * k + 1], corners[3 * k + 2]});
      }
      endFacet();
    }
    tellAttributes(scene_, input_.name(), attributed);
    if (kind_.said != kind_.triangles) {
      scene_.replaced.add(
          fmt::format("{}: its header says {} triangles, it has room for {}; those are shown",
                      input_.name(), kind_.said, kind_.triangles));
    }
  }

  /// "facet", "outer loop", "vertex x y z", "endloop", "endfacet"; only vertices and ends count.
  void readText() {
    std::string_view line;
    bool first = true;
    while (input_.readLine(line)) {
      const std::string_view keyword = nextWord(line);
      if (first && !keyword.empty() && !isWord(keyword, "solid")) {
        fail(ExitCode::kInput, "{}: neither text nor binary STL (its size does not fit its count)",
             input_.name());
      }
      first = first && keyword.empty();
      if (isWord(keyword, "vertex")) {
        readVertex(line);
      } else if (isWord(keyword, "endloop") || isWord(keyword, "endfacet")) {
        endFacet();
      }
    }
    endFacet();
    const auto tell = [&](std::uint64_t count, const char* what) {
      if (count == 0) return;
      scene_.replaced.add(fmt::format("{}: {} {}", input_.name(), count, what), count);
    };
    tell(badNumbers_, "vertices have words that are no numbers; not-a-number is used");
    tell(cutFacets_, "facets have fewer than 3 vertices and are left out");
  }

  static bool isWord(std::string_view word, std::string_view wanted) {
    return std::equal(word.begin(), word.end(), wanted.begin(), wanted.end(), [](char a, char b) {
      return (a >= 'A' && a <= 'Z' ? a - 'A' + 'a' : a) == b;
    });
  }

  void readVertex(std::string_view line) {
    dvec3 p;
    bool good = true;
    for (int k = 0; k < 3; ++k) {
      if (parseNumber(nextWord(line), p[k])) continue;
      p[k] = std::nan("");
      good = false;
    }
    badNumbers_ += !good;
    add(frame_.toLocal(p));
  }

  /// Corners that are alike share a vertex.
  void add(vec3 p) {
    p += 0.0f;  // -0 becomes 0
    const std::uint32_t index =
        table_.indexOf({std::bit_cast<std::int32_t>(p.x), std::bit_cast<std::int32_t>(p.y),
                        std::bit_cast<std::int32_t>(p.z)});
    if (index == mesh_.positions.size()) mesh_.positions.push_back(p);
    if (index >= kMaxElements) fail(ExitCode::kInput, "{}: too many vertices", input_.name());
    facet_.push_back(index);
  }

  void endFacet() {
    for (std::size_t k = 2; k < facet_.size(); ++k) {
      if (mesh_.triangles.size() >= kMaxElements) {
        fail(ExitCode::kInput, "{}: too many triangles", input_.name());
      }
      mesh_.triangles.push_back({facet_[0], facet_[k - 1], facet_[k]});
    }
    cutFacets_ += !facet_.empty() && facet_.size() < 3;
    facet_.clear();
  }

  Scene finish() {
    table_ = {};
    scene_.materials.push_back(defaultMaterial());
    scene_.objects.push_back(name_);
    mesh_.name = name_;
    mesh_.origin = frame_.origin();
    sanitiseMesh(scene_, mesh_, input_.name());
    scene_.meshes.push_back(std::move(mesh_));
    scene_.instances.emplace_back().name = name_;
    return std::move(scene_);
  }

  InputFile input_;
  std::string name_;
  StlKind kind_;
  Scene scene_;
  Mesh mesh_;
  CornerTable<3> table_;
  LocalFrame frame_;
  std::vector<std::uint32_t> facet_;
  std::uint64_t badNumbers_ = 0, cutFacets_ = 0;
};

}  // namespace

StlKind kindOfStl(const std::filesystem::path& path) {
  InputFile input(path);
  const std::uint64_t size = input.remaining();
  StlKind kind;
  if (size < kStlHeader) return kind;
  std::array<std::uint8_t, kStlHeader> head;
  for (std::size_t at = 0; at < head.size();) {
    const std::size_t part = std::min<std::size_t>(head.size() - at, 64);
    std::memcpy(head.data() + at, input.take(part), part);
    at += part;
  }
  std::uint32_t said = 0;
  std::memcpy(&said, head.data() + 80, sizeof(said));
  const std::uint64_t room = (size - kStlHeader) / kStlTriangle;
  // Binary files begin with "solid" too now and then; text has no zero bytes.
  const bool exact = size == kStlHeader + kStlTriangle * std::uint64_t{said};
  const bool text = std::find(head.begin(), head.end(), 0) == head.end();
  if (!exact && text) return kind;
  kind.binary = true;
  kind.said = said;
  kind.triangles = said < room ? said : room;
  if (said == 0) kind.triangles = room;
  return kind;
}

void tellAttributes(Scene& scene, const std::string& file, std::uint64_t facets) {
  if (facets == 0) return;
  scene.warnings.push_back(
      fmt::format("{}: attributes of {} facets are not shown (some programs keep colours there)",
                  file, facets));
}

Scene readStl(const std::filesystem::path& path, const ImportOptions& options) {
  Scene scene = StlReader(path).read();
  noteNoUnit(scene, "STL", path, options);
  return scene;
}

}  // namespace trex::detail
