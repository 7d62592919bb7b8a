/// Simulates whole sessions, one for each seed.
/// `scripts/bench simulate` runs 10^5 of them, or one with a trace (--seed N).
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <optional>
#include <string>

#include "session/delivery_client.hpp"
#include "tests/session/simulated_session.hpp"

namespace tactus::test_support {
namespace {

#if defined(__SANITIZE_THREAD__) || defined(__SANITIZE_ADDRESS__)
constexpr std::uint64_t kSchedules = 200;
#else
constexpr std::uint64_t kSchedules = 2000;
#endif

using testing::HasSubstr;
using testing::IsEmpty;

PlannedFault crash_of_the_first_host() {
  PlannedFault fault;
  fault.kind = FaultKind::kCrash;
  fault.at_ns = 400 * kMs;
  fault.duration_ns = 2000 * kMs;
  fault.programs = 1;
  return fault;
}

TEST(SessionSimulation, WithoutFaultsNoRegionIsRefusedAndNoRecordIsRepeated) {
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    Schedule schedule;
    schedule.hrtc_faults.decode_ns = seed % 2 == 0 ? 30 * kMs : 0;
    const SimulationResult result = simulate(seed, schedule);
    ASSERT_THAT(result.violations, IsEmpty()) << "seed " << seed;
    EXPECT_EQ(result.hrtcs.regions_refused, 0u) << "seed " << seed;
    EXPECT_EQ(result.hrtcs.records_repeated, 0u) << "seed " << seed;
    EXPECT_GT(result.hrtcs.regions_released, 30u) << "seed " << seed << ": the HRTCs retire too few regions";
    EXPECT_EQ(result.host_changes, 0u) << "seed " << seed;
    EXPECT_EQ(result.hrtcs.false_suspicions, 0u) << "seed " << seed;
  }
}

TEST(SessionSimulation, AHostFailureIsDetectedWithin50Ms) {
  std::uint64_t detected = 0;
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    Schedule schedule;
    schedule.planned_faults.push_back(crash_of_the_first_host());
    const SimulationResult result = simulate(seed, schedule);
    ASSERT_THAT(result.violations, IsEmpty()) << "seed " << seed;
    EXPECT_LE(result.hrtcs.max_detection_ns, 50 * kMs) << "seed " << seed;
    detected += result.hrtcs.failures_detected;
  }
  EXPECT_GE(detected, 20u) << "no HRTC needed the host";
}

TEST(SessionSimulation, ANewHostRepeatsNoRecordOfTheRegionsInADemand) {
  SimulationResult total;
  for (std::uint64_t seed = 1; seed <= 40; ++seed) {
    Schedule schedule;
    schedule.planned_faults.push_back(crash_of_the_first_host());
    schedule.hrtc_faults.decode_ns = seed % 2 == 0 ? 30 * kMs : 0;
    const SimulationResult result = simulate(seed, schedule);
    ASSERT_THAT(result.violations, IsEmpty()) << "seed " << seed;
    total.hrtcs.records_received += result.hrtcs.records_received;
    total.hrtcs.records_repeated += result.hrtcs.records_repeated;
    total.host_changes += result.host_changes;
  }
  EXPECT_GT(total.host_changes, 40u);
  EXPECT_EQ(total.hrtcs.records_repeated, 0u) << "of " << total.hrtcs.records_received;
}

TEST(SessionSimulation, InvariantsHoldUnderThreeKindsOfFaultAndTheSessionRecovers) {
  SimulationResult total;
  for (std::uint64_t seed = 1; seed <= kSchedules; ++seed) {
    const SimulationResult result = simulate(seed, random_schedule(seed));
    ASSERT_THAT(result.violations, IsEmpty()) << "replay with scripts/bench simulate --seed " << seed;
    ASSERT_GE(result.samples_sent, 300u) << "seed " << seed;
    ASSERT_GE(result.fault_kinds(), 3u) << "seed " << seed;
    total.hrtcs.regions_refused += result.hrtcs.regions_refused;
    total.hrtcs.pages_held += result.hrtcs.pages_held;
    total.hrtcs.pages_refused += result.hrtcs.pages_refused;
    total.hrtcs.pages_forgotten += result.hrtcs.pages_forgotten;
    total.host_changes += result.host_changes;
    for (std::size_t kind = 0; kind < kFaultKinds; ++kind) total.fault_counts[kind] += result.fault_counts[kind];
  }
  EXPECT_GT(total.hrtcs.regions_refused, 0u) << "the faults had no effect";
  EXPECT_GT(total.hrtcs.pages_held, kSchedules);
  EXPECT_GT(total.hrtcs.pages_refused, 0u);
  EXPECT_GT(total.hrtcs.pages_forgotten, 0u);
  EXPECT_GT(total.host_changes, 0u);
  for (std::size_t kind = 0; kind < kFaultKinds; ++kind) EXPECT_GT(total.fault_counts[kind], 0u) << kFaultNames[kind];
}

TEST(SessionSimulation, TheTimeToRecoveryEndsWhereTheSilenceBegins) {
  // A run ends this long after the recovery.
  constexpr std::int64_t kSilenceNs = session::DeliverySettings{}.keep_alive_ns + 200 * kMs;
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    const Schedule schedule = random_schedule(seed);
    const SimulationResult result = simulate(seed, schedule);
    ASSERT_THAT(result.violations, IsEmpty()) << "seed " << seed;
    EXPECT_EQ(result.recovery_ns, result.virtual_ns - kSilenceNs - schedule.faulty_phase_ns) << "seed " << seed;
  }
}

TEST(SessionSimulation, ASessionThatDoesNotRecoverHasNoTimeToRecovery) {
  Schedule schedule;
  schedule.bug = InjectedBug::kReceivesNothing;
  const SimulationResult result = simulate(1, schedule);
  ASSERT_FALSE(result.violations.empty());
  EXPECT_EQ(result.recovery_ns, std::nullopt);
}

TEST(SessionSimulation, TheSameSeedGivesTheSameLog) {
  const auto log_of = [](std::uint64_t seed) {
    std::string log;
    (void)simulate(seed, random_schedule(seed), [&](const std::string& line) { log += line + '\n'; });
    return log;
  };
  EXPECT_EQ(log_of(7), log_of(7));
  EXPECT_NE(log_of(7), log_of(8));
}

struct BugCase {
  const char* name;
  InjectedBug bug;
  const char* violation;  // part of the text
};
class EveryInjectedBug : public testing::TestWithParam<BugCase> {};

TEST_P(EveryInjectedBug, IsDetected) {
  std::string violations;
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    Schedule schedule;
    schedule.hrtc_faults.decode_ns = 60 * kMs;
    schedule.bug = GetParam().bug;
    if (GetParam().bug == InjectedBug::kIgnoresFailureDetector)
      schedule.planned_faults.push_back(crash_of_the_first_host());
    for (const std::string& violation : simulate(seed, schedule).violations) violations += violation + '\n';
  }
  EXPECT_THAT(violations, HasSubstr(GetParam().violation));
}

constexpr BugCase kBugCases[] = {
    {"FreesRegionsEarly", InjectedBug::kFreesRegionsEarly, "was received without record"},
    {"LosesRecords", InjectedBug::kLosesRecords, "is not held"},
    {"ClocksDrift", InjectedBug::kClocksDrift, "is wrong by"},
    {"HostsDropHrtcs", InjectedBug::kHostsDropHrtcs, "records of regions that were never retired"},
    {"ReceivesNothing", InjectedBug::kReceivesNothing, "the roster of"},
    {"IgnoresFailureDetector", InjectedBug::kIgnoresFailureDetector, "which has not answered for"},
    {"ForgetsPagesSilently", InjectedBug::kForgetsPagesSilently, "lacks wanted regions or pages"}};

INSTANTIATE_TEST_SUITE_P(SessionSimulation, EveryInjectedBug, testing::ValuesIn(kBugCases),
                         [](const auto& instance) { return instance.param.name; });

}  // namespace
}  // namespace tactus::test_support
