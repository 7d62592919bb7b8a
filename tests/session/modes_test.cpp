#include "session/modes.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <stdexcept>

#include "tests/support/constants.hpp"

namespace tactus::session {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

constexpr std::uint64_t kFirstHrtc = 1, kSecondHrtc = 2, kAnn = 11, kBob = 12;

/// A cube of 0.2 m around `centre`.
CatalogueEntry cube(std::uint64_t id, const std::array<double, 3>& centre) {
  CatalogueEntry entry;
  entry.object_id = id;
  entry.summary.bounds_min = {-1, -1, -1};
  entry.summary.bounds_max = {1, 1, 1};
  entry.scale = 0.1;
  entry.pose.position = centre;
  return entry;
}

/// Runs the Modes of two HRTCs in steps of 20 ms. Ann is a user of the first HRTC, Bob of the second.
class TwoHrtcs : public ::testing::Test {
 protected:
  TwoHrtcs() {
    for (Modes* const modes : {&first_, &second_}) {
      modes->on_catalogue(cube(100, {0, 0, 0}));
      modes->on_catalogue(cube(200, {2, 0, 0}));
    }
  }
  /// Holds the probes at these positions on the x axis.
  void stay(std::int64_t ms, double ann_x, double bob_x) {
    for (const std::int64_t end = now_ + ms * kMs; now_ < end; now_ += 20 * kMs) {
      for (Modes* const modes : {&first_, &second_}) {
        modes->on_probe(kAnn, kFirstHrtc, {ann_x, 0, 0}, now_);
        modes->on_probe(kBob, kSecondHrtc, {bob_x, 0, 0}, now_);
        modes->tick(now_);
      }
    }
  }
  void match_peers() {
    for (Modes* const modes : {&first_, &second_})
      for (const std::uint64_t group : modes->groups()) modes->on_peers(group, true);
  }

  Modes first_{kFirstHrtc}, second_{kSecondHrtc};
  std::int64_t now_ = 1'000'000'000;
};

TEST_F(TwoHrtcs, CreateEndpointsNearOneObjectAndSendFullRateStatesAfterPeersMatch) {
  stay(100, 1, 0.5);
  EXPECT_THAT(first_.groups(), IsEmpty());
  stay(100, 0.14, 0.12);
  EXPECT_THAT(first_.groups(), ElementsAre(100));
  EXPECT_THAT(second_.groups(), ElementsAre(100));
  EXPECT_EQ(first_.group_of(kAnn), 0u) << "no peer is matched yet";
  match_peers();
  EXPECT_EQ(first_.group_of(kAnn), 100u);
  EXPECT_EQ(second_.group_of(kBob), 100u);
  EXPECT_EQ(first_.group_of(kBob), 0u) << "Bob is not a user of the first HRTC";
}

TEST_F(TwoHrtcs, FormNoGroupAtDifferentObjects) {
  stay(200, 0.1, 1.9);
  EXPECT_THAT(first_.groups(), IsEmpty());
}

TEST_F(TwoHrtcs, AreInNoGroupForLongerPausesEachTime) {
  stay(100, 0.14, 0.12);
  match_peers();
  for (const std::int64_t pause_ms : {30'000, 60'000, 120'000, 240'000, 480'000, 480'000}) {
    ASSERT_EQ(first_.group_of(kAnn), 100u);
    first_.pause(now_);
    first_.pause(now_ + kMs);  // has no effect during a pause
    stay(20, 0.14, 0.12);
    EXPECT_TRUE(first_.is_paused());
    EXPECT_EQ(first_.group_of(kAnn), 0u);
    EXPECT_EQ(second_.group_of(kBob), 100u) << "its own link may be fast";
    stay(pause_ms - 40, 0.14, 0.12);
    EXPECT_THAT(first_.groups(), IsEmpty());
    stay(40, 0.14, 0.12);
    EXPECT_FALSE(first_.is_paused());
    EXPECT_THAT(first_.groups(), ElementsAre(100));
    match_peers();
  }
  stay(61'000, 0.14, 0.12);
  first_.pause(now_);
  stay(30'020, 0.14, 0.12);
  EXPECT_FALSE(first_.is_paused()) << "short again after a minute without a pause";
}

TEST_F(TwoHrtcs, FormNoGroupOfMoreThanTheMaxUsersUnlessCommanded) {
  constexpr std::size_t kMax = 8;
  const auto stay_with = [&](std::size_t others) {
    for (int i = 0; i < 50; ++i, now_ += 20 * kMs) {
      first_.on_probe(kAnn, kFirstHrtc, {0.1, 0, 0}, now_);
      for (std::size_t other = 0; other < others; ++other)
        first_.on_probe(1000 + other, kSecondHrtc, {0.1, 0, 0}, now_);
      first_.tick(now_);
    }
  };
  stay_with(kMax - 1);
  EXPECT_THAT(first_.groups(), ElementsAre(100));
  stay_with(kMax);
  EXPECT_THAT(first_.groups(), IsEmpty());
  first_.set_command(parse_mode("collaborate"));
  stay_with(kMax);
  EXPECT_THAT(first_.groups(), ::testing::SizeIs(1));
}

TEST_F(TwoHrtcs, RemainTogetherWhileAUserLeavesForLessThanTheDwellTime) {
  stay(100, 0.14, 0.14);
  match_peers();
  for (int i = 0; i < 20; ++i) {
    stay(200, 0.3, 0.14);
    stay(40, 0.19, 0.14);
    ASSERT_EQ(first_.group_of(kAnn), 100u) << i;
  }
}

TEST_F(TwoHrtcs, SeparateAfterTheDwellTimeAndDeleteTheEndpointsLater) {
  stay(100, 0.14, 0.14);
  match_peers();
  stay(400, 0.5, 0.14);
  EXPECT_EQ(first_.group_of(kAnn), 100u);
  stay(120, 0.5, 0.14);
  EXPECT_EQ(first_.group_of(kAnn), 0u);
  EXPECT_THAT(first_.groups(), ElementsAre(100)) << "the other HRTC may still send";
  stay(220, 0.5, 0.14);
  EXPECT_THAT(first_.groups(), IsEmpty());
}

TEST_F(TwoHrtcs, SeparateWhenTheOtherHrtcIsSilent) {
  stay(100, 0.14, 0.14);
  match_peers();
  for (const std::int64_t end = now_ + 600 * kMs; now_ < end; now_ += 20 * kMs) {
    first_.on_probe(kAnn, kFirstHrtc, {0.14, 0, 0}, now_);
    first_.tick(now_);
  }
  EXPECT_THAT(first_.groups(), IsEmpty());
}

TEST_F(TwoHrtcs, RejoinAGroupWhoseEndpointsStillExist) {
  stay(100, 0.14, 0.14);
  match_peers();
  stay(600, 0.5, 0.14);
  ASSERT_EQ(first_.group_of(kAnn), 0u);
  stay(40, 0.14, 0.14);
  EXPECT_EQ(first_.group_of(kAnn), 100u);
}

TEST_F(TwoHrtcs, ApplyACommandToListedUsersOrToAll) {
  const std::uint64_t ann = id_of("ann"), bob = id_of("bob");
  const auto hold_far_from_objects = [&] {
    for (int i = 0; i < 50; ++i, now_ += 20 * kMs) {
      first_.on_probe(ann, kFirstHrtc, {5, 0, 0}, now_);
      first_.on_probe(bob, kSecondHrtc, {-5, 0, 0}, now_);
      first_.tick(now_);
    }
  };
  first_.set_command(parse_mode("collaborate ann,bob"));
  hold_far_from_objects();
  ASSERT_EQ(first_.groups().size(), 1u);
  first_.set_command(parse_mode("collaborate ann,eve"));
  hold_far_from_objects();
  EXPECT_THAT(first_.groups(), IsEmpty()) << "bob is not in the list";
  first_.set_command(parse_mode("collaborate"));
  hold_far_from_objects();
  EXPECT_EQ(first_.groups().size(), 1u);
  first_.set_command(parse_mode("auto"));
  hold_far_from_objects();
  EXPECT_THAT(first_.groups(), IsEmpty());
}

TEST_F(TwoHrtcs, FormNoGroupAfterACommand) {
  first_.set_command(parse_mode("large-scale"));
  stay(200, 0.14, 0.14);
  EXPECT_THAT(first_.groups(), IsEmpty());
  EXPECT_THAT(second_.groups(), ElementsAre(100)) << "the second HRTC received no command";
}

TEST(DistanceFrom, MeasuresInTheFrameOfTheObject) {
  CatalogueEntry entry = cube(1, {1, 0, 0});
  EXPECT_NEAR(distance_from(entry, {1.05, 0.02, 0}), 0, 1e-12);
  EXPECT_NEAR(distance_from(entry, {1.4, 0, 0.5}), 0.5, 1e-7);
  const double half = std::sqrt(0.5);
  entry.pose.orientation = {0, 0, std::sin(M_PI / 8), std::cos(M_PI / 8)};  // 45 degrees about z
  EXPECT_NEAR(distance_from(entry, {1 + 0.5 * half, 0.5 * half, 0}), 0.4, 1e-7) << "perpendicular to a side";
  EXPECT_NEAR(distance_from(entry, {1.5, 0, 0}), 0.5 - 0.1 / half, 1e-7) << "outwards from an edge";
}

TEST(ParseMode, RefusesAWrongModeAndQuotesIt) {
  for (const char* text : {"", "fast", "auto ann", "collaborate ", "collaborate ann,", "large-scale ,bob"}) {
    try {
      (void)parse_mode(text);
      ADD_FAILURE() << "accepted '" << text << "'";
    } catch (const std::invalid_argument& error) {
      EXPECT_THAT(error.what(), HasSubstr(std::string{"'"} + text + "'"));
    }
  }
  EXPECT_THAT(parse_mode("large-scale ann").users, ElementsAre(id_of("ann")));
}

}  // namespace
}  // namespace tactus::session
