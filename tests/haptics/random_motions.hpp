/// Random hands in bodies at rest or in random motion; checks that their proxies never enter a body.
///
/// The oracle is the winding number around the proxy, summed over all triangles. It uses no sweeps, planes or closest
/// points.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "tests/haptics/triangle_surface.hpp"

namespace tactus::haptics::testing {

struct MotionBody {
  std::vector<Triangle> triangles = {};
  std::vector<Triangle> walls = {};  ///< triangles of the winding number; empty: `triangles`
  int winding = 0;                   ///< expected winding number: 1 for a cavity that contains the proxy
  double speed = 0;                  ///< m/s; the body alternates between motion and rest; 0: always at rest
  double turning = 0;                ///< rad/s
};

struct MotionScene {
  std::string name;
  std::vector<MotionBody> bodies = {};
  Vec3d start = {0.02, -0.01, 0.12};  ///< of the hand
  double range = 0.08;                ///< m from the origin at which the hand reverses
  double hand_speed = 1;              ///< m/s, maximum
  bool may_crush = false;             ///< bodies may leave no room
};

struct MotionResult {
  std::uint64_t motions = 0;
  std::uint64_t contacts = 0;
  std::uint64_t pushed = 0;   ///< contacts while the touched body moved
  std::uint64_t crushed = 0;  ///< times without room
  std::uint64_t passed = 0;   ///< proxies on the wrong side of a body; the first one ends the run
  double deepest = 0;         ///< m, greatest overlap of a proxy's sphere with a body
  std::string what;           ///< description of the first failure
};

/// Solids, thin shells, grooves, corners; at rest, moving, and faster than the tip's radius in a cycle.
[[nodiscard]] std::vector<MotionScene> motion_scenes();

/// `reported`: false hides the motion of bodies from the proxy; the oracle must detect it.
[[nodiscard]] MotionResult run_motions(const MotionScene& scene, std::uint64_t motions, double friction,
                                       std::uint64_t seed, bool reported = true);
/// A closed box of edge 2 `half` around the origin; with inward faces it bounds a cavity.
[[nodiscard]] std::vector<Triangle> box(double half, bool inwards = false);

}  // namespace tactus::haptics::testing
