// trex export-vdb X.trex -o x.vdb: the voxels of a model as OpenVDB grids, to look at in other
// tools.
#include <fmt/format.h>

#include <filesystem>
#include <memory>

#include "src/app/app.h"
#include "src/bundle/bundle.h"
#include "src/core/error.h"
#include "src/core/file.h"
#include "src/paths/walk_tracer.h"
#include "src/session/light_pass.h"
#include "src/session/voxel_source.h"
#include "src/vdb/vdb.h"
#include "src/vdb/vdb_library.h"

namespace trex {
namespace {

namespace fs = std::filesystem;

struct ExportArguments {
  std::string input, output;
  std::uint64_t photons = 1u << 20;
  int depth = 8;
};

/// Light of the voxels in W/m^2 after some photons.
class Lit {
 public:
  Lit(const Model& model, std::uint64_t photons)
      : tree_(*model.voxels),
        lights_(model.scene, *model.rays),
        tracer_(makeCpuTracer(*model.voxels,
                              photonMaterials(model.scene.materials, model.scene.images))),
        cache_(*model.voxels),
        walks_(*model.rays),
        pass_(model.scene, walks_, lights_, *tracer_, cache_, 0u, true) {
    pass_.run(photons, [] { return true; });
  }
  /// Radiance that the brighter side of a voxel sends out, emission included.
  vec3 radiance(std::uint32_t voxel) const {
    const asvo::Tracer& t = cache_.tracer();
    vec3 best(0.0f);
    for (const bool front : {true, false}) {
      const asvo::uvec4& light = tracer_->light()[voxel];
      const vec3 arriving =
          t.asvoUnpackRgb9e5(front ? light.x : light.y) * static_cast<float>(pass_.scale());
      const vec3 sent = tree_.emission(voxel, front) + t.asvoAlbedo(voxel) * arriving * kInvPi;
      if (sent.x + sent.y + sent.z > best.x + best.y + best.z) best = sent;
    }
    return best;
  }

 private:
  const asvo::Tree& tree_;
  LightSet lights_;
  std::unique_ptr<GRayTracer> tracer_;
  LightCache cache_;
  WalkTracer walks_;
  LightPass pass_;
};

/// The largest of the six coverages.
float coverageOf(const asvo::Tracer& tracer, const asvo::uvec4& words) {
  std::uint32_t most = 0;
  for (std::uint32_t d = 0; d < 6; ++d) most = std::max(most, tracer.asvoCoverage(words, d));
  return static_cast<float>(most) / 63.0f;
}

void put(const vec3& v, float (&out)[3]) {
  for (int axis = 0; axis < 3; ++axis) out[axis] = v[axis];
}

/// All leaves below a node at a place of its level.
void collect(const asvo::Tree& tree, const asvo::Tracer& tracer, const Lit& lit, std::uint32_t node,
             const glm::ivec3& place, std::vector<TrexVdbVoxel>& out) {
  if (node >= tree.info.firstLeaf) {
    TrexVdbVoxel& voxel = out.emplace_back();
    for (int axis = 0; axis < 3; ++axis) voxel.place[axis] = place[axis];
    voxel.coverage = coverageOf(tracer, tree.voxels[node]);
    put(tracer.asvoAlbedo(node), voxel.albedo);
    put(tracer.asvoNormal(node), voxel.normal);
    put(lit.radiance(node), voxel.radiance);
    return;
  }
  std::uint32_t child = tree.nodes[node].x;
  for (int octant = 0; octant < 8; ++octant) {
    if ((tree.nodes[node].y >> octant & 1u) == 0) continue;
    const glm::ivec3 half(octant & 1, octant >> 1 & 1, octant >> 2);
    collect(tree, tracer, lit, child++, 2 * place + half, out);
  }
}

void exportVdb(const ExportArguments& a) {
  if (!a.output.ends_with(".vdb")) fail(ExitCode::kUsage, "-o {}: want a name in .vdb", a.output);
  checkWritable(a.output);
  const auto write = vdbFunction<TrexWriteVdb>(kTrexWriteVdb);
  OpenOptions options;
  options.model.voxelDepth = a.depth;
  const Model model = openModel(a.input, options);
  if (!model.voxels || model.voxels->info.leafCount == 0) {
    fail(ExitCode::kInput, "{}: has no voxels; bake it without --no-voxels", a.input);
  }
  const asvo::Tree& tree = *model.voxels;
  const Lit lit(model, a.photons);
  std::vector<TrexVdbVoxel> voxels;
  voxels.reserve(tree.leaves.size());
  collect(tree, asvo::Tracer(tree), lit, 0, glm::ivec3(0), voxels);
  const dvec3 lower =
      model.rays->renderOrigin() + dvec3(tree.info.lowerX, tree.info.lowerY, tree.info.lowerZ);
  const double edge = static_cast<double>(tree.info.size) / (1u << tree.info.depth);
  writeAtomically(a.output, [&](const fs::path& temporary) {
    const char* error = write(temporary.c_str(), voxels.data(), voxels.size(), edge, &lower.x);
    if (error != nullptr) fail(ExitCode::kOutput, "{}: can't be written: {}", a.output, error);
  });
  fmt::print("{}\n", a.output);
}

}  // namespace

void addExportVdbCommand(CLI::App& app) {
  auto a = std::make_shared<ExportArguments>();
  CLI::App* c = app.add_subcommand("export-vdb", "Write a model's voxels as OpenVDB grids");
  c->add_option("INPUT", a->input, "A bundle or a model")->required();
  c->add_option("-o,--output", a->output, "The grids (.vdb)")->required();
  c->add_option("--photons", a->photons, "Photons of the radiance grid")
      ->check(CLI::Range(std::uint64_t{1}, std::uint64_t{1} << 30))
      ->capture_default_str();
  c->add_option("--voxel-depth", a->depth, "Levels below the root, of a model without voxels")
      ->check(CLI::Range(1, 10))
      ->capture_default_str();
  c->callback([a] { exportVdb(*a); });
}

}  // namespace trex
