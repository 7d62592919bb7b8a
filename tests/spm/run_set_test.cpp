#include "spm/run_set.hpp"

#include <gtest/gtest.h>

#include <random>
#include <set>

namespace tactus::spm {
namespace {

using Runs = std::vector<spm::Run>;  // a test has a Run of its own

class Random {
 public:
  explicit Random(std::uint32_t seed) : engine_{seed} {}
  /// 0 to `limit` - 1.
  std::uint32_t below(std::uint32_t limit) { return static_cast<std::uint32_t>(engine_() % limit); }
  Runs runs(std::uint32_t records, std::uint32_t most_gap, std::uint32_t most_count) {
    Runs runs;
    for (std::uint32_t at = below(most_gap); at < records; at += runs.back().count + 1 + below(most_gap))
      runs.push_back({at, std::min(1 + below(most_count), records - at)});
    return runs;
  }

 private:
  std::mt19937 engine_;
};

std::set<std::uint32_t> members(const Runs& runs) {
  std::set<std::uint32_t> all;
  for (const spm::Run& run : runs)
    for (std::uint32_t i = 0; i < run.count; ++i) all.insert(run.first + i);
  return all;
}

void expect_separate(const Runs& runs) {
  for (std::size_t i = 1; i < runs.size(); ++i)
    ASSERT_GT(runs[i].first, runs[i - 1].first + runs[i - 1].count) << "run " << i;
}

TEST(RunSetTest, HoldsAllThatWasAddedAndMissesAllElse) {
  for (std::uint32_t seed = 0; seed < 200; ++seed) {
    Random random{seed};
    RunSet set;
    std::set<std::uint32_t> held;
    for (int round = 0; round < 8; ++round) {
      const Runs added = random.runs(500, 1 + random.below(60), 1 + random.below(30));
      set.add(Span<const spm::Run>{added}, 10'000);
      held.merge(members(added));
      ASSERT_EQ(members(set.runs()), held) << "seed " << seed;
      expect_separate(set.runs());

      const Runs asked = random.runs(600, 1 + random.below(40), 1 + random.below(40));
      std::set<std::uint32_t> expected;
      for (const std::uint32_t record : members(asked))
        if (held.count(record) == 0) expected.insert(record);
      const Runs missing = set.missing(Span<const spm::Run>{asked});
      ASSERT_EQ(members(missing), expected) << "seed " << seed;
    }
  }
}

TEST(RunSetTest, ForgetsTheShortestWhenThereAreTooMany) {
  constexpr std::size_t kMost = 1280;
  Runs runs;
  for (std::uint32_t i = 0; i <= kMost; ++i) runs.push_back({i * 10, 1 + i % 8});
  RunSet set;
  set.add(Span<const spm::Run>{runs}, kMost);
  EXPECT_EQ(set.runs().size(), kMost / 4 * 3);
  const std::set<std::uint32_t> added = members(runs);
  std::size_t longest = 0;
  for (const spm::Run& run : set.runs()) {
    EXPECT_EQ(added.count(run.first), 1u);
    EXPECT_GE(run.count, 2u) << "the eighth of length 1 go first";
    longest += run.count == 8 ? 1 : 0;
  }
  EXPECT_EQ(longest, kMost / 8) << "no long one was forgotten";
}

}  // namespace
}  // namespace tactus::spm
