#include "trace/flight_file.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/support/temporary_folder.hpp"
#include "tests/trace/read_mcap.hpp"
#include "trace/cdr.hpp"
#include "trace/idl_schema.hpp"
#include "trace/mcap.hpp"

namespace tactus::trace {
namespace {

/// Returns one message of each type. The values differ from the defaults, so that the tests detect a field that is not
/// written.
std::vector<FlightMessage> messages_of_all_types() {
  FlightStart start;
  start.build = "abc";
  start.participant = "desk";
  start.reason = "why";
  start.first_cycle = 7;
  start.period = 0.001;
  start.devices = {{1, 2, 3, 4}, {5, 6, 7, 8}};
  start.slots = 11;
  start.list_blocks = 13;
  FlightObject object{3, 1ull << 60, 2, "organ", {}, 800, 1, 0.5, 0.4, true};
  object.placement[12] = -0.1;
  FlightState state;
  state.cycle = 99;
  state.lost = 5;
  state.objects = {{3, 20, 1ull << 63, {5}, {1, 2, 3}, {{2, 40, true}, {1, 0, false}}}, {4, 0, 0, {}, {}, {}}};
  state.carried = {0, 255, 7};
  FlightProbe probe;
  probe.cycle = 100;
  probe.pose_time_ns = -5;
  probe.position = {0.1, -0.0, 1e-310};
  probe.orientation = {0, 0, 0, 1};
  probe.force = {1.0 / 3, 2, 3};
  probe.contacts = 17;
  return {start,
          object,
          state,
          FlightEvent{100, FlightEvent::Kind::kRegionRetired, 3, 2, 0},
          FlightMove{100, 3, {1, 2}},
          probe,
          FlightTouch{100, 12345, 0x9fc0},
          FlightRefine{100, 55, 160, 1, 0}};
}

std::vector<std::uint8_t> encoded(const FlightMessage& message) {
  CdrWriter writer;
  std::visit([&](const auto& value) { writer(value); }, message);
  return {writer.bytes().begin(), writer.bytes().end()};
}

class FlightFile : public ::testing::Test {
 protected:
  void write() const {
    FlightFileWriter writer{file_};
    for (const FlightMessage& message : messages_of_all_types()) writer.write(message);
    writer.close();
  }
  /// Copies the file. Replaces `from` by `to` in its IDL text.
  [[nodiscard]] std::string copy_with_other_idl(const std::string& from, const std::string& to) const {
    const std::string copy = (folder_.path() / "copy.mcap").string();
    McapReader reader{file_};
    McapWriter writer{copy, "copy"};
    for (McapMessage message; reader.next(message);) {
      std::string idl = *message.schema_text;
      EXPECT_NE(idl.find(from), std::string::npos);
      idl.replace(idl.find(from), from.size(), to);
      writer.write(writer.add_channel(writer.add_schema(message.schema, "omgidl", idl), message.topic, "cdr"), 0, 0,
                   message.sequence, {message.bytes.data(), message.bytes.size()});
    }
    writer.close();
    return copy;
  }
  test_support::TemporaryFolder folder_;
  std::string file_ = (folder_.path() / "flight.mcap").string();
};

TEST_F(FlightFile, ReadsTheWrittenMessages) {
  write();
  FlightFileReader reader{file_};
  FlightMessage found;
  for (const FlightMessage& message : messages_of_all_types()) {
    ASSERT_TRUE(reader.next(found));
    EXPECT_EQ(found.index(), message.index());
    EXPECT_EQ(encoded(found), encoded(message)) << "type " << message.index();
  }
  EXPECT_FALSE(reader.next(found));
  EXPECT_FALSE(reader.is_truncated());
}

TEST_F(FlightFile, ReadsAFileWithOtherCommentsInItsIdl) {
  write();
  FlightFileReader reader{copy_with_other_idl("string name;", "string name;  // another comment\n\n")};
  std::size_t count = 0;
  for (FlightMessage message; reader.next(message);) ++count;
  EXPECT_EQ(count, messages_of_all_types().size());
}

TEST_F(FlightFile, RefusesAFileWithOtherTypes) {
  write();
  FlightFileReader reader{copy_with_other_idl("double max_slew;", "float max_slew;")};
  FlightMessage message;
  EXPECT_THROW((void)reader.next(message), FlightError);
}

TEST_F(FlightFile, MatchesItsIdl) {
  write();
  McapReader reader{file_};
  std::map<std::string, std::string> values;  // by topic and column
  for (McapMessage message; reader.next(message);) {
    const IdlSchema schema{*message.schema_text};
    const std::vector<std::string> columns = schema.columns(message.schema);
    const std::vector<std::string> cells = schema.values(message.schema, {message.bytes.data(), message.bytes.size()});
    ASSERT_EQ(cells.size(), columns.size()) << message.topic;
    for (std::size_t i = 0; i < cells.size(); ++i) values[message.topic + " " + columns[i]] = cells[i];
  }
  EXPECT_EQ(values["flight_start reason"], "why");
  EXPECT_EQ(values["flight_start list_blocks"], "13");
  EXPECT_EQ(values["flight_object dynamic_friction"], "0.4");
  EXPECT_EQ(values["flight_state carried"], "[0,255,7]");
  EXPECT_THAT(
      values["flight_state objects"],
      testing::StartsWith(
          R"([{"object":3,"base_faces":20,"mesh_hash":9223372036854775808,"loaded_pages":[5],"loaded_regions":[1,2,3],)"
          R"("in_use":[{"region":2,"applied":40,"retiring":true,"retained":false},)"));
  EXPECT_EQ(values["flight_event kind"], "kRegionRetired");
  EXPECT_EQ(values["flight_move placement.1"], "2");
  EXPECT_EQ(values["flight_probe force.0"], "0.3333333333333333");
  EXPECT_EQ(values["flight_probe position.1"], "-0");
  EXPECT_EQ(values["flight_probe contacts"], "17");
  EXPECT_EQ(values["flight_touch float_control"], "40896");
  EXPECT_EQ(values["flight_refine budget_spent"], "1");
}

TEST_F(FlightFile, RefusesAMessageTruncatedAnywhere) {
  for (const FlightMessage& message : messages_of_all_types()) {
    const std::vector<std::uint8_t> complete = encoded(message);
    for (std::size_t size = 0; size < complete.size(); ++size) {
      std::visit(
          [&](auto value) {
            EXPECT_THROW((CdrReader{{complete.data(), size}}(value)), CdrError) << message.index() << ", " << size;
          },
          message);
    }
  }
}

TEST_F(FlightFile, TheReferenceReaderDecodesEveryTypeByTheSchemaInTheFile) {
  if (const std::string reason = missing_mcap_reader(); !reason.empty()) GTEST_SKIP() << reason;
  write();
  const std::string found = read_mcap("decoded '" + file_ + "'");
  for (const char* const expected :
       {R"("flight_start":{"count":1,"schema":"tactus::flight::Start")", R"("reason":"why")", R"("list_blocks":13)",
        R"("flight_state":{"count":1)", R"("carried":[0,255,7])",
        R"({"region":2,"applied":40,"retiring":true,"retained":false})", R"("flight_event":{"count":1)",
        R"("flight_move":{"count":1)", R"("force":[0.3333333333333333,2,3])", R"("float_control":40896)",
        R"("granted":160)"})
    EXPECT_THAT(found, testing::HasSubstr(expected));
}

}  // namespace
}  // namespace tactus::trace
