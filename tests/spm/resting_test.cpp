// Regions that nobody asks for any more: they stay as they are until their tree nodes are needed, the longest unasked
// for gives way first, and what rests in which order can be recorded and restored.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <random>

#include "tests/support/hrtc_model.hpp"
#include "tests/support/random_model.hpp"

namespace tactus {
namespace {

using spm::Advance;
using spm::RegionId;
using spm::Unrequested;
using test_support::HrtcModel;
using ::testing::IsEmpty;

constexpr std::uint32_t kRecords = 600;
constexpr std::uint32_t kCells = 3;

class Resting : public ::testing::TestWithParam<std::uint64_t> {
 protected:
  /// All regions are here, nothing is refined. `slots`: of which an eighth are the nodes beyond which nothing rests.
  [[nodiscard]] std::unique_ptr<HrtcModel> hrtc(std::uint32_t slots) const {
    spm::PoolSettings settings = spm::PoolSettings::for_slots(slots);
    auto made = std::make_unique<HrtcModel>(model_, settings);
    for (std::uint32_t i = 0; i < model_.summary.regions; ++i)
      EXPECT_EQ(made->load(RegionId{i}), spm::AcceptResult::kAccepted);
    return made;
  }
  static Advance ask(HrtcModel& hrtc, const std::vector<RegionId>& regions, std::uint32_t units = 1u << 30) {
    return hrtc.refine(regions, units, nullptr, 0, Unrequested::kRetain);
  }
  [[nodiscard]] RegionId any_region() {
    return RegionId{static_cast<std::uint32_t>(random_() % model_.summary.regions)};
  }
  [[nodiscard]] std::vector<RegionId> any_regions(std::size_t max) {
    std::vector<RegionId> regions;
    for (std::size_t more = random_() % (max + 1); more > 0; --more) regions.push_back(any_region());
    return regions;
  }
  /// The first ones with a record, which random regions may lack.
  [[nodiscard]] std::vector<RegionId> some_regions(std::size_t count) const {
    std::vector<RegionId> regions;
    for (std::uint32_t i = 0; i < model_.summary.regions && regions.size() < count; ++i)
      if (model_.intervals_of(RegionId{i}).size() > 0) regions.push_back(RegionId{i});
    EXPECT_EQ(regions.size(), count);
    return regions;
  }

  spm::OwnedModel owned_ = test_support::random_model(GetParam(), kRecords, kCells);
  spm::Model model_ = owned_.model();
  std::mt19937_64 random_{GetParam()};
  static constexpr std::uint32_t kRoomy = 1u << 14;
};

struct Published {
  std::vector<spm::Forest::InUse> regions;
  explicit Published(const spm::Forest& forest) : regions(forest.copy_in_use(nullptr, 0)) {
    EXPECT_EQ(forest.copy_in_use(regions.data(), static_cast<std::uint32_t>(regions.size())), regions.size());
  }
  [[nodiscard]] std::vector<RegionId> resting() const {
    std::vector<RegionId> found;
    for (const spm::Forest::InUse& one : regions)
      if (one.retained) found.push_back(one.region);
    return found;
  }
  [[nodiscard]] std::vector<std::vector<std::uint32_t>> plain() const {
    std::vector<std::vector<std::uint32_t>> all;
    for (const spm::Forest::InUse& one : regions)
      all.push_back({spm::index(one.region), one.applied, one.retiring ? 1u : 0u, one.retained ? 1u : 0u});
    return all;
  }
};

TEST_P(Resting, ARegionIsAsItWasWhenItIsRequestedAgain) {
  const auto hrtc = this->hrtc(kRoomy);
  const std::vector<RegionId> regions = some_regions(2);
  const RegionId first = regions[0], other = regions[1];
  ASSERT_EQ(ask(*hrtc, {first}), Advance::kDone);
  ASSERT_EQ(ask(*hrtc, {other}), Advance::kDone);
  const spm::ForestCounters before = hrtc->forest().counters();
  EXPECT_EQ(before.collapses, 0u);
  EXPECT_TRUE(hrtc->forest().is_refined(first));
  EXPECT_THAT(Published{hrtc->forest()}.resting(), testing::ElementsAre(first));

  ASSERT_EQ(ask(*hrtc, {first}, 0), Advance::kDone) << "nothing is left to do";

  EXPECT_EQ(hrtc->forest().counters().visits, before.visits);
  EXPECT_THAT(Published{hrtc->forest()}.resting(), testing::ElementsAre(other));
  EXPECT_EQ(hrtc->refine({}), Advance::kDone) << "but not where what is not asked for is to be coarse";
  EXPECT_EQ(hrtc->forest().mesh_hash(), 0u);
  EXPECT_THAT(Published{hrtc->forest()}.regions, IsEmpty());
  EXPECT_THAT(hrtc->forest().violations(), IsEmpty());
}

TEST_P(Resting, ARegionLeftHalfRefinedGoesOnWhereItWas) {
  const auto hrtc = this->hrtc(kRoomy);
  const RegionId region = some_regions(1)[0];
  ASSERT_EQ(ask(*hrtc, {}), Advance::kDone) << "the base mesh";
  constexpr std::uint32_t kSome = 4 * (spm::Budget::kVisit + spm::Budget::kChange);
  ASSERT_EQ(ask(*hrtc, {region}, kSome), Advance::kBudget);
  ASSERT_EQ(ask(*hrtc, {}), Advance::kDone);
  EXPECT_EQ(hrtc->forest().counters().collapses, 0u);
  EXPECT_THAT(Published{hrtc->forest()}.resting(), testing::ElementsAre(region));

  ASSERT_EQ(ask(*hrtc, {region}), Advance::kDone);

  EXPECT_EQ(hrtc->forest().counters().collapses, 0u);
  EXPECT_TRUE(hrtc->forest().is_refined(region));
}

TEST_P(Resting, BeyondTheNodesThatMayRestTheLongestUnaskedGivesWayFirst) {
  const auto hrtc = this->hrtc(1024);
  const std::uint32_t max = spm::Forest::retained_node_limit(hrtc->pool().settings);
  std::vector<std::uint32_t> requested_at(model_.summary.regions, 0);
  std::uint32_t gave_way = 0, max_resting = 0;
  for (std::uint32_t step = 1; step < 400; ++step) {
    SCOPED_TRACE("seed " + std::to_string(GetParam()) + " step " + std::to_string(step));
    const std::vector<RegionId> requested = any_regions(3);
    for (const RegionId region : requested) requested_at[spm::index(region)] = step;
    const bool over = hrtc->nodes().used_nodes() > max;
    const std::uint64_t collapses = hrtc->forest().counters().collapses;
    (void)ask(*hrtc, requested);
    ASSERT_TRUE(over || hrtc->forest().counters().collapses == collapses) << "there was room";
    gave_way += over ? 1 : 0;

    const std::vector<RegionId> resting = Published{hrtc->forest()}.resting();
    max_resting = std::max(max_resting, static_cast<std::uint32_t>(resting.size()));
    for (std::size_t i = 0; i < resting.size(); ++i) {
      if (i == 0) continue;  // it may be half way
      ASSERT_TRUE(hrtc->forest().is_refined(resting[i]));
      ASSERT_LE(requested_at[spm::index(resting[i - 1])], requested_at[spm::index(resting[i])]);
    }
    // Whoever was asked for later than the oldest that rests is still refined.
    for (std::uint32_t i = 0; i < model_.summary.regions && !resting.empty(); ++i) {
      ASSERT_TRUE(requested_at[i] <= requested_at[spm::index(resting[0])] || hrtc->forest().is_refined(RegionId{i}));
    }
    ASSERT_THAT(hrtc->forest().violations(), IsEmpty());
  }
  EXPECT_GT(gave_way, 20u);
  EXPECT_GT(max_resting, 2u);
  for (int i = 0; i < 1000 && !Published{hrtc->forest()}.resting().empty() && hrtc->nodes().used_nodes() > max; ++i)
    ASSERT_EQ(ask(*hrtc, {}), Advance::kDone);
  EXPECT_LE(hrtc->nodes().used_nodes(), max) << "what rests does not keep more for itself";
}

TEST_P(Resting, ARetiredRegionIsCoarsenedWhateverRoomThereIs) {
  const auto hrtc = this->hrtc(kRoomy);
  const std::vector<RegionId> regions = some_regions(3);
  ASSERT_EQ(ask(*hrtc, regions), Advance::kDone);
  ASSERT_EQ(ask(*hrtc, {}), Advance::kDone);
  ASSERT_EQ(Published{hrtc->forest()}.resting().size(), 3u);

  hrtc->forest().retire(regions[1]);
  ASSERT_EQ(ask(*hrtc, {}), Advance::kDone);

  EXPECT_EQ(hrtc->forest().take_retired(), regions[1]);
  EXPECT_EQ(hrtc->forest().take_retired(), spm::kNone);
  EXPECT_THAT(Published{hrtc->forest()}.resting(), testing::UnorderedElementsAre(regions[0], regions[2]));
  hrtc->cache().release(hrtc->object(), regions[1]);
  ASSERT_EQ(hrtc->load(regions[1]), spm::AcceptResult::kAccepted);
  EXPECT_FALSE(hrtc->forest().is_refined(regions[1]));
  EXPECT_THAT(hrtc->forest().violations(), IsEmpty());
}

TEST_P(Resting, WhatRestsIsMadeAgainToTheBitAndGoesOnAlike) {
  const auto settings = 1024u;
  const auto hrtc = this->hrtc(settings);
  std::uint32_t compared = 0;
  for (int step = 0; step < 150; ++step) {
    (void)ask(*hrtc, any_regions(4), static_cast<std::uint32_t>(random_() % 2000));
    if (step % 25 != 24) continue;
    const Published published{hrtc->forest()};
    if (published.resting().size() < 2) continue;
    ++compared;
    const auto again = this->hrtc(settings);
    again->forest().store_previous(false);
    ASSERT_TRUE(again->forest().restore(hrtc->forest().base_faces_shown(), published.regions.data(),
                                        static_cast<std::uint32_t>(published.regions.size())));
    for (int more = 0; more < 20; ++more) {
      ASSERT_EQ(Published{again->forest()}.plain(), Published{hrtc->forest()}.plain()) << "after " << more;
      ASSERT_EQ(again->forest().mesh_hash(), hrtc->forest().mesh_hash());
      ASSERT_EQ(again->nodes().used_nodes(), hrtc->nodes().used_nodes());
      const std::vector<RegionId> next = any_regions(4);
      const auto units = static_cast<std::uint32_t>(random_() % 2000);
      ASSERT_EQ(ask(*again, next, units), ask(*hrtc, next, units));
    }
  }
  EXPECT_GT(compared, 2u);
}

TEST_P(Resting, AStateThatCannotHaveBeenIsRefused) {
  const RegionId region = some_regions(1)[0];
  const std::uint32_t base = model_.summary.base_faces;
  const auto restores = [&](const std::vector<spm::Forest::InUse>& regions) {
    return this->hrtc(kRoomy)->forest().restore(base, regions.data(), static_cast<std::uint32_t>(regions.size()));
  };
  EXPECT_TRUE(restores({{region, 1, false, true}}));
  EXPECT_FALSE(restores({{region, 1, false, true}, {region, 1, false, true}})) << "named twice";
  EXPECT_FALSE(restores({{region, 0, false, true}})) << "nothing is left of it to rest";
  EXPECT_FALSE(restores({{region, 1, true, true}})) << "what is to go does not rest";
}

INSTANTIATE_TEST_SUITE_P(Seeds, Resting, ::testing::Range<std::uint64_t>(1, 9));

}  // namespace
}  // namespace tactus
