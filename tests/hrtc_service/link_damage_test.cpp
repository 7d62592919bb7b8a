/// Writes random bytes everywhere in the memory that a gateway can write, while the servo runs.
#include <gtest/gtest.h>

#include <atomic>
#include <limits>
#include <random>
#include <thread>

#include "tests/support/damaged_link.hpp"

namespace tactus::hrtc_service {
namespace {

constexpr int kWritesPerCycle = 100;
constexpr int kCyclesPerRestore = 500;  // after which the servo finds valid values again

class LinkDamageTest : public testing::Test {
 protected:
  /// Writes at a random place of the next page: a random byte, or a value at the edge of its type.
  void damage() {
    constexpr std::size_t kPage = 4096;
    const std::size_t pages = (link_.size() + kPage - 1) / kPage;
    page_ = (page_ + 1) % pages;
    const std::size_t offset = page_ * kPage + random_() % kPage;
    static const double kDoubles[] = {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity(),
                                      -1e300, 1e-300, 0.0};
    static const std::uint64_t kIntegers[] = {0, 1, 0x7fffffff, 0xffffffff, 1ull << 63, ~0ull};
    std::uint64_t value = random_();
    std::size_t size = 1;
    if (value % 4 == 0) {
      std::memcpy(&value, &kDoubles[random_() % std::size(kDoubles)], size = sizeof value);
    } else if (value % 4 == 1) {
      value = kIntegers[random_() % std::size(kIntegers)];
      size = random_() % 2 == 0 ? 4 : 8;
    }
    link_.damage(offset, std::as_bytes(std::span{&value, 1}).first(size));
  }

  void run_cycle(int cycle) {
    if (!link_.run_cycle()) ++wrong_;
    if (cycle % kCyclesPerRestore == kCyclesPerRestore - 1) link_.restore();
  }

  void damage_link(int writes) {
    const int cycles = writes / kWritesPerCycle;
    for (int cycle = 0; cycle < cycles; ++cycle) {
      for (int i = 0; i < kWritesPerCycle; ++i) damage();
      run_cycle(cycle);
    }
    expect_no_force_above_limits(cycles);
  }
  /// The same by a second thread, so that a value also changes between a check and its use.
  void damage_link_during_cycles(int writes) {
    const int cycles = writes / kWritesPerCycle;
    std::atomic<int> cycle{0};
    std::jthread writer{[&] {
      for (int done = 0; done < writes;) {
        if (done < kWritesPerCycle * (cycle + 1)) damage(), ++done;
      }
    }};
    for (; cycle < cycles; ++cycle) run_cycle(cycle);
    writer.join();
    expect_no_force_above_limits(cycles);
  }
  void expect_no_force_above_limits(int cycles) const {
    EXPECT_EQ(wrong_, 0);
    EXPECT_GT(link_.forces(0), cycles / 20) << "of a fixed object; too few, so the limits were hardly tested";
    EXPECT_GT(link_.forces(1), 0) << "of a movable object";
  }

  test_support::DamagedLink link_;
  std::mt19937_64 random_{20261126};
  std::size_t page_ = 0;
  int wrong_ = 0;  // cycles with a force or torque above the limits
};

TEST_F(LinkDamageTest, OfAMillionWritesExceedsNoLimit) { damage_link(1'000'000); }

// ThreadSanitizer would report each of these writes.
#ifndef __SANITIZE_THREAD__
TEST_F(LinkDamageTest, OfAMillionWritesDuringCyclesExceedsNoLimit) { damage_link_during_cycles(1'000'000); }
#endif

using LinkDamageNightly = LinkDamageTest;
TEST_F(LinkDamageNightly, OfTenMillionWritesExceedsNoLimit) { damage_link(10'000'000); }
#ifndef __SANITIZE_THREAD__
TEST_F(LinkDamageNightly, OfTenMillionWritesDuringCyclesExceedsNoLimit) { damage_link_during_cycles(10'000'000); }
#endif

}  // namespace
}  // namespace tactus::hrtc_service
