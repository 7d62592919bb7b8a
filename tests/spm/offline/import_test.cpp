#include "spm/offline/import.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "spm/offline/clean.hpp"
#include "spm/offline/generate.hpp"
#include "spm/offline/write_mesh.hpp"
#include "tests/support/mesh_zoo.hpp"
#include "tests/support/reference_mesh.hpp"
#include "tests/support/temporary_folder.hpp"

namespace tactus::spm::offline {
namespace {

using test_support::read_bytes;
using test_support::sorted_faces;
using test_support::write_bytes;
using ::testing::HasSubstr;

class Import : public ::testing::Test {
 protected:
  std::filesystem::path file(const std::string& name, const std::string& bytes) const {
    write_bytes(folder_.path() / name, bytes);
    return folder_.path() / name;
  }

  static std::string refusal(const std::filesystem::path& path) {
    try {
      static_cast<void>(import_mesh(path));
    } catch (const ModelError& e) {
      return e.what();
    }
    return {};
  }

  test_support::TemporaryFolder folder_;
};

TEST_F(Import, BinaryFilesGiveBackTheSameBits) {
  TriangleMesh mesh = generate(Shape::kOrgan, 3000);
  clean(mesh);
  for (const char* name : {"organ.ply", "organ.stl"}) {
    write_mesh(folder_.path() / name, mesh);
    TriangleMesh back = import_mesh(folder_.path() / name);
    clean(back);
    EXPECT_EQ(sorted_faces(back.positions, back.faces), sorted_faces(mesh.positions, mesh.faces)) << name;
  }
}

TEST_F(Import, AnObjGivesBackTheSameFacesToAMillionth) {
  TriangleMesh mesh = generate(Shape::kOrgan, 1000);
  write_mesh(folder_.path() / "organ.obj", mesh);
  TriangleMesh back = import_mesh(folder_.path() / "organ.obj");
  clean(back);
  ASSERT_EQ(back.faces.size(), mesh.faces.size());
  for (std::size_t f = 0; f < mesh.faces.size(); ++f) {
    for (std::size_t k = 0; k < 3; ++k) {
      for (std::size_t axis = 0; axis < 3; ++axis) {
        ASSERT_NEAR(back.positions[back.faces[f][k]][axis], mesh.positions[mesh.faces[f][k]][axis], 1e-7);
      }
    }
  }
}

TEST_F(Import, CutsPolygonsIntoTriangles) {
  const auto path = file("square.obj", "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n");
  EXPECT_EQ(import_mesh(path).faces.size(), 2u);
}

TEST_F(Import, CutsAPolygonWithADentInsideOfIt) {
  const TriangleMesh mesh = import_mesh(file("dent.obj", "v 0 0 0\nv 4 0 0\nv 4 4 0\nv 2 1 0\nv 0 4 0\nf 1 2 3 4 5\n"));
  ASSERT_EQ(mesh.faces.size(), 3u);
  double area = 0;
  for (const Triangle& f : mesh.faces) {
    const auto &a = mesh.positions[f[0]], &b = mesh.positions[f[1]], &c = mesh.positions[f[2]];
    const double twice = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
    EXPECT_GT(twice, 0);
    area += twice / 2;
  }
  EXPECT_DOUBLE_EQ(area, 10);
}

TEST_F(Import, PlacesMeshesByTheirNodesAndTurnsMirroredOnesRightSideOut) {
  // One triangle, shown twice: as it is, and mirrored in x and moved by 10.
  const std::string gltf = R"({"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0,1]}],
    "nodes":[{"mesh":0},{"mesh":0,"scale":[-1,1,1],"translation":[10,0,0]}],
    "meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}],
    "accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3","min":[0,0,0],"max":[1,1,0]}],
    "bufferViews":[{"buffer":0,"byteLength":36}],
    "buffers":[{"byteLength":36,"uri":"data:application/octet-stream;base64,AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAA"}]})";
  TriangleMesh mesh = import_mesh(file("twice.gltf", gltf));
  ASSERT_EQ(mesh.faces.size(), 2u);
  const std::vector<std::array<float, 3>> expected{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {10, 0, 0}, {9, 0, 0}, {10, 1, 0}};
  EXPECT_EQ(mesh.positions, expected);
  EXPECT_EQ(mesh.faces[1], (Triangle{3, 5, 4}));
}

TEST_F(Import, RefusesWhatIsMissingOrEmptyOrAFolder) {
  EXPECT_THAT(refusal(folder_.path() / "missing.obj"), HasSubstr("missing.obj: no such file"));
  EXPECT_THAT(refusal(file("empty.ply", "")), HasSubstr("found 0 bytes"));
  EXPECT_THAT(refusal(folder_.path()), HasSubstr("no regular file"));
}

TEST_F(Import, RefusesWhatIsNoModel) {
  EXPECT_THAT(refusal(file("letter.txt", "Dear reader,\n")), HasSubstr("letter.txt: cannot be read as a model"));
}

TEST_F(Import, RefusesPointsAndLinesAndSaysThatItFoundThem) {
  const std::string points =
      "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n"
      "property float z\nend_header\n0 0 0\n1 0 0\n0 1 0\n";
  EXPECT_THAT(refusal(file("cloud.ply", points)), HasSubstr("expected a surface of triangles"));
  EXPECT_THAT(refusal(file("wire.obj", "v 0 0 0\nv 1 0 0\nv 1 1 0\nl 1 2 3\n")), HasSubstr("expected a surface"));
}

TEST_F(Import, RefusesEveryTruncationOfABinaryFile) {
  const TriangleMesh mesh = generate(Shape::kSphere, 200);
  for (const char* name : {"cut.ply", "cut.stl"}) {
    write_mesh(folder_.path() / name, mesh);
    const std::string bytes = read_bytes(folder_.path() / name);
    for (std::size_t size = 0; size < bytes.size(); size += 61) {
      EXPECT_NE(refusal(file(name, bytes.substr(0, size))), "") << name << " cut to " << size;
    }
  }
}

TEST_F(Import, SurvivesDamageOfAnyByte) {
  const TriangleMesh mesh = generate(Shape::kSphere, 60);
  for (const char* name : {"hurt.ply", "hurt.stl", "hurt.obj"}) {
    write_mesh(folder_.path() / name, mesh);
    const std::string bytes = read_bytes(folder_.path() / name);
    for (std::size_t at = 0; at < bytes.size(); at += 7) {
      std::string damaged = bytes;
      damaged[at] = static_cast<char>(damaged[at] ^ 0x55);
      // It may still be a model, or be refused: what counts is that every index it gives is good.
      try {
        const TriangleMesh back = import_mesh(file(name, damaged));
        for (const Triangle& f : back.faces) {
          for (const std::uint32_t v : f) ASSERT_LT(v, back.positions.size());
        }
      } catch (const ModelError& e) {
        ASSERT_THAT(e.what(), HasSubstr(name));
      }
    }
  }
}

TEST_F(Import, WritingToAnUnknownFormatOrPlaceIsRefused) {
  const TriangleMesh mesh = generate(Shape::kSphere, 60);
  EXPECT_THROW(write_mesh(folder_.path() / "sphere.xyz", mesh), ModelError);
  EXPECT_THROW(write_mesh(folder_.path() / "no" / "sphere.ply", mesh), ModelError);
}

}  // namespace
}  // namespace tactus::spm::offline
