/// Records sessions with tactus-record, and reads the files with the reference reader of MCAP.
#include <algorithm>
#include <array>
#include <charconv>
#include <fstream>
#include <nlohmann/json.hpp>
#include <set>

#include "tests/e2e/session_test.hpp"
#include "tests/trace/read_mcap.hpp"
#include "trace/mcap.hpp"

namespace tactus::e2e {
namespace {

using nlohmann::json;
using Seen = Observer::Seen;

class RecordTest : public SessionTest {
 protected:
  [[nodiscard]] std::vector<std::string> record(const std::string& file) const {
    return in_session("record", {path(file)});
  }
  [[nodiscard]] json decoded(const std::string& mode, const std::string& file) const {
    const std::string text = trace::read_mcap("decoded " + mode + " '" + path(file) + "'");
    EXPECT_TRUE(json::accept(text)) << text.substr(0, 2000);
    return json::accept(text) ? json::parse(text) : json::object();
  }
};

constexpr char kRecordedScenario[] = R"(name: recorded
duration: 120
users:
  - name: ann
    script: [{approach: {object: "#1", direction: [0, 0, 1], speed: 0.2}}, {hold: {seconds: 110, force: 1}}]
  - name: bob
    remote: true
    script: [{approach: {object: "#1", direction: [0, 1, 0], speed: 0.2}}, {hold: {seconds: 110, force: 1}}]
)";

TEST_F(RecordTest, ARecordingAndItsTablesContainEveryTopicOfTheSession) {
  if (const std::string reason = trace::missing_mcap_reader(); !reason.empty()) GTEST_SKIP() << reason;
  Observer observer{address("observer")};
  Process recorder{record("all.mcap")};
  ASSERT_TRUE(recorder.wait_for_line("recording session"));
  Process killed_recorder{record("killed.mcap")};
  ASSERT_TRUE(killed_recorder.wait_for_line("recording session"));
  Process museum{host("museum", models().sphere)};
  Process desk{hrtc("desk")};
  Process users{sim(kRecordedScenario)};
  ASSERT_TRUE(observer.until([](const Seen& seen) {
    return seen.user("ann").exact > 100 && seen.user("bob").exact > 100 && seen.metrics_count("desk") > 1;
  })) << users.output()
      << desk.output();
  // A recorder writes to its file at least once a second. The test waits for this, and then kills the second recorder.
  const std::uint64_t metrics = observer.seen().metrics_count("desk");
  ASSERT_TRUE(observer.until([&](const Seen& seen) { return seen.metrics_count("desk") > metrics + 4; }));
  killed_recorder.signal(SIGKILL);
  users.signal(SIGINT);
  EXPECT_TRUE(exits_with(1, users));
  EXPECT_TRUE(exits_with(0, desk));
  EXPECT_TRUE(exits_with(0, museum));
  recorder.signal(SIGINT);
  EXPECT_TRUE(exits_with(0, recorder));

  const json all = decoded("", "all.mcap");
  std::uint64_t messages = 0;
  for (const auto& [topic, content] : all.items()) messages += content["count"].get<std::uint64_t>();
  EXPECT_THAT(recorder.output(), testing::HasSubstr(std::to_string(messages) + " messages, "));
  for (const char* const topic :
       {"tactus_roster", "tactus_catalogue", "tactus_demand", "tactus_metrics", "tactus_control", "tactus_end",
        "tactus_records", "tactus_probe_state", "tactus_intent", "tactus_device_pose", "tactus_device_command",
        "tactus_clock", "/scene/objects", "/scene/probes", "/tf", "/events"})
    EXPECT_TRUE(all.contains(topic)) << topic;
  ASSERT_TRUE(all.contains("tactus_device_pose"));
  const json& pose = all["tactus_device_pose"];
  EXPECT_EQ(pose["schema"], "tactus::idl::DevicePose");
  EXPECT_EQ(pose["last"]["user_id"], std::to_string(session::id_of("bob")));
  EXPECT_NEAR(pose["last"]["device"]["orientation"][3].get<double>(), 1, 1);
  EXPECT_EQ(all["tactus_catalogue"]["last"]["object_name"], "sphere");

  // Each topic has a table, with the numbers that the reference reader prints.
  Process export_all{in_session("record", {path("all.mcap"), "--to-csv", path("tables")})};
  EXPECT_TRUE(exits_with(0, export_all));
  for (const auto& [topic, content] : all.items()) {
    std::string table = topic.substr(topic.front() == '/' ? 1 : 0);
    std::replace(table.begin(), table.end(), '/', '_');
    EXPECT_THAT(export_all.output(), testing::HasSubstr("tables/" + table + ".csv: ")) << export_all.output();
  }
  std::ifstream table{path("tables/tactus_device_pose.csv")};
  std::string header, row, last_row;
  std::getline(table, header);
  while (std::getline(table, row)) last_row = row;
  EXPECT_THAT(header, testing::StartsWith("log_time_ns,sequence,user_id,probe,participant,"));
  std::string position;
  for (const json& number : pose["last"]["device"]["position"]) {
    std::array<char, 32> digits{};
    position.append(",").append(digits.data(), std::to_chars(digits.begin(), digits.end(), number.get<double>()).ptr);
  }
  EXPECT_THAT(last_row, testing::HasSubstr(position + ","));
  EXPECT_THAT(last_row, testing::HasSubstr("," + pose["last"]["stamp"]["time_ns"].get<std::string>() + ","));

  const json until_killed = decoded("stream", "killed.mcap");
  EXPECT_GT(until_killed["tactus_probe_state"]["count"], 0);
  EXPECT_EQ(until_killed["tactus_catalogue"]["last"]["object_name"], "sphere");

  // The scene of the session before it ended.
  EXPECT_EQ(until_killed["/scene/objects"]["schema"], "foxglove::SceneUpdate");
  const json objects = until_killed["/scene/objects"]["last"]["entities"];
  ASSERT_EQ(objects.size(), 1u);
  EXPECT_EQ(objects[0]["id"], "sphere");
  ASSERT_EQ(objects[0]["models"].size(), 1u) << "the recorder saw the base mesh, because it was there first";
  EXPECT_EQ(objects[0]["models"][0]["media_type"], "model/gltf-binary");
  const std::vector<std::uint8_t> glb = objects[0]["models"][0]["data"];
  EXPECT_THAT(std::string(glb.begin(), glb.end()), testing::StartsWith("glTF"));
  const json probes = until_killed["/scene/probes"]["last"]["entities"];
  std::set<std::string> drawn_users;
  for (const json& probe : probes) drawn_users.insert(probe["id"].get<std::string>());
  EXPECT_EQ(drawn_users, (std::set<std::string>{"ann", "bob"}));
  for (const json& probe : probes) {
    EXPECT_EQ(probe["spheres"].size(), 2u);
    EXPECT_EQ(probe["arrows"].size(), 1u) << "both users press on the sphere";
  }
  const json transform = until_killed["/tf"]["last"]["transforms"][0];
  EXPECT_EQ(transform["parent_frame_id"], "world");
  EXPECT_EQ(transform["child_frame_id"], objects[0]["frame_id"]);
  EXPECT_EQ(all["/events"]["schema"], "foxglove::Log");
  EXPECT_NE(all["/events"]["last"]["message"], "");
  EXPECT_TRUE(all["/scene/objects"]["last"]["entities"].empty()) << "the host has left";

  // The recording has every topic and every first field that the layout shows.
  std::ifstream layout_file{TACTUS_FOXGLOVE_LAYOUT};
  const json panels = json::parse(layout_file)["configById"];
  std::vector<std::string> paths{panels["RosOut!events"]["topicToRender"]};
  for (const auto& [topic, settings] : panels["3D!tactus"]["topics"].items()) paths.push_back(topic);
  for (const auto& [id, panel] : panels.items())
    for (const json& path : panel.value("paths", json::array())) paths.push_back(path["value"]);
  EXPECT_GT(paths.size(), 6u);
  for (const std::string& path : paths) {
    const std::size_t dot = path.find('.');
    const std::string topic = path.substr(0, dot);
    ASSERT_TRUE(all.contains(topic)) << path;
    if (dot == std::string::npos) continue;
    const std::string field = path.substr(dot + 1, path.find_first_of(".[", dot + 1) - dot - 1);
    EXPECT_TRUE(all[topic]["last"].contains(field)) << path;
  }
}

TEST_F(RecordTest, ARecordingWithoutTheSceneHasOnlyTheTopicsOfTheSession) {
  if (const std::string reason = trace::missing_mcap_reader(); !reason.empty()) GTEST_SKIP() << reason;
  std::vector<std::string> command = record("plain.mcap");
  command.push_back("--no-scene");
  Process recorder{command};
  ASSERT_TRUE(recorder.wait_for_line("recording session"));
  Observer observer{address("observer")};
  Process museum{host("museum", models().sphere)};
  ASSERT_TRUE(observer.until([](const Seen& seen) { return seen.metrics_count("museum") > 1; })) << museum.output();
  museum.signal(SIGINT);
  EXPECT_TRUE(exits_with(0, museum));
  recorder.signal(SIGINT);
  EXPECT_TRUE(exits_with(0, recorder));
  const json all = decoded("", "plain.mcap");
  EXPECT_TRUE(all.contains("tactus_catalogue"));
  for (const auto& [topic, content] : all.items()) EXPECT_THAT(topic, testing::StartsWith("tactus_"));
}

TEST_F(RecordTest, ATopicWithoutANameHasATable) {
  {
    trace::McapWriter writer{path("unnamed.mcap"), "test"};
    const auto channel = writer.add_channel(writer.add_schema("B", "omgidl", "struct B { long c; };"), "", "cdr");
    writer.write(channel, 5, 5, 1, std::array<std::uint8_t, 8>{0, 1, 0, 0, 7, 0, 0, 0});
  }
  Process exporter{in_session("record", {path("unnamed.mcap"), "--to-csv", path("tables")})};
  EXPECT_TRUE(exits_with(0, exporter)) << exporter.output();
  EXPECT_EQ(test_support::read_bytes(path("tables/unnamed.csv")), "log_time_ns,sequence,c\n5,1,7\n");
}

TEST_F(RecordTest, TheOrderOfTheMessagesDoesNotChangeTheTablesOfChannels) {
  {
    trace::McapWriter writer{path("states.mcap"), "test"};
    const auto schema = writer.add_schema("B", "omgidl", "struct B { long c; };");
    const auto coded = writer.add_channel(schema, "state", "cdr"),
               full_rate = writer.add_channel(schema, "state", "cdr");
    writer.write(full_rate, 5, 5, 1, std::array<std::uint8_t, 8>{0, 1, 0, 0, 7, 0, 0, 0});
    writer.write(coded, 6, 6, 1, std::array<std::uint8_t, 8>{0, 1, 0, 0, 8, 0, 0, 0});
  }
  Process exporter{in_session("record", {path("states.mcap"), "--to-csv", path("tables")})};
  EXPECT_TRUE(exits_with(0, exporter)) << exporter.output();
  EXPECT_EQ(test_support::read_bytes(path("tables/state.csv")), "log_time_ns,sequence,c\n6,1,8\n");
  EXPECT_EQ(test_support::read_bytes(path("tables/state-2.csv")), "log_time_ns,sequence,c\n5,1,7\n");
}

TEST_F(RecordTest, AFileThatCannotBeWrittenIsWrongInput) {
  Process recorder{record("none/x.mcap")};
  EXPECT_TRUE(exits_with(2, recorder));
  EXPECT_THAT(recorder.output(), testing::HasSubstr("none/x.mcap: No such file or directory"));
}

}  // namespace
}  // namespace tactus::e2e
