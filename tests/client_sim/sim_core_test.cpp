#include "client_sim/sim_core.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <string>
#include <vector>

namespace tactus::client_sim {
namespace {

using session::ControlKind;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

constexpr std::int64_t kMs = 1'000'000;
constexpr std::int64_t kSessionAhead = 5'000'000'000;  // session time minus this program's

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

/// The other participants of a session, as messages.
class World {
 public:
  explicit World(const std::string& scenario, double name_check = 0)
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

  void hrtc(const std::string& name, const std::vector<std::string>& users = {}) {
    session::RosterEntry& entry = participant(name, session::Role::kHrtc);
    entry.slots.clear();
    for (const std::string& user : users) entry.slots.push_back({user, static_cast<std::uint32_t>(entry.slots.size())});
  }
  void host(const std::string& name) { (void)participant(name, session::Role::kHost); }
  /// Another program of users, with heartbeats under `name`.
  void rival(const std::string& name, std::uint64_t incarnation) {
    participant(name, session::Role::kClient).origin.incarnation = incarnation;
  }
  void silence(const std::string& name) {
    entries.erase(std::find_if(entries.begin(), entries.end(), [&](const auto& entry) { return entry.name == name; }));
  }

  void object(const std::string& name) {
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
      SimMessages out = core.tick(now, now + kSessionAhead);
      for (auto& entry : out.roster) roster.push_back(entry);
      for (auto& control : out.control) controls.push_back(control);
      for (auto& one : out.ends) ends.push_back(one);
      for (auto& intent : out.intents) intents.push_back(intent);
    }
  }

  /// Returns the messages that this program has sent since the last call to it, as the network does.
  void echo() {
    for (; echoed < roster.size(); ++echoed) core.on_roster(roster[echoed], now);
  }

  /// A user without a probe state only sends a start position: one point.
  [[nodiscard]] bool only_places_to_start() const {
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

TEST(SimCore, ReportsMissingPartsAndFailsAfterItsPatience) {
  World world{kTwoUsers};
  world.run(1);
  EXPECT_EQ(world.core.state(), SimState::kGathering);
  EXPECT_THAT(world.core.stop_reason(), HasSubstr("no HRTC #1, #2 in session 's'; no host serves object #1, #2"));
  world.run(5);
  EXPECT_EQ(world.core.state(), SimState::kFailed);
  EXPECT_THAT(world.core.report().stop_reason, HasSubstr("waited 5 s"));
  EXPECT_TRUE(world.roster.back().leaving);
  EXPECT_THAT(world.controls, IsEmpty());
}

TEST(SimCore, JoinsWithOneParticipantPerHrtc) {
  World world{kTwoUsers};
  world.hrtc("left");
  world.hrtc("right");
  world.object("a");
  world.object("b");
  world.run(0.2);
  EXPECT_EQ(world.core.state(), SimState::kJoining);
  EXPECT_THAT(world.core.stop_reason(), HasSubstr("not served: ann by left, bob by right"));
  const session::RosterEntry& second = world.roster.back();
  const session::RosterEntry& first = world.roster[world.roster.size() - 2];
  EXPECT_EQ(first.name, "sim");
  EXPECT_EQ(first.requested_hrtc, "left");
  EXPECT_THAT(first.users, ElementsAre("ann"));
  EXPECT_EQ(second.name, "sim.2");
  EXPECT_EQ(second.origin.participant, session::id_of("sim.2"));
  EXPECT_EQ(second.requested_hrtc, "right");
  EXPECT_THAT(second.users, ElementsAre("bob"));
}

TEST(SimCore, ResolvesNumbersModuloThePresentOnes) {
  World world{kTwoUsers};
  world.hrtc("only");
  world.object("a");
  world.run(0.5);
  EXPECT_EQ(world.core.state(), SimState::kGathering);
  world.run(1);
  EXPECT_EQ(world.core.state(), SimState::kJoining);
  EXPECT_THAT(world.roster.back().users, ElementsAre("ann", "bob"));
}

TEST(SimCore, StartsWhenAllAreServedActsAndEndsOnTime) {
  World world{kTwoUsers};
  world.host("host");
  world.hrtc("left", {"ann"});
  world.hrtc("right", {"bob"});
  world.object("a");
  world.object("b");
  world.run(0.1);
  ASSERT_EQ(world.core.state(), SimState::kRunning);
  ASSERT_EQ(world.controls.size(), 1u);
  EXPECT_EQ(world.controls[0].kind, ControlKind::kStart);
  ASSERT_GT(world.intents.size(), 2u);
  EXPECT_TRUE(world.only_places_to_start());
  world.intents.clear();
  world.core.on_probe_state(world.state_of("ann", "left"), world.now + kSessionAhead);
  world.core.on_probe_state(world.state_of("bob", "right"), world.now + kSessionAhead);
  world.run(0.5);
  ASSERT_GT(world.intents.size(), 80u);
  for (const session::Intent& intent : world.intents) {
    const bool ann = intent.user_id == session::id_of("ann");
    EXPECT_EQ(intent.origin.participant, session::id_of(ann ? "sim" : "sim.2"));
    EXPECT_GT(intent.path[0].session_time_ns, kSessionAhead);
  }
  world.run(0.5);
  EXPECT_EQ(world.core.state(), SimState::kEnding);
  EXPECT_EQ(world.ends.size(), 1u);
  for (const char* name : {"host", "left", "right"}) {
    EXPECT_EQ(world.core.state(), SimState::kEnding);
    world.core.on_metrics({world.origin(name), {{"x", 1}}}, world.now);
  }
  world.run(0.01);
  EXPECT_EQ(world.core.state(), SimState::kEnded);
  EXPECT_TRUE(world.roster.back().leaving);
  EXPECT_EQ(world.core.report().stop_reason, "");
  EXPECT_NEAR(world.core.report().duration, 1, 0.02);
  EXPECT_EQ(world.core.report().records_total, 2000u);
}

TEST(SimCore, DatesEventsFromTheStartOfTheSession) {
  World world{kTwoUsers};
  world.host("host");
  world.object("a");
  world.run(0.5);
  world.hrtc("left", {"ann", "bob"});
  world.run(1.2);  // resolves numbers modulo after the settle time
  ASSERT_EQ(world.core.state(), SimState::kRunning);
  world.run(0.2);
  world.host("late host");
  world.run(0.1);
  const auto time_of = [&](const std::string& text) {
    for (const ReportEvent& event : world.core.report().events)
      if (event.text.find(text) != std::string::npos) return event.time;
    return 1e9;
  };
  const double host = time_of("'host' joined"), hrtc = time_of("'left' joined");
  EXPECT_LT(host, -0.5);
  EXPECT_NEAR(hrtc - host, 0.5, 0.06);
  EXPECT_LT(hrtc, 0);
  EXPECT_GT(time_of("'late host' joined"), 0);
}

TEST(SimCore, EndsWithoutTheLastFiguresAfterAWhile) {
  World world{kTwoUsers};
  world.hrtc("left", {"ann", "bob"});
  world.object("a");
  world.run(2.2);
  ASSERT_EQ(world.core.state(), SimState::kEnding);
  world.run(1.1);
  EXPECT_EQ(world.core.state(), SimState::kEnded);
}

TEST(SimCore, StopsInOrderOnRequest) {
  World world{kTwoUsers};
  world.hrtc("left", {"ann", "bob"});
  world.object("a");
  world.run(1.2);
  ASSERT_EQ(world.core.state(), SimState::kRunning);
  world.core.stop("interrupted");
  world.run(0.01);
  ASSERT_EQ(world.ends.size(), 1u);
  EXPECT_EQ(world.ends[0].text, "interrupted");
  EXPECT_EQ(world.core.report().stop_reason, "interrupted");
}

TEST(SimCore, EndsWithTheSessionAndReportsARepeatedStopOnce) {
  World world{kTwoUsers};
  world.hrtc("left", {"ann", "bob"});
  world.object("a");
  world.run(1.2);
  ASSERT_EQ(world.core.state(), SimState::kRunning);
  for (int i = 0; i < 3; ++i) world.core.on_stop({world.origin("operator"), 1, "needle bent"});
  world.core.on_end({world.origin("operator"), "enough"});
  world.run(0.01);
  int stops = 0;
  for (const ReportEvent& event : world.core.report().events) stops += event.text == "emergency stop: needle bent";
  EXPECT_EQ(stops, 1);
  EXPECT_EQ(world.core.state(), SimState::kEnding);
  EXPECT_EQ(world.core.report().stop_reason, "ended by another participant: enough");
}

TEST(SimCore, LeavesForAnOlderProgramOfItsNameBeforeUsersJoin) {
  World world{kTwoUsers, 1};
  world.hrtc("left", {"ann", "bob"});
  world.object("a");
  world.rival("sim", 5);
  world.run(1);
  EXPECT_EQ(world.core.state(), SimState::kFailed);
  EXPECT_TRUE(world.core.name_taken());
  EXPECT_THAT(world.core.stop_reason(), HasSubstr("'sim' was in session 's' before"));
  EXPECT_THAT(world.core.stop_reason(), HasSubstr("another --name"));
  EXPECT_TRUE(world.roster.back().leaving);
  for (const session::RosterEntry& entry : world.roster) EXPECT_THAT(entry.users, IsEmpty());
  EXPECT_THAT(world.ends, IsEmpty()) << "the session goes on";
}

TEST(SimCore, ContinuesAndReportsWhenALaterProgramHasItsName) {
  World world{kTwoUsers, 1};
  world.hrtc("left", {"ann", "bob"});
  world.object("a");
  world.rival("sim", 12);
  world.run(1.5);
  EXPECT_EQ(world.core.state(), SimState::kRunning);
  EXPECT_FALSE(world.core.name_taken());
  const std::vector<ReportEvent> events = world.core.report().events;
  EXPECT_TRUE(std::any_of(events.begin(), events.end(),
                          [](const ReportEvent& event) { return event.text.find("'sim' is there twice") == 7; }));
}

TEST(SimCore, LeavesForAProgramWithTheNameOfItsSecondParticipant) {
  World world{kTwoUsers};
  world.hrtc("left", {"ann"});
  world.hrtc("right", {"bob"});
  world.object("a");
  world.object("b");
  world.rival("sim.2", 5);
  world.run(0.1);
  EXPECT_EQ(world.core.state(), SimState::kFailed);
  EXPECT_THAT(world.core.stop_reason(), HasSubstr("'sim.2' was in session 's' before"));

  World later{kTwoUsers};
  later.hrtc("left", {"ann"});
  later.hrtc("right", {"bob"});
  later.object("a");
  later.object("b");
  later.run(0.1);
  ASSERT_EQ(later.core.state(), SimState::kRunning);
  later.rival("sim.2", 5);
  for (int beat = 0; beat < 5; ++beat) {
    later.echo();
    later.run(0.1);
  }
  EXPECT_EQ(later.core.state(), SimState::kFailed);
  EXPECT_THAT(later.core.stop_reason(), HasSubstr("'sim.2' was in session 's' before"));
}

TEST(SimCore, IgnoresItsOwnSamples) {
  World world{kTwoUsers};
  world.hrtc("left", {"ann"});
  world.hrtc("right", {"bob"});
  world.object("a");
  world.object("b");
  for (int beat = 0; beat < 8; ++beat) {
    world.run(0.1);
    world.echo();
  }
  EXPECT_EQ(world.core.state(), SimState::kRunning);
  for (const ReportEvent& event : world.core.report().events) EXPECT_EQ(event.text.find("'sim"), std::string::npos);
}

TEST(SimCore, JoinsUsersOnlyAfterTheNameCheck) {
  World world{kTwoUsers, 1};
  world.hrtc("left", {"ann", "bob"});
  world.hrtc("right");
  world.object("a");
  world.object("b");
  world.run(0.9);
  EXPECT_EQ(world.core.state(), SimState::kGathering);
  EXPECT_EQ(world.core.stop_reason(), "");
  world.run(0.2);
  EXPECT_GE(world.core.state(), SimState::kJoining);
}

TEST(SimCore, IgnoresOtherSessions) {
  World world{kTwoUsers};
  world.hrtc("left");
  world.entries.back().origin.session = session::id_of("other");
  session::CatalogueEntry entry;
  entry.origin = world.origin("host");
  entry.origin.session = session::id_of("other");
  entry.object = "a";
  world.core.on_catalogue(entry);
  world.run(2);
  EXPECT_THAT(world.core.stop_reason(), HasSubstr("no HRTC #1"));
  EXPECT_THAT(world.core.stop_reason(), HasSubstr("no host serves object #1"));
}

TEST(SimCore, AcceptsProbeStatesOnlyFromItsHrtc) {
  World world{kTwoUsers};
  world.hrtc("left", {"ann", "bob"});
  world.hrtc("right");
  world.object("a");
  world.object("b");
  world.entries[1].slots = {{"bob", 0}};
  world.run(0.1);
  ASSERT_EQ(world.core.state(), SimState::kRunning);
  world.core.on_probe_state(world.state_of("ann", "right"), world.now + kSessionAhead);
  world.run(0.1);
  EXPECT_TRUE(world.only_places_to_start());
  EXPECT_EQ(world.core.report().users[0].touch.states, 0u);
}

TEST(SimCore, ReportsAHostThatLeavesAndReturns) {
  World world{kTwoUsers};
  world.host("host");
  world.hrtc("left", {"ann", "bob"});
  world.object("a");
  world.run(1.2);
  world.silence("host");
  world.run(0.6);
  ASSERT_EQ(world.core.state(), SimState::kRunning);
  const auto participant = [&] {
    const Report report = world.core.report();
    return *std::find_if(report.participants.begin(), report.participants.end(),
                         [](const ParticipantReport& p) { return p.name == "host"; });
  };
  EXPECT_FALSE(participant().present_at_end);
  world.host("host");
  world.entries.back().origin.incarnation = 2;
  world.run(0.1);
  EXPECT_TRUE(participant().present_at_end);
  int published = 0;
  for (const ReportEvent& event : world.core.report().events) {
    if (event.time > 0 && event.text.find("host") != std::string::npos) ++published;
  }
  EXPECT_GE(published, 2);
}

}  // namespace
}  // namespace tactus::client_sim
