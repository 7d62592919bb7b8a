// Both profiles of every mesh of the zoo, through codec and cache.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
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

class EveryProfile : public ::testing::TestWithParam<std::tuple<ZooMesh, unsigned>> {};

INSTANTIATE_TEST_SUITE_P(Zoo, EveryProfile,
                         ::testing::Combine(::testing::ValuesIn(mesh_zoo()), ::testing::Values(0u, 12u)),
                         [](const auto& test) {
                           return std::get<0>(test.param).name + (std::get<1>(test.param) > 0 ? "Compact" : "Lossless");
                         });

TEST_P(EveryProfile, IsSoundVerifiesAndArrivesToTheBitInAnyOrderOfRegions) {
  const auto& [zoo, bits] = GetParam();
  BuiltModel built;
  try {
    built = build_model(zoo.mesh, options_with(bits));
  } catch (const ModelError& e) {
    ASSERT_GT(bits, 0u);
    ASSERT_THAT(e.what(), HasSubstr("the distance of neighbouring floats this far"));
    return;
  }
  const Model model = built.model();
  EXPECT_EQ(model.summary.position_step > 0, bits > 0);
  ASSERT_THAT(violations(model), IsEmpty());
  EXPECT_THAT(verify(model, zoo.mesh).mismatches, IsEmpty());

  std::vector<RegionId> order;
  for (std::uint32_t i = 0; i < model.summary.regions; ++i) order.push_back(RegionId{i});
  for (std::uint32_t seed = 1; seed <= 3; ++seed) {
    std::shuffle(order.begin(), order.end(), std::mt19937{seed});
    // Small cells: far more list entries than records.
    PoolSettings settings = PoolSettings::for_slots(2 * (model.summary.parts + model.summary.base_faces + 64));
    for (const Region& region : model.regions) settings.list_blocks += region.record_count / ListBlock::kEntries + 1;
    test_support::HrtcModel hrtc{model, settings};
    for (const RegionId region : order) ASSERT_EQ(hrtc.load(region), AcceptResult::kAccepted) << "seed " << seed;
    EXPECT_EQ(test_support::loaded_difference(model, hrtc.pool()), "") << "seed " << seed;
  }
}

TEST_P(EveryProfile, RegionsComeAndGoInAnyOrderWithTheChecksumsThatTheBaseMeshStates) {
  const auto& [zoo, bits] = GetParam();
  BuiltModel built;
  try {
    built = build_model(zoo.mesh, options_with(bits));
  } catch (const ModelError&) {
    return;  // as above
  }
  const Model model = built.model();
  PoolSettings settings = PoolSettings::for_slots(2 * (model.summary.parts + model.summary.base_faces + 64));
  for (const Region& region : model.regions) settings.list_blocks += region.record_count / ListBlock::kEntries + 1;
  test_support::HrtcModel hrtc{model, settings};
  std::mt19937 random{7};
  for (int step = 0; step < 400; ++step) {
    const RegionId region{static_cast<std::uint32_t>(random() % model.summary.regions)};
    if (hrtc.cache().is_loaded(hrtc.object(), region)) {
      hrtc.cache().release(hrtc.object(), region);
      continue;
    }
    RegionList list;
    ASSERT_EQ(hrtc.cache().accept(hrtc.object(), hrtc.message(region), list), AcceptResult::kAccepted)
        << "step " << step << ", seed 7";
  }
  EXPECT_THAT(hrtc.cache().violations(), IsEmpty());
}

TEST(Snap, MovesNoCoordinateByMoreThanHalfAStepAndDoesNothingTwice) {
  TriangleMesh mesh = generate(Shape::kOrgan, 3000);
  clean(mesh);
  const TriangleMesh before = mesh;
  const double step = step_of_grid(mesh, 16);
  const CleanReport merged = snap(mesh, step);
  ASSERT_EQ(merged.welded_vertices, 0u);
  ASSERT_EQ(mesh.positions.size(), before.positions.size());
  double furthest = 0;
  for (std::size_t v = 0; v < mesh.positions.size(); ++v) {
    for (std::size_t axis = 0; axis < 3; ++axis) {
      furthest = std::max(furthest, std::abs(double{mesh.positions[v][axis]} - double{before.positions[v][axis]}));
    }
  }
  EXPECT_LE(furthest, 0.501 * step);
  EXPECT_GE(furthest, 0.4 * step);
  const TriangleMesh once = mesh;
  snap(mesh, step);
  EXPECT_EQ(mesh.positions, once.positions);
}

TEST(Snap, VerticesThatFallTogetherBecomeOneAndTheModelStaysSound) {
  const TriangleMesh mesh = generate(Shape::kOrgan, 3000);
  const BuiltModel built = build_model(mesh, options_with(4));
  EXPECT_LT(built.summary.vertices, mesh.positions.size() * 9 / 10);
  EXPECT_THAT(violations(built.model()), IsEmpty());
  EXPECT_THAT(verify(built.model(), mesh).mismatches, IsEmpty());
}

TEST(Violations, ACoordinateOffTheDeclaredGridIsFound) {
  BuiltModel built = build_model(generate(Shape::kOrgan, 1500), options_with(10));
  ASSERT_THAT(violations(built.model()), IsEmpty());
  float& x = built.positions[20][0];
  x = std::nextafter(x, built.summary.bounds_max[0] > x ? built.summary.bounds_max[0] : built.summary.bounds_min[0]);
  EXPECT_THAT(violations(built.model()), ::testing::Contains(HasSubstr("vertex 20: off the grid")));
}

}  // namespace
}  // namespace tactus::spm::offline
