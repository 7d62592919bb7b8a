#include "spm/interval_set.hpp"

#include <gtest/gtest.h>

#include <random>
#include <set>

namespace tactus::spm {
namespace {

using Intervals = std::vector<spm::Interval>;

class Random {
 public:
  explicit Random(std::uint32_t seed) : engine_{seed} {}
  /// Returns a number from 0 to `limit` - 1.
  std::uint32_t below(std::uint32_t limit) { return static_cast<std::uint32_t>(engine_() % limit); }
  Intervals intervals(std::uint32_t records, std::uint32_t max_gap, std::uint32_t max_count) {
    Intervals intervals;
    for (std::uint32_t first = below(max_gap); first < records; first += intervals.back().count + 1 + below(max_gap))
      intervals.push_back({first, std::min(1 + below(max_count), records - first)});
    return intervals;
  }

 private:
  std::mt19937 engine_;
};

std::set<std::uint32_t> members(const Intervals& intervals) {
  std::set<std::uint32_t> all;
  for (const spm::Interval& interval : intervals)
    for (std::uint32_t i = 0; i < interval.count; ++i) all.insert(interval.first + i);
  return all;
}

void expect_separate(const Intervals& intervals) {
  for (std::size_t i = 1; i < intervals.size(); ++i)
    ASSERT_GT(intervals[i].first, intervals[i - 1].first + intervals[i - 1].count) << "interval " << i;
}

TEST(IntervalSetTest, ContainsTheAddedRecordsAndReportsAllOthersAsMissing) {
  for (std::uint32_t seed = 0; seed < 200; ++seed) {
    Random random{seed};
    IntervalSet set;
    std::set<std::uint32_t> contained;
    for (int round = 0; round < 8; ++round) {
      const Intervals added = random.intervals(500, 1 + random.below(60), 1 + random.below(30));
      set.add(std::span<const spm::Interval>{added}, 10'000);
      contained.merge(members(added));
      ASSERT_EQ(members(set.intervals()), contained) << "seed " << seed;
      expect_separate(set.intervals());

      const Intervals requested = random.intervals(600, 1 + random.below(40), 1 + random.below(40));
      std::set<std::uint32_t> expected;
      for (const std::uint32_t record : members(requested))
        if (contained.count(record) == 0) expected.insert(record);
      const Intervals missing = set.missing(std::span<const spm::Interval>{requested});
      ASSERT_EQ(members(missing), expected) << "seed " << seed;
    }
  }
}

TEST(IntervalSetTest, RemovesTheShortestIntervalsWhenThereAreTooMany) {
  constexpr std::size_t kMax = 1280;
  Intervals intervals;
  for (std::uint32_t i = 0; i <= kMax; ++i) intervals.push_back({i * 10, 1 + i % 8});
  IntervalSet set;
  set.add(std::span<const spm::Interval>{intervals}, kMax);
  EXPECT_EQ(set.intervals().size(), kMax / 4 * 3);
  const std::set<std::uint32_t> added = members(intervals);
  std::size_t longest = 0;
  for (const spm::Interval& interval : set.intervals()) {
    EXPECT_EQ(added.count(interval.first), 1u);
    EXPECT_GE(interval.count, 2u) << "intervals of length 1 are removed first";
    longest += interval.count == 8 ? 1 : 0;
  }
  EXPECT_EQ(longest, kMax / 8) << "an interval of the maximum length was removed";
}

}  // namespace
}  // namespace tactus::spm
