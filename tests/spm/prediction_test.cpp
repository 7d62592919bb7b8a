// Tests which cells of a plane each prediction strategy wants for a tip that moves at constant speed.

#include "spm/prediction.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <set>
#include <vector>

#include "tests/support/cells.hpp"

namespace tactus::spm {
namespace {

constexpr double kTipSpeed = 10, kRadius = 0.5, kMargin = 0.25, kLead = 0.4;

/// A plane of 41 x 41 fully occupied cells of edge 1 around the origin. The tip is at the origin and moves along x.
class Prediction : public testing::Test {
 protected:
  Prediction() {
    for (std::uint16_t x = 0; x < 41; ++x)
      for (std::uint16_t y = 0; y < 41; ++y) {
        Region region{};
        region.cell = {x, y, 0};
        region.occupied = {~0u, ~0u};
        regions_.push_back(region);
      }
    test_support::sort_cells(regions_);
    grid_ = std::make_unique<RegionGrid>(GridFrame{{-20.5, -20.5, -0.5}, 1}, std::span<const Region>{regions_});
  }

  Predictor::Regions predict(Strategy strategy, bool in_contact) const {
    Predictor predictor{*grid_, {kRadius, kMargin, 0, strategy}};
    for (int i = -60; i <= 0; ++i) predictor.observe(i * 0.002, {kTipSpeed * i * 0.002, 0, 0}, in_contact);
    Predictor::Regions predicted;
    predictor.predict(kLead, predicted);
    predicted.sort();
    return predicted;
  }
  static std::set<std::uint32_t> regions_of(const Predictor::Regions& predicted) {
    std::set<std::uint32_t> regions;
    for (const PredictedRegion& entry : predicted.entries()) regions.insert(index(entry.region));
    return regions;
  }
  [[nodiscard]] bool wants_cell(const Predictor::Regions& predicted, std::uint16_t x, std::uint16_t y) const {
    const std::span<const PredictedRegion> entries = predicted.entries();
    return std::any_of(entries.begin(), entries.end(), [&](const PredictedRegion& entry) {
      return regions_[index(entry.region)].cell == std::array<std::uint16_t, 3>{x, y, 0};
    });
  }
  /// Returns the cells with a point within `distance` of the path from the origin to `length` on the x axis.
  [[nodiscard]] std::set<std::uint32_t> cells_near_path(double length, double distance) const {
    std::set<std::uint32_t> regions;
    for (std::uint32_t r = 0; r < regions_.size(); ++r) {
      const double x = regions_[r].cell[0] - 20.0, y = regions_[r].cell[1] - 20.0;
      const double dx = std::max({0.0, x - 0.5 - length, -(x + 0.5)}), dy = std::max(0.0, std::abs(y) - 0.5);
      if (dx * dx + dy * dy <= distance * distance) regions.insert(r);
    }
    return regions;
  }

  std::vector<Region> regions_;
  std::unique_ptr<RegionGrid> grid_;
};

TEST_F(Prediction, LinearAndPolynomialStrategiesWantOnlyThePath) {
  for (const Strategy strategy : {Strategy::kLinear, Strategy::kPolynomial})
    EXPECT_EQ(regions_of(predict(strategy, true)), cells_near_path(kTipSpeed * kLead, kRadius + kMargin));
}

TEST_F(Prediction, NeighbourAndDistanceStrategiesWantAllDirectionsEqually) {
  EXPECT_EQ(regions_of(predict(Strategy::kNeighbours, true)),
            cells_near_path(0, kRadius + kMargin + kTipSpeed * kLead));
  EXPECT_EQ(regions_of(predict(Strategy::kDistance, false)),
            cells_near_path(0, kRadius + kMargin + kTipSpeed * kLead / 2));
}

TEST_F(Prediction, TheMixtureWantsThePathAndSomeCellsAroundIt) {
  const std::set<std::uint32_t> path = cells_near_path(kTipSpeed * kLead, kRadius + kMargin);
  for (const bool in_contact : {true, false}) {
    const std::set<std::uint32_t> wanted = regions_of(predict(Strategy::kMixture, in_contact));
    EXPECT_TRUE(std::includes(wanted.begin(), wanted.end(), path.begin(), path.end()));
    EXPECT_GT(wanted.size(), path.size());
  }
}

TEST_F(Prediction, EndsForTimesThatASpacingDoesNotIncrease) {
  Predictor predictor{*grid_, {kRadius, kMargin, 0, Strategy::kMixture}};
  for (const double time : {1e15, 1e18, 1e300, std::numeric_limits<double>::infinity()}) {
    predictor.observe(time, {0, 0, 0}, true);
    Predictor::Regions predicted;
    predictor.predict(kLead, predicted);
    predicted.sort();
    EXPECT_FALSE(predicted.entries().empty()) << time;
  }
}

TEST_F(Prediction, ListsTheCellOfTheTipFirstAndTheOthersByTimeToContact) {
  for (std::size_t s = 0; s < kStrategyNames.size(); ++s) {
    const Predictor::Regions predicted = predict(static_cast<Strategy>(s), true);
    const std::span<const PredictedRegion> entries = predicted.entries();
    ASSERT_GT(entries.size(), 1u) << kStrategyNames[s];
    EXPECT_TRUE(predicted.complete()) << kStrategyNames[s];
    EXPECT_EQ(entries[0].time_to_contact, 0) << kStrategyNames[s];
    EXPECT_TRUE(wants_cell(predicted, 20, 20)) << kStrategyNames[s];
    for (std::size_t i = 1; i < entries.size(); ++i)
      EXPECT_LE(entries[i - 1].time_to_contact, entries[i].time_to_contact) << kStrategyNames[s];
  }
}

}  // namespace
}  // namespace tactus::spm
