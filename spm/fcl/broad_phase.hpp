/// Finds the objects near each probe, with FCL's dynamic tree of axis-aligned boxes. The loader calls it, not the
/// cycle.
///
/// World frame, metres. Fast if objects move rarely; probes may move in every query. Allocates. One thread at a time.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "spm/model.hpp"

namespace tactus::spm::fcl {

/// An object's bounds, `low <= high` on each axis.
struct WorldBox {
  Vec3d low, high;
};

/// A sphere that contains a probe until the next query.
struct BoundingSphere {
  Vec3d centre;
  double radius = 0;
};

/// A probe (index in the query) and an object (number that the caller has given) whose sphere and box intersect.
struct NearPair {
  std::uint32_t probe = 0, object = 0;
};

class BroadPhase {
 public:
  BroadPhase();
  ~BroadPhase();
  BroadPhase(BroadPhase&&) noexcept;
  BroadPhase& operator=(BroadPhase&&) noexcept;

  /// Adds or moves `object`. O(log n). Throws std::invalid_argument if the box is inverted or not finite.
  void put(std::uint32_t object, const WorldBox& box);
  /// Removes `object` if it exists.
  void remove(std::uint32_t object);

  /// Returns all pairs in which the sphere intersects or touches the box, ordered by probe and object. Throws
  /// std::invalid_argument if a probe is not finite or its radius is negative.
  [[nodiscard]] std::vector<NearPair> find_near_pairs(std::span<const BoundingSphere> probes) const;

 private:
  struct Manager;
  std::unique_ptr<Manager> manager_;
};

}  // namespace tactus::spm::fcl
