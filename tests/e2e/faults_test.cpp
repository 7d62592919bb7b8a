/// What becomes of a session when one of its programs dies.
#include "session/figures.hpp"
#include "tests/e2e/session_test.hpp"

namespace tactus::e2e {
namespace {

namespace figures = session::figures;
using Seen = Observer::Seen;
using Clock = std::chrono::steady_clock;
using testing::HasSubstr;

class FaultsTest : public SessionTest {
 protected:
  /// Half a second of contact, all of it exact.
  static bool firmly_touches(const Seen& seen, const std::string& user) {
    const SeenStates states = seen.user(user);
    return states.in_contact >= 500 && states.exact == states.in_contact;
  }
  /// Forgets until contact is exact and stays so.
  testing::AssertionResult wait_for_firm_contact(Observer& observer, const std::string& user) {
    for (const auto end = Clock::now() + kWatchdog; Clock::now() < end;) {
      observer.forget_states();
      const auto decided = [&](const Seen& seen) {
        const SeenStates states = seen.user(user);
        return states.exact < states.in_contact || firmly_touches(seen, user);
      };
      if (observer.until(decided) && firmly_touches(observer.seen(), user)) return testing::AssertionSuccess();
    }
    return testing::AssertionFailure() << user << " never touched for long";
  }
};

TEST_F(FaultsTest, KillingAHostLeavesLoadedRegionsExactAndItsReturnGoesOnLoadingWhatIsMissing) {
  Observer observer{address("observer")};
  Process first_host{host("museum", models().organ)};
  Process desk{hrtc("desk")};
  Process holding{sim(R"(name: hold
duration: 120
users:
  - name: ann
    hrtc: desk
    script:
      - approach: {object: organ, direction: [0, 0, 1], speed: 0.15, until_force: 0.5}
      - hold: {seconds: 110, force: 1}
)")};
  ASSERT_TRUE(wait_for_firm_contact(observer, "ann")) << holding.output() << desk.output();
  ASSERT_TRUE(observer.until([](const Seen& seen) { return seen.figure("desk", figures::kRegionsReceived) > 0; }));

  first_host.signal(SIGKILL);
  ASSERT_EQ(first_host.wait(), 128 + SIGKILL);
  observer.forget_states();

  EXPECT_TRUE(desk.wait_for_line("host 'museum' is gone"));
  ASSERT_TRUE(observer.until([](const Seen& seen) { return seen.user("ann").in_contact >= 1500; }));
  const SeenStates orphaned = observer.seen().user("ann");
  EXPECT_EQ(orphaned.exact, orphaned.in_contact) << "while nothing new was needed";
  const std::uint64_t metrics = observer.seen().metrics_of("desk");
  ASSERT_TRUE(observer.until([&](const Seen& seen) { return seen.metrics_of("desk") > metrics + 1; }));
  const Seen without_host = observer.seen();

  Process second_host{host("museum", models().organ)};
  Process exploring{sim(R"(name: explore
duration: 120
users:
  - name: bob
    hrtc: desk
    script:
      - approach: {object: organ, direction: [1, 0, 0], speed: 0.15, until_force: 0.5}
      - follow: {speed: 0.05, force: 1.5, seconds: 110, pattern: circle}
)",
                        {"--name", "sim2"})};

  const double received = without_host.figure("desk", figures::kRegionsReceived);
  EXPECT_TRUE(observer.until([&](const Seen& seen) {
    return seen.figure("desk", figures::kRegionsReceived) > received + 1;
  })) << desk.output()
      << second_host.output();
  EXPECT_TRUE(observer.until([](const Seen& seen) { return seen.user("bob").exact > 500; })) << exploring.output();
  holding.signal(SIGINT);
  EXPECT_TRUE(ends_with(1, holding));
  EXPECT_TRUE(ends_with(1, exploring));
  EXPECT_TRUE(ends_with(0, desk));
  EXPECT_TRUE(ends_with(0, second_host));
  const Seen after = observer.seen();
  EXPECT_EQ(after.user("ann").faults, 0u);
  EXPECT_EQ(after.user("bob").faults, 0u);
  EXPECT_EQ(after.figure("desk", figures::kEvictions), 0) << "or records would have to come again";
  EXPECT_EQ(after.figure("desk", figures::kRecordsReturned), 0);
  EXPECT_THAT(holding.output(), HasSubstr("host 'museum' is gone without a leave message"));
  EXPECT_THAT(holding.output(), HasSubstr("host 'museum' joined"));
}

TEST_F(FaultsTest, AHostThatEndsTakesItsObjectAlongAndMayBringItBack) {
  Observer observer{address("observer")};
  Process museum{host("museum", models().organ)};
  Process desk{hrtc("desk")};
  Process holding{sim(R"(name: hold
duration: 120
users:
  - name: ann
    hrtc: desk
    script:
      - approach: {object: organ, direction: [0, 0, 1], speed: 0.15, until_force: 0.5}
      - hold: {seconds: 110, force: 1}
)")};
  ASSERT_TRUE(wait_for_firm_contact(observer, "ann")) << holding.output() << desk.output();
  museum.signal(SIGINT);
  ASSERT_EQ(museum.wait(), 0) << museum.output();
  EXPECT_TRUE(desk.wait_for_line("object organ: withdrawn"));
  EXPECT_TRUE(desk.wait_for_line("object organ: freed"));
  EXPECT_TRUE(observer.until([](const Seen& seen) {
    const session::ProbeState last = seen.user("ann").last;
    return (last.status & session::kInContact) == 0 && std::hypot(last.force[0], last.force[1], last.force[2]) < 0.1;
  })) << desk.output();
  EXPECT_TRUE(observer.until([](const Seen& seen) { return seen.figure("desk", figures::kPoolUsed) == 0; }));

  Process back{host("museum", models().organ)};
  Process exploring{sim(R"(name: explore
duration: 120
users:
  - name: bob
    hrtc: desk
    script:
      - approach: {object: organ, direction: [1, 0, 0], speed: 0.15, until_force: 0.5}
      - hold: {seconds: 110, force: 1}
)",
                        {"--name", "sim2"})};
  EXPECT_TRUE(observer.until([](const Seen& seen) { return seen.user("bob").exact > 500; }))
      << exploring.output() << desk.output();
}

TEST_F(FaultsTest, ProbesOfAKilledHrtcVanishFromTheOther) {
  Observer observer{address("observer")};
  Process museum{host("museum", models().sphere)};
  Process left{hrtc("left")};
  Process right{hrtc("right")};
  Process users{sim(R"(name: two desks
duration: 120
users:
  - name: ann
    hrtc: left
    script: [{approach: {object: sphere}}, {hold: {seconds: 110, force: 1}}]
  - name: bob
    hrtc: right
    script: [{approach: {object: sphere, direction: [1, 0, 0]}}, {hold: {seconds: 110, force: 1}}]
)")};
  ASSERT_TRUE(observer.until([](const Seen& seen) {
    return seen.user("ann").exact > 0 && seen.user("bob").exact > 0 &&
           seen.figure("left", figures::kRemoteProbes) == 1 && seen.figure("right", figures::kRemoteProbes) == 1;
  })) << users.output();

  left.signal(SIGKILL);
  ASSERT_EQ(left.wait(), 128 + SIGKILL);

  ASSERT_TRUE(observer.until([](const Seen& seen) { return seen.figure("right", figures::kRemoteProbes) == 0; }));
  observer.forget_states();
  ASSERT_TRUE(observer.until([](const Seen& seen) { return seen.user("bob").count >= 500; }));
  EXPECT_EQ(observer.seen().user("ann").count, 0u);
  EXPECT_EQ(observer.seen().user("bob").faults, 0u);
  users.signal(SIGINT);
  EXPECT_TRUE(ends_with(1, users));
  EXPECT_THAT(users.output(), HasSubstr("HRTC 'left' is gone without a leave message"));
  EXPECT_TRUE(ends_with(0, right));
  EXPECT_TRUE(ends_with(0, museum));
}

}  // namespace
}  // namespace tactus::e2e
