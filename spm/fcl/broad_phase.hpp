/// Which objects are near which probes: FCL's dynamic tree of axis-aligned boxes, for the planner, outside the cycle.
///
/// World frame, metres. Objects move seldom, probes in every query. Allocates. One thread at a time.
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "spm/model.hpp"
#include "spm/span.hpp"

namespace tactus::spm::fcl {

/// An object's extent, `low <= high` on each axis.
struct WorldBox {
  Vec3d low, high;
};

/// A probe with all that it may reach until the next query.
struct ProbeSphere {
  Vec3d centre;
  double radius = 0;
};

/// `probe` is an index into the query's probes, `object` the caller's number.
struct NearPair {
  std::uint32_t probe = 0, object = 0;
};

class BroadPhase {
 public:
  BroadPhase();
  ~BroadPhase();
  BroadPhase(BroadPhase&&) noexcept;
  BroadPhase& operator=(BroadPhase&&) noexcept;

  /// Adds `object`, or moves it. O(log n). Throws std::invalid_argument when the box is inverted or not finite.
  void put(std::uint32_t object, const WorldBox& box);
  /// Without effect when it is not there.
  void remove(std::uint32_t object);

  /// All pairs in which the ball meets the box, touching included; by probe, then by object. Throws
  /// std::invalid_argument when a probe is not finite or its radius is below 0.
  [[nodiscard]] std::vector<NearPair> near(Span<const ProbeSphere> probes) const;

 private:
  struct Manager;
  std::unique_ptr<Manager> manager_;
};

}  // namespace tactus::spm::fcl
