/// Whole sessions by seed. `scripts/bench simulate` runs 10^5 of them, or one with a trace (--seed N).
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>

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

PlannedFault death_of_the_first_host() {
  PlannedFault fault;
  fault.kind = FaultKind::kCrash;
  fault.at_ns = 400 * kMs;
  fault.lasts_ns = 2000 * kMs;
  fault.programs = 1;
  return fault;
}

TEST(SessionSimulation, WithoutFaultsNothingIsRefusedOrSentTwiceAndAllAgree) {
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    Schedule none;
    none.hrtcs.decode_ns = seed % 2 == 0 ? 30 * kMs : 0;
    const SimulationResult result = simulate(seed, none);
    ASSERT_THAT(result.broken, IsEmpty()) << "seed " << seed;
    EXPECT_EQ(result.hrtcs.regions_refused, 0u) << "seed " << seed;
    EXPECT_EQ(result.hrtcs.records_repeated, 0u) << "seed " << seed;
    EXPECT_GT(result.hrtcs.regions_released, 30u) << "seed " << seed << ": nothing was ever retired";
    EXPECT_EQ(result.host_changes, 0u) << "seed " << seed;
    EXPECT_EQ(result.hrtcs.false_suspicions, 0u) << "seed " << seed;
  }
}

TEST(SessionSimulation, AHostFailureIsDetectedLongBeforeTheRosterReportsIt) {
  std::uint64_t noticed = 0;
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    Schedule crash;
    crash.planned.push_back(death_of_the_first_host());
    const SimulationResult result = simulate(seed, crash);
    ASSERT_THAT(result.broken, IsEmpty()) << "seed " << seed;
    EXPECT_LE(result.hrtcs.noticed_ns, 50 * kMs) << "seed " << seed;
    noticed += result.hrtcs.deaths_noticed;
  }
  EXPECT_GE(noticed, 20u) << "or no HRTC needed the host";
}

TEST(SessionSimulation, ATakeoverRepeatsNoRecordThatADemandReported) {
  SimulationResult all;
  for (std::uint64_t seed = 1; seed <= 40; ++seed) {
    Schedule crash;
    crash.planned.push_back(death_of_the_first_host());
    crash.hrtcs.decode_ns = seed % 2 == 0 ? 30 * kMs : 0;
    const SimulationResult result = simulate(seed, crash);
    ASSERT_THAT(result.broken, IsEmpty()) << "seed " << seed;
    all.hrtcs.records_received += result.hrtcs.records_received;
    all.hrtcs.records_repeated += result.hrtcs.records_repeated;
    all.host_changes += result.host_changes;
  }
  EXPECT_GT(all.host_changes, 40u);
  EXPECT_EQ(all.hrtcs.records_repeated, 0u) << "of " << all.hrtcs.records_received;
}

TEST(SessionSimulation, InvariantsHoldUnderThreeKindsOfFaultAndTheSessionRecovers) {
  SimulationResult all;
  for (std::uint64_t seed = 1; seed <= kSchedules; ++seed) {
    const SimulationResult result = simulate(seed, random_schedule(seed));
    ASSERT_THAT(result.broken, IsEmpty()) << "replay with scripts/bench simulate --seed " << seed;
    ASSERT_GE(result.messages, 300u) << "seed " << seed;
    ASSERT_GE(result.kinds(), 3u) << "seed " << seed;
    all.hrtcs.regions_refused += result.hrtcs.regions_refused;
    all.host_changes += result.host_changes;
    for (std::size_t kind = 0; kind < kFaultKinds; ++kind) all.faults[kind] += result.faults[kind];
  }
  EXPECT_GT(all.hrtcs.regions_refused, 0u) << "the faults have no effect";
  EXPECT_GT(all.host_changes, 0u);
  for (std::size_t kind = 0; kind < kFaultKinds; ++kind) EXPECT_GT(all.faults[kind], 0u) << kFaultNames[kind];
}

TEST(SessionSimulation, OneSeedGivesOneRun) {
  const auto log_of = [](std::uint64_t seed) {
    std::string log;
    (void)simulate(seed, random_schedule(seed), [&](const std::string& line) { log += line + '\n'; });
    return log;
  };
  EXPECT_EQ(log_of(7), log_of(7));
  EXPECT_NE(log_of(7), log_of(8));
}

struct Mistake {
  const char* name;
  Sabotage sabotage;
  const char* noticed;
};
class EveryMistake : public testing::TestWithParam<Mistake> {};

TEST_P(EveryMistake, IsDetected) {
  std::string all;
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    Schedule schedule;
    schedule.hrtcs.decode_ns = 60 * kMs;
    schedule.sabotage = GetParam().sabotage;
    if (GetParam().sabotage == Sabotage::kTrusting) schedule.planned.push_back(death_of_the_first_host());
    for (const std::string& what : simulate(seed, schedule).broken) all += what + '\n';
  }
  EXPECT_THAT(all, HasSubstr(GetParam().noticed));
}

constexpr Mistake kMistakes[] = {{"FreeEarly", Sabotage::kFreeEarly, "came without record"},
                                 {"Forget", Sabotage::kForget, "is not held"},
                                 {"RunFast", Sabotage::kRunFast, "is wrong by"},
                                 {"SendTwice", Sabotage::kSendTwice, "held all along"},
                                 {"Deaf", Sabotage::kDeaf, "the roster of"},
                                 {"Trusting", Sabotage::kTrusting, "which has not answered for"}};

INSTANTIATE_TEST_SUITE_P(SessionSimulation, EveryMistake, testing::ValuesIn(kMistakes),
                         [](const auto& instance) { return instance.param.name; });

}  // namespace
}  // namespace tactus::test_support
