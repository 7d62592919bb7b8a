#include "session/modes.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <stdexcept>

namespace tactus::session {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

constexpr std::int64_t kMs = 1'000'000;
constexpr std::uint64_t kHere = 1, kThere = 2, kAnn = 11, kBob = 12;

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

/// The Modes of two HRTCs with one user each; time in steps of 20 ms.
class TwoHrtcs : public ::testing::Test {
 protected:
  TwoHrtcs() {
    for (Modes* const modes : {&here_, &there_}) {
      modes->on_catalogue(cube(100, {0, 0, 0}));
      modes->on_catalogue(cube(200, {2, 0, 0}));
    }
  }
  void stay(std::int64_t ms, double ann_x, double bob_x) {
    for (const std::int64_t end = now_ + ms * kMs; now_ < end; now_ += 20 * kMs) {
      for (Modes* const modes : {&here_, &there_}) {
        modes->on_probe(kAnn, kHere, {ann_x, 0, 0}, now_);
        modes->on_probe(kBob, kThere, {bob_x, 0, 0}, now_);
        modes->tick(now_);
      }
    }
  }
  void match() {
    for (Modes* const modes : {&here_, &there_})
      for (const std::uint64_t group : modes->groups()) modes->on_peers(group, true);
  }

  Modes here_{kHere}, there_{kThere};
  std::int64_t now_ = 1'000'000'000;
};

TEST_F(TwoHrtcs, CreateEndpointsNearOneObjectAndSendFullRateStatesOncePeersMatch) {
  stay(100, 1, 0.5);
  EXPECT_THAT(here_.groups(), IsEmpty());
  stay(100, 0.14, 0.12);
  EXPECT_THAT(here_.groups(), ElementsAre(100));
  EXPECT_THAT(there_.groups(), ElementsAre(100));
  EXPECT_EQ(here_.group_of(kAnn), 0u) << "no peer is matched yet";
  match();
  EXPECT_EQ(here_.group_of(kAnn), 100u);
  EXPECT_EQ(there_.group_of(kBob), 100u);
  EXPECT_EQ(here_.group_of(kBob), 0u) << "not an own user";
}

TEST_F(TwoHrtcs, StayApartAtDifferentObjects) {
  stay(200, 0.1, 1.9);
  EXPECT_THAT(here_.groups(), IsEmpty());
}

TEST_F(TwoHrtcs, StayApartInACrowdAtOneObjectUntilCommanded) {
  const std::size_t max = ModeSettings{}.max_collaborating;
  const auto crowd = [&](std::size_t others) {
    for (int i = 0; i < 50; ++i, now_ += 20 * kMs) {
      here_.on_probe(kAnn, kHere, {0.1, 0, 0}, now_);
      for (std::size_t other = 0; other < others; ++other) here_.on_probe(1000 + other, kThere, {0.1, 0, 0}, now_);
      here_.tick(now_);
    }
  };
  crowd(max - 1);
  EXPECT_THAT(here_.groups(), ElementsAre(100));
  crowd(max);
  EXPECT_THAT(here_.groups(), IsEmpty());
  here_.set_command(parse_mode("collaborate"));
  crowd(max);
  EXPECT_THAT(here_.groups(), ::testing::SizeIs(1));
}

TEST_F(TwoHrtcs, StayTogetherWhileAUserMovesBetweenNearAndApart) {
  stay(100, 0.14, 0.14);
  match();
  for (int i = 0; i < 20; ++i) {
    stay(200, 0.3, 0.14);
    stay(40, 0.19, 0.14);
    ASSERT_EQ(here_.group_of(kAnn), 100u) << i;
  }
}

TEST_F(TwoHrtcs, SeparateAfterTheDwellTimeAndDropTheEndpointsLater) {
  stay(100, 0.14, 0.14);
  match();
  stay(400, 0.5, 0.14);
  EXPECT_EQ(here_.group_of(kAnn), 100u);
  stay(120, 0.5, 0.14);
  EXPECT_EQ(here_.group_of(kAnn), 0u);
  EXPECT_THAT(here_.groups(), ElementsAre(100)) << "others may still send";
  stay(220, 0.5, 0.14);
  EXPECT_THAT(here_.groups(), IsEmpty());
}

TEST_F(TwoHrtcs, SeparateWhenTheOtherIsSilent) {
  stay(100, 0.14, 0.14);
  match();
  for (const std::int64_t end = now_ + 600 * kMs; now_ < end; now_ += 20 * kMs) {
    here_.on_probe(kAnn, kHere, {0.14, 0, 0}, now_);
    here_.tick(now_);
  }
  EXPECT_THAT(here_.groups(), IsEmpty());
}

TEST_F(TwoHrtcs, ContinueTheGroupIfItsEndpointsStillExist) {
  stay(100, 0.14, 0.14);
  match();
  stay(600, 0.5, 0.14);
  ASSERT_EQ(here_.group_of(kAnn), 0u);
  stay(40, 0.14, 0.14);
  EXPECT_EQ(here_.group_of(kAnn), 100u);
}

TEST_F(TwoHrtcs, FollowACommandForSomeUsersAndForAll) {
  const std::uint64_t ann = id_of("ann"), bob = id_of("bob");
  const auto far_apart = [&] {
    for (int i = 0; i < 50; ++i, now_ += 20 * kMs) {
      here_.on_probe(ann, kHere, {5, 0, 0}, now_);
      here_.on_probe(bob, kThere, {-5, 0, 0}, now_);
      here_.tick(now_);
    }
  };
  here_.set_command(parse_mode("collaborate ann,bob"));
  far_apart();
  ASSERT_EQ(here_.groups().size(), 1u);
  here_.set_command(parse_mode("collaborate ann,eve"));
  far_apart();
  EXPECT_THAT(here_.groups(), IsEmpty()) << "bob is not in the list";
  here_.set_command(parse_mode("collaborate"));
  far_apart();
  EXPECT_EQ(here_.groups().size(), 1u);
  here_.set_command(parse_mode("auto"));
  far_apart();
  EXPECT_THAT(here_.groups(), IsEmpty());
}

TEST_F(TwoHrtcs, StayApartOnCommand) {
  here_.set_command(parse_mode("large-scale"));
  stay(200, 0.14, 0.14);
  EXPECT_THAT(here_.groups(), IsEmpty());
  EXPECT_THAT(there_.groups(), ElementsAre(100)) << "got no command";
}

TEST(DistanceFrom, MeasuresInTheFrameOfTheObject) {
  CatalogueEntry entry = cube(1, {1, 0, 0});
  EXPECT_NEAR(distance_from(entry, {1.05, 0.02, 0}), 0, 1e-12);
  EXPECT_NEAR(distance_from(entry, {1.4, 0, 0.5}), 0.5, 1e-7);
  const double half = std::sqrt(0.5);
  entry.pose.orientation = {0, 0, std::sin(M_PI / 8), std::cos(M_PI / 8)};  // 45 degrees about z
  EXPECT_NEAR(distance_from(entry, {1 + 0.5 * half, 0.5 * half, 0}), 0.4, 1e-7) << "straight out of a side";
  EXPECT_NEAR(distance_from(entry, {1.5, 0, 0}), 0.5 - 0.1 / half, 1e-7) << "straight out of an edge";
}

TEST(ParseMode, RefusesAndNamesAWrongMode) {
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
