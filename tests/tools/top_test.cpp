#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "session/figures.hpp"
#include "session/units.hpp"
#include "tools/top/overview.hpp"

namespace tactus::top {
namespace {

using session::id_of;
using session::Role;
using testing::AllOf;
using testing::ElementsAre;
using testing::EndsWith;
using testing::HasSubstr;
using testing::Not;
using testing::StartsWith;

constexpr std::int64_t kSecond = 1'000 * kMs;
constexpr std::uint64_t kIncarnation = 5;

session::Origin origin(const std::string& participant, std::int64_t time_ns = 0) {
  return {id_of("lab"), id_of(participant), kIncarnation, time_ns};
}

/// An overview with a clock, and participants that send heartbeats.
class OverviewTest : public testing::Test {
 protected:
  session::RosterEntry entry(const std::string& name, Role role) {
    session::RosterEntry made;
    made.origin = origin(name);
    made.role = role;
    made.name = name;
    made.session = "lab";
    made.session_time_ns = now_ns_;
    made.heartbeat = ++heartbeats_;
    if (name == "desk") made.served_users = {{"ann", 0}};
    return made;
  }
  void heartbeat(const std::string& name, Role role) { overview_.on_sample(entry(name, role), now_ns_); }
  void state(std::uint32_t status, double force = 0) {
    session::ProbeState made;
    made.origin = origin("desk");
    made.user_id = id_of("ann");
    made.force = {0, 0, force};
    made.object_id = (status & session::kInContact) != 0 ? id_of("organ") : 0;
    made.status = status;
    made.data_age_us = 3'000;
    overview_.on_sample(made, now_ns_);
  }
  void metrics(const std::string& name, std::vector<session::Figure> figures) {
    session::Metrics made;
    made.origin = origin(name, now_ns_);
    made.figures = std::move(figures);
    overview_.on_sample(made, now_ns_);
  }
  /// Host museum and HRTC desk send heartbeats every 100 ms.
  void run(std::int64_t time_ns) {
    for (const std::int64_t end_ns = now_ns_ + time_ns; now_ns_ < end_ns; now_ns_ += 100 * kMs) {
      heartbeat("museum", Role::kHost);
      heartbeat("desk", Role::kHrtc);
    }
  }
  /// Returns the line of the next screen that begins with `begin`, or an empty one.
  Line line(const std::string& begin) {
    for (Line& found : overview_.screen(now_ns_))
      if (found.text.starts_with(begin)) return found;
    return {};
  }
  std::string screen() { return plain(overview_.screen(now_ns_)); }

  std::int64_t now_ns_ = 100 * kSecond;
  std::uint64_t heartbeats_ = 0;
  Overview overview_{origin("top"), "session lab", now_ns_};
};

TEST_F(OverviewTest, ShowsThatASessionIsEmpty) {
  EXPECT_EQ(screen(), "session lab: no participants\n");
  EXPECT_FALSE(overview_.has_participants());
}

TEST_F(OverviewTest, WarnsInTheSecondLine) {
  Overview overview{origin("top"), "session lab", now_ns_, "NOT SECURED (--plain)"};
  const std::vector<Line> lines = overview.screen(now_ns_);
  ASSERT_GE(lines.size(), 2u);
  EXPECT_EQ(lines[1].text, "NOT SECURED (--plain)");
  EXPECT_EQ(lines[1].emphasis, Emphasis::kAlert);
}

TEST_F(OverviewTest, CountsParticipantsAndStates) {
  run(kSecond);
  state(0);
  (void)screen();
  for (int i = 0; i < 50; ++i) {
    now_ns_ += 10 * kMs;
    state(session::kInContact | session::kExact, 1.5);
  }
  session::CatalogueEntry organ;
  organ.object_id = id_of("organ");
  organ.object = "organ";
  overview_.on_sample(organ, now_ns_);
  run(kMs);
  const std::string text = screen();
  EXPECT_THAT(text, StartsWith("session lab, session time 0:01:41: 1 host, 1 HRTC, 0 clients, 0 viewers\n"));
  EXPECT_THAT(text, HasSubstr("\nann   desk      0        83     103     1.50  organ      0.000  kInContact kExact\n"))
      << "50 states in 0.6 s; the newest is 100 ms old, and its pose 3 ms more";
}

TEST_F(OverviewTest, ComputesRatesFromTwoSamplesOfCounters) {
  namespace figures = session::figures;
  run(kSecond);
  metrics("desk", {{figures::kCycles, 1000}, {figures::kRate, 995}, {figures::kPoolUsed, 1}, {figures::kPoolLimit, 4}});
  EXPECT_EQ(line("desk").text, "desk  ok        100       995       -       -      25        -          -       -")
      << "the mean rate, before the second sample";
  run(kSecond);
  metrics("desk", {{figures::kCycles, 1900},
                   {figures::kRecentCycleP99, 21.4},
                   {figures::kPoolUsed, 1},
                   {figures::kPoolLimit, 4},
                   {"safety.faults", 2}});
  EXPECT_EQ(line("desk").text, "desk  ok        100       900      21       -      25        -          -       2");
}

TEST_F(OverviewTest, StoresOnlyTheFiguresOfTheNewestSamples) {
  run(kSecond);
  metrics("desk", {{"safety.faults", 2}});
  metrics("desk", {{"figure with another name", 1}});
  EXPECT_EQ(line("desk").text, "desk  ok        100         -       -       -       -        -          -       -");
}

TEST_F(OverviewTest, StoresNoMoreThan4096AbsentParticipants) {
  for (int i = 0; i < 5000; ++i) {
    session::RosterEntry viewer = entry("v" + std::to_string(i), Role::kViewer);
    overview_.on_sample(viewer, now_ns_);
    viewer.leaving = true;
    viewer.heartbeat = ++heartbeats_;
    overview_.on_sample(viewer, now_ns_);
  }
  int absent = 0;
  for (const Line& shown : overview_.screen(now_ns_)) absent += shown.text.ends_with("left 0 s ago") ? 1 : 0;
  EXPECT_EQ(absent, 4096);
}

TEST_F(OverviewTest, ForgetsTheFiguresOfAnEarlierStart) {
  run(kSecond);
  metrics("desk", {{session::figures::kCycles, 9e6}});
  session::Metrics restarted;
  restarted.origin = origin("desk", now_ns_);
  restarted.origin.incarnation = kIncarnation + 1;
  restarted.figures = {{session::figures::kCycles, 10}};
  overview_.on_sample(restarted, now_ns_);
  EXPECT_EQ(line("desk").text, "desk  ok        100         -       -       -       -        -          -       -");
}

TEST_F(OverviewTest, ShowsParticipantsThatAreLateGoneAndBack) {
  run(3 * kSecond);
  heartbeat("museum", Role::kHost);
  now_ns_ += 300 * kMs;
  heartbeat("museum", Role::kHost);
  EXPECT_THAT(line("desk").text, StartsWith("desk  late      400")) << "its last entry came 400 ms ago";
  now_ns_ += 300 * kMs;
  heartbeat("museum", Role::kHost);
  EXPECT_EQ(line("desk").text, "desk  gone for 0 s");
  EXPECT_EQ(line("desk").emphasis, Emphasis::kAlert);
  EXPECT_THAT(screen(), HasSubstr("0 s  HRTC 'desk' is silent, presumed failed\n"));
  now_ns_ += 100 * kMs;
  run(100 * kMs);
  EXPECT_THAT(line("desk").text, StartsWith("desk  ok"));
  EXPECT_EQ(line("desk").emphasis, Emphasis::kNone);
}

TEST_F(OverviewTest, ShowsForOneMinuteThatAParticipantLeft) {
  run(3 * kSecond);
  session::RosterEntry leave = entry("desk", Role::kHrtc);
  leave.leaving = true;
  overview_.on_sample(leave, now_ns_);
  now_ns_ += 2 * kSecond;
  EXPECT_EQ(line("desk").text, "desk  left 2 s ago");
  now_ns_ += 60 * kSecond;
  EXPECT_EQ(line("desk").text, "");
}

TEST_F(OverviewTest, ShowsAnEmergencyStopUntilItsReset) {
  run(3 * kSecond);
  EXPECT_THAT(screen(), Not(HasSubstr("EMERGENCY")));
  overview_.on_sample(session::EmergencyStop{origin("panel"), 1, "needle\x1b bent"}, now_ns_);
  session::RosterEntry stopped = entry("museum", Role::kHost);
  stopped.stops = {{id_of("panel"), kIncarnation, 1, 0, 0}};
  overview_.on_sample(stopped, now_ns_);
  EXPECT_EQ(line("EMERGENCY").text, "EMERGENCY STOP: forces are off at no HRTC, NOT at desk");
  EXPECT_EQ(line("EMERGENCY").emphasis, Emphasis::kAlert);
  EXPECT_EQ(line("reason").text, "reason: needle? bent");
  EXPECT_THAT(screen(), HasSubstr("0 s  emergency stop\n"));

  session::RosterEntry also = entry("desk", Role::kHrtc);
  also.stops = stopped.stops;
  overview_.on_sample(also, now_ns_);
  EXPECT_EQ(line("EMERGENCY").text, "EMERGENCY STOP: forces are off at desk");
  EXPECT_THAT(line("desk").text, StartsWith("desk  stopped"));

  run(100 * kMs);  // entries without stops
  EXPECT_THAT(screen(), AllOf(Not(HasSubstr("EMERGENCY")), HasSubstr("0 s  all emergency stops ended\n")));
}

TEST_F(OverviewTest, ShowsALatchedFaultWithItsReason) {
  run(3 * kSecond);
  state(session::kExact);
  state(session::kFault | 3u << session::kFaultReasonShift);
  EXPECT_THAT(line("ann").text, HasSubstr("FAULT: the device failed; kFault"));
  EXPECT_EQ(line("ann").emphasis, Emphasis::kAlert);
  EXPECT_THAT(screen(), HasSubstr("0 s  user 'ann': fault: the device failed\n"));
  state(session::kExact);
  EXPECT_THAT(screen(), HasSubstr("0 s  user 'ann': fault ended\n"));
}

TEST_F(OverviewTest, ShowsUsersThatNoHrtcServes) {
  run(kSecond);
  session::RosterEntry client = entry("sim", Role::kClient);
  client.users = {"ann", "bob"};
  client.requested_hrtc = "desk";
  overview_.on_sample(client, now_ns_);
  EXPECT_THAT(line("bob").text, AllOf(StartsWith("bob   desk"), HasSubstr("waits for its HRTC")));
  EXPECT_THAT(line("ann").text, HasSubstr("no probe state yet"));
}

TEST(TextTable, AlignsColumnsByTheirCharacters) {
  const std::vector<Line> lines = table({{{"NAME", "N"}}, {{"Zo\xc3\xab", "12"}}, {{"a"}, Emphasis::kAlert}}, "lr");
  ASSERT_EQ(lines.size(), 3u);
  EXPECT_EQ(lines[0].text, "NAME   N");
  EXPECT_EQ(lines[0].emphasis, Emphasis::kHead);
  EXPECT_EQ(lines[1].text, "Zo\xc3\xab   12");
  EXPECT_EQ(lines[2].text, "a");
  EXPECT_EQ(lines[2].emphasis, Emphasis::kAlert);
}

TEST(TextTable, AlignsCellsWhoseControlCharactersItReplaces) {
  const std::vector<Line> lines = table({{{"N", "X"}}, {{"\xc2\x9b\xc2\x9b", "1"}}, {{"a", "2"}}}, "ll");
  ASSERT_EQ(lines.size(), 3u);
  EXPECT_EQ(lines[1].text.find('\x9b'), std::string::npos);
  EXPECT_THAT(lines[1].text, EndsWith("  1"));
  EXPECT_THAT(lines[2].text, AllOf(StartsWith("a "), EndsWith("  2")));
}

TEST(TextTable, IsCutToTheTerminal) {
  const auto texts = [](const std::vector<Line>& lines) {
    std::vector<std::string> all;
    for (const Line& line : lines) all.push_back(line.text);
    return all;
  };
  EXPECT_THAT(texts(fitted({{"\xc3\xab"
                             "b"
                             "c"},
                            {"d"}},
                           2, 2)),
              ElementsAre("\xc3\xab"
                          "b",
                          "d"));
  EXPECT_THAT(texts(fitted({{"a"}, {"b"}, {"c"}}, 80, 2)), ElementsAre("a", "2 more lines: enlarge the terminal"));
}

TEST(TextTable, RedrawsATerminalWithoutErasingItFirst) {
  EXPECT_EQ(ansi({{"head", Emphasis::kHead}, {"x"}, {"bad", Emphasis::kAlert}}),
            "\x1b[H\x1b[1mhead\x1b[0m\x1b[K\nx\x1b[0m\x1b[K\n\x1b[7m"
            "bad\x1b[0m\x1b[K\x1b[J");
}

}  // namespace
}  // namespace tactus::top
