#include "tools/mesh_tool.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cerrno>
#include <nlohmann/json.hpp>
#include <sstream>
#include <string>
#include <vector>

#include "spm/offline/model_file.hpp"
#include "tests/support/temporary_folder.hpp"

namespace tactus::tools {
namespace {

using test_support::read_bytes;
using test_support::write_bytes;
using ::testing::AllOf;
using ::testing::HasSubstr;

struct Outcome {
  int code;
  std::string out, errors;
};

class MeshTool : public ::testing::Test {
 protected:
  Outcome run(std::vector<std::string> arguments, bool is_terminal = false) const {
    arguments.insert(arguments.begin(), "tactus-mesh");
    std::vector<const char*> argv;
    for (const std::string& argument : arguments) argv.push_back(argument.c_str());
    std::ostringstream out, errors;
    const int code = run_mesh_tool(static_cast<int>(argv.size()), argv.data(), {out, errors, is_terminal});
    return {code, out.str(), errors.str()};
  }
  std::string path(const std::string& name) const { return (folder_.path() / name).string(); }

  test_support::TemporaryFolder folder_;
};

TEST_F(MeshTool, BuildsAGeneratedMeshAndVerifiesTheModel) {
  ASSERT_EQ(run({"generate", "organ", path("a.ply"), "--faces", "3000", "--seed", "4"}).code, kDone);
  ASSERT_EQ(run({"build", path("a.ply"), path("a.spm"), "--cell-faces", "100"}).code, kDone);
  const Outcome outcome = run({"verify", path("a.spm"), path("a.ply"), "--json"});
  EXPECT_EQ(outcome.code, kDone);
  const auto json = nlohmann::json::parse(outcome.out);
  EXPECT_TRUE(json["exact"]);
  EXPECT_EQ(json["faces"], 3000);
  EXPECT_GT(json["regions"], 20);
}

TEST_F(MeshTool, ExportsTheFinestMeshToTheBit) {
  ASSERT_EQ(run({"generate", "organ", path("a.ply"), "--faces", "3000", "--seed", "4"}).code, kDone);
  ASSERT_EQ(run({"build", path("a.ply"), path("a.spm")}).code, kDone);
  const Outcome outcome = run({"export", path("a.spm"), path("b.ply"), "--json"});
  EXPECT_EQ(outcome.code, kDone) << outcome.errors;
  EXPECT_EQ(nlohmann::json::parse(outcome.out)["faces"], 3000);
  // A model of the exported mesh restores the original mesh.
  ASSERT_EQ(run({"build", path("b.ply"), path("b.spm")}).code, kDone);
  EXPECT_EQ(run({"verify", path("b.spm"), path("a.ply")}).code, kDone);
}

TEST_F(MeshTool, FailsIfItsOutputCannotBeWritten) {
  ASSERT_EQ(run({"generate", "organ", path("a.ply"), "--faces", "2000"}).code, kDone);
  ASSERT_EQ(run({"build", path("a.ply"), path("a.spm")}).code, kDone);
  const std::string ply = path("a.ply"), spm = path("a.spm"), new_ply = path("b.ply"), new_spm = path("b.spm");
  const std::vector<std::vector<const char*>> commands{
      {"tactus-mesh", "build", ply.c_str(), new_spm.c_str()},  {"tactus-mesh", "info", spm.c_str(), "--json"},
      {"tactus-mesh", "verify", spm.c_str(), ply.c_str()},     {"tactus-mesh", "generate", "sphere", new_ply.c_str()},
      {"tactus-mesh", "export", spm.c_str(), new_ply.c_str()},
  };
  for (const std::vector<const char*>& command : commands) {
    std::ostringstream full, errors;
    full.setstate(std::ios::badbit);
    errno = ENOSPC;
    EXPECT_EQ(run_mesh_tool(static_cast<int>(command.size()), command.data(), {full, errors, false}), 1) << command[1];
    EXPECT_THAT(errors.str(), HasSubstr("tactus-mesh: cannot write the output: ")) << command[1];
  }
}

TEST_F(MeshTool, TheProgressBarEndsBeforeTheReport) {
  const std::string out = path("a.spm");
  const std::vector<const char*> command{"tactus-mesh", "generate", "organ", out.c_str(), "--faces", "2000"};
  std::ostringstream terminal;
  ASSERT_EQ(run_mesh_tool(static_cast<int>(command.size()), command.data(), {terminal, terminal, true}), kDone);
  const std::string shown = terminal.str();
  const std::size_t bar = shown.rfind("\033[K");
  ASSERT_NE(bar, std::string::npos);
  EXPECT_THAT(shown.substr(bar), HasSubstr("built in "));
}

TEST_F(MeshTool, VerifyFailsOnAnotherMesh) {
  ASSERT_EQ(run({"generate", "organ", path("a.spm"), "--faces", "2000", "--seed", "1"}).code, kDone);
  ASSERT_EQ(run({"generate", "organ", path("b.stl"), "--faces", "2000", "--seed", "2"}).code, kDone);
  const Outcome outcome = run({"verify", path("a.spm"), path("b.stl")});
  EXPECT_EQ(outcome.code, kCheckFailed);
  EXPECT_THAT(outcome.out, HasSubstr("2000 of 2000 faces of the original are missing"));
}

TEST_F(MeshTool, InfoPrintsTheRowsOfTableOneOfThePaper) {
  ASSERT_EQ(run({"generate", "sphere", path("s.spm"), "--faces", "4096"}).code, kDone);
  const auto json = nlohmann::json::parse(run({"info", path("s.spm"), "--json"}).out);
  EXPECT_EQ(json["vertices"], 2050);
  EXPECT_EQ(json["faces"], 4096);
  EXPECT_EQ(json["base_vertices"].get<int>() + json["records"].get<int>(), 2050);
  EXPECT_EQ(json["ab_tree"]["eight_wide"]["height"], 4);
  EXPECT_EQ(json["ab_tree"]["eight_wide"]["nodes"], 4096 + 512 + 64 + 8 + 1);
  EXPECT_EQ(json["ab_tree"]["binary"]["nodes"], 2 * 4096 - 1);
  EXPECT_GT(json["certificate"]["records"], 0);
  EXPECT_LE(json["certificate"]["slots"], json["parts"]);
  EXPECT_THAT(run({"info", path("s.spm")}).out, AllOf(HasSubstr("vertices"), HasSubstr("needed records")));
}

TEST_F(MeshTool, InfoBoundsTheMemoryAndTheDataRateThatAProbeNeeds) {
  ASSERT_EQ(run({"generate", "sphere", path("s.spm"), "--faces", "20000"}).code, kDone);
  const auto certificate = [&](const char* radius, const char* speed) {
    return nlohmann::json::parse(
        run({"info", path("s.spm"), "--radius", radius, "--speed", speed, "--json"}).out)["certificate"];
  };
  const auto small = certificate("1", "0.1"), large = certificate("30", "0.1"), fast = certificate("1", "0.3");
  EXPECT_EQ(small["speed_m_s"], 0.1);
  EXPECT_LT(small["pool_slots"], large["pool_slots"]);
  EXPECT_LT(small["memory_bytes"], large["memory_bytes"]);
  EXPECT_GT(small["pool_slots"], small["slots"]);
  EXPECT_GT(small["step_records"], 0);
  EXPECT_LE(small["step_records"], small["records"]);
  EXPECT_GT(small["step_bytes"], small["step_records"]);
  EXPECT_NEAR(fast["records_per_second"].get<double>(), 3 * small["records_per_second"].get<double>(), 1e-6);
  EXPECT_NEAR(fast["bytes_per_second"].get<double>(), 3 * small["bytes_per_second"].get<double>(), 1e-6);
  EXPECT_EQ(fast["memory_bytes"], small["memory_bytes"]);
  EXPECT_THAT(run({"info", path("s.spm")}).out, AllOf(HasSubstr("sufficient memory"), HasSubstr("Mbit")));
}

TEST_F(MeshTool, InfoPrintsNoControlCharacterOfASource) {
  const std::string mesh = path("a\nb\x1b]2;x.ply");
  ASSERT_EQ(run({"generate", "sphere", mesh, "--faces", "500"}).code, kDone);
  ASSERT_EQ(run({"build", mesh, path("s.spm")}).code, kDone);
  EXPECT_THAT(run({"info", path("s.spm")}).out, HasSubstr("a?b?]2;x.ply\n"));
  EXPECT_EQ(nlohmann::json::parse(run({"info", path("s.spm"), "--json"}).out)["source"], "a\nb\x1b]2;x.ply");
}

TEST_F(MeshTool, UnitAndSizeSetTheScale) {
  ASSERT_EQ(run({"generate", "torus", path("t.obj"), "--faces", "500"}).code, kDone);
  const auto scale = [&](const std::vector<std::string>& options) {
    std::vector<std::string> arguments{"build", path("t.obj"), path("t.spm"), "--json"};
    arguments.insert(arguments.end(), options.begin(), options.end());
    return nlohmann::json::parse(run(arguments).out)["metres_per_unit"].get<double>();
  };
  EXPECT_DOUBLE_EQ(scale({}), 1);
  EXPECT_DOUBLE_EQ(scale({"--unit", "mm"}), 1e-3);
  EXPECT_NEAR(scale({"--size", "0.28"}), 2, 0.01);  // the width of the torus is about 0.14 units
}

TEST_F(MeshTool, ReportsDroppedElements) {
  write_bytes(path("d.obj"), "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nf 1 2 3\nf 2 4 3\nf 2 3 1\nf 1 1 2\n");
  EXPECT_THAT(run({"build", path("d.obj"), path("d.spm")}).out,
              AllOf(HasSubstr("1 duplicate faces"), HasSubstr("1 repeated corner faces")));
}

TEST_F(MeshTool, RefusesAFileIfMoreThanHalfWouldBeDroppedUnlessAllowed) {
  const std::string square = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\n";
  const std::string usable = "f 1 2 3\nf 2 4 3\n", unusable = "f 2 3 1\nf 1 1 2\n";
  write_bytes(path("half.obj"), square + usable + unusable);
  write_bytes(path("faces.obj"), square + usable + unusable + "f 3 3 4\n");
  std::string unused_vertices = square;
  for (int i = 0; i < 7; ++i) unused_vertices += "v 5 5 " + std::to_string(i) + "\n";
  write_bytes(path("unused.obj"), unused_vertices + usable);
  write_bytes(path("unused.ply"),
              "ply\nformat ascii 1.0\nelement vertex 7\nproperty float x\nproperty float y\nproperty float z\n"
              "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
              "0 0 0\n1 0 0\n0 1 0\n5 5 1\n5 5 2\n5 5 3\n5 5 4\n3 0 1 2\n");
  write_bytes(path("lines.ply"),
              "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
              "element face 3\nproperty list uchar int vertex_indices\nend_header\n"
              "0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n2 0 1\n2 1 2\n");
  EXPECT_EQ(run({"build", path("half.obj"), path("half.spm")}).code, kDone);
  const std::pair<const char*, const char*> cases[] = {
      {"faces.obj",
       "faces.obj: most faces would be dropped: found 3 of 5 unusable (2 with two equal corners, 1 equal "
       "to another), expected at most half"},
      {"unused.obj", "unused.obj: most vertices would be dropped: the file declares 11, found 4, expected"},
      {"unused.ply", "unused.ply: most vertices would be dropped: found 4 of 7 unusable (no face uses them)"},
      {"lines.ply", "lines.ply: most faces would be dropped: the file declares 3, found 1, expected"}};
  for (const auto& [name, message] : cases) {
    const Outcome refused = run({"build", path(name), path("x.spm")});
    EXPECT_EQ(refused.code, kBadInput) << name;
    EXPECT_THAT(refused.errors, AllOf(HasSubstr(message), HasSubstr("--allow-losses"))) << name;
    EXPECT_FALSE(std::filesystem::exists(path("x.spm"))) << name;
    EXPECT_EQ(run({"build", path(name), path("y.spm"), "--allow-losses"}).code, kDone) << name;
    EXPECT_EQ(run({"verify", path("y.spm"), path(name)}).code, kDone) << name;
  }
}

TEST_F(MeshTool, ShowsProgressOnATerminalOnly) {
  ASSERT_EQ(run({"generate", "organ", path("a.ply"), "--faces", "3000"}).code, kDone);
  EXPECT_THAT(run({"build", path("a.ply"), path("a.spm")}, true).errors, HasSubstr("%"));
  EXPECT_EQ(run({"build", path("a.ply"), path("a.spm")}, false).errors, "");
}

TEST_F(MeshTool, HelpHasExamplesAndSucceeds) {
  const Outcome outcome = run({"--help"});
  EXPECT_EQ(outcome.code, kDone);
  EXPECT_THAT(outcome.out, HasSubstr("tactus-mesh verify organ.spm organ.ply"));
  EXPECT_THAT(run({"build", "--help"}).out, HasSubstr("Example: tactus-mesh build"));
}

TEST_F(MeshTool, RefusesBadInputWithAMessageThatNamesIt) {
  write_bytes(path("empty.stl"), "");
  write_bytes(path("text.ply"), "this is no model\n");
  write_bytes(path("line.obj"), "v 0 0 0\nv 1 1 1\nv 2 2 2\nf 1 2 3\n");
  ASSERT_EQ(run({"generate", "sphere", path("good.spm"), "--faces", "500"}).code, kDone);
  ASSERT_EQ(run({"generate", "sphere", path("good.ply"), "--faces", "500"}).code, kDone);
  const std::string good = read_bytes(path("good.spm"));
  std::string flipped_bit = good, newer_version = good;
  flipped_bit[good.size() / 2] = static_cast<char>(flipped_bit[good.size() / 2] ^ 1);
  newer_version[8] = 99;
  write_bytes(path("flipped.spm"), flipped_bit);
  write_bytes(path("newer.spm"), newer_version);
  write_bytes(path("cut.spm"), good.substr(0, good.size() - 100));

  struct Case {
    std::vector<std::string> arguments;
    std::string message;
  };
  const std::vector<Case> cases{
      {{}, "subcommand"},
      {{"mend", "x"}, "subcommand"},
      {{"build", path("good.ply")}, "OUT"},
      {{"build", path("good.ply"), path("x.spm"), "--fast"}, "--fast"},
      {{"build", path("good.ply"), path("x.spm"), "--unit", "inch"}, "inch"},
      {{"build", path("good.ply"), path("x.spm"), "--size", "-1"}, "--size"},
      {{"build", path("good.ply"), path("x.spm"), "--size", "1", "--unit", "mm"}, "exclude"},
      {{"build", path("missing.ply"), path("x.spm")}, "missing.ply: no such file"},
      {{"build", path("empty.stl"), path("x.spm")}, "empty.stl: found 0 bytes"},
      {{"build", path("text.ply"), path("x.spm")}, "text.ply: PLY header"},
      {{"build", path("line.obj"), path("x.spm")}, "line.obj: no surface"},
      {{"build", path("good.ply"), path("no/x.spm")}, "x.spm: cannot be written"},
      {{"info", path("good.ply")}, "good.ply: not an .spm file"},
      {{"info", path("flipped.spm")}, "flipped.spm: section"},
      {{"info", path("newer.spm")}, "version 99"},
      {{"info", path("cut.spm")}, "truncated"},
      {{"verify", path("good.spm"), path("missing.ply")}, "missing.ply"},
      {{"export", path("good.ply"), path("x.ply")}, "good.ply: not an .spm file"},
      {{"export", path("good.spm"), path("x.xyz")}, "x.xyz: extension"},
      {{"generate", "cube", path("x.ply")}, "cube"},
      {{"build", path("good.ply"), path("x.spm"), "--base-faces", "268435456"}, "268435455"},
      {{"generate", "sphere", path("x.ply"), "--faces", "3"}, "faces: found 3"},
      {{"generate", "sphere", path("x.ply"), "--faces", "268435456"},
       "faces: found 268435456, expected 8 to 268435455"},
      {{"generate", "sphere", path("x.xyz")}, "x.xyz: extension"},
      {{"generate", "sphere", path("no/x.ply")}, "x.ply: cannot be written"},
  };
  for (const Case& wrong : cases) {
    const Outcome outcome = run(wrong.arguments);
    EXPECT_EQ(outcome.code, kBadInput) << wrong.message;
    EXPECT_THAT(outcome.errors, HasSubstr(wrong.message));
    EXPECT_EQ(outcome.out, "") << wrong.message;
  }
  EXPECT_FALSE(std::filesystem::exists(path("x.spm")));
  EXPECT_FALSE(std::filesystem::exists(path("x.ply")));
}

}  // namespace
}  // namespace tactus::tools
