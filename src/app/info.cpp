// trex info FILE: what is in a bundle, a mesh, a tree of voxels, or a model.
#include <fmt/format.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <memory>
#include <nlohmann/json.hpp>

#include "asvo/medium.h"
#include "src/app/app.h"
#include "src/bundle/bundle.h"
#include "src/command/parse.h"
#include "src/core/error.h"
#include "src/core/memory.h"
#include "src/scene/synth.h"
#include "src/scene/texels.h"
#include "src/scene/texture_cache.h"

namespace trex {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;
using Bytes = std::span<const std::byte>;

Json list(const dvec3& v) { return {v.x, v.y, v.z}; }

Json describe(const hccm::Sizes& s) {
  return {{"headers_bytes", s.header + s.clusterTable + s.clusterHeaders},
          {"vertices_bytes", s.vertices},
          {"topology_bytes", s.topology},
          {"nodes_bytes", s.nodes},
          {"normals_bytes", s.normals},
          {"texture_coordinates_bytes", s.texCoords},
          {"colours_bytes", s.colors},
          {"padding_bytes", s.padding}};
}

Json describe(const hccm::Mesh& mesh) {
  vec3 lower, upper;
  mesh.bounds(lower, upper);
  return {{"triangles", mesh.triangleCount()},
          {"dropped_triangles", mesh.droppedTriangles()},
          {"clusters", mesh.clusterCount()},
          {"lower_metres", list(mesh.gridOrigin() + dvec3(lower))},
          {"upper_metres", list(mesh.gridOrigin() + dvec3(upper))},
          {"grid_step_metres", mesh.step()},
          {"error_bound_metres", mesh.errorBound()},
          {"hccmesh", describe(mesh.sizes())}};
}

Json describe(const asvo::Tree& tree) {
  Json levels = Json::array();
  for (std::size_t l = 0; l + 1 < tree.levelOffsets.size(); ++l) {
    levels.push_back(tree.levelOffsets[l + 1] - tree.levelOffsets[l]);
  }
  return {{"depth", tree.info.depth},
          {"edge_metres", std::ldexp(double{tree.info.size}, -static_cast<int>(tree.info.depth))},
          {"voxels", tree.info.nodeCount},
          {"leaves", tree.info.leafCount},
          {"voxels_by_level", levels},
          {"nodes_bytes", tree.nodes.size() * sizeof(tree.nodes[0])},
          {"voxels_bytes", tree.voxels.size() * sizeof(tree.voxels[0])},
          {"leaves_bytes", tree.leaves.size() * sizeof(tree.leaves[0])},
          {"emitters_bytes", tree.emitters.size() * sizeof(tree.emitters[0])}};
}

Json describe(const Medium& m) {
  const asvo::Medium& grid = *m.grid;
  const dvec3 size = dvec3(grid.size * asvo::Medium::kCells);
  Box3d box;
  for (int corner = 0; corner < 8; ++corner) {
    const dvec3 place = dvec3(grid.base) + size * dvec3(corner & 1, corner >> 1 & 1, corner >> 2);
    box.extend(dvec3(m.transform * glm::dvec4(place, 1.0)));
  }
  return {{"name", m.name},
          {"voxels", grid.voxels},
          {"bricks", grid.bricks.size()},
          {"bytes", grid.bytes()},
          {"shines", m.emits()},
          {"density", m.density},
          {"albedo", {m.albedo.x, m.albedo.y, m.albedo.z}},
          {"anisotropy", m.anisotropy},
          {"lower_metres", list(box.lower)},
          {"upper_metres", list(box.upper)}};
}

template <typename Items>
Json names(const Items& items) {
  Json out = Json::array();
  for (const auto& item : items) out.push_back(item.name);
  return out;
}

Json describe(const std::vector<bundle::Requirement>& requirements) {
  Json out = Json::array();
  for (const bundle::Requirement& r : requirements) {
    out.push_back({{"name", r.name},
                   {"required", r.required},
                   {"reason", r.reason},
                   {"saved_bytes", r.savedBytes}});
  }
  return out;
}

/// What a bundle and a model have in common.
void addScene(Json& out, const Scene& scene) {
  out["meshes"] = scene.meshes.size();
  out["instances"] = scene.instances.size();
  out["objects"] = scene.objects.size();
  out["materials"] = names(scene.materials);
  Json images = Json::array();
  for (const Image& i : scene.images) {
    images.push_back({{"name", i.name},
                      {"width", i.width},
                      {"height", i.height},
                      {"channels", i.channels},
                      {"format", bundle::kTexelKeys[static_cast<std::size_t>(texelKind(i))]}});
  }
  out["images"] = images;
  out["lights"] = names(scene.lights);
  out["cameras"] = names(scene.cameras);
  out["environment"] = !scene.environment.present() ? "none"
                       : scene.environment.map      ? scene.environment.map->name
                                                    : "constant";
  if (scene.maxBounces != Scene::kAnyBounces) out["max_bounces"] = scene.maxBounces;
  if (!scene.media.empty()) out["media"] = Json::array();
  for (const Medium& m : scene.media) out["media"].push_back(describe(m));
  out["dropped_triangles"] = scene.droppedTriangles;
  out["warnings"] = scene.warnings;
  out["replaced"] = scene.replaced.texts;
  out["replaced_parts"] = scene.replaced.count;
}

Json sourcesOf(const fs::path& path, const std::vector<bundle::BakedFile>& files) {
  Json out = Json::array();
  for (const bundle::BakedFile& f : files) {
    const SourceState state = compareSource(path, f);
    out.push_back({{"path", f.file.path},
                   {"bytes", f.file.bytes},
                   {"state", state == SourceState::kUnchanged ? "unchanged"
                             : state == SourceState::kChanged ? "changed"
                                                              : "absent"}});
  }
  return out;
}

void addMeshes(Json& out, const RayScene& rays) {
  const RayScene::Parts& parts = rays.parts();
  const RayScene::Statistics statistics = rays.statistics();
  hccm::Sizes sum = parts.world.sizes();
  double finest = parts.world.step(), coarsest = finest, error = parts.world.errorBound();
  if (parts.paged) {
    sum = parts.paged->table().sizes;
    finest = coarsest = parts.paged->step();
    error = parts.paged->errorBound();
  }
  for (const hccm::Mesh& mesh : parts.shared) {
    sum += mesh.sizes();
    finest = std::min(finest, mesh.step());
    coarsest = std::max(coarsest, mesh.step());
    error = std::max(error, mesh.errorBound());
  }
  out["triangles"] = statistics.triangles;
  out["unique_triangles"] = statistics.uniqueTriangles;
  out["clusters"] = statistics.clusters;
  out["shared_meshes"] = parts.shared.size();
  out["placements"] = parts.placed.size();
  const Box3f bounds = rays.bounds();
  if (!bounds.empty()) {
    out["lower_metres"] = list(parts.renderOrigin + dvec3(bounds.lower));
    out["upper_metres"] = list(parts.renderOrigin + dvec3(bounds.upper));
  }
  out["finest_grid_step_metres"] = finest;
  out["coarsest_grid_step_metres"] = coarsest;
  out["error_bound_metres"] = error;
  out["hccmesh"] = describe(sum);
  if (parts.paged) {
    const hccm::PageTable& table = parts.paged->table();
    out["mesh_pages"] = {{"pages", table.pages.size()},
                         {"groups", table.groups.size()},
                         {"memory_bytes", table.bytes()},
                         {"disk_bytes", table.packedBytes()},
                         {"largest_page_bytes", table.largestPage()},
                         {"table_bytes", table.toBytes().size()}};
  }
  out["top_level_bytes"] = statistics.topLevelBytes;
}

/// Loads every page, which checks its checksum and every cluster in it.
void verifyPages(const hccm::PagedMesh& mesh) {
  try {
    tbb::parallel_for(std::size_t{0}, mesh.table().pages.size(),
                      [&](std::size_t page) { mesh.page(static_cast<std::uint32_t>(page)); });
  } catch (const hccm::FormatError& e) {
    fail(ExitCode::kInput, "{}; bake again", e.what());
  }
}

Json describeBundle(const fs::path& path, const std::shared_ptr<const Bytes>& bytes, bool verify,
                    bool strict) {
  const bundle::Container container(*bytes, path.string());
  if (verify) container.verify();
  constexpr std::uint64_t kCache = 64 * (std::uint64_t{16} << 20);  // any 64 pages
  BundleReadOptions read;
  read.textures = std::make_shared<TextureCache>(kCache, 0, fs::temp_directory_path());
  BundleContents contents = readBundle(*bytes, bytes, path.string(), read);
  if (contents.pageTable) attachPages(contents, kCache);
  if (verify && contents.parts.paged) verifyPages(*contents.parts.paged);
  if (verify) {
    for (const Image& image : contents.description.scene.images) inMemory(image);
  }
  const bundle::Description d = std::move(contents.description);
  if (strict) refuseReplaced(d.scene);
  Json out = {{"kind", "bundle"},
              {"path", path.string()},
              {"bytes", bytes->size()},
              {"version", bundle::kVersion},
              {"baked_by", d.bakedBy},
              {"input", d.input},
              {"sources", sourcesOf(path, d.files)},
              {"checksums", verify ? "all good" : "good where read"},
              {"pages", container.pageCount()}};
  std::uint64_t textures = 0, scene = 0;
  for (const bundle::Section& s : container.sections()) {
    if (s.name.ends_with(".tiles") || s.name.ends_with(".zst")) textures += s.bytes;
    if (s.name == "scene.json") scene = s.bytes;
  }
  const RayScene rays(d.scene, std::move(contents.parts));
  addMeshes(out, rays);
  addScene(out, d.scene);
  out["scene_bytes"] = scene;
  out["texture_bytes"] = textures;
  if (contents.voxels) out["voxels"] = describe(*contents.voxels);
  out["precision_bits"] = d.precisionBits;
  out["requirements"] = describe(d.requirements);
  return out;
}

Json describeModel(const fs::path& path, const ImportOptions& options) {
  const Scene scene = importScene(path, options);
  const Box3d bounds = scene.bounds();
  Json sources = Json::array();
  for (const SourceFile& f : scene.files) {
    sources.push_back({{"path", f.path}, {"bytes", f.bytes}, {"state", "unchanged"}});
  }
  Json out = {{"kind", "model"},
              {"path", path.string()},
              {"sources", sources},
              {"triangles", scene.triangleCount()},
              {"unique_triangles", scene.uniqueTriangleCount()}};
  if (!bounds.empty()) {
    out["lower_metres"] = list(bounds.lower);
    out["upper_metres"] = list(bounds.upper);
  }
  addScene(out, scene);
  out["requirements"] = describe(bundle::requirementsOf(scene, true));
  return out;
}

/// Without making it.
Json describeSynth(const std::string& name) {
  const std::unique_ptr<TriangleStream> stream = openSynth(name);
  const Box3d bounds = stream->bounds();
  Json out = {{"kind", "model"},
              {"path", name},
              {"triangles", stream->triangleCount()},
              {"unique_triangles", stream->triangleCount()},
              {"lower_metres", list(bounds.lower)},
              {"upper_metres", list(bounds.upper)}};
  addScene(out, stream->scene());
  out["requirements"] = describe(bundle::requirementsOf(stream->scene(), true));
  return out;
}

bool startsWith(Bytes bytes, std::string_view magic) {
  return bytes.size() >= magic.size() && std::memcmp(bytes.data(), magic.data(), magic.size()) == 0;
}

Json describeFile(const fs::path& path, bool verify, const ImportOptions& options) {
  if (isSynthName(path.string())) return describeSynth(path.string());
  const std::shared_ptr<const Bytes> bytes = mapFile(path);
  if (bundle::hasBundleMagic(*bytes) || isBundlePath(path)) {
    return describeBundle(path, bytes, verify, options.strict);
  }
  Json out = {{"kind", "hccmesh"}, {"path", path.string()}, {"bytes", bytes->size()}};
  try {
    if (startsWith(*bytes, "HCCM")) {
      out.update(describe(hccm::Mesh::fromView(*bytes, bytes)));
      return out;
    }
    if (startsWith(*bytes, "ASVOtree")) {
      out["kind"] = "asvo";
      out["voxels"] = describe(asvo::Tree::fromBytes(*bytes));
      return out;
    }
  } catch (const hccm::FormatError& e) {
    fail(ExitCode::kInput, "{}: {}", path.string(), e.what());
  } catch (const asvo::FormatError& e) {
    fail(ExitCode::kInput, "{}: {}", path.string(), e.what());
  }
  return describeModel(path, options);
}

std::string sizeOf(const Json& bytes) { return formatBytes(bytes.get<std::uint64_t>()); }

std::string lengthOf(const Json& metres) { return fmt::format("{:.3g} m", metres.get<double>()); }

std::string quoted(const Json& list) {
  constexpr std::size_t kMost = 12;
  std::string out;
  for (std::size_t i = 0; i < std::min(kMost, list.size()); ++i) {
    out += fmt::format("{}'{}'", i > 0 ? ", " : "", list[i].get<std::string>());
  }
  return list.size() > kMost ? fmt::format("{} and {} more", out, list.size() - kMost) : out;
}

void line(const char* what, const std::string& text) {
  if (!text.empty()) fmt::print("{:<14} {}\n", what, text);
}

void printBytes(const Json& parts) {
  for (const auto& [key, value] : parts.items()) {
    std::string name = key.substr(0, key.rfind("_bytes"));
    std::replace(name.begin(), name.end(), '_', ' ');
    if (key.ends_with("_bytes")) fmt::print("  {:<20} {:>12}\n", name, sizeOf(value));
  }
}

void printBox(const Json& d) {
  if (!d.contains("lower_metres")) return;
  const Json &a = d["lower_metres"], &b = d["upper_metres"];
  line("bounds", fmt::format("{:.6g},{:.6g},{:.6g} to {:.6g},{:.6g},{:.6g} m", a[0].get<double>(),
                             a[1].get<double>(), a[2].get<double>(), b[0].get<double>(),
                             b[1].get<double>(), b[2].get<double>()));
}

void printScene(const Json& d) {
  line("meshes", fmt::format("{} in {} instances of {} objects", d["meshes"].dump(),
                             d["instances"].dump(), d["objects"].dump()));
  line("materials", fmt::format("{}: {}", d["materials"].size(), quoted(d["materials"])));
  for (const Json& i : d["images"]) {
    line("image",
         fmt::format("{}x{}x{} {} {}", i["width"].dump(), i["height"].dump(), i["channels"].dump(),
                     i["format"].get<std::string>(), i["name"].get<std::string>()));
  }
  line("lights", quoted(d["lights"]));
  line("cameras", quoted(d["cameras"]));
  line("environment", d["environment"].get<std::string>());
  if (d.contains("max_bounces")) line("bounces", "at most " + d["max_bounces"].dump());
  for (const Json& m : d.value("media", Json::array())) {
    line("medium",
         fmt::format("'{}', {} voxels, {}{}", m["name"].get<std::string>(), m["voxels"].dump(),
                     sizeOf(m["bytes"]), m["shines"].get<bool>() ? ", shines" : ""));
    printBox(m);
  }
  for (const Json& w : d["warnings"]) line("warning", w.get<std::string>());
  for (const Json& w : d["replaced"]) line("replaced", w.get<std::string>());
}

void printVoxels(const Json& v) {
  line("voxels", fmt::format("{}, {} of them leaves of {}, depth {}", v["voxels"].dump(),
                             v["leaves"].dump(), lengthOf(v["edge_metres"]), v["depth"].dump()));
  line("  by level", v["voxels_by_level"].dump());
  printBytes(v);
}

void printText(const Json& d) {
  const std::string kind = d["kind"];
  line(kind.c_str(), d["path"].get<std::string>() +
                         (d.contains("bytes") ? ", " + sizeOf(d["bytes"]) : std::string()));
  if (kind == "bundle") {
    line("baked", fmt::format("from {} by {}, version {}", d["input"].get<std::string>(),
                              d["baked_by"].get<std::string>(), d["version"].dump()));
    line("checksums",
         fmt::format("{} ({} pages)", d["checksums"].get<std::string>(), d["pages"].dump()));
  }
  if (d.contains("sources")) {
    for (const Json& s : d["sources"]) {
      line("source", fmt::format("{}, {}, {}", s["path"].get<std::string>(), sizeOf(s["bytes"]),
                                 s["state"].get<std::string>()));
    }
  }
  if (d.contains("unique_triangles")) {
    line("triangles",
         fmt::format("{} unique, {} placed", d["unique_triangles"].dump(), d["triangles"].dump()));
  } else if (d.contains("triangles")) {
    line("triangles", d["triangles"].dump());
  }
  printBox(d);
  if (d.contains("meshes")) printScene(d);
  if (d.contains("error_bound_metres")) {
    const Json& step =
        d.contains("grid_step_metres") ? d["grid_step_metres"] : d["coarsest_grid_step_metres"];
    line("grid", fmt::format("steps up to {}, vertices off by at most {}", lengthOf(step),
                             lengthOf(d["error_bound_metres"])));
  }
  if (d.contains("hccmesh")) {
    line("clusters", d["clusters"].dump());
    printBytes(d["hccmesh"]);
  }
  if (d.contains("mesh_pages")) {
    const Json& p = d["mesh_pages"];
    line("mesh pages", fmt::format("{} of {} groups, loaded as rays need them", p["pages"].dump(),
                                   p["groups"].dump()));
    printBytes(p);
  }
  if (kind == "bundle") printBytes(d);
  if (d.contains("voxels")) printVoxels(d["voxels"]);
  if (!d.contains("requirements")) return;
  for (const Json& r : d["requirements"]) {
    const auto bytes = r["saved_bytes"].get<std::uint64_t>();
    const bool required = r["required"].get<bool>();
    const std::string saved =
        bytes == 0 ? ""
                   : fmt::format(", saves {}{}", formatBytes(bytes), required ? " elsewhere" : "");
    line(required ? "requires" : "left out", fmt::format("{}: {}{}", r["name"].get<std::string>(),
                                                         r["reason"].get<std::string>(), saved));
  }
}

}  // namespace

void addInfoCommand(CLI::App& app) {
  struct Arguments {
    std::string file;
    bool verify = false, json = false;
    ImportOptions import;
  };
  auto a = std::make_shared<Arguments>();
  CLI::App* c = app.add_subcommand("info", "Tell what is in a file, and check it");
  c->add_option("FILE", a->file,
                "Bundle, .hccm, .asvo, or model: .gltf .glb .ply .obj .stl .xml .pbrt")
      ->required();
  c->add_flag("--verify", a->verify, "Check every byte of a bundle");
  addImportOptions(*c, a->import);
  c->add_flag("--json", a->json, "Print JSON on stdout");
  c->callback([a] {
    const Json out = describeFile(a->file, a->verify, a->import);
    if (a->json) {
      fmt::print("{}\n", out.dump(2, ' ', false, Json::error_handler_t::replace));
    } else {
      printText(out);
    }
  });
}

}  // namespace trex
