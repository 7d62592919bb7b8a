#include "spm/offline/certificate.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <set>

#include "spm/checksum.hpp"
#include "spm/directory.hpp"
#include "spm/offline/build.hpp"
#include "spm/offline/generate.hpp"
#include "spm/offline/verify.hpp"
#include "spm/region_grid.hpp"
#include "tests/support/hrtc_model.hpp"

namespace tactus::spm::offline {
namespace {

BuiltModel organ() {
  BuildOptions options;
  options.simplify.base_faces = 100;
  options.partition.cell_faces = 60;
  options.partition.max_cell_faces = 100;
  return build_model(generate(Shape::kOrgan, 8000), options);
}

TEST(Certificate, NoSphereAnywhereNeedsMoreAndTheBoundIsNear) {
  const BuiltModel built = organ();
  const Model model = built.model();
  const RegionGrid grid{model.summary.grid, model.regions};
  for (const double radius : {0.0005, 0.003, 0.01}) {
    const Certificate certificate = certify(model, radius, 0.05);
    std::mt19937 random{5};
    std::uniform_real_distribution<double> jitter{-radius, radius};
    std::size_t max_regions = 0, max_records = 0, max_parts = 0;
    for (int i = 0; i < 2000; ++i) {
      const std::array<float, 3>& near = model.positions[random() % model.summary.vertices];
      const Vec3d centre{near[0] + jitter(random), near[1] + jitter(random), near[2] + jitter(random)};
      std::size_t regions = 0, parts = 0;
      std::set<std::uint32_t> records;
      ASSERT_TRUE(grid.for_each_intersecting(centre, radius, [&](RegionId region, double) {
        ++regions;
        for (const spm::Interval& run : model.intervals_of(region)) {
          for (std::uint32_t r = run.first; r < run.first + run.count; ++r) records.insert(r);
        }
      }));
      for (const std::uint32_t r : records) {
        for (PartIndex p{r}; p != kNone; p = model.parts[p].next) ++parts;
      }
      max_regions = std::max(max_regions, regions);
      max_records = std::max(max_records, records.size());
      max_parts = std::max(max_parts, parts);
    }
    EXPECT_LE(max_regions, certificate.regions) << radius;
    EXPECT_LE(max_records, certificate.records) << radius;
    EXPECT_LE(max_parts, certificate.parts) << radius;
    EXPECT_LE(certificate.records, 2 * max_records) << radius;
  }
}

TEST(Certificate, AMovingSphereNeedsNoMoreThanWhatItBeganWithAndWhatEveryStepBrings) {
  const BuiltModel built = organ();
  const Model model = built.model();
  const RegionGrid grid{model.summary.grid, model.regions};
  constexpr double kRadius = 0.003;
  const Certificate certificate = certify(model, kRadius, 0.05);
  EXPECT_LE(certificate.entering_records, certificate.records);
  std::mt19937 random{7};
  std::uniform_real_distribution<double> unit{-1, 1};
  std::size_t max_beyond_start = 0;
  for (int path = 0; path < 100; ++path) {
    // Straight on from a vertex, in pieces so small that no cube in between is passed over.
    constexpr int kPieces = 200;
    const std::array<float, 3>& start = model.positions[random() % model.summary.vertices];
    Vec3d centre{start[0], start[1], start[2]};
    const Vec3d piece = Vec3d{unit(random), unit(random), unit(random)}.normalized() * certificate.step / 10;
    std::set<std::uint32_t> records;
    double crossings = 3;
    for (int k = 0; k < kPieces; ++k, centre += piece) {
      crossings += piece.lpNorm<1>() / certificate.step;
      ASSERT_TRUE(grid.for_each_intersecting(centre, kRadius, [&](RegionId region, double) {
        for (const spm::Interval& run : model.intervals_of(region))
          for (std::uint32_t r = run.first; r < run.first + run.count; ++r) records.insert(r);
      }));
      ASSERT_LE(static_cast<double>(records.size()), certificate.records + crossings * certificate.entering_records);
    }
    max_beyond_start = std::max(max_beyond_start, records.size());
  }
  EXPECT_GT(max_beyond_start, certificate.records) << "the paths were too short to need anything new";
  EXPECT_DOUBLE_EQ(certificate.steps_per_second(), std::sqrt(3.0) * 0.05 / certificate.step);
}

TEST(Certificate, TheWorstStepTakesTheWorkThatItSays) {
  const BuiltModel built = organ();
  const Model model = built.model();
  for (const double radius : {0.0005, 0.003, 0.01}) {
    const Certificate certificate = certify(model, radius, 0.05);
    test_support::HrtcModel hrtc{model, PoolSettings::for_slots(8 * model.summary.vertices)};
    for (std::uint32_t r = 0; r < model.summary.regions; ++r)
      ASSERT_EQ(hrtc.load(RegionId{r}), AcceptResult::kAccepted);
    Forest& forest = hrtc.forest();
    constexpr std::uint32_t kPlenty = 1u << 30;
    const auto step = [&](const std::vector<RegionId>& to) {
      forest.set_targets(to.data(), static_cast<std::uint32_t>(to.size()));
      Budget budget{kPlenty};
      EXPECT_EQ(forest.advance(budget), Advance::kDone);
      const RefitCount refit = forest.refit();
      EXPECT_LE(hrtc.nodes().used_nodes(), certificate.nodes);
      EXPECT_LE(refit.marked, max_marked(refit.changed, model.summary.faces));
      return kPlenty - budget.units;
    };
    step(certificate.regions_before);
    EXPECT_EQ(step(certificate.regions_after), certificate.work_units) << radius;
    EXPECT_LE(hrtc.nodes().used_nodes(), certificate.nodes) << radius;
  }
}

TEST(Certificate, NoSphereAnywhereShowsMoreNodesThanItSaysAndTheBoundIsNear) {
  const BuiltModel built = organ();
  const Model model = built.model();
  const RegionGrid grid{model.summary.grid, model.regions};
  constexpr double kRadius = 0.003;
  const Certificate certificate = certify(model, kRadius, 0.05);
  test_support::HrtcModel hrtc{model, PoolSettings::for_slots(8 * model.summary.vertices)};
  for (std::uint32_t r = 0; r < model.summary.regions; ++r) ASSERT_EQ(hrtc.load(RegionId{r}), AcceptResult::kAccepted);
  std::mt19937 random{13};
  std::uint32_t max = 0;
  for (int i = 0; i < 300; ++i) {
    const std::array<float, 3>& near = model.positions[random() % model.summary.vertices];
    const Vec3d centre =
        i == 0 ? Vec3d{certificate.worst_position[0], certificate.worst_position[1], certificate.worst_position[2]}
               : Vec3d{near[0], near[1], near[2]};
    std::vector<RegionId> regions;
    ASSERT_TRUE(
        grid.for_each_intersecting(centre, kRadius, [&](RegionId region, double) { regions.push_back(region); }));
    ASSERT_EQ(hrtc.refine(regions), Advance::kDone);
    max = std::max(max, hrtc.nodes().used_nodes());
  }
  EXPECT_LE(max, certificate.nodes);
  EXPECT_LE(certificate.nodes, 2 * max);
}

TEST(Certificate, WhatTheWorstStepBringsIsNewAndComplete) {
  const BuiltModel built = organ();
  const Model model = built.model();
  const Certificate certificate = certify(model, 0.003, 0.05);
  std::set<std::uint32_t> brought;
  for (const Certificate::RegionMessage& message : certificate.messages) {
    std::set<std::uint32_t> listed;
    for (const spm::Interval& run : model.intervals_of(message.region))
      for (std::uint32_t r = run.first; r < run.first + run.count; ++r) listed.insert(r);
    for (const spm::Interval& run : message.missing)
      for (std::uint32_t r = run.first; r < run.first + run.count; ++r) {
        EXPECT_EQ(listed.count(r), 1u);
        EXPECT_TRUE(brought.insert(r).second) << "record " << r << " comes twice";
      }
  }
  EXPECT_EQ(brought.size(), certificate.entering_records);
}

TEST(Certificate, APoolOfTheSlotsNeededHoldsWhatABallNeedsAndTheMemoryNeededHasThatPool) {
  const BuiltModel built = organ();
  const Model model = built.model();
  const RegionGrid grid{model.summary.grid, model.regions};
  const Certificate certificate = certify(model, 0.003, 0.05);
  const PoolSettings settings = PoolSettings::for_slots(slots_needed(model.summary, certificate));
  const MemoryShares shares = memory_shares(memory_needed(model.summary, certificate));
  EXPECT_GE(shares.pool.slots, settings.slots);
  EXPECT_GE(shares.directories, directory_bytes(model.summary, shares.pool));
  std::mt19937 random{11};
  for (int i = 0; i < 30; ++i) {
    const std::array<float, 3>& near = model.positions[random() % model.summary.vertices];
    const Vec3d centre =
        i == 0 ? Vec3d{certificate.worst_position[0], certificate.worst_position[1], certificate.worst_position[2]}
               : Vec3d{near[0], near[1], near[2]};
    test_support::HrtcModel hrtc{model, settings};
    std::vector<RegionId> regions;
    ASSERT_TRUE(grid.for_each_intersecting(centre, 0.003, [&](RegionId region, double) { regions.push_back(region); }));
    for (const RegionId region : regions) ASSERT_EQ(hrtc.load(region), AcceptResult::kAccepted) << "ball " << i;
    EXPECT_EQ(hrtc.refine(regions), Advance::kDone) << "ball " << i;
    EXPECT_TRUE(hrtc.forest().is_exact(centre, 0.003));
  }
}

TEST(TreeSizes, AreThoseOfTheImplicitTree) {
  EXPECT_EQ(tree_size(1, 8).levels, 0u);
  EXPECT_EQ(tree_size(8, 8).nodes, 1u);
  EXPECT_EQ(tree_size(9, 8).levels, 2u);
  EXPECT_EQ(tree_size(9, 8).nodes, 3u);
  EXPECT_EQ(tree_size(5, 2).nodes, 3u + 2 + 1);
}

class Verify : public ::testing::Test {
 protected:
  static BuildOptions options() {
    BuildOptions o;
    o.simplify.base_faces = 60;
    o.partition.cell_faces = 60;
    return o;
  }
  TriangleMesh mesh_ = generate(Shape::kTerrain, 2000);
  BuiltModel built_ = build_model(mesh_, options());
};

TEST_F(Verify, FindsAModelOfItsMeshExact) {
  const Verification result = verify(built_.model(), mesh_);
  EXPECT_TRUE(result.mismatches.empty());
  EXPECT_EQ(result.regions, built_.summary.regions);
  EXPECT_GE(result.faces_in_regions, mesh_.faces.size());
}

TEST_F(Verify, FindsOneBitOfOnePosition) {
  TriangleMesh other = mesh_;
  other.positions[100][2] = std::nextafter(other.positions[100][2], 1.0f);
  EXPECT_FALSE(verify(built_.model(), other).mismatches.empty());
}

TEST_F(Verify, FindsAFaceTurnedOver) {
  TriangleMesh other = mesh_;
  std::swap(other.faces[7][0], other.faces[7][1]);
  EXPECT_FALSE(verify(built_.model(), other).mismatches.empty());
}

TEST_F(Verify, FindsARegionWhoseListIsTooShort) {
  // Closed and sound all the same: the region loses its last record, which nothing in its list needs.
  BuiltModel broken = built_;
  Region& region = broken.regions.back();
  --broken.intervals.back().count;
  --region.record_count;
  --region.part_count;
  if (broken.intervals.back().count == 0) {
    broken.intervals.pop_back();
    --region.interval_count;
  }
  region.checksum = region_checksums(broken.model()).back();
  ASSERT_TRUE(violations(broken.model()).empty());
  EXPECT_FALSE(verify(broken.model(), mesh_).mismatches.empty());
}

TEST_F(Verify, FindsAMissingRegion) {
  BuiltModel broken = built_;
  broken.intervals.resize(broken.regions.back().first_interval);
  broken.regions.pop_back();
  --broken.summary.regions;
  ASSERT_TRUE(violations(broken.model()).empty());
  EXPECT_FALSE(verify(broken.model(), mesh_).mismatches.empty());
}

TEST(Certificate, TheNodesThatItSaysAreEnoughWhateverRests) {
  const BuiltModel built = organ();
  const Model model = built.model();
  const RegionGrid grid{model.summary.grid, model.regions};
  constexpr double kRadius = 0.003;
  PoolSettings settings = PoolSettings::for_slots(8 * model.summary.vertices);
  // A record may only be split when each face that it bears could have a branch of its own.
  constexpr std::uint32_t kBranches = 6 * 7;
  settings.tree_nodes = certify(model, kRadius, 0.05).nodes + kBranches;
  test_support::HrtcModel hrtc{model, settings};
  for (std::uint32_t r = 0; r < model.summary.regions; ++r) ASSERT_EQ(hrtc.load(RegionId{r}), AcceptResult::kAccepted);
  std::mt19937 random{17};
  std::uint32_t full = 0;
  for (int i = 0; i < 300; ++i) {
    const std::array<float, 3>& near = model.positions[random() % model.summary.vertices];
    std::vector<RegionId> regions;
    ASSERT_TRUE(grid.for_each_intersecting(Vec3d{near[0], near[1], near[2]}, kRadius,
                                           [&](RegionId region, double) { regions.push_back(region); }));
    const auto ask = [&] { return hrtc.refine(regions, 1u << 30, nullptr, 0, Unrequested::kRetain); };
    Advance advance = ask();
    if (advance == Advance::kNodesFull) {  // those of what rested are free after the refit
      ++full;
      advance = ask();
    }
    ASSERT_EQ(advance, Advance::kDone) << i;
    for (const RegionId region : regions) ASSERT_TRUE(hrtc.forest().is_refined(region));
  }
  EXPECT_GT(full, 10u) << "nodes were never short";
  EXPECT_LT(full, 290u) << "nothing ever rested";
  EXPECT_THAT(hrtc.forest().violations(), ::testing::IsEmpty());
}

}  // namespace
}  // namespace tactus::spm::offline
