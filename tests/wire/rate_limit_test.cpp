#include "wire/rate_limit.hpp"

#include <gtest/gtest.h>

namespace tactus::wire {
namespace {

constexpr std::int64_t kSecond = 1'000'000'000;

TEST(RateLimitTest, AParticipantMaySendItsRateAndAfterAPauseABurst) {
  RateLimit limit{1000};
  const GuidPrefix flooding{1}, other{2};
  int admitted = 0;
  for (int i = 0; i < 1000; ++i) admitted += limit.admits(flooding, 0) ? 1 : 0;
  EXPECT_EQ(admitted, 125);
  EXPECT_TRUE(limit.admits(other, 0)) << "others are not limited";
  for (std::int64_t step = 1; step <= 10'000; ++step)
    admitted += limit.admits(flooding, step * kSecond / 10'000) ? 1 : 0;
  EXPECT_NEAR(admitted, 1125, 1);
  for (int i = 0; i < 1000; ++i) admitted += limit.admits(flooding, 100 * kSecond) ? 1 : 0;
  EXPECT_NEAR(admitted, 1250, 1);
}

TEST(RateLimitTest, ForgetsAllParticipantsWhenThereAreTooMany) {
  RateLimit limit{1};
  const auto participant = [](std::size_t i) {
    return GuidPrefix{static_cast<std::uint8_t>(i), static_cast<std::uint8_t>(i >> 8u)};
  };
  for (std::size_t i = 0; i < RateLimit::kMaxParticipants; ++i) EXPECT_TRUE(limit.admits(participant(i), 0));
  for (std::uint32_t i = 1; i < RateLimit::kMinBurst; ++i) EXPECT_TRUE(limit.admits(participant(0), 0));
  EXPECT_FALSE(limit.admits(participant(0), 0));
  EXPECT_TRUE(limit.admits(participant(RateLimit::kMaxParticipants), 0));
  EXPECT_TRUE(limit.admits(participant(0), 0));
}

}  // namespace
}  // namespace tactus::wire
