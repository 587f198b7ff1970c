// Shapes of pbrt as meshes and instances: objects are kept once, meshes of one file or of equal
// numbers too.
#pragma once

#include <unordered_map>

#include "src/scene/pbrt_materials.h"
#include "src/scene/pbrt_mesh.h"
#include "src/scene/pbrt_state.h"

namespace trex::detail {

/// What a medium does to light that crosses it: all that is shown of one is what it absorbs.
struct PbrtMedium {
  vec3 absorption{0.0f};  ///< 1/m
};

class PbrtShapes {
 public:
  PbrtShapes(PbrtContext& context, PbrtColors& colors, PbrtTextures& textures,
             PbrtMaterials& materials)
      : context_(context), colors_(colors), textures_(textures), materials_(materials) {}

  /// The directive Shape. False if the shape is not shown.
  bool add(const std::string& kind, const PbrtParameters& parameters, const PbrtState& state);

  /// Shapes that follow become parts of an object, until endObject().
  void beginObject(const std::string& name);
  void endObject() { object_ = nullptr; }
  bool inObject() const { return object_ != nullptr; }
  /// Places an object's shapes. Throws Error(kMemoryOrDevice) if there are too many.
  void instance(const std::string& name, const PbrtState& state);

  /// By name; what shapes hold inside.
  std::map<std::string, PbrtMedium> media;
  float lightScale = 1.0f;  ///< of all emission

 private:
  struct Part {
    int mesh;
    dmat4 transform;
  };
  /// Meshes of equal triangles, by material.
  struct Uses {
    int first = kNone;
    std::map<int, int> byMaterial;
  };

  std::optional<Mesh> make(const std::string& kind, const PbrtParameters& parameters,
                           const PbrtQuadric* quadric, const PbrtFaces& faces);
  bool surface(const PbrtParameters& parameters, const PbrtState& state, Material& material);
  void addEmission(const Mesh& shape, const PbrtState& state, const dmat4& toWorld,
                   Material& material);
  void addEmissionImage(const std::string& file, Material& material);
  int meshOf(std::optional<Mesh> made, Uses* uses, int material);
  void place(int mesh, const dmat4& toWorld, const std::string& name);
  bool placeable(const dmat4& toWorld);

  PbrtContext& context_;
  PbrtColors& colors_;
  PbrtTextures& textures_;
  PbrtMaterials& materials_;
  std::unordered_map<std::string, Uses> uses_;
  std::unordered_map<std::string, std::vector<Part>> objects_;
  std::vector<Part>* object_ = nullptr;  ///< the one that is being defined
};

}  // namespace trex::detail
