// Tests that a million lost, late, repeated and corrupted samples of a remote device cause no unsafe force.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "bench/safety_run.hpp"

namespace tactus::bench {
namespace {

using haptics::Fault;

std::uint64_t latched(const SafetyResult& result, Fault fault) {
  return result.faults[static_cast<std::size_t>(fault)];
}

TEST(Safety, AMillionCorruptedSamplesCauseNoUnsafeForce) {
  SafetySettings settings;
  settings.seed = 11;
  const SafetyResult result = run_safety(settings);

  EXPECT_THAT(result.problems, testing::IsEmpty());
  EXPECT_EQ(result.violations(), 0u);
  EXPECT_GE(result.arrived, settings.samples);
  // Without forces, and without work for each guard, the checks above would prove nothing.
  EXPECT_GT(result.force_cycles, result.cycles / 10);
  EXPECT_GT(result.torque_cycles, result.cycles / 20);
  EXPECT_GT(result.undecodable, 0u);
  EXPECT_GT(result.refused, 0u);
  EXPECT_GT(result.overtaken, 0u);
  EXPECT_GT(latched(result, Fault::kInputNotFinite), 0u);
  EXPECT_GT(latched(result, Fault::kTooFast), 0u);
  for (const std::uint64_t interventions : {result.interventions[0], result.interventions[1], result.interventions[2],
                                            result.interventions[3], result.interventions[6]})
    EXPECT_GT(interventions, 0u);
}

TEST(Safety, TheSameSeedGivesTheSameRun) {
  SafetySettings settings;
  settings.samples = 20'000;
  const SafetyResult first = run_safety(settings);
  const SafetyResult second = run_safety(settings);
  EXPECT_EQ(first.cycles, second.cycles);
  EXPECT_EQ(first.interventions, second.interventions);
  EXPECT_EQ(first.max_force, second.max_force);
}

}  // namespace
}  // namespace tactus::bench
