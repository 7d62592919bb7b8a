#include "client_sim/report.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <iterator>
#include <nlohmann/json.hpp>
#include <sstream>
#include <string>

#include "session/figures.hpp"
#include "tests/support/constants.hpp"

namespace tactus::client_sim {
namespace {

using ::testing::HasSubstr;

constexpr std::int64_t kStart = 7'000'000'000;

session::ProbeState state_at(std::int64_t ms, std::uint32_t status, double force) {
  session::ProbeState state;
  state.sequence = static_cast<std::uint32_t>(ms + 1);
  state.session_time_ns = kStart + ms * kMs;
  state.status = status;
  state.force = {0, force * 0.6, force * 0.8};
  return state;
}

/// 100 ms without contact, 100 ms of contact with 2 N, the last 75 ms of it exact, 100 ms without contact, 50 ms of
/// exact contact with 4 N.
TouchTally example_tally() {
  TouchTally tally;
  for (int ms = 0; ms < 350; ++ms) {
    const bool first = ms >= 100 && ms < 200;
    const bool second = ms >= 300;
    std::uint32_t status = 0;
    if (first || second) status |= session::kInContact;
    if (second || (first && ms >= 125)) status |= session::kExact;
    tally.add(state_at(ms, status, first ? 2 : second ? 4 : 0), kStart, kStart + ms * kMs + 300'000);
  }
  return tally;
}

TEST(TouchTally, SumsContactTimeExactTimeAndForce) {
  const TouchTally tally = example_tally();
  EXPECT_EQ(tally.touches, 2u);
  EXPECT_NEAR(tally.contact, 0.149, 1e-9);  // the last sample has no next one
  EXPECT_NEAR(tally.exact, 0.124, 1e-9);
  EXPECT_NEAR(tally.first_touch, 0.100, 1e-9);
  EXPECT_NEAR(tally.first_exact, 0.125, 1e-9);
  EXPECT_NEAR(tally.force_mean(), (0.1 * 2 + 0.049 * 4) / 0.149, 1e-9);
  EXPECT_NEAR(tally.force_max, 4, 1e-12);
  EXPECT_NEAR(tally.age_us.percentile(0.5), 300, 1e-6);
  EXPECT_EQ(tally.states_lost, 0u);
}

TEST(TouchTally, CountsLostSamplesAndIgnoresRepeatedSamples) {
  TouchTally tally;
  for (const int ms : {0, 1, 1, 4, 3, 5}) tally.add(state_at(ms, 0, 0), kStart, kStart + ms * kMs);
  EXPECT_EQ(tally.states, 4u);
  EXPECT_EQ(tally.states_lost, 2u);
}

TEST(TouchTally, CountsNoTouchForABounceAndNoContactWithoutSamples) {
  TouchTally tally;
  const auto add = [&](int ms, std::uint32_t status, double force) {
    tally.add(state_at(ms, status, force), kStart, kStart + ms * kMs);
  };
  add(0, session::kInContact, 1);
  add(5, 0, 0);
  add(10, session::kInContact, 1);
  add(2000, session::kInContact, 1);
  EXPECT_EQ(tally.touches, 1u);
  EXPECT_NEAR(tally.contact, 0.005 + 0.05, 1e-9);
}

TEST(TouchTally, IgnoresAStateWithAnImplausibleNumber) {
  TouchTally tally;
  for (int ms = 0; ms < 100; ++ms) {
    session::ProbeState state = state_at(ms, 0, 0);
    if (ms == 50) state.sequence = 0xffffffff;
    tally.add(state, kStart, kStart + ms * kMs);
  }
  EXPECT_EQ(tally.states, 99u);
  EXPECT_EQ(tally.states_lost, 1u);
}

TEST(TouchTally, CountsEachLatchedFaultOnce) {
  TouchTally tally;
  for (int ms = 0; ms < 10; ++ms) {
    const std::uint32_t fault = session::kFault | 4u << session::kFaultReasonShift;
    tally.add(state_at(ms, ms >= 2 && ms < 6 ? fault : 0u, 0), kStart, kStart);
  }
  EXPECT_EQ(tally.faults, 1u);
  EXPECT_EQ(tally.fault_reason, "emergency stop");
}

Report example_report() {
  Report report;
  report.session = "s";
  report.scenario = "demo";
  report.duration = 20;
  report.records_total = 1000000;
  UserReport ann;
  ann.name = "ann";
  ann.hrtc = "left";
  ann.touch = example_tally();
  ann.taps = 4;
  report.users.push_back(ann);
  ParticipantReport hrtc;
  hrtc.name = "left";
  hrtc.role = session::Role::kHrtc;
  hrtc.figures = {{session::figures::kCycles, 20000},
                  {session::figures::kRate, 999.75},
                  {session::figures::kPreempted, 3},
                  {session::figures::kLateUnknown, 1},
                  {session::figures::kWakeP99, 61},
                  {session::figures::kWakeP50, 52},
                  {session::figures::kTimerP50, 41},
                  {session::figures::kTimerMax, 1234},
                  {session::figures::kTimerOverruns, 2},
                  {session::figures::kPoolUsed, 90},
                  {session::figures::kPoolLimit, 100},
                  {session::figures::kRecordsReceived, 50000},
                  {std::string{session::figures::kCycleTime} + ".p50", 4.25},
                  {std::string{session::figures::kRefitTime} + ".p999", 77.5}};
  report.participants.push_back(hrtc);
  ParticipantReport host;
  host.name = "vault";
  host.present_at_end = false;
  host.figures = {{session::figures::kHostBytes, 123456}};
  report.participants.push_back(host);
  report.events.push_back({3.25, "host vault gone"});
  return report;
}

TEST(Report, TextShowsUsersHrtcsHostsAndEvents) {
  const std::string report = text(example_report());
  EXPECT_THAT(report, HasSubstr("Session s, scenario demo: 20.0 s"));
  EXPECT_THAT(report, HasSubstr("ann"));
  EXPECT_THAT(report, HasSubstr("cycles 20000 at 999.8 Hz, 0 skipped\n"
                                "  late cycles: 0 overruns, 3 preempted, 1 unknown\n"
                                "    (overruns of a reference timer with 30 us of work: 2)\n"));
  EXPECT_THAT(report, HasSubstr("p50 52, p99 61, max 0\n    reference timer without work: p50 41, p99 0, max 1234"));
  EXPECT_THAT(report, HasSubstr("pool 90 of 100 slots"));
  EXPECT_THAT(report, HasSubstr("records received 50000 (5.00 % of 1000000)"));
  EXPECT_THAT(report, HasSubstr("77.5"));
  EXPECT_THAT(report, HasSubstr("Host vault (gone before the end)\n  sent 123456 bytes"));
  EXPECT_THAT(report, HasSubstr("3.25 s  host vault gone"));
  std::istringstream lines{report};
  for (std::string line; std::getline(lines, line);) EXPECT_LE(line.size(), 100u) << line;
}

TEST(Report, TextShowsObjectsLiftsAndGrabs) {
  Report report = example_report();
  report.users[0].lifts = 1;
  report.users[0].lifts_lost = 2;
  report.users[0].grabs = 3;
  report.users[0].grabs_refused = 4;
  report.users[0].grabs_lost = 5;
  report.participants[0].figures[session::figures::kInterventions[3]] = 6;
  report.participants[0].figures[session::figures::kInterventions[4]] = 7;
  report.objects.push_back({"crate", {}});
  const std::string shown = text(report);
  EXPECT_THAT(shown, HasSubstr("lifts 1, lost during the lift 2\n"));
  EXPECT_THAT(shown, HasSubstr("grabs 3, refused 4, lost while held 5\n"));
  EXPECT_THAT(shown, HasSubstr("stale pose 6, surface ramp 7\n"));
  EXPECT_THAT(shown, HasSubstr("raised mm  held s    final mm    poses  takeovers\n"
                               "  crate                      0.0    0.00         0.0        0          0\n"));
}

TEST(Report, TextContainsNoControlCharacterOfAnEventOrAName) {
  Report report = example_report();
  report.stop_reason = "ended: a\nb";
  report.users[0].name = "c\x1bz";
  report.events.push_back({1, "emergency stop: e\n      2.00 s  forces are reset"});
  EXPECT_THAT(text(report), testing::AllOf(HasSubstr("Stopped early: ended: a?b\n"), HasSubstr("  c?z "),
                                           HasSubstr("emergency stop: e?      2.00 s  forces are reset\n")));
}

TEST(Report, TextFitsAHundredColumnsForTheLongestNamesAndEvents) {
  Report report = example_report();
  report.stop_reason = "ended by another participant: " + std::string(255, 't');
  report.users[0].name = report.users[0].hrtc = std::string(63, 'n');
  for (ParticipantReport& participant : report.participants) {
    participant.name = std::string(63, 'n');
    for (auto& [name, value] : participant.figures) value = 1e12;
  }
  for (const char* name : session::figures::kInterventions) report.participants[0].figures[name] = 1e6;
  report.events.push_back({1, "emergency stop: the hand of the user in the second room was caught " +
                                  std::string(130, 'e') + " and let go"});
  std::string without_spaces;
  std::istringstream lines{text(report)};
  for (std::string line; std::getline(lines, line);) {
    EXPECT_LE(line.size(), 100u) << line;
    std::copy_if(line.begin(), line.end(), std::back_inserter(without_spaces),
                 [](char character) { return character != ' '; });
  }
  EXPECT_THAT(without_spaces, HasSubstr("roomwascaught" + std::string(130, 'e') + "andletgo"))
      << "the whole text is shown";
}

TEST(Report, JsonHasTheSameFigures) {
  const auto all = nlohmann::json::parse(json(example_report()));
  EXPECT_EQ(all["scenario"], "demo");
  EXPECT_NEAR(all["users"][0]["exact_share"].get<double>(), 0.124 / 0.149, 1e-9);
  EXPECT_EQ(all["users"][0]["taps"], 4);
  EXPECT_EQ(all["participants"][0]["figures"]["hrtc.cycles"], 20000);
  EXPECT_EQ(all["participants"][1]["present_at_end"], false);
  EXPECT_EQ(all["events"][0]["text"], "host vault gone");
}

TEST(Report, HasNoTouchTimeForAUserWithoutContact) {
  Report report;
  report.users.push_back({});
  report.users[0].name = "idle\xff";  // not UTF-8
  const auto all = nlohmann::json::parse(json(report));
  EXPECT_TRUE(all["users"][0]["first_touch_s"].is_null());
  EXPECT_EQ(all["users"][0]["exact_share"], 0);
  EXPECT_THAT(text(report), HasSubstr("no probe state was received"));
}

}  // namespace
}  // namespace tactus::client_sim
