#include "hrtc_service/servo/overload.hpp"

#include <gtest/gtest.h>

namespace tactus::hrtc_service {
namespace {

constexpr std::int64_t kMs = 1'000'000;

class OverloadTest : public testing::Test {
 protected:
  /// Observes a cycle with this time on the clock, of which the thread ran for `cpu_ns`.
  bool cycle(std::int64_t work_ns, std::int64_t cpu_ns) {
    cpu_ns_ += cpu_ns;
    return overload_.observe(work_ns, [this] { return cpu_ns_; });
  }

  Overload overload_{kMs};
  std::int64_t cpu_ns_ = 12'345 * kMs;
};

TEST_F(OverloadTest, FiftyHeavyCyclesAreAnOverload) {
  (void)cycle(kMs / 10, kMs / 10);
  int cycles = 1;
  while (!cycle(5 * kMs, 5 * kMs) && cycles < 1000) ++cycles;
  EXPECT_EQ(cycles, 50);
}

TEST_F(OverloadTest, AHeavyShareOfMoreThanASixthIsAnOverload) {
  const auto overloads = [this](int light_after_each) {
    bool overload = false;
    for (int i = 0; i < 2000 && !overload; ++i) {
      overload = cycle(9 * kMs, 9 * kMs);
      for (int light = 0; light < light_after_each; ++light) overload = cycle(kMs, kMs) || overload;
    }
    return overload;
  };
  EXPECT_FALSE(overloads(5));
  EXPECT_TRUE(overloads(4));
}

TEST_F(OverloadTest, DelaysByOtherProgramsAreNone) {
  for (int i = 0; i < 1000; ++i) EXPECT_FALSE(cycle(20 * kMs, 2 * kMs));
}

TEST_F(OverloadTest, CyclesOfThreePeriodsAreNone) {
  for (int i = 0; i < 1000; ++i) EXPECT_FALSE(cycle(3 * kMs, 3 * kMs));
}

}  // namespace
}  // namespace tactus::hrtc_service
