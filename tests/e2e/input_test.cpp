/// Every program refuses wrong input: exit status 2, a message that names the error, and no change of any file.
#include <filesystem>
#include <map>

#include "spm/pool.hpp"
#include "tests/e2e/session_test.hpp"

namespace tactus::e2e {
namespace {

using Strings = std::vector<std::string>;
using testing::ContainsRegex;
using testing::HasSubstr;

struct WrongInput {
  Strings arguments;
  Strings messages;  // the output contains each of them
};

class WrongInputTest : public SessionTest {
 protected:
  WrongInputTest() {
    run_mesh_tool({"generate", "sphere", path("good.ply"), "--faces", "2000"});
    run_mesh_tool({"generate", "sphere", path("good.spm"), "--faces", "2000"});
    const std::string ply = test_support::read_bytes(path("good.ply"));
    const std::string spm = test_support::read_bytes(path("good.spm"));
    std::string flipped_bit = spm, newer_version = spm;
    flipped_bit[spm.size() / 2] = static_cast<char>(flipped_bit[spm.size() / 2] ^ 1);
    newer_version[8] = static_cast<char>(newer_version[8] + 1);
    write("flipped.spm", flipped_bit);
    write("newer.spm", newer_version);
    write("cut.spm", spm.substr(0, spm.size() - 100));
    write("empty.spm", "");
    write("empty.ply", "");
    write("cut.ply", ply.substr(0, ply.size() - 100));
    write("too_large.ply",
          "ply\nformat ascii 1.0\nelement vertex 4000000000\nproperty float x\nproperty float y\nproperty float z\n"
          "element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n3 0 1 2\n");
    write("bad_index.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 999999999\n");
    write("flat.obj", "v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n");
    write("points.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\n");
    write("garbage.ply", std::string(4096, '\xa5'));
    write("garbage.spm", std::string(4096, '\xa5'));
    write("report.json", "{}\n");
    write("poses.csv", "0,0,0,0\n1,0,0,0.1\n");
    write("key.yaml", "name: x\nusers:\n  - name: ann\n    script:\n      - approach: {object: organ, spede: 1}\n");
    write("list.yaml", "- 1\n- 2\n");
    write("host.yaml", "objects:\n  - modell: good.spm\n");
    std::filesystem::create_directory(path("empty_qos"));
    std::filesystem::copy(wire::default_qos_directory(), path("broken_qos"));
    write("broken_qos/probe.xml", "<dds><profiles></profiles></dds>\n");
  }

  static void run_mesh_tool(const Strings& arguments) {
    Process mesh{program("mesh", arguments)};
    ASSERT_EQ(mesh.wait(60s), 0) << mesh.output();
  }

  /// The content of every file in the test's folder, by path.
  using Contents = std::map<std::string, std::string>;
  [[nodiscard]] Contents contents() const {
    Contents found;
    for (const auto& entry : std::filesystem::recursive_directory_iterator{folder_.path()})
      found[entry.path().string()] = entry.is_regular_file() ? test_support::read_bytes(entry.path()) : "a folder";
    return found;
  }
  /// The paths of files that are new, missing or different now.
  [[nodiscard]] Strings changes_since(const Contents& before) const {
    const Contents now = contents();
    Strings changed;
    for (const auto& [file, content] : now)
      if (before.count(file) == 0 || before.at(file) != content) changed.push_back(file);
    for (const auto& [file, content] : before)
      if (now.count(file) == 0) changed.push_back(file);
    return changed;
  }

  void expect_refused(const std::string& name, const std::vector<WrongInput>& inputs) const {
    const auto before = contents();
    for (const WrongInput& input : inputs) {
      std::string command_line = name;
      for (const std::string& argument : input.arguments) command_line += " " + argument;
      SCOPED_TRACE(command_line);
      Process refused{program(name, input.arguments)};
      EXPECT_EQ(refused.wait(), 2) << refused.output();
      EXPECT_TRUE(refused.left_nothing_running());
      for (const std::string& message : input.messages) EXPECT_THAT(refused.output(), HasSubstr(message));
      const Strings changed = changes_since(before);
      EXPECT_THAT(changed, testing::IsEmpty()) << "changed files";
      for (const std::string& file : changed)
        if (before.count(file) == 0) std::filesystem::remove_all(file);
    }
  }

  /// A memory that is too small for the pool of a viewer or a bridge.
  [[nodiscard]] static WrongInput memory_of_999_slots() {
    const std::string memory = std::to_string(spm::PoolSettings::for_slots(999).bytes());
    return {{"--memory", memory}, {"found " + memory + " bytes, which hold 999 slots", "expected at least 1000"}};
  }

  /// Wrong values of the options that every program of a session has. `valid_arguments` are added to each, so that
  /// nothing else is wrong.
  [[nodiscard]] std::vector<WrongInput> wrong_session_options(const Strings& valid_arguments) const {
    std::vector<WrongInput> inputs{
        {{"--colour", "red"}, {"--colour"}},
        {{"--domain", "0"}, {"domain 0", "expected 1 to 98"}},
        {{"--domain", "99"}, {"domain 99", "expected 1 to 98"}},
        {{"--domain", "many"}, {"--domain", "many"}},
        {{"--name", ""}, {"participant name ''", "0 bytes", "expected 1 to 63"}},
        {{"--name", std::string(64, 'x')}, {"64 bytes", "expected 1 to 63"}},
        {{"--name", "a*"}, {"participant name 'a*'"}},
        {{"--session", "a/b"}, {"session name 'a/b'"}},
        {{"--qos", path("nowhere")}, {path("nowhere"), "does not exist", "expected"}},
        {{"--qos", path("empty_qos")}, {path("empty_qos"), "no such file", "expected"}},
        {{"--qos", path("broken_qos")}, {path("broken_qos"), "probe", "expected"}},
    };
    for (WrongInput& input : inputs)
      input.arguments.insert(input.arguments.end(), valid_arguments.begin(), valid_arguments.end());
    return inputs;
  }
};

TEST_F(WrongInputTest, IsRefusedByTheHost) {
  expect_refused("host", wrong_session_options({path("good.spm")}));
  expect_refused("host", {
                             {{}, {"no model", "expected"}},
                             {{path("missing.spm")}, {"missing.spm", "no such"}},
                             {{path("missing.ply")}, {"missing.ply", "no such"}},
                             {{path("empty.spm")}, {"empty.spm", "0 bytes"}},
                             {{path("cut.spm")}, {"cut.spm", "found", "truncated"}},
                             {{path("flipped.spm")}, {"flipped.spm", "checksum"}},
                             {{path("newer.spm")},
                              {"newer.spm", "format version ", "this program reads version ", "later release"}},
                             {{path("garbage.spm")}, {"garbage.spm", "not an .spm file"}},
                             {{path("good.spm"), path("good.spm")}, {"two objects", "'good'"}},
                             {{"--config", path("host.yaml")}, {"host.yaml:2", "unknown key 'modell'"}},
                             {{"--config", path("missing.yaml")}, {"missing.yaml"}},
                             {{"--at", "0", "0", path("good.spm")}, {"--at"}},
                             {{"--at", "0", "nan", "0", path("good.spm")}, {"--at", "nan", "finite"}},
                             {{"--cache", path("good.ply/below"), path("good.ply")}, {"good.ply/below", "cannot"}},
                         });
}

TEST_F(WrongInputTest, IsRefusedByAHostThatBuildsAModel) {
  for (const std::string name :
       {"empty.ply", "cut.ply", "too_large.ply", "bad_index.obj", "points.obj", "garbage.ply", "flat.obj"}) {
    Process refused{program("host", {"--cache", path("cache"), path(name)})};
    EXPECT_EQ(refused.wait(), 2) << name << ": " << refused.output();
    EXPECT_THAT(refused.output(), ContainsRegex("error [^\n]*" + name + ": "));
  }
  EXPECT_TRUE(!std::filesystem::exists(path("cache")) || std::filesystem::is_empty(path("cache")));
}

TEST_F(WrongInputTest, IsRefusedByTheHrtc) {
  expect_refused("hrtc", wrong_session_options({"--log", path("new.log")}));
  expect_refused(
      "hrtc",
      {
          {{"surplus"}, {"surplus"}},
          {{"--pool", "10"}, {"--pool", "10", "256"}},
          {{"--memory", "1000"}, {"--memory", "1000", "256"}},
          {{"--memory", "64MiB", "--pool", "1000"}, {"--memory", "--pool"}},
          {{"--users", "9"}, {"--users", "9", "8"}},
          {{"--rate", "1"}, {"--rate", "100"}},
          {{"--max-force", "nan"}, {"--max-force", "nan", "0.1 to 100"}},
          {{"--device-offset", "0", "0", "inf"}, {"--device-offset", "inf", "finite"}},
          {{"--priority", "99"}, {"--priority", "98"}},
          {{"--wait-host", "soon"}, {"--wait-host", "soon"}},
          {{"--replay", "ann"}, {"--replay", "ann", "expected USER=FILE"}},
          {{"--replay", "a*b=path.csv"}, {"--replay", "a*b", "expected 1 to 63 bytes"}},
          {{"--device", "a\nb=driver.so"}, {"--device", "'a?b'", "without control characters"}},
          {{"--replay", "ann=" + path("missing.csv")}, {"missing.csv"}},
          {{"--replay", "ann=" + path("missing.csv"), "--log", path("new.log"), "--snapshot", path("new_shots")},
           {"missing.csv"}},
          {{"--replay", "ann=" + path("list.yaml")}, {"list.yaml", "expected"}},
          {{"--replay", "a=" + path("poses.csv"), "--replay", "b=" + path("poses.csv"), "--users", "1"},
           {"no probe left", "b"}},
          {{"--log", path("no/such.log")}, {"no/such.log"}},
          {{"--log", path("good.ply/a.log")}, {"good.ply/a.log"}},
          {{"--snapshot", path("good.ply/shots/today")},
           {"snapshot directory " + path("good.ply/shots/today") + ": found " + path("good.ply") +
                ", which is no directory",
            "expected a directory"}},
          {{"--snapshot", path("good.ply")},
           {"snapshot directory " + path("good.ply") + ": found " + path("good.ply") + ", which is no directory",
            "expected a directory"}},
          {{"--snapshot", "/proc/tactus/shots"},
           {"snapshot directory /proc/tactus/shots: found that /proc cannot be written into (",
            "expected a directory"}},
          {{"--snapshot", path("new_shots"), "--log", path("no/such.log")}, {"no/such.log"}},
          {{"--snapshot", path("good.ply"), "--log", path("new.log")}, {"good.ply"}},
      });
}

TEST_F(WrongInputTest, IsRefusedByTheSimulation) {
  expect_refused("sim", wrong_session_options({"--json", path("new.json")}));
  expect_refused("sim",
                 {
                     {{"surplus"}, {"surplus"}},
                     {{"--seconds", "0"}, {"--seconds", "0.1"}},
                     {{"--seconds", "nan"}, {"--seconds", "nan", "0.1"}},
                     {{"--patience", "-1"}, {"--patience", "0.1"}},
                     {{"--scenario", "dmeo"}, {"'dmeo'", "touch, follow, lift, grab, demo", "nor a readable file"}},
                     {{"--scenario", path("key.yaml")}, {"key.yaml:5:", "unknown key 'spede'", "expected"}},
                     {{"--scenario", path("list.yaml")}, {"list.yaml:1:", "expected a map"}},
                     {{"--scenario", path("garbage.spm")}, {"garbage.spm:1:"}},
                     {{"--scenario", path("empty_qos")}, {"empty_qos"}},
                     {{"--json", path("no/such.json")}, {"no/such.json", "cannot write"}},
                     {{"--json", path("empty_qos")}, {"empty_qos", "cannot write"}},
                     {{"--html", path("no/such.html")}, {"no/such.html", "cannot write"}},
                 });
}

TEST_F(WrongInputTest, IsRefusedByWatchAndTop) {
  expect_refused("watch", wrong_session_options({"roster"}));
  expect_refused("watch", {
                              {{}, {"TOPIC", "required"}},
                              {{"rooster"}, {"found no topic 'rooster'", "expected one of tactus_roster, ", "_clock"}},
                              {{"roster", "--user", "ann"}, {"tactus_roster", "--user", "expected a topic of users"}},
                              {{"records", "--from", "museum"}, {"tactus_records", "--from", "expected another"}},
                              {{"roster", "--count", "0"}, {"--count", "0"}},
                              {{"roster", "--for", "soon"}, {"--for", "soon"}},
                              {{"roster", "--for", "nan"}, {"--for", "nan", "0.1"}},
                          });
  expect_refused("top", wrong_session_options({}));
  expect_refused("top", {{{"surplus"}, {"surplus"}},
                         {{"--interval", "0"}, {"--interval", "0.1"}},
                         {{"--interval", "nan"}, {"--interval", "nan", "0.1"}}});
}

TEST_F(WrongInputTest, IsRefusedByRos2) {
  expect_refused("ros2", wrong_session_options({}));
  expect_refused("ros2", {
                             {{"surplus"}, {"surplus"}},
                             {{"--ros-domain", "233"}, {"--ros-domain", "233", "232"}},
                             {{"--ros-domain", "22"}, {"--ros-domain: found 22", "expected one outside 20 to 22"}},
                             {{"--rate", "2000"}, {"--rate", "2000", "1000"}},
                             {{"--rate", "nan"}, {"--rate", "nan", "1000"}},
                             {{"--hrtc", "desk", "--read-only"}, {"--hrtc", "--read-only"}},
                             memory_of_999_slots(),
                         });
}

TEST_F(WrongInputTest, IsRefusedByTheViewer) {
  expect_refused("view", {{{"surplus"}, {"surplus"}}, memory_of_999_slots()});
}

TEST_F(WrongInputTest, IsRefusedByTheControlTool) {
  expect_refused("control",
                 {
                     {{}, {"subcommand"}},
                     {{"mode"}, {"MODE"}},
                     {{"mode", "colaborate"}, {"mode 'colaborate'", "expected auto, collaborate or large-scale"}},
                     {{"mode", "collaborate ann,"}, {"mode 'collaborate ann,'", "empty user name"}},
                     {{"stop", "--reason", std::string(256, 'x')}, {"--reason", "expected at most 255 bytes"}},
                 });
}

TEST_F(WrongInputTest, IsRefusedByTheMeshTool) {
  const std::string out = path("new.spm");
  expect_refused("mesh",
                 {
                     {{}, {"subcommand"}},
                     {{"mend"}, {"subcommand"}},
                     {{"build", "--fast", path("good.ply"), out}, {"--fast"}},
                     {{"build", path("missing.ply"), out}, {"missing.ply", "no such file"}},
                     {{"build", path("empty.ply"), out}, {"empty.ply", "0 bytes"}},
                     {{"build", path("cut.ply"), out}, {"cut.ply"}},
                     {{"build", path("too_large.ply"), out}, {"too_large.ply", "found 14 bytes", "expected"}},
                     {{"build", path("bad_index.obj"), out}, {"bad_index.obj"}},
                     {{"build", path("points.obj"), out}, {"points.obj", "found 3 points", "expected a surface"}},
                     {{"build", path("garbage.ply"), out}, {"garbage.ply"}},
                     {{"build", path("good.ply"), path("no/such.spm")}, {"no/such.spm", "cannot be written"}},
                     {{"build", path("good.ply"), path("empty_qos")}, {"empty_qos", "cannot be written"}},
                     {{"build", "--size", "nan", path("good.ply"), out}, {"--size", "nan", "above 0"}},
                     {{"build", "--pairs", "nan", path("good.ply"), out}, {"--pairs", "nan", "at least 0"}},
                     {{"info", path("missing.spm")}, {"missing.spm"}},
                     {{"info", path("flipped.spm")}, {"flipped.spm", "checksum"}},
                     {{"info", path("newer.spm")},
                      {"newer.spm", "format version ", "this program reads version ", "later release"}},
                     {{"info", path("cut.spm")}, {"cut.spm", "found", "truncated"}},
                     {{"verify", path("good.spm"), path("missing.ply")}, {"missing.ply"}},
                     {{"generate", "cube", out}, {"cube"}},
                     {{"generate", "sphere", path("new.xyz")}, {"new.xyz"}},
                     {{"generate", "sphere", path("no/such.ply")}, {"no/such.ply"}},
                     {{"audit", path("missing.log"), path("good.spm")}, {"missing.log"}},
                     {{"audit", path("garbage.spm"), path("good.ply")}, {"garbage.spm"}},
                     {{"audit", path("missing.log"), path("good.spm"), "--json", path("report.json")}, {"missing.log"}},
                     {{"audit", path("garbage.spm"), path("good.ply"), "--json", path("new.json")}, {"garbage.spm"}},
                     {{"audit", path("missing.log"), path("good.spm"), "--json", path("no/such.json")},
                      {"no/such.json: cannot be written: No such file"}},
                 });
}

TEST_F(WrongInputTest, AnOutputThatCannotBeWrittenIsReported) {
  for (Strings command : {program("mesh", {"info", path("good.spm")}), program("sim", {"--list"}),
                          program("keys", {"init", path("authority")})}) {
    command.insert(command.begin(), {"/bin/sh", "-c", "exec \"$0\" \"$@\" > /dev/full"});
    Process writer{command};
    EXPECT_EQ(writer.wait(), 1) << writer.output();
    EXPECT_THAT(writer.output(), HasSubstr("cannot write the output: No space left on device"));
  }
}

}  // namespace
}  // namespace tactus::e2e
