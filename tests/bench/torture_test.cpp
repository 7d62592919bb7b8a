// Splits, collapses, loads, evicts and reloads records in random order, up to a million times. Then the set of refined
// regions alone must determine the mesh.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "bench/torture_run.hpp"
#include "spm/offline/build.hpp"
#include "spm/offline/generate.hpp"
#include "tests/support/random_model.hpp"

namespace tactus::bench {
namespace {

void expect_determined(const TortureResult& result, const TortureSettings& settings) {
  EXPECT_GE(result.operations(), settings.operations);
  EXPECT_EQ(result.checks, settings.checks + 1);
  EXPECT_THAT(result.problems, testing::IsEmpty());
  EXPECT_GT(result.regions_at_end, 0u);
  EXPECT_GT(result.reloaded, 0u);
  EXPECT_GT(result.cut_by_budget, 0u);
  EXPECT_GT(result.refused_full, 0u);
  EXPECT_EQ(result.hash, result.expected_hash);
  EXPECT_EQ(result.hash, result.fresh_hash);
  EXPECT_GT(result.faces_compared, 0u);
  EXPECT_EQ(result.faces_different, 0u);
}

TEST(Torture, AfterAMillionOperationsTheRefinedRegionsDetermineTheMesh) {
  const spm::offline::BuiltModel built =
      spm::offline::build_model(spm::offline::generate(spm::offline::Shape::kOrgan, 20000, 3));
  TortureSettings settings;
  settings.checks = 10;
  settings.seed = 5;
  expect_determined(torture(built.model(), settings), settings);
}

TEST(Torture, TheRefinedRegionsDetermineTheMeshOfARandomModelWithRecordsOfSeveralParts) {
  const spm::OwnedModel model = test_support::random_model(9, 4000, 6);
  TortureSettings settings;
  settings.operations = 300'000;
  settings.checks = 10;
  settings.pool_share = 0.6;
  expect_determined(torture(model.model(), settings), settings);
}

}  // namespace
}  // namespace tactus::bench
