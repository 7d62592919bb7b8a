#include "hrtc_service/servo/governor.hpp"

#include <gtest/gtest.h>

#include <random>

namespace tactus::hrtc_service {
namespace {

constexpr std::uint32_t kPortion = 136;  // units of Budget in a portion, as in Cycle

/// Simulates cycles that always have more to refine. Their times are log-normal.
class Machine {
 public:
  explicit Machine(std::uint64_t seed) : random_{seed} {}
  double unit_ns = 8, refit_unit_ns = 4;  // for each unit of Budget
  double touch_ns = 15'000;
  double slowness = 1;      // factor of the times of touch, refinement and refit
  double interrupt_ns = 0;  // in one cycle of 200 at random
  double preempt_ns = 0;    // in one cycle of 20 at random, before its first portion

  /// Returns the share of cycles that missed the deadline although nothing interrupted or preempted them.
  double run(Governor& governor, double deadline_ns, int cycles) {
    std::lognormal_distribution<double> random_factor{0, 0.25};
    int missed = 0;
    double units = 0;
    for (int cycle = 0; cycle < cycles; ++cycle) {
      const RefineLimit limit = governor.limit();
      const double refine_start = touch_ns * random_factor(random_) * slowness,
                   portion_ns = unit_ns * kPortion * slowness;
      const bool preempted = preempt_ns > 0 && random_() % 20 == 0;
      double now = refine_start + (preempted ? preempt_ns : 0), predicted_end = 0;
      std::uint32_t refined = 0;
      while (refined == 0 || limit.allows(refine_start, now, refined)) {
        predicted_end = limit.predicted_end(now, refined);
        refined += kPortion;
        now += portion_ns * random_factor(random_);
      }
      const double refit = refit_unit_ns * refined * random_factor(random_) * slowness;
      const bool interrupted = random_() % 200 == 0 && interrupt_ns > 0;
      const double end = now + refit + (interrupted ? interrupt_ns : 0);
      governor.observe(refined, refit, end, predicted_end);
      missed += end > deadline_ns && !interrupted && !preempted ? 1 : 0;
      units += refined;
    }
    mean_units = units / cycles;
    return static_cast<double>(missed) / cycles;
  }
  /// Returns how much of the time between touch and deadline the cycles use to refine and refit, as a mean share.
  [[nodiscard]] double used_share(double deadline_ns) const {
    return mean_units * (unit_ns + refit_unit_ns) / (deadline_ns / slowness - touch_ns);
  }
  double mean_units = 0;  // units of Budget in a cycle, mean of the last run

 private:
  std::mt19937_64 random_;
};

TEST(Governor, MissesTheDeadlineInLessThanAThousandthOfTheCycles) {
  for (const double deadline : {50e3, 100e3, 200e3}) {
    Machine machine{3};
    Governor governor{static_cast<std::int64_t>(deadline)};
    (void)machine.run(governor, deadline, 5000);
    EXPECT_LT(machine.run(governor, deadline, 200'000), 0.001) << deadline << " ns";
    EXPECT_GT(machine.used_share(deadline), 0.6)
        << "of the time between touch and deadline, deadline " << deadline << " ns";
  }
}

TEST(Governor, FollowsAMachineThatSlowsDownAndRecovers) {
  constexpr double kDeadline = 200e3;
  Machine machine{5};
  Governor governor{static_cast<std::int64_t>(kDeadline)};
  (void)machine.run(governor, kDeadline, 20'000);
  const double before = machine.mean_units;
  for (int round = 0; round < 5; ++round) {
    machine.slowness = 2.5;
    EXPECT_LT(machine.run(governor, kDeadline, 20'000), 0.005) << "round " << round;
    EXPECT_LT(machine.mean_units, before * 0.8);
    machine.slowness = 1;
    EXPECT_LT(machine.run(governor, kDeadline, 20'000), 0.001);
    EXPECT_GT(machine.mean_units, before * 0.8);
  }
}

TEST(Governor, DoesNotReduceRefinementBecauseOfInterruptsLongerThanTheDeadline) {
  constexpr double kDeadline = 100e3;
  Machine machine{11};
  machine.interrupt_ns = 150e3;
  Governor governor{static_cast<std::int64_t>(kDeadline)};
  (void)machine.run(governor, kDeadline, 5000);
  EXPECT_LT(machine.run(governor, kDeadline, 100'000), 0.001);
  EXPECT_GT(machine.used_share(kDeadline), 0.5);
}

TEST(Governor, DoesNotReduceRefinementBecauseOfPreemptionBeforeTheLastPortion) {
  constexpr double kDeadline = 100e3;
  Machine machine{13};
  machine.preempt_ns = 2e6;
  Governor governor{static_cast<std::int64_t>(kDeadline)};
  (void)machine.run(governor, kDeadline, 5000);
  EXPECT_LT(machine.run(governor, kDeadline, 100'000), 0.002);
  EXPECT_GT(machine.used_share(kDeadline), 0.5);
}

TEST(Governor, RefinesForTheMinShareOfTheDeadlineWhenForcesTakeLongerThanTheDeadline) {
  constexpr double kDeadline = 50e3;
  Machine machine{7};
  machine.touch_ns = 80'000;
  Governor governor{static_cast<std::int64_t>(kDeadline)};
  (void)machine.run(governor, kDeadline, 50'000);
  EXPECT_GE(machine.mean_units, kPortion);
  EXPECT_LE(machine.mean_units * machine.unit_ns, kDeadline * 0.25);
}

}  // namespace
}  // namespace tactus::hrtc_service
