#include "hrtc_service/statistics.hpp"

#include <gmock/gmock.h>

namespace tactus::hrtc_service {
namespace {

/// Adds 100 cycles; 2 of them take ten times as long.
void add_cycles(CycleStatistics& statistics, std::uint32_t query_ns) {
  for (int i = 0; i < 100; ++i) {
    CycleTrace trace;
    trace.costs.query = i % 50 == 0 ? 10 * query_ns : query_ns;
    statistics.add(trace);
  }
}

double value_of(const std::vector<session::Figure>& figures, const std::string& name) {
  for (const session::Figure& figure : figures)
    if (figure.name == name) return figure.value;
  return -1;
}

TEST(CycleStatistics, RecentCyclesAreThoseSinceTheFiguresBefore) {
  CycleStatistics statistics;
  add_cycles(statistics, 20'000);
  std::vector<session::Figure> first, second, third;
  statistics.add_figures(first, true);
  EXPECT_EQ(value_of(first, session::figures::kRecentCycleP99), 200);
  EXPECT_EQ(value_of(first, std::string{session::figures::kCycleTime} + ".p99"), 200);
  add_cycles(statistics, 5'000);
  statistics.add_figures(second, true);
  EXPECT_EQ(value_of(second, session::figures::kRecentCycleP99), 50);
  EXPECT_EQ(value_of(second, std::string{session::figures::kCycleTime} + ".max"), 200);
  statistics.add_figures(third, false);
  EXPECT_EQ(value_of(third, session::figures::kRecentCycleP99), -1) << "without cycles there is no percentile";
}

}  // namespace
}  // namespace tactus::hrtc_service
