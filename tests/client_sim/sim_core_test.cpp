#include "client_sim/sim_core.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <string>
#include <vector>

#include "tests/support/constants.hpp"

namespace tactus::client_sim {
namespace {

using session::ControlKind;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

constexpr std::int64_t kSessionAhead = 5'000'000'000;  // session time minus the time of this program, ns

const char* const kTwoUsers = R"(
name: two
duration: 1
users:
  - name: ann
    hrtc: "#1"
    script: [approach: {object: "#1"}, wait: {seconds: 100}]
  - name: bob
    hrtc: "#2"
    script: [approach: {object: "#2"}, wait: {seconds: 100}]
)";

/// A SimCore and the samples of the other participants of its session.
class SimulatedSession {
 public:
  explicit SimulatedSession(const std::string& scenario, double name_check = 0)
      : core{parse_scenario(scenario, "test"), settings(name_check)} {}

  static SimSettings settings(double name_check) {
    SimSettings settings;
    settings.name_check = name_check;
    settings.session = "s";
    settings.name = "sim";
    settings.incarnation = 9;
    settings.patience = 5;
    settings.settle = 1;
    settings.linger = 1;
    return settings;
  }

  session::Origin origin(const std::string& name) const { return {session::id_of("s"), session::id_of(name), 1, now}; }

  void add_hrtc(const std::string& name, const std::vector<std::string>& users = {}) {
    session::RosterEntry& entry = participant(name, session::Role::kHrtc);
    entry.served_users.clear();
    for (const std::string& user : users)
      entry.served_users.push_back({user, static_cast<std::uint32_t>(entry.served_users.size())});
  }
  void add_host(const std::string& name) { (void)participant(name, session::Role::kHost); }
  /// Adds another client that has the name `name`.
  void add_client(const std::string& name, std::uint64_t incarnation) {
    participant(name, session::Role::kClient).origin.incarnation = incarnation;
  }
  /// Ends the heartbeats of a participant.
  void remove(const std::string& name) {
    entries.erase(std::find_if(entries.begin(), entries.end(), [&](const auto& entry) { return entry.name == name; }));
  }

  void add_object(const std::string& name) {
    session::CatalogueEntry entry;
    entry.origin = origin("host");
    entry.object = name;
    entry.object_id = session::id_of(name);
    entry.summary.bounds_min = {-10, -10, -10};
    entry.summary.bounds_max = {10, 10, 10};
    entry.summary.records = 1000;
    entry.scale = 0.01;
    core.on_catalogue(entry);
  }

  /// Adds one HRTC that serves both users of kTwoUsers, and an object.
  void add_hrtc_for_all() {
    add_hrtc("left", {"ann", "bob"});
    add_object("a");
  }
  /// Adds an HRTC and an object for each user of kTwoUsers.
  void add_hrtc_for_each_user() {
    add_hrtc("left", {"ann"});
    add_hrtc("right", {"bob"});
    add_object("a");
    add_object("b");
  }

  session::ProbeState state_of(const std::string& user, const std::string& hrtc) const {
    session::ProbeState state;
    state.origin = origin(hrtc);
    state.user_id = session::id_of(user);
    state.sequence = static_cast<std::uint32_t>(now / kMs);
    state.session_time_ns = now + kSessionAhead;
    state.device.position = {0, 0, 0.3};
    state.proxy = {0, 0, 0.3};
    return state;
  }

  /// Ticks every 5 ms; all participants send a heartbeat every 50 ms.
  void run(double seconds) {
    const std::int64_t end = now + static_cast<std::int64_t>(seconds * 1e9);
    for (; now < end; now += 5 * kMs) {
      if (now % (50 * kMs) == 0) {
        for (session::RosterEntry& entry : entries) {
          ++entry.heartbeat;
          entry.origin.time_ns = now;
          core.on_roster(entry, now);
        }
      }
      const SimMessages messages = core.tick(now, now + kSessionAhead);
      roster.insert(roster.end(), messages.roster.begin(), messages.roster.end());
      controls.insert(controls.end(), messages.control.begin(), messages.control.end());
      ends.insert(ends.end(), messages.ends.begin(), messages.ends.end());
      intents.insert(intents.end(), messages.intents.begin(), messages.intents.end());
    }
  }

  /// Passes to the core its own roster entries since the last call, as multicast does.
  void echo() {
    for (; echoed < roster.size(); ++echoed) core.on_roster(roster[echoed], now);
  }

  /// Returns whether all intents are start positions, which have one point. A user without a probe state sends these.
  [[nodiscard]] bool only_start_positions() const {
    return std::all_of(intents.begin(), intents.end(),
                       [](const session::Intent& intent) { return intent.path.size() == 1; });
  }

  SimCore core;
  std::int64_t now = 1'000'000'000;
  std::vector<session::RosterEntry> entries;
  std::vector<session::RosterEntry> roster;
  std::size_t echoed = 0;
  std::vector<session::Control> controls;
  std::vector<session::SessionEnd> ends;
  std::vector<session::Intent> intents;

 private:
  session::RosterEntry& participant(const std::string& name, session::Role role) {
    for (session::RosterEntry& entry : entries) {
      if (entry.name == name) return entry;
    }
    session::RosterEntry entry;
    entry.origin = origin(name);
    entry.role = role;
    entry.name = name;
    entry.session = "s";
    return entries.emplace_back(entry);
  }
};

TEST(SimCore, ReportsMissingParticipantsAndFailsAfterItsTimeout) {
  SimulatedSession session{kTwoUsers};
  session.run(1);
  EXPECT_EQ(session.core.state(), SimState::kGathering);
  EXPECT_EQ(session.core.stop_reason(),
            "no HRTC #1, #2 in session 's'; no host serves object #1, #2; found no HRTC and no object");
  session.run(3);
  EXPECT_THAT(session.core.stop_reason(), HasSubstr("(do all programs have the same --session and --domain, "));
  session.run(2);
  EXPECT_EQ(session.core.state(), SimState::kFailed);
  EXPECT_THAT(session.core.report().stop_reason, HasSubstr("waited 5 s"));
  EXPECT_TRUE(session.roster.back().leaving);
  EXPECT_THAT(session.controls, IsEmpty());
}

TEST(SimCore, JoinsWithOneParticipantPerHrtc) {
  SimulatedSession session{kTwoUsers};
  session.add_hrtc("left");
  session.add_hrtc("right");
  session.add_object("a");
  session.add_object("b");
  session.run(0.2);
  EXPECT_EQ(session.core.state(), SimState::kJoining);
  EXPECT_THAT(session.core.stop_reason(), HasSubstr("not served: ann by left, bob by right"));
  const session::RosterEntry& second = session.roster.back();
  const session::RosterEntry& first = session.roster[session.roster.size() - 2];
  EXPECT_EQ(first.name, "sim");
  EXPECT_EQ(first.requested_hrtc, "left");
  EXPECT_THAT(first.users, ElementsAre("ann"));
  EXPECT_EQ(second.name, "sim.2");
  EXPECT_EQ(second.origin.participant, session::id_of("sim.2"));
  EXPECT_EQ(second.requested_hrtc, "right");
  EXPECT_THAT(second.users, ElementsAre("bob"));
}

TEST(SimCore, ResolvesNumbersModuloTheNumberOfParticipants) {
  SimulatedSession session{kTwoUsers};
  session.add_hrtc("only");
  session.add_object("a");
  session.run(0.5);
  EXPECT_EQ(session.core.state(), SimState::kGathering);
  session.run(1);
  EXPECT_EQ(session.core.state(), SimState::kJoining);
  EXPECT_THAT(session.roster.back().users, ElementsAre("ann", "bob"));
}

TEST(SimCore, StartsWhenAllUsersAreServedAndEndsAfterTheDuration) {
  SimulatedSession session{kTwoUsers};
  session.add_host("host");
  session.add_hrtc_for_each_user();
  session.run(0.1);
  ASSERT_EQ(session.core.state(), SimState::kRunning);
  ASSERT_EQ(session.controls.size(), 1u);
  EXPECT_EQ(session.controls[0].kind, ControlKind::kStart);
  ASSERT_GT(session.intents.size(), 2u);
  EXPECT_TRUE(session.only_start_positions());
  session.intents.clear();
  session.core.on_probe_state(session.state_of("ann", "left"), session.now + kSessionAhead);
  session.core.on_probe_state(session.state_of("bob", "right"), session.now + kSessionAhead);
  session.run(0.5);
  ASSERT_GT(session.intents.size(), 80u);
  for (const session::Intent& intent : session.intents) {
    const bool ann = intent.user_id == session::id_of("ann");
    EXPECT_EQ(intent.origin.participant, session::id_of(ann ? "sim" : "sim.2"));
    EXPECT_GT(intent.path[0].session_time_ns, kSessionAhead);
  }
  session.run(0.5);
  EXPECT_EQ(session.core.state(), SimState::kEnding);
  EXPECT_EQ(session.ends.size(), 1u);
  for (const char* name : {"host", "left", "right"}) {
    EXPECT_EQ(session.core.state(), SimState::kEnding);
    session.core.on_metrics({session.origin(name), {{"x", 1}}}, session.now);
  }
  session.run(0.01);
  EXPECT_EQ(session.core.state(), SimState::kEnded);
  EXPECT_TRUE(session.roster.back().leaving);
  EXPECT_EQ(session.core.report().stop_reason, "");
  const Report report = session.core.report();
  EXPECT_NEAR(report.duration, 1, 0.02);
  EXPECT_EQ(report.records_total, 2000u);
  EXPECT_EQ(std::count_if(report.events.begin(), report.events.end(),
                          [](const ReportEvent& event) {
                            return event.text.find("ended during action 1 of 2 of the script") != std::string::npos;
                          }),
            2);
}

TEST(SimCore, ReportsTimesOfEventsRelativeToTheStart) {
  SimulatedSession session{kTwoUsers};
  session.add_host("host");
  session.add_object("a");
  session.run(0.5);
  session.add_hrtc("left", {"ann", "bob"});
  session.run(1.2);  // after the settle time, #2 also resolves to the only HRTC and object
  ASSERT_EQ(session.core.state(), SimState::kRunning);
  session.run(0.2);
  session.add_host("later host");
  session.run(0.1);
  const auto time_of = [&](const std::string& text) {
    for (const ReportEvent& event : session.core.report().events)
      if (event.text.find(text) != std::string::npos) return event.time;
    return 1e9;
  };
  const double host = time_of("'host' joined"), hrtc = time_of("'left' joined");
  EXPECT_LT(host, -0.5);
  EXPECT_NEAR(hrtc - host, 0.5, 0.06);
  EXPECT_LT(hrtc, 0);
  EXPECT_GT(time_of("'later host' joined"), 0);
}

TEST(SimCore, EndsAfterATimeoutWithoutTheLastFigures) {
  SimulatedSession session{kTwoUsers};
  session.add_hrtc_for_all();
  session.run(2.2);
  ASSERT_EQ(session.core.state(), SimState::kEnding);
  session.run(1.1);
  EXPECT_EQ(session.core.state(), SimState::kEnded);
}

TEST(SimCore, EndsTheSessionWhenItIsStopped) {
  SimulatedSession session{kTwoUsers};
  session.add_hrtc_for_all();
  session.run(1.2);
  ASSERT_EQ(session.core.state(), SimState::kRunning);
  session.core.stop("interrupted");
  session.run(0.01);
  ASSERT_EQ(session.ends.size(), 1u);
  EXPECT_EQ(session.ends[0].text, "interrupted");
  EXPECT_EQ(session.core.report().stop_reason, "interrupted");
}

TEST(SimCore, EndsWithTheSessionAndReportsARepeatedEmergencyStopOnce) {
  SimulatedSession session{kTwoUsers};
  session.add_hrtc_for_all();
  session.run(1.2);
  ASSERT_EQ(session.core.state(), SimState::kRunning);
  for (int i = 0; i < 3; ++i) session.core.on_stop({session.origin("operator"), 1, "needle bent"});
  session.core.on_end({session.origin("operator"), "enough"});
  session.run(0.01);
  int stops = 0;
  for (const ReportEvent& event : session.core.report().events) stops += event.text == "emergency stop: needle bent";
  EXPECT_EQ(stops, 1);
  EXPECT_EQ(session.core.state(), SimState::kEnding);
  EXPECT_EQ(session.core.report().stop_reason, "ended by another participant: enough");
}

TEST(SimCore, LeavesBeforeItsUsersJoinIfAnEarlierProgramHasItsName) {
  SimulatedSession session{kTwoUsers, 1};
  session.add_hrtc_for_all();
  session.add_client("sim", 5);
  session.run(1);
  EXPECT_EQ(session.core.state(), SimState::kFailed);
  EXPECT_TRUE(session.core.name_taken());
  EXPECT_THAT(session.core.stop_reason(), HasSubstr("'sim' is already in session 's'"));
  EXPECT_THAT(session.core.stop_reason(), HasSubstr("another --name"));
  EXPECT_TRUE(session.roster.back().leaving);
  for (const session::RosterEntry& entry : session.roster) EXPECT_THAT(entry.users, IsEmpty());
  EXPECT_THAT(session.ends, IsEmpty()) << "the session continues";
}

TEST(SimCore, ContinuesAndReportsItIfALaterProgramHasItsName) {
  SimulatedSession session{kTwoUsers, 1};
  session.add_hrtc_for_all();
  session.add_client("sim", 12);
  session.run(1.5);
  EXPECT_EQ(session.core.state(), SimState::kRunning);
  EXPECT_FALSE(session.core.name_taken());
  const std::vector<ReportEvent> events = session.core.report().events;
  EXPECT_TRUE(std::any_of(events.begin(), events.end(),
                          [](const ReportEvent& event) { return event.text.find("'sim' runs twice") == 7; }));
}

TEST(SimCore, LeavesIfAProgramHasTheNameOfItsSecondParticipant) {
  SimulatedSession session{kTwoUsers};
  session.add_hrtc_for_each_user();
  session.add_client("sim.2", 5);
  session.run(0.1);
  EXPECT_EQ(session.core.state(), SimState::kFailed);
  EXPECT_THAT(session.core.stop_reason(), HasSubstr("'sim.2' is already in session 's'"));

  SimulatedSession later_conflict{kTwoUsers};
  later_conflict.add_hrtc_for_each_user();
  later_conflict.run(0.1);
  ASSERT_EQ(later_conflict.core.state(), SimState::kRunning);
  later_conflict.add_client("sim.2", 5);
  for (int heartbeat = 0; heartbeat < 5; ++heartbeat) {
    later_conflict.echo();
    later_conflict.run(0.1);
  }
  EXPECT_EQ(later_conflict.core.state(), SimState::kFailed);
  EXPECT_THAT(later_conflict.core.stop_reason(), HasSubstr("'sim.2' is already in session 's'"));
}

TEST(SimCore, IgnoresItsOwnSamples) {
  SimulatedSession session{kTwoUsers};
  session.add_hrtc_for_each_user();
  for (int heartbeat = 0; heartbeat < 8; ++heartbeat) {
    session.run(0.1);
    session.echo();
  }
  EXPECT_EQ(session.core.state(), SimState::kRunning);
  for (const ReportEvent& event : session.core.report().events) EXPECT_EQ(event.text.find("'sim"), std::string::npos);
}

TEST(SimCore, JoinsUsersOnlyAfterTheNameCheck) {
  SimulatedSession session{kTwoUsers, 1};
  session.add_hrtc("left", {"ann", "bob"});
  session.add_hrtc("right");
  session.add_object("a");
  session.add_object("b");
  session.run(0.9);
  EXPECT_EQ(session.core.state(), SimState::kGathering);
  EXPECT_EQ(session.core.stop_reason(), "");
  session.run(0.2);
  EXPECT_GE(session.core.state(), SimState::kJoining);
}

TEST(SimCore, IgnoresOtherSessions) {
  SimulatedSession session{kTwoUsers};
  session.add_hrtc("left");
  session.entries.back().origin.session = session::id_of("other");
  session::CatalogueEntry entry;
  entry.origin = session.origin("host");
  entry.origin.session = session::id_of("other");
  entry.object = "a";
  session.core.on_catalogue(entry);
  session.run(2);
  EXPECT_THAT(session.core.stop_reason(), HasSubstr("no HRTC #1"));
  EXPECT_THAT(session.core.stop_reason(), HasSubstr("no host serves object #1"));
}

TEST(SimCore, AcceptsProbeStatesOnlyFromTheHrtcOfTheUser) {
  SimulatedSession session{kTwoUsers};
  session.add_hrtc("left", {"ann", "bob"});
  session.add_hrtc("right");
  session.add_object("a");
  session.add_object("b");
  session.entries[1].served_users = {{"bob", 0}};
  session.run(0.1);
  ASSERT_EQ(session.core.state(), SimState::kRunning);
  session.core.on_probe_state(session.state_of("ann", "right"), session.now + kSessionAhead);
  session.run(0.1);
  EXPECT_TRUE(session.only_start_positions());
  EXPECT_EQ(session.core.report().users[0].touch.states, 0u);
}

TEST(SimCore, StoresABoundedNumberOfFiguresOfAParticipant) {
  SimulatedSession session{kTwoUsers};
  session.add_host("host");
  session.run(0.1);
  for (int i = 0; i < 10'000; ++i)
    session.core.on_metrics({session.origin("host"), {{"figure " + std::to_string(i), 1}}}, session.now);
  session.core.on_metrics({session.origin("host"), {{"figure 0", 2}}}, session.now);

  const std::vector<ParticipantReport> participants = session.core.report().participants;
  ASSERT_EQ(participants.size(), 1u);
  EXPECT_EQ(participants[0].figures.size(), 2 * session::kMaxFigures);
  EXPECT_EQ(participants[0].figures.at("figure 0"), 2) << "stored figures are still updated";
}

TEST(SimCore, ReportsAHostThatLeavesAndReturns) {
  SimulatedSession session{kTwoUsers};
  session.add_host("host");
  session.add_hrtc_for_all();
  session.run(1.2);
  session.remove("host");
  session.run(0.6);
  ASSERT_EQ(session.core.state(), SimState::kRunning);
  const auto host_report = [&] {
    const Report report = session.core.report();
    return *std::find_if(report.participants.begin(), report.participants.end(),
                         [](const ParticipantReport& participant) { return participant.name == "host"; });
  };
  EXPECT_FALSE(host_report().present_at_end);
  session.add_host("host");
  session.entries.back().origin.incarnation = 2;
  session.run(0.1);
  EXPECT_TRUE(host_report().present_at_end);
  int host_events = 0;
  for (const ReportEvent& event : session.core.report().events) {
    if (event.time > 0 && event.text.find("host") != std::string::npos) ++host_events;
  }
  EXPECT_GE(host_events, 2);
}

}  // namespace
}  // namespace tactus::client_sim
