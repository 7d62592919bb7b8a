/// Who meets whom in a session, and who must not.
#include "session/figures.hpp"
#include "tests/e2e/session_test.hpp"

namespace tactus::e2e {
namespace {

namespace figures = session::figures;
using Seen = Observer::Seen;
using testing::HasSubstr;
using testing::Not;

class MeetingTest : public SessionTest {};

constexpr char kTouch[] = R"(name: one touch
duration: 30
users:
  - name: ann
    script: [{approach: {object: "#1", speed: 0.2}}, {hold: {seconds: 2, force: 1}}]
)";

constexpr char kTouchLong[] = R"(name: one long touch
duration: 120
users:
  - name: ann
    script: [{approach: {object: "#1", speed: 0.2}}, {hold: {seconds: 100, force: 1}}]
)";

constexpr char kStay[] = R"(name: stay
duration: 60
users:
  - name: ann
    script: [{wait: {seconds: 60}}]
)";

TEST_F(MeetingTest, TheLaterOfTwoProgramsWithOneNameEndsAndTheFirstGoesOn) {
  Observer observer{address("observer")};
  Process museum{host("museum", models().sphere)};
  Process desk{hrtc("desk")};
  ASSERT_TRUE(observer.until([](const Seen& seen) { return seen.is_here("museum") && seen.is_here("desk"); }));

  Process second_desk{hrtc("desk")};
  EXPECT_EQ(second_desk.wait(), 2) << second_desk.output();
  EXPECT_THAT(second_desk.output(), HasSubstr("desk"));
  EXPECT_THAT(second_desk.output(), HasSubstr("name"));
  EXPECT_THAT(second_desk.output(), HasSubstr(session_));
  Process second_museum{host("museum", models().organ)};
  EXPECT_EQ(second_museum.wait(), 2) << second_museum.output();
  EXPECT_THAT(second_museum.output(), HasSubstr("'museum'"));
  EXPECT_THAT(second_museum.output(), HasSubstr("another --name"));
  EXPECT_THAT(second_museum.output(), HasSubstr(session_));

  Process users{sim(kTouch)};
  EXPECT_EQ(users.wait(60s), 0) << users.output() << desk.output() << museum.output();
  EXPECT_GT(observer.seen().user("ann").exact, 0u);
  EXPECT_TRUE(ends_with(0, desk));
  EXPECT_TRUE(ends_with(0, museum));
}

TEST_F(MeetingTest, AUserWhomHisClientBringsNoMoreGivesHisProbeBack) {
  Observer observer{address("observer")};
  Process desk{hrtc("desk")};
  wire::Participants participants{address("visitor")};
  wire::Writer<session::RosterEntry> roster{participants, wire::topics::kRoster};
  session::RosterEntry entry;
  entry.role = session::Role::kClient;
  entry.name = "visitor";
  entry.session = session_;
  const auto seated = [&](const std::string& hrtc, const std::vector<std::string>& users,
                          const std::vector<std::string>& expected) {
    entry.requested_hrtc = hrtc;
    entry.users = users;
    const auto seen_so = [&](const Seen& seen) {
      std::vector<std::string> there;
      if (seen.is_here("desk"))
        for (const session::UserSlot& slot : seen.roster.at("desk").slots) there.push_back(slot.user);
      return seen.is_here("desk") && there == expected;
    };
    for (const auto end = std::chrono::steady_clock::now() + kWatchdog; std::chrono::steady_clock::now() < end;) {
      entry.origin = participants.origin();
      ++entry.heartbeat;
      EXPECT_EQ(roster.send(entry), wire::SendStatus::kSent);
      if (observer.until(seen_so, 100ms)) return true;
    }
    return false;
  };

  EXPECT_TRUE(seated("desk", {"ann", "bob"}, {"ann", "bob"})) << desk.output();
  EXPECT_TRUE(seated("desk", {"bob"}, {"bob"})) << desk.output();
  EXPECT_TRUE(seated("desk", {"cid", "bob"}, {"cid", "bob"})) << desk.output();
  EXPECT_TRUE(seated("another", {"cid", "bob"}, {})) << desk.output();
  desk.signal(SIGINT);
  EXPECT_TRUE(ends_with(0, desk));
}

TEST_F(MeetingTest, TheLaterOfTwoUsersProgramsWithOneNameEndsAndTheSessionGoesOn) {
  Observer observer{address("observer")};
  Process museum{host("museum", models().sphere)};
  Process desk{hrtc("desk")};
  Process users{sim(kTouchLong)};
  ASSERT_TRUE(observer.until([](const Seen& seen) { return seen.user("ann").exact > 0; })) << users.output();

  Process second{in_session("sim", {"--scenario", "touch", "--json", path("second.json")})};
  EXPECT_EQ(second.wait(), 2) << second.output();
  EXPECT_THAT(second.output(), HasSubstr("'sim'"));
  EXPECT_THAT(second.output(), HasSubstr("another --name"));
  EXPECT_THAT(second.output(), HasSubstr(session_));
  EXPECT_FALSE(std::filesystem::exists(path("second.json")));

  ASSERT_TRUE(users.running()) << users.output();
  observer.forget_states();
  EXPECT_TRUE(observer.until([](const Seen& seen) { return seen.user("ann").exact > 100; })) << "still served";
  users.signal(SIGINT);
  EXPECT_TRUE(ends_with(1, users));
  EXPECT_TRUE(ends_with(0, desk));
  EXPECT_TRUE(ends_with(0, museum));
}

TEST_F(MeetingTest, AProgramOfAnotherProtocolVersionIsRefusedWithBothVersionsNamed) {
  Observer observer{address("observer")};
  Process museum{host("museum", models().sphere)};
  Process desk{hrtc("desk")};
  Process users{sim(kStay)};
  ASSERT_TRUE(observer.until([](const Seen& seen) {
    return seen.is_here("museum") && seen.is_here("desk") && !seen.roster.at("desk").slots.empty();
  })) << users.output();

  wire::Participants participants{address("newcomer")};
  wire::Writer<session::RosterEntry> roster{participants, wire::topics::kRoster};
  session::RosterEntry entry;
  entry.protocol = session::kProtocolVersion + 1;
  entry.role = session::Role::kClient;
  entry.name = "newcomer";
  entry.session = session_;
  entry.requested_hrtc = "desk";
  entry.users = {"eve"};
  for (int beat = 0; beat < 10; ++beat) {
    entry.origin = participants.origin();
    ++entry.heartbeat;
    ASSERT_EQ(roster.send(entry), wire::SendStatus::kSent);
    const std::uint64_t received = observer.seen().roster.at("desk").heartbeat;
    ASSERT_TRUE(observer.until([&](const Seen& seen) { return seen.roster.at("desk").heartbeat > received; }));
  }

  const std::string refusal = "client 'newcomer' refused: it speaks protocol version " +
                              std::to_string(session::kProtocolVersion + 1) + ", we speak version " +
                              std::to_string(session::kProtocolVersion);
  EXPECT_TRUE(museum.wait_for_line(refusal)) << museum.output();
  EXPECT_TRUE(desk.wait_for_line(refusal)) << desk.output();
  const Seen seen = observer.seen();
  for (const session::UserSlot& slot : seen.roster.at("desk").slots) EXPECT_NE(slot.user, "eve");
  users.signal(SIGINT);
  EXPECT_TRUE(ends_with(1, users));
  EXPECT_THAT(users.output(), HasSubstr(refusal)) << "in the report";
}

TEST_F(MeetingTest, AClientThatLeavesTakesOnlyItsOwnUsersAlong) {
  Observer observer{address("observer")};
  Process desk{hrtc("desk")};
  struct Client {
    Client(const wire::SessionAddress& address, const std::string& hrtc) : participants{address} {
      entry.role = session::Role::kClient;
      entry.name = address.participant;
      entry.session = address.session;
      entry.requested_hrtc = hrtc;
      entry.users = {"ann"};
    }
    void beat() {
      entry.origin = participants.origin();
      ++entry.heartbeat;
      ASSERT_EQ(roster.send(entry), wire::SendStatus::kSent);
    }
    wire::Participants participants;
    wire::Writer<session::RosterEntry> roster{participants, wire::topics::kRoster};
    session::RosterEntry entry;
  };
  Client first{address("first"), "desk"}, elsewhere{address("elsewhere"), "another desk"};
  Client second{address("second"), "desk"};
  const auto serves_ann = [](const Seen& seen) {
    if (!seen.is_here("desk")) return false;
    const std::vector<session::UserSlot>& slots = seen.roster.at("desk").slots;
    return slots.size() == 1 && slots[0].user == "ann";
  };
  /// Beats until the observer or the HRTC's output shows it.
  const auto beat_until = [&](const std::vector<Client*>& clients, const auto& condition) {
    for (int times = 0; times < 600; ++times) {
      for (Client* const client : clients) client->beat();
      if (observer.until(condition, 50ms)) return true;
    }
    return false;
  };
  const auto says = [&](const std::string& line) {
    return [&desk, line](const Seen&) { return desk.output().find(line) != std::string::npos; };
  };
  ASSERT_TRUE(beat_until({&first}, serves_ann)) << desk.output();
  ASSERT_TRUE(beat_until({&first, &elsewhere, &second}, [&](const Seen& seen) {
    return says("client 'elsewhere' joined")(seen) && says("user ann of client second refused")(seen);
  })) << desk.output();

  elsewhere.entry.leaving = true;
  ASSERT_TRUE(beat_until({&first, &elsewhere, &second}, says("client 'elsewhere' left"))) << desk.output();
  const std::uint64_t received = observer.seen().roster.at("desk").heartbeat;
  ASSERT_TRUE(
      beat_until({&first, &second}, [&](const Seen& seen) { return seen.roster.at("desk").heartbeat > received + 2; }));
  EXPECT_TRUE(serves_ann(observer.seen()));
  EXPECT_THAT(desk.output(), Not(HasSubstr("user ann has left")));

  first.entry.leaving = true;
  ASSERT_TRUE(beat_until({&first, &second}, says("user ann has left"))) << desk.output();
  EXPECT_TRUE(beat_until({&second}, serves_ann)) << "the name is free again";
  desk.signal(SIGTERM);
  EXPECT_TRUE(ends_with(0, desk));
}

TEST_F(MeetingTest, TwoSessionsOnOneDomainNeverMeetThoughAllNamesAreTheSame) {
  const std::string ours = session_;
  Observer observer{address("observer")};
  Process museum{host("museum", models().organ)};
  Process desk{hrtc("desk")};
  session_ += ".other";
  Observer other_observer{address("observer")};
  Process other_museum{host("museum", models().sphere)};
  Process other_desk{hrtc("desk")};
  ASSERT_TRUE(other_observer.until([](const Seen& seen) { return seen.is_here("museum") && seen.is_here("desk"); }));
  ASSERT_TRUE(other_desk.wait_for_line("object sphere found")) << other_desk.output();
  session_ = ours;

  Process users{sim(kTouch)};
  EXPECT_EQ(users.wait(60s), 0) << users.output();

  EXPECT_GT(observer.seen().user("ann").exact, 0u);
  EXPECT_TRUE(ends_with(0, desk));
  EXPECT_TRUE(ends_with(0, museum));
  EXPECT_THAT(desk.output(), HasSubstr("object organ found"));
  EXPECT_THAT(desk.output(), Not(HasSubstr("sphere")));
  // The end of the one session is none of the other's; its next heartbeats show that it is alive.
  const Seen other = other_observer.seen();
  ASSERT_TRUE(other_observer.until([&](const Seen& seen) {
    return seen.metrics_of("desk") > other.metrics_of("desk") + 1 &&
           seen.roster.at("museum").heartbeat > other.roster.at("museum").heartbeat + 2;
  }));
  EXPECT_TRUE(other_observer.seen().states.empty());
  EXPECT_EQ(other_observer.seen().figure("desk", figures::kRemoteProbes), 0);
  EXPECT_EQ(other_observer.seen().roster.count("sim"), 0u);
  EXPECT_THAT(other_desk.output(), Not(HasSubstr("organ")));
  other_desk.signal(SIGTERM);
  other_museum.signal(SIGTERM);
  EXPECT_TRUE(ends_with(0, other_desk));
  EXPECT_TRUE(ends_with(0, other_museum));
}

TEST_F(MeetingTest, AControllerGivesUpWhenNoHostIsFoundInTheTimeItWasGiven) {
  Process desk{hrtc("desk", {"--wait-host", "2"})};
  EXPECT_EQ(desk.wait(), 1);
  EXPECT_THAT(desk.output(), HasSubstr("no host found in session " + session_ + " on domain " +
                                       std::to_string(domain_) + " within 2 s"));
}

TEST_F(MeetingTest, UsersGiveUpNamingWhatTheyMissed) {
  Process nobody{in_session("sim", {"--scenario", "touch", "--patience", "1"})};
  EXPECT_EQ(nobody.wait(), 1);
  EXPECT_THAT(nobody.output(), HasSubstr("no HRTC #1 in session '" + session_ + "'; no host serves object #1"));
  EXPECT_THAT(nobody.output(), HasSubstr("waited 1 s"));

  Process desk{hrtc("desk")};
  ASSERT_TRUE(desk.wait_for_line("serves"));
  Process no_host{in_session("sim", {"--scenario", "touch", "--patience", "10"})};
  EXPECT_EQ(no_host.wait(), 1);
  EXPECT_THAT(no_host.output(), HasSubstr("Stopped early: no host serves object #1, waited 10 s"));
}

}  // namespace
}  // namespace tactus::e2e
