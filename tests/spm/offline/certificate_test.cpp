#include "spm/offline/certificate.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <optional>
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

Vec3d position_of(const Model& model, std::uint32_t vertex) {
  const std::array<float, 3>& p = model.positions[vertex];
  return {p[0], p[1], p[2]};
}

void add_records(const Model& model, RegionId region, std::set<std::uint32_t>& records) {
  for (const spm::Interval& interval : model.intervals_of(region))
    for (std::uint32_t r = interval.first; r < interval.first + interval.count; ++r) records.insert(r);
}

std::vector<RegionId> regions_around(const RegionGrid& grid, const Vec3d& centre, double radius) {
  std::vector<RegionId> regions;
  EXPECT_TRUE(grid.for_each_intersecting(centre, radius, [&](RegionId region, double) { regions.push_back(region); }));
  return regions;
}

Vec3d worst_position(const Certificate& certificate) {
  return {certificate.worst_position[0], certificate.worst_position[1], certificate.worst_position[2]};
}

void load_all(test_support::HrtcModel& hrtc) {
  for (std::uint32_t r = 0; r < hrtc.model().summary.regions; ++r)
    ASSERT_EQ(hrtc.load(RegionId{r}), AcceptResult::kAccepted);
}

TEST(Certificate, NoSphereNeedsMoreThanTheCertificateAndTheWorstSphereNeedsAtLeastHalfOfIt) {
  const BuiltModel built = organ();
  const Model model = built.model();
  const RegionGrid grid{model.summary.grid, model.regions};
  for (const double radius : {0.0005, 0.003, 0.01}) {
    const Certificate certificate = certify(model, radius, 0.05);
    std::mt19937 random{5};
    std::uniform_real_distribution<double> jitter{-radius, radius};
    std::size_t max_regions = 0, max_records = 0, max_parts = 0;
    for (int i = 0; i < 2000; ++i) {
      const Vec3d vertex = position_of(model, static_cast<std::uint32_t>(random() % model.summary.vertices));
      const Vec3d centre = vertex + Vec3d{jitter(random), jitter(random), jitter(random)};
      const std::vector<RegionId> regions = regions_around(grid, centre, radius);
      std::size_t parts = 0;
      std::set<std::uint32_t> records;
      for (const RegionId region : regions) add_records(model, region, records);
      for (const std::uint32_t record : records) {
        for (PartIndex part{record}; part != kNone; part = model.parts[part].next) ++parts;
      }
      max_regions = std::max(max_regions, regions.size());
      max_records = std::max(max_records, records.size());
      max_parts = std::max(max_parts, parts);
    }
    EXPECT_LE(max_regions, certificate.regions) << radius;
    EXPECT_LE(max_records, certificate.records) << radius;
    EXPECT_LE(max_parts, certificate.parts) << radius;
    EXPECT_LE(certificate.records, 2 * max_records) << radius;
  }
}

TEST(Certificate, AMovingSphereNeedsNoMoreThanItsFirstRecordsAndTheEnteringRecordsOfEachStep) {
  const BuiltModel built = organ();
  const Model model = built.model();
  const RegionGrid grid{model.summary.grid, model.regions};
  constexpr double kRadius = 0.003;
  const Certificate certificate = certify(model, kRadius, 0.05);
  EXPECT_LE(certificate.entering_records, certificate.records);
  std::mt19937 random{7};
  std::uniform_real_distribution<double> unit{-1, 1};
  std::size_t max_records = 0;
  for (int path = 0; path < 100; ++path) {
    // A straight path from a vertex, in displacements so small that the sphere skips no region.
    constexpr int kDisplacements = 200;
    Vec3d centre = position_of(model, static_cast<std::uint32_t>(random() % model.summary.vertices));
    const Vec3d displacement = Vec3d{unit(random), unit(random), unit(random)}.normalized() * certificate.step / 10;
    std::set<std::uint32_t> records;
    double crossings = 3;
    for (int i = 0; i < kDisplacements; ++i, centre += displacement) {
      crossings += displacement.lpNorm<1>() / certificate.step;
      for (const RegionId region : regions_around(grid, centre, kRadius)) add_records(model, region, records);
      ASSERT_LE(static_cast<double>(records.size()), certificate.records + crossings * certificate.entering_records);
    }
    max_records = std::max(max_records, records.size());
  }
  EXPECT_GT(max_records, certificate.records) << "the paths were too short to need further records";
  EXPECT_DOUBLE_EQ(certificate.steps_per_second(), std::sqrt(3.0) * 0.05 / certificate.step);
}

TEST(Certificate, TheWorstStepTakesTheCertifiedWork) {
  const BuiltModel built = organ();
  const Model model = built.model();
  for (const double radius : {0.0005, 0.003, 0.01}) {
    const Certificate certificate = certify(model, radius, 0.05);
    test_support::HrtcModel hrtc{model, PoolSettings::for_slots(8 * model.summary.vertices)};
    load_all(hrtc);
    Forest& forest = hrtc.forest();
    constexpr std::uint32_t kUnits = 1u << 30;
    const auto work_of_step = [&](const std::vector<RegionId>& targets) {
      forest.set_targets(targets.data(), static_cast<std::uint32_t>(targets.size()));
      Budget budget{kUnits};
      EXPECT_EQ(forest.advance(budget), Advance::kDone);
      const RefitCount refit = forest.refit();
      EXPECT_LE(hrtc.nodes().used_nodes(), certificate.nodes);
      EXPECT_LE(refit.marked, max_marked(refit.changed, model.summary.faces));
      return kUnits - budget.units;
    };
    work_of_step(certificate.regions_before);
    EXPECT_EQ(work_of_step(certificate.regions_after), certificate.work_units) << radius;
    EXPECT_LE(hrtc.nodes().used_nodes(), certificate.nodes) << radius;
  }
}

TEST(Certificate, NoSphereUsesMoreNodesThanCertifiedAndTheWorstSphereUsesAtLeastHalfOfThem) {
  const BuiltModel built = organ();
  const Model model = built.model();
  const RegionGrid grid{model.summary.grid, model.regions};
  constexpr double kRadius = 0.003;
  const Certificate certificate = certify(model, kRadius, 0.05);
  test_support::HrtcModel hrtc{model, PoolSettings::for_slots(8 * model.summary.vertices)};
  load_all(hrtc);
  std::mt19937 random{13};
  std::uint32_t max_nodes = 0;
  for (int i = 0; i < 300; ++i) {
    const auto vertex = static_cast<std::uint32_t>(random() % model.summary.vertices);
    const Vec3d centre = i == 0 ? worst_position(certificate) : position_of(model, vertex);
    ASSERT_EQ(hrtc.refine(regions_around(grid, centre, kRadius)), Advance::kDone);
    max_nodes = std::max(max_nodes, hrtc.nodes().used_nodes());
  }
  EXPECT_LE(max_nodes, certificate.nodes);
  EXPECT_LE(certificate.nodes, 2 * max_nodes);
}

TEST(Certificate, TheMessagesOfTheWorstStepContainEachEnteringRecordOnce) {
  const BuiltModel built = organ();
  const Model model = built.model();
  const Certificate certificate = certify(model, 0.003, 0.05);
  std::set<std::uint32_t> sent;
  for (const Certificate::RegionMessage& message : certificate.messages) {
    std::set<std::uint32_t> listed;
    add_records(model, message.region, listed);
    for (const spm::Interval& interval : message.missing)
      for (std::uint32_t r = interval.first; r < interval.first + interval.count; ++r) {
        EXPECT_EQ(listed.count(r), 1u);
        EXPECT_TRUE(sent.insert(r).second) << "record " << r << " is sent twice";
      }
  }
  EXPECT_EQ(sent.size(), certificate.entering_records);
}

TEST(Certificate, ThePoolInTheCertifiedMemoryIsEnoughForAnySphere) {
  const BuiltModel built = organ();
  const Model model = built.model();
  const RegionGrid grid{model.summary.grid, model.regions};
  const Certificate certificate = certify(model, 0.003, 0.05);
  const PoolSettings settings = PoolSettings::for_slots(*slots_needed(model.summary, certificate));
  const MemoryShares shares = memory_shares(*memory_needed(model.summary, certificate));
  EXPECT_GE(shares.pool.slots, settings.slots);
  EXPECT_GE(shares.directories, directory_bytes(model.summary, shares.pool));
  std::mt19937 random{11};
  for (int i = 0; i < 30; ++i) {
    const auto vertex = static_cast<std::uint32_t>(random() % model.summary.vertices);
    const Vec3d centre = i == 0 ? worst_position(certificate) : position_of(model, vertex);
    test_support::HrtcModel hrtc{model, settings};
    const std::vector<RegionId> regions = regions_around(grid, centre, 0.003);
    for (const RegionId region : regions) ASSERT_EQ(hrtc.load(region), AcceptResult::kAccepted) << "sphere " << i;
    EXPECT_EQ(hrtc.refine(regions), Advance::kDone) << "sphere " << i;
    EXPECT_TRUE(hrtc.forest().is_exact(centre, 0.003));
  }
}

TEST(MemoryShares, TheDirectoryOf28MillionFacesFitsInto16MiB) {
  ModelSummary summary{};
  summary.faces = 28'000'000;
  summary.records = 14'000'000;
  summary.regions = 103'295;  // of the generated organ
  summary.base_faces = 500;
  for (const std::uint64_t memory : {16u << 20, 24u << 20, 64u << 20}) {
    const MemoryShares shares = memory_shares(memory);
    EXPECT_GE(shares.directories, directory_bytes(summary, shares.pool)) << memory;
    EXPECT_LE(shares.directories + shares.pool.bytes(), memory);
  }
}

TEST(Certificate, NoPoolIsEnoughForMoreSlotsThanAPoolCanHave) {
  ModelSummary summary{};
  summary.base_vertices = 1000;
  summary.base_faces = 1996;
  Certificate certificate{};
  certificate.parts = kMaxSlots - summary.base_vertices;
  EXPECT_EQ(slots_needed(summary, certificate), kMaxSlots);
  const std::optional<std::uint64_t> memory = memory_needed(summary, certificate);
  ASSERT_TRUE(memory);
  EXPECT_EQ(memory_shares(*memory).pool.slots, kMaxSlots);
  ++certificate.parts;
  EXPECT_EQ(slots_needed(summary, certificate), std::nullopt);
  EXPECT_EQ(memory_needed(summary, certificate), std::nullopt);
}

TEST(TreeSizes, AreTheSizesOfTheImplicitTree) {
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

TEST_F(Verify, AcceptsTheModelOfItsMesh) {
  const Verification result = verify(built_.model(), mesh_);
  EXPECT_TRUE(result.mismatches.empty());
  EXPECT_EQ(result.regions, built_.summary.regions);
  EXPECT_GE(result.faces_in_regions, mesh_.faces.size());
}

TEST_F(Verify, FindsADifferenceOfOneBitInOnePosition) {
  TriangleMesh changed = mesh_;
  changed.positions[100][2] = std::nextafter(changed.positions[100][2], 1.0f);
  EXPECT_FALSE(verify(built_.model(), changed).mismatches.empty());
}

TEST_F(Verify, FindsAFaceWithReversedOrientation) {
  TriangleMesh changed = mesh_;
  std::swap(changed.faces[7][0], changed.faces[7][1]);
  EXPECT_FALSE(verify(built_.model(), changed).mismatches.empty());
}

TEST_F(Verify, FindsARegionWhoseListIsTooShort) {
  // The region loses its last record. No other record of the list depends on this record, so the list is still closed.
  BuiltModel damaged = built_;
  Region& region = damaged.regions.back();
  --damaged.intervals.back().count;
  --region.record_count;
  --region.part_count;
  if (damaged.intervals.back().count == 0) {
    damaged.intervals.pop_back();
    --region.interval_count;
  }
  region.checksum = region_checksums(damaged.model()).back();
  ASSERT_TRUE(violations(damaged.model()).empty());
  EXPECT_FALSE(verify(damaged.model(), mesh_).mismatches.empty());
}

TEST_F(Verify, FindsAMissingRegion) {
  BuiltModel damaged = built_;
  damaged.intervals.resize(damaged.regions.back().first_interval);
  damaged.regions.pop_back();
  --damaged.summary.regions;
  ASSERT_TRUE(violations(damaged.model()).empty());
  EXPECT_FALSE(verify(damaged.model(), mesh_).mismatches.empty());
}

TEST(Certificate, TheCertifiedNodesAreEnoughWhicheverRegionsAreRetained) {
  const BuiltModel built = organ();
  const Model model = built.model();
  const RegionGrid grid{model.summary.grid, model.regions};
  constexpr double kRadius = 0.003;
  PoolSettings settings = PoolSettings::for_slots(8 * model.summary.vertices);
  // The forest splits a record only if the free nodes suffice for a branch of 7 nodes for each of 6 born faces.
  constexpr std::uint32_t kBranches = 6 * 7;
  settings.tree_nodes = certify(model, kRadius, 0.05).nodes + kBranches;
  test_support::HrtcModel hrtc{model, settings};
  load_all(hrtc);
  std::mt19937 random{17};
  std::uint32_t full = 0;
  for (int i = 0; i < 300; ++i) {
    const Vec3d centre = position_of(model, static_cast<std::uint32_t>(random() % model.summary.vertices));
    const std::vector<RegionId> regions = regions_around(grid, centre, kRadius);
    const auto refine = [&] { return hrtc.refine(regions, 1u << 30, nullptr, 0, Unrequested::kRetain); };
    Advance advance = refine();
    if (advance == Advance::kNodesFull) {  // the nodes of retained regions are free only after the refit
      ++full;
      advance = refine();
    }
    ASSERT_EQ(advance, Advance::kDone) << i;
    for (const RegionId region : regions) ASSERT_TRUE(hrtc.forest().is_refined(region));
  }
  EXPECT_GT(full, 10u) << "the nodes were hardly ever used up";
  EXPECT_LT(full, 290u) << "the nodes were nearly always used up";
  EXPECT_THAT(hrtc.forest().violations(), ::testing::IsEmpty());
}

}  // namespace
}  // namespace tactus::spm::offline
