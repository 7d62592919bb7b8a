#include "session/sequence_window.hpp"

#include <gtest/gtest.h>

#include <random>

#include "tests/support/constants.hpp"

namespace tactus::session {
namespace {

constexpr SequenceLimits kLimits{10, 1000};

/// A window that has accepted the numbers 1 to 100, one each millisecond, and 100 at 100 ms.
SequenceWindow after_hundred(const SequenceLimits& limits = kLimits) {
  SequenceWindow window{limits};
  for (std::uint64_t i = 1; i <= 100; ++i) EXPECT_TRUE(accepted(window.admit(i, static_cast<std::int64_t>(i) * kMs)));
  return window;
}

Origin sender(std::uint64_t participant, std::uint64_t incarnation) { return {1, participant, incarnation, 0}; }

TEST(SequenceWindow, ANumberMayBeLargerByTheFixedLimitPlusRateTimesTime) {
  for (const std::int64_t passed_ms : {0, 1, 50, 3'600'000}) {
    const auto max = 100 + 10 + static_cast<std::uint64_t>(passed_ms);
    EXPECT_EQ(after_hundred().admit(max, (100 + passed_ms) * kMs), Admission::kAccepted);
    EXPECT_EQ(after_hundred().admit(max + 1, (100 + passed_ms) * kMs), Admission::kImplausible);
  }
  EXPECT_EQ(after_hundred().admit(UINT64_MAX, 101 * kMs), Admission::kImplausible);
}

TEST(SequenceWindow, DropsOneImplausibleNumber) {
  SequenceWindow window = after_hundred();
  EXPECT_EQ(window.admit(4'000'000'000, 101 * kMs), Admission::kImplausible);
  EXPECT_EQ(window.newest(), 100u);
  EXPECT_EQ(window.admit(101, 101 * kMs), Admission::kAccepted);
}

TEST(SequenceWindow, AnOvertakenOrRepeatedNumberIsOld) {
  SequenceWindow window = after_hundred();
  EXPECT_EQ(window.admit(100, 101 * kMs), Admission::kOld);
  EXPECT_EQ(window.admit(90, 101 * kMs), Admission::kOld);
  EXPECT_EQ(window.admit(89, 101 * kMs), Admission::kImplausible);
}

TEST(SequenceWindow, AcceptsAJumpAfterThreeConsecutiveNumbers) {
  for (const std::uint64_t to : {std::uint64_t{1} << 40, std::uint64_t{1}}) {
    SequenceWindow window = after_hundred();
    EXPECT_EQ(window.admit(to, 150 * kMs), Admission::kImplausible);
    EXPECT_EQ(window.admit(to, 150 * kMs), Admission::kImplausible) << "a repetition is no successor";
    EXPECT_EQ(window.admit(to + 1, 151 * kMs), Admission::kImplausible);
    EXPECT_EQ(window.admit(to + 2, 152 * kMs), Admission::kNewStart);
    EXPECT_EQ(window.admit(to + 3, 153 * kMs), Admission::kAccepted);
  }
}

TEST(SequenceWindow, AcceptsNoJumpIfTheNumbersAreNotConsecutiveOrAreInterrupted) {
  SequenceWindow window = after_hundred();
  for (std::uint64_t i = 1; i < 100; ++i)
    EXPECT_EQ(window.admit(i << 40, 101 * kMs), Admission::kImplausible) << "no number follows its predecessor";
  for (std::uint64_t i = 1; i < 100; ++i) {
    const std::int64_t now = static_cast<std::int64_t>(101 + i) * kMs;
    ASSERT_EQ(window.admit((std::uint64_t{1} << 40) + i, now), Admission::kImplausible);
    ASSERT_EQ(window.admit(100 + i, now), Admission::kAccepted);
  }
}

TEST(SequenceWindow, TheFirstNumberIsUnconfirmedUntilTheNextNumberFollowsIt) {
  SequenceWindow window{kLimits};
  EXPECT_EQ(window.admit(UINT64_MAX, 0), Admission::kNewStart);
  EXPECT_EQ(window.admit(7, kMs), Admission::kNewStart);
  EXPECT_FALSE(window.confirmed());
  EXPECT_EQ(window.admit(8, 2 * kMs), Admission::kAccepted);
  EXPECT_TRUE(window.confirmed());
  EXPECT_EQ(window.admit(UINT64_MAX, 3 * kMs), Admission::kImplausible);
}

TEST(SequenceWindow, AcceptsRepetitionsOfTheNewestNumberIfTheyAreAllowed) {
  SequenceWindow window = after_hundred({10, 1000, true});
  EXPECT_EQ(window.admit(100, 101 * kMs), Admission::kAccepted);
  EXPECT_EQ(window.admit(99, 102 * kMs), Admission::kOld);
  for (int i = 0; i < 2; ++i) EXPECT_EQ(window.admit(5000, 103 * kMs), Admission::kImplausible);
  EXPECT_EQ(window.admit(5000, 104 * kMs), Admission::kNewStart) << "equal numbers agree";
}

TEST(SequenceWindow, AConfirmedFencingNumberNeverDecreases) {
  SequenceWindow window{{10, 1000, true, false}, std::uint64_t{1} << 40, 0};
  for (std::int64_t i = 0; i < 100; ++i) EXPECT_EQ(window.admit(5, i * kMs), Admission::kOld);
  EXPECT_EQ(window.newest(), std::uint64_t{1} << 40);
  SequenceWindow fresh{{10, 1000, true, false}};
  EXPECT_EQ(fresh.admit(UINT64_MAX, 0), Admission::kNewStart);
  EXPECT_EQ(fresh.admit(5, 0), Admission::kNewStart) << "a single sample is not confirmed";
}

TEST(SequenceWindow, AConfirmedWindowJumpsAtMostToTheLargestJump) {
  SequenceLimits limits = kLimits;
  limits.max_jump = 1000;
  SequenceWindow window = after_hundred(limits);
  for (std::uint64_t i = 1; i <= 10; ++i) EXPECT_EQ(window.admit(1000 + i, 100 * kMs), Admission::kImplausible);
  for (std::uint64_t i = 998; i < 1000; ++i) EXPECT_EQ(window.admit(i, 100 * kMs), Admission::kImplausible);
  EXPECT_EQ(window.admit(1000, 100 * kMs), Admission::kNewStart);
  EXPECT_EQ(window.admit(1001, 100 * kMs), Admission::kAccepted) << "inside the window numbers still grow";
}

TEST(SequenceWindow, AFencingNumberAboveTheLargestThatAHostFollowsMayDecrease) {
  constexpr std::uint64_t kAbove = kMaxFollowedFencing + 5000;
  SequenceWindow window{kFencingNumbers, kAbove, 0};
  for (int i = 0; i < 10; ++i) EXPECT_EQ(window.admit(kAbove - 1, 0), Admission::kOld) << "of a former owner";
  for (int i = 0; i < 2; ++i) EXPECT_EQ(window.admit(5, 0), Admission::kImplausible);
  EXPECT_EQ(window.admit(5, 0), Admission::kNewStart);
  EXPECT_EQ(window.admit(4, 0), Admission::kOld);
}

/// A third of the correct numbers is lost, and implausible numbers arrive in between.
TEST(SequenceWindow, RefusesNoCorrectNumberBecauseOfImplausibleNumbers) {
  for (unsigned seed = 1; seed <= 50; ++seed) {
    std::mt19937_64 random{seed};
    SequenceWindow window{kLimits};
    (void)window.admit(1, 0);
    (void)window.admit(2, kMs);
    for (std::uint64_t i = 3; i < 2000; ++i) {
      const auto now = static_cast<std::int64_t>(i) * kMs;
      if (random() % 4 == 0) (void)window.admit((std::uint64_t{1} << 32) | random(), now);
      if (random() % 3 == 0) continue;  // lost
      ASSERT_EQ(window.admit(i, now), Admission::kAccepted) << "seed " << seed << ", number " << i;
    }
  }
}

TEST(SourceWindow, AcceptsALargerIncarnationAtOnceAndASmallerIncarnationAfterThreeSamples) {
  SourceWindow window;
  EXPECT_EQ(window.admit(sender(1, 50)), Admission::kNewStart);
  EXPECT_EQ(window.admit(sender(1, 50)), Admission::kAccepted);
  EXPECT_EQ(window.admit(sender(1, UINT64_MAX)), Admission::kNewStart);
  EXPECT_EQ(window.admit(sender(1, 50)), Admission::kImplausible);
  EXPECT_EQ(window.admit(sender(1, 50)), Admission::kImplausible);
  EXPECT_EQ(window.admit(sender(1, 50)), Admission::kNewStart);
}

TEST(SourceWindow, IncarnationsOfDifferentParticipantsAreNotCompared) {
  for (const std::uint64_t incarnation : {20u, 80u}) {
    SourceWindow window;
    (void)window.admit(sender(1, 50));
    for (unsigned i = 1; i < kAgreeing; ++i) EXPECT_EQ(window.admit(sender(2, incarnation)), Admission::kImplausible);
    EXPECT_EQ(window.admit(sender(2, incarnation)), Admission::kNewStart);
    EXPECT_EQ(window.admit(sender(1, 50)), Admission::kImplausible);
  }
}

TEST(SourceWindow, OfTwoAlternatingWritersTheFirstRemainsAccepted) {
  SourceWindow window;
  for (int i = 0; i < 100; ++i) {
    EXPECT_TRUE(accepted(window.admit(sender(1, 50))));
    EXPECT_EQ(window.admit(sender(2, 60)), Admission::kImplausible);
  }
}

TEST(SenderWindow, AcceptsTheFirstNumbersOfARestartedSender) {
  SenderWindow window{kLimits};
  for (std::uint64_t i = 1000; i < 1100; ++i)
    EXPECT_TRUE(accepted(window.admit(sender(1, 5), i, static_cast<std::int64_t>(i) * kMs)));
  EXPECT_EQ(window.admit(sender(1, 6), 1, 1100 * kMs), Admission::kNewStart);
  EXPECT_EQ(window.admit(sender(1, 6), 2, 1101 * kMs), Admission::kAccepted);
}

TEST(TimeWindow, DropsOneImplausibleTime) {
  for (const std::int64_t wrong : {INT64_MAX, INT64_MIN, INT64_C(3'000'000'000)}) {
    TimeWindow window;
    for (std::int64_t ms = 0; ms < 1000; ++ms) {
      if (ms == 500) {
        EXPECT_EQ(window.admit(wrong, ms * kMs), Admission::kImplausible);
      }
      ASSERT_TRUE(accepted(window.admit((ms - 15) * kMs, ms * kMs)));
    }
  }
}

TEST(TimeWindow, AcceptsAClockWithAnyOffsetAndDrift) {
  TimeWindow window{{kMs, kMs}};
  for (std::int64_t ms = 0; ms < 1'000'000; ++ms)
    ASSERT_TRUE(accepted(window.admit(INT64_C(77'000'000) * kMs + ms * kMs - ms * 200, ms * kMs))) << ms;
}

TEST(TimeWindow, ATimeMayBeOneSecondAheadAndTenSecondsBehind) {
  for (const std::int64_t difference : {1000 * kMs, -10'000 * kMs}) {
    for (const bool is_outside : {false, true}) {
      TimeWindow window;
      for (std::int64_t ms = 0; ms < 10; ++ms) ASSERT_TRUE(accepted(window.admit(ms * kMs, ms * kMs)));
      const std::int64_t time = 10 * kMs + difference + (is_outside ? (difference > 0 ? kMs : -kMs) : 0);
      EXPECT_EQ(accepted(window.admit(time, 10 * kMs)), !is_outside) << difference;
    }
  }
}

TEST(TimeWindow, AcceptsAStepOfTheClockAfterThreeConsistentTimes) {
  TimeWindow window;
  for (std::int64_t ms = 0; ms < 10; ++ms) (void)window.admit(ms * kMs, ms * kMs);
  EXPECT_EQ(window.admit(60'010 * kMs, 10 * kMs), Admission::kImplausible);
  EXPECT_EQ(window.admit(60'011 * kMs, 11 * kMs), Admission::kImplausible);
  EXPECT_EQ(window.admit(60'012 * kMs, 12 * kMs), Admission::kNewStart);
  EXPECT_EQ(window.admit(60'013 * kMs, 13 * kMs), Admission::kAccepted);
}

TEST(WrappedTimeWindow, AcceptsTimesAcrossTheWrap) {
  WrappedTimeWindow window;
  for (std::uint32_t i = 0; i < 100; ++i)
    ASSERT_TRUE(accepted(window.admit(0xffffffc0u + 2 * i, static_cast<std::int64_t>(i) * kMs)));
  EXPECT_EQ(window.admit(0x80000000u, 100 * kMs), Admission::kImplausible);
  EXPECT_TRUE(accepted(window.admit(50, 101 * kMs)));
}

}  // namespace
}  // namespace tactus::session
