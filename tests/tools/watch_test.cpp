#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "session/messages.hpp"
#include "tools/hex.hpp"
#include "tools/watch/sample_text.hpp"

namespace tactus::watch {
namespace {

using session::id_of;
using testing::HasSubstr;

constexpr char kIdl[] = R"(struct Figure { string<63> name; double value; };
struct State {
  unsigned long long user_id; unsigned long long participant; unsigned long long object_id;
  unsigned long long hash; unsigned long status; double force[3]; sequence<Figure> figures;
};
struct Entry { unsigned long long participant; string<63> name; sequence<Figure> users; };
)";

Fields state() {
  Fields fields;
  fields["user_id"] = id_of("ann");
  fields["participant"] = id_of("desk");
  fields["object_id"] = 0u;
  fields["status"] = session::kInContact | session::kExact;
  return fields;
}

Fields named(const SampleReader& reader, Fields fields) {
  reader.name(fields);
  return fields;
}

TEST(SampleReader, ReplacesIdsByNamesOfTheRoster) {
  SampleReader reader{kIdl};
  reader.add_names(Fields::parse(R"({"participant":5,"name":"desk","users":[{"name":"ann"}]})"));
  const Fields fields = named(reader, state());
  EXPECT_EQ(fields["user_id"], "ann");
  EXPECT_EQ(fields["participant"], "desk");
  EXPECT_TRUE(fields["object_id"].is_null()) << "id 0 is no object";
}

TEST(SampleReader, ShowsAnIdWithoutANameInHexadecimal) {
  EXPECT_EQ(named(SampleReader{kIdl}, state())["user_id"], tools::hex(id_of("ann")));
  EXPECT_EQ(named(SampleReader{kIdl}, {{"hash", 255u}})["hash"], "00000000000000ff");
}

TEST(SampleReader, NamesStatusBitsAndTheReasonOfAFault) {
  Fields fields = state();
  EXPECT_EQ(named(SampleReader{kIdl}, fields)["status"], (Fields{"kInContact", "kExact"}));
  EXPECT_FALSE(named(SampleReader{kIdl}, fields).contains("fault_reason"));
  fields["status"] = session::kFault | 3u << session::kFaultReasonShift;
  EXPECT_EQ(named(SampleReader{kIdl}, fields)["status"], Fields::array({"kFault"}));
  EXPECT_EQ(named(SampleReader{kIdl}, fields)["fault_reason"], "the device failed");
}

TEST(SampleReader, NamesTheFieldsOfStructsInLists) {
  SampleReader reader{kIdl};
  reader.add_name("desk");
  const Fields fields{{"touchers", {{{"participant", id_of("desk")}}}}};
  EXPECT_EQ(json_line(named(reader, fields)), R"({"touchers":[{"participant":"desk"}]})");
}

TEST(SampleReader, MakesAnObjectOfTheFiguresOfMetrics) {
  const Fields fields = Fields::parse(R"({"figures":[{"name":"hrtc.cycles","value":7},{"name":"b","value":0.5}]})");
  EXPECT_EQ(json_line(named(SampleReader{kIdl}, fields)), R"({"figures":{"hrtc.cycles":7,"b":0.5}})");
}

TEST(SampleReader, DecodesStringsThatAreNotUtf8) {
  const std::vector<std::uint8_t> encoded{0, 1, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0, 3, 0, 0, 0, 'a', 0xff, 0, 0, 0, 0, 0, 0};
  EXPECT_EQ(SampleReader{kIdl}.decode("Entry", encoded)["name"], "a\xef\xbf\xbd");
}

TEST(SampleReader, SelectsByUserAndSender) {
  EXPECT_TRUE(SampleReader::is_selected(state(), {}));
  EXPECT_TRUE(SampleReader::is_selected(state(), {"ann", "desk"}));
  EXPECT_FALSE(SampleReader::is_selected(state(), {"bob", ""}));
  EXPECT_FALSE(SampleReader::is_selected(state(), {"", "museum"}));
}

TEST(SampleReader, RefusesAFilterOnAFieldThatTheTypeLacks) {
  const SampleReader reader{kIdl};
  EXPECT_EQ(reader.refusal("State", {"ann", "desk"}), std::nullopt);
  EXPECT_THAT(reader.refusal("Entry", {"ann", ""}).value_or(""), HasSubstr("--user: found samples without a user"));
  EXPECT_THAT(reader.refusal("Figure", {"", "desk"}).value_or(""), HasSubstr("--from: found samples without"));
}

TEST(SampleText, HasALineForEachFieldWithItsPath) {
  const Fields fields = Fields::parse(R"({"user":"ann","device":{"position":[0.1,2],"on":true},"object":null,)"
                                      R"("status":["kExact","kFault"],"users":[{"user":"ann"}],"gaps":[]})");
  EXPECT_EQ(text(fields),
            "user: ann\ndevice.position: [0.1, 2]\ndevice.on: true\nobject: none\nstatus: kExact kFault\n"
            "users: [{\"user\":\"ann\"}]\ngaps: []\n");
}

TEST(SampleText, OmitsTheEndOfALongList) {
  Fields fields{{"payload", Fields::array()}};
  for (int i = 0; i < 20; ++i) fields["payload"].push_back(i);
  EXPECT_EQ(text(fields), "payload: [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 4 more]\n");
}

TEST(SampleJson, EscapesAllControlCharacters) {
  const Fields fields{{"text", "a\x1b[2J\x7f\xc2\x9b\xc2\xa0\xc3\xab"}};
  const std::string line = json_line(fields);
  EXPECT_EQ(line, "{\"text\":\"a\\u001b[2J\\u007f\\u009b\xc2\xa0\xc3\xab\"}");
  EXPECT_EQ(Fields::parse(line), fields);
}

TEST(SampleText, ContainsNoControlCharacters) {
  EXPECT_EQ(text({{"text", "a\x1b[2J\nb\x7f\xc2\x9b"}}), "text: a?[2J?b??\n");
}

}  // namespace
}  // namespace tactus::watch
