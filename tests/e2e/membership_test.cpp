/// Which programs join a session, which are refused, and which users an HRTC serves.
#include "session/figures.hpp"
#include "tests/e2e/session_test.hpp"

namespace tactus::e2e {
namespace {

namespace figures = session::figures;
using Seen = Observer::Seen;
using testing::HasSubstr;
using testing::Not;

class MembershipTest : public SessionTest {};

/// A client that requests probes of an HRTC for its users.
struct Client {
  Client(const wire::SessionAddress& address, const std::string& hrtc, const std::vector<std::string>& users = {})
      : participants{address} {
    entry.role = session::Role::kClient;
    entry.name = address.participant;
    entry.session = address.session;
    entry.requested_hrtc = hrtc;
    entry.users = users;
  }
  void send_entry() {
    entry.origin = participants.origin();
    ++entry.heartbeat;
    ASSERT_EQ(roster.send(entry), wire::SendStatus::kSent);
  }
  wire::Participants participants;
  wire::Writer<session::RosterEntry> roster{participants, wire::topics::kRoster};
  session::RosterEntry entry;
};

constexpr char kLongTouch[] = R"(name: one long touch
duration: 120
users:
  - name: ann
    script: [{approach: {object: "#1", speed: 0.2}}, {hold: {seconds: 100, force: 1}}]
)";

constexpr char kWait[] = R"(name: wait
duration: 60
users:
  - name: ann
    script: [{wait: {seconds: 60}}]
)";

TEST_F(MembershipTest, TheLaterOfTwoProgramsWithOneNameExitsAndTheFirstContinues) {
  Observer observer{address("observer")};
  Process museum{host("museum", models().sphere)};
  Process desk{hrtc("desk")};
  ASSERT_TRUE(observer.until([](const Seen& seen) { return seen.is_present("museum") && seen.is_present("desk"); }));

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

  Process users{sim(kOneTouch)};
  EXPECT_EQ(users.wait(60s), 0) << users.output() << desk.output() << museum.output();
  EXPECT_GT(observer.seen().user("ann").exact, 0u);
  EXPECT_TRUE(exits_with(0, desk));
  EXPECT_TRUE(exits_with(0, museum));
}

TEST_F(MembershipTest, AnHrtcFreesTheSlotOfAUserWhomTheClientNoLongerLists) {
  Observer observer{address("observer")};
  Process desk{hrtc("desk")};
  Client client{address("visitor"), "desk"};
  // Requests probes for `users` until the HRTC serves the users `expected`.
  const auto request_slots = [&](const std::string& hrtc, const std::vector<std::string>& users,
                                 const std::vector<std::string>& expected) {
    client.entry.requested_hrtc = hrtc;
    client.entry.users = users;
    const auto serves_expected = [&](const Seen& seen) {
      if (!seen.is_present("desk")) return false;
      std::vector<std::string> served;
      for (const session::UserProbe& probe : seen.roster.at("desk").served_users) served.push_back(probe.user);
      return served == expected;
    };
    for (const auto end = std::chrono::steady_clock::now() + kWatchdog; std::chrono::steady_clock::now() < end;) {
      client.send_entry();
      if (observer.until(serves_expected, 100ms)) return true;
    }
    return false;
  };

  EXPECT_TRUE(request_slots("desk", {"ann", "bob"}, {"ann", "bob"})) << desk.output();
  EXPECT_TRUE(request_slots("desk", {"bob"}, {"bob"})) << desk.output();
  EXPECT_TRUE(request_slots("desk", {"cid", "bob"}, {"cid", "bob"})) << desk.output();
  EXPECT_TRUE(request_slots("another", {"cid", "bob"}, {})) << desk.output();
  desk.signal(SIGINT);
  EXPECT_TRUE(exits_with(0, desk));
}

TEST_F(MembershipTest, TheLaterOfTwoSimulationsWithOneNameExitsAndTheSessionContinues) {
  Observer observer{address("observer")};
  Process museum{host("museum", models().sphere)};
  Process desk{hrtc("desk")};
  Process users{sim(kLongTouch)};
  ASSERT_TRUE(observer.until([](const Seen& seen) { return seen.user("ann").exact > 0; })) << users.output();

  Process second{in_session("sim", {"--scenario", "touch", "--json", path("second.json")})};
  EXPECT_EQ(second.wait(), 2) << second.output();
  EXPECT_THAT(second.output(), HasSubstr("'sim'"));
  EXPECT_THAT(second.output(), HasSubstr("another --name"));
  EXPECT_THAT(second.output(), HasSubstr(session_));
  EXPECT_FALSE(std::filesystem::exists(path("second.json")));

  ASSERT_TRUE(users.running()) << users.output();
  observer.forget_states();
  EXPECT_TRUE(observer.until([](const Seen& seen) { return seen.user("ann").exact > 100; }))
      << "states of the first simulation's user";
  users.signal(SIGINT);
  EXPECT_TRUE(exits_with(1, users));
  EXPECT_TRUE(exits_with(0, desk));
  EXPECT_TRUE(exits_with(0, museum));
}

TEST_F(MembershipTest, AProgramOfAnotherProtocolVersionIsRefusedWithBothVersionsNamed) {
  Observer observer{address("observer")};
  Process museum{host("museum", models().sphere)};
  Process desk{hrtc("desk")};
  Process users{sim(kWait)};
  ASSERT_TRUE(observer.until([](const Seen& seen) {
    return seen.is_present("museum") && seen.is_present("desk") && !seen.roster.at("desk").served_users.empty();
  })) << users.output();

  Client newcomer{address("newcomer"), "desk", {"eve"}};
  newcomer.entry.protocol = session::kProtocolVersion + 1;
  for (int sent = 0; sent < 10; ++sent) {
    newcomer.send_entry();
    const std::uint64_t received = observer.seen().roster.at("desk").heartbeat;
    ASSERT_TRUE(observer.until([&](const Seen& seen) { return seen.roster.at("desk").heartbeat > received; }));
  }

  const std::string refusal = "client 'newcomer' refused: found protocol version " +
                              std::to_string(session::kProtocolVersion + 1) + ", expected " +
                              std::to_string(session::kProtocolVersion);
  EXPECT_TRUE(museum.wait_for_line(refusal)) << museum.output();
  EXPECT_TRUE(desk.wait_for_line(refusal)) << desk.output();
  const Seen seen = observer.seen();
  for (const session::UserProbe& probe : seen.roster.at("desk").served_users) EXPECT_NE(probe.user, "eve");
  users.signal(SIGINT);
  EXPECT_TRUE(exits_with(1, users));
  EXPECT_THAT(users.output(), HasSubstr(refusal)) << "in the report";
}

TEST_F(MembershipTest, AClientThatLeavesFreesOnlyTheSlotsOfItsOwnUsers) {
  Observer observer{address("observer")};
  Process desk{hrtc("desk")};
  Client first{address("first"), "desk", {"ann"}}, second{address("second"), "desk", {"ann"}};
  Client elsewhere{address("elsewhere"), "another desk", {"ann"}};
  const auto serves_ann = [](const Seen& seen) {
    if (!seen.is_present("desk")) return false;
    const std::vector<session::UserProbe>& served_users = seen.roster.at("desk").served_users;
    return served_users.size() == 1 && served_users[0].user == "ann";
  };
  // Sends roster entries of `clients` until `condition` holds.
  const auto send_until = [&](const std::vector<Client*>& clients, const auto& condition) {
    for (int attempt = 0; attempt < 600; ++attempt) {
      for (Client* const client : clients) client->send_entry();
      if (observer.until(condition, 50ms)) return true;
    }
    return false;
  };
  const auto desk_logs = [&](const std::string& text) {
    return [&desk, text](const Seen&) { return desk.output().find(text) != std::string::npos; };
  };
  ASSERT_TRUE(send_until({&first}, serves_ann)) << desk.output();
  ASSERT_TRUE(send_until({&first, &elsewhere, &second}, [&](const Seen& seen) {
    return desk_logs("client 'elsewhere' joined")(seen) && desk_logs("user ann of client second refused")(seen);
  })) << desk.output();

  elsewhere.entry.leaving = true;
  ASSERT_TRUE(send_until({&first, &elsewhere, &second}, desk_logs("client 'elsewhere' left"))) << desk.output();
  const std::uint64_t received = observer.seen().roster.at("desk").heartbeat;
  ASSERT_TRUE(
      send_until({&first, &second}, [&](const Seen& seen) { return seen.roster.at("desk").heartbeat > received + 2; }));
  EXPECT_TRUE(serves_ann(observer.seen()));
  EXPECT_THAT(desk.output(), Not(HasSubstr("user ann has left")));

  first.entry.leaving = true;
  ASSERT_TRUE(send_until({&first, &second}, desk_logs("user ann has left"))) << desk.output();
  EXPECT_TRUE(send_until({&second}, serves_ann)) << "after the probe was freed";
  desk.signal(SIGTERM);
  EXPECT_TRUE(exits_with(0, desk));
}

TEST_F(MembershipTest, TwoSessionsOnOneDomainExchangeNothingThoughTheirParticipantsHaveEqualNames) {
  const std::string first_session = session_;
  Observer observer{address("observer")};
  Process museum{host("museum", models().organ)};
  Process desk{hrtc("desk")};
  session_ += ".other";
  Observer other_observer{address("observer")};
  Process other_museum{host("museum", models().sphere)};
  Process other_desk{hrtc("desk")};
  ASSERT_TRUE(
      other_observer.until([](const Seen& seen) { return seen.is_present("museum") && seen.is_present("desk"); }));
  ASSERT_TRUE(other_desk.wait_for_line("object sphere found")) << other_desk.output();
  session_ = first_session;

  Process users{sim(kOneTouch)};
  EXPECT_EQ(users.wait(60s), 0) << users.output();

  EXPECT_GT(observer.seen().user("ann").exact, 0u);
  EXPECT_TRUE(exits_with(0, desk));
  EXPECT_TRUE(exits_with(0, museum));
  EXPECT_THAT(desk.output(), HasSubstr("object organ found"));
  EXPECT_THAT(desk.output(), Not(HasSubstr("sphere")));
  // The first session has ended; later heartbeats and metrics show that the other session continues.
  const Seen other = other_observer.seen();
  ASSERT_TRUE(other_observer.until([&](const Seen& seen) {
    return seen.metrics_count("desk") > other.metrics_count("desk") + 1 &&
           seen.roster.at("museum").heartbeat > other.roster.at("museum").heartbeat + 2;
  }));
  EXPECT_TRUE(other_observer.seen().states.empty());
  EXPECT_EQ(other_observer.seen().figure("desk", figures::kRemoteProbes), 0);
  EXPECT_EQ(other_observer.seen().roster.count("sim"), 0u);
  EXPECT_THAT(other_desk.output(), Not(HasSubstr("organ")));
  other_desk.signal(SIGTERM);
  other_museum.signal(SIGTERM);
  EXPECT_TRUE(exits_with(0, other_desk));
  EXPECT_TRUE(exits_with(0, other_museum));
}

TEST_F(MembershipTest, AnHrtcExitsIfItFindsNoHostWithinItsTimeLimit) {
  Process desk{hrtc("desk", {"--wait-host", "2"})};
  EXPECT_EQ(desk.wait(), 1);
  EXPECT_THAT(desk.output(), HasSubstr("no host found in session " + session_ + " on domain " +
                                       std::to_string(domain_.first()) + " within 2 s"));
}

TEST_F(MembershipTest, ASimulationExitsAndNamesTheMissingHrtcAndObject) {
  Process sim_alone{in_session("sim", {"--scenario", "touch", "--patience", "1"})};
  EXPECT_EQ(sim_alone.wait(), 1);
  EXPECT_THAT(sim_alone.output(), HasSubstr("no HRTC #1 in session '" + session_ + "'; no host serves object #1"));
  EXPECT_THAT(sim_alone.output(), HasSubstr("waited 1 s"));

  Process desk{hrtc("desk")};
  ASSERT_TRUE(desk.wait_for_line("serves"));
  Process sim_without_host{in_session("sim", {"--scenario", "touch", "--patience", "10"})};
  EXPECT_EQ(sim_without_host.wait(), 1);
  EXPECT_THAT(sim_without_host.output(),
              HasSubstr("Stopped early: no host serves object #1; found HRTC desk and no object"));
  EXPECT_THAT(sim_without_host.output(), HasSubstr("waited 10 s"));
}

}  // namespace
}  // namespace tactus::e2e
