#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>

#include <set>

#include "tests/support/constants.hpp"
#include "tools/chaos/health.hpp"
#include "tools/chaos/plan.hpp"
#include "tools/chaos/programs.hpp"

namespace tactus::chaos {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

constexpr std::int64_t kMs = 1'000'000;

std::vector<Program> session_programs() {
  Program host, gateway, sim;
  host.label = "host museum";
  gateway.label = "gateway desk";
  gateway.restart = Restart::kItsSupervisor;
  sim.label = "sim";
  return {gateway, host, sim};
}

const std::vector<FaultKind> kAllKinds{FaultKind::kSuspend, FaultKind::kKill, FaultKind::kLoss, FaultKind::kCut};

std::vector<std::string> first_faults(std::uint64_t seed, std::size_t count) {
  Plan plan{seed, kAllKinds, 4};
  std::vector<std::string> texts;
  for (std::size_t i = 0; i < count; ++i) texts.push_back(text(plan.next(session_programs())));
  return texts;
}

TEST(ChaosPlan, IsTheSameForTheSameSeed) {
  EXPECT_EQ(first_faults(7, 50), first_faults(7, 50));
  EXPECT_NE(first_faults(7, 50), first_faults(8, 50));
}

TEST(ChaosPlan, KillsOnlyProgramsThatStartAgain) {
  Plan plan{1, kAllKinds, 4};
  std::set<FaultKind> kinds;
  for (int i = 0; i < 500; ++i) {
    const Fault fault = plan.next(session_programs());
    kinds.insert(fault.kind);
    if (fault.kind == FaultKind::kKill) {
      EXPECT_EQ(fault.program, "gateway desk");
    }
    EXPECT_LE(fault.pause, 4);
    EXPECT_LE(fault.percent, 30);
  }
  EXPECT_EQ(kinds.size(), kFaultKinds);
}

TEST(ChaosPlan, HasNoFaultIfNoneIsPossible) {
  Plan plan{1, {FaultKind::kKill}, 4};
  Program host;
  host.label = "host museum";
  EXPECT_THROW((void)plan.next({host}), std::runtime_error);
}

class HealthTest : public testing::Test {
 protected:
  session::RosterEntry entry(std::uint64_t participant, session::Role role, const std::string& name) {
    session::RosterEntry entry;
    entry.origin = {kSession, participant, 1, now_};
    entry.role = role;
    entry.name = name;
    entry.heartbeat = ++heartbeat_;
    if (role == session::Role::kHrtc) entry.served_users = {{"ann", 0}};
    return entry;
  }
  session::ProbeState state(std::uint32_t status, double force = 1, std::uint64_t incarnation = 1) {
    session::ProbeState state;
    state.origin = {kSession, kHrtc, incarnation, now_};
    state.user_id = session::id_of("ann");
    state.status = status;
    state.force = {0, 0, force};
    return state;
  }
  /// Host and HRTC publish for `ms`, unless omitted, and the user has this status.
  void run(int ms, std::uint32_t status, bool has_host = true) {
    for (int i = 0; i < ms; i += 10) {
      now_ += 10 * kMs;
      if (i % 100 == 0) {
        if (has_host) health_.on_sample(entry(kHost, session::Role::kHost, "museum"), now_);
        health_.on_sample(entry(kHrtc, session::Role::kHrtc, "desk"), now_);
      }
      health_.on_sample(state(status), now_);
      health_.tick(now_);
    }
  }

  static constexpr std::uint32_t kTouch = session::kInContact | session::kExact;
  std::int64_t now_ = 1'000'000 * kMs;
  std::uint64_t heartbeat_ = 0;
  Health health_{{kSession, 99, 1, 0}, {}};
};

TEST_F(HealthTest, MissesNothingWhileAllPublish) {
  run(1000, kTouch);
  health_.set_reference(now_);
  EXPECT_THAT(health_.reference_text(), HasSubstr("museum"));
  EXPECT_THAT(health_.reference_text(), HasSubstr("user ann"));
  run(1000, kTouch);
  EXPECT_THAT(health_.missing(now_), IsEmpty());
  EXPECT_THAT(health_.violations(), IsEmpty());
}

TEST_F(HealthTest, MissesASilentHostUntilItReturns) {
  run(1000, kTouch);
  health_.set_reference(now_);
  run(400, kTouch, false);
  EXPECT_THAT(health_.missing(now_), ElementsAre(HasSubstr("museum")));
  run(200, kTouch);
  EXPECT_THAT(health_.missing(now_), IsEmpty());
}

TEST_F(HealthTest, MissesAUserWithoutStatesWithoutForcesOrWithoutExactContact) {
  run(1000, kTouch);
  health_.set_reference(now_);
  run(10, session::kInContact);
  EXPECT_THAT(health_.missing(now_), ElementsAre(HasSubstr("not exact")));
  run(10, session::kFault);
  EXPECT_THAT(health_.missing(now_), ElementsAre(HasSubstr("user ann")));
  run(10, session::kStalePose);
  EXPECT_THAT(health_.missing(now_), ElementsAre(HasSubstr("no poses")));
  run(10, kTouch);
  EXPECT_THAT(health_.missing(now_), IsEmpty());
  EXPECT_THAT(health_.missing(now_ + 251 * kMs), ElementsAre(HasSubstr("no states")));
}

TEST_F(HealthTest, DoesNotExpectAnExactContactThatNeverWas) {
  run(1000, session::kInContact);
  health_.set_reference(now_);
  run(10, session::kInContact);
  EXPECT_THAT(health_.missing(now_), IsEmpty());
}

TEST_F(HealthTest, ReportsAForceAboveTheLimit) {
  health_.on_sample(state(kTouch, 8), now_);
  EXPECT_THAT(health_.violations(), IsEmpty());
  health_.on_sample(state(kTouch, 8.1), now_);
  EXPECT_THAT(health_.violations(), ElementsAre(HasSubstr("8.1 N, expected at most 8 N")));
  EXPECT_DOUBLE_EQ(health_.max_force(), 8.1);
}

TEST_F(HealthTest, ReportsAStateOfAnEarlierProcess) {
  health_.on_sample(state(kTouch, 1, 2), now_);
  health_.on_sample(state(kTouch, 1, 1), now_);
  EXPECT_THAT(health_.violations(), ElementsAre(HasSubstr("earlier process")));
}

TEST(ChaosPrograms, FindsNoProgramOfAnUnknownSession) {
  EXPECT_THAT(programs_of("no such session", 20, true), IsEmpty());
}

TEST(ChaosPrograms, KnowsTheResourcesOfAProcessWhileItRuns) {
  Program missing;
  missing.pid = 1;
  missing.started = 1;  // before any process
  EXPECT_FALSE(resources_of(missing).has_value());
  EXPECT_THROW(Suspension(missing, 1), std::runtime_error);
}

}  // namespace
}  // namespace tactus::chaos
