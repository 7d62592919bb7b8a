/// Whole sessions by seed. `TACTUS_SEED=n` replays one schedule, `TACTUS_SCHEDULES=n` runs more than the usual 300 (30
/// under ThreadSanitizer: one thread alone runs here).
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <string>

#include "tests/session/simulated_session.hpp"

namespace tactus::test_support {
namespace {

#ifdef __SANITIZE_THREAD__
constexpr std::uint64_t kSchedules = 30;
#else
constexpr std::uint64_t kSchedules = 300;
#endif

using testing::IsEmpty;

std::uint64_t environment(const char* name, std::uint64_t otherwise) {
  const char* value = std::getenv(name);
  return value == nullptr ? otherwise : std::strtoull(value, nullptr, 10);
}

TEST(DeliverySimulation, WithoutFaultsNothingIsRefusedOrSentTwice) {
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    Faults none;
    none.decode_ms = seed % 2 == 0 ? 30 : 0;
    const SimulationResult result = simulate(seed, none, 2, 1500);
    ASSERT_THAT(result.broken, IsEmpty()) << "seed " << seed;
    EXPECT_TRUE(result.converged) << "seed " << seed;
    EXPECT_EQ(result.regions_refused, 0u) << "seed " << seed;
    EXPECT_EQ(result.records_repeated, 0u) << "seed " << seed;
    EXPECT_GT(result.regions_released, 50u) << "seed " << seed << ": nothing was ever retired";
    EXPECT_EQ(result.host_changes, 0u) << "seed " << seed;
  }
}

TEST(DeliverySimulation, UnderFaultsAllHoldsAndConvergesAfterwards) {
  const bool one = std::getenv("TACTUS_SEED") != nullptr;
  const std::uint64_t first = environment("TACTUS_SEED", 1);
  const std::uint64_t count = one ? 1 : environment("TACTUS_SCHEDULES", kSchedules);
  SimulationResult all;
  for (std::uint64_t seed = first; seed < first + count; ++seed) {
    const SimulationResult result = simulate(seed, random_faults(seed), 2 + static_cast<int>(seed % 2), 1500);
    ASSERT_THAT(result.broken, IsEmpty()) << "replay with TACTUS_SEED=" << seed;
    ASSERT_TRUE(result.converged) << "replay with TACTUS_SEED=" << seed;
    all.regions_held += result.regions_held;
    all.regions_refused += result.regions_refused;
    all.regions_released += result.regions_released;
    all.host_changes += result.host_changes;
    all.crashes += result.crashes;
  }
  RecordProperty("regions_held", std::to_string(all.regions_held));
  RecordProperty("regions_refused", std::to_string(all.regions_refused));
  if (one) return;
  EXPECT_GT(all.regions_refused, 0u) << "the faults never bite";
  EXPECT_GT(all.host_changes, 0u);
  EXPECT_GT(all.crashes, 0u);
}

TEST(DeliverySimulation, OneSeedGivesOneRun) {
  const SimulationResult a = simulate(7, random_faults(7), 3, 800);
  const SimulationResult b = simulate(7, random_faults(7), 3, 800);
  EXPECT_EQ(a.chunks, b.chunks);
  EXPECT_EQ(a.regions_held, b.regions_held);
  EXPECT_EQ(a.regions_refused, b.regions_refused);
}

}  // namespace
}  // namespace tactus::test_support
