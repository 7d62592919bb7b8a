/// What becomes of a session when one of its programs dies.
#include "session/figures.hpp"
#include "tests/e2e/session_test.hpp"

namespace tactus::e2e {
namespace {

namespace figures = session::figures;
using Seen = Observer::Seen;
using Clock = std::chrono::steady_clock;
using testing::HasSubstr;

#ifdef TACTUS_SANITIZED
constexpr bool kTimed = false;  // an instrumented cycle is late by itself
#else
constexpr bool kTimed = true;
#endif

class FaultsTest : public SessionTest {
 protected:
  /// More than a second of contact without a break, all of it exact.
  static bool firmly_touches(const Seen& seen, const std::string& user) {
    const SeenStates states = seen.user(user);
    return states.count >= 500 && states.exact == states.count;
  }
  /// Forgets until contact is exact and stays so.
  testing::AssertionResult wait_for_firm_contact(Observer& observer, const std::string& user) {
    for (const auto end = Clock::now() + kWatchdog; Clock::now() < end;) {
      observer.forget_states();
      const auto decided = [&](const Seen& seen) {
        const SeenStates states = seen.user(user);
        return states.exact < states.count || firmly_touches(seen, user);
      };
      if (observer.until(decided) && firmly_touches(observer.seen(), user)) return testing::AssertionSuccess();
    }
    return testing::AssertionFailure() << user << " never touched for long";
  }
};

TEST_F(FaultsTest, KillingAHostLeavesLoadedRegionsExactAndItsReturnGoesOnLoadingWhatIsMissing) {
  Observer observer{address("observer")};
  Process first_host{host("museum", models().organ)};
  Process controller{hrtc("desk")};
  Process users{sim(R"(name: hold, then explore
duration: 60
users:
  - name: ann
    hrtc: desk
    script:
      - approach: {object: organ, direction: [0, 0, 1], speed: 0.15, until_force: 0.5}
      - hold: {seconds: 9, force: 1}
      - follow: {speed: 0.05, force: 1.5, seconds: 30, pattern: circle}
)")};
  ASSERT_TRUE(wait_for_firm_contact(observer, "ann")) << users.output() << controller.output();
  ASSERT_TRUE(observer.until([](const Seen& seen) { return seen.figure("desk", figures::kRegionsReceived) > 0; }));
  const double late_before = observer.seen().figure("desk", figures::kLateOurs);

  first_host.signal(SIGKILL);
  ASSERT_EQ(first_host.wait(), 128 + SIGKILL);
  observer.forget_states();

  EXPECT_TRUE(controller.wait_for_line("host 'museum' is gone"));
  ASSERT_TRUE(observer.until([](const Seen& seen) { return seen.user("ann").count >= 1500; }));
  const SeenStates orphaned = observer.seen().user("ann");
  EXPECT_EQ(orphaned.exact, orphaned.count) << "while nothing new was needed";
  const std::uint64_t metrics = observer.seen().metrics["desk"];
  ASSERT_TRUE(observer.until([&](const Seen& seen) { return seen.metrics.at("desk") > metrics + 1; }));
  const Seen without_host = observer.seen();
  if (kTimed) {
    EXPECT_EQ(without_host.figure("desk", figures::kLateOurs), late_before);
  }

  Process second_host{host("museum", models().organ)};

  const double received = without_host.figure("desk", figures::kRegionsReceived);
  EXPECT_TRUE(observer.until([&](const Seen& seen) {
    return seen.figure("desk", figures::kRegionsReceived) > received + 1;
  })) << controller.output()
      << second_host.output();
  EXPECT_TRUE(wait_for_firm_contact(observer, "ann")) << "while exploring";
  users.signal(SIGINT);
  EXPECT_TRUE(ends_with(1, users));
  EXPECT_TRUE(ends_with(0, controller));
  EXPECT_TRUE(ends_with(0, second_host));
  const Seen after = observer.seen();
  EXPECT_EQ(after.user("ann").faults, 0u);
  EXPECT_EQ(after.figure("desk", figures::kEvictions), 0) << "or records would have to come again";
  EXPECT_EQ(after.figure("desk", figures::kRecordsReturned), 0);
  EXPECT_THAT(users.output(), HasSubstr("host 'museum' is gone without a word"));
  EXPECT_THAT(users.output(), HasSubstr("host 'museum' joined"));
}

TEST_F(FaultsTest, ProbesOfAKilledControllerVanishFromTheOtherInHalfASecond) {
  constexpr auto kVanish = 500ms;
  constexpr auto kMetricsPeriod = 500ms;
  Observer observer{address("observer")};
  Process museum{host("museum", models().sphere)};
  Process left{hrtc("left")};
  Process right{hrtc("right")};
  Process users{sim(R"(name: two desks
duration: 60
users:
  - name: ann
    hrtc: left
    script: [{approach: {object: sphere}}, {hold: {seconds: 50, force: 1}}]
  - name: bob
    hrtc: right
    script: [{approach: {object: sphere, direction: [1, 0, 0]}}, {hold: {seconds: 50, force: 1}}]
)")};
  ASSERT_TRUE(observer.until([](const Seen& seen) {
    return seen.user("ann").exact > 0 && seen.user("bob").exact > 0 &&
           seen.figure("left", figures::kRemoteProbes) == 1 && seen.figure("right", figures::kRemoteProbes) == 1;
  })) << users.output();

  left.signal(SIGKILL);
  const auto killed = Clock::now();
  ASSERT_EQ(left.wait(), 128 + SIGKILL);

  ASSERT_TRUE(observer.until([](const Seen& seen) { return seen.figure("right", figures::kRemoteProbes) == 0; }));
  EXPECT_LT(Clock::now() - killed, kVanish + kMetricsPeriod);
  observer.forget_states();
  ASSERT_TRUE(observer.until([](const Seen& seen) { return seen.user("bob").count >= 500; }));
  EXPECT_EQ(observer.seen().user("ann").count, 0u);
  EXPECT_EQ(observer.seen().user("bob").faults, 0u);
  users.signal(SIGINT);
  EXPECT_TRUE(ends_with(1, users));
  EXPECT_THAT(users.output(), HasSubstr("HRTC 'left' is gone without a word"));
  EXPECT_TRUE(ends_with(0, right));
  EXPECT_TRUE(ends_with(0, museum));
}

}  // namespace
}  // namespace tactus::e2e
