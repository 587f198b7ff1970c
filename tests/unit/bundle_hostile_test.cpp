// Bundles as they should not be: every flipped bit is noticed, every wrong field is an error.
#include <gtest/gtest.h>

#include <cstring>
#include <limits>
#include <nlohmann/json.hpp>
#include <random>

#include "src/bundle/layout.h"
#include "src/core/error.h"
#include "tests/unit/bundle_scene.h"

namespace trex {
namespace {

using bundle::Container;
using nlohmann::json;
using test::littleFacts;
using test::littleModel;
using Buffer = std::vector<std::byte>;

const Buffer& bundleOf(int depth) {
  static const Buffer with = bundleBytes(littleModel(3), littleFacts(3));
  static const Buffer without = bundleBytes(littleModel(0), littleFacts(0));
  return depth > 0 ? with : without;
}

/// The message of the error that reading ends in; empty if there is none.
std::string problem(const Buffer& bytes) {
  try {
    test::readBuffer(bytes);
  } catch (const Error& e) {
    EXPECT_EQ(e.code(), ExitCode::kInput) << e.what();
    EXPECT_EQ(std::string(e.what()).find('\n'), std::string::npos);
    return e.what();
  }
  return "";
}

bool verifies(const Buffer& bytes) {
  try {
    Container(bytes, "x.trex").verify();
    return true;
  } catch (const Error&) {
    return false;
  }
}

/// The bundle with some sections replaced (empty: left out) or added; all checksums are right.
Buffer repacked(const std::map<std::string, std::optional<Buffer>>& changes, int depth = 0) {
  const Container container(bundleOf(depth), "x.trex");
  std::vector<bundle::SectionData> sections;
  auto rest = changes;
  for (const bundle::Section& s : container.sections()) {
    const auto changed = changes.find(s.name);
    rest.erase(s.name);
    if (changed == changes.end()) sections.push_back({s.name, container.section(s.name)});
    if (changed != changes.end() && changed->second) sections.push_back({s.name, *changed->second});
  }
  for (const auto& [name, bytes] : rest) sections.push_back({name, *bytes});
  Buffer out;
  bundle::writeContainer(sections, [&](std::span<const std::byte> bytes) {
    out.insert(out.end(), bytes.begin(), bytes.end());
  });
  EXPECT_TRUE(verifies(out));
  return out;
}

Buffer bufferOf(const std::string& text) {
  const auto bytes = std::as_bytes(std::span(text));
  return {bytes.begin(), bytes.end()};
}

std::string sceneText(int depth = 0) {
  const Container container(bundleOf(depth), "x.trex");
  const auto bytes = container.section("scene.json");
  return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

TEST(BundleHostile, TenThousandFlippedBitsAreNoticed) {
  Buffer bytes = bundleOf(3);
  ASSERT_TRUE(verifies(bytes));
  std::mt19937_64 random(1);
  for (int i = 0; i < 10'000; ++i) {
    const std::size_t at = random() % bytes.size();
    const auto bit = static_cast<std::byte>(1u << (random() % 8));
    bytes[at] ^= bit;
    ASSERT_FALSE(verifies(bytes)) << "byte " << at;
    bytes[at] ^= bit;
  }
  EXPECT_TRUE(verifies(bytes));
}

TEST(BundleHostile, FlippedBitsOfTablesAreNoticed) {
  Buffer bytes = bundleOf(0);
  bundle::Header header;
  std::memcpy(&header, bytes.data(), sizeof(header));
  for (std::size_t at = 0; at < bytes.size(); ++at) {
    if (at == 64) at = sizeof(header) - 8;
    if (at == sizeof(header)) at = header.directoryOffset;
    bytes[at] ^= std::byte{0x10};
    ASSERT_FALSE(verifies(bytes)) << "byte " << at;
    bytes[at] ^= std::byte{0x10};
  }
}

TEST(BundleHostile, OpeningNoticesFlippedBits) {
  Buffer bytes = bundleOf(3);
  ASSERT_EQ(problem(bytes), "");
  std::mt19937_64 random(2);
  for (int i = 0; i < 500; ++i) {
    const std::size_t at = random() % bytes.size();
    bytes[at] ^= std::byte{4};
    ASSERT_NE(problem(bytes), "") << "byte " << at;
    bytes[at] ^= std::byte{4};
  }
}

TEST(BundleHostile, DamageIsNamedBySection) {
  Buffer bytes = bundleBytes(littleModel(6), littleFacts(6));
  const Container container(bytes, "x.trex");
  for (const bundle::Section& s : container.sections()) {
    if (s.bytes < 3 * bundle::kPageBytes) continue;
    const std::uint64_t middle = s.offset + s.bytes / 2;
    bytes[middle] ^= std::byte{1};
    const std::string what = problem(bytes);
    EXPECT_NE(what.find("section " + s.name), std::string::npos) << what;
    bytes[middle] ^= std::byte{1};
    return;
  }
  FAIL() << "no section is large enough";
}

TEST(BundleHostile, WrongLengths) {
  const Buffer& good = bundleOf(0);
  EXPECT_NE(problem({}).find("not a trex bundle"), std::string::npos);
  for (const std::size_t size : {std::size_t{7}, std::size_t{8}, std::size_t{4095},
                                 std::size_t{4096}, good.size() / 2, good.size() - 1}) {
    const Buffer cut(good.begin(), good.begin() + static_cast<std::ptrdiff_t>(size));
    const char* says = size < 8 ? "not a trex bundle" : "truncated";
    EXPECT_NE(problem(cut).find(says), std::string::npos) << size;
  }
  Buffer longer = good;
  longer.push_back(std::byte{0});
  EXPECT_NE(problem(longer).find("follows its end"), std::string::npos);
}

/// Changes the header but not its checksum.
template <typename Change>
Buffer withHeader(Change change) {
  Buffer bytes = bundleOf(0);
  bundle::Header header;
  std::memcpy(&header, bytes.data(), sizeof(header));
  change(header);
  std::memcpy(bytes.data(), &header, sizeof(header));
  return bytes;
}

TEST(BundleHostile, WrongMagicAndVersion) {
  EXPECT_NE(problem(withHeader([](auto& h) { h.magic[0] = 'X'; })).find("not a trex bundle"),
            std::string::npos);
  const std::string version = problem(withHeader([](auto& h) { h.version = 1; }));
  EXPECT_NE(version.find("version 1, this program reads 2; bake again"), std::string::npos);
  EXPECT_NE(problem(withHeader([](auto& h) { h.byteOrder = 0x04030201u; })).find("byte order"),
            std::string::npos);
}

TEST(BundleHostile, SectionsOfAllSizes) {
  for (const std::size_t size : {0, 1, 4095, 4096, 4097, 65535, 65536, 65537, 200'000}) {
    const Buffer first(size, std::byte{0x5a}), second(3, std::byte{1});
    const std::vector<bundle::SectionData> sections = {{"first", first}, {"second", second}};
    Buffer out;
    bundle::writeContainer(sections, [&](std::span<const std::byte> bytes) {
      out.insert(out.end(), bytes.begin(), bytes.end());
    });
    ASSERT_EQ(out.size(), bundle::containerBytes(sections));
    const Container container(out, "x.trex");
    container.verify();
    EXPECT_EQ(container.pagesChecked(), container.pageCount());
    const auto got = container.section("first");
    EXPECT_TRUE(std::equal(got.begin(), got.end(), first.begin(), first.end()));
    EXPECT_EQ(container.section("second").size(), 3u);
    EXPECT_THROW(container.section("third"), Error);
  }
}

TEST(BundleHostile, NamesOfSectionsAreChecked) {
  for (const char* name : {"Upper", "a/b", "scene.json"}) {
    const Buffer empty;
    const std::vector<bundle::SectionData> sections = {{"scene.json", empty}, {name, empty}};
    Buffer out;
    bundle::writeContainer(sections, [&](std::span<const std::byte> bytes) {
      out.insert(out.end(), bytes.begin(), bytes.end());
    });
    EXPECT_THROW(Container(out, "x.trex"), Error) << name;
  }
}

struct Mutation {
  const char* pointer;
  json value;  ///< discarded: the key is removed
};

/// Each must be an error that names its place.
std::vector<Mutation> mutations() {
  const json none = json::value_t::discarded;
  return {{"/trex", 2},
          {"/trex", "1"},
          {"/extra", 1},
          {"/cameras", json::array()},
          {"/cameras", none},
          {"/cameras/0/forward", {0, 0, 0}},
          {"/cameras/0/up", {0, 0, 1}},
          {"/cameras/0/up", {0, 1}},
          {"/cameras/0/vertical_fov_radians", 0},
          {"/cameras/0/vertical_fov_radians", 3.2},
          {"/cameras/0/fstop", 0},
          {"/environment/rotation", 1e5},
          {"/cameras/0/name", 5},
          {"/cameras/0/zoom", 5},
          {"/materials", json::array()},
          {"/materials/0/metallic", -0.1},
          {"/materials/0/metallic", nullptr},
          {"/materials/0/roughness", 1.5},
          {"/materials/0/emission", {-1, 0, 0}},
          {"/materials/0/emission", {1e39, 0, 0}},
          {"/materials/0/ior", 0.5},
          {"/materials/0/alpha_mode", "maybe"},
          {"/materials/0/unlit", 1},
          {"/materials/2/base_color_texture/image", 2},
          {"/materials/2/base_color_texture/image", -1},
          {"/materials/2/base_color_texture/wrap_s", "fold"},
          {"/materials/2/base_color_texture/offset", {0, 0, 0}},
          {"/materials/2/base_color_texture/more", 0},
          {"/meshes/0/material", 4},
          {"/meshes/1/emitter", none},
          {"/meshes/1/emitter/positions", 4294967295u},
          {"/meshes/0/emitter", {{"positions", 0}, {"triangles", 0}}},
          {"/meshes/0/same_geometry_as", 0},
          {"/meshes/0/origin", {0, 0, "x"}},
          {"/instances/0/mesh", 3},
          {"/instances/0/mesh", 0.5},
          {"/instances/0/object", 6},
          {"/instances/0/transform/3", 1},
          {"/instances/0/transform", {1, 2, 3}},
          {"/placements/0/instance", 5},
          {"/placements/0/hccmesh", 1},
          {"/shared_meshes", 1'000'000'000},
          {"/shared_meshes", -1},
          {"/images/0/width", 0},
          {"/images/0/width", 100'000},
          {"/images/0/channels", 5},
          {"/images/0/format", "f64"},
          {"/environment/color", {-1, 0, 0}},
          {"/environment/map/channels", 4},
          {"/environment/map/format", "u8"},
          {"/lights/0/type", "area"},
          {"/lights/0/direction", {0, 0, -2}},
          {"/lights/0/intensity", {0, -1, 0}},
          {"/lights/0/inner_cone_angle_radians", 3},
          {"/lights/0/outer_cone_angle_radians", 4},
          {"/render_origin", {0, 0}},
          {"/objects/0", 7},
          {"/warnings", "none"},
          {"/sources/0/xxh3", "0123"},
          {"/sources/0/xxh3", "0123456789abcdeg"},
          {"/sources/0/bytes", -1},
          {"/requirements/0/required", "yes"},
          {"/precision_bits", 25},
          {"/voxel_depth", 33},
          {"/dropped_triangles", 1.5}};
}

TEST(BundleHostile, WrongFieldsOfTheSceneNameTheirPlace) {
  const json scene = json::parse(sceneText());
  ASSERT_EQ(problem(repacked({{"scene.json", bufferOf(scene.dump())}})), "");
  for (const Mutation& m : mutations()) {
    json changed = scene;
    const json::json_pointer at(m.pointer);
    if (m.value.is_discarded()) {
      changed[at.parent_pointer()].erase(at.back());
    } else {
      changed[at] = m.value;
    }
    const std::string what = problem(repacked({{"scene.json", bufferOf(changed.dump())}}));
    // An element of an array of numbers is named by its array.
    const std::string place = std::isdigit(at.back()[0]) && !scene[at].is_object()
                                  ? at.parent_pointer().to_string()
                                  : at.to_string();
    const bool size = std::string(m.pointer).find("emitter/") != std::string::npos;
    EXPECT_NE(what.find(size ? "emitter" : place), std::string::npos)
        << m.pointer << " = " << m.value << ": '" << what << "'";
  }
}

TEST(BundleHostile, TextsThatAreNoScene) {
  const std::string good = sceneText();
  const std::string deep = std::string(200'000, '[');
  std::string infinite = good, overflow = good;
  const std::size_t at = good.find("\"roughness\":1.0");
  ASSERT_NE(at, std::string::npos);
  infinite.replace(at, 15, "\"roughness\":Infinity");
  overflow.replace(at, 15, "\"roughness\":1e999");
  for (const std::string& text :
       {std::string(), std::string("{}"), std::string("[]"), std::string("{\"trex\":1}"),
        good.substr(0, good.size() / 2), good + "x", deep, infinite, overflow,
        std::string("\xff\xfe{}"), std::string(4096, '\0')}) {
    EXPECT_NE(problem(repacked({{"scene.json", bufferOf(text)}})), "") << text.substr(0, 40);
  }
}

TEST(BundleHostile, ChangedTextsAreReadOrRefused) {
  const std::string good = sceneText(), alphabet = "0123456789-+.eE{}[]\",:ntfx ";
  std::mt19937 random(3);
  int read = 0;
  for (int i = 0; i < 3000; ++i) {
    std::string text = good;
    for (unsigned k = 0; k < 1 + random() % 3; ++k) {
      text[random() % text.size()] = alphabet[random() % alphabet.size()];
    }
    try {
      const Buffer bytes = repacked({{"scene.json", bufferOf(text)}});
      BundleContents contents = test::readBuffer(bytes);
      ++read;
      const RayScene rays(contents.description.scene, std::move(contents.parts));
    } catch (const Error&) {
    }
  }
  EXPECT_GT(read, 100);
  EXPECT_LT(read, 2900);
}

TEST(BundleHostile, ArraysThatDoNotFitTheScene) {
  const Container container(bundleOf(0), "x.trex");
  const auto copy = [&](const char* name) {
    const auto bytes = container.section(name);
    return Buffer(bytes.begin(), bytes.end());
  };
  const auto refused = [](const char* name, const Buffer& bytes) {
    EXPECT_NE(problem(repacked({{name, bytes}})).find(name), std::string::npos) << name;
  };
  Buffer emitters = copy("emitters.bin");
  refused("emitters.bin", {});
  emitters.resize(emitters.size() - 12);
  refused("emitters.bin", emitters);
  emitters.resize(emitters.size() + 24);
  refused("emitters.bin", emitters);
  emitters = copy("emitters.bin");
  const std::uint32_t beyond = 8;
  std::memcpy(emitters.data() + emitters.size() - 4, &beyond, 4);
  refused("emitters.bin", emitters);
  emitters = copy("emitters.bin");
  const float nan = std::numeric_limits<float>::quiet_NaN();
  std::memcpy(emitters.data(), &nan, 4);
  refused("emitters.bin", emitters);
  Buffer image = copy("image-0.tiles");
  refused("image-0.tiles", copy("image-1.tiles"));
  refused("image-0.tiles", {});
  image.resize(image.size() - 1);
  refused("image-0.tiles", image);
  refused("environment.zst", copy("image-1.tiles"));
  Buffer mesh = copy("world.hccm");
  mesh.resize(mesh.size() - 1);
  refused("world.hccm", mesh);
  refused("mesh-0.hccm", Buffer(200));
}

TEST(BundleHostile, MeshesWithMaterialsThatAreNotThere) {
  const Mesh cube = test::box(vec3(0.0f), vec3(1.0f), 0, false);
  hccm::Part part;
  part.positions = cube.positions;
  part.triangles = cube.triangles;
  part.material = 4;
  const hccm::Mesh mesh = hccm::Mesh::build({&part, 1});
  const auto bytes = mesh.bytes();
  const std::string what = problem(repacked({{"world.hccm", Buffer(bytes.begin(), bytes.end())}}));
  EXPECT_NE(what.find("material 4 does not exist; there are 4"), std::string::npos) << what;
}

TEST(BundleHostile, SectionsMissingOrTooMany) {
  EXPECT_NE(problem(repacked({{"world.hccm", std::nullopt}})), "");
  EXPECT_NE(problem(repacked({{"scene.json", std::nullopt}})), "");
  EXPECT_NE(problem(repacked({{"image-1.tiles", std::nullopt}})), "");
  EXPECT_NE(problem(repacked({{"more", Buffer(5)}})), "");
  EXPECT_NE(problem(repacked({{"voxels.asvo", Buffer(5)}}, 3)), "");
}

TEST(BundleHostile, ImagesBeyondTheLimitAreRefusedBeforeTheyAreMade) {
  BundleReadOptions options;
  options.maxImageBytes = 1000;
  try {
    readBundle(bundleOf(0), nullptr, "x.trex", options);
    FAIL();
  } catch (const Error& e) {
    EXPECT_EQ(e.code(), ExitCode::kMemoryOrDevice);
  }
}

}  // namespace
}  // namespace trex
