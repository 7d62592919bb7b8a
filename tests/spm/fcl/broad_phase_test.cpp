#include "spm/fcl/broad_phase.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <limits>
#include <map>
#include <random>
#include <utility>
#include <vector>

namespace tactus::spm::fcl {
namespace {

constexpr unsigned kBroadPhaseSeed = 20051;

using Pairs = std::vector<std::pair<std::uint32_t, std::uint32_t>>;

Pairs pairs_of(const std::vector<NearPair>& near) {
  Pairs pairs;
  for (const NearPair& n : near) pairs.emplace_back(n.probe, n.object);
  return pairs;
}

/// Compares the distance of each pair of sphere and box with the radius.
Pairs brute_force(const std::vector<BoundingSphere>& probes, const std::map<std::uint32_t, WorldBox>& boxes) {
  Pairs pairs;
  for (std::uint32_t p = 0; p < probes.size(); ++p) {
    for (const auto& [object, box] : boxes) {
      double squared = 0;
      for (int axis = 0; axis < 3; ++axis) {
        const double below = box.low[axis] - probes[p].centre[axis];
        const double above = probes[p].centre[axis] - box.high[axis];
        const double gap = std::max({below, above, 0.0});
        squared += gap * gap;
      }
      if (squared <= probes[p].radius * probes[p].radius) pairs.emplace_back(p, object);
    }
  }
  return pairs;
}

TEST(BroadPhase, AgreesWithBruteForceWhileObjectsAreAddedMovedAndRemoved) {
  SCOPED_TRACE("seed " + std::to_string(kBroadPhaseSeed));
  std::mt19937 rng{kBroadPhaseSeed};
  std::uniform_real_distribution<double> coordinate{-1, 1};
  std::uniform_real_distribution<double> size{0, 0.3};
  std::uniform_int_distribution<std::uint32_t> object_number{0, 40};
  const auto random_point = [&] { return Vec3d{coordinate(rng), coordinate(rng), coordinate(rng)}; };
  BroadPhase broad_phase;
  std::map<std::uint32_t, WorldBox> boxes;
  std::size_t found = 0;
  for (int round = 0; round < 300; ++round) {
    const std::uint32_t object = object_number(rng);
    if (round % 4 == 3) {
      broad_phase.remove(object);
      boxes.erase(object);
    } else {
      const Vec3d low = random_point();
      const WorldBox box{low, low + Vec3d{size(rng), size(rng), size(rng)}};
      broad_phase.put(object, box);
      boxes[object] = box;
    }
    std::vector<BoundingSphere> probes(5);
    for (BoundingSphere& probe : probes) probe = {random_point(), size(rng)};
    const Pairs expected = brute_force(probes, boxes);
    ASSERT_EQ(pairs_of(broad_phase.find_near_pairs(probes)), expected) << "round " << round;
    found += expected.size();
  }
  EXPECT_GT(found, 300u);
}

TEST(BroadPhase, CountsABoxThatASphereOnlyTouchesAsNear) {
  BroadPhase broad_phase;
  broad_phase.put(7, {{1, 1, 1}, {2, 2, 2}});
  const std::vector<BoundingSphere> probes{{{0.5, 1.5, 1.5}, 0.5}, {{0.5, 1.5, 1.5}, 0.499999}, {{1.5, 1.5, 1.5}, 0}};
  EXPECT_EQ(pairs_of(broad_phase.find_near_pairs(probes)), (Pairs{{0, 7}, {2, 7}}));
}

TEST(BroadPhase, FindsNothingWithoutObjects) {
  BroadPhase broad_phase;
  broad_phase.remove(3);
  const std::vector<BoundingSphere> probes{{{0, 0, 0}, 1}};
  EXPECT_TRUE(broad_phase.find_near_pairs(probes).empty());
}

TEST(BroadPhase, RefusesAnInvertedBoxAndAProbeThatIsNotFinite) {
  BroadPhase broad_phase;
  EXPECT_THROW(broad_phase.put(1, {{1, 0, 0}, {0, 1, 1}}), std::invalid_argument);
  const std::vector<BoundingSphere> probes{{{std::numeric_limits<double>::quiet_NaN(), 0, 0}, 1}};
  EXPECT_THROW(static_cast<void>(broad_phase.find_near_pairs(probes)), std::invalid_argument);
}

TEST(BroadPhase, RefusesANegativeRadiusHoweverSmallAndReportsIt) {
  BroadPhase broad_phase;
  const std::vector<BoundingSphere> probes{{{0, 0, 0}, 1}, {{0, 0, 0}, -1e-9}};
  std::string error;
  try {
    static_cast<void>(broad_phase.find_near_pairs(probes));
  } catch (const std::invalid_argument& refusal) {
    error = refusal.what();
  }
  EXPECT_EQ(error,
            "BroadPhase::find_near_pairs: probe 1: found radius -1e-09 and centre 0 0 0, expected finite numbers and a "
            "radius of at least 0");
}

}  // namespace
}  // namespace tactus::spm::fcl
