// Tests both profiles, lossless and compact, with every mesh of the zoo, in the codec and the cache.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <optional>
#include <random>
#include <tuple>

#include "spm/offline/build.hpp"
#include "spm/offline/generate.hpp"
#include "spm/offline/snap.hpp"
#include "spm/offline/verify.hpp"
#include "tests/support/hrtc_model.hpp"
#include "tests/support/loaded_records.hpp"
#include "tests/support/mesh_zoo.hpp"

namespace tactus::spm::offline {
namespace {

using test_support::mesh_zoo;
using test_support::ZooMesh;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

BuildOptions options_with(unsigned grid_bits) {
  BuildOptions options;
  options.simplify.base_faces = 12;
  options.partition.cell_faces = 40;
  options.partition.max_cell_faces = 80;
  options.grid_bits = grid_bits;
  return options;
}

class EveryProfile : public ::testing::TestWithParam<std::tuple<ZooMesh, unsigned>> {
 protected:
  /// Returns no model if floats are too coarse for the grid at the mesh's distance from the origin.
  static std::optional<BuiltModel> build() {
    const auto& [zoo, bits] = GetParam();
    try {
      return build_model(zoo.mesh, options_with(bits));
    } catch (const ModelError& e) {
      EXPECT_GT(bits, 0u);
      EXPECT_THAT(e.what(), HasSubstr("the distance of neighbouring floats this far"));
      return {};
    }
  }
  /// The cells are small, so the closed lists have far more entries than there are records.
  static PoolSettings pool_for(const Model& model) {
    PoolSettings settings = PoolSettings::for_slots(2 * (model.summary.parts + model.summary.base_faces + 64));
    for (const Region& region : model.regions) settings.list_blocks += region.record_count / ListBlock::kEntries + 1;
    return settings;
  }
};

INSTANTIATE_TEST_SUITE_P(Zoo, EveryProfile,
                         ::testing::Combine(::testing::ValuesIn(mesh_zoo()), ::testing::Values(0u, 12u)),
                         [](const auto& test) {
                           return std::get<0>(test.param).name + (std::get<1>(test.param) > 0 ? "Compact" : "Lossless");
                         });

TEST_P(EveryProfile, GivesAModelWithoutViolationsThatLoadsToTheBitInAnyOrderOfRegions) {
  const auto& [zoo, bits] = GetParam();
  const std::optional<BuiltModel> built = build();
  if (!built) return;
  const Model model = built->model();
  EXPECT_EQ(model.summary.position_step > 0, bits > 0);
  ASSERT_THAT(violations(model), IsEmpty());
  EXPECT_THAT(verify(model, zoo.mesh).mismatches, IsEmpty());

  std::vector<RegionId> order;
  for (std::uint32_t i = 0; i < model.summary.regions; ++i) order.push_back(RegionId{i});
  for (std::uint32_t seed = 1; seed <= 3; ++seed) {
    std::shuffle(order.begin(), order.end(), std::mt19937{seed});
    test_support::HrtcModel hrtc{model, pool_for(model)};
    for (const RegionId region : order) ASSERT_EQ(hrtc.load(region), AcceptResult::kAccepted) << "seed " << seed;
    EXPECT_EQ(test_support::loaded_difference(model, hrtc.pool()), "") << "seed " << seed;
  }
}

TEST_P(EveryProfile, LoadsAndReleasesRegionsInAnyOrderWithTheChecksumsOfTheBaseMesh) {
  const std::optional<BuiltModel> built = build();
  if (!built) return;
  const Model model = built->model();
  test_support::HrtcModel hrtc{model, pool_for(model)};
  std::mt19937 random{7};
  for (int step = 0; step < 400; ++step) {
    const RegionId region{static_cast<std::uint32_t>(random() % model.summary.regions)};
    if (hrtc.cache().is_loaded(hrtc.object(), region)) {
      hrtc.cache().release(hrtc.object(), region);
      continue;
    }
    RegionList list;
    ASSERT_EQ(hrtc.accept(hrtc.message(region), list), AcceptResult::kAccepted) << "step " << step << ", seed 7";
  }
  EXPECT_THAT(hrtc.cache().violations(), IsEmpty());
}

TEST(Snap, MovesCoordinatesByAtMostHalfAStepAndASecondTimeByNothing) {
  TriangleMesh mesh = generate(Shape::kOrgan, 3000);
  clean(mesh);
  const TriangleMesh before = mesh;
  const double step = step_of_grid(mesh, 16);
  const CleanReport merged = snap(mesh, step);
  ASSERT_EQ(merged.welded_vertices, 0u);
  ASSERT_EQ(mesh.positions.size(), before.positions.size());
  double max_distance = 0;
  for (std::size_t v = 0; v < mesh.positions.size(); ++v) {
    for (std::size_t axis = 0; axis < 3; ++axis) {
      max_distance =
          std::max(max_distance, std::abs(double{mesh.positions[v][axis]} - double{before.positions[v][axis]}));
    }
  }
  EXPECT_LE(max_distance, 0.501 * step);
  EXPECT_GE(max_distance, 0.4 * step);
  const TriangleMesh snapped = mesh;
  snap(mesh, step);
  EXPECT_EQ(mesh.positions, snapped.positions);
}

TEST(Snap, RefusesAGridThatIsTooFineAndReportsItsStep) {
  TriangleMesh mesh;
  mesh.positions = {{1e-3f, 0, 0}, {1.0001e-3f, 0, 0}, {1e-3f, 1e-7f, 0}};
  mesh.faces = {{0, 1, 2}};
  std::string error;
  try {
    (void)step_of_grid(mesh, 20);
  } catch (const ModelError& refusal) {
    error = refusal.what();
  }
  EXPECT_THAT(error, HasSubstr("step would be 9.5"));
  EXPECT_THAT(error, HasSubstr("expected above 1.19"));
}

TEST(Snap, MergesVerticesOnOneGridPointWithoutViolations) {
  const TriangleMesh mesh = generate(Shape::kOrgan, 3000);
  const BuiltModel built = build_model(mesh, options_with(4));
  EXPECT_LT(built.summary.vertices, mesh.positions.size() * 9 / 10);
  EXPECT_THAT(violations(built.model()), IsEmpty());
  EXPECT_THAT(verify(built.model(), mesh).mismatches, IsEmpty());
}

TEST(Violations, ReportsACoordinateOffTheGrid) {
  BuiltModel built = build_model(generate(Shape::kOrgan, 1500), options_with(10));
  ASSERT_THAT(violations(built.model()), IsEmpty());
  float& x = built.positions[20][0];
  x = std::nextafter(x, built.summary.bounds_max[0] > x ? built.summary.bounds_max[0] : built.summary.bounds_min[0]);
  EXPECT_THAT(violations(built.model()), ::testing::Contains(HasSubstr("vertex 20: off the grid")));
}

}  // namespace
}  // namespace tactus::spm::offline
