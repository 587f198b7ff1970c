// What the readers of Wavefront OBJ share: its statements and the faces that they make. One makes
// meshes of them (obj.cpp), the other streams them (obj_stream.cpp).
#pragma once

#include <compare>
#include <map>
#include <set>
#include <span>
#include <string>
#include <vector>

#include "src/scene/corner_table.h"
#include "src/scene/growing_array.h"
#include "src/scene/import_detail.h"
#include "src/scene/polygon.h"
#include "src/scene/statements.h"

namespace trex::detail {

/// Numbers of position, texture coordinate and normal; -1 where absent. Normals that are made of
/// those of faces are -2, -3, ...
using ObjCorner = CornerTable<3>::Corner;

/// What faces of one mesh have in common.
struct ObjGroup {
  int object = 0, material = 0;
  bool normals = false;
  auto operator<=>(const ObjGroup&) const = default;
};

class ObjReader {
 public:
  /// With a folder, vertices lie in files there (GrowingArray).
  ObjReader(const std::filesystem::path& path, const ImportOptions& options,
            const std::filesystem::path& folder = {});
  virtual ~ObjReader() = default;

 protected:
  /// Reads the file; take() is called with each face, last with those before their vertices.
  void readAll();
  virtual void take(const ObjGroup& group, std::span<const ObjCorner> corners,
                    std::span<const glm::uvec3> triangles) = 0;

  // After readAll().
  vec3 normalOf(const ObjCorner& corner) const;
  vec2 texCoordOf(const ObjCorner& c) const { return c[1] < 0 ? vec2(0.0f) : texCoords_[c[1]]; }
  /// A mesh of triangles of such corners; `texCoords`: any corner has them.
  Mesh meshOf(const ObjGroup& group, const std::vector<ObjCorner>& corners,
              std::vector<glm::uvec3> triangles, bool texCoords);
  /// Enters a mesh and its only instance into the scene.
  void addMesh(const ObjGroup& group, Mesh mesh);
  const std::string& file() const { return input_.file(); }
  std::string where() const { return input_.where(); }

  Scene scene_;
  LocalFrame frame_;
  GrowingArray<vec3> positions_, normals_;
  GrowingArray<vec2> texCoords_;
  GrowingArray<glm::u8vec4> colors_;  ///< as many as positions, or none
  GrowingArray<dvec3> madeNormals_;
  CornerTable<2> smoothVertices_;  ///< of vertices and smoothing groups

  const ImportOptions& options() const { return options_; }

 private:
  /// A face that uses vertices which have not come yet.
  struct WaitingFace {
    int object = 0, material = 0;
    std::int32_t smoothing = 0;
    std::uint64_t line = 0;
    std::size_t firstCorner = 0, corners = 0;
  };

  template <typename... Args>
  void replace(fmt::format_string<Args...> format, Args&&... args) {
    scene_.replaced.add(input_.where() + ": " + fmt::format(format, std::forward<Args>(args)...));
  }

  void readStatement(std::string_view keyword, std::string_view line);
  double number(std::string_view word);
  void readPosition(std::string_view line);
  void addColor(const vec3& color);
  void readPolypaint(std::string_view line);
  void readNormal(std::string_view line);
  void readTexCoord(std::string_view line);
  void beginObject(std::string_view name);
  void readSmoothing(std::string_view line);
  bool readLibrary(std::string_view name);
  void readLibraries(std::string_view line);
  void useMaterial(std::string_view written);
  std::string readCorner(std::string_view word, ObjCorner& corner) const;
  bool known(const ObjCorner& c) const;
  void readFace(std::string_view line);
  void addWaitingFaces();
  bool checkWaiting(const WaitingFace& face);
  std::span<const glm::uvec3> cutFace();
  void addFace(int object, int material, std::int32_t smoothing);
  void makeNormals(std::int32_t smoothing, std::span<const glm::uvec3> triangles);
  void tellWhatIsLeftOut();

  Statements input_;
  std::filesystem::path path_;
  const ImportOptions& options_;
  std::map<std::string, int> materialNames_;
  std::map<std::string, bool> libraries_;   ///< by name: whether there is one
  std::set<std::string> missingLibraries_;  ///< that were told
  int object_ = kNone, material_ = 0;
  std::int32_t smoothing_ = 0, ownNormals_ = 0;
  bool objectsNamed_ = false, facesSeen_ = false;
  std::size_t firstColor_ = 0, painted_ = 0;  ///< vertex of the first colour; those of ZBrush
  float colorRange_ = 1.0f;
  GrowingArray<WaitingFace> waiting_;
  GrowingArray<ObjCorner> waitingCorners_;
  // Of the face under way.
  std::vector<ObjCorner> corners_;
  std::vector<dvec3> points_;
  PolygonCutter cutter_;
  std::uint64_t linesAndPoints_ = 0, freeForms_ = 0, smallFaces_ = 0, crossedFaces_ = 0;
  LeftOut leftOut_;
};

}  // namespace trex::detail
