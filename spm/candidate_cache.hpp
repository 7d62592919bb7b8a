/// The leaves of a tree around a ball, each with how far it is: a proxy that slides asks for many sweeps that start
/// within a hair of one another, and all but the first find here what they can meet.
///
/// Model frame, file units. Fixed memory. Belongs to a NodePool; one thread at a time.
#pragma once

#include <array>
#include <cstdint>

#include "spm/model.hpp"

namespace tactus::spm {

struct TreeNode;

struct CandidateCache {
  /// Of the ball's radius: how far around the ball there are leaves here. Further out costs each first sweep time, less
  /// far leaves more sweeps without.
  static constexpr double kAround = 0.03;
  static constexpr std::uint32_t kMaxLeaves = 512;

  struct Leaf {
    const TreeNode* node;
    double distance;  ///< of its nearest triangle from the centre
    unsigned lanes;   ///< bits of those that are not beyond the reach
  };

  // Which mesh: of what object, after what refit and, for one that was kept, in what keeping.
  std::uint32_t object = 0;
  std::uint64_t refit = 0, keeping = 0;
  std::uint64_t used = 0;  ///< when; the one longest unused makes room

  Vec3d centre = Vec3d::Zero();
  double reach = -1;     ///< every triangle no further from the centre is in a leaf here
  bool crowded = false;  ///< there are more leaves than fit: what is here is not all
  std::uint32_t count = 0;
  std::array<Leaf, kMaxLeaves> leaves;

  /// How far around `point` it knows everything; below 0: not even at it.
  [[nodiscard]] double known_around(const Vec3d& point) const noexcept { return reach - (point - centre).norm(); }
};

/// Of a NodePool: of two versions of a mesh or of two objects, around where a proxy was and where it is.
inline constexpr std::uint32_t kCandidateCaches = 4;

}  // namespace tactus::spm
