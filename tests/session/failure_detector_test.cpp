#include "session/failure_detector.hpp"

#include <gtest/gtest.h>

#include <functional>
#include <random>

#include "tests/support/constants.hpp"

namespace tactus::session {
namespace {

constexpr Origin kDetector{kSession, kHrtc, 1, 0};

ClockSample answer_to(const ClockSample& request, std::uint64_t incarnation = 1) {
  ClockSample answer = request;
  answer.origin = {1, request.peer, incarnation, 0};
  answer.peer = request.origin.participant;
  answer.answer = true;
  return answer;
}

bool always() { return true; }
bool never() { return false; }

class FailureDetectorTest : public testing::Test {
 protected:
  FailureDetectorTest() { failure_detector_.watch({kHost}); }
  /// Calls the failure detector every 2 ms until `end_ns`. The host answers a request at once if `answers()` returns
  /// true. Returns the times of suspicions.
  std::vector<std::int64_t> run(std::int64_t end_ns, const std::function<bool()>& answers) {
    std::vector<std::int64_t> suspected;
    for (; now_ < end_ns; now_ += 2 * kMs) {
      while (auto request = failure_detector_.next_request(now_))
        if (answers()) failure_detector_.on_answer(answer_to(*request), now_);
      for (const FailureDetector::Suspect& suspect : failure_detector_.take_suspects(now_)) {
        EXPECT_EQ(suspect.host, kHost);
        suspected.push_back(now_);
      }
    }
    return suspected;
  }
  FailureDetector failure_detector_{kDetector, {}};
  std::int64_t now_ = 1000 * kMs;
};

TEST_F(FailureDetectorTest, SuspectsADeadHostOnceWithin40Ms) {
  ASSERT_TRUE(run(2000 * kMs, always).empty());
  const std::vector<std::int64_t> suspected = run(4000 * kMs, never);
  ASSERT_EQ(suspected.size(), 1u);
  EXPECT_LE(suspected.front(), 2040 * kMs);
  EXPECT_EQ(failure_detector_.false_suspicions(), 0u);
}

TEST_F(FailureDetectorTest, AllRequestsAreAnsweredOnlyWhileTheHostAnswers) {
  ASSERT_TRUE(run(2000 * kMs, always).empty());
  EXPECT_TRUE(failure_detector_.all_answered());
  ASSERT_TRUE(run(2014 * kMs, never).empty());
  EXPECT_FALSE(failure_detector_.all_answered()) << "14 ms of silence";
}

TEST_F(FailureDetectorTest, DoesNotSuspectAHostThatHasNeverAnswered) { EXPECT_TRUE(run(5000 * kMs, never).empty()); }

TEST_F(FailureDetectorTest, DoesNotCountItsOwnPauseAsSilence) {
  ASSERT_TRUE(run(2000 * kMs, always).empty());
  now_ += 300 * kMs;
  EXPECT_TRUE(run(3000 * kMs, always).empty());
}

TEST_F(FailureDetectorTest, AdaptsToALossyLink) {
  std::mt19937_64 random{1};
  const auto nine_of_ten = [&] { return random() % 10 != 0; };
  (void)run(30'000 * kMs, nine_of_ten);
  const std::uint64_t while_adapting = failure_detector_.false_suspicions();
  EXPECT_LE(while_adapting, 2u);
  (void)run(330'000 * kMs, nine_of_ten);
  EXPECT_LE(failure_detector_.false_suspicions() - while_adapting, 2u) << "in five minutes";
}

TEST_F(FailureDetectorTest, SuspectsADeadHostWithin40MsAlsoAfterAFalseSuspicion) {
  ASSERT_TRUE(run(2000 * kMs, always).empty());
  ASSERT_EQ(run(2060 * kMs, never).size(), 1u);
  ASSERT_TRUE(run(60'000 * kMs, always).empty());
  EXPECT_EQ(failure_detector_.false_suspicions(), 1u);
  const std::vector<std::int64_t> suspected = run(61'000 * kMs, never);
  ASSERT_EQ(suspected.size(), 1u);
  EXPECT_LE(suspected.front(), 60'040 * kMs);
}

TEST_F(FailureDetectorTest, SendsRequestsOnlyToWatchedHosts) {
  failure_detector_.watch({kOtherHost});
  const auto request = failure_detector_.next_request(now_);
  ASSERT_TRUE(request);
  EXPECT_EQ(request->peer, kOtherHost);
  EXPECT_FALSE(failure_detector_.next_request(now_));
  failure_detector_.watch({});
  EXPECT_FALSE(failure_detector_.next_request(now_ + 1000 * kMs));
}

TEST_F(FailureDetectorTest, ARestartOfASuspectedHostIsNoFalseSuspicion) {
  ASSERT_TRUE(run(2000 * kMs, always).empty());
  ASSERT_EQ(run(2200 * kMs, never).size(), 1u);
  const auto request = failure_detector_.next_request(now_ + 8 * kMs);
  ASSERT_TRUE(request);
  failure_detector_.on_answer(answer_to(*request, 2), now_ + 8 * kMs);
  EXPECT_EQ(failure_detector_.false_suspicions(), 0u);
  EXPECT_TRUE(failure_detector_.take_suspects(now_ + 20 * kMs).empty());
}

}  // namespace
}  // namespace tactus::session
