/// Causes random faults in a session in a network namespace. Checks that the session recovers from each of them, that
/// no process grows, and that a replay computes the same forces.
#include <gtest/gtest.h>

#include "bench/fault_runs.hpp"
#include "bench/live_session.hpp"
#include "netem/pair.hpp"
#include "tests/support/sanitizer.hpp"

namespace tactus::bench {
namespace {

/// Expects that every row of the report holds. A sanitizer delays the reuse of freed memory, so the growth of memory
/// is not checked in its builds.
void expect_recovery(double seconds) {
  // Without its own network namespace, it would drop packets of other programs of this machine.
  if (const std::string missing = netem::missing_privilege(); !missing.empty()) GTEST_SKIP() << missing;
  FaultSettings settings;
  settings.seconds = seconds;
  Report report{{"a host, and an HRTC with two users", 0, 0, ""}};
  in_own_thread([&] { measure_random_faults(settings, report); });
  for (const Row& row : report.rows()) {
    if (test_support::kSanitized && row.figure.find("growth of the memory") != std::string::npos) continue;
    EXPECT_NE(row.verdict(), Verdict::kFallsShort) << row.figure << ": " << row.value << ' ' << row.unit;
  }
}

TEST(RandomFaults, OfAMinuteLeaveTheSessionWhole) { expect_recovery(60); }
TEST(LongRandomFaults, OfAnHourLeaveTheSessionWhole) { expect_recovery(3600); }

}  // namespace
}  // namespace tactus::bench
