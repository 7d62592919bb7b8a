/// Simulates random hands that touch bodies at rest or in random motion, and checks that no proxy enters a body.
///
/// The test oracle is the winding number of a body's surface around the proxy, summed over all triangles. It is
/// independent of the proxy: it uses no sweeps, planes or closest points.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "tests/haptics/triangle_surface.hpp"

namespace tactus::haptics::testing {

struct MotionBody {
  std::vector<Triangle> triangles = {};
  std::vector<Triangle> walls = {};  ///< closed surface for the winding number; empty: `triangles`
  int winding = 0;                   ///< expected winding number; 1 if the proxy is inside the walls
  double speed = 0;                  ///< m/s; the body alternates between motion and rest; 0: always at rest
  double angular_speed = 0;          ///< rad/s
};

struct MotionScene {
  std::string name;
  std::vector<MotionBody> bodies = {};
  Vec3d start = {0.02, -0.01, 0.12};  ///< of the hand
  double range = 0.08;                ///< m; distance from the origin at which the hand turns back
  double hand_speed = 1;              ///< m/s, maximum
  bool may_crush = false;             ///< bodies may close around the tip until it has no space
};

struct MotionResult {
  std::uint64_t motions = 0;
  std::uint64_t contacts = 0;
  std::uint64_t pushed = 0;   ///< contacts while the touched body moved
  std::uint64_t crushed = 0;  ///< times at which bodies left no space for the tip
  std::uint64_t passed = 0;   ///< proxies on the wrong side of a body; the run ends at the first one
  double deepest = 0;         ///< m, maximum overlap of a proxy's sphere with a body
  std::string what;           ///< description of the first failure
};

/// Solids, thin shells, grooves and corners: at rest, in motion, and in motion by more than the tip's radius per cycle.
[[nodiscard]] std::vector<MotionScene> motion_scenes();

/// Runs `motions` cycles. `reported`: false hides the motion of bodies from the proxy. The oracle must then find a
/// proxy inside a body.
[[nodiscard]] MotionResult run_motions(const MotionScene& scene, std::uint64_t motions, double friction,
                                       std::uint64_t seed, bool reported = true);

/// A closed box with edges of 2 `half` around the origin. `inwards`: the faces bound a cavity.
[[nodiscard]] std::vector<Triangle> box(double half, bool inwards = false);

}  // namespace tactus::haptics::testing
