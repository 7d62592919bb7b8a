#include "session/clock.hpp"

#include <gtest/gtest.h>

#include <cstdlib>
#include <random>

#include "tests/support/constants.hpp"

namespace tactus::session {
namespace {

constexpr Origin kReference{1, 10, 1, 0};
constexpr Origin kRequester{1, 20, 1, 0};

/// A reference and a requester. The clock of the requester has an offset and a drift relative to that of the reference.
class ClockPair {
 public:
  ClockPair(std::int64_t offset, double drift) : offset_{offset}, drift_{drift} {
    reference_.set_reference(10, 1, 0);
    requester_.set_reference(10, 1, local(0));
  }
  /// Restarts the requester at reference time `t`.
  void restart_requester(std::int64_t t) { requester_ = SessionClock{kRequester, {}, local(t)}; }
  /// The requester's local clock at a reference time.
  [[nodiscard]] std::int64_t local(std::int64_t t) const {
    return t + offset_ + static_cast<std::int64_t>(static_cast<double>(t) * drift_);
  }
  /// Exchanges a request and an answer from reference time `t` on. Returns whether the requester accepts the answer.
  bool exchange(std::int64_t t, std::int64_t request_delay, std::int64_t answer_delay) {
    const ClockSample request = requester_.request(local(t));
    const ClockSample answer = reference_.answer(request, t + request_delay, t + request_delay + 10'000);
    return requester_.on_answer(answer, local(t + request_delay + 10'000 + answer_delay));
  }
  [[nodiscard]] std::int64_t error(std::int64_t t) const {
    return requester_.map().session_time(local(t)) - reference_.map().session_time(t);
  }
  [[nodiscard]] std::int64_t error_bound(std::int64_t t) const { return requester_.map().error_bound(local(t)); }

 private:
  std::int64_t offset_;
  double drift_;

 public:
  SessionClock reference_{kReference, {}, 0};
  SessionClock requester_{kRequester, {}, local(0)};
};

TEST(SessionClock, IsNotSynchronisedBeforeTheFirstAnswer) {
  const SessionClock clock{kRequester, {}, 0};
  EXPECT_FALSE(clock.synchronised());
  EXPECT_EQ(clock.map().error_bound(5), kClockUnknown);
}

TEST(SessionClock, TheErrorStaysWithinItsBoundUnderJitterAndDrift) {
  for (const std::uint64_t seed : {1u, 2u, 3u, 4u, 5u}) {
    std::mt19937_64 random{seed};
    ClockPair pair{static_cast<std::int64_t>(random() % 4'000'000'000'000) - 2'000'000'000'000, 100e-6};
    for (std::int64_t t = 0; t < 20'000 * kMs; t += 100 * kMs) {
      const auto delay = [&] {
        return static_cast<std::int64_t>(50'000 + random() % (random() % 4 == 0 ? 8'000'000 : 300'000));
      };
      ASSERT_TRUE(pair.exchange(t, delay(), delay()));
      for (std::int64_t later = t + 20 * kMs; later < t + 100 * kMs; later += 20 * kMs) {
        ASSERT_LE(std::abs(pair.error(later)), pair.error_bound(later)) << "seed " << seed << ", time " << later;
      }
    }
    EXPECT_LT(pair.error_bound(20'000 * kMs), 1 * kMs) << "seed " << seed;
  }
}

TEST(SessionClock, NeverStepsBack) {
  std::mt19937_64 random{1};
  ClockPair pair{0, -150e-6};
  std::int64_t last = INT64_MIN;
  for (std::int64_t t = 0; t < 5'000 * kMs; t += 1 * kMs) {
    if (t % (50 * kMs) == 0) pair.exchange(t - 20 * kMs, static_cast<std::int64_t>(random() % 9'000'000), 100'000);
    if (!pair.requester_.synchronised()) continue;
    const std::int64_t now = pair.requester_.map().session_time(pair.local(t));
    ASSERT_GE(now, last) << "at " << t;
    last = now;
  }
}

TEST(SessionClock, ContinuesItsTimeWhenItBecomesTheReference) {
  ClockPair pair{3'000 * kMs, 0};
  ASSERT_TRUE(pair.exchange(0, 100'000, 100'000));
  const std::int64_t now = pair.local(2'000 * kMs);
  const std::int64_t before = pair.requester_.map().session_time(now);

  pair.requester_.set_reference(20, 1, now);

  EXPECT_EQ(pair.requester_.map().session_time(now), before);
  EXPECT_EQ(pair.requester_.map().session_time(now + 100), before + 100);
  EXPECT_EQ(pair.requester_.map().error_bound(now), 0);
}

TEST(SessionClock, ANewReferenceCausesNoStep) {
  ClockPair pair{0, 0};
  ASSERT_TRUE(pair.exchange(0, 100'000, 100'000));
  SessionClock other{{1, 5, 1, 0}, {}, 0};
  other.set_reference(5, 1, 0);  // its session time will be 30 ms ahead
  pair.requester_.set_reference(5, 1, 10 * kMs);
  const ClockSample request = pair.requester_.request(20 * kMs);
  const ClockSample answer = other.answer(request, 50 * kMs, 50 * kMs);
  const std::int64_t before = pair.requester_.map().session_time(20 * kMs);

  ASSERT_TRUE(pair.requester_.on_answer(answer, 20 * kMs));

  EXPECT_EQ(pair.requester_.map().session_time(20 * kMs), before);
  EXPECT_EQ(pair.requester_.map().session_time(2'000 * kMs), 2'030 * kMs) << "the times agree after slewing";
  EXPECT_GE(pair.requester_.map().error_bound(20 * kMs), 30 * kMs - 1) << "the bound includes the error that is left";
}

TEST(SessionClock, StepsWhenItsSessionMergesWithAnOlderSession) {
  ClockPair pair{3'600'000 * kMs, 0};
  pair.restart_requester(600 * kMs);
  pair.requester_.set_reference(20, 1, pair.local(600 * kMs));  // the requester is alone in its session
  ASSERT_EQ(pair.error(700 * kMs), -600 * kMs);

  pair.requester_.set_reference(10, 1, pair.local(1000 * kMs));
  EXPECT_EQ(pair.error_bound(1000 * kMs), kClockUnknown);
  ASSERT_TRUE(pair.exchange(1000 * kMs, kMs, kMs));

  EXPECT_LE(std::abs(pair.error(1010 * kMs)), pair.error_bound(1010 * kMs));
  EXPECT_LT(pair.error_bound(1010 * kMs), 2 * kMs);
}

TEST(SessionClock, DoesNotStepWhileAForceIsOn) {
  ClockPair pair{0, 0};
  pair.restart_requester(6000 * kMs);
  pair.requester_.set_reference(20, 1, pair.local(6000 * kMs));  // the requester is alone in its session
  pair.requester_.set_reference(10, 1, pair.local(7000 * kMs));
  pair.requester_.set_force_on(true);
  std::int64_t last = pair.requester_.map().session_time(pair.local(7000 * kMs));
  for (std::int64_t t = 7000 * kMs; t < 11'000 * kMs; t += 100 * kMs) {
    ASSERT_TRUE(pair.exchange(t, kMs, kMs));
    const std::int64_t now = pair.requester_.map().session_time(pair.local(t + 3 * kMs));
    ASSERT_LT(now - last, 110 * kMs) << "at " << t;
    ASSERT_GE(pair.error_bound(t + 3 * kMs), std::abs(pair.error(t + 3 * kMs))) << "the bound includes the error";
    last = now;
  }
  EXPECT_TRUE(pair.requester_.waits_for_force_off());
  pair.requester_.set_force_on(false);
  ASSERT_TRUE(pair.exchange(11'000 * kMs, kMs, kMs));

  EXPECT_FALSE(pair.requester_.waits_for_force_off());
  EXPECT_LT(std::abs(pair.error(11'010 * kMs)), 2 * kMs);
}

TEST(SessionClock, DoesNotFollowAFirstAnswerWithALargeErrorWhileAForceIsOn) {
  ClockPair pair{0, 0};
  pair.restart_requester(6000 * kMs);
  pair.requester_.set_reference(10, 1, pair.local(6000 * kMs));
  pair.requester_.set_force_on(true);
  ASSERT_TRUE(pair.exchange(6100 * kMs, kMs, kMs));

  EXPECT_EQ(pair.requester_.map().session_time(pair.local(6200 * kMs)), 200 * kMs);
  EXPECT_FALSE(pair.requester_.synchronised());
  pair.requester_.set_force_on(false);
  ASSERT_TRUE(pair.exchange(6300 * kMs, kMs, kMs));
  EXPECT_TRUE(pair.requester_.synchronised());
  EXPECT_LT(std::abs(pair.error(6310 * kMs)), 2 * kMs);
}

TEST(SessionClock, FollowsAFirstAnswerWithASmallErrorWhileAForceIsOn) {
  for (const std::int64_t error : {60 * kMs, 220 * kMs, 1500 * kMs}) {  // programs that one command starts
    SCOPED_TRACE(error / kMs);
    ClockPair pair{0, 0};
    pair.restart_requester(error);
    pair.requester_.set_reference(10, 1, pair.local(error));
    pair.requester_.set_force_on(true);
    ASSERT_TRUE(pair.exchange(2000 * kMs, kMs, kMs));

    EXPECT_TRUE(pair.requester_.synchronised());
    EXPECT_FALSE(pair.requester_.waits_for_force_off());
    EXPECT_NEAR(static_cast<double>(pair.error(2003 * kMs)), static_cast<double>(-error), 1.0 * kMs) << "no step";
    EXPECT_GE(pair.error_bound(2003 * kMs), std::abs(pair.error(2003 * kMs)));
    const std::int64_t slewed = 2003 * kMs + 20 * error;  // by 5 %
    EXPECT_LT(std::abs(pair.error(slewed)), 2 * kMs);
    EXPECT_NE(pair.requester_.joined_ns(), kNotJoined);
  }
}

TEST(SessionClock, AnswersRequestsOnlyAsTheReference) {
  SessionClock alone{kReference, {}, 0};
  EXPECT_FALSE(alone.answers_requests());
  alone.set_reference(20, 1, 0);
  EXPECT_FALSE(alone.answers_requests());
  alone.set_reference(10, 1, 0);
  EXPECT_TRUE(alone.answers_requests());
}

TEST(SessionClock, SlewsToABetterMeasurementWithinTheBound) {
  ClockPair pair{0, 0};
  ASSERT_TRUE(pair.exchange(0, 80 * kMs, 0));  // causes an error of 40 ms, within the bound
  const std::int64_t before = pair.requester_.map().session_time(pair.local(999 * kMs));

  ASSERT_TRUE(pair.exchange(998 * kMs, kMs, kMs));

  EXPECT_NEAR(static_cast<double>(pair.requester_.map().session_time(pair.local(1001 * kMs)) - before), 2e6, 1e6);
  EXPECT_GT(std::abs(pair.error(1001 * kMs)), 35 * kMs);
}

TEST(SessionClock, RefusesForeignAndImpossibleAnswers) {
  ClockPair pair{0, 0};
  const ClockSample request = pair.requester_.request(0);
  const ClockSample correct = pair.reference_.answer(request, 100, 200);
  const auto refused = [&](auto vary) {
    ClockSample answer = correct;
    vary(answer);
    return !pair.requester_.on_answer(answer, 1000);
  };
  EXPECT_TRUE(refused([](ClockSample& answer) { answer.answer = false; }));
  EXPECT_TRUE(refused([](ClockSample& answer) { answer.peer = 21; }));
  EXPECT_TRUE(refused([](ClockSample& answer) { answer.origin.participant = 11; }));
  EXPECT_TRUE(refused([](ClockSample& answer) { answer.origin.incarnation = 0; }));
  EXPECT_TRUE(refused([](ClockSample& answer) { answer.sequence = 7; }));
  EXPECT_TRUE(refused([](ClockSample& answer) { answer.t2_ns = answer.t1_ns - 1; }))
      << "sent before the request was received";
  EXPECT_TRUE(refused([](ClockSample& answer) { answer.t2_ns = answer.t1_ns + 5000; }))
      << "the answer took longer than the round trip";
  EXPECT_TRUE(refused([](ClockSample& answer) { answer.t0_ns = INT64_MIN; }));
  EXPECT_TRUE(refused([](ClockSample& answer) { answer.t1_ns = answer.t2_ns = (INT64_C(1) << 60) - 5; }));
  EXPECT_TRUE(pair.requester_.on_answer(correct, 1000));
  EXPECT_FALSE(pair.requester_.on_answer(correct, 1000)) << "a repeated answer";
}

TEST(SessionClock, TheErrorStaysWithinItsBoundAfterOneImplausibleAnswer) {
  ClockPair pair{3'000 * kMs, 0};
  for (std::int64_t t = 0; t < 3'000 * kMs; t += 100 * kMs) {
    if (t == 1'000 * kMs) {
      const ClockSample request = pair.requester_.request(pair.local(t));
      ClockSample answer = pair.reference_.answer(request, t + 100, t + 200);
      answer.t1_ns += 1'000'000'000 * kMs;
      answer.t2_ns += 1'000'000'000 * kMs;
      (void)pair.requester_.on_answer(answer, pair.local(t + 300));
    } else {
      ASSERT_TRUE(pair.exchange(t, kMs, kMs));
    }
    ASSERT_LE(std::abs(pair.error(t)), pair.error_bound(t)) << "at " << t / kMs << " ms";
  }
}

}  // namespace
}  // namespace tactus::session
