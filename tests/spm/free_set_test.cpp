#include "spm/free_set.hpp"

#include <gtest/gtest.h>

#include <cstdint>
#include <random>
#include <set>
#include <vector>

namespace tactus::spm {
namespace {

class OfSize : public ::testing::TestWithParam<std::uint32_t> {};

TEST_P(OfSize, EveryNumberIsTakenOnceUntilNoneIsLeft) {
  FreeSet set{GetParam()};
  std::mt19937 random{1};
  std::set<std::uint32_t> taken;
  for (std::uint32_t i = 0; i < GetParam(); ++i) {
    EXPECT_EQ(set.count(), GetParam() - i);
    const std::uint32_t number = set.allocate(static_cast<std::uint32_t>(random() % GetParam()));
    ASSERT_LT(number, GetParam());
    ASSERT_TRUE(taken.insert(number).second) << number << " was taken before";
  }
  EXPECT_EQ(set.count(), 0u);
}

TEST_P(OfSize, WhatIsGivenBackIsAllThatCanBeTaken) {
  FreeSet set{GetParam()};
  std::mt19937 random{2};
  std::set<std::uint32_t> held;
  for (int step = 0; step < 20000; ++step) {
    const bool take = set.count() > 0 && (held.empty() || random() % 2 == 0);
    const auto any = static_cast<std::uint32_t>(random() % GetParam());
    if (take) {
      ASSERT_TRUE(held.insert(set.allocate(any)).second) << "step " << step;
    } else {
      const auto given = held.lower_bound(any) == held.end() ? held.begin() : held.lower_bound(any);
      set.release(*given);
      held.erase(given);
    }
    ASSERT_EQ(set.count() + held.size(), GetParam()) << "step " << step;
  }
}

INSTANTIATE_TEST_SUITE_P(FreeSet, OfSize, ::testing::Values(1u, 63u, 64u, 65u, 4096u, 5000u, 10000u));

TEST(FreeSet, TakesFromTheGroupRequestedWhileItHasAny) {
  FreeSet set{1000};
  for (int i = 0; i < 64; ++i) EXPECT_EQ(set.allocate(200) / 64, 200u / 64);
  EXPECT_NE(set.allocate(200) / 64, 200u / 64);
}

TEST(FreeSet, TakesTheNextNumberThatIsFree) {
  FreeSet set{1000};
  EXPECT_EQ(set.allocate(130), 130u);
  EXPECT_EQ(set.allocate(130), 131u);
  set.release(130);
  EXPECT_EQ(set.allocate(130), 130u);
}

TEST(FreeSet, PrefersAGroupThatIsFreeAsAWholeWhenTheOneRequestedIsFull) {
  FreeSet set{4 * 64};
  for (int i = 0; i < 64; ++i) static_cast<void>(set.allocate(0));
  static_cast<void>(set.allocate(64));  // the second is no longer whole
  EXPECT_EQ(set.allocate(0), 128u);
}

TEST(FreeSet, LooksOnFromTheStartWhenNothingIsFreeBehind) {
  FreeSet set{20000};
  for (std::uint32_t i = 0; i < 20000; ++i) static_cast<void>(set.allocate(i));
  set.release(5);
  EXPECT_EQ(set.allocate(19999), 5u);
}

}  // namespace
}  // namespace tactus::spm
