/// Decodes .spm files with a reader in Python that was written from docs/reference/spm-format.md, and compares its
/// finest mesh with that of the C++ code.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <random>
#include <regex>
#include <sstream>
#include <utility>

#include "session/messages.hpp"
#include "spm/checksum.hpp"
#include "spm/codec/model_codec.hpp"
#include "spm/codec/region_codec.hpp"
#include "spm/offline/build.hpp"
#include "spm/offline/digest.hpp"
#include "spm/offline/generate.hpp"
#include "spm/offline/model_file.hpp"
#include "tests/formats/python.hpp"
#include "tests/support/mesh_zoo.hpp"
#include "tests/support/temporary_folder.hpp"

namespace tactus::formats {
namespace {

using e2e::Process;
using test_support::read_bytes;
using test_support::write_bytes;
using testing::HasSubstr;

class ModelFormat : public testing::Test {
 protected:
  void SetUp() override {
    if (const std::string reason = missing_python(); !reason.empty()) GTEST_SKIP() << reason;
  }
  [[nodiscard]] std::string path(const std::string& name) const { return (folder_.path() / name).string(); }

  /// Expects that the reader and tactus-mesh write the same finest mesh of an .spm file.
  void expect_same_finest_mesh(const std::string& model) const {
    Process program{{TACTUS_MESH, "export", model, path("expected.ply")}};
    ASSERT_EQ(program.wait(), 0) << program.output();
    Process python{reader("spm_reader.py", {model, path("found.ply")})};
    ASSERT_EQ(python.wait(), 0) << python.output();
    const std::string expected = read_bytes(path("expected.ply"));
    ASSERT_FALSE(expected.empty());
    EXPECT_TRUE(read_bytes(path("found.ply")) == expected) << python.output();
  }

  test_support::TemporaryFolder folder_;
};

/// Options with which even a small mesh gets records and several regions.
spm::offline::BuildOptions small_parts(unsigned grid_bits = 0) {
  spm::offline::BuildOptions options;
  options.simplify.base_faces = 4;
  options.partition.cell_faces = 16;
  options.partition.max_cell_faces = 40;
  options.grid_bits = grid_bits;
  options.losses = spm::offline::LossPolicy::kAllow;
  return options;
}

/// Rings of `corners` vertices each around one vertex. The faces at this vertex are flat, so it collapses early.
spm::offline::TriangleMesh wheel(std::uint32_t corners) {
  constexpr std::uint32_t kRings = 3;
  spm::offline::TriangleMesh mesh{{{0, 0, 0}}, {}};
  for (std::uint32_t ring = 0; ring < kRings; ++ring) {
    const std::uint32_t first = 1 + ring * corners;
    for (std::uint32_t i = 0; i < corners; ++i) {
      const float angle = 6.2831853f * static_cast<float>(i) / static_cast<float>(corners);
      const float radius = 1 + 0.1f * static_cast<float>(ring);
      mesh.positions.push_back(
          {radius * std::cos(angle), radius * std::sin(angle), 0.3f * static_cast<float>(ring * (i % 2))});
      const std::uint32_t a = first + i, b = first + (i + 1) % corners;
      if (ring == 0) {
        mesh.faces.push_back({0, a, b});
      } else {
        mesh.faces.push_back({a - corners, a, b});
        mesh.faces.push_back({a - corners, b, b - corners});
      }
    }
  }
  return mesh;
}

/// Six patches that share one column of vertices. Each edge in this column has six faces.
spm::offline::TriangleMesh book() {
  spm::offline::TriangleMesh mesh;
  for (int page = 0; page < 6; ++page) {
    const auto first = static_cast<std::uint32_t>(mesh.positions.size());
    const spm::offline::TriangleMesh patch = test_support::grid_patch(3, 8);
    for (const auto& [x, y, z] : patch.positions)
      mesh.positions.push_back({x * std::cos(static_cast<float>(page)), y, x * std::sin(static_cast<float>(page))});
    for (const auto& [a, b, c] : patch.faces) mesh.faces.push_back({a + first, b + first, c + first});
  }
  return mesh;
}

/// Two spheres of which one is a million times smaller than the other, so that the radii of their vertices differ by
/// more than 254 codes.
spm::offline::TriangleMesh large_and_tiny() {
  spm::offline::TriangleMesh mesh = test_support::icosphere(2);
  const auto first = static_cast<std::uint32_t>(mesh.positions.size());
  const spm::offline::TriangleMesh sphere = mesh;
  for (const auto& [x, y, z] : sphere.positions) mesh.positions.push_back({1e-6f * x, 1e-6f * y, 1e-6f * z});
  for (const auto& [a, b, c] : sphere.faces) mesh.faces.push_back({a + first, b + first, c + first});
  return mesh;
}

/// Gives a model, in which each record has one part, a form that Tactus reads but does not write: each record bears its
/// faces in one part and deforms faces in the next one.
void make_unusual(spm::offline::BuiltModel& built) {
  spm::OwnedModel& m = built;
  const std::uint32_t records = m.summary.records;
  ASSERT_EQ(m.summary.parts, records);
  m.parts.resize(2 * std::size_t{records});
  for (std::uint32_t r = 0; r < records; ++r) {
    spm::RecordPart& first = m.parts[r];
    spm::RecordPart& second = m.parts[records + r] = first;
    for (int i = 0; i < first.born_count; ++i) {
      second.born[i] = {};
      second.born_x[i] = {};
    }
    std::fill_n(first.deformed_corners, spm::kDeformedPerPart, 0u);
    first.next = spm::PartIndex{records + r};
    first.deformed_count = 0;
    first.finest = 0;
    second.born_count = 0;
  }
  m.summary.parts = 2 * records;
  for (spm::Region& region : m.regions) region.part_count = 2 * region.record_count;
  m.summary.digest = spm::offline::digest_of(m.model());
}

/// Changes the order of the deformed faces of each part. In the new order, a swing may use a link that remains because
/// a record has more faces than the limits of links. With this seed, it does in the models below.
void shuffle(spm::offline::BuiltModel& built) {
  std::mt19937 random{11};
  for (spm::RecordPart& part : built.parts)
    for (std::uint32_t i = part.deformed_count; i > 1; --i) {
      const auto other = static_cast<std::uint32_t>(random() % i);
      const spm::DeformedRef last = part.deformed(i - 1);
      part.set_deformed(i - 1, part.deformed(other));
      part.set_deformed(other, last);
    }
  const std::vector<std::uint32_t> checksums = spm::region_checksums(built.model());
  for (std::size_t i = 0; i < checksums.size(); ++i) built.regions[i].checksum = checksums[i];
  built.summary.digest = spm::offline::digest_of(built.model());
}

class EveryZooMesh : public ModelFormat, public testing::WithParamInterface<test_support::ZooMesh> {};
INSTANTIATE_TEST_SUITE_P(Zoo, EveryZooMesh, testing::ValuesIn(test_support::mesh_zoo()),
                         [](const auto& test) { return test.param.name; });

TEST_P(EveryZooMesh, HasTheSameFinestMeshInTheReaderInBothProfiles) {
  for (const unsigned grid_bits : {0u, 12u}) {
    const auto built = spm::offline::build_model(GetParam().mesh, small_parts(grid_bits));
    spm::offline::write_model(path("zoo.spm"), built.model(), {GetParam().name, built.cleaned});
    expect_same_finest_mesh(path("zoo.spm"));
  }
}

TEST_F(ModelFormat, AModelWithManyBlocksAndRegionsHasTheSameFinestMeshInTheReader) {
  const auto built =
      spm::offline::build_model(spm::offline::generate(spm::offline::Shape::kOrgan, 12000, 5), small_parts());
  spm::offline::write_model(path("organ.spm"), built.model(), {});
  expect_same_finest_mesh(path("organ.spm"));
}

TEST_F(ModelFormat, TheTestModelsNeedEveryRule) {
  std::vector<std::string> files;
  const auto write = [&](const spm::offline::BuiltModel& built) {
    files.push_back(path(std::to_string(files.size()) + ".spm"));
    spm::offline::write_model(files.back(), built.model(), {});
  };
  for (const test_support::ZooMesh& zoo : test_support::mesh_zoo())
    for (const unsigned grid_bits : {0u, 12u}) write(spm::offline::build_model(zoo.mesh, small_parts(grid_bits)));
  const std::size_t compared = files.size();  // EveryZooMesh compares the finest meshes of these files
  write(spm::offline::build_model(large_and_tiny(), small_parts()));
  write(spm::offline::build_model(wheel(36), small_parts()));
  spm::offline::BuildOptions many_faces = small_parts();
  many_faces.simplify.max_star = 100;
  for (spm::offline::BuiltModel built :
       {spm::offline::build_model(book(), small_parts()), spm::offline::build_model(wheel(80), many_faces)}) {
    write(built);
    shuffle(built);
    write(built);
  }
  spm::offline::BuiltModel unusual = spm::offline::build_model(test_support::icosphere(2), small_parts());
  make_unusual(unusual);
  write(unusual);
  for (std::size_t i = compared; i < files.size(); ++i) expect_same_finest_mesh(files[i]);
  Process count{python(TACTUS_COUNT_RULES, files)};
  EXPECT_EQ(count.wait(), 0) << count.output();
}

TEST_F(ModelFormat, ModelsOfOtherProgramsHaveTheSameFinestMeshInTheReader) {
  const std::filesystem::path models = "/usr/share/assimp/models";
  if (!exists(models)) GTEST_SKIP() << "no models of other programs (Debian: assimp-testmodels)";
  for (const char* const name : {"OBJ/spider.obj", "OBJ/WusonOBJ.obj", "STL/Spider_binary.stl",
                                 "STL/sphereWithHole.stl", "PLY/cube.ply", "OFF/Wuson.off"}) {
    SCOPED_TRACE(name);
    Process build{{TACTUS_MESH, "build", models / name, path("model.spm"), "--base-faces", "50"}};
    ASSERT_EQ(build.wait(), 0) << build.output();
    expect_same_finest_mesh(path("model.spm"));
  }
}

TEST_F(ModelFormat, TheReaderRefusesADamagedFile) {
  const auto built = spm::offline::build_model(test_support::icosphere(2), small_parts());
  spm::offline::write_model(path("good.spm"), built.model(), {});
  const std::string good = read_bytes(path("good.spm"));
  std::vector<std::pair<std::string, std::string>> cases{{good.substr(0, good.size() - 1), "bytes, expected"},
                                                         {"solid nothing", "found no .spm file"}};
  const auto flipped = [&good](std::size_t at) {
    std::string damaged = good;
    damaged[at] = static_cast<char>(damaged[at] ^ 4);
    return damaged;
  };
  cases.emplace_back(flipped(8), "found file version");
  cases.emplace_back(flipped(70), "the header has a wrong checksum");
  cases.emplace_back(flipped(330), "section 1 has a wrong checksum");
  cases.emplace_back(flipped(good.size() - 1), "section 7 has a wrong checksum");
  for (const auto& [bytes, message] : cases) {
    write_bytes(path("bad.spm"), bytes);
    Process python{reader("spm_reader.py", {path("bad.spm")})};
    EXPECT_EQ(python.wait(), 1);
    EXPECT_THAT(python.output(), HasSubstr(message));
    EXPECT_THAT(python.output(), Not(HasSubstr("Traceback")));
  }
}

/// The hexadecimal dump of a page: lines with an offset and up to 16 bytes. Bytes that no line has are 0.
std::string bytes_of_dump(const std::string& page) {
  std::istringstream lines{read_bytes(std::string{TACTUS_REFERENCE_FOLDER} + "/" + page)};
  const std::regex dump_line{"^    ([0-9a-f]{4})  ((?:[0-9a-f]{2} ?)+)$"};
  std::string bytes;
  std::smatch match;
  for (std::string line; std::getline(lines, line);) {
    if (!std::regex_match(line, match, dump_line)) continue;
    bytes.resize(std::stoul(match[1], nullptr, 16), '\0');
    std::istringstream values{match[2].str()};
    for (unsigned value = 0; values >> std::hex >> value;) bytes += static_cast<char>(value);
  }
  return bytes;
}

class ExamplesOfThePages : public ModelFormat {
 protected:
  /// Builds the mesh whose OBJ lines are in the page.
  void build_example() const {
    std::istringstream lines{read_bytes(std::string{TACTUS_REFERENCE_FOLDER} + "/spm-format.md")};
    std::string mesh;
    for (std::string line; std::getline(lines, line);)
      if (line.rfind("    v ", 0) == 0 || line.rfind("    f ", 0) == 0) mesh += line.substr(4) + "\n";
    write_bytes(path("tiny.obj"), mesh);
    Process build{{TACTUS_MESH, "build", path("tiny.obj"), path("tiny.spm"), "--base-faces", "4"}};
    ASSERT_EQ(build.wait(), 0) << build.output();
  }
};

TEST_F(ExamplesOfThePages, TheDumpOfTheModelIsTheFileThatTheProgramWrites) {
  build_example();
  EXPECT_EQ(testing::PrintToString(bytes_of_dump("spm-format.md")),
            testing::PrintToString(read_bytes(path("tiny.spm"))));
  expect_same_finest_mesh(path("tiny.spm"));
}

TEST_F(ExamplesOfThePages, TheDumpOfTheChunkHasTheRegionMessageOfTheModel) {
  build_example();
  const spm::offline::MappedModel model{path("tiny.spm")};
  const spm::RegionId region{0};
  const spm::codec::Bytes message =
      *spm::codec::encode_region(model.compressed(), region, model.compressed().intervals_of(region));
  std::string expected{"\x00\x01\x00\x00", 4};
  const auto number = [&expected](std::uint32_t value) {
    for (unsigned shift = 0; shift < 32; shift += 8) expected += static_cast<char>(value >> shift);
  };
  for (const std::uint32_t field : {0x5eed1234u, 7u, 3u, 1000000u}) number(field);  // stream, number, epoch, time
  number(static_cast<std::uint32_t>(8 + message.size()));
  expected += {1, 0, 1, static_cast<char>(message.size())};
  number(session::checksum_of(message));
  expected.append(message.begin(), message.end());
  EXPECT_EQ(testing::PrintToString(bytes_of_dump("stream-format.md")), testing::PrintToString(expected));
}

}  // namespace
}  // namespace tactus::formats
