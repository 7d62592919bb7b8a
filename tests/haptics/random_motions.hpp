/// Hands that move at random through bodies that stand or move at random, and whether their proxies ever pass into one.
///
/// The oracle is the winding number around the proxy, summed over all triangles: it knows nothing of sweeps, planes and
/// nearest points.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "tests/haptics/triangle_surface.hpp"

namespace tactus::haptics::testing {

struct MotionBody {
  std::vector<Triangle> triangles = {};
  std::vector<Triangle> walls = {};  ///< what the proxy's winding is counted around; empty: `triangles`
  int winding = 0;                   ///< what it must be: 1 for a cavity that holds the proxy
  double speed = 0;                  ///< m/s; the body moves for a while and rests for a while, 0: never
  double turning = 0;                ///< rad/s
};

struct MotionScene {
  std::string name;
  std::vector<MotionBody> bodies = {};
  Vec3d start = {0.02, -0.01, 0.12};  ///< of the hand
  double range = 0.08;                ///< m from the origin at which the hand turns back
  double hand_speed = 1;              ///< m/s at most
  bool may_crush = false;             ///< bodies leave no room at times
};

struct MotionResult {
  std::uint64_t motions = 0;
  std::uint64_t contacts = 0;
  std::uint64_t pushed = 0;   ///< contacts while the touched body moved
  std::uint64_t crushed = 0;  ///< times that there was no room
  std::uint64_t passed = 0;   ///< proxies on the wrong side of a body; the first ends the run
  double deepest = 0;         ///< m by which a proxy's sphere overlapped a body, at most
  std::string what;           ///< passed
};

/// Solids, thin shells, grooves, corners; at rest, moving, and faster than the tip's radius in a cycle.
[[nodiscard]] std::vector<MotionScene> motion_scenes();

/// `told`: false hides from the proxy that bodies move; the oracle must find that.
[[nodiscard]] MotionResult run_motions(const MotionScene& scene, std::uint64_t motions, double friction,
                                       std::uint64_t seed, bool reported = true);
/// A closed box of edge 2 `half` around the origin; with its faces turned inwards it bounds a cavity.
[[nodiscard]] std::vector<Triangle> box(double half, bool inwards = false);

}  // namespace tactus::haptics::testing
