// Tests targets with an exact number of applied entries, by which a viewer shows the mesh of an HRTC.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <random>

#include "tests/support/hrtc_model.hpp"
#include "tests/support/random_model.hpp"

namespace tactus {
namespace {

using spm::Advance;
using spm::RegionId;
using test_support::HrtcModel;
using ::testing::IsEmpty;

class ExactTargets : public ::testing::TestWithParam<std::uint64_t> {
 protected:
  /// Returns a model whose regions are all loaded and not refined.
  [[nodiscard]] std::unique_ptr<HrtcModel> make_hrtc() const {
    auto hrtc = std::make_unique<HrtcModel>(model_, spm::PoolSettings::for_slots(1u << 14));
    for (std::uint32_t i = 0; i < model_.summary.regions; ++i)
      EXPECT_EQ(hrtc->load(RegionId{i}), spm::AcceptResult::kAccepted);
    return hrtc;
  }
  [[nodiscard]] std::vector<RegionId> any_regions(std::size_t max) {
    std::vector<RegionId> regions;
    for (std::size_t count = random_() % (max + 1); count > 0; --count)
      regions.push_back(RegionId{static_cast<std::uint32_t>(random_() % model_.summary.regions)});
    return regions;
  }
  [[nodiscard]] static std::vector<spm::Forest::Applied> applied(const spm::Forest& forest) {
    std::vector<spm::Forest::InUse> in_use(forest.copy_in_use(nullptr, 0));
    (void)forest.copy_in_use(in_use.data(), static_cast<std::uint32_t>(in_use.size()));
    std::vector<spm::Forest::Applied> regions;
    for (const spm::Forest::InUse& region : in_use) regions.push_back({region.region, region.applied});
    return regions;
  }
  /// Brings `follower` to the mesh of `leader`, in steps of `units`.
  static void follow(const spm::Forest& leader, spm::Forest& follower, std::uint32_t units) {
    const std::vector<spm::Forest::Applied> regions = applied(leader);
    for (int i = 0; i < 100000; ++i) {
      follower.set_targets(regions.data(), static_cast<std::uint32_t>(regions.size()));
      spm::Budget budget{units};
      const Advance result = follower.advance(budget);
      static_cast<void>(follower.refit());
      ASSERT_THAT(follower.violations(), IsEmpty());
      if (result == Advance::kDone) return;
      ASSERT_EQ(result, Advance::kBudget);
    }
    FAIL() << "the follower does not reach the mesh";
  }

  spm::OwnedModel owned_ = test_support::random_model(GetParam(), 600, 3);
  spm::Model model_ = owned_.model();
  std::mt19937_64 random_{GetParam()};
};

TEST_P(ExactTargets, AFollowerReachesEveryMeshOfTheLeaderAlsoPartlyRefinedOnes) {
  const auto leader = make_hrtc(), follower = make_hrtc();
  for (int step = 0; step < 60; ++step) {
    SCOPED_TRACE(step);
    // The leader runs out of budget in most steps, so some of its regions are partly refined.
    const auto others = random_() % 2 == 0 ? spm::Unrequested::kRetain : spm::Unrequested::kCoarsen;
    (void)leader->refine(any_regions(6), static_cast<std::uint32_t>(random_() % 3000), nullptr, 0, others);
    if (!leader->forest().is_base_shown()) continue;
    const std::uint32_t units = random_() % 2 == 0 ? 1u << 30 : 200;
    ASSERT_NO_FATAL_FAILURE(follow(leader->forest(), follower->forest(), units));
    EXPECT_EQ(follower->forest().mesh_hash(), leader->forest().mesh_hash());
  }
}

TEST_P(ExactTargets, MoreEntriesThanTheListHasRefineTheWholeRegion) {
  const auto hrtc = make_hrtc();
  std::vector<spm::Forest::Applied> all;
  for (std::uint32_t i = 0; i < model_.summary.regions; ++i) all.push_back({RegionId{i}, ~0u});
  hrtc->forest().set_targets(all.data(), static_cast<std::uint32_t>(all.size()));
  spm::Budget budget{1u << 30};
  ASSERT_EQ(hrtc->forest().advance(budget), Advance::kDone);
  static_cast<void>(hrtc->forest().refit());
  for (std::uint32_t i = 0; i < model_.summary.regions; ++i) EXPECT_TRUE(hrtc->forest().is_refined(RegionId{i}));
  EXPECT_THAT(hrtc->forest().violations(), IsEmpty());
}

INSTANTIATE_TEST_SUITE_P(Seeds, ExactTargets, ::testing::Range<std::uint64_t>(1, 21));

}  // namespace
}  // namespace tactus
