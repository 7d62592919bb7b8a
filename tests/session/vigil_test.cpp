#include "session/vigil.hpp"

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

class VigilTest : public testing::Test {
 protected:
  VigilTest() { vigil_.watch({kHost}); }
  /// Looks every 2 ms until `end_ns`; `answers` says whether a question is answered, at once. When silence was named.
  std::vector<std::int64_t> run(std::int64_t end_ns, const std::function<bool()>& answers) {
    std::vector<std::int64_t> named;
    for (; now_ < end_ns; now_ += 2 * kMs) {
      while (auto question = vigil_.ask(now_))
        if (answers()) vigil_.on_answer(answer_to(*question), now_);
      for (const Vigil::Silent& silent : vigil_.silent(now_)) {
        EXPECT_EQ(silent.host, kHost);
        named.push_back(now_);
      }
    }
    return named;
  }
  Vigil vigil_{kSelf, {}};
  std::int64_t now_ = 1000 * kMs;
};

TEST_F(VigilTest, NamesADeadHostOnceWithin40Ms) {
  ASSERT_TRUE(run(2000 * kMs, [] { return true; }).empty());
  const std::vector<std::int64_t> named = run(4000 * kMs, [] { return false; });
  ASSERT_EQ(named.size(), 1u);
  EXPECT_LE(named.front(), 2040 * kMs);
  EXPECT_EQ(vigil_.false_alarms(), 0u);
}

TEST_F(VigilTest, IsAtEaseWhileQuestionsAreAnswered) {
  ASSERT_TRUE(run(2000 * kMs, [] { return true; }).empty());
  EXPECT_TRUE(vigil_.at_ease());
  ASSERT_TRUE(run(2014 * kMs, [] { return false; }).empty());
  EXPECT_FALSE(vigil_.at_ease()) << "14 ms of silence";
}

TEST_F(VigilTest, DoesNotMissWhoHasNeverAnswered) {
  EXPECT_TRUE(run(5000 * kMs, [] { return false; }).empty());
}

TEST_F(VigilTest, DoesNotTakeItsOwnSleepForTheHosts) {
  ASSERT_TRUE(run(2000 * kMs, [] { return true; }).empty());
  now_ += 300 * kMs;
  EXPECT_TRUE(run(3000 * kMs, [] { return true; }).empty());
}

TEST_F(VigilTest, LearnsWhatALossyLinkIsLike) {
  std::mt19937_64 random{1};
  const auto one_of_ten_lost = [&] { return random() % 10 != 0; };
  (void)run(30'000 * kMs, one_of_ten_lost);
  const std::uint64_t learning = vigil_.false_alarms();
  EXPECT_LE(learning, 2u);
  (void)run(330'000 * kMs, one_of_ten_lost);
  EXPECT_LE(vigil_.false_alarms() - learning, 2u) << "in five minutes";
}

TEST_F(VigilTest, ForgetsALongSilence) {
  ASSERT_TRUE(run(2000 * kMs, [] { return true; }).empty());
  ASSERT_EQ(run(2060 * kMs, [] { return false; }).size(), 1u);
  ASSERT_TRUE(run(60'000 * kMs, [] { return true; }).empty());
  EXPECT_EQ(vigil_.false_alarms(), 1u);
  const std::vector<std::int64_t> named = run(61'000 * kMs, [] { return false; });
  ASSERT_EQ(named.size(), 1u);
  EXPECT_LE(named.front(), 60'040 * kMs);
}

TEST_F(VigilTest, AsksOnlyWhomItWatches) {
  vigil_.watch({kOther});
  const auto question = vigil_.ask(now_);
  ASSERT_TRUE(question);
  EXPECT_EQ(question->peer, kOther);
  EXPECT_FALSE(vigil_.ask(now_));
  vigil_.watch({});
  EXPECT_FALSE(vigil_.ask(now_ + 1000 * kMs));
}

TEST_F(VigilTest, ANewProgramOfTheNameIsNoFalseAlarm) {
  ASSERT_TRUE(run(2000 * kMs, [] { return true; }).empty());
  ASSERT_EQ(run(2200 * kMs, [] { return false; }).size(), 1u);
  const auto question = vigil_.ask(now_ + 8 * kMs);
  ASSERT_TRUE(question);
  vigil_.on_answer(answer_to(*question, 2), now_ + 8 * kMs);
  EXPECT_EQ(vigil_.false_alarms(), 0u);
  EXPECT_TRUE(vigil_.silent(now_ + 20 * kMs).empty());
}

}  // namespace
}  // namespace tactus::session
