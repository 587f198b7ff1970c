// Generated models: names, counts, bounds, closed surfaces, and equal bits each time.
#include "src/scene/synth.h"

#include <gtest/gtest.h>

#include <array>
#include <map>
#include <set>

#include "src/core/error.h"
#include "src/scene/import.h"

namespace trex {
namespace {

const char* const kModels[] = {"terrain", "scan", "assembly"};

std::string nameOf(const char* model, const char* parameters) {
  return std::string("synth:") + model + parameters;
}

ExitCode codeOf(const std::string& name) {
  try {
    parseSynthName(name);
  } catch (const Error& e) {
    EXPECT_NE(std::string(e.what()).find("synth:"), std::string::npos) << e.what();
    return e.code();
  }
  return ExitCode::kDone;
}

std::vector<vec3> positionsOf(const TriangleStream& stream) {
  std::vector<vec3> out;
  TriangleBatch batch;
  for (std::uint64_t i = 0; i < stream.batchCount(); ++i) {
    stream.batch(i, batch);
    EXPECT_LE(batch.triangles(), TriangleStream::kBatchTriangles);
    std::size_t inRuns = 0;
    for (const TriangleBatch::Run& run : batch.runs) {
      inRuns += run.triangles;
      EXPECT_LT(run.material, stream.scene().materials.size());
      EXPECT_LT(run.object, stream.scene().objects.size());
    }
    EXPECT_EQ(inRuns, batch.triangles());
    out.insert(out.end(), batch.positions.begin(), batch.positions.end());
  }
  return out;
}

TEST(Synth, NamesAreRead) {
  const SynthRequest r = parseSynthName("synth:assembly?triangles=2.5e6&seed=7");
  EXPECT_EQ(r.kind, SynthRequest::Kind::kAssembly);
  EXPECT_EQ(r.triangles, 2'500'000u);
  EXPECT_EQ(r.seed, 7u);
  EXPECT_EQ(parseSynthName("synth:scan").seed, 1u);
  EXPECT_EQ(parseSynthName("synth:terrain?triangles=1e10").triangles, 10'000'000'000u);
}

TEST(Synth, BadNamesAreUsageErrors) {
  for (const char* name :
       {"synth:", "synth:cube", "synth:scan?", "synth:scan?triangles",
        "synth:scan?triangles=", "synth:scan?triangles=0", "synth:scan?triangles=-5",
        "synth:scan?triangles=1e13", "synth:scan?triangles=1.5", "synth:scan?triangles=nan",
        "synth:scan?triangles=12x", "synth:scan?seed=-1", "synth:scan?seed=1e3",
        "synth:scan?sides=3", "synth:scan?seed=99999999999999999999"}) {
    const bool harmless = std::string(name) == "synth:scan?";  // no parameter at all
    EXPECT_EQ(codeOf(name), harmless ? ExitCode::kDone : ExitCode::kUsage) << name;
  }
}

TEST(Synth, CountsAreClose) {
  for (const char* model : kModels) {
    for (const char* count : {"1e5", "1e6", "1e9", "1e10"}) {
      const auto stream = openSynth(nameOf(model, "?triangles=") + count);
      const double asked = std::stod(count), made = static_cast<double>(stream->triangleCount());
      EXPECT_NEAR(made / asked, 1.0, 0.06) << model << " " << count;
    }
    EXPECT_GE(openSynth(nameOf(model, "?triangles=1"))->triangleCount(), 1u);
  }
}

TEST(Synth, TrianglesLieInTheBoundsAndAreAsManyAsStated) {
  for (const char* model : kModels) {
    for (const char* parameters : {"?triangles=1", "?triangles=3e4&seed=5", "?triangles=2e5"}) {
      const auto stream = openSynth(nameOf(model, parameters));
      const std::vector<vec3> p = positionsOf(*stream);
      EXPECT_EQ(p.size(), 3 * stream->triangleCount()) << model << parameters;
      const Box3d box = stream->bounds();
      for (const vec3& v : p) {
        ASSERT_TRUE(isFinite(v));
        ASSERT_TRUE(glm::all(glm::lessThanEqual(box.lower, dvec3(v))) &&
                    glm::all(glm::lessThanEqual(dvec3(v), box.upper)))
            << model << parameters << " " << v.x << "," << v.y << "," << v.z;
      }
    }
  }
}

TEST(Synth, PartsThatReachFarAreInTheBounds) {
  const auto stream = openSynth("synth:assembly?triangles=4e6&seed=3");
  const Box3d box = stream->bounds();
  TriangleBatch batch;
  Box3d all;
  for (std::uint64_t i = 0; i < stream->batchCount(); ++i) {
    stream->batch(i, batch);
    for (const vec3& v : batch.positions) all.extend(dvec3(v));
  }
  EXPECT_TRUE(glm::all(glm::lessThanEqual(box.lower, all.lower)));
  EXPECT_TRUE(glm::all(glm::lessThanEqual(all.upper, box.upper)));
}

TEST(Synth, EqualBitsEachTimeOtherSeedsOtherTriangles) {
  for (const char* model : kModels) {
    const auto a = openSynth(nameOf(model, "?triangles=2e4&seed=3"));
    const auto b = openSynth(nameOf(model, "?triangles=2e4&seed=3"));
    const auto c = openSynth(nameOf(model, "?triangles=2e4&seed=4"));
    EXPECT_EQ(positionsOf(*a), positionsOf(*b));
    EXPECT_NE(positionsOf(*a), positionsOf(*c));
    EXPECT_NE(a->key(), c->key());
  }
}

using Point = std::array<float, 3>;

/// Edges by direction: how often each is used.
std::map<std::pair<Point, Point>, int> edgesOf(const std::vector<vec3>& p) {
  std::map<std::pair<Point, Point>, int> edges;
  for (std::size_t t = 0; t < p.size(); t += 3) {
    for (std::size_t k = 0; k < 3; ++k) {
      const vec3 &a = p[t + k], &b = p[t + (k + 1) % 3];
      ++edges[{{a.x, a.y, a.z}, {b.x, b.y, b.z}}];
    }
  }
  return edges;
}

TEST(Synth, TheScanIsClosedAndFacesOutwards) {
  for (const char* parameters : {"?triangles=12", "?triangles=2e5"}) {
    const std::vector<vec3> p = positionsOf(*openSynth(nameOf("scan", parameters)));
    double volume = 0.0;
    for (std::size_t t = 0; t < p.size(); t += 3) {
      volume += glm::dot(dvec3(p[t]), glm::cross(dvec3(p[t + 1]), dvec3(p[t + 2]))) / 6.0;
    }
    EXPECT_GT(volume, 1.0);
    const auto edges = edgesOf(p);
    for (const auto& [edge, count] : edges) {
      const auto back = edges.find({edge.second, edge.first});
      ASSERT_TRUE(back != edges.end() && back->second == count);
    }
  }
}

TEST(Synth, NoTriangleComesTwice) {
  for (const char* model : kModels) {
    const std::vector<vec3> p = positionsOf(*openSynth(nameOf(model, "?triangles=1e5")));
    std::set<std::array<float, 9>> seen;
    for (std::size_t t = 0; t < p.size(); t += 3) {
      const std::array<float, 9> key = {p[t].x,     p[t].y,     p[t].z,     p[t + 1].x, p[t + 1].y,
                                        p[t + 1].z, p[t + 2].x, p[t + 2].y, p[t + 2].z};
      ASSERT_TRUE(seen.insert(key).second) << model << " triangle " << t / 3;
    }
  }
}

TEST(Synth, AScenesLightCameraAndPanels) {
  for (const char* model : kModels) {
    const Scene scene = importScene(nameOf(model, "?triangles=3e4"));
    EXPECT_TRUE(hasLight(scene)) << model;
    EXPECT_FALSE(scene.cameras.empty()) << model;
    EXPECT_EQ(scene.triangleCount(), openSynth(nameOf(model, "?triangles=3e4"))->triangleCount());
  }
  const auto stream = openSynth("synth:assembly?triangles=1e9");
  std::size_t emitting = 0;
  std::set<std::string> kinds;
  for (const Instance& i : stream->scene().instances) {
    const Mesh& mesh = stream->scene().meshes[static_cast<std::size_t>(i.mesh)];
    const bool emits = stream->scene().materials[static_cast<std::size_t>(mesh.material)].emits();
    EXPECT_EQ(emits, !mesh.triangles.empty());
    emitting += mesh.triangles.size();
  }
  for (const std::string& object : stream->scene().objects) {
    kinds.insert(object.substr(0, object.find(' ')));
  }
  EXPECT_EQ(emitting, 32u);
  EXPECT_GT(stream->scene().objects.size(), 5000u);
  EXPECT_EQ(kinds.size(), 7u);
}

TEST(Synth, TooManyForMemoryAreRefused) {
  try {
    importScene("synth:scan?triangles=1e9");
    FAIL();
  } catch (const Error& e) {
    EXPECT_EQ(e.code(), ExitCode::kMemoryOrDevice);
  }
}

}  // namespace
}  // namespace trex
