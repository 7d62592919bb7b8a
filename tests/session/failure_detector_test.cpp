#include "session/failure_detector.hpp"

#include <gtest/gtest.h>

#include <functional>
#include <random>

namespace tactus::session {
namespace {

constexpr std::int64_t kMs = 1'000'000;
constexpr std::uint64_t kHost = 10, kOther = 11;
constexpr Origin kSelf{1, 20, 1, 0};

ClockSample answer_to(const ClockSample& question, std::uint64_t incarnation = 1) {
  ClockSample answer = question;
  answer.origin = {1, question.peer, incarnation, 0};
  answer.peer = question.origin.participant;
  answer.answer = true;
  return answer;
}

class FailureDetectorTest : public testing::Test {
 protected:
  FailureDetectorTest() { failure_detector_.watch({kHost}); }
  /// Polls every 2 ms until `end_ns`; a request is answered at once if `answers()`. Returns the times of suspicions.
  std::vector<std::int64_t> interval(std::int64_t end_ns, const std::function<bool()>& answers) {
    std::vector<std::int64_t> named;
    for (; now_ < end_ns; now_ += 2 * kMs) {
      while (auto question = failure_detector_.ask(now_))
        if (answers()) failure_detector_.on_answer(answer_to(*question), now_);
      for (const FailureDetector::Silent& silent : failure_detector_.silent(now_)) {
        EXPECT_EQ(silent.host, kHost);
        named.push_back(now_);
      }
    }
    return named;
  }
  FailureDetector failure_detector_{kSelf, {}};
  std::int64_t now_ = 1000 * kMs;
};

TEST_F(FailureDetectorTest, SuspectsADeadHostOnceWithin40Ms) {
  ASSERT_TRUE(interval(2000 * kMs, [] { return true; }).empty());
  const std::vector<std::int64_t> named = interval(4000 * kMs, [] { return false; });
  ASSERT_EQ(named.size(), 1u);
  EXPECT_LE(named.front(), 2040 * kMs);
  EXPECT_EQ(failure_detector_.false_alarms(), 0u);
}

TEST_F(FailureDetectorTest, AllAreAnsweredWhileTheHostAnswers) {
  ASSERT_TRUE(interval(2000 * kMs, [] { return true; }).empty());
  EXPECT_TRUE(failure_detector_.at_ease());
  ASSERT_TRUE(interval(2014 * kMs, [] { return false; }).empty());
  EXPECT_FALSE(failure_detector_.at_ease()) << "14 ms of silence";
}

TEST_F(FailureDetectorTest, DoesNotSuspectAHostThatHasNeverAnswered) {
  EXPECT_TRUE(interval(5000 * kMs, [] { return false; }).empty());
}

TEST_F(FailureDetectorTest, DoesNotCountItsOwnPauseAsSilence) {
  ASSERT_TRUE(interval(2000 * kMs, [] { return true; }).empty());
  now_ += 300 * kMs;
  EXPECT_TRUE(interval(3000 * kMs, [] { return true; }).empty());
}

TEST_F(FailureDetectorTest, AdaptsToALossyLink) {
  std::mt19937_64 random{1};
  const auto one_of_ten_lost = [&] { return random() % 10 != 0; };
  (void)interval(30'000 * kMs, one_of_ten_lost);
  const std::uint64_t learning = failure_detector_.false_alarms();
  EXPECT_LE(learning, 2u);
  (void)interval(330'000 * kMs, one_of_ten_lost);
  EXPECT_LE(failure_detector_.false_alarms() - learning, 2u) << "in five minutes";
}

TEST_F(FailureDetectorTest, RecoversFromALongSilence) {
  ASSERT_TRUE(interval(2000 * kMs, [] { return true; }).empty());
  ASSERT_EQ(interval(2060 * kMs, [] { return false; }).size(), 1u);
  ASSERT_TRUE(interval(60'000 * kMs, [] { return true; }).empty());
  EXPECT_EQ(failure_detector_.false_alarms(), 1u);
  const std::vector<std::int64_t> named = interval(61'000 * kMs, [] { return false; });
  ASSERT_EQ(named.size(), 1u);
  EXPECT_LE(named.front(), 60'040 * kMs);
}

TEST_F(FailureDetectorTest, SendsRequestsOnlyToWatchedHosts) {
  failure_detector_.watch({kOther});
  const auto question = failure_detector_.ask(now_);
  ASSERT_TRUE(question);
  EXPECT_EQ(question->peer, kOther);
  EXPECT_FALSE(failure_detector_.ask(now_));
  failure_detector_.watch({});
  EXPECT_FALSE(failure_detector_.ask(now_ + 1000 * kMs));
}

TEST_F(FailureDetectorTest, ARestartedHostIsNoFalseSuspicion) {
  ASSERT_TRUE(interval(2000 * kMs, [] { return true; }).empty());
  ASSERT_EQ(interval(2200 * kMs, [] { return false; }).size(), 1u);
  const auto question = failure_detector_.ask(now_ + 8 * kMs);
  ASSERT_TRUE(question);
  failure_detector_.on_answer(answer_to(*question, 2), now_ + 8 * kMs);
  EXPECT_EQ(failure_detector_.false_alarms(), 0u);
  EXPECT_TRUE(failure_detector_.silent(now_ + 20 * kMs).empty());
}

}  // namespace
}  // namespace tactus::session
