#include "spm/free_set.hpp"

#include <gtest/gtest.h>

#include <cstdint>
#include <random>
#include <set>
#include <vector>

namespace tactus::spm {
namespace {

class FreeSetOfSize : public ::testing::TestWithParam<std::uint32_t> {};

TEST_P(FreeSetOfSize, AllocatesEveryNumberOnceUntilNoneIsFree) {
  FreeSet set{GetParam()};
  std::mt19937 random{1};
  std::set<std::uint32_t> allocated;
  for (std::uint32_t i = 0; i < GetParam(); ++i) {
    EXPECT_EQ(set.count(), GetParam() - i);
    const std::uint32_t number = set.allocate(static_cast<std::uint32_t>(random() % GetParam()));
    ASSERT_LT(number, GetParam());
    ASSERT_TRUE(allocated.insert(number).second) << number << " was allocated before";
  }
  EXPECT_EQ(set.count(), 0u);
}

TEST_P(FreeSetOfSize, AllocatesOnlyNumbersThatAreFree) {
  FreeSet set{GetParam()};
  std::mt19937 random{2};
  std::set<std::uint32_t> allocated;
  for (int step = 0; step < 20000; ++step) {
    const bool allocate = set.count() > 0 && (allocated.empty() || random() % 2 == 0);
    const auto number = static_cast<std::uint32_t>(random() % GetParam());
    if (allocate) {
      ASSERT_TRUE(allocated.insert(set.allocate(number)).second) << "step " << step;
    } else {
      auto released = allocated.lower_bound(number);
      if (released == allocated.end()) released = allocated.begin();
      set.release(*released);
      allocated.erase(released);
    }
    ASSERT_EQ(set.count() + allocated.size(), GetParam()) << "step " << step;
  }
}

INSTANTIATE_TEST_SUITE_P(Sizes, FreeSetOfSize, ::testing::Values(1u, 63u, 64u, 65u, 4096u, 5000u, 10000u));

TEST(FreeSet, AllocatesFromTheRequestedGroupUntilItIsFull) {
  FreeSet set{1000};
  for (int i = 0; i < 64; ++i) EXPECT_EQ(set.allocate(200) / 64, 200u / 64);
  EXPECT_NE(set.allocate(200) / 64, 200u / 64);
}

TEST(FreeSet, AllocatesTheNextFreeNumber) {
  FreeSet set{1000};
  EXPECT_EQ(set.allocate(130), 130u);
  EXPECT_EQ(set.allocate(130), 131u);
  set.release(130);
  EXPECT_EQ(set.allocate(130), 130u);
}

TEST(FreeSet, PrefersACompletelyFreeGroupWhenTheRequestedGroupIsFull) {
  FreeSet set{4 * 64};
  for (int i = 0; i < 64; ++i) static_cast<void>(set.allocate(0));
  static_cast<void>(set.allocate(64));  // the second group is no longer completely free
  EXPECT_EQ(set.allocate(0), 128u);
}

TEST(FreeSet, ContinuesAtTheStartWhenNoLaterNumberIsFree) {
  FreeSet set{20000};
  for (std::uint32_t i = 0; i < 20000; ++i) static_cast<void>(set.allocate(i));
  set.release(5);
  EXPECT_EQ(set.allocate(19999), 5u);
}

}  // namespace
}  // namespace tactus::spm
