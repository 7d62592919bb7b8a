#include "spm/offline/import.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cstring>

#include "spm/offline/clean.hpp"
#include "spm/offline/generate.hpp"
#include "spm/offline/write_mesh.hpp"
#include "tests/support/mesh_zoo.hpp"
#include "tests/support/reference_mesh.hpp"
#include "tests/support/temporary_folder.hpp"

namespace tactus::spm::offline {
namespace {

using test_support::sorted_faces;
using test_support::write_bytes;
using ::testing::HasSubstr;

class Import : public ::testing::Test {
 protected:
  std::filesystem::path write_file(const std::string& name, const std::string& bytes) const {
    write_bytes(folder_.path() / name, bytes);
    return folder_.path() / name;
  }

  /// Returns the error message of the import, or an empty string if it succeeds.
  static std::string import_error(const std::filesystem::path& path) {
    try {
      static_cast<void>(import_mesh(path));
    } catch (const ModelError& e) {
      return e.what();
    }
    return {};
  }

  test_support::TemporaryFolder folder_;
};

struct MeshFile {
  std::string name, bytes;
  std::size_t faces;
};

template <class Value>
void append(std::string& bytes, Value value, bool big_endian = false) {
  std::array<char, sizeof value> raw;
  std::memcpy(raw.data(), &value, sizeof value);
  if (big_endian) std::reverse(raw.begin(), raw.end());
  bytes.append(raw.begin(), raw.end());
}

TEST_F(Import, BinaryFilesRestoreTheSameBits) {
  TriangleMesh mesh = generate(Shape::kOrgan, 3000);
  clean(mesh);
  for (const char* name : {"organ.ply", "organ.stl"}) {
    write_mesh(folder_.path() / name, mesh);
    TriangleMesh imported = import_mesh(folder_.path() / name);
    clean(imported);
    EXPECT_EQ(sorted_faces(imported.positions, imported.faces), sorted_faces(mesh.positions, mesh.faces)) << name;
  }
}

TEST_F(Import, AnObjFileRestoresTheFacesWithin100Nanometres) {
  TriangleMesh mesh = generate(Shape::kOrgan, 1000);
  write_mesh(folder_.path() / "organ.obj", mesh);
  TriangleMesh imported = import_mesh(folder_.path() / "organ.obj");
  clean(imported);
  ASSERT_EQ(imported.faces.size(), mesh.faces.size());
  for (std::size_t f = 0; f < mesh.faces.size(); ++f) {
    for (std::size_t k = 0; k < 3; ++k) {
      for (std::size_t axis = 0; axis < 3; ++axis) {
        ASSERT_NEAR(imported.positions[imported.faces[f][k]][axis], mesh.positions[mesh.faces[f][k]][axis], 1e-7);
      }
    }
  }
}

TEST_F(Import, TriangulatesPolygons) {
  const auto path = write_file("square.obj", "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n");
  EXPECT_EQ(import_mesh(path).faces.size(), 2u);
}

TEST_F(Import, TriangulatesAConcavePolygonWithoutLeavingItsOutline) {
  const TriangleMesh mesh =
      import_mesh(write_file("dent.obj", "v 0 0 0\nv 4 0 0\nv 4 4 0\nv 2 1 0\nv 0 4 0\nf 1 2 3 4 5\n"));
  ASSERT_EQ(mesh.faces.size(), 3u);
  double area = 0;
  for (const Triangle& f : mesh.faces) {
    const auto &a = mesh.positions[f[0]], &b = mesh.positions[f[1]], &c = mesh.positions[f[2]];
    const double doubled_area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
    EXPECT_GT(doubled_area, 0);
    area += doubled_area / 2;
  }
  EXPECT_DOUBLE_EQ(area, 10);
}

TEST_F(Import, ReadsAPlyFileWithPolygonsDoublesOtherElementsAndFacesBeforeVertices) {
  const TriangleMesh mesh =
      import_mesh(write_file("odd.ply",
                             "ply\r\nformat ascii 1.0\r\nelement face 3\r\n"
                             "property list uchar int vertex_index\r\nproperty uchar red\r\n"
                             "element edge 1\r\nproperty int vertex1\r\nproperty int vertex2\r\n"
                             "element vertex 5\r\nproperty double z\r\nproperty double x\r\n"
                             "property list uchar float weights\r\nproperty double y\r\n"
                             "end_header\r\n3 0 1 2 255\r\n4 0 2 3 4 255\r\n2 0 1 255\r\n0 1\r\n"
                             "1 0 0 0\r\n1 4 2 0.5 0.5 0\r\n1 4 1 0.5 4\r\n1 +2e0 0 1.0\r\n1 0 0 4"));
  const std::vector<std::array<float, 3>> positions{{0, 0, 1}, {4, 0, 1}, {4, 4, 1}, {2, 1, 1}, {0, 4, 1}};
  EXPECT_EQ(mesh.positions, positions);
  ASSERT_EQ(mesh.faces.size(), 3u);
  EXPECT_EQ(mesh.faces[0], (Triangle{0, 1, 2}));
}

// The files of all formats contain the same pyramid: a square base and four sides.
const std::vector<std::array<int, 3>> kPyramidCorners{{0, 0, 0}, {2, 0, 0}, {2, 2, 0}, {0, 2, 0}, {1, 1, 1}};
const std::vector<Triangle> kPyramidFaces{{0, 3, 2}, {0, 2, 1}, {0, 1, 4}, {1, 2, 4}, {2, 3, 4}, {3, 0, 4}};

std::vector<MeshFile> polygon_pyramids() {
  const std::string points = "0 0 0\n2 0 0\n2 2 0\n0 2 0\n1 1 1\n";
  const std::string polygons = "4 0 3 2 1\n3 0 1 4\n3 1 2 4\n3 2 3 4\n3 3 0 4\n";
  return {{"text.obj",
           "v 0 0 0\nv 2 0 0\nv 2 2 0\nv 0 2 0\nv 1 1 1\nf 1 4 3 2\nf 1 2 5\nf 2/1 3/1 5/1\n"
           "f -3 -2 -1\nf 4//1 1//1 5//1\nvt 0 0\nvn 0 0 1\n",
           6},
          {"text.ply",
           "ply\nformat ascii 1.0\nelement vertex 5\nproperty float x\nproperty float y\nproperty float z\n"
           "element face 5\nproperty list uchar int vertex_indices\nend_header\n" +
               points + polygons,
           6},
          {"text.off", "OFF\n5 5 0\n" + points + polygons, 6}};
}

std::vector<MeshFile> stl_pyramids() {
  std::string solid = "solid pyramid\n";
  std::string binary(80, ' ');
  append(binary, std::uint32_t{6});
  for (const Triangle& face : kPyramidFaces) {
    solid += "facet normal 0 0 0\nouter loop\n";
    for (int i = 0; i < 3; ++i) append(binary, 0.0f);
    for (const std::uint32_t v : face) {
      solid += "vertex";
      for (const int x : kPyramidCorners[v]) {
        solid += " " + std::to_string(x);
        append(binary, static_cast<float>(x));
      }
      solid += "\n";
    }
    solid += "endloop\nendfacet\n";
    append(binary, std::uint16_t{0});
  }
  return {{"text.stl", solid + "endsolid pyramid\n", 6}, {"binary.stl", binary, 6}};
}

/// Requires that the number of bytes is a multiple of 3.
std::string base64(const std::string& bytes) {
  const char* const digits = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string text;
  for (std::size_t i = 0; i < bytes.size(); i += 3) {
    std::uint32_t word = 0;
    for (std::size_t k = 0; k < 3; ++k) word = word << 8 | static_cast<std::uint8_t>(bytes[i + k]);
    for (int shift = 18; shift >= 0; shift -= 6) text += digits[word >> shift & 63];
  }
  return text;
}

std::vector<MeshFile> gltf_pyramids() {
  // The buffer contains the positions, the indices of all triangles, and the indices of a strip of the four sides.
  std::string buffer;
  for (const auto& corner : kPyramidCorners)
    for (const int x : corner) append(buffer, static_cast<float>(x));
  for (const Triangle& face : kPyramidFaces)
    for (const std::uint32_t v : face) append(buffer, static_cast<std::uint16_t>(v));
  for (const int v : {0, 1, 4, 2, 3, 0}) append(buffer, static_cast<std::uint16_t>(v));
  const auto gltf = [&](int accessor, int mode, const std::string& uri) {
    return R"({"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0]}],"nodes":[{"mesh":0}],
      "meshes":[{"primitives":[{"attributes":{"POSITION":0},"indices":)" +
           std::to_string(accessor) + R"(,"mode":)" + std::to_string(mode) + R"(}]}],
      "accessors":[{"bufferView":0,"componentType":5126,"count":5,"type":"VEC3","min":[0,0,0],"max":[2,2,1]},
        {"bufferView":1,"componentType":5123,"count":18,"type":"SCALAR"},
        {"bufferView":2,"componentType":5123,"count":6,"type":"SCALAR"}],
      "bufferViews":[{"buffer":0,"byteOffset":0,"byteLength":60},{"buffer":0,"byteOffset":60,"byteLength":36},
        {"buffer":0,"byteOffset":96,"byteLength":12}],"buffers":[{"byteLength":108)" +
           uri + "}]}";
  };
  const std::string embedded = R"(,"uri":"data:application/octet-stream;base64,)" + base64(buffer) + "\"";

  std::string json = gltf(1, 4, "");
  json.resize((json.size() + 3) / 4 * 4, ' ');
  std::string glb = "glTF";
  append(glb, std::uint32_t{2});
  append(glb, static_cast<std::uint32_t>(12 + 8 + json.size() + 8 + buffer.size()));
  append(glb, static_cast<std::uint32_t>(json.size()));
  glb += "JSON" + json;
  append(glb, static_cast<std::uint32_t>(buffer.size()));
  glb += std::string{"BIN\0", 4} + buffer;
  return {{"triangles.gltf", gltf(1, 4, embedded), 6}, {"strip.gltf", gltf(2, 5, embedded), 4}, {"binary.glb", glb, 6}};
}

TEST_F(Import, ReadsAllFacesOfEveryDocumentedFormat) {
  for (const auto& files : {polygon_pyramids(), stl_pyramids(), gltf_pyramids()}) {
    for (const MeshFile& expected : files) {
      TriangleMesh mesh;
      ASSERT_NO_THROW(mesh = import_mesh(write_file(expected.name, expected.bytes))) << expected.name;
      clean(mesh);
      EXPECT_EQ(mesh.positions.size(), 5u) << expected.name;
      EXPECT_EQ(mesh.faces.size(), expected.faces) << expected.name;
    }
  }
}

TEST_F(Import, AppliesNodeTransformsAndReversesTheFacesOfMirroredMeshes) {
  // The file shows one triangle twice: unchanged, and mirrored in x and moved by 10.
  const std::string gltf = R"({"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0,1]}],
    "nodes":[{"mesh":0},{"mesh":0,"scale":[-1,1,1],"translation":[10,0,0]}],
    "meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}],
    "accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3","min":[0,0,0],"max":[1,1,0]}],
    "bufferViews":[{"buffer":0,"byteLength":36}],
    "buffers":[{"byteLength":36,"uri":"data:application/octet-stream;base64,AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAA"}]})";
  TriangleMesh mesh = import_mesh(write_file("twice.gltf", gltf));
  ASSERT_EQ(mesh.faces.size(), 2u);
  const std::vector<std::array<float, 3>> expected{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {10, 0, 0}, {9, 0, 0}, {10, 1, 0}};
  EXPECT_EQ(mesh.positions, expected);
  EXPECT_EQ(mesh.faces[1], (Triangle{3, 5, 4}));
}

TEST_F(Import, RefusesAMissingFileAnEmptyFileAndAFolder) {
  EXPECT_THAT(import_error(folder_.path() / "missing.obj"), HasSubstr("missing.obj: no such file"));
  EXPECT_THAT(import_error(write_file("empty.ply", "")), HasSubstr("found 0 bytes"));
  EXPECT_THAT(import_error(folder_.path()), HasSubstr("no regular file"));
}

TEST_F(Import, RefusesAFileOfWhichAssimpLosesANode) {
  // For a RAW file of two groups, assimp 5.2 returns a root with a null child.
  EXPECT_THAT(import_error(write_file("groups.raw", "a\n0 0 0 1 0 0 0 1 0\nb\n0 0 1 1 0 1 0 1 1\n")),
              HasSubstr("groups.raw: found an empty node"));
}

TEST_F(Import, RefusesAFileThatIsNoModel) {
  EXPECT_THAT(import_error(write_file("letter.txt", "Dear reader,\n")),
              HasSubstr("letter.txt: cannot be read as a model"));
}

TEST_F(Import, RefusesPointsAndLinesAndReportsThatItExpectedASurface) {
  const std::string points =
      "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n"
      "property float z\nend_header\n0 0 0\n1 0 0\n0 1 0\n";
  EXPECT_THAT(import_error(write_file("cloud.ply", points)), HasSubstr("expected a surface of triangles"));
  EXPECT_THAT(import_error(write_file("wire.obj", "v 0 0 0\nv 1 0 0\nv 1 1 0\nl 1 2 3\n")),
              HasSubstr("expected a surface"));
}

TEST_F(Import, RefusesAWordOfOver1024CharactersWhereverItIsInAPlyFile) {
  const auto import_with_x = [&](std::size_t blanks, std::size_t length) {
    return import_error(write_file("long.ply",
                                   "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n"
                                   "property float z\nelement face 1\nproperty list uchar int vertex_indices\n"
                                   "end_header\n" +
                                       std::string(blanks, ' ') + "1." + std::string(length - 2, '0') +
                                       " 0 0\n0 0 0\n0 1 0\n3 0 1 2\n"));
  };
  for (const std::size_t blanks : {0u, 64'000u, 64'500u, 65'500u}) {  // the reader has a buffer of 65,536 bytes
    EXPECT_EQ(import_with_x(blanks, 1024), "") << blanks << " blanks";
    EXPECT_THAT(import_with_x(blanks, 1100), HasSubstr("at most 1024 characters")) << blanks << " blanks";
  }
}

TEST_F(Import, RefusesToWriteAnUnknownFormatOrIntoAMissingFolder) {
  const TriangleMesh mesh = generate(Shape::kSphere, 60);
  EXPECT_THROW(write_mesh(folder_.path() / "sphere.xyz", mesh), ModelError);
  EXPECT_THROW(write_mesh(folder_.path() / "no" / "sphere.ply", mesh), ModelError);
}

}  // namespace
}  // namespace tactus::spm::offline
