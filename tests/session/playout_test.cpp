#include "session/playout.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/support/constants.hpp"

namespace tactus::session {
namespace {

PlayoutSettings without_reserve() {
  PlayoutSettings settings;
  settings.reserve_ns = 0;
  return settings;
}

/// A state of a probe that moves along x with 1 m/s and is at 0 at time 0.
ProbeState moving(std::uint32_t sequence, std::int64_t at_ms) {
  ProbeState state;
  state.origin.incarnation = 1;
  state.sequence = sequence;
  state.session_time_ns = at_ms * kMs;
  state.device.position = {static_cast<double>(at_ms) * 1e-3, 0, 0};
  state.velocity = {1, 0, 0};
  return state;
}

/// Delivers a state every 10 ms from `from_ms` to `to_ms`, each after `transit_ms`.
void deliver(ProbePlayout& playout, std::int64_t from_ms, std::int64_t to_ms, std::int64_t transit_ms) {
  for (std::int64_t ms = from_ms; ms < to_ms; ms += 10)
    playout.on_state(moving(static_cast<std::uint32_t>(ms / 10 + 1), ms), (ms + transit_ms) * kMs);
}

TEST(ProbePlayout, IsStaleBeforeTheFirstState) {
  ProbePlayout playout;
  const ShownProbe shown = playout.view_at(5 * kMs);
  EXPECT_TRUE(shown.stale);
  EXPECT_EQ(shown.state.sequence, 0u);
}

TEST(ProbePlayout, ShowsTheProbeWithADelayOfOneTransit) {
  ProbePlayout playout{without_reserve()};
  deliver(playout, 0, 3000, 30);
  const ShownProbe shown = playout.view_at(3025 * kMs);
  EXPECT_EQ(playout.delay_ns(), 30 * kMs);
  EXPECT_EQ(shown.at_ns, 2995 * kMs);
  EXPECT_NEAR(shown.view.device[0], 2.995, 1e-12);
  EXPECT_FALSE(shown.stale);
}

TEST(ProbePlayout, TheDelayIgnoresOneLongTransitButNotTwo) {
  ProbePlayout playout{without_reserve()};
  deliver(playout, 0, 1000, 5);
  playout.on_state(moving(101, 1000), 1050 * kMs);
  EXPECT_EQ(playout.delay_ns(), 5 * kMs);
  deliver(playout, 1060, 1500, 5);
  playout.on_state(moving(151, 1500), 1540 * kMs);
  EXPECT_EQ(playout.delay_ns(), 40 * kMs);
}

TEST(ProbePlayout, TheDelayFallsSlowlyAfterLongTransits) {
  ProbePlayout playout{without_reserve()};
  deliver(playout, 0, 2500, 40);
  deliver(playout, 2500, 4500, 5);  // at 4500 ms the window of the estimator still contains the long transits
  EXPECT_NEAR(static_cast<double>(playout.delay_ns()), 40e6, 1e6);
  deliver(playout, 4500, 5500, 5);
  EXPECT_NEAR(static_cast<double>(playout.delay_ns()), 30e6, 2e6) << "the delay falls by 1 % of a second";
}

TEST(TransitEstimator, DropsMeasurementsOfLaterTimesWhenTimeStepsBack) {
  TransitEstimator estimator;
  for (std::int64_t ms = 60'000; ms < 61'000; ms += 10) estimator.on_transit(40 * kMs, ms * kMs);
  for (std::int64_t ms = 1000; ms < 1300; ms += 10) estimator.on_transit(5 * kMs, ms * kMs);
  EXPECT_EQ(estimator.max_ns(), 5 * kMs);
}

TEST(ProbePlayout, ContinuesWhenSessionTimeStepsBack) {
  ProbePlayout playout{without_reserve()};
  deliver(playout, 60'000, 61'000, 40);
  (void)playout.view_at(61'000 * kMs);
  for (std::int64_t ms = 1000; ms < 1100; ms += 10)
    playout.on_state(moving(static_cast<std::uint32_t>(6100 + ms / 10), ms), (ms + 5) * kMs);
  const ShownProbe shown = playout.view_at(1095 * kMs);
  EXPECT_EQ(playout.delay_ns(), 5 * kMs) << "earlier transits are dropped";
  EXPECT_NEAR(shown.view.device[0], 1.09, 1e-9);
  EXPECT_FALSE(shown.stale);
}

TEST(ProbePlayout, TheShownTimeNeverStepsBack) {
  ProbePlayout playout{without_reserve()};
  deliver(playout, 0, 500, 5);
  const std::int64_t before = playout.view_at(505 * kMs).at_ns;
  deliver(playout, 500, 1500, 60);
  EXPECT_EQ(playout.delay_ns(), 60 * kMs);
  EXPECT_GE(playout.view_at(506 * kMs).at_ns, before);
}

TEST(ProbePlayout, TheDelayStaysWithinItsMaximum) {
  ProbePlayout playout;
  deliver(playout, 0, 1000, 500);
  EXPECT_EQ(playout.delay_ns(), PlayoutSettings{}.max_delay_ns);
}

TEST(ProbePlayout, ExtrapolatesBetweenConsecutiveStatesAndInterpolatesOverAGap) {
  PlayoutSettings settings;
  settings.reserve_ns = 30 * kMs;
  ProbePlayout without_gap{settings}, with_gap{settings};
  ProbeState first = moving(1, 0), second = moving(2, 10);
  first.velocity = {0, 0, 0};
  for (ProbePlayout* const playout : {&without_gap, &with_gap}) playout->on_state(first, 0);
  without_gap.on_state(second, 10 * kMs);
  second.sequence = 3;
  with_gap.on_state(second, 10 * kMs);
  EXPECT_EQ(without_gap.view_at(35 * kMs).view.device[0], 0);
  EXPECT_NEAR(with_gap.view_at(35 * kMs).view.device[0], 0.005, 1e-12);
}

TEST(ProbePlayout, InsertsAnOvertakenStateBySequenceAndIgnoresARepetition) {
  PlayoutSettings settings;
  settings.reserve_ns = 50 * kMs;
  ProbePlayout playout{settings};
  playout.on_state(moving(1, 0), 0);
  playout.on_state(moving(3, 20), 20 * kMs);
  ProbeState overtaken = moving(2, 10);
  overtaken.device.position = {7, 0, 0};
  playout.on_state(overtaken, 21 * kMs);
  overtaken.device.position = {8, 0, 0};
  playout.on_state(overtaken, 22 * kMs);
  const ShownProbe shown = playout.view_at(60 * kMs + playout.delay_ns() - 50 * kMs);
  EXPECT_EQ(shown.at_ns, 10 * kMs);
  EXPECT_EQ(shown.view.device[0], 7);
}

TEST(ProbePlayout, IsStaleAfterThreeKeepAlivePeriodsOfSilence) {
  ProbePlayout playout;
  deliver(playout, 0, 1000, 5);
  EXPECT_FALSE(playout.view_at(1100 * kMs).stale);
  EXPECT_TRUE(playout.view_at(1130 * kMs).stale);
}

TEST(ProbePlayout, DropsTheStatesOfThePreviousIncarnation) {
  ProbePlayout playout{without_reserve()};
  deliver(playout, 0, 1000, 60);
  ProbeState restarted = moving(1, 1100);
  restarted.origin.incarnation = 2;
  playout.on_state(restarted, 1105 * kMs);
  EXPECT_EQ(playout.delay_ns(), 5 * kMs);
  EXPECT_EQ(playout.view_at(1105 * kMs).state.sequence, 1u);
}

}  // namespace
}  // namespace tactus::session
