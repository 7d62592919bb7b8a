/// Sessions in which a host or an HRTC ends or is killed.
#include "session/figures.hpp"
#include "tests/e2e/session_test.hpp"

namespace tactus::e2e {
namespace {

namespace figures = session::figures;
using Seen = Observer::Seen;
using Clock = std::chrono::steady_clock;
using testing::HasSubstr;

/// User ann holds an exact contact with the organ of a host.
class HostFaultsTest : public SessionTest {
 protected:
  void SetUp() override { ASSERT_TRUE(wait_for_lasting_contact("ann")) << holding_.output() << desk_.output(); }

  /// True after half a second of contact, if all of it was exact.
  static bool has_lasting_contact(const Seen& seen, const std::string& user) {
    const StateCounts states = seen.user(user);
    return states.in_contact >= 500 && states.exact == states.in_contact;
  }
  /// Starts to count again after each inexact contact.
  testing::AssertionResult wait_for_lasting_contact(const std::string& user) {
    for (const auto end = Clock::now() + kWatchdog; Clock::now() < end;) {
      observer_.forget_states();
      const auto is_decided = [&](const Seen& seen) {
        const StateCounts states = seen.user(user);
        return states.exact < states.in_contact || has_lasting_contact(seen, user);
      };
      if (observer_.until(is_decided) && has_lasting_contact(observer_.seen(), user))
        return testing::AssertionSuccess();
    }
    return testing::AssertionFailure() << "no lasting exact contact of " << user;
  }

  /// A second simulation, in which user bob touches the organ on another side and then performs `action`.
  [[nodiscard]] std::vector<std::string> second_sim(const std::string& action) const {
    return sim(R"(name: explore
duration: 120
users:
  - name: bob
    hrtc: desk
    script:
      - approach: {object: organ, direction: [1, 0, 0], speed: 0.15, until_force: 0.5}
      - )" + action +
                   "\n",
               {"--name", "sim2"});
  }

  Observer observer_{address("observer")};
  Process museum_{host("museum", models().organ)};
  Process desk_{hrtc("desk")};
  Process holding_{sim(R"(name: hold
duration: 120
users:
  - name: ann
    hrtc: desk
    script:
      - approach: {object: organ, direction: [0, 0, 1], speed: 0.15, until_force: 0.5}
      - hold: {seconds: 110, force: 1}
)")};
};

TEST_F(HostFaultsTest, LoadedRegionsStayExactAfterAHostIsKilledAndItsSuccessorServesTheMissingRegions) {
  ASSERT_TRUE(observer_.until([](const Seen& seen) { return seen.figure("desk", figures::kRegionsReceived) > 0; }));

  museum_.signal(SIGKILL);
  ASSERT_EQ(museum_.wait(), 128 + SIGKILL);
  observer_.forget_states();

  EXPECT_TRUE(desk_.wait_for_line("host 'museum' is silent, presumed failed"));
  ASSERT_TRUE(observer_.until([](const Seen& seen) { return seen.user("ann").in_contact >= 1500; }));
  const StateCounts without_host = observer_.seen().user("ann");
  EXPECT_EQ(without_host.exact, without_host.in_contact) << "although ann needs no other region";
  const std::uint64_t metrics = observer_.seen().metrics_count("desk");
  ASSERT_TRUE(observer_.until([&](const Seen& seen) { return seen.metrics_count("desk") > metrics + 1; }));
  const double regions = observer_.seen().figure("desk", figures::kRegionsReceived);

  Process second_museum{host("museum", models().organ)};
  Process exploring{second_sim("follow: {speed: 0.05, force: 1.5, seconds: 110, pattern: circle}")};

  EXPECT_TRUE(observer_.until([&](const Seen& seen) {
    return seen.figure("desk", figures::kRegionsReceived) > regions + 1;
  })) << desk_.output()
      << second_museum.output();
  EXPECT_TRUE(observer_.until([](const Seen& seen) { return seen.user("bob").exact > 500; })) << exploring.output();
  holding_.signal(SIGINT);
  EXPECT_TRUE(exits_with(1, holding_));
  EXPECT_TRUE(exits_with(1, exploring));
  EXPECT_TRUE(exits_with(0, desk_));
  EXPECT_TRUE(exits_with(0, second_museum));
  const Seen after = observer_.seen();
  EXPECT_EQ(after.user("ann").faults, 0u);
  EXPECT_EQ(after.user("bob").faults, 0u);
  EXPECT_EQ(after.figure("desk", figures::kEvictions), 0) << "an eviction would be a reason to receive a record again";
  EXPECT_EQ(after.figure("desk", figures::kRecordsReceivedAgain), 0);
  EXPECT_THAT(holding_.output(), HasSubstr("host 'museum' is silent, presumed failed"));
  EXPECT_THAT(holding_.output(), HasSubstr("host 'museum' joined"));
}

TEST_F(HostFaultsTest, AHostThatLeavesWithdrawsItsObjectAndItsSuccessorOffersTheObjectAgain) {
  museum_.signal(SIGINT);
  ASSERT_EQ(museum_.wait(), 0) << museum_.output();
  EXPECT_TRUE(desk_.wait_for_line("object organ: withdrawn"));
  EXPECT_TRUE(desk_.wait_for_line("object organ: freed"));
  EXPECT_TRUE(observer_.until([](const Seen& seen) {
    const session::ProbeState last = seen.user("ann").last;
    return (last.status & session::kInContact) == 0 && std::hypot(last.force[0], last.force[1], last.force[2]) < 0.1;
  })) << desk_.output();
  EXPECT_TRUE(observer_.until([](const Seen& seen) { return seen.figure("desk", figures::kPoolUsed) == 0; }));

  Process second_museum{host("museum", models().organ)};
  Process exploring{second_sim("hold: {seconds: 110, force: 1}")};
  EXPECT_TRUE(observer_.until([](const Seen& seen) { return seen.user("bob").exact > 500; }))
      << exploring.output() << desk_.output();
}

class HrtcFaultsTest : public SessionTest {};

TEST_F(HrtcFaultsTest, AnHrtcRemovesTheRemoteProbesOfAKilledHrtc) {
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

  left.signal_all(SIGKILL);
  ASSERT_EQ(left.wait(), 128 + SIGKILL);

  ASSERT_TRUE(observer.until([](const Seen& seen) { return seen.figure("right", figures::kRemoteProbes) == 0; }));
  observer.forget_states();
  ASSERT_TRUE(observer.until([](const Seen& seen) { return seen.user("bob").count >= 500; }));
  EXPECT_EQ(observer.seen().user("ann").count, 0u);
  EXPECT_EQ(observer.seen().user("bob").faults, 0u);
  users.signal(SIGINT);
  EXPECT_TRUE(exits_with(1, users));
  EXPECT_THAT(users.output(), HasSubstr("HRTC 'left' is silent, presumed failed"));
  EXPECT_TRUE(exits_with(0, right));
  EXPECT_TRUE(exits_with(0, museum));
}

}  // namespace
}  // namespace tactus::e2e
