#include "tools/judge/judge.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <functional>
#include <nlohmann/json.hpp>
#include <sstream>
#include <string>

namespace tactus::judge {
namespace {

using nlohmann::json;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

json user(const char* name) { return {{"name", name}, {"touches", 3}, {"first_exact_contact_s", 1.5}, {"faults", 0}}; }

json participant(const char* name, const char* role) {
  return {{"name", name}, {"role", role}, {"present_at_end", true}, {"figures", json::object()}};
}

json hrtc(const char* name) {
  json entry = participant(name, "hrtc");
  entry["figures"] = {
      {"hrtc.evictions", 200}, {"hrtc.reloads", 40}, {"hrtc.copies_apart_um", 900}, {"hrtc.port_lowest_uj", 0}};
  return entry;
}

json audit(const char* log, const char* original) {
  return {{"log", log},
          {"original", original},
          {"objects",
           {{{"contact", 10000},
             {"exact_contact", 9990},
             {"audited", 9000},
             {"audited_near_change", 3000},
             {"mismatched", 0},
             {"fcl", {{"disagreed", 0}}},
             {"probes", {{{"probe", 0}, {"exact_after_ms", 3.0}}}},
             {"records", {{"needed", 1000}, {"of_model", 20000}, {"received", 1300}, {"returned", 200}}}}}}};
}

/// A session of 20 s within all bounds of the demo.
struct Session {
  json report{{"stop_reason", ""},
              {"duration_s", 20.0},
              {"injected_j", 1e-5},
              {"users", {user("ann"), user("bob")}},
              {"objects", {{{"max_raised_m", 0.1}, {"held_s", 2.1}, {"last_raised_m", 0.0005}}}},
              {"participants", {participant("host-a", "host"), hrtc("hrtc-1"), hrtc("hrtc-2")}}};
  std::vector<json> audits{audit("hrtc-1", "organ"), audit("hrtc-2", "organ"), audit("hrtc-2", "terrain")};
  Expectations expectations{true, true, 0.15};

  [[nodiscard]] std::vector<Row> rows() const { return judge(report, audits, expectations); }
};

std::vector<std::string> rows_that_fall_short(const std::vector<Row>& rows) {
  std::vector<std::string> names;
  for (const Row& row : rows)
    if (row.verdict == Verdict::kFallsShort) names.push_back(row.quantity);
  return names;
}

/// The first row whose name contains `name`.
const Row& row_of(const std::vector<Row>& rows, const std::string& name) {
  for (const Row& row : rows)
    if (row.quantity.find(name) != std::string::npos) return row;
  throw std::logic_error("no row " + name);
}

TEST(Judge, AcceptsASessionWithinItsBounds) {
  const std::vector<Row> rows = Session{}.rows();
  EXPECT_THAT(rows_that_fall_short(rows), IsEmpty());
  EXPECT_TRUE(all_hold(rows));
  for (const Row& row : rows) EXPECT_EQ(row.verdict, Verdict::kHolds) << row.quantity;
  EXPECT_EQ(row_of(rows, "share of exact contact, hrtc-2").value, "99.90 %");
  EXPECT_EQ(row_of(rows, "without repeats / needed, hrtc-2").value, "1.100");
  EXPECT_EQ(row_of(rows, "received / all, hrtc-2").value, "6.50 %");
  EXPECT_EQ(row_of(rows, "audited cycles, hrtc-2").value, "18000");
}

TEST(Judge, EachRowFallsShortWhenItsValueMissesTheBound) {
  struct Case {
    const char* row;
    std::function<void(Session&)> change;
  };
  const auto object = [](Session& s) -> json& { return s.audits[2]["objects"][0]; };
  const std::vector<Case> cases{
      {"session ran to its end", [](Session& s) { s.report["stop_reason"] = "ended by another participant"; }},
      {"hosts and HRTCs present", [](Session& s) { s.report["participants"][0]["present_at_end"] = false; }},
      {"hosts and HRTCs present", [](Session& s) { s.report["participants"].erase(0); }},
      {"users who touched", [](Session& s) { s.report["users"][1]["touches"] = 0; }},
      {"first exact contact", [](Session& s) { s.report["users"][1]["first_exact_contact_s"] = nullptr; }},
      {"first exact contact", [](Session& s) { s.report["users"][1]["first_exact_contact_s"] = 5.1; }},
      {"latched fault", [](Session& s) { s.report["users"][0]["faults"] = 1; }},
      {"share of exact contact, hrtc-2", [&](Session& s) { object(s)["exact_contact"] = 9000; }},
      {"audited cycles, hrtc-1", [](Session& s) { s.audits[0]["objects"][0]["audited"] = 3999; }},
      {"audited cycles, hrtc-1", [](Session& s) { s.audits.erase(s.audits.begin()); }},
      {"without repeats / needed, hrtc-2", [&](Session& s) { object(s)["records"]["received"] = 2300; }},
      {"received / all, hrtc-2", [](Session& s) { s.expectations.received_share = 0.06; }},
      {"region change",
       [](Session& s) {
         for (json& log : s.audits) log["objects"][0]["audited_near_change"] = 33;
       }},
      {"differ from the original", [&](Session& s) { object(s)["mismatched"] = 1; }},
      {"FCL disagrees", [&](Session& s) { object(s)["fcl"]["disagreed"] = 1; }},
      {"first touch of a surface", [&](Session& s) { object(s)["probes"][0]["exact_after_ms"] = nullptr; }},
      {"first touch of a surface", [&](Session& s) { object(s)["probes"][0]["exact_after_ms"] = 201.0; }},
      {"regions evicted",
       [](Session& s) {
         for (json& entry : s.report["participants"]) entry["figures"].erase("hrtc.evictions");
       }},
      {"regions loaded again",
       [](Session& s) {
         for (json& entry : s.report["participants"]) entry["figures"].erase("hrtc.reloads");
       }},
      {"lift: raised", [](Session& s) { s.report["objects"][0]["max_raised_m"] = 0.07; }},
      {"lift: raised", [](Session& s) { s.report["objects"] = json::array(); }},
      {"lift: held", [](Session& s) { s.report["objects"][0]["held_s"] = 1.4; }},
      {"lift: final height", [](Session& s) { s.report["objects"][0]["last_raised_m"] = -0.0031; }},
      {"coupled copy", [](Session& s) { s.report["participants"][1]["figures"].erase("hrtc.copies_apart_um"); }},
      {"lift: distance of the copies",
       [](Session& s) { s.report["participants"][1]["figures"]["hrtc.copies_apart_um"] = 15001; }},
      {"lift: energy injected", [](Session& s) { s.report["injected_j"] = 0.0011; }},
      {"lift: lowest energy", [](Session& s) { s.report["participants"][2]["figures"]["hrtc.port_lowest_uj"] = -2; }},
  };
  for (const Case& tested : cases) {
    Session session;
    tested.change(session);
    const std::vector<Row> rows = session.rows();
    EXPECT_FALSE(all_hold(rows)) << tested.row;
    EXPECT_EQ(row_of(rows, tested.row).verdict, Verdict::kFallsShort) << tested.row;
  }
}

TEST(Judge, NamesTheUserWhoTouchedNothing) {
  Session session;
  session.report["users"][1]["touches"] = 0;
  EXPECT_THAT(text(session.rows()), HasSubstr("falls short\n    not bob"));
}

TEST(Judge, AnHrtcWithoutTotalsFallsShortBecauseItWasKilled) {
  Session session;
  session.audits[0]["objects"][0]["records"].erase("received");
  EXPECT_THAT(rows_that_fall_short(session.rows()),
              ::testing::Contains("vertex splits without repeats / needed, hrtc-1"));
}

TEST(Judge, RowsThatDoNotApplyGiveTheReasonAndDoNotFail) {
  Session session;
  session.expectations = {};
  session.report["objects"] = json::array();
  const std::vector<Row> rows = session.rows();
  EXPECT_TRUE(all_hold(rows));
  EXPECT_EQ(row_of(rows, "lift").reason, "no lift in this session");
  for (const char* name : {"lift", "regions evicted", "regions loaded again", "received / all, hrtc-1"})
    EXPECT_EQ(row_of(rows, name).verdict, Verdict::kDoesNotApply) << name;
}

TEST(Judge, AShortSessionIsJudgedWithoutItsTouchRows) {
  Session session;
  session.expectations.has_lift = false;
  session.report["duration_s"] = 1.0;
  session.report["users"][0]["touches"] = 0;
  session.report["users"][0]["first_exact_contact_s"] = nullptr;
  session.audits[0]["objects"] = json::array();
  const std::vector<Row> rows = session.rows();
  EXPECT_THAT(rows_that_fall_short(rows), IsEmpty());
  EXPECT_EQ(row_of(rows, "users who touched").reason, "duration 1.0 s, this row requires 6 s");
  session.audits[1]["objects"][0]["mismatched"] = 2;
  EXPECT_THAT(rows_that_fall_short(session.rows()),
              ::testing::ElementsAre("exact contacts that differ from the original"));
}

TEST(Judge, TheTableHasAtMostAHundredColumns) {
  Session session;
  session.report["stop_reason"] = std::string(300, 'x');
  session.report["participants"][1]["name"] = std::string(63, 'h');
  std::istringstream lines{text(session.rows())};
  for (std::string line; std::getline(lines, line);) EXPECT_LE(line.size(), 100u) << line;
}

TEST(Judge, AReportThatLacksAKeyIsAnErrorThatNamesIt) {
  Session session;
  session.report.erase("duration_s");
  EXPECT_THAT([&] { (void)session.rows(); }, ::testing::ThrowsMessage<std::exception>(HasSubstr("duration_s")));
}

}  // namespace
}  // namespace tactus::judge
