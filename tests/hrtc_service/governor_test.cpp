#include "hrtc_service/governor.hpp"

#include <gtest/gtest.h>

#include <random>

namespace tactus::hrtc_service {
namespace {

/// A machine whose cycles cost what it says, with tails as measured ones have.
class Machine {
 public:
  explicit Machine(std::uint64_t seed) : random_{seed} {}
  double unit_ns = 8, rest_ns = 15'000, slowness = 1;

  /// Runs cycles that spend what they are given; returns the share that missed.
  double run(Governor& governor, double deadline_ns, int cycles) {
    std::lognormal_distribution<double> tail{0, 0.25};
    int missed = 0;
    double units = 0;
    for (int i = 0; i < cycles; ++i) {
      const std::uint32_t budget = governor.budget().units;
      const double refining = (2000 + budget * unit_ns * tail(random_)) * slowness;
      const double own = refining + rest_ns * tail(random_) * slowness;
      governor.observe(budget, refining, own);
      missed += own > deadline_ns ? 1 : 0;
      units += budget;
    }
    mean_units = units / cycles;
    return static_cast<double>(missed) / cycles;
  }
  double mean_units = 0;

 private:
  std::mt19937_64 random_;
};

TEST(Governor, KeepsEveryDeadlineInAllButAThousandthOfTheCycles) {
  for (const double deadline : {50e3, 100e3, 200e3}) {
    Machine machine{3};
    Governor governor{static_cast<std::int64_t>(deadline)};
    (void)machine.run(governor, deadline, 5000);
    EXPECT_LT(machine.run(governor, deadline, 200'000), 0.001) << deadline << " ns";
    EXPECT_GT(machine.mean_units * machine.unit_ns, (deadline - machine.rest_ns) * 0.2) << "most of it went unused";
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
    EXPECT_GT(machine.mean_units, before * 0.5);
  }
}

TEST(Governor, LetsARecordThroughEvenWhenAllElseTakesTheWholeDeadline) {
  constexpr double kDeadline = 50e3;
  Machine machine{7};
  machine.rest_ns = 80'000;
  Governor governor{static_cast<std::int64_t>(kDeadline)};
  (void)machine.run(governor, kDeadline, 50'000);
  EXPECT_GE(governor.budget().units, spm::Budget::kVisit + spm::Budget::kChange);
  EXPECT_LE(governor.budget().units * machine.unit_ns, kDeadline * 0.2);
}

}  // namespace
}  // namespace tactus::hrtc_service
