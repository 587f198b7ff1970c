// Streams of files hold the triangles of their import.
#include <algorithm>
#include <array>

#include "src/scene/triangle_stream.h"
#include "tests/unit/scene_helpers.h"

namespace trex::test {
namespace {

/// A corner with all that it has, rounded to what the two ways may differ by.
using Corner = std::vector<long>;
using Triangle = std::array<Corner, 3>;

class SceneStreams : public SceneTest {
 protected:
  static std::vector<Triangle> trianglesOf(const TriangleStream& stream) {
    std::vector<Triangle> out;
    TriangleBatch batch;
    for (std::uint64_t b = 0; b < stream.batchCount(); ++b) {
      stream.batch(b, batch);
      std::size_t at = 0;
      for (const TriangleBatch::Run& run : batch.runs) {
        for (std::size_t t = 0; t < run.triangles; ++t) {
          Triangle& made = out.emplace_back();
          bool finite = true;
          for (Corner& corner : made) {
            finite = finite && isFinite(batch.positions[at]);
            corner = cornerOf(batch, at++, run);
          }
          if (!finite) out.pop_back();
        }
      }
    }
    std::sort(out.begin(), out.end());
    return out;
  }

  static Corner cornerOf(const TriangleBatch& batch, std::size_t at,
                         const TriangleBatch::Run& run) {
    Corner c = {static_cast<long>(run.material), static_cast<long>(run.object)};
    const auto add = [&](double value) { c.push_back(std::lround(value * 4096.0)); };
    const dvec3 p = batch.origin + dvec3(batch.positions[at]);
    if (!isFinite(vec3(p))) return c;
    for (int k = 0; k < 3; ++k) add(p[k]);
    for (int k = 0; k < 3 && !batch.normals.empty(); ++k) {
      add(glm::normalize(batch.normals[at])[k]);
    }
    for (int k = 0; k < 2 && !batch.texCoords.empty(); ++k) add(batch.texCoords[at][k]);
    for (int k = 0; k < 4 && !batch.colors.empty(); ++k) c.push_back(batch.colors[at][k]);
    return c;
  }

  /// The stream of a file, compared with that of its import.
  std::unique_ptr<TriangleStream> expectSame(const std::filesystem::path& path,
                                             ImportOptions options = {}) {
    options.scratch = folder_;
    std::unique_ptr<TriangleStream> stream = openTriangleStream(path, options);
    const std::unique_ptr<TriangleStream> whole = streamOf(importScene(path, options));
    EXPECT_EQ(trianglesOf(*stream), trianglesOf(*whole)) << path;
    EXPECT_EQ(stream->scene().objects, whole->scene().objects);
    EXPECT_EQ(stream->scene().materials.size(), whole->scene().materials.size());
    expectSameNotes(stream->scene(), whole->scene());
    const Box3d a = stream->bounds(), b = whole->bounds();
    EXPECT_LT(glm::length(a.lower - b.lower) + glm::length(a.upper - b.upper),
              1e-4 * glm::length(b.upper - b.lower));
    EXPECT_EQ(entries(), 0u) << "temporary files are left";
    return stream;
  }
  /// What is left out is said by both, but for what a stream finds only when it is read.
  static void expectSameNotes(const Scene& stream, const Scene& whole) {
    for (const std::string& text : whole.replaced.texts) {
      const bool late = text.find("non-finite") != text.npos ||
                        text.find("unusable normals") != text.npos ||
                        text.find("cross themselves") != text.npos;
      EXPECT_TRUE(late || anyReplaced(stream, text.substr(0, text.find(" to vert")))) << text;
    }
  }
  /// Of hidden files.
  std::size_t entries() const {
    std::size_t count = 0;
    for (const auto& entry : std::filesystem::directory_iterator(folder_)) {
      count += entry.path().filename().string().front() == '.';
    }
    return count;
  }
};

TEST_F(SceneStreams, ObjOfEveryKindOfFace) {
  write("t.png", tinyPng());
  write("m.mtl",
        "newmtl wood\nKd 1 1 1\nmap_Kd t.png\nnewmtl lamp\nKd 0 0 0\nKe 2 2 2\nnewmtl red\nKd 1 0 "
        "0\n");
  const std::string text =
      "mtllib m.mtl\no first\nv 1000000 0 0\nv 1000001 0 0\nv 1000001 1 0\nv 1000000 1 0.5\n"
      "vt 0 0\nvt 1 0\nvt 1 1\nvn 0 0 1\nvn 0 0 0\n"
      "usemtl wood\nf 1/1 2/2 3/3\nf 1 3 4\nf 1//1 2//1 3//2\n"
      "usemtl red\ns 1\nf 1 2 3 4\nf -4 -3 -2\ns off\nf 4 3 2\n"
      "o second\nusemtl lamp\nf 1 2 3\nf 5 6 7\nusemtl wood\nf 1/1 2/2 3/9\n"
      "v 1000002 0 1\nv 1000003 0 1\nv 1000002 nan 1\nv 1000003 2 1\n"
      "f 5 6 8\nf 1 2\nf 1 2 99\nl 1 2\nusemtl none\nf 1 2 5 6 8\n";
  const auto stream = expectSame(write("m.obj", text));
  EXPECT_TRUE(stream->attributes().normals && stream->attributes().texCoords);
  EXPECT_EQ(stream->residentBytes() < 10000, true);
  // The lamp is there as a mesh too.
  std::size_t lit = 0;
  for (const Mesh& m : stream->scene().meshes) lit += m.triangles.size();
  EXPECT_EQ(lit, 1u);
  expectSame(folder_ / "m.obj", {.unit = 0.01, .zUp = true});
}

TEST_F(SceneStreams, ObjWithColours) {
  expectSame(
      write("c.obj", "v 0 0 0\nv 1 0 0 1 0 0\nv 0 1 0 0 0.5 0\nv 1 1 1\nf 1 2 3\nf 2 4 3\n"));
}

TEST_F(SceneStreams, PlyOfText) {
  const std::string head =
      "ply\nformat ascii 1.0\ncomment c\nelement vertex 5\nproperty double x\nproperty double y\n"
      "property double z\nproperty float nx\nproperty float ny\nproperty float nz\n"
      "property uchar red\nproperty uchar green\nproperty uchar blue\nproperty float quality\n"
      "element face 5\nproperty uchar flags\nproperty list uchar int vertex_indices\nend_header\n";
  const std::string text = head +
                           "5000000.125 0 0 0 0 1 255 0 0 9\n5000001 0 0 0 0 1 0 255 0 9\n"
                           "5000001 1 0 0 0 0 1 2 3 9\n5000000 1 0 0 0 1 9 9 9 9\n"
                           "5000000 2 what 0 0 1 9 9 9 9\n"
                           "0 3 0 1 2\n0 4 0 1 2 3\n1 2 0 1\n0 3 0 1 7\n0 3 0 3 4\n";
  const auto stream = expectSame(write("t.ply", text));
  EXPECT_TRUE(stream->attributes().normals && stream->attributes().colors);
  expectSame(folder_ / "t.ply", {.unit = 0.5, .zUp = true});
}

TEST_F(SceneStreams, PlyCloudsOfPoints) {
  const std::string vertex =
      "element vertex 3\nproperty float x\nproperty float y\nproperty float z\n";
  const std::string colors =
      "property uchar red\nproperty uchar green\nproperty uchar blue\nproperty uchar alpha\n";
  const ImportOptions options{.unit = 0.5, .zUp = true, .pointSize = 0.5};
  // Text, octahedra; one of them nowhere.
  const auto text = expectSame(
      write("t.ply", "ply\nformat ascii 1.0\n" + vertex + colors +
                         "element camera 1\nproperty "
                         "float x\nend_header\n0 0 0 1 2 3 4\n1 2 3 5 6 7 8\nnan 0 0 9 9 9 9\n7\n"),
      options);
  EXPECT_EQ(text->triangleCount(), 3u * 8u);
  EXPECT_TRUE(text->attributes().colors && !text->attributes().normals);
  // Binary, which is mapped: squares.
  std::string bytes = "ply\nformat binary_little_endian 1.0\n" + vertex +
                      "property float nx\nproperty float ny\nproperty float nz\nend_header\n";
  bytes += bytesOf(std::vector<float>{0, 0, 0, 0, 0, 1, 4, 0, 0, 0.6f, 0.8f, 0, 0, 4, 0, 0, 0, 0});
  const auto mapped = expectSame(write("b.ply", bytes), options);
  EXPECT_EQ(mapped->triangleCount(), 3u * 2u);
  EXPECT_FALSE(mapped->attributes().normals);
  bytes.pop_back();
  EXPECT_THROW(openTriangleStream(write("cut.ply", bytes), options), Error);
  EXPECT_THROW(openTriangleStream(write("m.obj", "v 0 0 0\n"), options), Error);
}

TEST_F(SceneStreams, PlyOfTheOtherByteOrder) {
  std::string bytes =
      "ply\nformat binary_big_endian 1.0\nelement vertex 3\nproperty float x\nproperty float y\n"
      "property float z\nelement face 1\nproperty list int short vertex_index\nend_header\n";
  const auto big = [&](const void* value, std::size_t size) {
    for (std::size_t k = size; k-- > 0;) bytes.push_back(static_cast<const char*>(value)[k]);
  };
  for (const float f : {0.0f, 0.0f, 0.0f, 1.0f, 0.0f, 0.25f, 0.0f, 2.0f, 0.0f}) big(&f, 4);
  const std::int32_t corners = 3;
  big(&corners, 4);
  for (std::int16_t i = 0; i < 3; ++i) big(&i, 2);
  EXPECT_EQ(expectSame(write("b.ply", bytes))->triangleCount(), 1u);
  bytes.pop_back();
  EXPECT_THROW(openTriangleStream(write("cut.ply", bytes)), Error);
}

TEST_F(SceneStreams, AFolderWithoutRoomIsNamed) {
  const auto path = write("a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
  try {
    openTriangleStream(path, {.scratch = folder_ / "none"});
    ADD_FAILURE() << "was accepted";
  } catch (const Error& e) {
    EXPECT_EQ(e.code(), ExitCode::kOutput);
    EXPECT_NE(std::string(e.what()).find("none"), std::string::npos);
  }
}

}  // namespace
}  // namespace trex::test
