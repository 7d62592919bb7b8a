// Tests retained regions: a region that is no longer requested stays refined until its tree nodes are needed. The
// region that was requested least recently is coarsened first. The retained regions and their order can be copied and
// restored.

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

constexpr std::uint32_t kModelRecords = 600;
constexpr std::uint32_t kModelCells = 3;

class Retained : public ::testing::TestWithParam<std::uint64_t> {
 protected:
  /// Returns a model whose regions are all loaded and not refined. The limit of nodes for retained regions is
  /// proportional to `slots`.
  [[nodiscard]] std::unique_ptr<HrtcModel> make_hrtc(std::uint32_t slots) const {
    spm::PoolSettings settings = spm::PoolSettings::for_slots(slots);
    auto hrtc = std::make_unique<HrtcModel>(model_, settings);
    for (std::uint32_t i = 0; i < model_.summary.regions; ++i)
      EXPECT_EQ(hrtc->load(RegionId{i}), spm::AcceptResult::kAccepted);
    return hrtc;
  }
  static Advance request(HrtcModel& hrtc, const std::vector<RegionId>& regions, std::uint32_t units = 1u << 30) {
    return hrtc.refine(regions, units, nullptr, 0, Unrequested::kRetain);
  }
  [[nodiscard]] RegionId any_region() {
    return RegionId{static_cast<std::uint32_t>(random_() % model_.summary.regions)};
  }
  [[nodiscard]] std::vector<RegionId> any_regions(std::size_t max) {
    std::vector<RegionId> regions;
    for (std::size_t count = random_() % (max + 1); count > 0; --count) regions.push_back(any_region());
    return regions;
  }
  /// Returns the first `count` regions with records. A random model can have regions without records.
  [[nodiscard]] std::vector<RegionId> first_regions(std::size_t count) const {
    std::vector<RegionId> regions;
    for (std::uint32_t i = 0; i < model_.summary.regions && regions.size() < count; ++i)
      if (!model_.intervals_of(RegionId{i}).empty()) regions.push_back(RegionId{i});
    EXPECT_EQ(regions.size(), count);
    return regions;
  }

  spm::OwnedModel owned_ = test_support::random_model(GetParam(), kModelRecords, kModelCells);
  spm::Model model_ = owned_.model();
  std::mt19937_64 random_{GetParam()};
  static constexpr std::uint32_t kManySlots = 1u << 14;
};

/// A copy of a forest's list of regions in use.
struct RegionsInUse {
  std::vector<spm::Forest::InUse> regions;
  explicit RegionsInUse(const spm::Forest& forest) : regions(forest.copy_in_use(nullptr, 0)) {
    EXPECT_EQ(forest.copy_in_use(regions.data(), static_cast<std::uint32_t>(regions.size())), regions.size());
  }
  [[nodiscard]] std::vector<RegionId> retained() const {
    std::vector<RegionId> found;
    for (const spm::Forest::InUse& entry : regions)
      if (entry.retained) found.push_back(entry.region);
    return found;
  }
  /// Returns the members of all entries, for comparisons.
  [[nodiscard]] std::vector<std::vector<std::uint32_t>> members() const {
    std::vector<std::vector<std::uint32_t>> all;
    for (const spm::Forest::InUse& entry : regions)
      all.push_back({spm::index(entry.region), entry.applied, entry.retiring ? 1u : 0u, entry.retained ? 1u : 0u});
    return all;
  }
};

TEST_P(Retained, ARetainedRegionNeedsNoWorkWhenItIsRequestedAgain) {
  const auto hrtc = make_hrtc(kManySlots);
  const std::vector<RegionId> regions = first_regions(2);
  const RegionId first = regions[0], other = regions[1];
  ASSERT_EQ(request(*hrtc, {first}), Advance::kDone);
  ASSERT_EQ(request(*hrtc, {other}), Advance::kDone);
  const spm::ForestCounters before = hrtc->forest().counters();
  EXPECT_EQ(before.collapses, 0u);
  EXPECT_TRUE(hrtc->forest().is_refined(first));
  EXPECT_THAT(RegionsInUse{hrtc->forest()}.retained(), testing::ElementsAre(first));

  ASSERT_EQ(request(*hrtc, {first}, 0), Advance::kDone) << "no units are needed";

  EXPECT_EQ(hrtc->forest().counters().visits, before.visits);
  EXPECT_THAT(RegionsInUse{hrtc->forest()}.retained(), testing::ElementsAre(other));
  EXPECT_EQ(hrtc->refine({}), Advance::kDone) << "with kCoarsen no region is retained";
  EXPECT_EQ(hrtc->forest().mesh_hash(), 0u);
  EXPECT_THAT(RegionsInUse{hrtc->forest()}.regions, IsEmpty());
  EXPECT_THAT(hrtc->forest().violations(), IsEmpty());
}

TEST_P(Retained, APartlyRefinedRegionContinuesFromItsRetainedState) {
  const auto hrtc = make_hrtc(kManySlots);
  const RegionId region = first_regions(1)[0];
  ASSERT_EQ(request(*hrtc, {}), Advance::kDone) << "the base mesh";
  constexpr std::uint32_t kSome = 4 * (spm::Budget::kVisit + spm::Budget::kChange);
  ASSERT_EQ(request(*hrtc, {region}, kSome), Advance::kBudget);
  ASSERT_EQ(request(*hrtc, {}), Advance::kDone);
  EXPECT_EQ(hrtc->forest().counters().collapses, 0u);
  EXPECT_THAT(RegionsInUse{hrtc->forest()}.retained(), testing::ElementsAre(region));

  ASSERT_EQ(request(*hrtc, {region}), Advance::kDone);

  EXPECT_EQ(hrtc->forest().counters().collapses, 0u);
  EXPECT_TRUE(hrtc->forest().is_refined(region));
}

TEST_P(Retained, BeyondTheLimitOfNodesTheLeastRecentlyRequestedRegionIsCoarsenedFirst) {
  const auto hrtc = make_hrtc(1024);
  const std::uint32_t limit = spm::Forest::retained_node_limit(hrtc->pool().settings);
  std::vector<std::uint32_t> last_request(model_.summary.regions, 0);  // step number by region
  std::uint32_t steps_over_limit = 0, max_retained = 0;
  for (std::uint32_t step = 1; step < 400; ++step) {
    SCOPED_TRACE("seed " + std::to_string(GetParam()) + " step " + std::to_string(step));
    const std::vector<RegionId> requested = any_regions(3);
    for (const RegionId region : requested) last_request[spm::index(region)] = step;
    const bool over_limit = hrtc->nodes().used_nodes() > limit;
    const std::uint64_t collapses = hrtc->forest().counters().collapses;
    (void)request(*hrtc, requested);
    ASSERT_TRUE(over_limit || hrtc->forest().counters().collapses == collapses) << "coarsened below the limit";
    steps_over_limit += over_limit ? 1 : 0;

    const std::vector<RegionId> retained = RegionsInUse{hrtc->forest()}.retained();
    max_retained = std::max(max_retained, static_cast<std::uint32_t>(retained.size()));
    for (std::size_t i = 1; i < retained.size(); ++i) {  // the first retained region may be partly coarsened
      ASSERT_TRUE(hrtc->forest().is_refined(retained[i]));
      ASSERT_LE(last_request[spm::index(retained[i - 1])], last_request[spm::index(retained[i])]);
    }
    // A region that was requested later than the first retained one is still refined.
    for (std::uint32_t i = 0; i < model_.summary.regions && !retained.empty(); ++i) {
      ASSERT_TRUE(last_request[i] <= last_request[spm::index(retained[0])] || hrtc->forest().is_refined(RegionId{i}));
    }
    ASSERT_THAT(hrtc->forest().violations(), IsEmpty());
  }
  EXPECT_GT(steps_over_limit, 20u);
  EXPECT_GT(max_retained, 2u);
  for (int i = 0; i < 1000 && !RegionsInUse{hrtc->forest()}.retained().empty() && hrtc->nodes().used_nodes() > limit;
       ++i)
    ASSERT_EQ(request(*hrtc, {}), Advance::kDone);
  EXPECT_LE(hrtc->nodes().used_nodes(), limit);
}

TEST_P(Retained, ARetiredRegionIsCoarsenedAlsoBelowTheLimitOfNodes) {
  const auto hrtc = make_hrtc(kManySlots);
  const std::vector<RegionId> regions = first_regions(3);
  ASSERT_EQ(request(*hrtc, regions), Advance::kDone);
  ASSERT_EQ(request(*hrtc, {}), Advance::kDone);
  ASSERT_EQ(RegionsInUse{hrtc->forest()}.retained().size(), 3u);

  hrtc->forest().retire(regions[1]);
  ASSERT_EQ(request(*hrtc, {}), Advance::kDone);

  EXPECT_EQ(hrtc->forest().take_retired(), regions[1]);
  EXPECT_EQ(hrtc->forest().take_retired(), spm::kNone);
  EXPECT_THAT(RegionsInUse{hrtc->forest()}.retained(), testing::UnorderedElementsAre(regions[0], regions[2]));
  hrtc->cache().release(hrtc->object(), regions[1]);
  ASSERT_EQ(hrtc->load(regions[1]), spm::AcceptResult::kAccepted);
  EXPECT_FALSE(hrtc->forest().is_refined(regions[1]));
  EXPECT_THAT(hrtc->forest().violations(), IsEmpty());
}

TEST_P(Retained, ARestoredForestHasTheSameStateAndContinuesIdentically) {
  constexpr std::uint32_t kSlots = 1024;
  const auto hrtc = make_hrtc(kSlots);
  std::uint32_t compared = 0;
  for (int step = 0; step < 150; ++step) {
    (void)request(*hrtc, any_regions(4), static_cast<std::uint32_t>(random_() % 2000));
    if (step % 25 != 24) continue;
    const RegionsInUse in_use{hrtc->forest()};
    if (in_use.retained().size() < 2) continue;
    ++compared;
    const auto restored = make_hrtc(kSlots);
    restored->forest().store_previous(false);
    ASSERT_TRUE(restored->forest().restore(hrtc->forest().base_faces_shown(), in_use.regions.data(),
                                           static_cast<std::uint32_t>(in_use.regions.size())));
    for (int requests = 0; requests < 20; ++requests) {
      ASSERT_EQ(RegionsInUse{restored->forest()}.members(), RegionsInUse{hrtc->forest()}.members())
          << "after " << requests << " requests";
      ASSERT_EQ(restored->forest().mesh_hash(), hrtc->forest().mesh_hash());
      ASSERT_EQ(restored->nodes().used_nodes(), hrtc->nodes().used_nodes());
      const std::vector<RegionId> next = any_regions(4);
      const auto units = static_cast<std::uint32_t>(random_() % 2000);
      ASSERT_EQ(request(*restored, next, units), request(*hrtc, next, units));
    }
  }
  EXPECT_GT(compared, 2u);
}

TEST_P(Retained, RefusesToRestoreAnImpossibleState) {
  const RegionId region = first_regions(1)[0];
  const std::uint32_t base = model_.summary.base_faces;
  const auto restores = [&](const std::vector<spm::Forest::InUse>& regions) {
    return make_hrtc(kManySlots)->forest().restore(base, regions.data(), static_cast<std::uint32_t>(regions.size()));
  };
  EXPECT_TRUE(restores({{region, 1, false, true}}));
  EXPECT_FALSE(restores({{region, 1, false, true}, {region, 1, false, true}})) << "listed twice";
  EXPECT_FALSE(restores({{region, 0, false, true}})) << "retained without an applied record";
  EXPECT_FALSE(restores({{region, 1, true, true}})) << "retained and retiring";
}

INSTANTIATE_TEST_SUITE_P(Seeds, Retained, ::testing::Range<std::uint64_t>(1, 9));

}  // namespace
}  // namespace tactus
