#include <gmock/gmock.h>

#include <limits>

#include "bench/cycle_log.hpp"
#include "bench/flight_cycles.hpp"
#include "session/messages.hpp"
#include "tests/support/temporary_folder.hpp"

namespace tactus::bench {
namespace {

using testing::ElementsAre;

/// Writes recordings of one probe, and checks them.
class ForceCheckerTest : public testing::Test {
 protected:
  ForceCheckerTest() {
    start_.period = 1e-3;
    start_.max_force = 8;
    start_.max_slew = 1000;  // N/s: 1 N in a cycle
    start_.max_torque = 0.3;
    start_.max_torque_slew = 100;
    start_.zero_force_age = 0.06;
    start_.devices = {{.max_force = 3, .max_torque = 0.3}};
  }
  struct Cycle {
    std::uint64_t number;
    double force;
    std::uint32_t status = 0;
    double pose_age = 0.001, torque = 0;
    std::int64_t time_ns = 0;  // 0: the number in ms
  };
  void check(const std::vector<Cycle>& cycles) {
    {
      trace::FlightFileWriter writer{file_};
      writer.write(start_);
      for (const Cycle& cycle : cycles) {
        trace::FlightProbe probe;
        probe.cycle = cycle.number;
        probe.force = {0, 0, cycle.force};
        probe.torque = {cycle.torque, 0, 0};
        probe.status = cycle.status;
        probe.pose_age = cycle.pose_age;
        writer.write(probe);
        trace::FlightTouch touch;
        touch.cycle = cycle.number;
        touch.time_ns = cycle.time_ns != 0 ? cycle.time_ns : static_cast<std::int64_t>(cycle.number) * 1'000'000;
        writer.write(touch);
      }
      writer.close();
    }
    checker_.check(file_);
  }

  trace::FlightStart start_;
  ForceChecker checker_;

 private:
  test_support::TemporaryFolder folder_;
  std::filesystem::path file_ = folder_.path() / "flight.mcap";
};

TEST_F(ForceCheckerTest, FindsNothingInForcesWithinTheirLimits) {
  check({{1, 0}, {2, 0.9}, {3, 1.8}, {4, 2.7}, {5, 2}});
  EXPECT_EQ(checker_.cycles(), 5u);
  EXPECT_EQ(checker_.missing(), 0u);
  EXPECT_EQ(checker_.violations(), 0u);
  EXPECT_EQ(checker_.max_force(), 2.7);
  EXPECT_NEAR(checker_.max_step(), 0.9, 1e-9);
}

TEST_F(ForceCheckerTest, FindsForcesThatBreakARule) {
  check({{1, std::numeric_limits<double>::quiet_NaN()}});
  check({{2, 3}, {3, 3.1}});
  check({{4, 2}, {5, 0.5}});
  check({{6, 0.5, 0, 0.001, 0.25}, {7, 0.5, 0, 0.001, 0.31}});
  EXPECT_THAT(checker_.texts(), ElementsAre("cycle 1: the force of probe 0 is not finite",
                                            "cycle 3: the force of probe 0 is above its limit",
                                            "cycle 4: the force of probe 0 changes faster than its slew limit",
                                            "cycle 5: the force of probe 0 changes faster than its slew limit",
                                            "cycle 6: the torque of probe 0 changes faster than its slew limit",
                                            "cycle 7: the torque of probe 0 is above its limit"));
}

TEST_F(ForceCheckerTest, AForceIsZeroAfterAFaultAndWithoutNewPoses) {
  check({{1, 2}, {2, 0, session::kFault}, {3, 1, session::kFault}});
  check({{4, 0}, {5, 1, 0, 0.07}});
  EXPECT_THAT(checker_.texts(), ElementsAre("cycle 3: the force of probe 0 acts in spite of a fault",
                                            "cycle 5: the force of probe 0 acts on a pose that is too old"));
}

TEST_F(ForceCheckerTest, OnlyAFaultOrAnOldPoseMayEndAForceAtOnce) {
  check({{1, 2}, {2, 0}});
  check({{4, 2}, {5, 0, 0, 0.06}});
  check({{7, 2}, {8, 0, session::kFault}});
  check({{10, 2}, {11, 0, session::kStalePose, 0.03}});
  check({{13, 0.5}, {14, 0}});
  EXPECT_THAT(checker_.texts(), ElementsAre("cycle 2: the force of probe 0 changes faster than its slew limit",
                                            "cycle 11: the force of probe 0 changes faster than its slew limit"));
}

TEST_F(ForceCheckerTest, ChecksCyclesOfOverlappingRecordingsOnce) {
  check({{1, 1}, {2, 2}, {3, 2}});
  check({{2, 2}, {3, 2}, {4, 3}});
  check({{3, 2}, {4, 3}, {5, 1}});
  EXPECT_EQ(checker_.cycles(), 5u);
  EXPECT_EQ(checker_.missing(), 0u);
  EXPECT_THAT(checker_.texts(), ElementsAre("cycle 5: the force of probe 0 changes faster than its slew limit"));
}

TEST_F(ForceCheckerTest, CountsMissingCyclesAndTimesThatDoNotGrow) {
  check({{5, 1}, {6, 1}});
  check({{10, 3}, {11, 3, 0, 0.001, 0, 10'000'000}});
  EXPECT_EQ(checker_.cycles(), 4u);
  EXPECT_EQ(checker_.missing(), 3u);
  EXPECT_THAT(checker_.texts(), ElementsAre("cycle 11: its time is not after that of the cycle before"));
}

/// Cycles at 1, 2, 22 and 23 ms. The window begins between the second and the third.
TEST(CycleFigures, ContainTheIntervalInWhichTheWindowBegins) {
  const Cycles cycles{{1'000'000, 2'000'000, 22'000'000, 23'000'000}, {{1, 1}, {1, 1}, {0.4, 1}, {0.4, 1}}};
  CycleFigures figures;
  figures.add(cycles, {2'500'000, 30'000'000});
  EXPECT_EQ(figures.late, 1u);
  EXPECT_EQ(figures.intervals_ms.size(), 2u);
  EXPECT_EQ(figures.intervals_ms.max(), 20);
  EXPECT_NEAR(figures.force_change, 0.6, 1e-9);
  EXPECT_EQ(figures.min_force, 0.4);
}

TEST(CycleFigures, HaveNoIntervalBeforeTheFirstCycleOfTheRecording) {
  CycleFigures figures;
  figures.add({{1'000'000, 2'000'000}, {{1, 1}, {1, 1}}}, {0, 30'000'000});
  figures.add({}, {0, 30'000'000});
  EXPECT_EQ(figures.intervals_ms.size(), 1u);
  EXPECT_EQ(figures.late, 0u);
}

}  // namespace
}  // namespace tactus::bench
