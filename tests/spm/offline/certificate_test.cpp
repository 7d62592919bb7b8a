#include "spm/offline/certificate.hpp"

#include <gtest/gtest.h>

#include <random>
#include <set>

#include "spm/offline/build.hpp"
#include "spm/offline/generate.hpp"
#include "spm/offline/verify.hpp"
#include "spm/region_grid.hpp"
#include "spm/seal.hpp"

namespace tactus::spm::offline {
namespace {

TEST(Certificate, NoBallAnywhereNeedsMoreAndTheBoundIsNear) {
  BuildOptions options;
  options.simplify.base_faces = 100;
  options.partition.cell_faces = 60;
  options.partition.max_cell_faces = 100;
  const BuiltModel built = build_model(generate(Shape::kOrgan, 8000), options);
  const Model model = built.model();
  const RegionGrid grid{model.summary.grid, model.regions};
  for (const double radius : {0.0005, 0.003, 0.01}) {
    const Certificate certificate = certify(model, radius);
    std::mt19937 random{5};
    std::uniform_real_distribution<double> jitter{-radius, radius};
    std::size_t most_regions = 0, most_records = 0, most_parts = 0;
    for (int i = 0; i < 2000; ++i) {
      const std::array<float, 3>& near = model.positions[random() % model.summary.vertices];
      const Vec3d centre{near[0] + jitter(random), near[1] + jitter(random), near[2] + jitter(random)};
      std::size_t regions = 0, parts = 0;
      std::set<std::uint32_t> records;
      ASSERT_TRUE(grid.for_each_meeting(centre, radius, [&](RegionId region, double) {
        ++regions;
        for (const spm::Run& run : model.runs_of(region)) {
          for (std::uint32_t r = run.first; r < run.first + run.count; ++r) records.insert(r);
        }
      }));
      for (const std::uint32_t r : records) {
        for (std::uint32_t p = r; p != kNone; p = model.parts[p].next) ++parts;
      }
      most_regions = std::max(most_regions, regions);
      most_records = std::max(most_records, records.size());
      most_parts = std::max(most_parts, parts);
    }
    EXPECT_LE(most_regions, certificate.regions) << radius;
    EXPECT_LE(most_records, certificate.records) << radius;
    EXPECT_LE(most_parts, certificate.parts) << radius;
    EXPECT_LE(certificate.records, 2 * most_records) << radius;
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
  --broken.runs.back().count;
  --region.record_count;
  --region.part_count;
  if (broken.runs.back().count == 0) {
    broken.runs.pop_back();
    --region.run_count;
  }
  region.seal = region_seals(broken.model()).back();
  ASSERT_TRUE(violations(broken.model()).empty());
  EXPECT_FALSE(verify(broken.model(), mesh_).mismatches.empty());
}

TEST_F(Verify, FindsAMissingRegion) {
  BuiltModel broken = built_;
  broken.runs.resize(broken.regions.back().first_run);
  broken.regions.pop_back();
  --broken.summary.regions;
  ASSERT_TRUE(violations(broken.model()).empty());
  EXPECT_FALSE(verify(broken.model(), mesh_).mismatches.empty());
}

}  // namespace
}  // namespace tactus::spm::offline
