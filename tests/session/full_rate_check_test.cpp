#include "session/full_rate_check.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "tests/support/constants.hpp"

namespace tactus::session {
namespace {

/// Sends a state each millisecond to a check.
class FullRateCheckTest : public ::testing::Test {
 protected:
  /// Sends states for `seconds`. `loss`: the share that is lost, at random. `delay_ms`: transit of the others.
  void send(double seconds, double loss, std::int64_t delay_ms) {
    for (int i = 0; i < std::lround(1000 * seconds); ++i, now_ += kMs) {
      ++number_;
      if (uniform_(random_) >= loss) check_.on_state(number_, delay_ms * kMs, now_ + delay_ms * kMs);
      arrival_ = now_ + delay_ms * kMs;
    }
  }
  [[nodiscard]] bool is_too_slow() const { return check_.is_too_slow(arrival_); }

  FullRateCheck check_;
  std::int64_t now_ = 1000 * kMs, arrival_ = now_;
  std::uint32_t number_ = 0;
  std::mt19937 random_{1};
  std::uniform_real_distribution<double> uniform_{0, 1};
};

TEST_F(FullRateCheckTest, ALinkThatLosesThirtyPercentPasses) {
  send(20, 0.3, 5);
  EXPECT_FALSE(is_too_slow());
  EXPECT_NEAR(check_.missed_share(), 0.3, 0.1);
}

TEST_F(FullRateCheckTest, ALinkThatLosesHalfIsTooSlowAfterASecond) {
  send(0.8, 0.5, 5);
  EXPECT_FALSE(is_too_slow());
  send(0.3, 0.5, 5);
  EXPECT_TRUE(is_too_slow());
  EXPECT_NEAR(check_.missed_share(), 0.5, 0.12);
}

TEST_F(FullRateCheckTest, AQueueThatDelaysStatesIsTooSlow) {
  send(1, 0, 10);
  send(5, 0, 200);
  EXPECT_FALSE(is_too_slow()) << "190 ms later than the fastest state";
  send(4, 0, 220);
  EXPECT_TRUE(is_too_slow());
  send(2, 0, 10);
  EXPECT_FALSE(is_too_slow()) << "the queue is empty again";
}

TEST_F(FullRateCheckTest, ALongConstantDelayPasses) {
  send(10, 0, 600);
  EXPECT_FALSE(is_too_slow());
}

TEST_F(FullRateCheckTest, AnInterruptionStartsTheCheckAnew) {
  send(5, 0.6, 5);
  EXPECT_TRUE(is_too_slow());
  arrival_ += 501 * kMs;
  EXPECT_FALSE(check_.is_active(arrival_));
  EXPECT_FALSE(is_too_slow()) << "no states arrive";
  now_ += 5000 * kMs;
  number_ += 5000;
  send(5, 0, 5);
  EXPECT_FALSE(is_too_slow());
  EXPECT_EQ(check_.missed_share(), 0);
}

TEST_F(FullRateCheckTest, CountsOvertakenStatesAsArrived) {
  for (int i = 0; i < 5000; i += 2, now_ += 2 * kMs) {
    number_ += 2;
    check_.on_state(number_, 5 * kMs, now_);
    check_.on_state(number_ - 1, 5 * kMs, now_);
  }
  EXPECT_LT(check_.missed_share(), 0.01);
}

TEST_F(FullRateCheckTest, FollowsASenderThatCountsFromTheBeginning) {
  send(5, 0, 5);
  number_ = 0;
  send(5, 0.6, 5);
  EXPECT_TRUE(is_too_slow());
}

}  // namespace
}  // namespace tactus::session
