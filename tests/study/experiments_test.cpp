#include "study/experiments.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "study/hand_over.hpp"
#include "study/shared_run.hpp"
#include "tests/study/figures.hpp"

namespace tactus::study {
namespace {

class StudyExperiments : public ::testing::Test {
 protected:
  static Experiments make_experiments() {
    Study study;
    study.scenarios = {"target-force", "lift", "hand-over"};
    return experiments_of(study, check(study));
  }
  ScenarioRun run(const std::string& name, const std::string& link, std::uint64_t seed = 1) const {
    for (const Experiment& experiment : experiments_.all)
      if (experiment.name == name) return experiment.run(netem::parse_link(link), seed, kNoStop);
    throw std::invalid_argument(name);
  }
  const Experiments experiments_ = make_experiments();
};

TEST_F(StudyExperiments, BeginWithTheBaselineLink) {
  for (const Experiment& experiment : experiments_.all) EXPECT_EQ(experiment.profiles.front(), kBaseline);
}

TEST_F(StudyExperiments, TwoUsersReachTheirTargetForceWithoutDelay) {
  const ScenarioRun result = run("target-force", "P0");
  EXPECT_GT(value_of(result.figures, "time on target"), 99);
  EXPECT_LT(value_of(result.figures, "deviation from target, rms"), 0.05);
  EXPECT_EQ(value_of(result.figures, "time without contact"), 0);
}

class TargetForce : public ::testing::Test {
 protected:
  /// Runs the first `seconds` of the scenario target-force.
  static ScenarioRun run(double seconds) {
    client_sim::Scenario scenario = client_sim::load_scenario("target-force");
    scenario.duration = seconds;
    return run(scenario);
  }
  static ScenarioRun run(const client_sim::Scenario& scenario) {
    static const Subject kSubject = make_subject(object_of(scenario), "box", 1200, 0.1);
    return press_to_target(scenario, kSubject, netem::parse_link("P0"), 1, kNoStop);
  }
  static void expect_no_values_of_the_period_of_contact(const ScenarioRun& run) {
    for (const char* name :
         {"time on target", "deviation from target, rms", "deviation from target, max", "time without contact"})
      EXPECT_TRUE(std::isnan(value_of(run.figures, name))) << name;
  }
};

TEST_F(TargetForce, UsersWhoNeverTouchHaveTheLengthOfTheRunAsTimeToTarget) {
  const ScenarioRun result = run(0.05);
  EXPECT_EQ(value_of(result.figures, "time until all touch"), 50);
  EXPECT_EQ(value_of(result.figures, "time to target"), 50);
  expect_no_values_of_the_period_of_contact(result);
}

TEST_F(TargetForce, UsersWhoTouchJustBeforeTheEndHaveTheLengthOfTheRunAsTimeToTarget) {
  const double touched_ms = value_of(run(5).figures, "time until all touch");
  ASSERT_LT(touched_ms, 4000);
  const ScenarioRun result = run((touched_ms + 50) * 1e-3);
  EXPECT_EQ(value_of(result.figures, "time until all touch"), touched_ms);
  EXPECT_NEAR(value_of(result.figures, "time to target"), touched_ms + 50, 1);
  expect_no_values_of_the_period_of_contact(result);
}

/// Returns a user who presses the crate along x with `force`, for `seconds` from the contact on, and then leaves it if
/// `releases`. The user begins after `wait` seconds.
client_sim::User user_who_presses(const char* name, double x, double force, double wait, double seconds,
                                  bool releases) {
  client_sim::User user;
  user.name = name;
  user.hrtc = name;
  client_sim::Action action;
  action.object = "crate";
  action.kind = client_sim::ActionKind::kApproach;
  action.direction = {x, 0, 0};
  action.force = 0.2;
  user.script.push_back(action);
  action.kind = client_sim::ActionKind::kWait;
  action.seconds = wait;
  user.script.insert(user.script.begin(), action);
  action.kind = client_sim::ActionKind::kHold;
  action.seconds = seconds;
  action.force = force;
  user.script.push_back(action);
  action.kind = client_sim::ActionKind::kRetreat;
  if (releases) user.script.push_back(action);
  return user;
}

TEST_F(TargetForce, IsThatOfEachUser) {
  client_sim::Scenario scenario;
  scenario.duration = 9;
  // The friction of the ground carries the difference of the forces, 1 N.
  scenario.users = {user_who_presses("ann", 1, 1.5, 0, 6, false), user_who_presses("bob", -1, 2.5, 0, 6, false)};
  const ScenarioRun result = run(scenario);
  EXPECT_GT(value_of(result.figures, "time on target"), 95);
  EXPECT_LT(value_of(result.figures, "time to target"), 3000);
}

TEST_F(TargetForce, IsMeasuredUntilTheFirstUserReleases) {
  client_sim::Scenario scenario;
  scenario.duration = 12;
  scenario.users = {user_who_presses("ann", 1, 1.5, 0, 5, true), user_who_presses("bob", -1, 1.5, 2, 5, true)};
  const ScenarioRun result = run(scenario);
  EXPECT_EQ(value_of(result.figures, "time without contact"), 0);
  EXPECT_LT(value_of(result.figures, "deviation from target, max"), 1);
}

TEST(LiftTogether, WithoutAViewOfTheObjectNothingIsKnownOfItsPose) {
  client_sim::Scenario scenario = client_sim::load_scenario("lift");
  scenario.duration = 0.003;
  const Subject subject = make_subject(object_of(scenario), "box", 1200, 0.1);
  const ScenarioRun result = lift_together(scenario, subject, netem::parse_link("P0:delay=100"), 1, kNoStop);
  for (const char* name : {"largest height", "largest tilt", "largest distance of copies", "height at the end"})
    EXPECT_TRUE(std::isnan(value_of(result.figures, name))) << name;
}

TEST(HandOver, WithoutAGrantThereIsNoTimeToGrant) {
  const Figures figures = hand_over({{0.01, 0.01}}, 0.5, netem::parse_link("P0:delay=1000"), 1);
  const ScenarioRun result{figures, {}};
  EXPECT_GT(value_of(result.figures, "touches"), 0);
  EXPECT_EQ(value_of(result.figures, "granted touches"), 0);
  EXPECT_TRUE(std::isnan(value_of(result.figures, "time to grant, mean")));
  EXPECT_TRUE(std::isnan(value_of(result.figures, "time to grant, max")));
}

TEST_F(StudyExperiments, CopiesOfALiftedCrateStayTogetherOverLongLinks) {
  for (const auto& [link, max_apart] : {std::pair{"P4", 15.0}, std::pair{"P6", 25.0}}) {
    SCOPED_TRACE(link);
    const ScenarioRun result = run("lift", link);
    EXPECT_EQ(value_of(result.figures, "completed lifts"), 2);
    EXPECT_EQ(value_of(result.figures, "lost lifts"), 0);
    EXPECT_LT(value_of(result.figures, "largest distance of copies"), max_apart);
    EXPECT_LT(value_of(result.figures, "largest tilt"), 20);
    EXPECT_LT(value_of(result.figures, "injected energy"), 1);
    EXPECT_GE(value_of(result.figures, "lowest port energy"), -1e-3);
  }
}

TEST_F(StudyExperiments, FourUsersNeverShareAFencingNumberAndWaitARoundTripForAGrant) {
  const ScenarioRun result = run("hand-over", "P4");
  EXPECT_GT(value_of(result.figures, "touches"), 40);
  EXPECT_EQ(value_of(result.figures, "shared fencing numbers"), 0);
  EXPECT_NEAR(value_of(result.figures, "time to grant, mean"), 32, 6);
}

TEST_F(StudyExperiments, DivergedRunsAreCountedAndHaveNoFigures) {
  const ScenarioRun naive = run("carry, naive", "P6");
  EXPECT_EQ(value_of(naive.figures, "diverged runs"), 100);
  EXPECT_TRUE(std::isnan(value_of(naive.figures, "largest distance of copies")));
  const ScenarioRun channel = run("carry, channel", "P6");
  EXPECT_EQ(value_of(channel.figures, "diverged runs"), 0);
  EXPECT_LT(value_of(channel.figures, "time to settle"), 2);
  EXPECT_LT(value_of(channel.figures, "distance of copies 1 s later"), 5);
}

TEST_F(StudyExperiments, RunsThatNeverComeToRestCountAsDivergedAndHaveNoFigures) {
  // The positions stay finite over the first two links, and diverge over the third.
  for (const auto& [name, link] :
       {std::pair{"carry, naive", "P7"}, std::pair{"carry, naive", "P8"}, std::pair{"carry, server", "P6"}}) {
    SCOPED_TRACE(std::string{name} + " " + link);
    const ScenarioRun result = run(name, link);
    EXPECT_EQ(value_of(result.figures, "diverged runs"), 100);
    for (const Figure& figure : result.figures)
      EXPECT_TRUE(figure.name == "diverged runs" || std::isnan(figure.value)) << figure.name;
  }
}

}  // namespace
}  // namespace tactus::study
